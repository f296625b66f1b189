// Words and numbers. Whatever comes from the records is put in as text.

const byId = (id) => document.getElementById(id);

/** Fills a list of names and values; keeps its elements from step to step. */
function fillRows(list, rows) {
  while (list.children.length > rows.length) list.lastChild.remove();
  while (list.children.length < rows.length) {
    const row = document.createElement("div");
    row.append(document.createElement("dt"), document.createElement("dd"));
    list.append(row);
  }
  rows.forEach(([name, value], index) => {
    const [term, text] = list.children[index].children;
    if (term.textContent !== name) term.textContent = name;
    if (text.textContent !== value) text.textContent = value;
  });
}

const metres = (value, places = 2) => (value === undefined || value === null ? "none" : `${value.toFixed(places)} m`);
const inMetres = (place) => (place ? `${place[0].toFixed(2)}, ${place[1].toFixed(2)} m` : "none");
const seconds = (value) => `${value.toFixed(2)} s`;

/** What the flight came to. */
function showResult() {
  const { scenario, seed } = flight.begin;
  const report = flight.end && flight.end.report;
  byId("name").textContent = scenario.name;
  document.title = `${scenario.name}: Foxhound flight`;
  const badge = byId("verdict");
  badge.className = `badge ${!report ? "open" : report.result === "reached" ? "good" : "bad"}`;
  badge.textContent = report ? `${verdict()} after ${report.time_s.toFixed(1)} s` : flight.cut ? "cut off" : "under way";
  fillRows(byId("facts"), report ? [
    ["path", metres(report.path_length_m)],
    ["straight line", metres(report.straight_line_m)],
    ["least clearance", metres(report.min_clearance_m, 3)],
    ["bearing rms", report.bearing_rms_deg === null ? "none" : `${report.bearing_rms_deg.toFixed(2)} deg`],
    ["plans", String(report.replans)],
    ["seed", String(seed)],
  ] : []);
}

/** How it was flown. */
function showRun() {
  const { begin, end, steps, plans } = flight;
  const { scenario } = begin;
  byId("command").textContent = begin.command;
  const { sensor, bearing, vehicle } = scenario;
  fillRows(byId("run"), [
    ["trace hash", end ? end.report.trace_hash : "under way"],
    ["seed", String(begin.seed)],
    ["planner", begin.planner],
    ["vehicle", `${vehicle.model}, radius ${scenario.drone_radius} m`],
    ["obstacle sensor", `${sensor.model}, ${sensor.fov_deg} deg, ${sensor.range_m} m`],
    ["direction finding", Number.isFinite(bearing.snr_db) ? `waveforms at ${bearing.snr_db} dB` : `sigma ${bearing.sigma_deg} deg`],
    ["pillars", String(scenario.obstacles.length)],
    ...(scenario.people ? [["people", String(scenario.people.reduce((sum, { group }) => sum + group, 0))]] : []),
    ["steps", flight.thinned ? `${end.steps} of ${begin.tick_s * 1000} ms, ${steps.length} of them here` : `${steps.length} of ${begin.tick_s * 1000} ms`],
    ["plans", String(plans.length)],
    ["program", `foxhound ${begin.program}`],
    ["view in space", "OGL 1.0.11, in the public domain"],
  ]);
  showThinned();
}

/** What a long flight's file leaves out. */
function showThinned() {
  const { thinned } = flight;
  byId("thinned").hidden = !thinned;
  if (!thinned) return;
  const parts = thinned.what.map(({ what, all, kept }) => `${kept} of ${all} ${what}`);
  byId("thinned").textContent = `A flight of more than ${thinned.from_s} s is thinned: this file holds ${parts.join(", ")}. ` +
    "Of the steps it holds those in which the guard did the most, the outcome or the stage of the landing changed, or a pillar was nearer than ever before. " +
    "The file of --mcap holds every step, every plan with its samples and its potential, and all tracks and obstacle maps.";
}

