//! The records that a file holds: all of a short flight; of a long one fewer, and how many of which.
//!
//! A flight is long from [`LONG_S`] on. Then the following is left out, from its beginning on:
//!
//! | record | kept |
//! |---|---|
//! | step | one in [`STEPS`], that in which the guard did the most; the last; every one in which the outcome or the stage of the landing changes, and every one nearer to a pillar than all before |
//! | plan | every one; with its samples, places, circles and potential one in [`DETAILS_S`] |
//! | obstacle map | one in [`MAPS_S`], the last before a pause always |
//! | people, tracks | one in [`MOVING_S`], the last before a pause always |
//! | picture | one in [`PICTURES_S`]; in the landing, every one |

use super::record::{Plan, Record, Step, Thin, Thinned};

/// From when on a flight is long.
const LONG_S: f64 = 300.0;
const STEPS: u64 = 5;
const DETAILS_S: f64 = 5.0;
const MAPS_S: f64 = 2.0;
const MOVING_S: f64 = 0.5;
const PICTURES_S: f64 = 20.0;

/// Collects the records of a file.
#[derive(Debug, Default)]
pub struct Kept {
    records: Vec<Record>,
    /// Whether the flight is long.
    thins: bool,
    /// The step that stands for those since the last one kept, and how many these are.
    candidate: Option<Step>,
    waiting: u64,
    last: Option<Step>,
    nearest_m: Option<f64>,
    /// Time of the last step that was kept.
    kept_s: f64,
    steps: Rate,
    details: Rate,
    maps: Rate,
    people: Rate,
    tracks: Rate,
    pictures: Rate,
}

/// Counts records, and those that are kept.
#[derive(Debug, Default)]
struct Rate {
    all: u64,
    kept: u64,
    next_s: f64,
    /// The last record that was left out: what it says may hold for long.
    waits: Option<Record>,
}

impl Rate {
    /// Whether a record is kept, of those that come at most every so many seconds.
    fn keeps(&mut self, time_s: f64, every_s: f64) -> bool {
        self.all += 1;
        let keeps = time_s >= self.next_s;
        if keeps {
            self.kept += 1;
            self.next_s = time_s + every_s - 1e-6;
        }
        keeps
    }

    /// A record that holds until the next one of its kind: kept, or the one that waits.
    fn keep_last(&mut self, time_s: f64, every_s: f64, record: Record) -> Option<Record> {
        let keeps = self.keeps(time_s, every_s);
        self.waits = (!keeps).then(|| record.clone());
        keeps.then_some(record)
    }

    /// The record that waits, once it may be kept.
    fn due(&mut self, now_s: f64, every_s: f64) -> Option<Record> {
        let due = self.waits.take_if(|_| now_s >= self.next_s)?;
        self.kept += 1;
        self.next_s = now_s + every_s - 1e-6;
        Some(due)
    }
}

impl Kept {
    /// Takes a record.
    pub fn add(&mut self, record: Record) {
        if let Record::Step(step) = &record
            && !self.thins
            && step.time_s >= LONG_S
        {
            self.thins = true;
            for earlier in std::mem::take(&mut self.records) {
                self.thin(earlier);
            }
        }
        if self.thins { self.thin(record) } else { self.records.push(record) }
    }

    /// The records.
    #[must_use]
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    fn thin(&mut self, record: Record) {
        let kept = match record {
            Record::Step(step) => return self.step(step),
            Record::Plan(plan) => return self.plan(plan),
            Record::End(end) => {
                self.keep_candidate();
                self.candidate = self.last.take().filter(|last| last.time_s > self.kept_s);
                self.keep_candidate();
                self.keep_due(f64::INFINITY);
                let thinned = self.thinned();
                self.records.extend([Record::Thinned(thinned), Record::End(end)]);
                return;
            }
            Record::Begin(_) | Record::Signal(_) | Record::Thinned(_) => Some(record),
            Record::Remembered(ref map) => self.maps.keep_last(map.time_s, MAPS_S, record),
            Record::People(ref people) => self.people.keep_last(people.time_s, MOVING_S, record),
            Record::Tracks(ref tracks) => self.tracks.keep_last(tracks.time_s, MOVING_S, record),
            Record::Picture(ref picture) => {
                let lands = self.last.as_ref().is_some_and(|step| step.landing.is_some());
                let every_s = if lands { 0.0 } else { PICTURES_S };
                self.pictures.keeps(picture.time_s, every_s).then_some(record)
            }
        };
        self.records.extend(kept);
    }

    /// Keeps what waits and is due.
    fn keep_due(&mut self, now_s: f64) {
        let due = [self.maps.due(now_s, MAPS_S), self.people.due(now_s, MOVING_S), self.tracks.due(now_s, MOVING_S)];
        self.records.extend(due.into_iter().flatten());
    }

