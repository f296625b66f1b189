// The potential that a plan descends: a heat map with contours, and a surface that can be turned.

const field = { shows: "surface", of: "followed", turn_rad: -0.5, tilt_rad: 0.9, zoom: 1 };
const CONTOURS = 14;

/**
 * Heights of a plan's raster, 0..1. The root makes a cone of the paraboloid that draws to the target, so that what repels
 * stands out; the highest hundredth, inside of obstacles, is cut off.
 */
const heightsOf = new WeakMap();
function heights(plan) {
  const values = plan.field[field.of];
  if (heightsOf.has(values)) return heightsOf.get(values);
  const least = Math.min(...values);
  const sorted = values.map((value) => Math.sqrt(value - least)).sort((a, b) => a - b);
  const top = sorted[Math.floor(0.99 * (sorted.length - 1))] || 1;
  const list = values.map((value) => Math.min(Math.sqrt(value - least) / top, 1));
  heightsOf.set(values, list);
  return list;
}

/** The raster as an image, a pixel a value, north up. */
const imageOf = new WeakMap();
function fieldImage(plan) {
  const { columns, [field.of]: values } = plan.field;
  if (imageOf.has(values)) return imageOf.get(values);
  const image = document.createElement("canvas");
  image.width = image.height = columns;
  const context = image.getContext("2d");
  const pixels = context.createImageData(columns, columns);
  heights(plan).forEach((height, index) => {
    const row = columns - 1 - Math.floor(index / columns);
    const [r, g, b] = viridisTable[Math.round(255 * height)];
    pixels.data.set([r, g, b, 255], 4 * (row * columns + (index % columns)));
  });
  context.putImageData(pixels, 0, 0);
  imageOf.set(values, image);
  return image;
}

/** Draws the raster where it is, in any projection of the plane that has north up. */
function paintField({ context, at, plan }, alpha) {
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const side = step_m * columns;
  const [left, bottom] = at([west - step_m / 2, south - step_m / 2]);
  const [right, top] = at([west - step_m / 2 + side, south - step_m / 2 + side]);
  context.save();
  context.globalAlpha = alpha;
  context.imageSmoothingEnabled = true;
  context.drawImage(fieldImage(plan), left, top, right - left, bottom - top);
  context.restore();
}

/** As a layer of the map. */
function drawPotential(picture) {
  paintField(picture, 0.55);
}

function drawField(canvas, plan, step) {
  const { context, width, height } = prepare(canvas);
  if (!width || !plan) return;
  if (field.shows === "heat") drawHeat({ context, width, height, plan, step });
  else drawSurface({ context, width, height, plan, step });
  drawFieldScale({ context, width, height });
}

function drawHeat({ context, width, height, plan, step }) {
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const side = step_m * (columns - 1);
  const scale = Math.max(width, height) / side;
  const middle = [west + side / 2, south + side / 2];
  const at = ([x, y]) => [width / 2 + (x - middle[0]) * scale, height / 2 - (y - middle[1]) * scale];
  paintField({ context, at, plan }, 1);
  drawContours({ context, at, plan });
  for (const [x, y, r] of plan.circles_m) disc(context, at([x, y]), r * scale, { stroke: "#fff", width: 1.4, dash: [4, 3] });
  drawFlow({ at, plan, step, context });
}

/** Lines of equal height, by marching squares. */
function drawContours({ context, at, plan }) {
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const list = heights(plan);
  const place = (column, row) => at([west + column * step_m, south + row * step_m]);
  context.save();
  context.strokeStyle = "#ffffff";
  context.globalAlpha = 0.35;
  context.lineWidth = 1;
  context.beginPath();
  for (let level = 1; level < CONTOURS; level += 1) {
    const height = level / CONTOURS;
    for (let row = 0; row + 1 < columns; row += 1) {
      for (let column = 0; column + 1 < columns; column += 1) {
        const corners = [[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]];
        const points = crossings(corners, corners.map(([c, r]) => list[r * columns + c] - height), place);
        for (let k = 0; k + 1 < points.length; k += 2) {
          context.moveTo(...points[k]);
          context.lineTo(...points[k + 1]);
        }
      }
    }
  }
  context.stroke();
  context.restore();
}

