// --- decode: the data of the page, from whole numbers and differences back to metres and radians ---

/** The JSON inside the page's JSON; see data.py for its fields. */
async function unpacked(element) {
  const bytes = Uint8Array.from(atob(JSON.parse(element.textContent).gzip), (letter) => letter.charCodeAt(0));
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(plain).json();
}

/** A column of differences as `count` values; one that never changes holds its first value only. */
function decodedColumn(column, count, perUnit) {
  const values = new Float64Array(count);
  let sum = 0;
  for (let i = 0; i < count; i += 1) {
    if (i < column.length) sum += column[i];
    values[i] = sum / perUnit;
  }
  return values;
}

/** Points of differences as [x, y] in metres. */
function decodedPoints(flat, perMetre) {
  const points = [];
  let [x, y] = [0, 0];
  for (let i = 0; i < flat.length; i += 2) {
    x += flat[i];
    y += flat[i + 1];
    points.push([x / perMetre, y / perMetre]);
  }
  return points;
}

/** Values of a series; NaN where there is none. */
function decodedSeries(values, perUnit) {
  return Float64Array.from(values, (value) => (value === null ? NaN : value / perUnit));
}

function decodedPath(body, count, per) {
  return {
    x: decodedColumn(body.x, count, per.metre),
    y: decodedColumn(body.y, count, per.metre),
    heading: decodedColumn(body.heading, count, per.radian),
  };
}

function decodedAgent(agent, per) {
  const path = decodedPath(agent, agent.frames, per);
  return { ...agent, ...path, speed: decodedColumn(agent.speed, agent.frames, per.unit) };
}

function decodedDrive(drive, per) {
  const charts = {};
  for (const [key, { values, beside }] of Object.entries(drive.charts)) {
    charts[key] = { values: decodedSeries(values, per.unit), beside: beside ? decodedSeries(beside, per.unit) : null };
  }
  return {
    ...drive,
    charts,
    ego: { ...drive.ego, ...decodedPath(drive.ego, drive.frames, per) },
    agents: drive.agents.map((agent) => decodedAgent(agent, per)),
    seen: drive.seen.map((track) => ({ ...track, ...decodedPath(track, track.frames, per) })),
    plans: drive.plans.map((plan) => decodedPoints(plan, per.metre)),
    triggers: drive.triggers.map((trigger) => ({
      ...trigger,
      ...decodedPath(trigger, trigger.frame === null ? drive.frames : Math.max(trigger.frame, 1), per),
      way: decodedPoints(trigger.way, per.metre),
    })),
  };
}

function addLine(path, points) {
  points.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
}

/** One path for many polygons with holes; fill it with the rule "evenodd". */
function ringsPath(polygons, perMetre) {
  const path = new Path2D();
  for (const ring of polygons.flat()) {
    addLine(path, decodedPoints(ring, perMetre));
    path.closePath();
  }
  return path;
}

function linesPath(lines, perMetre) {
  const path = new Path2D();
  for (const line of lines) addLine(path, decodedPoints(line, perMetre));
  return path;
}

/** The bars of a crosswalk: as long as it is wide, across its longer side. */
function zebraPath(rings, perMetre) {
  const BAR_M = 0.5;
  const path = new Path2D();
  for (const polygon of rings) {
    const corners = decodedPoints(polygon[0], perMetre);
    const sides = corners.map(([x, y], i) => {
      const [nextX, nextY] = corners[(i + 1) % corners.length];
      return { x: nextX - x, y: nextY - y, length: Math.hypot(nextX - x, nextY - y) };
    });
    const long = sides.reduce((a, b) => (b.length > a.length ? b : a));
    const [alongX, alongY] = [long.x / long.length, long.y / long.length];
    const along = corners.map(([x, y]) => x * alongX + y * alongY);
    const across = corners.map(([x, y]) => y * alongX - x * alongY);
    const [left, right] = [Math.min(...across), Math.max(...across)];
    const at = (a, b) => [a * alongX - b * alongY, a * alongY + b * alongX];
    for (let a = Math.min(...along) + BAR_M / 2; a + BAR_M <= Math.max(...along); a += 2 * BAR_M) {
      addLine(path, [at(a, left), at(a + BAR_M, left), at(a + BAR_M, right), at(a, right)]);
      path.closePath();
    }
  }
  return path;
}

function decodedMap(data) {
  const metre = data.per.metre;
  const map = data.map;
  const lines = ["edge", "solid", "dashed", "middle", "connectors"];
  const polygons = (table) => Object.entries(table).map(([kind, rings]) => ({ kind, path: ringsPath(rings, metre) }));
  return {
    areas: polygons(map.areas),
    stops: polygons(map.stop_lines),
    crosswalks: ringsPath(map.crosswalks, metre),
    zebras: zebraPath(map.crosswalks, metre),
    ...Object.fromEntries(lines.map((name) => [name, linesPath(map[name], metre)])),
    arrows: map.arrows.map(([x, y, heading]) => ({ x: x / metre, y: y / metre, heading })),
    route: linesPath([data.route.line], metre),
    goal: linesPath([data.route.goal], metre),
    lights: Object.entries(data.lights).map(([id, { bar, way }]) => ({
      id, bar: linesPath([bar], metre), way: linesPath([way], metre),
    })),
  };
}

/** Everything that the page shows, in metres, radians and seconds. */
function decoded(data) {
  const [[left, bottom], [right, top]] = decodedPoints(data.extent, data.per.metre);
  return {
    ...data,
    extent: { left, bottom, right, top },
    map: decodedMap(data),
    expert: decodedPath(data.expert, data.expert.x.length ? data.frames : 0, data.per),
    drives: data.drives.map((drive) => decodedDrive(drive, data.per)),
  };
}

/** A value of a column at a frame that may lie between two; the last one beyond the end. */
function between(values, frame) {
  const first = Math.min(Math.floor(frame), values.length - 1);
  const next = Math.min(first + 1, values.length - 1);
  return values[first] + (values[next] - values[first]) * (frame - Math.floor(frame));
}

function poseAt(path, frame) {
  return { x: between(path.x, frame), y: between(path.y, frame), heading: between(path.heading, frame) };
}
