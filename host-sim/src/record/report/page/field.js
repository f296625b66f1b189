// The potential that a plan descends: a heat map with contours.

/** With which gains. */
const field = { of: "followed" };
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

function drawField(canvas, plan, step) {
  const { context, width, height } = prepare(canvas);
  if (!width || !plan) return;
  const { south_west_m: [west, south], step_m, columns } = plan.field;
  const side = step_m * (columns - 1);
  const scale = Math.max(width, height) / side;
  const at = ([x, y]) => [width / 2 + (x - west - side / 2) * scale, height / 2 - (y - south - side / 2) * scale];
  paintField({ context, at, plan }, 1);
  drawContours({ context, at, plan });
  for (const [x, y, r] of plan.circles_m) disc(context, at([x, y]), r * scale, { stroke: "#fff", width: 1.4, dash: [4, 3] });
  drawSamples({ context, at, plan }, ON_HEAT);
  if (step) disc(context, at(step.place_m), 4.5, { fill: "#000", stroke: "#fff", width: 2 });
  drawFieldScale({ context, height });
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
  for (let row = 0; row + 1 < columns; row += 1) {
    for (let column = 0; column + 1 < columns; column += 1) {
      const corners = [[column, row], [column + 1, row], [column + 1, row + 1], [column, row + 1]];
      const values = corners.map(([c, r]) => CONTOURS * list[r * columns + c]);
      const [low, high] = extent(values);
      for (let level = Math.max(Math.ceil(low), 1); level <= high && level < CONTOURS; level += 1) {
        const points = crossings(corners, values.map((value) => value - level), place);
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

function drawFieldScale({ context, height }) {
  const [left, top, wide] = [12, height - 16, 90];
  context.fillStyle = colors.panel;
  context.globalAlpha = 0.85;
  context.fillRect(left - 6, top - 8, wide + 78, 22);
  context.globalAlpha = 1;
  paintRamp(context, [left, top, wide, 7]);
  write(context, "low to high", left + wide + 6, top + 7, { color: colors.faint, size: 10.5 });
}

/** Lets the gains be chosen; `redraw` is called after every change. */
function setUpField(redraw) {
  const names = ["followed", "mean"];
  for (const name of names) byId(`field-${name}`).addEventListener("click", () => {
    field.of = name;
    names.forEach((other) => byId(`field-${other}`).setAttribute("aria-pressed", String(other === name)));
    redraw();
  });
}
