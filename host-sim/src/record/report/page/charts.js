// What goes on over time. A chart's lines are drawn once; the cursor is drawn over them at every step.

const stepSeries = (of) => () => flight.steps.map((step) => [step.time_s, of(step)]);
const planSeries = (of) => () => flight.plans.flatMap((plan) => of(plan).map((value) => [plan.time_s, value]));
const last = (list) => list[list.length - 1];

/** Bearings without jumps of a turn: each within half a turn of the truth, or else of what is followed, and that of the one before. */
function unrolled(of) {
  return () => {
    let around = 0;
    return flight.steps.map((step) => {
      around += wrap_deg((step.truth_deg ?? step.followed_deg ?? around) - around);
      const value = of(step);
      return [step.time_s, value === undefined ? undefined : around + wrap_deg(value - around)];
    });
  };
}

const twoSigma_deg = (step) => (step.heard && step.heard.valid ? 2 * step.heard.sigma_deg : undefined);

const costs = (plan, feasible) => plan.samples.filter((sample) => sample.feasible === feasible).map((sample) => sample.cost);
const followedCost = (plan) => (plan && plan.cost !== undefined ? [plan.cost] : []);

/**
 * The charts. A series is a line, dots or a level; a `band` is drawn to either side of zero, or of its `around`. `value`
 * prints what holds at a step.
 */
const CHARTS = [
  {
    title: "Outcome, guard, landing, plans", unit: "", lanes: [
      { name: "outcome", color: (s) => outcomeColor(s.outcome), value: (s) => words(s.outcome) },
      { name: "guard", color: (s) => guardColor(s.guard), value: (s) => (s.guard_reason ? `${s.guard}: ${s.guard_reason}` : s.guard) },
      { name: "landing", color: (s) => (s.landing ? stageColor(s) : "quiet"), value: (s) => (s.landing ? words(s.landing.stage) : "none") },
    ],
    series: [],
  },
  {
    title: "Error of the bearing", unit: "deg", symmetric: true, robust: true,
    series: [
      { name: "2 sigma", kind: "band", color: "green", points: stepSeries(twoSigma_deg), value: (s) => number(twoSigma_deg(s), 2) },
      { name: "heard", kind: "dots", color: "blue", points: stepSeries(bearingError_deg), value: (s) => number(bearingError_deg(s), 2) },
    ],
  },
  {
    title: "Bearing from north", unit: "deg",
    series: [
      { name: "heard", kind: "dots", color: "blue", points: unrolled(heard_deg), value: (s) => number(heard_deg(s), 1) },
      { name: "followed", kind: "line", color: "orange", points: unrolled((s) => s.followed_deg), value: (s) => number(s.followed_deg, 1) },
      { name: "truth", kind: "line", color: "ink", dash: [5, 3], points: unrolled((s) => s.truth_deg), value: (s) => number(s.truth_deg, 1) },
    ],
  },
  {
    title: "Estimate of the source", unit: "m", zero: true, robust: true,
    series: [
      { name: "sigma", kind: "line", color: "purple", dash: [5, 3], points: stepSeries((s) => s.source_sigma_m), value: (s) => number(s.source_sigma_m, 2) },
      { name: "error", kind: "line", color: "blue", points: stepSeries(sourceError_m), value: (s) => number(sourceError_m(s), 2) },
      { name: "distance", kind: "line", color: "quiet", points: stepSeries((s) => s.truth_m), value: (s) => number(s.truth_m, 2) },
    ],
  },
  {
    title: "Speed", unit: "m/s", zero: true,
    series: [
      { name: "limit", kind: "level", color: "faint", at: () => flight.begin.speed_max_mps, value: () => number(flight.begin.speed_max_mps, 2) },
      { name: "setpoint", kind: "line", color: "orange", points: stepSeries(wantedSpeed_mps), value: (s) => number(wantedSpeed_mps(s), 2) },
      { name: "true", kind: "line", color: "blue", points: stepSeries(speed_mps), value: (s) => number(speed_mps(s), 2) },
    ],
  },
  {
    title: "Clearance to the nearest pillar", unit: "m", zero: true, most: 1.5,
    series: [
      { name: "margin", kind: "level", color: "faint", at: () => flight.begin.margins_m[0], value: () => number(flight.begin.margins_m[0], 2) },
      { name: "contact", kind: "level", color: "red", at: () => 0, value: () => "0" },
      { name: "hull", kind: "line", color: "blue", points: stepSeries((s) => s.clearance_m), value: (s) => number(s.clearance_m, 3) },
    ],
  },
  {
    title: "Signal to noise", unit: "dB", robust: true, least: 2,
    series: [
      { name: "per sample", kind: "dots", color: "blue", points: stepSeries((s) => s.heard && s.heard.snr_db), value: (s) => number(s.heard && s.heard.snr_db, 1) },
    ],
  },
  {
    title: "Cost of the trajectories", unit: "", zero: true,
    series: [
      { name: "may not be chosen", kind: "dots", color: "quiet", points: planSeries((p) => costs(p, false)), value: () => "" },
      { name: "may be", kind: "dots", color: "blue", points: planSeries((p) => costs(p, true)), value: () => "" },
      { name: "followed", kind: "steps", color: "orange", points: planSeries(followedCost), value: (s) => number(followedCost(latest(flight.plans, s.time_s))[0], 2) },
    ],
  },
  {
    title: "Height", unit: "m", zero: true,
    series: [
      { name: "beacon", kind: "level", color: "green", at: () => (knowsBeacon() ? flight.begin.beacon_height_m : undefined), value: () => number(knowsBeacon() ? flight.begin.beacon_height_m : undefined, 2) },
      { name: "sees the pad", kind: "dots", color: "red", points: stepSeries((s) => (s.landing && s.landing.sees_pad ? s.height_m : undefined)), value: (s) => (s.landing && s.landing.sees_pad ? "yes" : "no") },
      { name: "vehicle", kind: "line", color: "blue", points: stepSeries((s) => s.height_m), value: (s) => number(s.height_m, 2) },
    ],
  },
];

