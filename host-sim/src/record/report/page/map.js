// The map: the world as it is, what is remembered of it, what was considered, what was flown.

const LAYERS = [
  ["pillars", "pillars as they are", "pillar-edge"],
  ["remembered", "as remembered", "red"],
  ["tracks", "what is followed, and giving way to it", "orange"],
  ["view", "field of view", "sky"],
  ["samples", "sampled trajectories", "blue"],
  ["plans", "the last 50 plans", "orange"],
  ["belief", "where the source may be", "purple"],
  ["heard", "bearing heard", "green"],
  ["potential", "potential", "yellow"],
];
const shown = new Set(["pillars", "remembered", "tracks", "view", "samples", "plans", "belief", "heard"]);

/** How the path is coloured: what of a step, its range, its unit. */
const PATH_BY = {
  speed: { value: speed_mps, range: () => [0, flight.begin.speed_max_mps], unit: "m/s" },
  clearance: { value: (step) => step.clearance_m, range: () => [0, 1], unit: "m" },
  error: { value: missed_deg, range: () => [0, most(missed_deg)], unit: "deg" },
  source: { value: sourceError_m, range: () => [0, Math.min(most(sourceError_m), 5)], unit: "m" },
};

function missed_deg(step) {
  return Math.abs(bearingError_deg(step));
}

function most(of) {
  return flight.steps.reduce((most, step) => Math.max(most, of(step) || 0), 1e-3);
}

/** In a long flight the earlier ones would cover each other. */
const PLANS_SHOWN = 50;

/** The part of the plane that is seen: its middle, and pixels to a metre; `fitted` until somebody moves it. */
const camera = { x_m: 0, y_m: 0, scale: 50, fitted: true, follows: false };

/** Bounds that hold the map and everything flown; found anew when there are more steps. */
const bounded = { begin: null, steps: 0, box: [] };

function bounds() {
  if (bounded.begin === flight.begin && bounded.steps === flight.steps.length) return bounded.box;
  const box = [...flight.begin.scenario.bounds];
  const stretch = ([x, y]) => {
    box[0] = Math.min(box[0], x - 0.3);
    box[1] = Math.min(box[1], y - 0.3);
    box[2] = Math.max(box[2], x + 0.3);
    box[3] = Math.max(box[3], y + 0.3);
  };
  flight.steps.forEach((step) => stretch(step.place_m));
  if (knowsBeacon()) [0, duration_s()].forEach((time_s) => stretch(beaconAt(time_s)));
  Object.assign(bounded, { begin: flight.begin, steps: flight.steps.length, box });
  return box;
}

function fitCamera(width, height) {
  const [west, south, east, north] = bounds();
  camera.x_m = (west + east) / 2;
  camera.y_m = (south + north) / 2;
  camera.scale = Math.min((width - 56) / (east - west), (height - 44) / (north - south));
}

/** Map metres to pixels. */
function projection(width, height) {
  return ([x, y]) => [width / 2 + (x - camera.x_m) * camera.scale, height / 2 - (y - camera.y_m) * camera.scale];
}

/** Draws the map at a step. */
function drawMap(canvas, index) {
  const { context, width, height } = prepare(canvas);
  if (!width) return;
  const step = flight.steps[index];
  if (camera.fitted) fitCamera(width, height);
  if (camera.follows && step) [camera.x_m, camera.y_m] = step.place_m;
  const at = projection(width, height);
  const time_s = step ? step.time_s : 0;
  const plan = latest(flight.plans, time_s);
  const picture = { context, width, height, at, time_s, step, plan };

  const detailed = latest(flight.detailed, time_s);
  if (shown.has("potential") && detailed) paintField({ ...picture, plan: detailed }, 0.55);
  drawGrid(picture);
  if (shown.has("view") && step) drawView(picture);
  if (shown.has("pillars")) drawPillars(picture);
  if (shown.has("remembered")) drawRemembered(picture);
  if (shown.has("tracks")) drawTracks(picture);
  if (shown.has("plans")) drawPlans(picture);
  if (shown.has("belief") && plan) drawBelief(picture);
  drawEnds(picture);
  if (shown.has("heard") && step) drawHeard(picture);
  drawPath(picture, index);
  if (shown.has("samples") && plan) drawSamples(picture, onMap());
  if (step) drawVehicle(picture);
  drawAxes(picture);
}

