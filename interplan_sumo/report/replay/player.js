// --- player: time, keys and pointers, and what follows from them ---

const LONG_STEP_S = 1;
const LONGEST_GAP_S = 0.25; // between two pictures; a page that nobody sees stands still
const ZOOM_STEP = 1.25;
const PAN_STEP_PX = 60;
const CLICK_PX = 4; // a pointer that moved less has clicked

class Player {
  constructor(data) {
    this.data = data;
    this.state = { frame: 0, playing: false, rate: 1, chosen: 0, layers: {}, selected: null };
    this.look = new Look(data);
    this.camera = new Camera(data.turned_rad);
    const scene = new Scene(data, this.look);
    this.panes = data.drives.map((drive, index) => new Pane(drive, index, data, scene));
    this.seek = this.seek.bind(this);
    this.charts = data.charts.map((chart) => new Chart(chart, data, this.look, this.seek));
    this.parts = Object.fromEntries([...document.querySelectorAll("[id]")].map((part) => [part.id, part]));
    this.lay();
    this.listen();
    this.choose(0, { silent: true });
    this.redraw();
  }

  // --- the page ---

  lay() {
    const { data, parts } = this;
    const USUAL_CHARTS = 8;
    parts.about.textContent = data.scenario.about.join(", ");
    parts.stage.append(...this.panes.map((pane) => pane.element));
    parts.charts.append(...this.charts.slice(0, USUAL_CHARTS).map((chart) => chart.element));
    parts["more-charts"].append(...this.charts.slice(USUAL_CHARTS).map((chart) => chart.element));
    parts.verdicts.append(...data.drives.map((drive, index) => verdictSheet(drive, index, data, (frame) => {
      this.choose(index, { silent: true });
      this.seek(frame);
      parts.stage.scrollIntoView({ block: "nearest" });
    })));
    parts.marks.append(...eventMarks(data, this.seek));
    parts.time.max = String(data.frames - 1);
    parts.whole.textContent = ((data.frames - 1) * data.dt_s).toFixed(1);
    this.layLayers();
  }

  layLayers() {
    this.parts.layers.replaceChildren(...layerBoxes(this.data, this.look, this.state.layers, () => this.redraw()));
  }

  redraw() {
    if (this.waits) return;
    this.waits = true;
    requestAnimationFrame((now) => {
      this.waits = false;
      this.tick(now);
      this.draw();
    });
  }

  draw() {
    const { state, camera, parts, data } = this;
    const [first] = this.panes;
    if (!camera.scale && first.canvas.clientWidth) camera.start(first.canvas.clientWidth);
    for (const pane of this.panes) pane.draw(camera, state.frame, state);
    for (const chart of this.charts) chart.draw(state.frame);
    const frame = Math.round(state.frame);
    const now = (frame * data.dt_s).toFixed(1);
    parts.time.value = String(frame);
    parts.time.setAttribute("aria-valuetext", `${now} seconds`);
    parts.now.textContent = now;
    parts.follow.setAttribute("aria-pressed", String(camera.follows));
  }

  say(text) {
    this.parts.said.textContent = text;
  }

  // --- time ---

  tick(now) {
    const { state, data } = this;
    if (state.playing) {
      const before = state.frame;
      const passed = this.drawnAt === undefined ? 0 : Math.min(LONGEST_GAP_S, (now - this.drawnAt) / 1000);
      state.frame = Math.min(data.frames - 1, state.frame + (passed * state.rate) / data.dt_s);
      this.sayPassed(before, state.frame);
      if (state.frame >= data.frames - 1) this.play(false);
      else this.redraw();
    }
    this.drawnAt = state.playing ? now : undefined;
  }

  play(on) {
    const { state, parts, data } = this;
    if (on && state.frame >= data.frames - 1) state.frame = 0;
    state.playing = on;
    if (!on) state.frame = Math.round(state.frame);
    parts.play.classList.toggle("playing", on);
    parts.play.setAttribute("aria-label", on ? "Pause" : "Play");
    this.redraw();
  }

  seek(frame) {
    this.play(false);
    this.state.frame = Math.min(this.data.frames - 1, Math.max(0, frame));
    const here = this.eventsAt(this.state.frame, this.state.frame);
    this.say([seconds(this.state.frame, this.data), ...here].join(". "));
  }

  step(frames) {
    this.seek(Math.round(this.state.frame) + frames);
  }

  /** Texts of the events from one frame to another, both included. */
  eventsAt(first, last) {
    const { drives } = this.data;
    const found = drives.flatMap((drive) => drive.events
      .filter(({ frame }) => frame >= first && frame <= last)
      .map(({ text }) => (drives.length > 1 ? `${drive.planner}: ${text}` : text)));
    return [...new Set(found)];
  }

