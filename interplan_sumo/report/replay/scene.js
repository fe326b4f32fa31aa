// --- scene: one frame of one drive, drawn in metres of the map ---

const STATUSES = ["green", "yellow", "red", "unknown"];
const FLASH_S = 0.6; // how long a lost gate is ringed
const ARROW = [[1.6, 0], [0.5, 0.5], [0.5, 0.12], [-1.6, 0.12], [-1.6, -0.12], [0.5, -0.12], [0.5, -0.5]];
const TRAIL_WIDTH_M = 0.35;

/** The page's colours, read from its style whenever the scheme changes. */
class Look {
  constructor({ looks, behaviours }) {
    this.looks = new Map(Object.entries(looks));
    this.behaviours = new Map(Object.entries(behaviours));
    this.read();
  }

  read() {
    const style = getComputedStyle(document.documentElement);
    this.dark = matchMedia("(prefers-color-scheme: dark)").matches;
    this.value = (name) => style.getPropertyValue(`--${name}`).trim();
    this.seen = new Map();
  }

  colour(name) {
    if (!this.seen.has(name)) this.seen.set(name, this.value(name) || "#888888");
    return this.seen.get(name);
  }

  planner(index) {
    return this.colour(`planner-${index + 1}`);
  }

  /** Of an agent by its behaviour or by what it is; lighter in the dark. */
  agent(agent) {
    const colour = this.behaviours.get(agent.behaviour) ?? this.looks.get(agent.look);
    return this.dark ? mixed(colour, 255, 0.35) : colour;
  }
}

/** A colour "#rrggbb" with a share of a grey in it. */
function mixed(colour, grey, share) {
  const parts = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
  return `rgb(${parts.map((part) => Math.round(part + (grey - part) * share)).join(" ")})`;
}

/** The status of a light in a frame, from its changes. */
function statusAt(changes, frame) {
  let found = "unknown";
  for (const [since, status] of changes) if (since <= frame) found = STATUSES[status];
  return found;
}

/** Agents that are there in a frame, with their poses. */
function agentsAt(drive, frame) {
  const there = drive.agents.filter((agent) => frame >= agent.first && Math.floor(frame) < agent.first + agent.frames);
  return there.map((agent) => ({ agent, pose: poseAt(agent, frame - agent.first) }));
}

function isVehicle({ agent }) {
  return ["vehicle", "standing", "hiding"].includes(agent.look);
}

class Scene {
  constructor(data, look) {
    this.data = data;
    this.look = look;
  }

  /** Draw a drive at a frame; `view` has context, matrix, scale in pixels per metre, layers, ego colour, selection. */
  draw(drive, frame, view) {
    const { context } = view;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.look.colour("ground");
    context.fillRect(0, 0, context.canvas.width, context.canvas.height);
    context.setTransform(...view.matrix);
    context.lineJoin = "round";
    const held = Math.min(frame, drive.frames - 1);
    this.drawRoads(view);
    if (view.layers.route) this.drawRoute(view);
    if (view.layers.lights) this.drawLights(drive, held, view);
    this.drawTriggers(drive, held, view);
    if (view.layers.trail) this.drawTrail(drive, held, view);
    if (view.layers.expert) this.drawGhost(this.data.expert, frame, drive.ego, this.look.colour("expert"), view);
    if (view.other) this.drawGhost(view.other.ego, frame, drive.ego, view.otherColour, view);
    if (view.layers.plan) this.drawPlan(drive, held, view);
    const there = agentsAt(drive, held);
    for (const { agent, pose } of there.filter(isVehicle)) this.drawAgent(agent, pose, view);
    this.drawEgo(drive, held, view);
    if (view.layers.seen) this.drawSeen(drive, held, view);
    const people = there.filter((each) => !isVehicle(each)); // last, so that one sees who is under the ego
    for (const { agent, pose } of people) this.drawAgent(agent, pose, view);
    this.drawLoss(drive, held, view);
    if (view.layers.names) this.drawNames(drive, held, view);
  }

  // --- roads ---

  drawRoads({ context, scale }) {
    const { map } = this.data;
    const fill = (path, name) => {
      context.fillStyle = this.look.colour(name);
      context.fill(path, "evenodd");
    };
    const stroke = (path, name, width, dash = []) => {
      context.strokeStyle = this.look.colour(name);
      context.lineWidth = Math.max(width, 0.8 / scale);
      context.setLineDash(dash);
      context.stroke(path);
    };
    for (const { kind, path } of map.areas) fill(path, kind);
    stroke(map.edge, "edge", 0.12);
    context.globalAlpha = 0.5;
    stroke(map.connectors, "marking", 0.06);
    context.globalAlpha = 0.3;
    fill(map.crosswalks, "crosswalk");
    context.globalAlpha = 0.85;
    fill(map.zebras, "crosswalk");
    context.globalAlpha = 1;
    stroke(map.solid, "marking", 0.13);
    stroke(map.dashed, "marking", 0.13, [3, 3]);
    stroke(map.middle, "middle", 0.16);
    context.setLineDash([]);
    context.globalAlpha = 0.8;
    for (const { kind, path } of map.stops) fill(path, `stop-${kind.replaceAll("_", "-")}`);
    context.globalAlpha = 1;
    if (scale > 2.5) this.drawArrows(context);
  }

