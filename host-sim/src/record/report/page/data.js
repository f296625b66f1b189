// What is known of the flight, and of any time in it. Records come one by one through `add`, from the page or from anywhere.

/** `cut`: it was under way when whoever flies it fell silent. */
const NOTHING = () => ({ steps: [], remembered: [], people: [], tracks: [], plans: [], detailed: [], signals: [], pictures: [], thinned: null, end: null });
/** Where the records of a kind are. */
const LISTS = {
  step: "steps", remembered: "remembered", people: "people", tracks: "tracks", plan: "plans", signal: "signals", picture: "pictures",
};
const flight = { begin: null, ...NOTHING(), cut: false };
/** Told, at most once a picture, that there are new records. */
let refresh = () => {};
let refreshing = false;

/** Takes in one record. */
function add(record) {
  const { kind } = record;
  if (kind === "begin") Object.assign(flight, { begin: record, ...NOTHING() });
  else if (kind === "thinned" || kind === "end") flight[kind] = record;
  else flight[LISTS[kind]]?.push(record);
  if (kind === "plan" && !record.thinned) flight.detailed.push(record);
  if (!refreshing) {
    refreshing = true;
    requestAnimationFrame(() => {
      refreshing = false;
      refresh();
    });
  }
}

/** Index of the last record that is not later, or -1. The lists are in the order of time. */
function indexAt(list, time_s) {
  let low = 0;
  let high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle].time_s <= time_s + 1e-9) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

const latest = (list, time_s) => list[indexAt(list, time_s)];

const duration_s = () => (flight.steps.length ? flight.steps[flight.steps.length - 1].time_s : 0);

/** Least and greatest of a list, without what is no number. */
function extent(list) {
  const widen = ([low, high], value) => (Number.isFinite(value) ? [Math.min(low, value), Math.max(high, value)] : [low, high]);
  return list.reduce(widen, [Infinity, -Infinity]);
}

/** An angle to -180..180 degrees. */
function wrap_deg(angle_deg) {
  const turned = ((angle_deg % 360) + 360) % 360;
  return turned > 180 ? turned - 360 : turned;
}

/** The bearing that was heard in a step, and its error; none without a valid one. */
const heard_deg = (step) => (step.heard && step.heard.valid ? step.heard.bearing_deg : undefined);
const bearingError_deg = (step) => (heard_deg(step) === undefined || step.truth_deg === undefined ? undefined : wrap_deg(heard_deg(step) - step.truth_deg));

/** Whether it is known where the beacon is: a flight by a radio may not know, and its steps tell no distance from it. */
const knowsBeacon = () => !flight.steps.length || flight.steps[0].truth_m !== undefined;
/** How far the beacon is, in words, after a comma. */
const toBeacon = (step) => (step.truth_m === undefined ? "" : `, ${step.truth_m.toFixed(1)} metres from the beacon`);
/** How long a bearing is drawn: to the beacon, or as far as ten metres. */
const reach_m = (step) => step.truth_m ?? 10;

/** The beacon at a time: it moves straight on. */
function beaconAt(time_s) {
  const { goal, goal_velocity } = flight.begin.scenario;
  return [goal[0] + goal_velocity[0] * time_s, goal[1] + goal_velocity[1] * time_s];
}

/** How long a pillar has moved on from where it began; one that goes to and fro turns every `turns_s`. */
function away_s({ turns_s }, time_s) {
  if (!turns_s) return time_s;
  const since_s = time_s % (2 * turns_s);
  return Math.min(since_s, 2 * turns_s - since_s);
}

/** The pillars at a time, and people: x, y, radius. */
function pillarsAt(time_s) {
  const moved = flight.begin.scenario.obstacles.map((o) => {
    const on_s = away_s(o, time_s);
    return [o.x + o.vx * on_s, o.y + o.vy * on_s, o.r];
  });
  return moved.concat(flight.begin.walls, latest(flight.people, time_s)?.circles_m ?? []);
}

/** How far off the source is believed to be, metres. */
function sourceError_m(step) {
  if (!step.source_m || !knowsBeacon()) return undefined;
  const beacon = beaconAt(step.time_s);
  return Math.hypot(step.source_m[0] - beacon[0], step.source_m[1] - beacon[1]);
}