  sayPassed(before, after) {
    const passed = this.eventsAt(Math.floor(before) + 1, Math.floor(after));
    if (passed.length) this.say(`${seconds(Math.floor(after), this.data)}. ${passed.join(". ")}`);
  }

  // --- the chosen planner ---

  choose(index, { silent = false } = {}) {
    if (index >= this.panes.length) return;
    this.state.chosen = index;
    this.panes.forEach((pane, i) => pane.element.classList.toggle("chosen", this.panes.length > 1 && i === index));
    if (!silent) this.say(`${this.data.drives[index].planner} chosen`);
    const whose = this.panes.length > 1 ? ` of ${this.data.drives[index].planner}` : "";
    this.parts.decide.title = `To the deciding moment${whose} (D)`;
    this.redraw();
  }

  get drive() {
    return this.data.drives[this.state.chosen];
  }

  decide() {
    this.seek(this.drive.deciding.frame);
    this.say(`${seconds(this.drive.deciding.frame, this.data)}. ${this.drive.planner}: ${this.drive.deciding.reason}`);
  }

  /** Say the command with which a person drives on from here. */
  takeOver() {
    this.play(false);
    const quoted = (text) => (/^[\w./:-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);
    const at = Math.min(this.state.frame, this.drive.plans.length - 1) * this.data.dt_s;
    const words = [quoted(this.data.scenario.id), "--from RUN", `--planner ${quoted(this.drive.planner)}`, `--at ${at.toFixed(1)}`];
    const can = this.drive.seed === 0;
    this.parts["take-over-words"].textContent = can
      ? "With the run folder in place of RUN, you are at the wheel at this moment:"
      : `Only drives with seed 0 can be driven on; this one has seed ${this.drive.seed}.`;
    this.parts["take-over-command"].textContent = can ? `interplan-sumo drive ${words.join(" ")}` : "";
    this.parts["take-over-box"].showModal();
  }

  /** To the next event of the chosen planner, or to the one before. */
  nextEvent(direction) {
    const now = Math.round(this.state.frame);
    const frames = this.drive.events.map(({ frame }) => frame);
    const next = direction > 0 ? frames.find((frame) => frame > now) : frames.findLast((frame) => frame < now);
    if (next !== undefined) this.seek(next);
  }

  // --- who is that ---

  select(agent) {
    this.state.selected = agent ? { id: agent.id } : null;
    if (agent) this.say(`${agent.kind} ${agent.id} ${agent.behaviour}`);
    this.redraw();
  }

  selectNext() {
    const order = this.panes[this.state.chosen].nearest(this.state.frame);
    const at = order.findIndex(({ id }) => id === this.state.selected?.id);
    if (order.length) this.select(order[(at + 1) % order.length]);
  }

  // --- the view ---

  zoom(factor) {
    const pane = this.panes[this.state.chosen];
    this.zoomAt(pane, factor, pane.canvas.clientWidth / 2, pane.canvas.clientHeight / 2);
  }

  pan(dx, dy) {
    this.camera.drag(this.panes[this.state.chosen].centre(this.camera, this.state.frame), dx, dy);
    this.redraw();
  }

  fit() {
    const { canvas } = this.panes[0];
    this.camera.fit(this.data.extent, canvas.clientWidth, canvas.clientHeight);
    this.redraw();
  }

  follow() {
    if (this.camera.follows) this.camera.centre = this.panes[this.state.chosen].centre(this.camera, this.state.frame);
    this.camera.follows = !this.camera.follows;
    if (this.camera.follows) this.camera.scale = Math.max(this.camera.scale, LEAST_FOLLOWING_SCALE);
    this.say(this.camera.follows ? "follows the ego" : "stays in place");
    this.redraw();
  }

  // --- what the viewer does ---

  listen() {
    const { parts } = this;
    const last = this.data.frames - 1;
    const clicks = {
      "to-start": () => this.seek(0), "to-end": () => this.seek(last),
      back: () => this.step(-1), forward: () => this.step(1),
      play: () => this.play(!this.state.playing), decide: () => this.decide(),
      fit: () => this.fit(), follow: () => this.follow(),
      "zoom-in": () => this.zoom(ZOOM_STEP), "zoom-out": () => this.zoom(1 / ZOOM_STEP),
      "help-open": () => parts.help.showModal(), "take-over": () => this.takeOver(),
    };
    for (const [id, act] of Object.entries(clicks)) parts[id].addEventListener("click", act);
    parts.time.addEventListener("input", () => this.seek(Number(parts.time.value)));
    parts.rate.addEventListener("change", () => {
      this.state.rate = Number(parts.rate.value);
    });
    parts["more-charts-box"].addEventListener("toggle", () => this.redraw());
    document.addEventListener("keydown", (event) => this.key(event));
    document.addEventListener("click", (event) => {
      if (event.detail > 0) event.target.closest("button")?.blur(); // clicked, not pressed: Space shall play afterwards
    });
    new ResizeObserver(() => this.redraw()).observe(parts.stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.look.read();
      this.layLayers();
      this.redraw();
    });
    this.panes.forEach((pane, index) => this.listenTo(pane, index));
  }