    fn step(&mut self, step: Step) {
        self.steps.all += 1;
        self.keep_due(step.time_s);
        let stage = |step: &Step| step.landing.map(|landing| landing.stage);
        let changes = self.last.as_ref().is_none_or(|last| last.outcome != step.outcome || stage(last) != stage(&step));
        let is_nearer = step.clearance_m.is_some_and(|metres| self.nearest_m.is_none_or(|least_m| metres < least_m));
        self.last = Some(step.clone());
        if is_nearer {
            self.nearest_m = step.clearance_m;
        }
        let acts = |step: &Step| ["passed", "limited", "looking", "braked"].iter().position(|name| *name == step.guard);
        if changes || is_nearer {
            // Where everything changes at once the one that waits is kept, too.
            self.keep_candidate();
            self.candidate = Some(step);
            self.keep_candidate();
            return;
        }
        self.waiting += 1;
        if self.candidate.as_ref().is_none_or(|candidate| acts(&step) > acts(candidate)) {
            self.candidate = Some(step);
        }
        if self.waiting >= STEPS {
            self.keep_candidate();
        }
    }

    fn keep_candidate(&mut self) {
        self.waiting = 0;
        if let Some(step) = self.candidate.take() {
            self.steps.kept += 1;
            self.kept_s = step.time_s;
            self.records.push(Record::Step(step));
        }
    }

    fn plan(&mut self, mut plan: Box<Plan>) {
        if !self.details.keeps(plan.time_s, DETAILS_S) {
            plan.thinned = true;
            plan.field = None;
            plan.samples = Vec::new();
            plan.circles_m = Vec::new();
            plan.places = Vec::new();
        }
        self.records.push(Record::Plan(plan));
    }

    fn thinned(&self) -> Thinned {
        let what = [
            ("steps", &self.steps),
            ("details of plans", &self.details),
            ("obstacle maps", &self.maps),
            ("places of people", &self.people),
            ("tracks", &self.tracks),
            ("pictures", &self.pictures),
        ];
        let thin = |(what, rate): (&'static str, &Rate)| Thin { what, all: rate.all, kept: rate.kept };
        Thinned { from_s: LONG_S, what: what.into_iter().filter(|(_, rate)| rate.kept < rate.all).map(thin).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::record::Tracks;
    use super::*;

    fn step(time_s: f64, guard: &'static str, clearance_m: f64) -> Record {
        let clearance_m = Some(clearance_m);
        Record::Step(Step { time_s, guard, outcome: "nominal", clearance_m, ..Step::default() })
    }

    /// The records of a flight with a step every 20 ms.
    fn flown(seconds: u32, guard: impl Fn(u32) -> &'static str, clearance_m: impl Fn(u32) -> f64) -> Kept {
        let mut kept = Kept::default();
        for index in 0..seconds * 50 {
            kept.add(step(f64::from(index) * 0.02, guard(index), clearance_m(index)));
        }
        kept
    }

    fn steps(kept: &Kept) -> Vec<&Step> {
        kept.records()
            .iter()
            .filter_map(|record| if let Record::Step(step) = record { Some(step) } else { None })
            .collect()
    }

    #[test]
    fn a_short_flight_is_kept_whole() {
        assert_eq!(steps(&flown(299, |_| "passed", |_| 1.0)).len(), 299 * 50);
    }

    #[test]
    fn of_a_long_flight_no_brake_and_no_nearest_pillar_is_lost() {
        let brakes = [777, 5001, 17_499];
        let guard = |index| if brakes.contains(&index) { "braked" } else { "passed" };
        let kept = flown(400, guard, |index| if index == 12_343 { 0.07 } else { 1.0 });
        let steps = steps(&kept);
        assert!(steps.len() < 400 * 11, "{}", steps.len());
        assert_eq!(steps.iter().filter(|step| step.guard == "braked").count(), brakes.len());
        assert_eq!(steps.iter().filter(|step| step.clearance_m == Some(0.07)).count(), 1);
        assert!(steps.windows(2).all(|pair| pair[0].time_s < pair[1].time_s && pair[1].time_s - pair[0].time_s < 0.2));
    }

    #[test]
    fn what_was_followed_last_is_kept_although_much_came_before_it() {
        let mut kept = flown(301, |_| "passed", |_| 1.0);
        for hundredths in 0..7 {
            let time_s = 302.0 + 0.01 * f64::from(hundredths);
            kept.add(Record::Tracks(Tracks { time_s, tracks: Vec::new() }));
        }
        for time_s in [302.1, 303.0, 304.0] {
            kept.add(step(time_s, "passed", 1.0));
        }
        let times_s = kept.records().iter().filter_map(|record| match record {
            Record::Tracks(tracks) => Some(tracks.time_s),
            _ => None,
        });
        assert_eq!(times_s.collect::<Vec<_>>(), [302.0, 302.06]);
    }
}