const speed_mps = (step) => Math.hypot(step.velocity_mps[0], step.velocity_mps[1]);
const wantedSpeed_mps = (step) => Math.hypot(step.setpoint_mps[0], step.setpoint_mps[1]);

/** Half axes and direction of the ellipse of one standard deviation. */
function ellipse([xx, xy, yy]) {
  const middle = (xx + yy) / 2;
  const off = Math.hypot((xx - yy) / 2, xy);
  return {
    major_m: Math.sqrt(Math.max(middle + off, 0)),
    minor_m: Math.sqrt(Math.max(middle - off, 0)),
    angle_rad: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}

/** The bodies that are followed at a time, carried on from the record before. */
function tracksAt(time_s) {
  const record = latest(flight.tracks, time_s);
  const on_s = record ? time_s - record.time_s : 0;
  return (record ? record.tracks : []).map(({ place_m: [x, y], velocity_mps: [vx, vy], covariance: [place_m2] }) => ({
    place_m: [x + vx * on_s, y + vy * on_s], velocity_mps: [vx, vy], sigma_m: Math.sqrt(Math.max(place_m2, 0)),
  }));
}

/** What is said of a plan. */
const ORIGINS = {
  sampled: "a sampled trajectory",
  straight: "no sample is clear: straight to the target",
  bent: "bent to learn the range",
  initial: "the trajectory of the mean gains",
  brake: "nothing is clear: stay",
};

/** With more plans than this the list of what happened holds none of them. */
const PLANS_LISTED = 300;

/** Changes worth a line in the list of what happened: time, colour, text. */
function events() {
  const list = [];
  const acted_s = {};
  let outcome;
  let stage;
  const happens = (time_s, color, text) => list.push({ time_s, color, text });
  for (const step of flight.steps) {
    if (step.outcome !== outcome) happens(step.time_s, outcomeColor(step.outcome), words(step.outcome));
    if (step.guard === "braked" || step.guard === "looking") {
      // It comes and goes from step to step: a pause of less than a second is none.
      if (!(step.time_s - acted_s[step.guard] < 1)) happens(step.time_s, guardColor(step.guard), `guard: ${step.guard}, ${step.guard_reason}`);
      acted_s[step.guard] = step.time_s;
    }
    if (step.evasion_mps) {
      if (!(step.time_s - acted_s.evades < 1)) happens(step.time_s, "orange", "gives way to what moves");
      acted_s.evades = step.time_s;
    }
    if (step.landing && step.landing.stage !== stage) {
      const why = step.landing.reason ? `, ${words(step.landing.reason)}` : "";
      happens(step.time_s, stageColor(step), `landing: ${words(step.landing.stage)}${why}`);
      ({ stage } = step.landing);
    }
    ({ outcome } = step);
  }
  if (flight.plans.length > PLANS_LISTED) happens(0, "orange", `${flight.plans.length} plans are not in this list; the keys , and . lead to them`);
  else for (const plan of flight.plans) happens(plan.time_s, "orange", planned(plan));
  if (flight.end) happens(duration_s(), flight.end.report.result === "reached" ? "green" : "red", verdict());
  return list.sort((a, b) => a.time_s - b.time_s);
}

/** How the flight ended, in words. */
function verdict() {
  const { result, reason } = flight.end.report;
  return result === "reached" ? result : `${result}: ${words(reason)}`;
}

function planned(plan) {
  const of = plan.thinned ? "" : ` of ${plan.samples.length}`;
  const what = plan.chosen === undefined ? ORIGINS[plan.origin] : `sample ${plan.chosen + 1}${of}`;
  return `plan ${plan.id}: ${plan.searches ? "search, " : ""}${what}`;
}

const words = (name) => name.replaceAll("_", " ");

/** Names of the colours in the style sheet. */
function outcomeColor(outcome) {
  const colors = {
    nominal: "green", no_signal: "purple", ambiguous: "purple", uncalibrated: "purple", stale_ownship: "yellow",
    stale_obstacles: "yellow", no_path: "red", goal_unreachable: "red", plan_late: "orange", guard_brake: "orange",
    link_lost: "faint", not_in_control: "quiet", fault: "red", handed_over: "sky", landed: "sky",
  };
  return colors[outcome] ?? "faint";
}

function guardColor(guard) {
  return { passed: "quiet", limited: "sky", looking: "yellow", braked: "red" }[guard] ?? "faint";
}
