//! The vehicle's poses of the last half second, for the time when a frame was exposed or a bearing measured.

use crate::base::ned::{Horizontal, Ned};
use crate::base::ownship::Ownship;
use crate::base::time::Instant;
use crate::base::units::{sin_cos, wrap_pi};

/// Number of stored poses.
const KEPT: usize = 22;
/// Least time between two of them.
const APART_US: u64 = 18_000;
/// The oldest and newest may be used for times that are older or newer by this much.
const BEYOND_US: u64 = 60_000;
/// A position is extrapolated by the velocity for at most this long.
const CARRIED_S: f32 = 0.2;
/// A position this far from where the velocity leads is a jump of the frame, not a motion.
const JUMP_M: f32 = 0.7;
/// After a longer gap between two positions nothing is a jump.
const GAP_S: f32 = 1.0;

/// Position and attitude at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FullPose {
    /// Local NED.
    pub place_ned_m: Ned,
    /// Right side down positive.
    pub roll_rad: f32,
    /// Nose up positive.
    pub pitch_rad: f32,
    /// From north, clockwise.
    pub yaw_rad: f32,
}

/// The axes of the body in the NED frame.
#[derive(Clone, Copy, Debug)]
pub struct Axes {
    /// Forward.
    pub forward: Ned,
    /// To the right.
    pub right: Ned,
    /// Down.
    pub down: Ned,
}

impl FullPose {
    /// The vehicle's pose at an instant, extrapolated by its velocity and its yaw rate.
    #[must_use]
    pub fn carried(ownship: &Ownship, at: Instant) -> Self {
        let ahead_s = at.seconds_since(ownship.position_time) - ownship.position_time.seconds_since(at);
        let ahead_s = ahead_s.clamp(-CARRIED_S, CARRIED_S);
        let (place, velocity) = (ownship.position_ned_m, ownship.velocity_ned_mps);
        let place_ned_m = Ned {
            north: place.north + velocity.north * ahead_s,
            east: place.east + velocity.east * ahead_s,
            down: place.down + velocity.down * ahead_s,
        };
        Self { place_ned_m, roll_rad: ownship.roll_rad, pitch_rad: ownship.pitch_rad, yaw_rad: ownship.yaw_at(at) }
    }

    /// The axes of the body.
    #[must_use]
    pub fn axes(&self) -> Axes {
        let (sr, cr) = sin_cos(self.roll_rad);
        let (sp, cp) = sin_cos(self.pitch_rad);
        let (sy, cy) = sin_cos(self.yaw_rad);
        Axes {
            forward: Ned { north: cp * cy, east: cp * sy, down: -sp },
            right: Ned { north: sr * sp * cy - cr * sy, east: sr * sp * sy + cr * cy, down: sr * cp },
            down: Ned { north: cr * sp * cy + sr * sy, east: cr * sp * sy - sr * cy, down: cr * cp },
        }
    }
}

impl Axes {
    /// A body-frame vector in the NED frame.
    #[must_use]
    pub fn to_ned(&self, [forward, right, down]: [f32; 3]) -> Ned {
        let sum = |a: f32, b: f32, c: f32| forward * a + right * b + down * c;
        Ned {
            north: sum(self.forward.north, self.right.north, self.down.north),
            east: sum(self.forward.east, self.right.east, self.down.east),
            down: sum(self.forward.down, self.right.down, self.down.down),
        }
    }
}

/// A pose and the lower half of its time; the full time follows from that of the newest.
#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    micros: u32,
    pose: FullPose,
}

/// The last poses.
#[derive(Clone, Debug, Default)]
pub struct Poses {
    entries: [Entry; KEPT],
    newest: u8,
    count: u8,
    time: Instant,
    /// The last received position, and its time.
    heard_ned_m: Horizontal,
    heard: Instant,
}

impl Poses {
    /// Stores a received pose; returns how far the position has jumped, if it has.
    pub fn note(&mut self, ownship: &Ownship) -> Option<Horizontal> {
        let place = ownship.position_ned_m.horizontal();
        let since_s = ownship.position_time.seconds_since(self.heard);
        let velocity = ownship.velocity_ned_mps.horizontal();
        // After a longer gap it may have flown there.
        let is_next = self.count > 0 && since_s < GAP_S;
        let expected = self.heard_ned_m.plus(velocity.times(since_s.max(0.0)));
        let jump = place.minus(expected);
        let has_jumped = is_next && jump.norm_squared() > JUMP_M * JUMP_M;
        if ownship.position_time != self.heard || has_jumped {
            (self.heard_ned_m, self.heard) = (place, ownship.position_time);
        }
        let time = ownship.attitude_time;
        // After a clock that went back, or a gap, earlier poses are invalid.
        if has_jumped || time < self.time || time.micros_since(self.time) > 1_000_000 {
            self.count = 0;
        }
        if self.count == 0 || time.micros_since(self.time) >= APART_US {
            // The time is the attitude's.
            let pose = FullPose { yaw_rad: ownship.yaw_rad, ..FullPose::carried(ownship, time) };
            self.newest = (self.newest + 1) % KEPT as u8;
            if let Some(entry) = self.entries.get_mut(usize::from(self.newest)) {
                *entry = Entry { micros: time.0 as u32, pose };
            }
            self.time = time;
            self.count = (self.count + 1).min(KEPT as u8);
        }
        has_jumped.then_some(jump)
    }