const number = (value, places) => (value === undefined || value === null || Number.isNaN(value) ? "none" : value.toFixed(places));

/** Makes the figures; a press or a drag on one leads to that time. */
function setUpCharts(seek) {
  const room = byId("charts");
  for (const chart of CHARTS) {
    const figure = document.createElement("figure");
    figure.className = chart.lanes ? "panel chart wide" : "panel chart";
    const caption = document.createElement("figcaption");
    const title = document.createElement("strong");
    title.textContent = chart.unit ? `${chart.title}, ${chart.unit}` : chart.title;
    caption.append(title);
    chart.values = (chart.lanes ?? chart.series).map((entry) => legendEntry(caption, entry, chart.lanes));
    chart.canvas = document.createElement("canvas");
    chart.canvas.setAttribute("role", "img");
    figure.append(caption, chart.canvas);
    room.append(figure);
    scrub(chart.canvas, EDGE, (share) => seek(share * duration_s()));
  }
}

function legendEntry(caption, entry, isLane) {
  const item = document.createElement("span");
  item.className = "entry";
  const key = document.createElement("i");
  key.className = "key";
  if (!isLane) key.style.background = `var(--${entry.color})`;
  const value = document.createElement("b");
  item.append(key, entry.name, value);
  caption.append(item);
  return { key, value };
}

/** Least and greatest of a chart's values, with room around them. */
function rangeOf(chart, data) {
  const values = chart.series.flatMap((series, index) => {
    if (series.kind === "level") return [series.at() ?? []].flat();
    const list = data[index].map((point) => point[1]).filter((value) => Number.isFinite(value));
    return series.kind === "band" ? list.flatMap((value) => [value, -value]) : list;
  }).sort((a, b) => a - b);
  if (!values.length) return [0, 1];
  // A few outliers would press everything else flat: what is beyond is drawn at the edge.
  const cut = chart.robust ? 0.01 : 0;
  let low = values[Math.floor(cut * (values.length - 1))];
  let high = values[Math.ceil((1 - cut) * (values.length - 1))];
  if (chart.most !== undefined) high = Math.min(high, chart.most);
  if (chart.zero) low = Math.min(low, 0);
  if (chart.symmetric) [low, high] = [-Math.max(-low, high), Math.max(-low, high)];
  const more = Math.max((chart.least ?? 0) - (high - low), 0) / 2;
  [low, high] = [low - more, high + more];
  const room = (high - low || 1) * 0.06;
  return [chart.zero && low >= 0 ? -room / 2 : low - room, high + room];
}

