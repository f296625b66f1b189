//! The records that a file holds: all of a short flight; of a long one fewer, and how many of which.
//!
//! A flight is long from [`LONG_S`] on. Then the following is left out, from its beginning on:
//!
//! | record | kept |
//! |---|---|
//! | step | one in [`STEPS`], that in which the guard did the most; the last; every one in which the outcome or the stage of the landing changes, and every one nearer to a pillar than all before |
//! | plan | every one; with its samples, particles, circles and potential one in [`DETAILS_S`] |
//! | obstacle map | one in [`MAPS_S`] |
//! | people, tracks | one in [`MOVING_S`] |
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
        let keeps = match record {
            Record::Step(step) => return self.step(step),
            Record::Plan(plan) => return self.plan(plan),
            Record::End(end) => {
                self.keep_candidate();
                self.candidate = self.last.take().filter(|last| last.time_s > self.kept_s);
                self.keep_candidate();
                let thinned = self.thinned();
                self.records.extend([Record::Thinned(thinned), Record::End(end)]);
                return;
            }
            Record::Begin(_) | Record::Signal(_) | Record::Thinned(_) => true,
            Record::Remembered(ref map) => self.maps.keeps(map.time_s, MAPS_S),
            Record::People(ref people) => self.people.keeps(people.time_s, MOVING_S),
            Record::Tracks(ref tracks) => self.tracks.keeps(tracks.time_s, MOVING_S),
            Record::Picture(ref picture) => {
                let lands = self.last.as_ref().is_some_and(|step| step.landing.is_some());
                self.pictures.keeps(picture.time_s, if lands { 0.0 } else { PICTURES_S })
            }
        };
        if keeps {
            self.records.push(record);
        }
    }

    fn step(&mut self, step: Step) {
        self.steps.all += 1;
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
            plan.particles = Vec::new();
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