  key(event) {
    if (document.querySelector("dialog[open]") || event.ctrlKey || event.metaKey || event.altKey) return;
    const { target } = event;
    if (target instanceof HTMLSelectElement) return;
    const presses = target instanceof HTMLButtonElement || target.matches("input[type=checkbox], summary");
    if (event.key === " " && presses) return; // it presses what has the focus
    const act = this.keyActions(event)[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  keyActions({ shiftKey }) {
    const step = shiftKey ? Math.round(LONG_STEP_S / this.data.dt_s) : 1;
    return {
      " ": () => this.play(!this.state.playing),
      ArrowLeft: () => this.step(-step), ArrowRight: () => this.step(step),
      Home: () => this.seek(0), End: () => this.seek(this.data.frames - 1),
      d: () => this.decide(), p: () => this.nextEvent(-1), n: () => this.nextEvent(1),
      1: () => this.choose(0), 2: () => this.choose(1),
      "+": () => this.zoom(ZOOM_STEP), "=": () => this.zoom(ZOOM_STEP), "-": () => this.zoom(1 / ZOOM_STEP),
      0: () => this.fit(), f: () => this.follow(),
      i: () => this.pan(0, PAN_STEP_PX), k: () => this.pan(0, -PAN_STEP_PX),
      j: () => this.pan(PAN_STEP_PX, 0), l: () => this.pan(-PAN_STEP_PX, 0),
      a: () => this.selectNext(), Escape: () => this.select(null), "?": () => this.parts.help.showModal(),
    };
  }

  /** Drag to pan, wheel or two fingers to zoom, click to ask who that is. */
  listenTo(pane, index) {
    const { canvas } = pane;
    const down = new Map(); // pointers that are down, by id
    let travelled = 0;
    canvas.setAttribute("aria-label", `Map with the drive of ${pane.drive.planner}. Keys: see Keys.`);
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, event);
      travelled = 0;
      this.choose(index, { silent: true });
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const other = [...down].find(([id]) => id !== event.pointerId)?.[1];
      if (other) this.pinch(pane, other, before, event);
      else if ((travelled += Math.hypot(event.clientX - before.clientX, event.clientY - before.clientY)) > CLICK_PX) {
        this.pan(event.clientX - before.clientX, event.clientY - before.clientY);
      }
      down.set(event.pointerId, event);
    });
    canvas.addEventListener("pointerup", (event) => {
      const clicked = down.size === 1 && travelled <= CLICK_PX;
      down.delete(event.pointerId);
      if (clicked) this.select(pane.agentAt(this.camera, this.state.frame, event.offsetX, event.offsetY));
    });
    canvas.addEventListener("pointercancel", (event) => down.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const PIXELS_PER_DOUBLING = 400;
      this.zoomAt(pane, 2 ** (-event.deltaY / PIXELS_PER_DOUBLING), event.offsetX, event.offsetY);
    }, { passive: false });
  }

  zoomAt(pane, factor, x, y) {
    const { clientWidth, clientHeight } = pane.canvas;
    this.camera.zoom(factor, pane.centre(this.camera, this.state.frame), clientWidth, clientHeight, x, y);
    this.redraw();
  }

  pinch(pane, other, before, event) {
    const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
    const box = pane.canvas.getBoundingClientRect();
    const [x, y] = [(event.clientX + other.clientX) / 2 - box.left, (event.clientY + other.clientY) / 2 - box.top];
    if (apart(before) > 0) this.zoomAt(pane, apart(event) / apart(before), x, y);
  }
}

/** Start at the time that the address asks for: replay.html#t=6.2, or replay.html#decides, shortly before that. */
function startTime(data) {
  const EARLIER_S = 3;
  if (location.hash === "#decides") {
    const first = Math.min(...data.drives.map(({ deciding }) => deciding.frame));
    return Math.max(0, first - Math.round(EARLIER_S / data.dt_s));
  }
  const asked = /^#t=(\d+(?:\.\d+)?)$/.exec(location.hash);
  return asked ? Math.round(Number(asked[1]) / data.dt_s) : 0;
}

try {
  const data = decoded(await unpacked(document.getElementById("replay-data")));
  const player = new Player(data);
  player.seek(startTime(data));
  document.documentElement.dataset.ready = "yes";
} catch (error) {
  const trouble = document.getElementById("trouble");
  trouble.hidden = false;
  trouble.textContent = `This browser cannot show the replay (${error.message}). Any from 2023 on can.`;
}
