//! A delivery of hits, worked off a piece at a time: pillars first, then the chains of what is none.

use heapless::Vec;

use super::chain::{self, Edges};
use super::circle::{self, root};
use super::{
    DETECTIONS_MAX, Detection, FIT_MIN, FITS_MAX, Fitter, Frame, JUMP_MAX_M, Kind, Look, POINTS_MAX, Points, Pose,
    RANGE_MAX_M, Run, SECTORS_MAX, Scan, Sector, Turned, Verdict, around, unit,
};
use crate::frame::Horizontal;
use crate::order::insert;
use crate::units::{between, sin_cos};
use crate::work::Work;

/// Prices, in instructions: of a fit, and for each hit of it; of a link of a chain; of putting a hit in its place.
const FIT: u32 = 900;
const FIT_HIT: u32 = 95;
const LINK: u32 = 450;
const LINK_HIT: u32 = 25;
const SORT: u32 = 80;
const SORT_HIT: u32 = 40;
/// Of seaming sorted points together, and of a run.
const SEAM: u32 = 4_000;
const RUN: u32 = 60;
const RUN_HIT: u32 = 6;

/// It belongs to the same run as the hit after it.
const GOES_ON: u8 = 1;
/// The sensor sees past it, on the side of the hits before it, or of those after it.
const FREE_BEFORE: u8 = 2;
const FREE_BEHIND: u8 = 4;
/// A chain begins with it; it is a chain's last one.
const CHAIN_BEGINS: u8 = 8;
const CHAIN_ENDS: u8 = 16;
/// A run was cut behind it.
const CUT: u8 = 32;

/// What is being done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    #[default]
    Done,
    /// Points are put in the order of azimuth, up to `at`.
    Sorting,
    /// Runs are cut into pillars and chains.
    Pillars,
    /// Chains become links.
    Chains,
}

/// A delivery that is worked off.
#[derive(Clone, Debug, Default)]
pub struct Intake {
    stage: Stage,
    origin_ned_m: Horizontal,
    /// Azimuth step between the hits of a run, signed; 0 where there is none.
    step_rad: f32,
    /// The hits, relative to the sensor; neighbours in order, once sorted.
    points_m: Vec<Horizontal, POINTS_MAX>,
    marks: Vec<u8, POINTS_MAX>,
    /// The hit that is the first of what comes next.
    at: u8,
    /// The run that is being cut, or the chain.
    run: (u8, u8),
    fits_left: u8,
    refused: u16,
}

/// How far a delivery is worked off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// One more circle, local NED.
    Found(Detection),
    /// There is more, and no time for it.
    Paused,
    /// That was all.
    Done,
}

impl Intake {
    /// Whether all of it is worked off.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.stage == Stage::Done
    }

    /// Where it was taken from.
    #[must_use]
    pub fn origin_ned_m(&self) -> Horizontal {
        self.origin_ned_m
    }

    /// Hits refused because they were not finite or absurd; all of them, and at least one, if the delivery was.
    #[must_use]
    pub fn refused(&self) -> u16 {
        self.refused
    }

    /// Whether anything in it may be believed. A look that saw nothing may.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.refused == 0 || !self.points_m.is_empty()
    }

    /// The hits behind a detection, relative to the origin.
    #[must_use]
    pub fn points_of(&self, detection: &Detection) -> &[Horizontal] {
        self.points_m.get(usize::from(detection.from)..usize::from(detection.to)).unwrap_or_default()
    }

    fn begin(&mut self, pose: &Pose, step_rad: f32) {
        self.stage = Stage::Done;
        self.origin_ned_m = pose.position_ned_m;
        self.step_rad = step_rad;
        self.points_m.clear();
        self.marks.clear();
        self.run = (0, 0);
        self.at = 0;
        self.fits_left = FITS_MAX as u8;
        self.refused = 0;
    }

    fn has(&self, at: usize, mark: u8) -> bool {
        self.marks.get(at).is_some_and(|marks| marks & mark != 0)
    }

    fn mark(&mut self, at: usize, mark: u8) {
        if let Some(marks) = self.marks.get_mut(at) {
            *marks |= mark;
        }
    }

    /// One past the last hit of the run or chain that holds a hit.
    fn end_of(&self, from: usize, is_last: impl Fn(u8) -> bool) -> usize {
        let rest = self.marks.get(from..).unwrap_or_default();
        rest.iter().position(|marks| is_last(*marks)).map_or(self.marks.len(), |index| from + index + 1)
    }

    /// A look with nothing in it but where it was taken from and the hits, local NED.
    fn look(&self) -> Look {
        let mut look = Look { origin_ned_m: self.origin_ned_m, refused: self.refused, ..Look::default() };
        look.points_ned_m = self.points_m.iter().map(|point| point.plus(self.origin_ned_m)).collect();
        look
    }
}

