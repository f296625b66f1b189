//! A lidar on a serial line of its own: the LDROBOT LD06, LD19 and STL-19P, which send the same frames, at 230400
//! baud, and need no commands.
//!
//! A frame has 47 bytes: `0x54`, `0x2C` (12 points), speed (`u16`, deg/s), angle of the first point (`u16`, 0.01 deg), 12 points
//! (distance `u16`, mm; confidence `u8`), angle of the last point, time (`u16`, ms), CRC-8 of all before it (polynomial 0x4D).
//! Numbers are little-endian. 4500 points a second are 375 frames; a turn takes 0.1 s. After LDROBOT's development manuals of
//! the LD06 and the LD19.
//!
//! The angle grows clockwise, seen from above an upright lidar, from the arrow on its housing. A turn becomes a scan
//! of 360 rays of a degree, with the nearest point in each. A degree without a
//! point, because a frame was lost or the lidar turns fast, is unknown, and so is a point of low confidence, or one
//! nearer than [`Config::range_min_m`]. A turn begins astern, so that what is ahead is seen
//! at one time, whichever way it is mounted; the time of a scan is its middle. When the line was silent for most of
//! a turn, or the motor stood still, the scan begins anew.
//!
//! A distance of 0 means that nothing was reflected. In the open this is so in most directions, so it counts as free
//! up to [`Config::range_max_m`]. Black or glass objects reflect nothing either: with [`Config::trusts_silence`] off
//! a distance of 0 is unknown.

use core::f32::consts::PI;
use core::ops::RangeInclusive;

use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::guidance;
use foxhound_core::mapping::lidar::Mount;
use foxhound_core::mapping::scan::{RAYS_MAX, Rays, Scan, Sector};

/// Bytes of a frame.
pub const FRAME_BYTES: usize = 47;
/// Points of a frame.
pub const POINTS: usize = 12;
const BEGIN: [u8; 2] = [0x54, 0x2C];
const TURN_CDEG: u32 = 36_000;
/// Between the first and the last point of a frame: 12.5 deg at 13 Hz.
const SPAN_MAX_CDEG: u32 = 2_000;
const RAYS: u16 = RAYS_MAX as u16;
/// From four turns a second to fifteen: it is made for ten. What turns slower or faster gives no scan.
const SPEEDS_DEGPS: RangeInclusive<u16> = 1_440..=5_400;
/// A frame that comes later than this after the one before may be of another turn: a turn takes 77 ms at least.
const GAP_MAX_US: u64 = 70_000;
/// A turn that takes longer than this is no scan: a motor that stood still leaves old readings in it.
const TURN_MAX_US: u64 = 250_000;
/// Its range for bright surfaces.
const REACH_M: f32 = 12.0;

/// Mounting and limits of the lidar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// How it is mounted; upside down its angle grows counter-clockwise.
    pub mount: Mount,
    /// A nearer point is the vehicle itself.
    pub range_min_m: f32,
    /// A farther point is ignored.
    pub range_max_m: f32,
    /// A point of less confidence is unknown.
    pub confidence_min: u8,
    /// Whether a direction without a reflection counts as free.
    pub trusts_silence: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self { mount: Mount::default(), range_min_m: 0.1, range_max_m: 8.0, confidence_min: 15, trusts_silence: true }
    }
}

impl Config {
    /// From guidance's configuration, if it takes obstacles from a lidar; the range is that of guidance.
    #[must_use]
    pub fn of(config: &guidance::Config) -> Option<Self> {
        let range_max_m = config.sensor.range_m.min(REACH_M);
        config.lidar.map(|mount| Self { mount, range_max_m, ..Self::default() })
    }

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Lidar, ConfigError> {
        self.mount.check()?;
        check("lidar.range_min_m", self.range_min_m, 0.0, 1.0)?;
        check("lidar.range_max_m", self.range_max_m, 0.1, REACH_M)?;
        let sense = if self.mount.is_upside_down { -1.0 } else { 1.0 };
        let mut rays = Rays::new();
        rays.resize(RAYS_MAX);
        let scan = Scan {
            time: Instant(0),
            turn_s: 0.0,
            first_azimuth_rad: sense * (PI / 360.0 - PI),
            step_rad: sense * (PI / 180.0),
            range_max_m: self.range_max_m,
            rays: rays.clone(),
        };
        let counters = Counters::default();
        Ok(Lidar {
            config: *self,
            bytes: [0; FRAME_BYTES],
            filled: 0,
            scan,
            rays,
            last: None,
            heard: None,
            began: None,
            astern_cdeg: libm::roundf(100.0 * wrap_pi(PI - sense * self.mount.yaw_rad).to_degrees() + 36_000.0) as u32
                % TURN_CDEG,
            ended: None,
            speed_degps: 0,
            is_new: false,
            counters,
        })
    }
}

