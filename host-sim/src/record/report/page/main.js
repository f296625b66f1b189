// Playing and keys: what moves the time, and what is drawn when it has moved.

const replay = { begin: null, index: 0, playing: false, atEnd: true, since_ms: 0, from_s: 0, drawn_ms: 0 };
const stillness = window.matchMedia("(prefers-reduced-motion: reduce)");
const STILL_MS = 250;
let wanted = { all: true };
let pending = false;

/** Asks for a picture: of everything, or of what changes with the time. */
function redraw(all = false) {
  wanted.all ||= all;
  if (pending) return;
  pending = true;
  requestAnimationFrame(() => {
    pending = false;
    draw();
  });
}

function draw() {
  if (!flight.begin) return;
  const { all } = wanted;
  wanted = { all: false };
  const step = flight.steps[replay.index];
  const plan = step && latest(flight.plans, step.time_s);
  const detailed = step && (latest(flight.detailed, step.time_s) ?? flight.detailed[0]);
  if (all) {
    readColors();
    CHARTS.forEach(drawChart);
  }
  drawScale();
  drawMap(byId("map"), replay.index);
  drawSpace(byId("space"), step, plan);
  drawField(byId("field"), detailed, step);
  drawHeardSignal(step);
  drawSection(byId("section"), replay.index);
  drawPictures(step);
  drawStrip(byId("strip"), replay.index);
  markCharts(step);
  showNow(step);
  showPlan(plan, detailed);
  byId("field-words").textContent = plan && detailed ? fieldWords(detailed) : "";
  markEvents(step ? step.time_s : 0);
  tell(step, plan);
  // For whoever measures: when the first picture was there.
  document.documentElement.dataset.firstPicture ??= performance.now().toFixed(0);
}

/** What the pictures show, in words, and as data for whoever tests or scripts the page. */
function tell(step, plan) {
  if (!step) return;
  const map = byId("map");
  const [x, y] = step.place_m;
  map.dataset.x = String(x);
  map.dataset.y = String(y);
  map.dataset.step = String(replay.index);
  const near = step.clearance_m === undefined ? "" : `, ${step.clearance_m.toFixed(2)} metres clear of the nearest pillar`;
  const where = ([east, north]) => `${east.toFixed(2)} metres east and ${north.toFixed(2)} north`;
  map.setAttribute("aria-label", `Map. The vehicle is ${where([x, y])}${toBeacon(step)}${near}.`);
  const lowest = plan ? `Potential of plan ${plan.id}, lowest at the target, ${where(plan.target_m)}.` : "No plan yet.";
  byId("field").setAttribute("aria-label", lowest);
  const slider = byId("time");
  slider.value = String(replay.index);
  slider.setAttribute("aria-valuetext", `${seconds(step.time_s)}, ${words(step.outcome)}`);
  if (!replay.playing) tellAloud(`${seconds(step.time_s)}: ${words(step.outcome)}, guard ${step.guard}${step.guard_reason ? `, ${step.guard_reason}` : ""}. ${step.height_m.toFixed(1)} metres high${toBeacon(step)}.`);
  byId("clock").textContent = `${step.time_s.toFixed(2)} / ${duration_s().toFixed(2)} s`;
}

/** Goes to a step. */
function goTo(index) {
  const end = Math.max(flight.steps.length - 1, 0);
  replay.index = Math.min(Math.max(Math.round(index), 0), end);
  replay.atEnd = replay.index === end;
  if (replay.playing) fromHere();
  redraw();
}

const seek = (time_s) => goTo(indexAt(flight.steps, time_s));

function play(on) {
  if (!flight.steps.length) return;
  if (on && replay.index >= flight.steps.length - 1) goTo(0);
  replay.playing = on;
  byId("play").textContent = on ? "\u275a\u275a" : "\u25b6";
  byId("play").setAttribute("aria-label", on ? "Pause" : "Play");
  if (!on) return;
  fromHere();
  requestAnimationFrame(tick);
}

/** The replay goes on from the step that is shown. */
function fromHere() {
  [replay.since_ms, replay.from_s] = [performance.now(), flight.steps[replay.index].time_s];
}

function tick(now_ms) {
  if (!replay.playing) return;
  const passed_s = (Math.max(now_ms - replay.since_ms, 0) / 1000) * Number(byId("rate").value);
  const index = indexAt(flight.steps, replay.from_s + passed_s);
  // Where little motion is wanted the pictures change a few times a second only.
  const waits = stillness.matches && now_ms - replay.drawn_ms < STILL_MS && index < flight.steps.length - 1;
  if (index !== replay.index && !waits) {
    replay.drawn_ms = now_ms;
    replay.index = Math.max(index, 0);
    redraw();
  }
  replay.atEnd = replay.index >= flight.steps.length - 1;
  if (replay.atEnd) play(false);
  else requestAnimationFrame(tick);
}

/** To the replan before or after the one in force. */
function toPlan(off) {
  const step = flight.steps[replay.index];
  const plan = flight.plans[indexAt(flight.plans, step ? step.time_s : 0) + off];
  if (plan) seek(plan.time_s);
}