/** Metres that are in the picture: west, south, east, north. */
function seen({ width, height }) {
  const [x, y] = [width / 2 / camera.scale, height / 2 / camera.scale];
  return [camera.x_m - x, camera.y_m - y, camera.x_m + x, camera.y_m + y];
}

function drawGrid({ context, at, width, height }) {
  const [west, south, east, north] = seen({ width, height });
  const step = roundStep(width / camera.scale, width / 70);
  for (const x of marks(west, east, step)) line(context, [at([x, south]), at([x, north])], { color: colors.grid });
  for (const y of marks(south, north, step)) line(context, [at([west, y]), at([east, y])], { color: colors.grid });
}

/** Numbers along the left and lower edge, over everything. */
function drawAxes({ context, at, width, height }) {
  const [west, south, east, north] = seen({ width, height });
  const step = roundStep(width / camera.scale, width / 70);
  context.save();
  context.globalAlpha = 0.8;
  context.fillStyle = colors.ground;
  context.fillRect(0, height - 18, width, 18);
  context.fillRect(0, 0, 30, height);
  context.restore();
  for (const x of marks(west, east, step)) {
    const [left] = at([x, 0]);
    if (left < 38 || left > width - 66) continue;
    write(context, label(x, step), left, height - 5, { color: colors.faint, align: "center" });
  }
  for (const y of marks(south, north, step)) {
    const [, top] = at([0, y]);
    if (top < 22 || top > height - 24) continue;
    write(context, label(y, step), 26, top, { color: colors.faint, align: "right", base: "middle" });
  }
  write(context, "x east, m", width - 6, height - 5, { color: colors.faint, align: "right" });
  write(context, "y north, m", 6, 13, { color: colors.faint });
}

/** Where one comes to from a place in a direction from north. */
function away([x, y], deg, far_m) {
  const angle = (deg * Math.PI) / 180;
  return [x + far_m * Math.sin(angle), y + far_m * Math.cos(angle)];
}

/** A sector around a direction, as wide to either side. */
function sector({ context, at }, place, [deg, side_deg, far_m], color, alpha) {
  context.save();
  context.globalAlpha = alpha;
  context.fillStyle = color;
  context.beginPath();
  context.moveTo(...at(place));
  for (let k = -16; k <= 16; k += 1) context.lineTo(...at(away(place, deg + (side_deg * k) / 16, far_m)));
  context.fill();
  context.restore();
}

/** What the obstacle sensor overlooks. */
function drawView(picture) {
  const { fov_deg, range_m } = flight.begin.scenario.sensor;
  sector(picture, picture.step.place_m, [picture.step.yaw_deg, fov_deg / 2, range_m], colors.sky, 0.13);
}

function drawPillars({ context, at, time_s, width, height }) {
  const [west, south, east, north] = seen({ width, height });
  const dots = new Set();
  context.fillStyle = colors["pillar-edge"];
  for (const [x, y, r] of pillarsAt(time_s)) {
    if (x + r < west || x - r > east || y + r < south || y - r > north) continue;
    if (r * camera.scale < 1) {
      // From far away pillars are dots, and several are one.
      const [left, top] = at([x, y]).map(Math.round);
      if (!dots.has(left * 10_000 + top)) context.fillRect(left, top, 1, 1);
      dots.add(left * 10_000 + top);
    } else disc(context, at([x, y]), r * camera.scale, { fill: colors.pillar, stroke: colors["pillar-edge"], width: 1.2 });
  }
}

function drawRemembered({ context, at, time_s }) {
  const memory = latest(flight.remembered, time_s);
  for (const [x, y, r] of memory ? memory.circles_m : []) {
    disc(context, at([x, y]), Math.max(r * camera.scale, 2), { stroke: colors.red, width: 1.6, dash: [4, 3] });
  }
}

