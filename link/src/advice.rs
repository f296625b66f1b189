//! Checks the autopilot's own parameters: one that leaves a gap under our failsafes, or holds the vehicle below our
//! limits, is reported, once each.
//!
//! They are read by `PARAM_REQUEST_READ`, one at a time while we are not in control, three times at most. An autopilot
//! that does not answer, or does not know the name, is left alone. Nothing is ever set. `ArduPilot` sends whole numbers
//! as floats, PX4 puts the bytes of an integer in the place of the float; the message says which form it has.

use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::{self, Id, Values};

use crate::CharArray;
use crate::autopilot::Software;
use crate::dialect::{MavParamType, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA};

const PERIOD_US: u64 = 2_000_000;
const TRIES: u8 = 3;

struct Row {
    name: &'static str,
    hole: Hole,
    text: &'static str,
}

/// Which values leave a gap.
#[derive(Clone, Copy)]
enum Hole {
    Above(f32),
    Below(f32),
    /// Less than our parameter, in the autopilot's unit: so many of its units are one of ours.
    Under(Id, f32),
    Zero,
    WithoutBit(u32),
}

impl Hole {
    fn is(self, value: f32, ours: &Values) -> bool {
        match self {
            Self::Above(limit) => value > limit,
            Self::Below(limit) => value < limit,
            Self::Under(id, units) => value < units * ours.get(id),
            Self::Zero => value == 0.0,
            Self::WithoutBit(bit) => value as u32 & bit == 0,
        }
    }
}

/// `GUID_TIMEOUT` and `COM_OF_LOSS_T`: how long the vehicle flies on when we stop sending. `WPNAV_SPEED`, cm/s, and
/// `MPC_XY_VEL_MAX` bound the velocity that it follows, `WPNAV_ACCEL`, cm/s/s, how soon it stops; its stops were measured
/// with the default of 250. Since ArduCopter 4.7 these are `WP_SPD` and `WP_ACC`, in metres.
const ARDUPILOT: [Row; 6] = [
    Row { name: "GUID_TIMEOUT", hole: Hole::Above(1.5), text: "GUID_TIMEOUT is long, set 1" },
    Row { name: "FS_GCS_ENABLE", hole: Hole::Zero, text: "FS_GCS_ENABLE is off" },
    Row { name: "WPNAV_SPEED", hole: Hole::Under(param::FH_SPD_MAX, 100.0), text: "WPNAV_SPEED is below FH_SPD_MAX" },
    Row { name: "WPNAV_ACCEL", hole: Hole::Below(250.0), text: "stops late: WPNAV_ACCEL, set 250" },
    Row { name: "WP_SPD", hole: Hole::Under(param::FH_SPD_MAX, 1.0), text: "WP_SPD is below FH_SPD_MAX" },
    Row { name: "WP_ACC", hole: Hole::Below(2.5), text: "stops late: WP_ACC, set 2.5" },
];
const PX4: [Row; 3] = [
    Row { name: "COM_OF_LOSS_T", hole: Hole::Above(1.5), text: "COM_OF_LOSS_T is long, set 1" },
    Row { name: "COM_RC_OVERRIDE", hole: Hole::WithoutBit(2), text: "COM_RC_OVERRIDE: no sticks in OFFBOARD" },
    Row {
        name: "MPC_XY_VEL_MAX",
        hole: Hole::Under(param::FH_SPD_MAX, 1.0),
        text: "MPC_XY_VEL_MAX is below FH_SPD_MAX",
    },
];

/// Which parameter was requested, and when.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Advice {
    row: u8,
    tries: u8,
    due: Instant,
}

impl Advice {
    /// Starts with the first one.
    pub(crate) const fn new() -> Self {
        Self { row: 0, tries: 0, due: Instant(0) }
    }

    /// The clock ran backwards.
    pub(crate) fn follow_clock(&mut self, now: Instant) {
        self.due = now;
    }

    /// The request that is due now.
    pub(crate) fn poll(
        &mut self,
        now: Instant,
        software: Software,
        target: (u8, u8),
    ) -> Option<PARAM_REQUEST_READ_DATA> {
        if now < self.due {
            return None;
        }
        if self.tries >= TRIES {
            (self.row, self.tries) = (self.row.saturating_add(1), 0);
        }
        let row = rows(software).get(usize::from(self.row))?;
        self.due = now.plus_micros(PERIOD_US);
        self.tries += 1;
        Some(PARAM_REQUEST_READ_DATA {
            target_system: target.0,
            target_component: target.1,
            param_id: CharArray::from(row.name),
            param_index: -1,
        })
    }

    /// The warning that the autopilot's answer calls for, beside our parameters.
    pub(crate) fn hear(
        &mut self,
        now: Instant,
        software: Software,
        answer: &PARAM_VALUE_DATA,
        ours: &Values,
    ) -> Option<&'static str> {
        let row = rows(software).get(usize::from(self.row))?;
        let name = answer.param_id.split(|byte| *byte == 0).next().unwrap_or_default();
        if name != row.name.as_bytes() {
            return None;
        }
        (self.row, self.tries, self.due) = (self.row + 1, 0, now);
        let is_bytes = software == Software::Px4 && answer.param_type != MavParamType::MAV_PARAM_TYPE_REAL32 as u8;
        let value = if is_bytes { answer.param_value.to_bits() as f32 } else { answer.param_value };
        row.hole.is(value, ours).then_some(row.text)
    }
}