/// The lidar for guidance's configuration, if it takes obstacles from one.
///
/// # Errors
/// The field that is out of range.
pub fn build(config: &guidance::Config) -> Result<Option<Lidar>, ConfigError> {
    Config::of(config).map(|config| config.build()).transpose()
}

/// Counts since it was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Valid frames.
    pub frames: u32,
    /// Frames with a wrong checksum or impossible content.
    pub bad: u32,
    /// Turns.
    pub turns: u32,
}

/// Reads its bytes.
#[derive(Clone, Debug)]
pub struct Lidar {
    config: Config,
    bytes: [u8; FRAME_BYTES],
    filled: usize,
    /// The last whole turn, and the rays of this one.
    scan: Scan,
    rays: Rays,
    /// The last ray received, and when the last frame was.
    last: Option<u16>,
    heard: Option<Instant>,
    /// When this turn began; `None` before the first whole one.
    began: Option<Instant>,
    /// Its angle astern, where a turn begins.
    astern_cdeg: u32,
    /// When the last turn was seen to have ended.
    ended: Option<Instant>,
    /// How fast it turns.
    speed_degps: u16,
    is_new: bool,
    counters: Counters,
}

impl Lidar {
    /// Takes bytes, in pieces of any size, that have arrived by now.
    pub fn push(&mut self, now: Instant, bytes: &[u8]) {
        let turns = self.counters.turns;
        for byte in bytes {
            if let Some(slot) = self.bytes.get_mut(self.filled) {
                *slot = *byte;
                self.filled += 1;
            }
            while (1..=BEGIN.len()).contains(&self.filled) && !self.may_begin() {
                self.skip();
            }
            if self.filled == FRAME_BYTES {
                if self.is_right() && self.read(now) {
                    self.counters.frames = self.counters.frames.saturating_add(1);
                    self.filled = 0;
                } else {
                    self.counters.bad = self.counters.bad.saturating_add(1);
                    self.skip();
                    while self.filled > 0 && !self.may_begin() {
                        self.skip();
                    }
                }
            }
        }
        if self.counters.turns != turns {
            self.ended = Some(now);
        }
        // What arrived by one time may come in two pieces: a ring has an end.
        if self.ended == Some(now) {
            self.date(now);
        }
    }

    /// Times the turn that ended among the bytes that have arrived by now: its sensor has gone on by an angle since, at a speed
    /// that it tells. The bytes may have waited for a step.
    fn date(&mut self, now: Instant) {
        let turn_us = 360_000_000 / u64::from(self.speed_degps.clamp(*SPEEDS_DEGPS.start(), *SPEEDS_DEGPS.end()));
        let since_us = turn_us * u64::from(self.last.unwrap_or_default()) / u64::from(RAYS);
        self.scan.turn_s = turn_us as f32 * 1e-6;
        self.scan.time = Instant(now.0.saturating_sub(since_us + turn_us / 2));
    }

    /// The turn that has not been taken, if one is complete.
    #[must_use]
    pub fn scan(&self) -> Option<&Scan> {
        self.is_new.then_some(&self.scan)
    }

    /// The scan has been taken.
    pub fn take(&mut self) {
        self.is_new = false;
    }