impl Fitter {
    /// Begins with a scan taken at `pose`; what was begun before is dropped.
    pub fn begin_scan(&self, intake: &mut Intake, scan: &Scan, pose: &Pose) {
        intake.begin(pose, scan.step_rad);
        if !scan.is_plausible() || !pose.is_plausible() {
            intake.refused = 1 + scan.sectors.iter().filter(|sector| matches!(sector, Sector::Hit(_))).count() as u16;
            return;
        }
        let step_rad = libm::fabsf(scan.step_rad);
        let continues = |before: f32, range_m: f32| {
            let nearer = if range_m < before { range_m } else { before };
            let explained = self.config.gap_m + 3.0 * nearer * step_rad;
            let allowed = if explained < JUMP_MAX_M { explained } else { JUMP_MAX_M };
            before > 0.0 && range_m > 0.0 && libm::fabsf(range_m - before) < allowed
        };
        // Zero where there is no hit.
        let mut ranges_m = [0.0_f32; SECTORS_MAX];
        for (range_m, sector) in ranges_m.iter_mut().zip(&scan.sectors) {
            match *sector {
                Sector::Hit(hit_m) if hit_m > 0.0 && hit_m <= scan.range_max_m => *range_m = hit_m,
                Sector::Hit(_) => intake.refused += 1,
                _ => {}
            }
        }
        // A full turn is walked from a place where nothing continues, so that no run is cut at the seam.
        let turn = scan.turn();
        let count = turn.unwrap_or(SECTORS_MAX).min(SECTORS_MAX);
        let range_at = |index: usize| ranges_m.get(index).copied().unwrap_or_default();
        let before = |index: usize| if index == 0 { count - 1 } else { index - 1 };
        let seam = |index: &usize| !continues(range_at(before(*index)), range_at(*index));
        let begin = if turn.is_some() { (0..count).find(seam).unwrap_or(0) } else { 0 };

        let turned = Turned::new(scan.step_rad);
        let start = Horizontal::from_bearing(pose.yaw_rad + scan.first_azimuth_rad);
        let mut direction =
            Horizontal::from_bearing(pose.yaw_rad + scan.first_azimuth_rad + scan.step_rad * begin as f32);
        // A silhouette ends there unless something nearer hides it or nothing is known.
        let is_free = |index: usize, edge_m: f32| match scan.sectors.get(index).copied().unwrap_or_default() {
            Sector::Clear => true,
            Sector::Hit(hit_m) => hit_m > edge_m,
            Sector::Unknown => false,
        };
        let mut index = begin;
        for left in (0..count).rev() {
            let range_m = range_at(index);
            let next = if index + 1 == count { 0 } else { index + 1 };
            if range_m > 0.0 {
                let goes_on = left > 0 && (turn.is_some() || next > 0) && continues(range_m, range_at(next));
                let mut marks = if goes_on { GOES_ON } else { 0 };
                if (turn.is_some() || index > 0) && is_free(before(index), range_m) {
                    marks |= FREE_BEFORE;
                }
                if (turn.is_some() || next > 0) && is_free(next, range_m) {
                    marks |= FREE_BEHIND;
                }
                // Cannot fail: as many places as sectors.
                let _ = intake.points_m.push(direction.times(range_m));
                let _ = intake.marks.push(marks);
            }
            direction = if next == 0 { start } else { turned.on(direction) };
            index = next;
        }
        intake.stage = Stage::Pillars;
    }

    /// Begins with single hits seen from `pose`; what was begun before is dropped.
    pub fn begin_points(&self, intake: &mut Intake, points: &Points, pose: &Pose) {
        intake.begin(pose, 0.0);
        if !pose.is_plausible() {
            intake.refused = 1 + points.points_m.len() as u16;
            return;
        }
        let (sine, cosine) = sin_cos(pose.yaw_rad);
        for point in &points.points_m {
            let point = match points.frame {
                Frame::Body => Horizontal {
                    north: cosine * point.north - sine * point.east,
                    east: sine * point.north + cosine * point.east,
                },
                Frame::VehicleNed => *point,
                Frame::LocalNed => point.minus(pose.position_ned_m),
            };
            let squared = point.norm_squared();
            if squared > 1e-6 && squared <= RANGE_MAX_M * RANGE_MAX_M {
                // Cannot fail: as many places.
                let _ = intake.points_m.push(point);
            } else {
                intake.refused += 1;
            }
        }
        intake.stage = Stage::Sorting;
    }

