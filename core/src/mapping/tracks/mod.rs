//! Tracks of moving objects: objects of one size, followed from scan to scan, each by a Kalman filter of constant velocity.
//!
//! The hits of a scan are cut into clusters where neighbours are apart. What is long, or straight and not short, is a wall and
//! has no part in this. Of the others, the nearest if there are too many, the centre is found (`cluster`). Each is compared with
//! the two tracks nearest to it, and the nearest pairs belong together; a cluster without a track begins one.
//!
//! A track moves when its speed is above what its filter doubts, and when hits of it lay where a scan of
//! some tenths of a second ago had seen through: along a wall the view slides, and its pieces seem to, but nothing of
//! it comes to lie where nothing was. What is too slow for that moves once it has gone some way from where it was first
//! seen, and the sensor sees through there; of such it must be seen that nothing nearer hides an end, as of a piece of a wall. What comes
//! slowly straight towards the sensor hides where it was, and is not known to move.
//!
//! The hits of moving objects go into the map as all others do: a pillar that is mistaken for a person is still avoided.
//! What a moving object leaves behind is taken out of the map ([`Tracks::left_by`]).
//!
//! A track is forgotten when the sensor sees through where it should be, or when it was not seen for a while.
//!
//! All this is for ranges with errors of up to 2.5 cm. What the sensor's are is measured (`noise`), and where they are larger, so is
//! what must be exceeded: pieces of a wall would come and go.

use heapless::Vec;
use heapless::binary_heap::{BinaryHeap, Min};

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::base::units::{between, nearest, wrap_pi};
use crate::mapping::scan::{Doubts, RAYS_MAX, Ranges, Scan};

mod cluster;
mod noise;
use cluster::Cluster;
use noise::Noise;

/// Most objects that are followed: what the variables of the board have space for.
pub const TRACKS_MAX: usize = 27;
const _: () = assert!(TRACKS_MAX <= 32, "a bit of a u32 for each");
/// Most clusters of one scan.
const CLUSTERS_MAX: usize = 32;
/// Pairs of a cluster and a track near it, two for each cluster.
const PAIRS_MAX: usize = 2 * CLUSTERS_MAX;
/// Scans that are kept, and how far apart they are at least.
const KEPT: usize = 3;
const KEPT_APART_S: f32 = 0.14;
/// Most sectors of a scan that is kept.
const KEPT_SECTORS: usize = 120;
/// A place that a scan at least this old has seen through was free.
const BEFORE_S: f32 = 0.25;
/// The same for wide sectors.
const BEFORE_WIDE_S: f32 = 0.28;
/// A hit nearer by this than the earlier range lies where it was free, with little noise.
const THROUGH_M: f32 = 0.12;
/// Share of a cluster's hits that must lie where it was free.
const THROUGH_SHARE: f32 = 0.3;
/// What is so far from where it was first seen has moved, unless its centre has jumped: slow things take so many scans to get there.
const LEFT_BEHIND_M: f32 = 0.6;
const LEAVING_SCANS_MIN: u8 = 10;
/// For how long either counts.
const MOVED_S: f32 = 1.5;
/// A track that was seen through for this long is forgotten.
const CLEAR_S: f32 = 0.25;
/// A track with fewer scans does not count as moving.
const SCANS_MIN: u8 = 3;
/// Largest distance that an object moves from one scan to the next.
const LEFT_M: f32 = 0.25;
/// Widest gate.
const GATE_MAX_M: f32 = 0.75;
const GATE_M: f32 = 0.25;
const GATE_SIGMAS: f32 = 2.5;
/// Radius that an object is assumed to have.
pub(crate) const RADIUS_M: f32 = 0.3;
/// Acceleration of an object, standard deviation.
const SIGMA_MPS2: f32 = 0.8;
/// What moved and is slow counts as moving for so many scans: it may be turning round.
const SLOW_SCANS: u8 = 10;
/// Speed that a new track may have, standard deviation.
const SIGMA_MPS: f32 = 1.5;
/// Below this speed a track counts as standing.
const MOVING_MIN_MPS: f32 = 0.25;
/// And what has left where it was first seen below this one.
const LEAVING_MIN_MPS: f32 = 0.15;
/// A track's speed must exceed its sigma by this factor to count as moving, unless it has left where it was first seen.
const MOVING_SIGMAS: f32 = 2.5;
/// A position that has wandered looks like a speed of everything, built up in this time.
const WANDERS_S: f32 = 0.3;
/// A scan is not taken for older than this.
const LATE_MAX_S: f32 = 0.3;
/// A track that is out of sight is forgotten after this long.
const MEMORY_S: f32 = 3.0;

