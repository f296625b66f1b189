// What all pictures need: canvases that are sharp, colours of the style sheet, scales.

/** Sets a canvas to the size that it has on the page; returns its context, in CSS pixels. */
function prepare(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  // A canvas that is not shown keeps its picture.
  if (width && (canvas.width !== wide || canvas.height !== high)) [canvas.width, canvas.height] = [wide, high];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** Colours by their names in the style sheet, read once per theme. */
let colors = {};
function readColors() {
  const style = getComputedStyle(document.documentElement);
  const names = ["panel", "ground", "ink", "faint", "line", "grid", "pillar", "pillar-edge", "blue", "sky", "green", "orange", "red", "purple", "yellow", "quiet"];
  colors = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

// Viridis (van der Walt and Smith, 2015), as a polynomial of the sixth degree.
const VIRIDIS = [
  [0.2777273272, 0.0054073445, 0.3340998053],
  [0.1050930431, 1.4046135299, 1.3845901627],
  [-0.3308618287, 0.2148475595, 0.0950951630],
  [-4.6342304990, -5.7991009734, -19.3324409563],
  [6.2282699363, 14.1799333668, 56.6905526007],
  [4.7763849983, -13.7451453777, -65.3530326334],
  [-5.4354558559, 4.6458526122, 26.3124352496],
];

/** Red, green and blue, 0..255, of a share of 0..1. */
function viridis(share) {
  const t = Math.min(Math.max(share, 0), 1);
  return [0, 1, 2].map((channel) => {
    const value = VIRIDIS.reduceRight((sum, term) => sum * t + term[channel], 0);
    return Math.round(255 * Math.min(Math.max(value, 0), 1));
  });
}

const viridisTable = Array.from({ length: 256 }, (_, index) => viridis(index / 255));
const viridisCss = viridisTable.map(([r, g, b]) => `rgb(${r} ${g} ${b})`);
const ramp = (share) => viridisCss[Math.round(255 * Math.min(Math.max(share || 0, 0), 1))];

/** The colours of the shares 0 to 1, from left to right. */
function paintRamp(context, [left, top, wide, high]) {
  for (let x = 0; x < wide; x += 1) {
    context.fillStyle = ramp(x / wide);
    context.fillRect(left + x, top, 1.5, high);
  }
}

/** A round step so that an interval has about `count` of them. */
function roundStep(interval, count) {
  const rough = interval / Math.max(count, 1) || 1;
  const decade = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((m) => m * decade).find((step) => step >= rough) ?? rough;
}

/** Multiples of a step in an interval. */
function marks(from, to, step) {
  const list = [];
  for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9; k += 1) list.push(k * step);
  return list;
}

/** A number with as many places as its step needs. */
function label(value, step) {
  const places = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return (Math.abs(value) < step / 1e3 ? 0 : value).toFixed(places);
}

/** The margins of a picture with axes. */
const EDGE = { left: 46, right: 8, top: 8, bottom: 18 };

/** Grid and numbers of the axis to the right, from zero; returns where a value is. */
function axisAcross({ context, width, height }, most, unit) {
  const x = (value) => EDGE.left + ((width - EDGE.left - EDGE.right) * value) / most;
  const step = roundStep(most, width / 80);
  for (const value of marks(0, most, step)) {
    line(context, [[x(value), EDGE.top], [x(value), height - EDGE.bottom]], { color: colors.grid });
    const align = !value ? "left" : x(value) > width - 24 ? "right" : "center";
    write(context, `${label(value, step)} ${unit}`, x(value), height - 4, { color: colors.faint, align, size: 10 });
  }
  return x;
}

/** Of the axis upwards; what is beyond it is at its end. */
function axisUp({ context, width, height }, [low, high]) {
  const y = (value) => height - EDGE.bottom - ((height - EDGE.top - EDGE.bottom) * (Math.min(Math.max(value, low), high) - low)) / (high - low);
  const step = roundStep(high - low, height / 26);
  for (const value of marks(low, high, step)) {
    const color = Math.abs(value) < step / 1e3 ? colors.line : colors.grid;
    line(context, [[EDGE.left, y(value)], [width - EDGE.right, y(value)]], { color });
    write(context, label(value, step), EDGE.left - 6, y(value), { color: colors.faint, align: "right", base: "middle", size: 10 });
  }
  return y;
}

/** A copy of a picture, over which what moves is drawn. */
function copyOf(canvas, copy = document.createElement("canvas")) {
  [copy.width, copy.height] = [canvas.width, canvas.height];
  copy.getContext("2d").drawImage(canvas, 0, 0);
  return copy;
}

/** Lets a canvas be pressed and dragged: calls back with the share of its width between the edges. */
function scrub(canvas, { left, right }, to) {
  const go = (event) => to(Math.min(Math.max((event.offsetX - left) / (canvas.clientWidth - left - right), 0), 1));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    go(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) go(event);
  });
}

function line(context, points, { color, width = 1, alpha = 1, dash = [] }) {
  if (points.length < 2) return;
  context.save();
  context.globalAlpha = alpha;
  context.strokeStyle = color;
  context.lineWidth = width;
  context.lineJoin = context.lineCap = "round";
  context.setLineDash(dash);
  context.beginPath();
  points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
  context.restore();
}

function disc(context, [x, y], radius, { fill, stroke, width = 1, alpha = 1, dash = [] }) {
  context.save();
  context.globalAlpha = alpha;
  context.beginPath();
  context.arc(x, y, Math.max(radius, 0), 0, 2 * Math.PI);
  if (fill) {
    context.fillStyle = fill;
    context.fill();
  }
  if (stroke) {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.stroke();
  }
  context.restore();
}

function write(context, text, x, y, { color, align = "left", base = "alphabetic", size = 11, weight = "" }) {
  context.fillStyle = color;
  context.font = `${weight} ${size}px system-ui, "DejaVu Sans", sans-serif`;
  context.textAlign = align;
  context.textBaseline = base;
  context.fillText(text, x, y);
}

/** An arrow from a point along a vector of the picture. */
function arrow(context, [x, y], [dx, dy], { color, width = 2 }) {
  const length = Math.hypot(dx, dy);
  if (length < 4) return;
  const [ux, uy] = [dx / length, dy / length];
  const [tx, ty] = [x + dx, y + dy];
  const head = Math.min(7, length / 2);
  line(context, [[x, y], [tx, ty]], { color, width });
  const wing = (side) => [tx - head * (ux + side * uy * 0.6), ty - head * (uy - side * ux * 0.6)];
  line(context, [wing(1), [tx, ty], wing(-1)], { color, width });
}
