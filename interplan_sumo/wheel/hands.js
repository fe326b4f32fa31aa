// --- hands: what keys or a gamepad say, and the way of it to the program ---

const KEYS = {
  ArrowUp: "throttle", w: "throttle", ArrowDown: "brake", s: "brake", " ": "hard",
  ArrowLeft: "left", a: "left", ArrowRight: "right", d: "right",
};
const THROTTLE = 0.8; // of a key, which knows no half: 2.4 m/s2, as much as is comfortable
const BRAKE = 0.45; // 3.6 m/s2
const DEAD_ZONE = 0.08; // of a stick that nobody touches
const GRADES = 50; // that a stick is told in

class Hands {
  constructor() {
    this.down = new Set();
    this.number = 0;
    this.held = { push: 0, turn: 0 };
    this.asked = new Map(); // when each number was said, in milliseconds
  }

  /** A key goes down or up; whether it drives. */
  key(name, isDown) {
    const what = KEYS[name.length === 1 ? name.toLowerCase() : name];
    if (!what) return false;
    if (isDown) this.down.add(what);
    else this.down.delete(what);
    return true;
  }

  release() {
    this.down.clear();
  }

  /** What is held now, of keys and the first gamepad whatever says more. */
  read() {
    const is = (what) => (this.down.has(what) ? 1 : 0);
    let push = this.down.has("hard") ? -1 : THROTTLE * is("throttle") - BRAKE * is("brake");
    let turn = is("left") - is("right");
    const pad = [...(navigator.getGamepads?.() ?? [])].find((each) => each?.connected);
    if (pad) {
      const [brake, throttle] = [pad.buttons[6]?.value ?? 0, pad.buttons[7]?.value ?? 0];
      const stick = Math.abs(pad.axes[0] ?? 0) < DEAD_ZONE ? 0 : pad.axes[0];
      push ||= Math.round((throttle - brake) * GRADES) / GRADES;
      turn ||= -Math.round(Math.sign(stick) * stick * stick * GRADES) / GRADES; // fine near the middle
    }
    return { push, turn: turn || 0 };
  }

  /** Say what is held, if that is news, and what is wanted, if anything. */
  say(act = null, now = performance.now()) {
    const held = this.read();
    if (act === null && held.push === this.held.push && held.turn === this.held.turn) return;
    this.held = held;
    this.number += 1;
    this.asked.set(this.number, now);
    fetch("hands", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ number: this.number, ...held, act }),
    }).catch(() => {}); // the stream tells when the program is gone
  }

  /** Milliseconds since this number was said, once; what is older is forgotten. */
  since(number, now) {
    const asked = this.asked.get(number);
    for (const each of this.asked.keys()) if (each <= number) this.asked.delete(each);
    return asked === undefined ? null : now - asked;
  }
}