function cells(row, texts, tag = "td") {
  for (const text of texts) {
    const cell = document.createElement(tag);
    cell.textContent = text;
    row.append(cell);
  }
}

function showParameters() {
  const { parameters } = flight.begin;
  const body = byId("parameters").tBodies[0];
  const wanted = byId("find").value.toLowerCase();
  body.replaceChildren();
  for (const one of parameters) {
    if (!`${one.name} ${one.what}`.toLowerCase().includes(wanted)) continue;
    const row = body.insertRow();
    row.className = one.value === one.default ? "" : "changed";
    cells(row, [one.name, `${one.value}`, `${one.default}`, one.unit, one.what]);
  }
  const changed = parameters.filter((one) => one.value !== one.default).length;
  byId("parameters-count").textContent = `${parameters.length}, ${changed} not at their defaults`;
}

function showNow(step) {
  if (!step) return;
  const error_deg = bearingError_deg(step);
  byId("now-time").textContent = seconds(step.time_s);
  fillRows(byId("now"), [
    ["outcome", words(step.outcome)],
    ["guard", step.guard],
    ["its reason", step.guard_reason ?? "none needed"],
    ["place, east and north", inMetres(step.place_m)],
    ["height, climb", `${step.height_m.toFixed(2)} m, ${step.climb_mps.toFixed(2)} m/s`],
    ...(step.landing ? [["landing", `${words(step.landing.stage)}${step.landing.sees_pad ? ", sees the pad" : ""}`]] : []),
    ["yaw", `${step.yaw_deg.toFixed(1)} deg`],
    ["speed, setpoint", `${speed_mps(step).toFixed(2)}, ${wantedSpeed_mps(step).toFixed(2)} m/s`],
    ["clearance", metres(step.clearance_m, 3)],
    ["to the beacon", step.truth_m === undefined ? "unknown" : `${step.truth_m.toFixed(2)} m, ${step.truth_deg.toFixed(1)} deg`],
    ["bearing error, sigma", heard_deg(step) === undefined ? "not heard" : `${number(error_deg, 2)}, ${step.heard.sigma_deg.toFixed(2)} deg`],
    ["signal to noise", step.heard && step.heard.snr_db !== undefined ? `${step.heard.snr_db.toFixed(1)} dB` : "none"],
    ["flags", step.heard && step.heard.flags ? step.heard.flags.map(words).join(", ") : "none"],
    ["source believed at", inMetres(step.source_m)],
    ["its error, sigma", `${number(sourceError_m(step), 2)}, ${number(step.source_sigma_m, 2)} m`],
    ["temporary target", inMetres(step.target_m)],
  ]);
}

/** The samples of a plan, the cheapest first. */
function showPlan(inForce, detailed) {
  const table = byId("samples");
  if (table.dataset.plan === String(inForce && inForce.time_s)) return;
  table.dataset.plan = String(inForce && inForce.time_s);
  const plan = inForce && inForce.thinned ? detailed : inForce;
  const body = table.tBodies[0];
  body.replaceChildren();
  byId("plan-words").textContent = plan ? planWords(plan, inForce) : "No plan yet.";
  if (!plan) return;
  const most = Math.max(...plan.samples.map((sample) => sample.cost), 1e-6);
  const order = plan.samples.map((_, index) => index).sort((a, b) => plan.samples[a].cost - plan.samples[b].cost);
  for (const index of order) {
    const { cost, gains, feasible } = plan.samples[index];
    const row = body.insertRow();
    row.className = index === plan.chosen ? "best" : feasible ? "" : "out";
    const may = feasible ? "may be chosen" : "may not be chosen: comes too near, or does not get there";
    row.title = index === plan.chosen ? "followed" : may;
    cells(row, [String(index + 1), cost.toFixed(3)]);
    const bar = document.createElement("div");
    bar.className = "bar";
    bar.style.width = `${(100 * cost) / most}%`;
    row.insertCell().append(bar);
    cells(row, [gains.k_att.toFixed(2), gains.k_rep.toFixed(3), gains.influence_m.toFixed(2), gains.swirl.toFixed(2)]);
  }
}