    /// The pose at an instant; `None` if that is too long ago, or in the future.
    #[must_use]
    pub fn at(&self, time: Instant) -> Option<FullPose> {
        if self.count == 0 || time.micros_since(self.time) > BEYOND_US {
            return None;
        }
        let ago = self.time.micros_since(time);
        let mut after: Option<(u64, FullPose)> = None;
        for back in 0..self.count {
            let index = (usize::from(self.newest) + KEPT - usize::from(back)) % KEPT;
            let entry = self.entries.get(index)?;
            let its_ago = u64::from((self.time.0 as u32).wrapping_sub(entry.micros));
            if its_ago >= ago {
                let Some((later, pose)) = after else { return Some(entry.pose) };
                let share = (its_ago - ago) as f32 / (its_ago - later).max(1) as f32;
                return Some(between(&entry.pose, &pose, share));
            }
            after = Some((its_ago, entry.pose));
        }
        after.filter(|(oldest, _)| ago - oldest <= BEYOND_US).map(|(_, pose)| pose)
    }
}

/// The pose between two, at this share from the first to the second.
fn between(from: &FullPose, to: &FullPose, share: f32) -> FullPose {
    let mix = |a: f32, b: f32| a + share * (b - a);
    let turn = |a: f32, b: f32| a + share * wrap_pi(b - a);
    FullPose {
        place_ned_m: Ned {
            north: mix(from.place_ned_m.north, to.place_ned_m.north),
            east: mix(from.place_ned_m.east, to.place_ned_m.east),
            down: mix(from.place_ned_m.down, to.place_ned_m.down),
        },
        roll_rad: turn(from.roll_rad, to.roll_rad),
        pitch_rad: turn(from.pitch_rad, to.pitch_rad),
        yaw_rad: turn(from.yaw_rad, to.yaw_rad),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(micros: u64, north: f32, roll_rad: f32) -> Ownship {
        Ownship {
            position_time: Instant(micros),
            attitude_time: Instant(micros),
            position_ned_m: Ned { north, east: 0.0, down: -2.0 },
            velocity_ned_mps: Ned { north: 1.0, ..Ned::default() },
            roll_rad,
            yaw_rad: 3.1,
            ..Ownship::default()
        }
    }

    #[test]
    fn a_pose_of_the_past_lies_between_those_that_were_heard() {
        let mut poses = Poses::default();
        for step in 0..30_u64 {
            assert_eq!(poses.note(&heard(1_000_000 + 20_000 * step, 0.02 * step as f32, 0.01 * step as f32)), None);
        }
        let newest = 1_000_000 + 20_000 * 29;
        let pose = poses.at(Instant(newest - 90_000)).unwrap();
        assert!((pose.place_ned_m.north - 0.49).abs() < 1e-3 && (pose.roll_rad - 0.245).abs() < 1e-3, "{pose:?}");
        assert!(poses.at(Instant(newest - 440_000)).is_some(), "a picture that took 420 ms on its line");
        assert!(poses.at(Instant(newest + 40_000)).is_some(), "the attitude comes late");
        assert!(poses.at(Instant(newest - 560_000)).is_none() && poses.at(Instant(newest + 90_000)).is_none());
    }

    #[test]
    fn a_jump_of_the_position_is_noticed_and_what_was_before_is_forgotten() {
        let mut poses = Poses::default();
        poses.note(&heard(1_000_000, 0.0, 0.0));
        poses.note(&heard(1_020_000, 0.02, 0.0));
        let jump = poses.note(&heard(1_040_000, 5.04, 0.0)).unwrap();
        assert!((jump.north - 5.0).abs() < 1e-3, "{jump:?}");
        assert!(poses.at(Instant(900_000)).is_none());
        assert_eq!(poses.note(&heard(1_060_000, 5.06, 0.0)), None);
    }

    #[test]
    fn after_a_longer_gap_it_may_have_flown_there() {
        for (gap_us, has_jumped) in [(900_000, true), (1_100_000, false), (3_000_000, false)] {
            let mut poses = Poses::default();
            poses.note(&heard(1_000_000, 0.0, 0.0));
            assert_eq!(poses.note(&heard(1_000_000 + gap_us, 5.5, 0.0)).is_some(), has_jumped, "{gap_us}");
        }
    }

    #[test]
    fn the_axes_are_those_of_yaw_then_pitch_then_roll() {
        let pose = FullPose { roll_rad: 0.1, pitch_rad: -0.2, yaw_rad: 1.0, ..FullPose::default() };
        let ownship = Ownship { roll_rad: 0.1, pitch_rad: -0.2, yaw_rad: 1.0, ..Ownship::default() };
        let body = ownship.to_body(0.7, 0.5);
        let ned = pose.axes().to_ned(body);
        let (bearing, level) = (1.7_f32, 0.5_f32.cos());
        assert!((ned.north - bearing.cos() * level).abs() < 1e-5 && (ned.east - bearing.sin() * level).abs() < 1e-5);
        assert!((ned.down - 0.5_f32.sin()).abs() < 1e-5);
    }
}