/** Draws a chart without its cursor, and keeps the picture. */
function drawChart(chart) {
  const picture = prepare(chart.canvas);
  if (!picture.width) return;
  chart.x = axisAcross(picture, duration_s() || 1, "s");
  if (chart.lanes) drawLanes(chart, picture);
  else drawSeries(chart, picture);
  chart.kept = copyOf(chart.canvas, chart.kept);
}

function drawSeries(chart, picture) {
  const data = chart.series.map((series) => (series.points ? series.points() : []));
  const y = axisUp(picture, rangeOf(chart, data));
  chart.series.forEach((series, index) => drawOne(series, data[index], { ...picture, x: chart.x, y }));
}

function drawOne(series, points, { context, x, y, width }) {
  const style = { color: colors[series.color], width: 1.6, dash: series.dash ?? [] };
  if (series.kind === "level") {
    if (series.at() !== undefined) line(context, [[EDGE.left, y(series.at())], [width - EDGE.right, y(series.at())]], { ...style, width: 1.1, dash: [2, 3] });
  } else if (series.kind === "dots") {
    const there = apart(points.filter((point) => Number.isFinite(point[1])), x, y);
    const size = there.length > 300 ? 2.4 : 3.6;
    context.fillStyle = style.color;
    context.globalAlpha = there.length > 300 ? 0.55 : 0.9;
    for (const [time_s, value] of there) context.fillRect(x(time_s) - size / 2, y(value) - size / 2, size, size);
    context.globalAlpha = 1;
  } else {
    for (const piece of pieces(points)) drawPiece(series, perPixel(piece, x), style, { context, x, y });
  }
}

/** Of more points than a picture can show: in every column of pixels the first, the last, the least and the greatest. */
function perPixel(points, x) {
  if (points.length < 2000) return points;
  const columns = [];
  for (const point of points) {
    const column = Math.round(x(point[0]));
    const group = last(columns);
    if (!group || group.column !== column) columns.push({ column, first: point, least: point, greatest: point, last: point });
    else {
      group.last = point;
      if (point[1] < group.least[1]) group.least = point;
      if (point[1] > group.greatest[1]) group.greatest = point;
    }
  }
  return columns.flatMap(({ first, least, greatest, last: end }) => [...new Set([first, least, greatest, end])].sort((a, b) => a[0] - b[0]));
}

/** Of more dots than a picture can show: those that do not lie on another. */
function apart(points, x, y) {
  if (points.length < 2000) return points;
  const taken = new Set();
  return points.filter(([time_s, value]) => {
    const cell = Math.round(x(time_s)) * 10_000 + Math.round(y(value));
    return !taken.has(cell) && taken.add(cell);
  });
}

function drawPiece(series, piece, style, { context, x, y }) {
  if (series.kind === "band") {
    context.save();
    context.globalAlpha = 0.22;
    context.fillStyle = style.color;
    context.beginPath();
    piece.forEach(([t, v]) => context.lineTo(x(t), y(v)));
    piece.toReversed().forEach(([t, v]) => context.lineTo(x(t), y(-v)));
    context.fill();
    context.restore();
  } else if (series.kind === "steps") {
    const stairs = piece.flatMap(([t, v], k) => (k ? [[x(t), y(piece[k - 1][1])], [x(t), y(v)]] : [[x(t), y(v)]]));
    line(context, stairs, style);
    piece.forEach(([t, v]) => disc(context, [x(t), y(v)], 2.4, { fill: style.color }));
  } else {
    line(context, piece.map(([t, v]) => [x(t), y(v)]), style);
  }
}

/** The runs of a series that have values. */
function pieces(points) {
  const list = [[]];
  for (const point of points) {
    if (Number.isFinite(point[1])) last(list).push(point);
    else if (last(list).length) list.push([]);
  }
  return list;
}

function drawLanes(chart, { context, height }) {
  const { x, lanes } = chart;
  const tall = (height - EDGE.top - EDGE.bottom) / (lanes.length + 1);
  lanes.forEach((lane, index) => {
    const top = EDGE.top + index * tall;
    for (const [from, to, step] of runs(lane.color)) {
      context.fillStyle = colors[lane.color(step)];
      context.fillRect(x(from), top + 3, Math.max(x(to) - x(from), 1), tall - 8);
      writeInBand(context, lane.value(step), [x(from), top + 3, x(to) - x(from), tall - 8]);
    }
    write(context, lane.name, 2, top + tall / 2, { color: colors.faint, base: "middle", size: 9.5 });
  });
  const top = EDGE.top + lanes.length * tall;
  write(context, "plans", 2, top + tall / 2, { color: colors.faint, base: "middle", size: 9.5 });
  for (const plan of flight.plans) {
    const color = plan.origin === "brake" ? colors.red : colors.orange;
    context.fillStyle = color;
    if (plan.origin === "sampled") context.fillRect(x(plan.time_s) - 1, top + 3, 2, tall - 8);
    else disc(context, [x(plan.time_s), top + tall / 2 - 1], 4, { fill: color });
  }
}

