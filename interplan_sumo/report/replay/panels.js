// --- panels: the parts of the page that are made from the data; whatever they show is set as text ---

const LAYERS = [
  ["plan", "Plan", true],
  ["trail", "Trail", true],
  ["route", "Route", true],
  ["lights", "Lights", true],
  ["seen", "What the planner saw", true],
  ["expert", "Expert", false],
  ["other", "Other planner", false],
  ["names", "Names", false],
];

const LEGEND = { standing: "standing vehicle", hiding: "hides pedestrians" };

/** An element with a class, a text and children. */
function element(tag, { className = "", text = null, ...properties } = {}, ...children) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== null) made.textContent = text;
  Object.assign(made, properties);
  made.append(...children);
  return made;
}

function fromForm(id) {
  return document.getElementById(id).content.firstElementChild.cloneNode(true);
}

function seconds(frame, data) {
  return `${(frame * data.dt_s).toFixed(1)} s`;
}

/** One planner's drive on the map. */
class Pane {
  constructor(drive, index, data, scene) {
    this.drive = drive;
    this.index = index;
    this.data = data;
    this.scene = scene;
    this.element = fromForm("pane-form");
    this.element.style.setProperty("--mine", `var(--planner-${index + 1})`);
    this.canvas = this.element.querySelector("canvas");
    this.hud = this.element.querySelector(".hud");
    this.badge = this.element.querySelector(".badge");
    this.who = this.element.querySelector(".who");
    this.fillHead();
  }

  fillHead() {
    const { drive } = this;
    this.element.setAttribute("aria-label", drive.planner);
    this.element.querySelector("h2").textContent = drive.planner;
    const score = this.element.querySelector(".score");
    if (drive.score === null) score.append(element("small", { text: "no score" }));
    else score.append(drive.score.toFixed(drive.score % 1 ? 1 : 0), element("small", { text: " / 100" }));
    const verdict = this.element.querySelector(".verdict");
    verdict.textContent = drive.fault ?? this.decided();
    verdict.classList.toggle("lost", drive.fault !== null || drive.score === 0);
  }

  decided() {
    const { metric, reason, frame } = this.drive.deciding;
    if (metric === "nothing") return `${this.drive.end} at ${seconds(frame, this.data)}, no points lost`;
    const when = seconds(frame, this.data);
    return reason.includes(when) ? reason : `${reason}, decided at ${when}`;
  }

  /** Where this pane looks at a frame. */
  centre(camera, frame) {
    return camera.centreFor(poseAt(this.drive.ego, Math.min(frame, this.drive.frames - 1)), this.canvas.clientWidth);
  }

  draw(camera, frame, state) {
    const { context, width, height, ratio } = sized(this.canvas);
    if (!width) return;
    const other = state.layers.other ? this.data.drives[1 - this.index] : null;
    this.scene.draw(this.drive, frame, {
      context, ratio, other,
      matrix: camera.matrix(this.centre(camera, frame), width, height, ratio),
      scale: camera.scale,
      layers: state.layers,
      colour: this.scene.look.planner(this.index),
      otherColour: this.scene.look.planner(1 - this.index),
      selected: state.selected,
    });
    drawScaleBar(context, this.scene.look, camera.scale, width, height, ratio);
    this.fillHud(frame);
    this.fillWho(frame, state.selected);
  }

  fillHud(frame) {
    const at = Math.min(Math.round(frame), this.drive.frames - 1);
    const speed = this.drive.charts.speed.values[at];
    this.hud.querySelector("b").textContent = `${speed.toFixed(1)} m/s`;
    this.hud.querySelector("span").textContent = `${Math.round(3.6 * speed)} km/h`;
    const ended = frame >= this.drive.frames - 1;
    this.badge.hidden = !ended;
    this.badge.textContent = `${this.drive.end} at ${seconds(this.drive.frames - 1, this.data)}`;
    this.badge.classList.toggle("lost", this.drive.end !== "goal line passed");
  }

  /** Who the selected road user is, where it is in this drive. */
  fillWho(frame, selected) {
    const held = Math.min(frame, this.drive.frames - 1);
    const found = selected && agentsAt(this.drive, held).find(({ agent }) => agent.id === selected.id);
    this.who.hidden = !found;
    if (!found) return;
    const { agent, pose } = found;
    const ego = poseAt(this.drive.ego, held);
    const speed = between(agent.speed, held - agent.first);
    const lines = [
      agent.behaviour,
      `${agent.length_m.toFixed(1)} x ${agent.width_m.toFixed(1)} m`,
      `${speed.toFixed(1)} m/s, ${Math.round(3.6 * speed)} km/h`,
      `its centre ${Math.hypot(pose.x - ego.x, pose.y - ego.y).toFixed(1)} m from the ego's`,
    ];
    const title = element("b", { text: `${agent.kind} ${agent.id}` });
    this.who.replaceChildren(title, ...lines.filter(Boolean).map((text) => element("span", { text })));
  }