/** Keys of the whole page; what has keys of its own keeps them. */
function onKey(event) {
  if (!flight.begin || event.ctrlKey || event.metaKey || event.altKey) return;
  const { target } = event;
  if (target.matches('input[type="search"], select')) return;
  const isSlider = target.id === "time";
  const takesSpace = target.matches("button, summary, input[type=checkbox]");
  const time_s = flight.steps[replay.index]?.time_s ?? 0;
  const move = (way) => (event.shiftKey ? seek(time_s + way) : goTo(replay.index + way));
  const keys = {
    " ": () => play(!replay.playing), ",": () => toPlan(-1), ".": () => toPlan(1), ArrowLeft: () => move(-1),
    ArrowRight: () => move(1), Home: () => goTo(0), End: () => goTo(flight.steps.length - 1),
    m: () => showTab("map"), 3: () => showTab("space"), p: () => showTab("field"), s: () => showTab("signal"), v: () => showTab("section"),
  };
  if (!keys[event.key] || (event.key === " " && takesSpace)) return;
  // The slider's own keys do the same, but for Shift.
  if (isSlider && /^(Home|End)$/.test(event.key)) return;
  keys[event.key]();
  event.preventDefault();
}

/** Brings the pane of a tab to the front of those beside it. */
function showTab(name) {
  const chosen = byId(`tab-${name}`);
  for (const tab of chosen.parentElement.children) {
    const isChosen = tab === chosen;
    tab.setAttribute("aria-selected", String(isChosen));
    tab.tabIndex = isChosen ? 0 : -1;
    byId(tab.getAttribute("aria-controls")).hidden = !isChosen;
  }
  redraw(true);
}

/** Tabs: a press, or arrows between them. */
function setUpTabs() {
  for (const tab of document.querySelectorAll('[role="tab"]')) {
    tab.addEventListener("click", () => showTab(tab.id.slice(4)));
    tab.addEventListener("keydown", (event) => {
      const other = { ArrowLeft: tab.previousElementSibling, ArrowRight: tab.nextElementSibling }[event.key];
      if (!["ArrowLeft", "ArrowRight"].includes(event.key)) return;
      event.preventDefault();
      event.stopPropagation();
      if (!other) return;
      showTab(other.id.slice(4));
      other.focus();
    });
  }
}

/** Says what is shown once the cursor stands, for those who do not see it. */
let telling = 0;
function tellAloud(text) {
  clearTimeout(telling);
  telling = setTimeout(() => (byId("told").textContent = text), 600);
}

/** New records have come. */
refresh = () => {
  const { begin, steps } = flight;
  if (!begin) return;
  const end = Math.max(steps.length - 1, 0);
  byId("time").max = String(end);
  if (begin !== replay.begin) {
    Object.assign(replay, { begin, atEnd: true });
    Object.assign(camera, { fitted: !camera.follows });
    showParameters();
    fromAddress();
    if (begin.scenario.landing) showTab("section");
  }
  // Whoever looks at the end goes on looking at the end.
  replay.index = replay.atEnd ? end : Math.min(replay.index, end);
  showResult();
  showRun();
  showEvents(seek);
  describeCharts();
  redraw(true);
};

/** `#t=6.2` behind the address is a time to begin at. */
function fromAddress() {
  const match = /^#t=([0-9.]+)$/.exec(window.location.hash);
  if (match) seek(Number(match[1]));
}

/** Where the browser lets no page write to the clipboard, the command is selected instead. */
function copyCommand() {
  const select = () => getSelection().selectAllChildren(byId("command"));
  if (navigator.clipboard) navigator.clipboard.writeText(flight.begin.command).catch(select);
  else select();
}

function setUp() {
  setUpTabs();
  setUpMap(byId("map"), redraw.bind(null, false));
  setUpSpace(byId("space"), redraw.bind(null, false));
  setUpField(redraw.bind(null, false));
  setUpSection(byId("section"), goTo);
  setUpPictures(seek);
  setUpCharts(seek);
  scrub(byId("strip"), { left: THUMB, right: THUMB }, (share) => seek(share * duration_s()));
  byId("time").addEventListener("input", (event) => goTo(Number(event.target.value)));
  byId("play").addEventListener("click", () => play(!replay.playing));
  byId("rate").addEventListener("change", () => replay.playing && goTo(replay.index));
  byId("plan-before").addEventListener("click", () => toPlan(-1));
  byId("plan-after").addEventListener("click", () => toPlan(1));
  byId("events").addEventListener("keydown", onEventKey);
  byId("find").addEventListener("input", showParameters);
  byId("copy").addEventListener("click", copyCommand);
  // The canvases take the colours of the style sheet, which are light or dark as the system has it.
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => redraw(true));
  window.addEventListener("keydown", onKey);
  window.addEventListener("hashchange", fromAddress);
  new ResizeObserver(() => redraw(true)).observe(document.body);
  new ResizeObserver(() => redraw()).observe(byId("map"));
}

setUp();
unpack(byId("records").textContent).then((records) => records.forEach(add));
