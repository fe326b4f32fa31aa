// --- wheel: one person, one canvas, and a stream of what happens ---

const FARTHEST_BEHIND = 1.5; // frames that the picture may lag before it jumps
const LAYERS_SHOWN = { plan: true, trail: true, route: true, lights: true };
const USUAL_HEIGHT_M = 85; // of the map on the screen
const NARROW_PX = 640; // the dash leaves no room beside it for the scale
const DASH_PX = 52;
const ZOOMS = { "+": 1.25, "=": 1.25, "-": 1 / 1.25 };

class Wheel {
  constructor() {
    this.parts = Object.fromEntries([...document.querySelectorAll("[id]")].map((part) => [part.id, part]));
    this.canvas = this.parts.map;
    this.hands = new Hands();
    this.state = "loading";
    this.pictures = [];
    this.delays = [];
    this.zoomed = 1;
    this.listen();
    requestAnimationFrame((now) => this.tick(now));
  }

  // --- what the program tells ---

  hear(event) {
    const { kind } = event;
    if (kind === "scene") this.begin(event);
    else if (kind === "frame") this.take(event);
    else if (kind === "end") this.end(event);
    else this.become(kind);
  }

  begin(scene) {
    this.scene = { ...scene, map: decodedMap(scene) };
    this.look = new Look(this.scene);
    this.drawing = new Scene(this.scene, this.look);
    this.drive = new LiveDrive(this.scene);
    this.camera = new ChaseCamera();
    this.shown = 0;
    this.now = null;
    this.parts.heading.textContent = scene.id;
    this.parts.place.textContent = scene.scenes > 1 ? `${scene.number + 1} of ${scene.scenes}` : "";
    this.become("loading");
  }

  take(frame) {
    this.drive.append(frame);
    this.now = frame;
    this.arrived = frame.number;
  }

  become(state) {
    this.state = state;
    document.documentElement.dataset.state = state;
    for (const box of document.querySelectorAll(".box")) box.hidden = box.id !== `box-${state}`;
  }

  end({ score, reached_goal: reached, reasons, metrics, replay }) {
    const { parts } = this;
    parts.score.textContent = score === null ? "no score" : `${score} of 100`;
    parts.verdict.textContent = reached ? "The goal line was passed." : "The goal line was not passed.";
    parts.reasons.replaceChildren(...reasons.map((text) => listed("li", text)));
    parts.metrics.replaceChildren(...metrics.map(([title, value]) => {
      const row = document.createElement("tr");
      row.append(listed("th", title), listed("td", String(value)));
      return row;
    }));
    parts.replay.href = `replay/${replay}#decides`;
    parts.next.textContent = this.scene.number + 1 < this.scene.scenes ? "Next scene" : "Done";
    this.become("end");
  }

  // --- pictures ---

  tick(now) {
    requestAnimationFrame((later) => this.tick(later));
    const seconds = this.drawnAt === undefined ? 0 : Math.min(0.25, (now - this.drawnAt) / 1000);
    this.drawnAt = now;
    if (this.state === "driving") this.hands.say();
    if (!this.now) return;
    const last = this.drive.frames - 1;
    this.shown = Math.min(last, this.shown + seconds / this.scene.dt_s);
    if (last - this.shown > FARTHEST_BEHIND) this.shown = last - 1;
    this.draw(seconds);
    this.count(now);
  }

  draw(seconds) {
    const { context, width, height, ratio } = sized(this.canvas);
    if (!width) return;
    const { camera, drive, now } = this;
    const pose = poseAt(drive.ego, this.shown);
    camera.scale = (this.zoomed * height) / USUAL_HEIGHT_M;
    camera.turnTo(pose.heading, seconds, !this.parts.north.checked);
    const held = this.hands.read();
    drive.plans = [guide(pose, now.speed_mps, held, now.largest_turn_rad, this.scene.ego.wheelbase_m)];
    this.drawing.draw(drive, this.shown, {
      context, ratio, other: null, matrix: camera.matrix(camera.centreFor(pose, height), width, height, ratio),
      scale: camera.scale, layers: LAYERS_SHOWN, colour: this.look.planner(0), selected: null,
    });
    drawScaleBar(context, this.look, camera.scale, width, height - (width < NARROW_PX ? DASH_PX : 0), ratio);
    this.fillHud();
  }

  fillHud() {
    const { parts, now } = this;
    const over = now.limit_mps !== null && now.speed_mps > now.limit_mps + 0.3;
    parts.speed.textContent = Math.round(3.6 * now.speed_mps);
    parts.speed.classList.toggle("lost", over);
    parts.limit.textContent = now.limit_mps === null ? "" : `limit ${Math.round(3.6 * now.limit_mps)}`;
    parts.goal.textContent = now.to_goal_m > 0 ? `${Math.round(now.to_goal_m)} m to the goal` : "goal";
    parts.time.textContent = `${(now.frame * 0.1).toFixed(1)} s`;
  }

  /** Pictures in the last second, and how long the last keys took to reach one. */
  count(now) {
    this.pictures = [...this.pictures.filter((at) => at > now - 1000), now];
    if (this.arrived) {
      const delay = this.hands.since(this.arrived, now);
      if (delay !== null) this.delays = [...this.delays.slice(-49), delay];
      this.arrived = 0;
    }
    const sorted = [...this.delays].sort((a, b) => a - b);
    const middle = sorted.length ? `, ${Math.round(sorted[sorted.length >> 1])} ms from key to traffic` : "";
    this.parts.pace.textContent = `${this.pictures.length} pictures a second${middle}`;
    this.parts.pace.dataset.delays = JSON.stringify(sorted.map(Math.round));
  }

  // --- what the person does ---

  act(what) {
    this.hands.say(what);
  }

  listen() {
    const { parts } = this;
    const acts = { start: "start", resume: "pause", again: "again", next: "next", restart: "restart", quit: "quit" };
    for (const [id, what] of Object.entries(acts)) parts[id].addEventListener("click", () => this.act(what));
    document.addEventListener("keydown", (event) => this.key(event));
    document.addEventListener("keyup", (event) => {
      if (this.hands.key(event.key, false) && this.state === "driving") this.hands.say();
    });
    addEventListener("blur", () => {
      this.hands.release();
      if (this.state === "driving") this.act("pause");
    });
    const stream = new EventSource("events");
    stream.addEventListener("message", ({ data }) => {
      const event = JSON.parse(data);
      if (["over", "elsewhere"].includes(event.kind)) stream.close();
      this.hear(event);
    });
    stream.addEventListener("error", () => {
      if (stream.readyState !== EventSource.OPEN && !["over", "elsewhere"].includes(this.state)) this.become("gone");
    });
  }

  key(event) {
    const { key } = event;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (ZOOMS[key]) {
      this.zoomed = Math.min(3, Math.max(0.4, this.zoomed * ZOOMS[key]));
      return;
    }
    const pressed = event.target.closest("button, a, input");
    if (pressed && [" ", "Enter"].includes(key)) return; // it presses what has the focus
    if (this.state === "ready" && !event.repeat && (key === "Enter" || KEYS[key])) this.act("start");
    if (this.state === "paused" && !event.repeat && ["p", "P", "Enter"].includes(key)) this.act("pause");
    else if (this.state === "driving" && !event.repeat && ["p", "P", "Escape"].includes(key)) this.act("pause");
    if (!this.hands.key(key, true)) return;
    event.preventDefault();
    if (this.state === "driving" && !event.repeat) this.hands.say();
  }
}

function listed(tag, text) {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}

document.documentElement.dataset.state = "loading";
new Wheel();