/** Where the sign changes along the edges of a cell. */
function crossings(corners, values, place) {
  const points = [];
  for (let edge = 0; edge < 4; edge += 1) {
    const next = (edge + 1) % 4;
    if (values[edge] > 0 === values[next] > 0) continue;
    const share = values[edge] / (values[edge] - values[next]);
    const [a, b] = [corners[edge], corners[next]];
    points.push(place(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])));
  }
  return points;
}

/** The samples, the trajectory that is followed, its target and the vehicle. `at` takes a place. */
function drawFlow({ context, at, plan, step }) {
  plan.samples.forEach((sample, index) => {
    if (index === plan.chosen) return;
    const [alpha, dash] = sample.feasible ? [0.75, []] : [0.4, [2, 3]];
    line(context, [plan.start_m, ...sample.waypoints_m].map(at), { color: "#fff", width: 1.1, alpha, dash });
  });
  const chosen = [plan.start_m, ...plan.waypoints_m].map(at);
  line(context, chosen, { color: "#000", width: 4.5, alpha: 0.55 });
  line(context, chosen, { color: "#f0a830", width: 2.8 });
  disc(context, at(plan.target_m), 5, { fill: "#fff", stroke: "#c77700", width: 2 });
  if (step) disc(context, at(step.place_m), 4.5, { fill: "#000", stroke: "#fff", width: 2 });
}

/** The remembered obstacles, as rings on the surface. */
function drawRings(context, plan, on) {
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const side = step_m * (columns - 1);
  const inside = ([x, y]) => x >= west && x <= west + side && y >= south && y <= south + side;
  for (const [x, y, r] of plan.circles_m) {
    const ring = Array.from({ length: 33 }, (_, k) => [x + r * Math.cos((k * Math.PI) / 16), y + r * Math.sin((k * Math.PI) / 16)]);
    if (ring.every(inside)) line(context, ring.map((place) => on(place).slice(0, 2)), { color: "#fff", width: 1.3, dash: [4, 3] });
  }
}

/** Turns the plane and looks at it from above; without perspective, so that lengths can be compared. */
function surfaceProjection(width, height, raster) {
  const { south_west_m: [west, south], step_m, columns } = raster;
  const half = (step_m * (columns - 1)) / 2;
  const scale = (field.zoom * Math.min(width / 2.9, height / 2.5)) / half;
  const [sin, cos] = [Math.sin(field.turn_rad), Math.cos(field.turn_rad)];
  const [up, flat] = [Math.sin(field.tilt_rad), Math.cos(field.tilt_rad)];
  return ([x, y], z) => {
    const [dx, dy] = [x - west - half, y - south - half];
    const [right, away] = [dx * cos - dy * sin, dx * sin + dy * cos];
    return [width / 2 + right * scale, height * 0.55 - (away * flat + (z - 0.45) * 1.3 * half * up) * scale, away];
  };
}

/** Height of the surface at a place, between the values of the raster. */
function heightAt(plan, [x, y]) {
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const clamp = (value) => Math.min(Math.max(value, 0), columns - 1.001);
  const [c, r] = [clamp((x - west) / step_m), clamp((y - south) / step_m)];
  const [column, row] = [Math.floor(c), Math.floor(r)];
  const list = heights(plan);
  const value = (dc, dr) => list[(row + dr) * columns + column + dc];
  const [u, v] = [c - column, r - row];
  return (value(0, 0) * (1 - u) + value(1, 0) * u) * (1 - v) + (value(0, 1) * (1 - u) + value(1, 1) * u) * v;
}

/** The surface without what moves on it, as long as nobody turns it. */
const surface = { kept: document.createElement("canvas"), list: null, key: "" };

function keepSurface(canvas, list, key) {
  Object.assign(surface, { list, key });
  [surface.kept.width, surface.kept.height] = [canvas.width, canvas.height];
  surface.kept.getContext("2d").drawImage(canvas, 0, 0);
}

