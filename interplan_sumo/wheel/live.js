// --- live: a drive that grows frame by frame, in the form in which the scene draws stored ones ---

class LiveDrive {
  constructor({ ego }) {
    Object.assign(this, { frames: 0, agents: [], plans: [], signals: {}, seen: [], triggers: [], events: [] });
    this.ego = { ...ego, x: [], y: [], heading: [] };
    this.there = new Map(); // who was there in the last frame
  }

  append({ frame, ego: [x, y, heading], agents, lights }) {
    if (frame !== this.frames) return;
    extend(this.ego, x, y, heading);
    const before = this.there;
    this.there = new Map();
    for (const [id, look, kind, length, width, ax, ay, turned, speed] of agents) {
      const track = before.get(id) ?? this.entered(id, look, kind, length, width);
      extend(track, ax, ay, turned);
      track.speed.push(speed);
      track.frames += 1;
      this.there.set(id, track);
    }
    for (const [id, status] of Object.entries(lights)) (this.signals[id] ??= []).push([frame, status]);
    this.frames += 1;
  }

  entered(id, look, kind, length, width) {
    const track = {
      id, look, kind, behaviour: "", length_m: length, width_m: width,
      first: this.frames, frames: 0, x: [], y: [], heading: [], speed: [],
    };
    this.agents.push(track);
    return track;
  }
}

/** One more pose; headings go on without jumps by full turns. */
function extend(path, x, y, heading) {
  const last = path.heading.at(-1) ?? heading;
  path.x.push(x);
  path.y.push(y);
  path.heading.push(last + Math.atan2(Math.sin(heading - last), Math.cos(heading - last)));
}

/** Follows the ego with its front up, turning gently. */
class ChaseCamera extends Camera {
  constructor() {
    super(0);
    this.turnedRad = null;
  }

  turnTo(heading, seconds, up) {
    const TURN_S = 0.35; // until a turn is mostly followed
    const wanted = up ? heading - Math.PI / 2 : 0;
    const away = Math.atan2(Math.sin(wanted - this.turnedRad), Math.cos(wanted - this.turnedRad));
    const share = this.turnedRad === null ? 1 : 1 - Math.exp(-seconds / TURN_S);
    this.turnedRad = (this.turnedRad ?? wanted) + (this.turnedRad === null ? 0 : share * away);
    [this.cos, this.sin] = [Math.cos(this.turnedRad), Math.sin(this.turnedRad)];
  }

  centreFor(ego, height) {
    const LEAD = 0.22; // of the height by which the view leads
    const lead = this.turned(0, -LEAD * height);
    return { x: ego.x + lead.x, y: ego.y + lead.y };
  }
}

/** Where wheels and pedals lead from a pose, as points: what the next plan will be. */
function guide(pose, speed, { push, turn }, largestTurn, wheelbase) {
  const [STEP_S, STEPS] = [0.25, 8];
  const acceleration = push * (push > 0 ? 3 : 8);
  const curvature = Math.tan(turn * largestTurn) / wheelbase;
  let { x, y, heading } = pose;
  const points = [[x, y]];
  for (let i = 0; i < STEPS; i += 1) {
    const next = Math.max(0, speed + acceleration * STEP_S);
    const way = ((speed + next) / 2) * STEP_S;
    heading += (curvature * way) / 2;
    x += way * Math.cos(heading);
    y += way * Math.sin(heading);
    heading += (curvature * way) / 2;
    speed = next;
    points.push([x, y]);
  }
  return points;
}
