// The vertical section along the path, and the pictures of the camera around the cursor.

/** Distance along the path of every step. */
const along = { steps: 0, begin: null, list_m: [] };

function distances_m() {
  const { begin, steps } = flight;
  if (along.begin !== begin || along.steps > steps.length) Object.assign(along, { begin, steps: 0, list_m: [] });
  for (; along.steps < steps.length; along.steps += 1) {
    const [step, before] = [steps[along.steps], steps[along.steps - 1]];
    const way_m = before ? Math.hypot(step.place_m[0] - before.place_m[0], step.place_m[1] - before.place_m[1]) : 0;
    along.list_m.push((last(along.list_m) ?? 0) + way_m);
  }
  return along.list_m;
}

/** Colours of the landing's stages. */
function stageColor(step) {
  const colors = {
    seeking: "blue", approaching: "sky", searching_beacon: "purple", searching_pad: "purple", centring: "yellow",
    descending: "orange", recovering: "red", committed: "orange", landed: "green", handed_over: "green",
  };
  return step.landing ? (colors[step.landing.stage] ?? "faint") : "blue";
}

const stageOf = (step) => (step.landing ? step.landing.stage : "seeking");

/** The heights of the picture: the ground, or below it what was flown; and a little over the flight. */
function heightRange() {
  const [low, high] = extent(flight.steps.map((step) => step.height_m));
  return [Math.min(low, 0), Math.max(high, knowsBeacon() ? flight.begin.beacon_height_m : 0, 1) * 1.15];
}

function drawSection(canvas, index) {
  const picture = prepare(canvas);
  const { context, width, height } = picture;
  const { steps } = flight;
  if (!width || !steps.length) return;
  const list_m = distances_m();
  const span_m = Math.max(last(list_m), 1);
  const x = axisAcross(picture, span_m, "m");
  const y = axisUp(picture, heightRange());
  line(context, [[EDGE.left, y(0)], [width - EDGE.right, y(0)]], { color: colors["pillar-edge"], width: 2 });
  drawStages({ context, x, y, list_m, width });
  const beacon = [x(span_m), y(flight.begin.beacon_height_m)];
  if (knowsBeacon()) disc(context, beacon, 4.5, { fill: colors.green });
  if (padAt(last(steps).time_s)) line(context, [[beacon[0] - 14, y(0) - 2], [beacon[0], y(0) - 2]], { color: colors.red, width: 4 });
  const step = steps[index];
  if (!step) return;
  const place = [x(list_m[index]), y(step.height_m)];
  line(context, [[place[0], EDGE.top], [place[0], height - EDGE.bottom]], { color: colors.ink, width: 1.2 });
  disc(context, place, 5, { fill: colors.panel, stroke: colors.ink, width: 2 });
  canvas.dataset.height = String(step.height_m);
  canvas.setAttribute("aria-label", `Vertical section. ${sectionWords(step, index)}`);
  byId("section-words").textContent = sectionWords(step, index);
}

/** The heights, in the colours of the landing's stages; where the pad is seen a wide green line is below. */
function drawStages({ context, x, y, list_m, width }) {
  const { steps } = flight;
  const every = Math.max(Math.ceil(steps.length / (4 * width)), 1);
  let begun = 0;
  let sees = null;
  for (let index = 0; index <= steps.length; index += 1) {
    const step = steps[index];
    const seen = step && step.landing && step.landing.sees_pad;
    if (seen && sees === null) sees = index;
    if (!seen && sees !== null) {
      const path = steps.slice(sees, index).map((one, k) => [x(list_m[sees + k]), y(one.height_m)]);
      line(context, path, { color: colors.green, width: 8, alpha: 0.3 });
      sees = null;
    }
    if (step && stageOf(step) === stageOf(steps[begun])) continue;
    const piece = steps.slice(begun, Math.min(index + 1, steps.length));
    const path = piece.map((one, k) => [x(list_m[begun + k]), y(one.height_m)]).filter((_, k) => k % every === 0 || k === piece.length - 1);
    line(context, path, { color: colors[stageColor(steps[begun])], width: 2.2 });
    begun = index;
  }
}

function sectionWords(step, index) {
  const stage = step.landing ? `, ${words(step.landing.stage)}${step.landing.reason ? ` (${words(step.landing.reason)})` : ""}, ${step.landing.sees_pad ? "sees the pad" : "does not see the pad"}` : "";
  return `${step.height_m.toFixed(2)} m high after ${distances_m()[index].toFixed(1)} m of path, climbing at ${step.climb_mps.toFixed(2)} m/s${stage}.`;
}

/** Presses and drags in the section lead to where the vehicle was that far along its path. */
function setUpSection(canvas, goTo) {
  scrub(canvas, EDGE, (share) => {
    const index = distances_m().findIndex((distance_m) => distance_m >= share * last(distances_m()));
    goTo(index < 0 ? flight.steps.length - 1 : index);
  });
}

/** The decoded pictures; one that is not there yet is drawn when it is. */
const decoded = new WeakMap();
function imageOfPicture(picture) {
  const known = decoded.get(picture);
  if (known) return known.complete && known.naturalWidth ? known : null;
  const image = new Image();
  decoded.set(picture, image);
  image.addEventListener("load", () => redraw());
  image.src = `data:image/png;base64,${picture.png}`;
  return null;
}

/** What the camera saw last, with a circle around what is taken for the pad. */
function drawPictures(step) {
  const { pictures } = flight;
  const index = step ? indexAt(pictures, step.time_s) : -1;
  byId("camera-panel").hidden = !pictures.length;
  if (!pictures.length) return;
  const picture = pictures[Math.max(index, 0)];
  const canvas = byId("camera");
  canvas.style.aspectRatio = `${picture.columns} / ${picture.rows}`;
  const { context, width, height } = prepare(canvas);
  const image = imageOfPicture(picture);
  if (index >= 0 && width && image) {
    context.imageSmoothingEnabled = false;
    context.drawImage(image, 0, 0, width, height);
    const [column, row, radius] = (picture.pad ?? []).map((pixels) => (pixels * width) / picture.columns);
    if (picture.pad) disc(context, [column, row], radius, { stroke: "#ffffff", width: 1.5 });
    canvas.dataset.time = String(picture.time_s);
  }
  const text = index < 0 ? "no picture yet" : `${picture.seen}, from ${picture.height_m.toFixed(2)} m at ${picture.time_s.toFixed(1)} s; ${index + 1} of ${pictures.length}`;
  canvas.setAttribute("aria-label", `Picture of the camera: ${text}`);
  byId("camera-words").textContent = text;
}

/** The buttons lead to the time of the picture before, and of the next. */
function setUpPictures(seek) {
  const to = (off) => {
    const picture = flight.pictures[indexAt(flight.pictures, flight.steps[replay.index]?.time_s ?? 0) + off];
    if (picture) seek(picture.time_s);
  };
  byId("picture-before").addEventListener("click", () => to(-1));
  byId("picture-after").addEventListener("click", () => to(1));
}