    /// Counts since it was built.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    fn may_begin(&self) -> bool {
        self.bytes.iter().zip(BEGIN).take(self.filled).all(|(byte, begin)| *byte == begin)
    }

    /// Drops the first byte, and those after it that do not begin a frame.
    fn skip(&mut self) {
        let rest = self.bytes.get(1..self.filled).unwrap_or_default();
        let next = rest.iter().position(|byte| *byte == BEGIN[0]).map_or(self.filled, |index| index + 1);
        self.bytes.copy_within(next.min(self.filled)..self.filled, 0);
        self.filled -= next.min(self.filled);
    }

    fn is_right(&self) -> bool {
        let (body, crc) = self.bytes.split_at(FRAME_BYTES - 1);
        crc.first() == Some(&crc8(body))
    }

    fn word(&self, at: usize) -> u16 {
        match self.bytes.get(at..at + 2) {
            Some([low, high]) => u16::from_le_bytes([*low, *high]),
            _ => 0,
        }
    }

    /// Reads a whole frame; false if its content is impossible.
    fn read(&mut self, now: Instant) -> bool {
        let (first_cdeg, last_cdeg) = (u32::from(self.word(4)), u32::from(self.word(FRAME_BYTES - 5)));
        let speed_degps = self.word(2);
        if first_cdeg >= TURN_CDEG || last_cdeg >= TURN_CDEG {
            return false;
        }
        let span_cdeg = (last_cdeg + TURN_CDEG - first_cdeg) % TURN_CDEG;
        if span_cdeg > SPAN_MAX_CDEG {
            return false;
        }
        if self.heard.replace(now).is_some_and(|heard| now.micros_since(heard) > GAP_MAX_US) {
            (self.last, self.began, self.is_new) = (None, None, false);
            self.rays.resize(0);
            self.rays.resize(RAYS_MAX);
        }
        self.speed_degps = speed_degps;
        let from_cdeg = first_cdeg + TURN_CDEG - self.astern_cdeg;
        for point in 0..POINTS {
            let at = 6 + 3 * point;
            let along_cdeg = span_cdeg * point as u32 / (POINTS as u32 - 1);
            let ray = ((from_cdeg + along_cdeg) / 100 % u32::from(RAYS)) as u16;
            let confidence = self.bytes.get(at + 2).copied().unwrap_or(0);
            let seen = self.seen(self.word(at), confidence);
            self.note(now, ray, seen);
        }
        true
    }

    /// The content of a point.
    fn seen(&self, distance_mm: u16, confidence: u8) -> Sector {
        let range_m = f32::from(distance_mm) / 1000.0;
        if distance_mm == 0 {
            if self.config.trusts_silence { Sector::Clear } else { Sector::Unknown }
        } else if confidence < self.config.confidence_min || range_m < self.config.range_min_m {
            Sector::Unknown
        } else if range_m > self.config.range_max_m {
            Sector::Clear
        } else {
            Sector::Hit(range_m)
        }
    }

    /// A point in a ray: of several in a turn the nearest counts. A hit overrules what is not sure, and that overrules a miss.
    fn note(&mut self, now: Instant, ray: u16, seen: Sector) {
        let at = usize::from(ray);
        let Some(last) = self.last.replace(ray) else { return self.rays.set(at, seen) };
        if last == ray {
            return match (self.rays.get(at), seen) {
                (Sector::Hit(before_m), Sector::Hit(range_m)) if before_m <= range_m => {}
                (Sector::Hit(_), Sector::Clear | Sector::Unknown) | (Sector::Unknown, Sector::Clear) => {}
                _ => self.rays.set(at, seen),
            };
        }
        // A step back of less than half a turn is the jitter of the motor.
        let on = (ray + RAYS - last) % RAYS;
        if on > RAYS / 2 && RAYS - on < 5 {
            self.last = Some(last);
            return;
        }
        for skipped in last + 1..last + on {
            if skipped == RAYS {
                self.end(now);
            }
            self.rays.set(usize::from(skipped % RAYS), Sector::Unknown);
        }
        if at == 0 {
            self.end(now);
        }
        self.rays.set(at, seen);
    }

    /// The turn is whole: its rays are a scan.
    fn end(&mut self, now: Instant) {
        if let Some(began) = self.began.replace(now)
            && now.micros_since(began) <= TURN_MAX_US
            && SPEEDS_DEGPS.contains(&self.speed_degps)
        {
            self.scan.rays.clone_from(&self.rays);
            self.is_new = true;
            self.counters.turns = self.counters.turns.saturating_add(1);
        }
    }
}

/// CRC-8 by the polynomial 0x4D, from 0.
#[must_use]
pub fn crc8(bytes: &[u8]) -> u8 {
    bytes
        .iter()
        .fold(0, |crc, byte| (0..8).fold(crc ^ byte, |crc, _| (crc << 1) ^ if crc & 0x80 == 0 { 0 } else { 0x4D }))
}

#[cfg(test)]
mod tests;