/// An object that is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Centre, as of the time of the tracks.
    pub center_ned_m: Horizontal,
    /// Velocity.
    pub velocity_ned_mps: Horizontal,
    /// Covariance of place and place, place and velocity, velocity and velocity, the same along north and east.
    pub covariance: [f32; 3],
    /// Time since it was last seen.
    pub unseen_s: f32,
    /// Time for which the sensor has seen through it.
    clear_s: f32,
    /// Time since it was last seen to have moved.
    moved_s: f32,
    /// Where it was first seen, or some 25 s ago.
    first_ned_m: Horizontal,
    /// Scans of it since then.
    scans: u8,
    /// Scans of it since it was last fast enough.
    slow_scans: u8,
    moves: bool,
}

impl Track {
    /// Whether it moves.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.moves
    }

    fn predict(&mut self, dt_s: f32) {
        let q = SIGMA_MPS2 * SIGMA_MPS2;
        let [pp, pv, vv] = self.covariance;
        let dt2 = dt_s * dt_s;
        self.center_ned_m = self.center_ned_m.plus(self.velocity_ned_mps.times(dt_s));
        self.covariance = [
            pp + 2.0 * dt_s * pv + dt2 * vv + 0.25 * dt2 * dt2 * q,
            pv + dt_s * vv + 0.5 * dt2 * dt_s * q,
            vv + dt2 * q,
        ];
        self.unseen_s += dt_s;
        self.moved_s += dt_s;
    }

    /// Centre some time ago.
    fn center_before(&self, ago_s: f32) -> Horizontal {
        self.center_ned_m.minus(self.velocity_ned_mps.times(ago_s))
    }

    /// The update by a centre as it was some time ago: the measurement matrix is `[1, -ago_s]`. The acceleration within
    /// that time is neglected.
    fn update(&mut self, seen: &Cluster) {
        let [pp, pv, vv] = self.covariance;
        let ago_s = seen.ago_s;
        let (with_p, with_v) = (pp - ago_s * pv, pv - ago_s * vv);
        let of = 1.0 / (with_p - ago_s * with_v + seen.sigma_m * seen.sigma_m);
        let (gain_p, gain_v) = (with_p * of, with_v * of);
        let innovation = seen.center_ned_m.minus(self.center_before(ago_s));
        self.center_ned_m = self.center_ned_m.plus(innovation.times(gain_p));
        self.velocity_ned_mps = self.velocity_ned_mps.plus(innovation.times(gain_v)).clamped(20.0);
        self.covariance = [pp - gain_p * with_p, pv - gain_p * with_v, vv - gain_v * with_v];
        (self.unseen_s, self.clear_s) = (0.0, 0.0);
        self.scans = self.scans.saturating_add(1);
    }

    /// Updates it by a scan of its object. Whatever stands may seem to move at `wanders_mps`.
    fn follow(&mut self, seen: &Cluster, wanders_mps: f32, now: &Kept, noise: f32) {
        self.update(seen);
        if self.scans == u8::MAX {
            // Positions drift, and everything seems to leave where it was first seen.
            (self.first_ned_m, self.scans) = (self.center_ned_m, SCANS_MIN);
        }
        let has_left = seen.is_whole
            && self.scans >= LEAVING_SCANS_MIN
            && self.center_ned_m.minus(self.first_ned_m).norm() > LEFT_BEHIND_M * noise
            && now.saw_through(self.first_ned_m, noise);
        if seen.was_free || has_left {
            self.moved_s = 0.0;
        }
        let doubt_mps = MOVING_SIGMAS * sqrt(self.covariance[2]);
        let least_mps = wanders_mps
            + match has_left {
                true => LEAVING_MIN_MPS,
                false if doubt_mps > MOVING_MIN_MPS => doubt_mps,
                false => MOVING_MIN_MPS,
            };
        let is_fast = self.scans >= SCANS_MIN
            && self.moved_s < MOVED_S
            && self.velocity_ned_mps.norm_squared() > least_mps * least_mps;
        self.slow_scans = if is_fast { 0 } else { self.slow_scans.saturating_add(1) };
        self.moves = self.slow_scans < SLOW_SCANS;
    }
}

/// An earlier scan, of which the range in a direction is asked.
#[derive(Clone, Debug, Default)]
struct Kept {
    time: Instant,
    pose: Pose,
    first_azimuth_rad: f32,
    step_rad: f32,
    range_max_m: f32,
    turn: u8,
    /// How far the vehicle went from a sector to the next, and the sector in the middle of the turn.
    way_m: Horizontal,
    middle: f32,
    ranges: Ranges<KEPT_SECTORS>,
}