/** A band's name in it, as far as it fits: whole, or up to its reason. */
function writeInBand(context, text, [left, top, wide, high]) {
  context.font = '600 10px system-ui, "DejaVu Sans", sans-serif';
  const fits = [text, text.split(":")[0]].find((one) => context.measureText(one).width < wide - 8);
  if (!fits || fits === "none" || fits === "passed") return;
  write(context, fits, left + 4, top + high / 2 + 0.5, { color: colors.panel, base: "middle", size: 10, weight: "600" });
}

/** Runs of steps of the same colour: from, to, the first step. */
function runs(color) {
  const list = [];
  for (const step of flight.steps) {
    const run = last(list);
    if (run && color(run[2]) === color(step)) run[1] = step.time_s;
    else {
      if (run) run[1] = step.time_s;
      list.push([step.time_s, step.time_s, step]);
    }
  }
  return list;
}

/** The cursor at a step, and what holds there. */
function markCharts(step) {
  for (const chart of CHARTS) {
    if (!chart.kept || !chart.x || !step) continue;
    const { context, height } = prepare(chart.canvas);
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(chart.kept, 0, 0);
    context.restore();
    const x = chart.x(step.time_s);
    line(context, [[x, EDGE.top - 4], [x, height - EDGE.bottom]], { color: colors.ink, width: 1.2 });
    (chart.lanes ?? chart.series).forEach((entry, index) => {
      const legend = chart.values[index];
      legend.value.textContent = entry.value(step);
      if (chart.lanes) legend.key.style.background = `var(--${entry.color(step)})`;
    });
  }
}

/** Says in words what a chart shows, for those who do not see it. */
function describeCharts() {
  for (const chart of CHARTS) {
    const parts = chart.series.filter((series) => series.points).map((series) => {
      const [low, high] = extent(series.points().map((point) => point[1]));
      return low <= high ? `${series.name} from ${low.toFixed(2)} to ${high.toFixed(2)}` : `${series.name}: none`;
    });
    chart.canvas.setAttribute("aria-label", `${chart.title} over ${duration_s().toFixed(1)} seconds. ${parts.join("; ")}`);
  }
}

/** The strip above the slider: the outcomes, what the guard did, and a tick for every plan. All but the cursor is drawn once. */
const strip = { kept: undefined, key: "" };

function drawStrip(canvas, index) {
  const { context, width, height } = prepare(canvas);
  if (!width) return;
  const x = (time_s) => THUMB + ((width - 2 * THUMB) * time_s) / (duration_s() || 1);
  const key = [width, height, flight.steps.length, flight.plans.length, colors.ink].join();
  if (strip.key !== key) {
    paintStrip(context, x, height);
    Object.assign(strip, { kept: copyOf(canvas, strip.kept), key });
  } else context.drawImage(strip.kept, 0, 0, width, height);
  const step = flight.steps[index];
  if (step) line(context, [[x(step.time_s), 0], [x(step.time_s), height]], { color: colors.ink, width: 1.5 });
}

function paintStrip(context, x, height) {
  for (const [from, to, step] of runs((s) => outcomeColor(s.outcome))) {
    context.fillStyle = colors[outcomeColor(step.outcome)];
    context.fillRect(x(from), height - 5, Math.max(x(to) - x(from), 1), 5);
  }
  for (const [from, to, step] of runs((s) => guardColor(s.guard))) {
    if (step.guard === "passed") continue;
    context.fillStyle = colors[guardColor(step.guard)];
    context.fillRect(x(from), height - 10, Math.max(x(to) - x(from), 1), 4);
  }
  context.fillStyle = colors.orange;
  for (const plan of flight.plans) context.fillRect(x(plan.time_s) - 0.75, 0, 1.5, 6);
}

/** Half the width of a slider's thumb, by which its track is shorter than it. */
const THUMB = 8;