  drawArrows(context) {
    context.globalAlpha = 0.7;
    context.fillStyle = this.look.colour("marking");
    for (const { x, y, heading } of this.data.map.arrows) {
      shape(context, { x, y, heading }, ARROW);
      context.fill();
    }
    context.globalAlpha = 1;
  }

  drawRoute({ context, scale }) {
    const { map } = this.data;
    context.lineCap = "round";
    context.strokeStyle = this.look.colour("route");
    context.globalAlpha = 0.3;
    context.lineWidth = Math.max(0.5, 2 / scale);
    context.stroke(map.route);
    context.globalAlpha = 1;
    context.lineCap = "butt";
    context.strokeStyle = this.look.colour("goal");
    context.lineWidth = Math.max(0.6, 3 / scale);
    context.stroke(map.goal);
  }

  drawLights(drive, frame, { context, scale }) {
    for (const light of this.data.map.lights) {
      const changes = drive.signals[light.id];
      if (!changes) continue;
      context.strokeStyle = this.look.colour(`light-${statusAt(changes, Math.floor(frame))}`);
      context.globalAlpha = 0.35;
      context.lineWidth = Math.max(0.25, 1 / scale);
      context.stroke(light.way);
      context.globalAlpha = 1;
      context.lineWidth = Math.max(0.9, 3.5 / scale);
      context.stroke(light.bar);
    }
  }

  // --- who walks, who drives ---

  drawTriggers(drive, frame, { context, scale }) {
    for (const trigger of drive.triggers) {
      const waits = trigger.frame === null || frame < trigger.frame;
      context.strokeStyle = this.look.colour("person");
      context.globalAlpha = waits ? 0.9 : 0.35;
      context.lineWidth = Math.max(0.16, 1.2 / scale);
      context.setLineDash([0.8, 0.5]);
      strokeLine(context, trigger.way);
      context.setLineDash([]);
      if (waits && trigger.x.length) {
        const pose = poseAt(trigger, frame);
        context.lineWidth = Math.max(0.3, 2 / scale);
        const [cos, sin] = [Math.cos(pose.heading), Math.sin(pose.heading)];
        strokeLine(context, [2.4, -2.4].map((left) => [pose.x - left * sin, pose.y + left * cos]));
      }
      context.globalAlpha = 1;
    }
  }

  drawTrail(drive, frame, { context, scale, colour }) {
    const points = [];
    for (let k = 0; k <= Math.floor(frame); k += 1) points.push([drive.ego.x[k], drive.ego.y[k]]);
    const now = poseAt(drive.ego, frame);
    points.push([now.x, now.y]);
    context.strokeStyle = colour;
    context.globalAlpha = 0.45;
    context.lineCap = "round";
    context.lineWidth = Math.max(TRAIL_WIDTH_M, 2 / scale);
    strokeLine(context, points);
    context.globalAlpha = 1;
  }

