// The flight in space: WebGL through the library in `vendor/`. East is x, up is y, south is z.

const space = {
  scene: null, failed: false, rides: false, follows: true, turn_rad: -0.6, tilt_rad: 0.55, distance_m: 14, middle: [0, 1, 0], flight: null,
};
/** Height of what reaches higher than the flight, in heights of the flight; its least. */
const TALL = 1.6;
const TALL_MIN_M = 2;
const PERSON_M = 1.75;
/** How far behind and above it one rides, metres. */
const BEHIND_M = 2.4;
const ABOVE_M = 0.8;

const inSpace = ([x, y], height_m) => [x, height_m, -y];

const SHADED = {
  vertex: `attribute vec3 position; attribute vec3 normal; attribute vec3 place; attribute vec3 size; attribute vec3 rgb;
    uniform mat4 viewMatrix; uniform mat4 projectionMatrix; varying vec3 vNormal; varying vec3 vColor;
    void main() {
      vNormal = normal; vColor = rgb;
      gl_Position = projectionMatrix * viewMatrix * vec4(position * size + place, 1.0);
    }`,
  fragment: `precision mediump float; uniform float uAlpha; varying vec3 vNormal; varying vec3 vColor;
    void main() { gl_FragColor = vec4(vColor * (0.6 + 0.25 * abs(vNormal.y) + 0.15 * dot(normalize(vNormal), vec3(0.7, 0.0, 0.7))), uAlpha); }`,
};
const FLAT = {
  vertex: `attribute vec3 position; uniform mat4 modelViewMatrix; uniform mat4 projectionMatrix;
    void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
  fragment: "precision mediump float; uniform vec3 uColor; uniform float uAlpha; void main() { gl_FragColor = vec4(uColor, uAlpha); }",
};

/** Red, green and blue, 0..1, of a colour of the style sheet. */
function rgbOf(name) {
  const hex = colors[name];
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

/** Makes the renderer; says so where the browser has no WebGL. */
function beginSpace(canvas) {
  try {
    const renderer = new ogl.Renderer({ canvas, dpr: Math.min(window.devicePixelRatio || 1, 2), antialias: true, alpha: true, preserveDrawingBuffer: true });
    const { gl } = renderer;
    const root = new ogl.Transform();
    const eye = new ogl.Camera(gl, { fov: 50, near: 0.05, far: 2000 });
    const solid = { cylinder: new ogl.Cylinder(gl, { radialSegments: 28 }), sphere: new ogl.Sphere(gl, { widthSegments: 20 }) };
    space.scene = { gl, renderer, root, eye, solid, programs: {}, pools: {}, lines: {} };
  } catch (error) {
    space.failed = true;
    byId("space-words").textContent = `This browser shows no WebGL, so there is no view in space here (${error.message}). All other pictures are there.`;
  }
  return space.scene;
}

/** A mesh. Those that are drawn alike share a program. */
function meshOf(geometry, { shading, mode, alpha }) {
  const { gl, root, programs } = space.scene;
  const key = `${shading === SHADED} ${alpha}`;
  const uniforms = { uColor: { value: [0, 0, 0] }, uAlpha: { value: alpha } };
  const program = (programs[key] ??= new ogl.Program(gl, { ...shading, uniforms, transparent: alpha < 1, depthWrite: alpha === 1, cullFace: false }));
  const mesh = new ogl.Mesh(gl, { geometry, program, mode, frustumCulled: false });
  mesh.onBeforeRender(() => (program.uniforms.uColor.value = mesh.rgb));
  mesh.setParent(root);
  return mesh;
}

/** Removes what is drawn anew. */
function discard(mesh, kept = []) {
  mesh.setParent(null);
  // What several share stays.
  for (const name of kept) delete mesh.geometry.attributes[name];
  mesh.geometry.remove();
}

const SHARED = ["position", "normal", "index"];

/** Shows bodies of a kind, all in one go: place, size along x, y and z, colour of each. */
function bodies(name, solid, list, alpha = 1) {
  const { gl, pools, solid: solids } = space.scene;
  const values = [0, 1].map((part) => list.flatMap((body) => body[part])).concat([list.flatMap((body) => rgbOf(body[2]))]);
  const key = values.map((part) => part.join()).join(";");
  const before = pools[name];
  if (before?.key === key) return;
  if (before) discard(before.mesh, SHARED);
  const { position, normal, index } = solids[solid].attributes;
  const [place, size, rgb] = values.map((part) => ({ instanced: 1, size: 3, data: new Float32Array(part) }));
  pools[name] = { key, mesh: meshOf(new ogl.Geometry(gl, { position, normal, index, place, size, rgb }), { shading: SHADED, alpha }) };
  pools[name].mesh.visible = list.length > 0;
}

/** A cylinder that stands on the ground. */
const standing = ([x, y, r], height_m, color) => [inSpace([x, y], height_m / 2), [2 * r, height_m, 2 * r], color];

/** Lines, or triangles, between points, made anew where `key` has changed. */
function strokes(name, key, points, color, { alpha = 1, mode = "LINES" } = {}) {
  const { gl, lines } = space.scene;
  if (lines[name]?.key !== key) {
    if (lines[name]) discard(lines[name].mesh);
    const data = new Float32Array(points().flat());
    const mesh = meshOf(new ogl.Geometry(gl, { position: { size: 3, data } }), { shading: FLAT, mode: gl[mode], alpha });
    lines[name] = { key, mesh, count: data.length / 3 };
  }
  const { mesh, count } = lines[name];
  mesh.visible = count > 0;
  mesh.rgb = rgbOf(color);
  return mesh;
}

/** An upright ribbon along a path, so that it is wide enough to be seen. */
const ribbon = (path, half_m = 0.025) => path.flatMap(([x, y, z]) => [[x, y + half_m, z], [x, y - half_m, z]]);

/** Pairs of points from one of a path to the next. */
const links = (path) => path.slice(1).flatMap((place, index) => [path[index], place]);

const tallest = () => Math.max(TALL_MIN_M, TALL * flight.steps.reduce((most, step) => Math.max(most, step.height_m), 0));

/** The path, with at most so many points, and the step of each. */
function pathInSpace() {
  const every = Math.ceil(flight.steps.length / 6000);
  return flight.steps.filter((_, index) => index % every === 0 || index === flight.steps.length - 1);
}

function drawGround() {
  const [west, south, east, north] = bounds();
  const step = roundStep(Math.max(east - west, north - south), 12);
  const [w, s, e, n] = [Math.floor(west / step) - 1, Math.floor(south / step) - 1, Math.ceil(east / step) + 1, Math.ceil(north / step) + 1].map((k) => k * step);
  const key = `${w},${s},${e},${n}`;
  strokes("grid", key, () => [
    ...marks(w, e, step).flatMap((x) => [inSpace([x, s], 0), inSpace([x, n], 0)]),
    ...marks(s, n, step).flatMap((y) => [inSpace([w, y], 0), inSpace([e, y], 0)]),
  ], "line");
  // An arrow to the north at the western edge.
  const [x, y] = [w - step / 2, (s + n) / 2];
  const wing = step / 4;
  strokes("north", key, () => links([[x, y - step], [x, y + step], [x - wing, y + step - wing], [x, y + step], [x + wing, y + step - wing]].map((place) => inSpace(place, 0))), "faint");
}

/** What was flown, over a curtain down to the ground, and what is still to come. */
function drawWay(step) {
  const path = pathInSpace();
  const key = `${path.length},${last(path)?.time_s}`;
  const place = (s) => inSpace(s.place_m, s.height_m);
  strokes("way", key, () => links(path.map(place)), "quiet");
  const flown = strokes("flown", key, () => ribbon(path.map(place)), "blue", { mode: "TRIANGLE_STRIP" });
  const curtain = strokes("curtain", key, () => path.flatMap((s) => [place(s), inSpace(s.place_m, 0)]), "blue", { alpha: 0.22, mode: "TRIANGLE_STRIP" });
  const index = Math.max(indexAt(path, step.time_s), 0);
  flown.geometry.setDrawRange(0, 2 * (index + 1));
  curtain.geometry.setDrawRange(0, 2 * (index + 1));
  flown.visible = curtain.visible = index > 0;
}

function drawPlanInSpace(step, plan) {
  const key = plan ? String(plan.id) : "";
  const path = (waypoints) => links([plan.start_m, ...waypoints].map((place) => inSpace(place, step.height_m)));
  const samples = (wanted) => (plan ? plan.samples.filter((sample) => sample.feasible === wanted).flatMap((sample) => path(sample.waypoints_m)) : []);
  strokes("feasible", key, () => samples(true), "sky", { alpha: 0.7 });
  strokes("refused", key, () => samples(false), "quiet", { alpha: 0.7 });
  const followed = plan && plan.origin !== "brake" ? [plan.start_m, ...plan.waypoints_m].map((place) => inSpace(place, step.height_m)) : [];
  strokes("plan", key, () => ribbon(followed), "orange", { mode: "TRIANGLE_STRIP" });
  bodies("waypoints", "sphere", followed.map((place) => [place, [0.07, 0.07, 0.07], "orange"]));
  bodies("target", "sphere", plan ? [[inSpace(plan.target_m, step.height_m), [0.16, 0.16, 0.16], "orange"]] : []);
}

/** The vehicle: its hull, its nose, what it hears, its place on the ground. */
function drawVehicleInSpace(step) {
  const radius = flight.begin.scenario.drone_radius;
  const nose = away(step.place_m, step.yaw_deg, radius);
  const place = inSpace(step.place_m, step.height_m);
  bodies("hull", "cylinder", [[place, [2 * radius, 0.4 * radius, 2 * radius], "ink"]]);
  bodies("nose", "sphere", [[inSpace(nose, step.height_m), [0.6 * radius, 0.6 * radius, 0.6 * radius], "orange"]]);
  bodies("shadow", "cylinder", [[inSpace(step.place_m, 0.006), [2 * radius, 0.004, 2 * radius], "faint"]]);
  strokes("plumb", step.time_s, () => [place, inSpace(step.place_m, 0)], "faint");
  const deg = heard_deg(step);
  strokes("heard", step.time_s, () => (deg === undefined ? [] : [place, inSpace(away(step.place_m, deg, reach_m(step)), step.height_m)]), "green");
}

/** Where the pad is: east, north, radius; none without one. */
function padAt(time_s) {
  const landing = flight.begin.scenario.landing;
  if (!landing || landing.pad_missing) return null;
  const [x, y] = beaconAt(time_s);
  return [x + landing.pad[0], y + landing.pad[1], landing.pad_radius];
}

function drawWorldInSpace(step) {
  const tall_m = tallest();
  const { scenario, beacon_height_m } = flight.begin;
  const people = latest(flight.people, step.time_s)?.circles_m ?? [];
  const pillars = pillarsAt(step.time_s).slice(0, scenario.obstacles.length + flight.begin.walls.length);
  bodies("pillars", "cylinder", pillars.map((circle) => standing(circle, tall_m, "pillar-edge")));
  bodies("people", "cylinder", people.map((circle) => standing(circle, PERSON_M, "purple")));
  const memory = latest(flight.remembered, step.time_s)?.circles_m ?? [];
  bodies("remembered", "cylinder", shown.has("remembered") ? memory.map(([x, y, r]) => standing([x, y, r * 1.02], tall_m * 0.55, "red")) : [], 0.25);
  const beacons = knowsBeacon() ? [beaconAt(step.time_s)] : [];
  bodies("beacon", "sphere", beacons.map((beacon) => [inSpace(beacon, Math.max(beacon_height_m, 0.12)), [0.28, 0.28, 0.28], "green"]));
  strokes("mast", `${beacons}`, () => beacons.flatMap((beacon) => [inSpace(beacon, 0), inSpace(beacon, tall_m)]), "green");
  const pad = padAt(step.time_s);
  bodies("pad", "cylinder", pad ? [[inSpace(pad, 0.004), [2 * pad[2], 0.01, 2 * pad[2]], "red"]] : []);
}

/** Where one looks from: around the middle, or behind the vehicle. */
function lookInSpace(step) {
  const { eye } = space.scene;
  const place = inSpace(step.place_m, step.height_m);
  if (space.rides) {
    const yaw = (step.yaw_deg * Math.PI) / 180 + space.turn_rad;
    const back = BEHIND_M * (space.distance_m / 14);
    eye.position.set(place[0] - back * Math.sin(yaw), place[1] + ABOVE_M * (space.distance_m / 14), place[2] + back * Math.cos(yaw));
    eye.lookAt([place[0] + 2 * Math.sin(yaw), place[1] - 0.15, place[2] - 2 * Math.cos(yaw)]);
    return;
  }
  if (space.follows) space.middle = place;
  const flat = space.distance_m * Math.cos(space.tilt_rad);
  const [x, y, z] = space.middle;
  eye.position.set(x + flat * Math.sin(space.turn_rad), y + space.distance_m * Math.sin(space.tilt_rad), z + flat * Math.cos(space.turn_rad));
  eye.lookAt(space.middle);
}

/** Draws the flight in space at a step, if it is looked at. */
function drawSpace(canvas, step, plan) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !step || space.failed) return;
  const scene = space.scene ?? beginSpace(canvas);
  if (!scene) return;
  if (space.flight !== flight.begin) {
    space.flight = flight.begin;
    fitSpace();
  }
  const { renderer, gl, eye, root } = scene;
  // The library sets the size of the canvas in the style; here the style sheet has it.
  renderer.setSize(width, height);
  canvas.style.width = canvas.style.height = "";
  gl.clearColor(...rgbOf("ground"), 1);
  eye.perspective({ aspect: width / height });
  drawGround();
  drawWorldInSpace(step);
  drawWay(step);
  drawPlanInSpace(step, plan);
  drawVehicleInSpace(step);
  lookInSpace(step);
  renderer.render({ scene: root, camera: eye });
  canvas.dataset.drawn = String(replay.index);
  const height_m = `${step.height_m.toFixed(2)} metres high`;
  canvas.setAttribute("aria-label", `The flight in space. The vehicle is ${height_m}${toBeacon(step)}.`);
}

/** The whole flight in view. */
function fitSpace() {
  const [west, south, east, north] = bounds();
  space.middle = inSpace([(west + east) / 2, (south + north) / 2], 0.5);
  Object.assign(space, { follows: false, rides: false, turn_rad: -0.6, tilt_rad: 0.7, distance_m: 1.15 * Math.hypot(east - west, north - south) });
  showSpaceButtons();
}

function showSpaceButtons() {
  byId("space-follow").setAttribute("aria-pressed", String(space.follows && !space.rides));
  byId("space-ride").setAttribute("aria-pressed", String(space.rides));
}

function turnSpace(dx, dy) {
  space.turn_rad -= dx / 140;
  space.tilt_rad = Math.min(Math.max(space.tilt_rad + dy / 160, 0.02), 1.55);
}

function zoomSpace(factor) {
  space.distance_m = Math.min(Math.max(space.distance_m / factor, 0.8), 1500);
}

/** Lets the view in space be moved; `redraw` is called after every change. */
function setUpSpace(canvas, redraw) {
  const modes = {
    "space-fit": fitSpace,
    "space-follow": () => Object.assign(space, { follows: !space.follows || space.rides, rides: false }),
    "space-ride": () => Object.assign(space, { rides: !space.rides, turn_rad: 0, distance_m: 14 }),
  };
  const choose = (name) => {
    modes[name]();
    showSpaceButtons();
    redraw();
  };
  for (const name of Object.keys(modes)) byId(name).addEventListener("click", () => choose(name));
  onKeys(canvas, {
    ArrowLeft: () => turnSpace(-14, 0), ArrowRight: () => turnSpace(14, 0), ArrowUp: () => turnSpace(0, 12), ArrowDown: () => turnSpace(0, -12),
    "+": () => zoomSpace(1.2), "=": () => zoomSpace(1.2), "-": () => zoomSpace(1 / 1.2),
    0: () => choose("space-fit"), f: () => choose("space-follow"), r: () => choose("space-ride"),
  }, redraw);
  const zoom = (factor) => {
    zoomSpace(factor);
    redraw();
  };
  onWheel(canvas, zoom);
  const pinched = onPinch(canvas, zoom);
  onDrag(canvas, (dx, dy) => {
    if (pinched()) return;
    turnSpace(dx, dy);
    redraw();
  });
  showSpaceButtons();
}

/** Calls back with how much farther apart two fingers are; returns whether there are two. */
function onPinch(canvas, move) {
  const fingers = new Map();
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0;
  };
  canvas.addEventListener("pointerdown", (event) => fingers.set(event.pointerId, [event.clientX, event.clientY]));
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = apart();
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (before > 0 && apart() > 0) move(apart() / before);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  return () => fingers.size > 1;
}