impl Kept {
    fn take(&mut self, scan: &Scan, pose: &Pose, velocity_ned_mps: Horizontal) {
        self.time = scan.time;
        self.pose = *pose;
        let sectors = scan.in_sectors(KEPT_SECTORS);
        (self.first_azimuth_rad, self.step_rad) = (sectors.first_azimuth_rad, sectors.step_rad);
        self.range_max_m = scan.range_max_m;
        self.turn = sectors.turn().unwrap_or(0) as u8;
        let count = sectors.count().max(1) as f32;
        (self.way_m, self.middle) = (velocity_ned_mps.times(scan.turn_s / count), 0.5 * (count - 1.0));
        self.ranges.take(scan);
    }

    /// Whether it saw through where a hit is now, with noise that is so many times as large as usual.
    fn saw_through(&self, place: Horizontal, noise: f32) -> bool {
        self.sees_beyond(place, THROUGH_M * noise)
    }

    /// Whether it sees farther by more than that in the direction of a place; not where that is not known.
    #[inline(never)]
    fn sees_beyond(&self, place: Horizontal, by_m: f32) -> bool {
        let away = place.minus(self.pose.position_ned_m);
        let azimuth_rad = wrap_pi(away.bearing_rad() - self.pose.yaw_rad - self.first_azimuth_rad);
        let index = nearest(azimuth_rad / self.step_rad);
        let whole = nearest(core::f32::consts::TAU / libm::fabsf(self.step_rad));
        let index = if index < 0 { index + whole } else { index };
        let far_m = away.minus(self.way_m.times(index as f32 - self.middle)).norm();
        // What lies near the edge of a sector may have been seen in the next one.
        [index, index - 1, index + 1].into_iter().all(|index| self.sees_m(index) - far_m > by_m)
    }

    /// The range in a sector, counted on over the ends of a whole turn; -1 where that is not known.
    #[inline(never)]
    fn sees_m(&self, index: i32) -> f32 {
        let index = if self.turn > 0 { index.wrapping_rem_euclid(i32::from(self.turn)) } else { index };
        usize::try_from(index).map_or(-1.0, |index| self.ranges.sees_m(index, self.range_max_m))
    }
}

/// All tracks, and some earlier scans.
///
/// ```
/// use foxhound_core::base::ned::Horizontal;
/// use foxhound_core::base::pose::Pose;
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::mapping::scan::{Doubts, Scan, Sector};
/// use foxhound_core::mapping::tracks::Tracks;
///
/// let mut tracks = Tracks::default();
/// // Somebody of 0.3 m, 2.5 m ahead, walks to the east at 1 m/s.
/// for tenths in 0..15 {
///     let time = Instant(100_000 * tenths);
///     let east = 0.1 * tenths as f32 - 0.7;
///     let rays = (0..72).map(|ray| {
///         let azimuth_rad = 0.02 * ray as f32 - 0.71;
///         let (sine, cosine) = (libm::sinf(azimuth_rad), libm::cosf(azimuth_rad));
///         let (along, across) = (2.5 * cosine + east * sine, 2.5 * sine - east * cosine);
///         let inside = 0.09 - across * across;
///         if inside > 0.0 { Sector::Hit(along - libm::sqrtf(inside)) } else { Sector::Clear }
///     });
///     let scan =
///         Scan { time, turn_s: 0.0, first_azimuth_rad: -0.71, step_rad: 0.02, range_max_m: 5.0, rays: rays.collect() };
///     tracks.advance(time);
///     tracks.observe_rays(&scan, &Pose::default(), Horizontal::default(), Doubts::default());
/// }
/// let [track] = tracks.all() else { panic!("{tracks:?}") };
/// assert!(track.moves() && (track.velocity_ned_mps.east - 1.0).abs() < 0.15, "{track:?}");
/// ```
#[derive(Clone, Debug, Default)]
pub struct Tracks {
    tracks: Vec<Track, TRACKS_MAX>,
    time: Option<Instant>,
    /// Time stamp of the last scan that was used.
    scanned: Option<Instant>,
    kept: [Kept; KEPT],
    newest: usize,
    is_kept: bool,
    noise: Noise,
}

impl Tracks {
    /// Clears it in place.
    pub fn clear(&mut self) {
        let Self { tracks, time, scanned, kept: _, newest, is_kept, noise } = self;
        tracks.clear();
        (*time, *scanned, *newest, *is_kept, *noise) = (None, None, 0, false, Noise::default());
    }