/** A velocity in pixels. */
const shaft = ([x, y]) => [x * camera.scale * 0.8, -y * camera.scale * 0.8];

/** What is followed and moves, as wide as two standard deviations, where it is going, and how the vehicle gives way to it. */
function drawTracks({ context, at, time_s, step }) {
  for (const { place_m, velocity_mps, sigma_m } of tracksAt(time_s)) {
    const place = at(place_m);
    const radius = Math.max(2 * sigma_m * camera.scale, 3);
    disc(context, place, radius, { fill: colors.orange, alpha: 0.25 });
    disc(context, place, radius, { stroke: colors.orange, width: 1.4 });
    arrow(context, place, shaft(velocity_mps), { color: colors.orange, width: 1.8 });
  }
  if (step && step.evasion_mps) {
    arrow(context, at(step.place_m), shaft(step.evasion_mps), { color: colors.orange, width: 3.5 });
  }
}

/** The plans before, and their targets. */
function drawPlans({ context, at, time_s }) {
  const end = Math.max(indexAt(flight.plans, time_s), 0);
  for (const plan of flight.plans.slice(Math.max(end - PLANS_SHOWN, 0), end)) {
    line(context, [plan.start_m, ...plan.waypoints_m].map(at), { color: colors.orange, alpha: 0.35, width: 1.2 });
    disc(context, at(plan.target_m), 2.6, { fill: colors.ground, stroke: colors.orange, alpha: 0.6 });
  }
}

/** Colours of the samples: on the map, and on the heat map of the potential. */
const onMap = () => ({ clear: colors.blue, refused: colors.faint, under: colors.ground, followed: colors.orange });
const ON_HEAT = { clear: "#fff", refused: "#fff", under: "#000", followed: "#f0a830" };

/** The samples of a plan, stronger where they cost less; those that may not be chosen are dashed. */
function drawSamples({ context, at, plan }, { clear, refused, under, followed }) {
  const costs = plan.samples.map((sample) => sample.cost);
  const [least, greatest] = [Math.min(...costs), Math.max(...costs)];
  plan.samples.forEach((sample, index) => {
    if (index === plan.chosen) return;
    const share = (sample.cost - least) / (greatest - least || 1);
    const path = [plan.start_m, ...sample.waypoints_m].map(at);
    line(context, path, sample.feasible
      ? { color: clear, width: 1.5, alpha: 0.95 - 0.55 * share }
      : { color: refused, width: 1, alpha: 0.6, dash: [2, 3] });
  });
  if (plan.origin !== "brake") {
    const path = [plan.start_m, ...plan.waypoints_m].map(at);
    line(context, path, { color: under, width: 5, alpha: 0.8 });
    line(context, path, { color: followed, width: 3 });
    plan.waypoints_m.forEach((waypoint) => disc(context, at(waypoint), 1.9, { fill: followed }));
  }
  disc(context, at(plan.target_m), 5, { fill: under, stroke: followed, width: 2 });
}

/** The places where the source may be, and the ellipse of two standard deviations. */
function drawBelief({ context, at, plan }) {
  for (const [x, y, weight] of plan.places) {
    disc(context, at([x, y]), 1.6, { fill: colors.purple, alpha: 0.15 + 0.5 * weight });
  }
  if (!plan.belief) return;
  const { major_m, minor_m, angle_rad } = ellipse(plan.belief.covariance_m2);
  const [x, y] = at(plan.belief.mean_m);
  context.save();
  context.strokeStyle = colors.purple;
  context.lineWidth = 1.6;
  context.beginPath();
  context.ellipse(x, y, 2 * major_m * camera.scale, 2 * minor_m * camera.scale, -angle_rad, 0, 2 * Math.PI);
  context.stroke();
  context.restore();
  cross(context, [x, y], colors.purple);
}

function cross(context, [x, y], color) {
  line(context, [[x - 5, y], [x + 5, y]], { color, width: 1.6 });
  line(context, [[x, y - 5], [x, y + 5]], { color, width: 1.6 });
}