    /// The next circle behind a delivery, if there is time for it.
    pub fn next(&self, intake: &mut Intake, work: &mut Work) -> Progress {
        loop {
            let found = match intake.stage {
                Stage::Done => return Progress::Done,
                Stage::Sorting => self.sort(intake, work),
                Stage::Pillars => self.next_pillar(intake, work),
                Stage::Chains => self.next_link(intake, work),
            };
            match found {
                Err(Pause) => return Progress::Paused,
                Ok(Some(mut detection)) => {
                    let origin = intake.origin_ned_m;
                    detection.center_ned_m = detection.center_ned_m.plus(origin);
                    detection.face_ned_m = detection.face_ned_m.plus(origin);
                    return Progress::Found(detection);
                }
                Ok(None) => {}
            }
        }
    }

    /// All of what was begun.
    pub(super) fn finish(&self, intake: &mut Intake) -> Look {
        // Sorting moves them.
        let mut detections: Vec<Detection, DETECTIONS_MAX> = Vec::new();
        while let Progress::Found(detection) = self.next(intake, &mut Work::unlimited()) {
            // Cannot fail: no more circles than hits.
            let _ = detections.push(detection);
        }
        Look { detections, ..intake.look() }
    }

    /// Puts one more point in the order of azimuth; the last one decides where runs begin.
    fn sort(&self, intake: &mut Intake, work: &mut Work) -> Result<Option<Detection>, Pause> {
        let sorted = usize::from(intake.at);
        if sorted < intake.points_m.len() {
            pay(work, SORT + SORT_HIT * sorted as u32)?;
            insert(&mut intake.points_m, sorted, |point| around(*point));
            intake.at += 1;
            return Ok(None);
        }
        pay(work, SEAM)?;
        let apart = |a: &Horizontal, b: &Horizontal| {
            let limit = 2.0 * self.config.gap_m;
            a.minus(*b).norm_squared() >= limit * limit
        };
        // Begun where two neighbours are far apart.
        let seam = match (intake.points_m.first(), intake.points_m.last()) {
            (Some(first), Some(last)) if !apart(first, last) => {
                intake.points_m.windows(2).position(|pair| apart(&pair[0], &pair[1])).map_or(0, |index| index + 1)
            }
            _ => 0,
        };
        let count = intake.points_m.len();
        intake.points_m.rotate_left(seam.min(count));
        for index in 0..intake.points_m.len() {
            let goes_on = match intake.points_m.get(index..index + 2) {
                Some([a, b]) => !apart(a, b),
                _ => false,
            };
            let _ = intake.marks.push(if goes_on { GOES_ON } else { 0 });
        }
        (intake.stage, intake.at) = (Stage::Pillars, 0);
        Ok(None)
    }

    /// Cuts runs until there is a pillar; each cut shortens the pieces, so this ends.
    fn next_pillar(&self, intake: &mut Intake, work: &mut Work) -> Result<Option<Detection>, Pause> {
        let from = usize::from(intake.at);
        if from >= intake.points_m.len() {
            (intake.stage, intake.at, intake.run) = (Stage::Chains, 0, (0, 0));
            return Ok(None);
        }
        if from >= usize::from(intake.run.1) {
            let end = intake.end_of(from, |marks| marks & GOES_ON == 0);
            pay(work, RUN + RUN_HIT * (end - from) as u32)?;
            intake.run = (from as u8, end as u8);
        }
        let (first, end) = (usize::from(intake.run.0), usize::from(intake.run.1));
        let to = intake.end_of(from, |marks| marks & CUT != 0).min(end);
        let length = to - from;
        pay(work, FIT + FIT_HIT * length as u32)?;
        let turned = Turned::new(intake.step_rad);
        let edge = |at: usize, mark: u8| intake.points_m.get(at).copied().filter(|_| intake.has(at, mark)).map(unit);
        let free = [
            edge(from, FREE_BEFORE).filter(|_| from == first).map(|direction| turned.back(direction)),
            edge(to - 1, FREE_BEHIND).filter(|_| to == end).map(|direction| turned.on(direction)),
        ];
        let points = intake.points_m.get(from..to).unwrap_or_default();
        let piece = Run { points, first: from, step_rad: libm::fabsf(intake.step_rad), free };
        // What is cut over and over is no pillar.
        let verdict = match intake.fits_left.checked_sub(length as u8) {
            Some(left) if length >= FIT_MIN => {
                intake.fits_left = left;
                self.pillar(&piece)
            }
            Some(_) if length == end - first => self.thin(&piece),
            _ => Verdict::Chain,
        };
        match verdict {
            Verdict::Pillar(pillar) => {
                intake.at = to as u8;
                return Ok(Some(pillar));
            }
            Verdict::Cut(at) => intake.mark(from + at - 1, CUT),
            Verdict::Chain => {
                intake.mark(from, CHAIN_BEGINS);
                intake.mark(to - 1, CHAIN_ENDS);
                intake.at = to as u8;
            }
        }
        Ok(None)
    }