    /// All tracks.
    #[must_use]
    pub fn all(&self) -> &[Track] {
        &self.tracks
    }

    /// Whether scans are used.
    #[must_use]
    pub const fn has_scanned(&self) -> bool {
        self.scanned.is_some()
    }

    /// The latest kept scan that is old enough; where rays are lost, and one may be without meaning, the one before it too.
    fn before(&self, now: Instant, loses_rays: bool) -> Option<(&Kept, Option<&Kept>)> {
        if !self.is_kept {
            return None;
        }
        let mut old =
            (0..KEPT).map(|k| (self.newest + KEPT - k) % KEPT).filter_map(|at| self.kept.get(at)).filter(|kept| {
                let age_s = now.seconds_since(kept.time);
                let before_s = if libm::fabsf(kept.step_rad) > cluster::WIDE_RAD { BEFORE_WIDE_S } else { BEFORE_S };
                (before_s..1.0).contains(&age_s) && kept.step_rad != 0.0
            });
        let newest = old.next()?;
        Some((newest, if loses_rays { old.next() } else { None }))
    }

    /// Tracks whose object is not seen although the sensor covers its place.
    fn miss(&mut self, now: &Kept, ago_s: f32, taken: u32) {
        let since_s = self.scanned.map_or(0.0, |scanned| between(now.time.seconds_since(scanned), 0.0, 0.2));
        for (t, track) in self.tracks.iter_mut().enumerate() {
            if taken >> (t % 32) & 1 == 0 && now.sees_beyond(track.center_before(ago_s), 0.0) {
                track.clear_s += since_s;
            }
        }
    }

    fn keep(&mut self, now: &Kept) {
        if self.is_kept {
            let since_s = self.kept.get(self.newest).map_or(1.0, |kept| now.time.seconds_since(kept.time));
            if (0.0..KEPT_APART_S).contains(&since_s) {
                return;
            }
        } else {
            for kept in &mut self.kept {
                kept.step_rad = 0.0;
            }
        }
        self.newest = (self.newest + 1) % KEPT;
        self.is_kept = true;
        if let Some(kept) = self.kept.get_mut(self.newest) {
            kept.clone_from(now);
        }
    }

    /// Predicts all tracks to a time.
    #[inline(never)]
    pub fn advance(&mut self, now: Instant) {
        if self.time.is_some_and(|time| now < time) {
            // The clock was set back: nothing is known about when they were seen.
            self.clear();
        }
        let dt_s = self.time.map_or(0.0, |time| now.seconds_since(time));
        self.time = Some(now);
        if !(0.0..=2.0).contains(&dt_s) {
            self.tracks.clear();
            return;
        }
        if dt_s > 0.0 {
            for track in &mut self.tracks {
                track.predict(dt_s);
            }
        }
        self.tracks.retain(|track| track.unseen_s <= if track.moves { MEMORY_S } else { 1.0 });
    }

    /// Positions of the moving objects that have just been seen, and the radius around each within which nothing else stands,
    /// except what was hit there now.
    #[must_use]
    pub fn left_by(&self) -> (Vec<Horizontal, TRACKS_MAX>, f32) {
        let mut centers_ned_m = Vec::new();
        for track in self.tracks.iter().filter(|track| track.moves && track.unseen_s == 0.0) {
            // Cannot fail: the capacity is that of the tracks.
            let _ = centers_ned_m.push(track.center_ned_m);
        }
        (centers_ned_m, RADIUS_M + LEFT_M)
    }

    /// Takes in a scan of more rays than circles are made from, as [`Self::observe`] does, each ray for itself.
    #[inline(never)]
    pub fn observe_rays(&mut self, scan: &Scan, pose: &Pose, velocity_ned_mps: Horizontal, doubts: Doubts) {
        if !scan.is_plausible() || !pose.is_plausible() {
            return;
        }
        let mut hits: Vec<Horizontal, RAYS_MAX> = Vec::new();
        scan.hits_into(&mut hits, pose.yaw_rad, velocity_ned_mps);
        self.observe(scan, pose, velocity_ned_mps, &hits, doubts);
    }