/** Start, beacon, and what counts as there; beacons that are not ours, faint. */
function drawEnds({ context, at, time_s }) {
  const { start, goal_tolerance, other_beacons = [] } = flight.begin.scenario;
  for (const { x, y } of other_beacons) {
    disc(context, at([x, y]), 9, { stroke: colors.faint, alpha: 0.6 });
    disc(context, at([x, y]), 4, { fill: colors.faint });
  }
  const begun = flight.steps.length ? flight.steps[0].place_m : start;
  if (knowsBeacon()) {
    const beacon = at(beaconAt(time_s));
    disc(context, beacon, goal_tolerance * camera.scale, { stroke: colors.green, width: 1.4, dash: [3, 3] });
    [9, 14].forEach((radius) => disc(context, beacon, radius, { stroke: colors.green, alpha: 0.6 }));
    disc(context, beacon, 5, { fill: colors.green });
  }
  disc(context, at(begun), 5, { fill: colors.ground, stroke: colors.ink, width: 2 });
}

/** The last bearing, with two standard deviations to either side. */
function drawHeard(picture) {
  const { heard, place_m } = picture.step;
  const far_m = reach_m(picture.step);
  const deg = heard_deg(picture.step);
  if (deg === undefined) return;
  sector(picture, place_m, [deg, Math.min(2 * heard.sigma_deg, 90), far_m], colors.green, 0.2);
  const ends = [place_m, away(place_m, deg, far_m)].map(picture.at);
  line(picture.context, ends, { color: colors.green, alpha: 0.8, dash: [6, 4] });
}

const PATH_POINTS = 2500;

/** What was flown, coloured; what is still to come, faint. */
function drawPath({ context, at }, index) {
  const by = PATH_BY[byId("path-by").value];
  const [low, high] = by.range();
  // Of a long flight some steps, and none that would be drawn on the one before.
  const every = Math.ceil(flight.steps.length / PATH_POINTS);
  let before = [Infinity, Infinity];
  const path = flight.steps.filter((step, k) => {
    if (k === index) return true;
    const [dx, dy] = [step.place_m[0] - before[0], step.place_m[1] - before[1]];
    if (k % every || Math.hypot(dx, dy) * camera.scale < 0.7) return false;
    before = step.place_m;
    return true;
  });
  const here = path.indexOf(flight.steps[index]);
  const places = path.map((step) => at(step.place_m));
  line(context, places.slice(Math.max(here, 0)), { color: colors.faint, alpha: 0.7, width: 1.2, dash: [1, 4] });
  const flown = places.slice(0, here + 1);
  line(context, flown, { color: colors.ground, width: 6.5, alpha: 0.9 });
  context.save();
  context.lineCap = "round";
  context.lineWidth = 3.6;
  // A long flight in pieces of some steps.
  const piece = Math.ceil(flown.length / 1500);
  for (let from = 0; from + 1 < flown.length; from += piece) {
    const to = Math.min(from + piece, flown.length - 1);
    context.strokeStyle = ramp((by.value(path[to]) - low) / (high - low));
    context.beginPath();
    context.moveTo(...flown[from]);
    for (let k = from + 1; k <= to; k += 1) context.lineTo(...flown[k]);
    context.stroke();
  }
  context.restore();
}

/** The hull, its nose, how it moves and how it is told to. */
function drawVehicle({ context, at, step }) {
  const place = at(step.place_m);
  const radius = Math.max(flight.begin.scenario.drone_radius * camera.scale, 5);
  const yaw = (step.yaw_deg * Math.PI) / 180;
  disc(context, place, radius, { fill: colors.panel, alpha: 0.85 });
  disc(context, place, radius, { stroke: colors.ink, width: 2 });
  const nose = [place[0] + radius * Math.sin(yaw), place[1] - radius * Math.cos(yaw)];
  line(context, [place, nose], { color: colors.ink, width: 2 });
  arrow(context, place, shaft(step.setpoint_mps), { color: colors.faint, width: 1.6 });
  arrow(context, place, shaft(step.velocity_mps), { color: colors.ink, width: 2.2 });
}