/** Squares of the surface from far to near, each over those behind it. */
function drawSurface({ context, width, height, plan, step }) {
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const to = surfaceProjection(width, height, plan.field);
  const list = heights(plan);
  const points = list.map((z, index) => to([west + (index % columns) * step_m, south + Math.floor(index / columns) * step_m], z));
  const order = [...Array(columns - 1).keys()];
  const rows = Math.cos(field.turn_rad) > 0 ? [...order].reverse() : order;
  const sides = Math.sin(field.turn_rad) > 0 ? [...order].reverse() : order;
  const key = [field.turn_rad, field.tilt_rad, field.zoom, width, height].join();
  if (surface.list === list && surface.key === key) {
    context.drawImage(surface.kept, 0, 0, width, height);
  } else {
    context.lineWidth = 0.6;
    context.lineJoin = "round";
    for (const row of rows) {
      for (const column of sides) {
        const a = row * columns + column;
        paintSquare(context, [a, a + 1, a + columns + 1, a + columns], points, list);
      }
    }
    keepSurface(context.canvas, list, key);
  }
  const on = (place) => to(place, heightAt(plan, place) + 0.012);
  drawRings(context, plan, on);
  drawFlow({ context, plan, step, at: (place) => on(place).slice(0, 2) });
  drawNorth({ context, width, to, plan });
}

function paintSquare(context, corners, points, list) {
  const [a, b, c, d] = corners.map((index) => list[index]);
  // Light from the west: what rises to the east is brighter.
  const shade = Math.min(Math.max(1 + 2.2 * (b + c - a - d), 0.72), 1.2);
  const color = viridisTable[Math.round((255 * (a + b + c + d)) / 4)].map((value) => Math.min(255, Math.round(value * shade)));
  context.fillStyle = context.strokeStyle = `rgb(${color.join(" ")})`;
  context.beginPath();
  for (const index of corners) context.lineTo(points[index][0], points[index][1]);
  context.closePath();
  context.fill();
  context.stroke();
}

/** Which way is north, in a corner. */
function drawNorth({ context, width, to, plan }) {
  const middle = plan.field.south_west_m;
  const [x0, y0] = to(middle, 0);
  const [x1, y1] = to([middle[0], middle[1] + 1], 0);
  const length = Math.hypot(x1 - x0, y1 - y0) || 1;
  const [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length];
  const [x, y] = [width - 34, 34];
  arrow(context, [x - 14 * ux, y - 14 * uy], [28 * ux, 28 * uy], { color: colors.faint });
  write(context, "N", x + 22 * ux, y + 22 * uy, { color: colors.faint, align: "center", base: "middle", weight: "600" });
}

function drawFieldScale({ context, width, height }) {
  const [left, top, wide] = [12, height - 16, 90];
  context.fillStyle = colors.panel;
  context.globalAlpha = 0.85;
  context.fillRect(left - 6, top - 8, wide + 78, 22);
  context.globalAlpha = 1;
  for (let x = 0; x < wide; x += 1) {
    context.fillStyle = ramp(x / wide);
    context.fillRect(left + x, top, 1.5, 7);
  }
  write(context, "low to high", left + wide + 6, top + 7, { color: colors.faint, size: 10.5 });
}

function turnField(dx, dy) {
  field.turn_rad += dx / 120;
  field.tilt_rad = Math.min(Math.max(field.tilt_rad - dy / 150, 0.1), 1.5);
}

/** Lets the potential be turned; `redraw` is called after every change. */
function setUpField(canvas, redraw) {
  const choose = (of, names) => {
    const show = () => names.forEach((name) => document.getElementById(`field-${name}`).setAttribute("aria-pressed", String(name === field[of])));
    for (const name of names) document.getElementById(`field-${name}`).addEventListener("click", () => {
      field[of] = name;
      show();
      redraw();
    });
  };
  choose("shows", ["surface", "heat"]);
  choose("of", ["followed", "mean"]);
  const zoom = (factor) => (field.zoom = Math.min(Math.max(field.zoom * factor, 0.5), 4));
  canvas.addEventListener("keydown", (event) => {
    const keys = {
      ArrowLeft: () => turnField(-12, 0), ArrowRight: () => turnField(12, 0), ArrowUp: () => turnField(0, -10),
      ArrowDown: () => turnField(0, 10), "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15),
    };
    if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
    keys[event.key]();
    event.preventDefault();
    event.stopPropagation();
    redraw();
  });
  onDrag(canvas, (dx, dy) => {
    turnField(dx, dy);
    redraw();
  });
}