  drawGhost(path, frame, size, colour, { context, scale }) {
    if (!path.x.length) return;
    boxPath(context, poseAt(path, frame), size.length_m, size.width_m);
    context.strokeStyle = colour;
    context.fillStyle = colour;
    context.lineWidth = Math.max(0.12, 1.4 / scale);
    context.globalAlpha = 0.16;
    context.fill();
    context.globalAlpha = 0.85;
    context.setLineDash([0.7, 0.4]);
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  /** Outlines of the others where the planner took them to be; they jump from frame to frame, as they did for it. */
  drawSeen(drive, frame, { context, scale }) {
    const now = Math.floor(frame);
    context.strokeStyle = this.look.colour("ink");
    context.lineWidth = Math.max(0.1, 1.4 / scale);
    context.setLineDash([0.5, 0.3]);
    for (const track of drive.seen) {
      if (now < track.first || now >= track.first + track.frames) continue;
      boxPath(context, poseAt(track, now - track.first), track.length_m, track.width_m);
      context.stroke();
    }
    context.setLineDash([]);
  }

  drawPlan(drive, frame, { context, scale, colour }) {
    const plan = drive.plans[Math.min(Math.floor(frame), drive.plans.length - 1)];
    if (!plan) return;
    const dot = Math.max(0.28, 2.2 / scale);
    context.lineCap = "round";
    for (const [style, width] of [[this.look.colour("plan-halo"), dot * 1.5], [colour, dot * 0.7]]) {
      context.strokeStyle = style;
      context.lineWidth = width;
      strokeLine(context, plan);
    }
    context.fillStyle = colour;
    context.strokeStyle = this.look.colour("plan-halo");
    context.lineWidth = dot * 0.4;
    for (const [x, y] of plan) {
      context.beginPath();
      context.arc(x, y, dot, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
  }

  drawAgent(agent, pose, { context, scale, selected }) {
    const colour = this.look.agent(agent);
    if (isVehicle({ agent })) this.drawVehicle(pose, agent, colour, { context, scale });
    else this.drawSmall(pose, agent, colour, { context, scale });
    if (selected?.id !== agent.id) return;
    context.strokeStyle = this.look.colour("ink");
    context.lineWidth = 2 / scale;
    context.beginPath();
    context.arc(pose.x, pose.y, Math.hypot(agent.length_m, agent.width_m) / 2 + 6 / scale, 0, 2 * Math.PI);
    context.stroke();
  }

  /** A box with a bright windscreen, so that one sees where its front is. */
  drawVehicle(pose, { length_m: length, width_m: width }, colour, { context, scale }) {
    boxPath(context, pose, length, width, Math.min(0.5, width / 4));
    context.fillStyle = colour;
    context.fill();
    context.strokeStyle = this.look.colour("glass");
    context.lineWidth = Math.max(0.06, 0.8 / scale);
    context.globalAlpha = 0.9;
    context.stroke();
    context.fillStyle = this.look.colour("glass");
    context.globalAlpha = 0.85;
    const front = length / 2 - Math.min(0.28 * length, 1.5);
    const [half, side] = [Math.min(0.12 * length, 0.7) / 2, 0.39 * width];
    shape(context, pose, [[front + half, side], [front - half, side], [front - half, -side], [front + half, -side]]);
    context.fill();
    context.globalAlpha = 1;
  }

  /** A box that can be seen also from far away. */
  drawSmall(pose, agent, colour, { context, scale }) {
    const least = 5 / scale;
    const cut = agent.look === "pedestrian" ? 0.2 : 0;
    boxPath(context, pose, Math.max(agent.length_m, least), Math.max(agent.width_m, least), cut);
    context.fillStyle = colour;
    context.fill();
    context.strokeStyle = this.look.colour("glass");
    context.lineWidth = Math.max(0.05, 0.8 / scale);
    context.stroke();
  }

  drawEgo(drive, frame, { context, scale, colour }) {
    this.drawVehicle(poseAt(drive.ego, frame), drive.ego, colour, { context, scale });
  }

  /** A ring around the ego for a while after a gate is lost. */
  drawLoss(drive, frame, { context, scale }) {
    const lost = drive.events.find(({ kind, frame: at }) =>
      (kind === "gate" || kind === "fault") && frame >= at && (frame - at) * this.data.dt_s <= FLASH_S);
    if (!lost) return;
    const pose = poseAt(drive.ego, frame);
    context.strokeStyle = this.look.colour("poor");
    context.lineWidth = Math.max(0.35, 3 / scale);
    context.beginPath();
    context.arc(pose.x, pose.y, drive.ego.length_m * 0.8, 0, 2 * Math.PI);
    context.stroke();
  }

  drawNames(drive, frame, { context, matrix, ratio }) {
    const [a, b, c, d, e, f] = matrix;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineWidth = 3;
    context.strokeStyle = this.look.colour("ground");
    context.fillStyle = this.look.colour("ink");
    for (const { agent, pose } of agentsAt(drive, frame)) {
      const [x, y] = [(a * pose.x + c * pose.y + e) / ratio, (b * pose.x + d * pose.y + f) / ratio - 10];
      context.strokeText(agent.id, x, y);
      context.fillText(agent.id, x, y);
    }
  }
}

/** The scale of a pane, at its lower left: a round length in metres. */
function drawScaleBar(context, look, scale, width, height, ratio) {
  const length = [200, 100, 50, 20, 10, 5, 2, 1].find((metres) => metres * scale < 0.25 * width) ?? 1;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  const [x, y] = [14, height - 14];
  context.lineCap = "butt";
  for (const [name, thick] of [["ground", 6], ["ink", 2.5]]) {
    context.strokeStyle = look.colour(name);
    context.lineWidth = thick;
    strokeLine(context, [[x, y], [x + length * scale, y]]);
  }
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "left";
  context.lineWidth = 3;
  context.strokeStyle = look.colour("ground");
  context.fillStyle = look.colour("ink");
  context.strokeText(`${length} m`, x, y - 7);
  context.fillText(`${length} m`, x, y - 7);
}

// --- canvas and shapes ---

/** A canvas with as many pixels as the screen has for it, and its context in CSS pixels. */
function sized(canvas) {
  const ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height, ratio };
}

function strokeLine(context, points) {
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

/** A polygon given ahead and to the left of a pose. */
function shape(context, { x, y, heading }, corners) {
  const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
  context.beginPath();
  for (const [ahead, left] of corners) context.lineTo(x + ahead * cos - left * sin, y + ahead * sin + left * cos);
  context.closePath();
}

/** A box at a pose, its corners cut by `cut` metres. */
function boxPath(context, pose, length, width, cut = 0) {
  const [l, w] = [length / 2, width / 2];
  const left = [[l, w - cut], [l - cut, w], [cut - l, w], [-l, w - cut]];
  const right = left.map(([ahead, aside]) => [ahead, -aside]).reverse();
  shape(context, pose, [...left, ...right]);
}
