//! What the pilot reads of an outcome, and how severe it is.

use foxhound_core::base::ownship::Stale;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::landing::Reason;

use crate::dialect::MavSeverity;
use crate::failsafe::Cause;

/// Whether we hold because something that we need is missing.
pub(super) fn is_critical(outcome: Outcome) -> bool {
    matches!(outcome, Outcome::Uncalibrated | Outcome::StaleOwnship | Outcome::StaleObstacles | Outcome::Fault)
}

pub(super) fn severity(cause: Cause, outcome: Option<Outcome>, ended: Option<(Reason, bool)>) -> MavSeverity {
    match (cause, outcome) {
        (Cause::None, Some(Outcome::HandedOver)) if matches!(ended, Some((Reason::Arrived, _))) => {
            MavSeverity::MAV_SEVERITY_NOTICE
        }
        (Cause::Unfit, _) | (Cause::None, Some(Outcome::Fault)) => MavSeverity::MAV_SEVERITY_CRITICAL,
        (Cause::NotInMode | Cause::OnGround | Cause::Paused | Cause::SwitchedOff, _)
        | (Cause::None, Some(Outcome::Nominal | Outcome::NotInControl | Outcome::Landed)) => {
            MavSeverity::MAV_SEVERITY_INFO
        }
        _ => MavSeverity::MAV_SEVERITY_WARNING,
    }
}

pub(super) fn text(outcome: Outcome, stale: Option<Stale>, ended: Option<(Reason, bool)>) -> &'static str {
    match outcome {
        Outcome::StaleOwnship if stale == Some(Stale::VelocityContradicts) => "velocity contradicts position, holds",
        Outcome::StaleOwnship if stale == Some(Stale::PositionFrozen) => "position stands still, holds",
        Outcome::Nominal => "seeking",
        Outcome::NoSignal => "no signal",
        Outcome::Ambiguous => "bearing is ambiguous",
        Outcome::Uncalibrated => "array is not calibrated",
        Outcome::StaleOwnship => "position or attitude is stale",
        Outcome::StaleObstacles => "obstacle data is stale",
        Outcome::NoPath => "no safe path",
        Outcome::GoalUnreachable => "goal cannot be reached",
        Outcome::PlanLate => "plan is late",
        Outcome::GuardBrake => "guard brakes",
        Outcome::LinkLost => "autopilot is silent",
        Outcome::NotInControl => "waits for GUIDED or OFFBOARD, armed",
        Outcome::Fault => "internal fault",
        Outcome::HandedOver => handed_over(ended),
        Outcome::Landed => "landed",
    }
}

/// Why it hovers. With what goes before it at most [`super::NOTICE_BYTES`].
fn handed_over(ended: Option<(Reason, bool)>) -> &'static str {
    match ended {
        Some((Reason::Arrived, true)) => "arrived, asks the autopilot to land",
        Some((Reason::Arrived, false)) => "arrived, hovers, take over",
        Some((Reason::NoPad, _)) => "no pad here, hovers, take over",
        Some((Reason::PadLost, _)) => "pad lost, hovers, take over",
        Some((Reason::NoCamera, _)) => "no picture, hovers, take over",
        Some((Reason::NoHeight, _)) => "height unknown, hovers, take over",
        Some((Reason::Ambiguous, _)) => "beacon not located, hovers, take over",
        Some((Reason::SearchLimit, _)) => "beacon not found, hovers, take over",
        Some((Reason::TimeLimit, _)) => "time limit, hovers, take over",
        Some((Reason::Blocked, _)) => "path blocked, hovers, take over",
        Some((Reason::Landed | Reason::NoOwnship, _)) | None => "hovers, take over",
    }
}