    /// Takes in a scan, after [`Self::advance`] to its step, and where it hits, from where it was taken and in order; and what is to be
    /// doubted about it.
    #[inline(never)]
    pub fn observe(
        &mut self,
        scan: &Scan,
        pose: &Pose,
        velocity_ned_mps: Horizontal,
        hits: &[Horizontal],
        doubts: Doubts,
    ) {
        let (loses_rays, wanders_mps) = (doubts.loses_rays, doubts.wandered_m() / WANDERS_S);
        let mut clusters: Vec<Cluster, CLUSTERS_MAX> = Vec::new();
        let late_s = self.time.map_or(0.0, |now| between(now.seconds_since(scan.time), 0.0, LATE_MAX_S));
        self.noise.take(scan);
        let (before, noise) = (self.before(scan.time, loses_rays), self.noise.factor());
        cluster::find(&mut clusters, &cluster::View { scan, late_s, pose, hits, before, noise });
        let taken = associate(&self.tracks, &mut clusters);
        let mut now = Kept::default();
        now.take(scan, pose, velocity_ned_mps);
        self.miss(&now, late_s, taken);
        self.scanned = Some(scan.time);
        for seen in &clusters {
            if let Some(track) = seen.track.and_then(|track| self.tracks.get_mut(usize::from(track))) {
                track.follow(seen, wanders_mps, &now, noise);
            }
        }
        for seen in clusters.iter().filter(|seen| seen.track.is_none()) {
            self.begin(seen, pose.position_ned_m);
        }
        self.tracks.retain(|track| track.clear_s < CLEAR_S);
        self.keep(&now);
    }

    /// Begins a track. When the list is full, the farthest object that stands is replaced by a nearer one.
    fn begin(&mut self, seen: &Cluster, from_ned_m: Horizontal) {
        let vv = SIGMA_MPS * SIGMA_MPS;
        let born = Track {
            center_ned_m: seen.center_ned_m,
            velocity_ned_mps: Horizontal::default(),
            covariance: [seen.sigma_m * seen.sigma_m + seen.ago_s * seen.ago_s * vv, seen.ago_s * vv, vv],
            unseen_s: 0.0,
            clear_s: 0.0,
            moved_s: if seen.was_free { 0.0 } else { MOVED_S },
            first_ned_m: seen.center_ned_m,
            scans: 1,
            slow_scans: SLOW_SCANS,
            moves: false,
        };
        let Err(born) = self.tracks.push(born) else { return };
        let far = |track: &Track| track.center_ned_m.minus(from_ned_m).norm_squared();
        let (mut farthest_m2, mut farthest) = (far(&born), None);
        for track in self.tracks.iter_mut().filter(|track| !track.moves) {
            let squared = far(track);
            if squared > farthest_m2 {
                (farthest_m2, farthest) = (squared, Some(track));
            }
        }
        if let Some(farthest) = farthest {
            *farthest = born;
        }
    }
}

/// Assigns clusters to tracks, the nearest pair first; returns the assigned tracks, one bit each.
#[inline(never)]
fn associate(tracks: &[Track], clusters: &mut [Cluster]) -> u32 {
    // The nearest on top: squared distances as bits, which are in the order of the numbers.
    let mut pairs: BinaryHeap<(u32, u8, u8), Min, PAIRS_MAX> = BinaryHeap::new();
    let mut gates: Vec<f32, TRACKS_MAX> = Vec::new();
    for track in tracks {
        let gate_m = GATE_M + GATE_SIGMAS * sqrt(track.covariance[0]);
        let gate_m = if gate_m < GATE_MAX_M { gate_m } else { GATE_MAX_M };
        // There are no more tracks than gates.
        let _ = gates.push(gate_m * gate_m);
    }
    for (c, seen) in clusters.iter().enumerate() {
        // The nearest two tracks within their gates.
        let mut two = [(f32::INFINITY, 0); 2];
        for (t, (track, gate_m2)) in tracks.iter().zip(&gates).enumerate() {
            let off = seen.center_ned_m.minus(track.center_before(seen.ago_s));
            // Most are out of the gate to the north or south already.
            if off.north * off.north >= *gate_m2 {
                continue;
            }
            let squared = off.norm_squared();
            if squared < *gate_m2 && squared < two[1].0 {
                two[1] = (squared, t as u8);
                if squared < two[0].0 {
                    two.swap(0, 1);
                }
            }
        }
        for (squared, t) in two.into_iter().filter(|(squared, _)| squared.is_finite()) {
            // Cannot fail: there are two places for each cluster.
            let _ = pairs.push((squared.to_bits(), c as u8, t));
        }
    }
    let mut taken = 0_u32;
    while let Some((_, c, t)) = pairs.pop() {
        let Some(seen) = clusters.get_mut(usize::from(c)) else { continue };
        let bit = 1 << (t % 32);
        if seen.track.is_none() && taken & bit == 0 {
            (seen.track, taken) = (Some(t), taken | bit);
        }
    }
    taken
}

#[cfg(test)]
mod tests;