function planWords(plan, inForce) {
  const clear = plan.samples.filter((sample) => sample.feasible).length;
  const drawn = plan.samples.length
    ? ` ${clear} of ${plan.samples.length} may be chosen; followed is what is nearest to their mean, weighted by cost.`
    : " Nothing was drawn for it.";
  const { belief } = plan;
  const axes = belief && ellipse(belief.covariance_m2);
  const source = axes ? ` The source is known to ${axes.major_m.toFixed(2)} by ${axes.minor_m.toFixed(2)} m.` : "";
  const other = plan === inForce ? "" : ` In force is ${planned(inForce)}, whose samples are not in this file.`;
  return `At ${seconds(plan.time_s)}, ${planned(plan)}.${drawn}${source}${other}`;
}

function fieldWords(plan) {
  const { k_att, k_rep, influence_m, swirl } = field.of === "mean" ? flight.begin.gains : plan.gains;
  const side_m = plan.field.step_m * (plan.field.columns - 1);
  const whose = field.of === "mean" ? "The mean gains" : `The gains of ${planned(plan)}`;
  return `${whose}, over ${side_m.toFixed(1)} m: attraction ${k_att.toFixed(2)}, repulsion ${k_rep.toFixed(3)} within ` +
    `${influence_m.toFixed(2)} m; the swirl of ${swirl.toFixed(2)} has no potential. Drawn is the root of the potential, cut off at the top.`;
}

/** The lines of what happened, in the order of time. */
const happened = { list: [], current: null };

/** What happened; every line leads to its time. One of them takes the focus, and arrows lead to the others. */
function showEvents(seek) {
  const list = events();
  const stays = (event, index) => event.time_s === list[index]?.time_s && event.text === list[index].text;
  // In a flight under way lines are added below; those that are there may be under a finger.
  if (!happened.list.every(stays)) {
    byId("events").replaceChildren();
    Object.assign(happened, { list: [], current: null });
  }
  for (const { time_s, color, text } of list.slice(happened.list.length)) {
    const button = eventButton({ time_s, color, text }, seek);
    const item = document.createElement("li");
    item.append(button);
    byId("events").append(item);
    happened.list.push({ time_s, text, button });
  }
}

function eventButton(event, seek) {
  const button = document.createElement("button");
  button.type = "button";
  button.tabIndex = -1;
  const time = document.createElement("time");
  time.textContent = seconds(event.time_s);
  const key = document.createElement("i");
  key.style.background = `var(--${event.color})`;
  button.append(time, key, event.text);
  button.addEventListener("click", () => seek(event.time_s));
  return button;
}

/** Marks the last event that has happened, and brings it into view inside its list. */
function markEvents(time_s) {
  const one = happened.list[Math.max(indexAt(happened.list, time_s), 0)];
  const button = one && one.button;
  if (!button || button === happened.current) return;
  // Whoever is at another line of that time stays there.
  const focused = happened.list.find((other) => other.button === document.activeElement);
  if (happened.current) happened.current.tabIndex = -1;
  if (happened.current) happened.current.removeAttribute("aria-current");
  happened.current = button;
  button.tabIndex = focused ? -1 : 0;
  if (focused) focused.button.tabIndex = 0;
  button.setAttribute("aria-current", "true");
  const list = byId("events");
  const top = button.parentElement.offsetTop - list.offsetTop;
  if (top < list.scrollTop || top > list.scrollTop + list.clientHeight - 30) list.scrollTop = top - list.clientHeight / 2;
}

/** Up and down in the list of what happened. */
function onEventKey(event) {
  const off = { ArrowUp: -1, ArrowDown: 1 }[event.key];
  const index = happened.list.findIndex(({ button }) => button === document.activeElement);
  const next = off && happened.list[index + off];
  if (index < 0 || !off) return;
  event.preventDefault();
  if (!next) return;
  happened.list[index].button.tabIndex = -1;
  next.button.tabIndex = 0;
  next.button.focus();
  next.button.click();
}