fn rows(software: Software) -> &'static [Row] {
    match software {
        Software::ArduPilot => &ARDUPILOT,
        Software::Px4 => &PX4,
        Software::Other => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::companion::{NOTICE_BYTES, OURS};

    fn answer(name: &str, param_value: f32, param_type: u8) -> PARAM_VALUE_DATA {
        PARAM_VALUE_DATA { param_id: CharArray::from(name), param_value, param_type, ..PARAM_VALUE_DATA::DEFAULT }
    }

    fn asked(advice: &mut Advice, now: Instant, software: Software) -> Option<std::string::String> {
        let request = advice.poll(now, software, (1, 1))?;
        assert_eq!((request.target_system, request.target_component, request.param_index), (1, 1, -1));
        Some(request.param_id.to_str().unwrap().into())
    }

    #[test]
    fn each_parameter_is_asked_for_until_it_is_answered_and_a_hole_is_told() {
        let mut advice = Advice::new();
        let at = |s: u64| Instant(s * 1_000_000);
        assert_eq!(asked(&mut advice, at(0), Software::ArduPilot).as_deref(), Some("GUID_TIMEOUT"));
        assert_eq!(asked(&mut advice, at(1), Software::ArduPilot), None);
        assert_eq!(advice.hear(at(1), Software::ArduPilot, &answer("FENCE_ENABLE", 3.0, 9), &Values::DEFAULT), None);
        let told = advice.hear(at(1), Software::ArduPilot, &answer("GUID_TIMEOUT", 3.0, 9), &Values::DEFAULT);
        assert_eq!(told, Some("GUID_TIMEOUT is long, set 1"));
        for s in [1, 3, 5] {
            assert_eq!(asked(&mut advice, at(s), Software::ArduPilot).as_deref(), Some("FS_GCS_ENABLE"));
        }
        assert_eq!(asked(&mut advice, at(9), Software::ArduPilot).as_deref(), Some("WPNAV_SPEED"), "nobody answers");
        let late = answer("FS_GCS_ENABLE", 0.0, 2);
        assert_eq!(advice.hear(at(9), Software::ArduPilot, &late, &Values::DEFAULT), None, "too late");
    }

    /// The warnings of an autopilot that answers with these values, in the order of the requests.
    fn told(software: Software, answers: &[f32], ours: &Values) -> std::vec::Vec<bool> {
        let mut advice = Advice::new();
        let mut told = std::vec::Vec::new();
        for value in answers {
            let name = asked(&mut advice, Instant(0), software).unwrap();
            told.push(advice.hear(Instant(0), software, &answer(&name, *value, 9), ours).is_some());
        }
        assert_eq!(asked(&mut advice, Instant(0), software), None);
        told
    }

    #[test]
    fn an_autopilot_that_flies_slower_or_stops_later_than_planned_is_told() {
        let mut fast = Values::DEFAULT;
        fast.set(param::FH_SPD_MAX, 3.0).unwrap();
        for (speed_cmps, accel_cmps2, ours, expected) in [
            (1000.0, 250.0, &Values::DEFAULT, [false; 2]),
            (90.0, 250.0, &Values::DEFAULT, [true, false]),
            (250.0, 250.0, &Values::DEFAULT, [false, false]),
            (250.0, 250.0, &fast, [true, false]),
            (1000.0, 100.0, &Values::DEFAULT, [false, true]),
        ] {
            let (speed_mps, accel_mps2) = (speed_cmps / 100.0, accel_cmps2 / 100.0);
            let told = told(Software::ArduPilot, &[1.0, 1.0, speed_cmps, accel_cmps2, speed_mps, accel_mps2], ours);
            assert_eq!([&told[2..4], &told[4..]], [expected; 2], "{speed_cmps} {accel_cmps2}");
        }
        for (speed_mps, ours, expected) in
            [(12.0, &Values::DEFAULT, false), (0.5, &Values::DEFAULT, true), (2.0, &fast, true)]
        {
            assert_eq!(told(Software::Px4, &[1.0, 3.0, speed_mps], ours).last(), Some(&expected));
        }
    }

    #[test]
    fn whole_numbers_of_px4_are_read_by_their_bytes() {
        for (bits, hole) in [(1_u32, true), (3, false), (2, false), (0, true)] {
            let mut advice = Advice::new();
            asked(&mut advice, Instant(0), Software::Px4);
            assert_eq!(
                advice.hear(Instant(0), Software::Px4, &answer("COM_OF_LOSS_T", 1.0, 9), &Values::DEFAULT),
                None
            );
            let told = advice.hear(
                Instant(0),
                Software::Px4,
                &answer("COM_RC_OVERRIDE", f32::from_bits(bits), 6),
                &Values::DEFAULT,
            );
            assert_eq!(told.is_some(), hole, "{bits}");
        }
    }

    #[test]
    fn another_autopilot_is_asked_nothing() {
        assert_eq!(Advice::new().poll(Instant(0), Software::Other, (1, 1)), None);
    }

    #[test]
    fn texts_fit_a_message() {
        let most = NOTICE_BYTES - OURS.len();
        assert!(ARDUPILOT.iter().chain(&PX4).all(|row| row.text.len() <= most && row.name.len() <= 16));
    }
}