  /** The road user under a pixel, or none; small ones can be met beside their box. */
  agentAt(camera, frame, x, y) {
    const SLACK_PX = 5;
    const { clientWidth, clientHeight } = this.canvas;
    const place = camera.place(this.centre(camera, frame), clientWidth, clientHeight, x, y);
    const slack = SLACK_PX / camera.scale;
    const hit = agentsAt(this.drive, Math.min(frame, this.drive.frames - 1)).find(({ agent, pose }) => {
      const [dx, dy] = [place.x - pose.x, place.y - pose.y];
      const [cos, sin] = [Math.cos(pose.heading), Math.sin(pose.heading)];
      const [ahead, left] = [dx * cos + dy * sin, dy * cos - dx * sin];
      return Math.abs(ahead) <= agent.length_m / 2 + slack && Math.abs(left) <= agent.width_m / 2 + slack;
    });
    return hit?.agent ?? null;
  }

  /** Everybody by distance from the ego. */
  nearest(frame) {
    const held = Math.min(frame, this.drive.frames - 1);
    const ego = poseAt(this.drive.ego, held);
    const away = ({ pose }) => Math.hypot(pose.x - ego.x, pose.y - ego.y);
    return agentsAt(this.drive, held).sort((a, b) => away(a) - away(b)).map(({ agent }) => agent);
  }
}

/** The score of a drive metric by metric, and its events; `seek` is called with a frame. */
function verdictSheet(drive, index, data, seek) {
  const sheet = fromForm("verdict-form");
  sheet.style.setProperty("--mine", `var(--planner-${index + 1})`);
  sheet.querySelector(".planner").textContent = `${drive.planner}, seed ${drive.seed}, profile ${drive.profile}`;
  sheet.querySelector(".note").hidden = drive.fault === null;
  sheet.querySelector("tbody").append(...drive.metrics.map((metric) => metricRow(metric, data, seek)));
  const items = drive.events.map((event) => element("li", {}, jumpButton(event, data, seek)));
  if (!items.length) items.push(element("li", { className: "soft", text: "none" }));
  sheet.querySelector(".events").append(...items);
  return sheet;
}

function metricRow({ title, weight, score, reason, frame }, data, seek) {
  const grade = score >= 0.9995 ? "good" : score > 0 ? "fair" : "poor";
  const why = element("td", { className: "why" });
  if (frame !== null) why.append(jumpButton({ frame, kind: "", text: reason ?? "points were lost" }, data, seek));
  return element("tr", { className: frame === null ? "" : "lost" },
    element("th", { scope: "row", text: title }),
    element("td", { text: weight === null ? "gate" : `weight ${weight}` }),
    element("td", { className: `number ${grade}`, text: (100 * score).toFixed(score % 1 && score < 0.9995 ? 1 : 0) }),
    why);
}

function jumpButton({ frame, kind, text, decides }, data, seek) {
  const button = element("button", { type: "button", className: `jump ${kind}${decides ? " decides" : ""}` },
    element("time", { text: seconds(frame, data) }), element("span", { text: decides ? `${text} (decides)` : text }));
  button.addEventListener("click", () => seek(frame));
  return button;
}

/** A mark above the time bar for each event; who uses keys has the list of events. */
function eventMarks(data, seek) {
  return data.drives.flatMap((drive, index) => drive.events.map((event) => {
    const mark = element("button", {
      type: "button", tabIndex: -1, className: `mark ${event.kind}${event.decides ? " decides" : ""}`,
      title: `${drive.planner}, ${seconds(event.frame, data)}: ${event.text}`,
    });
    mark.style.setProperty("--mine", `var(--planner-${index + 1})`);
    mark.style.left = `${(100 * event.frame) / Math.max(1, data.frames - 1)}%`;
    mark.addEventListener("click", () => seek(event.frame));
    return mark;
  }));
}

/** Boxes to tick for what is drawn, and a legend of who is there. */
function layerBoxes(data, look, layers, changed) {
  const offered = LAYERS.filter(([name]) => name !== "other" || data.drives.length > 1)
    .filter(([name]) => name !== "expert" || data.expert.x.length)
    .filter(([name]) => name !== "seen" || data.drives.some((drive) => drive.seen.length))
    .filter(([name]) => name !== "lights" || data.map.lights.length);
  const boxes = offered.map(([name, title, on]) => {
    layers[name] ??= on;
    const box = element("input", { type: "checkbox", checked: layers[name] });
    box.addEventListener("change", () => {
      layers[name] = box.checked;
      changed();
    });
    return element("label", {}, box, title);
  });
  return [...boxes, element("span", { className: "split" }), ...legend(data, look)];
}

function legend(data, look) {
  const there = new Map();
  const colours = Object.values(data.behaviours);
  const shares = (name) => colours.filter((colour) => colour === data.behaviours[name]).length > 1;
  for (const agent of data.drives.flatMap((drive) => drive.agents)) {
    const own = shares(agent.behaviour) ? "drivers, each its own type" : agent.behaviour;
    const name = own || (LEGEND[agent.look] ?? agent.look);
    if (!there.has(name)) there.set(name, agent);
  }
  return [...there].sort(([a], [b]) => (a < b ? -1 : 1)).map(([name, agent]) => {
    return legendEntry(look.agent(agent), name);
  }).concat(data.drives[0].triggers.length ? legendEntry("var(--person)", "ego's front here sets it off", "line") : []);
}

function legendEntry(colour, text, form = "") {
  const swatch = element("span", { className: `swatch ${form}` });
  swatch.style.setProperty("--mine", colour);
  return element("span", { className: "legend" }, swatch, text);
}