/** The scale of the path's colours. */
function drawScale() {
  const { context, width, height } = prepare(byId("scale"));
  paintRamp(context, [0, 0, width, height]);
  const by = PATH_BY[byId("path-by").value];
  const [low, high] = by.range();
  byId("scale-low").textContent = `${low} ${by.unit}`;
  byId("scale-high").textContent = `${high.toFixed(2)} ${by.unit}`;
}

/** Makes a drag of the mouse, or of two fingers, call back; one finger scrolls the page. */
function onDrag(canvas, move) {
  let last = null;
  canvas.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse" && event.button !== 0) return;
    last = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!last) return;
    move(event.clientX - last[0], event.clientY - last[1]);
    last = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (last = null));
}

/** Calls back with how much nearer the wheel leads. */
function onWheel(canvas, zoom) {
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 500), event);
  }, { passive: false });
}

/** The keys of a canvas, which are not those of the page while it has the focus. */
function onKeys(canvas, keys, redraw) {
  canvas.addEventListener("keydown", (event) => {
    const isPages = event.ctrlKey || event.metaKey || event.altKey || (event.shiftKey && event.key.startsWith("Arrow"));
    if (!keys[event.key] || isPages) return;
    keys[event.key]();
    event.preventDefault();
    event.stopPropagation();
    redraw();
  });
}

/** Zooms, keeping what is at a pixel where it is. */
function zoomMap(canvas, factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
  const scale = Math.min(Math.max(camera.scale * factor, 2), 2000);
  const [dx, dy] = [x - canvas.clientWidth / 2, canvas.clientHeight / 2 - y];
  if (!camera.follows) {
    camera.x_m += dx / camera.scale - dx / scale;
    camera.y_m += dy / camera.scale - dy / scale;
  }
  camera.scale = scale;
  camera.fitted = false;
}

/** Lets the map be moved; `redraw` is called after every change. */
function setUpMap(canvas, redraw) {
  const press = (id, act) => byId(id).addEventListener("click", () => {
    act();
    redraw();
  });
  const follow = () => {
    camera.follows = !camera.follows;
    camera.fitted = !camera.follows && camera.fitted;
    if (camera.follows) camera.scale = Math.max(camera.scale, 90);
    byId("zoom-follow").setAttribute("aria-pressed", String(camera.follows));
  };
  const fit = () => {
    if (camera.follows) follow();
    camera.fitted = true;
  };
  press("zoom-in", () => zoomMap(canvas, 1.4));
  press("zoom-out", () => zoomMap(canvas, 1 / 1.4));
  press("zoom-fit", fit);
  press("zoom-follow", follow);
  onWheel(canvas, (factor, event) => {
    zoomMap(canvas, factor, event.offsetX, event.offsetY);
    redraw();
  });
  const [nearer, farther] = [() => zoomMap(canvas, 1.4), () => zoomMap(canvas, 1 / 1.4)];
  onKeys(canvas, { "+": nearer, "=": nearer, "-": farther, 0: fit, f: follow }, redraw);
  onDrag(canvas, (dx, dy) => {
    camera.x_m -= dx / camera.scale;
    camera.y_m += dy / camera.scale;
    camera.fitted = false;
    redraw();
  });
  byId("path-by").addEventListener("change", redraw);
  setUpLayers(redraw);
}

function setUpLayers(redraw) {
  const fieldset = byId("layers");
  for (const [name, text, color] of LAYERS) {
    const entry = document.createElement("label");
    const box = document.createElement("input");
    const key = document.createElement("i");
    box.type = "checkbox";
    box.checked = shown.has(name);
    box.name = name;
    key.style.borderColor = `var(--${color})`;
    box.addEventListener("change", () => {
      if (box.checked) shown.add(name);
      else shown.delete(name);
      redraw();
    });
    entry.append(box, key, text);
    fieldset.append(entry);
  }
}