    /// The next link of a chain; between its links `run` is the chain, and `at` the hit that the next one begins with.
    fn next_link(&self, intake: &mut Intake, work: &mut Work) -> Result<Option<Detection>, Pause> {
        let at = usize::from(intake.at);
        if at >= intake.points_m.len() {
            intake.stage = Stage::Done;
            return Ok(None);
        }
        if !(usize::from(intake.run.0)..usize::from(intake.run.1)).contains(&at) {
            // Where no chain begins, a pillar's hit is passed over.
            pay(work, RUN)?;
            intake.at += 1;
            if intake.has(at, CHAIN_BEGINS) {
                let to = intake.end_of(at, |marks| marks & CHAIN_ENDS != 0);
                (intake.run, intake.at) = ((at as u8, to as u8), at as u8);
            }
            return Ok(None);
        }
        let (from, to) = (usize::from(intake.run.0), usize::from(intake.run.1));
        // As far as the next piece, so that nothing is left open between them.
        let is_cut = intake.has(to - 1, GOES_ON);
        let points = intake.points_m.get(from..to + usize::from(is_cut)).unwrap_or_default();
        if !work.has(LINK + LINK_HIT * points.len() as u32) {
            return Err(Pause);
        }
        let is_begun = from > 0 && intake.has(from - 1, GOES_ON);
        let edges = Edges {
            first: !is_begun && intake.has(from, FREE_BEFORE),
            last: !is_cut && intake.has(to - 1, FREE_BEHIND),
        };
        // A sector's hit lies anywhere in its width.
        let half_m =
            points.first().map_or(0.0, |point| 0.5 * libm::fabsf(intake.step_rad) * root(point.norm_squared()));
        let radius_min_m = between(half_m, self.config.radius_min_m, self.config.radius_max_m);
        let Some(link) = chain::next(points, edges, radius_min_m, at - from) else {
            work.spend(RUN);
            intake.at = to as u8;
            intake.run = (0, 0);
            return Ok(None);
        };
        work.spend(LINK + LINK_HIT * (link.to - link.from) as u32);
        let last = from + link.to - 1;
        // A chain of a single hit ends with it; one that reaches the next piece's first hit is at its end there.
        let is_over = last + 1 >= from + points.len();
        intake.at = if is_over { to } else { last } as u8;
        if is_over {
            intake.run = (0, 0);
        }
        Ok(Some(Detection {
            kind: Kind::Patch,
            center_ned_m: link.center,
            radius_m: link.radius_m,
            sigma_m: 0.01,
            face_ned_m: link.face,
            from: (from + link.from) as u8,
            to: (from + link.to) as u8,
        }))
    }

    /// Whether a piece is a pillar, or where to cut it, or neither.
    fn pillar(&self, piece: &Run<'_>) -> Verdict {
        let c = &self.config;
        let points = piece.points;
        let Some(found) = circle::fit(points) else { return Verdict::Chain };
        if found.residual_m > c.residual_max_m {
            return Verdict::Cut(found.worst.clamp(2, points.len() - 2));
        }
        let Some(&middle) = points.get(points.len() / 2) else { return Verdict::Chain };
        let is_round = found.center.minus(middle).dot(middle) > 0.0
            && found.radius_m <= c.radius_max_m
            && found.sigma_m <= c.radius_doubt_max * found.radius_m
            && super::is_inside(found.center, found.radius_m, piece.free);
        if !is_round {
            return Verdict::Chain;
        }
        let radius_m = if found.radius_m < c.radius_min_m { c.radius_min_m } else { found.radius_m };
        piece.pillar(found.center, radius_m, found.sigma_m)
    }
}

/// There is no time left.
#[derive(Debug)]
struct Pause;

fn pay(work: &mut Work, price: u32) -> Result<(), Pause> {
    if work.take(price) { Ok(()) } else { Err(Pause) }
}
