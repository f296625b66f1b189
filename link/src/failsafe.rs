//! What may go wrong on the link or on the vehicle, and the reaction: the first of the [`Cause`]s that applies decides.
//!
//! There are two reactions. Where the link and this program can be trusted, a stream of zero velocity makes the vehicle
//! hold. Where they cannot, no setpoint at all is sent, so that the autopilot's own failsafe acts. No cause requests
//! another flight mode. `docs/autopilot.md` has the table: when each cause applies, and what happens to setpoints and
//! heartbeat.

use crate::autopilot::Software;

/// Why guidance may not move the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cause {
    /// It may.
    #[default]
    None,
    /// This computer is not fit to fly.
    Unfit,
    /// There is no autopilot.
    NoAutopilot,
    /// The autopilot has been silent for long.
    LinkLost,
    /// The pilot has not given control.
    NotInMode,
    /// The vehicle stands on the ground or takes off.
    OnGround,
    /// The autopilot is silent.
    LinkQuiet,
    /// A stored record is damaged.
    StoreDamaged,
    /// The mode has to be left and entered again.
    EntryNeeded,
    /// The pilot's switch is off.
    SwitchedOff,
    /// A station or another component has requested a pause.
    Paused,
    /// The battery is nearly empty.
    BatteryCritical,
    /// The battery is low, and no search has begun.
    BatteryLow,
    /// The vehicle is outside of the autopilot's fence.
    FenceBreached,
    /// Too many frames are damaged.
    LinkNoisy,
    /// The vehicle's position is not known.
    OwnshipLost,
}

/// What happens to the stream of setpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    /// Setpoints of guidance.
    Guidance,
    /// Zero velocity.
    Zero,
    /// No setpoints.
    Silent,
}

/// The conditions that decide the cause.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Input {
    pub(crate) unfit: bool,
    pub(crate) has_autopilot: bool,
    pub(crate) is_lost: bool,
    pub(crate) is_quiet: bool,
    pub(crate) obeys: bool,
    pub(crate) on_ground: bool,
    pub(crate) store_damaged: bool,
    pub(crate) entry_needed: bool,
    pub(crate) switched_off: bool,
    pub(crate) paused: bool,
    pub(crate) battery_critical: bool,
    pub(crate) battery_low: bool,
    pub(crate) seeking: bool,
    pub(crate) fence_breached: bool,
    pub(crate) is_noisy: bool,
    pub(crate) ownship_lost: bool,
}

impl Input {
    /// The first cause that applies.
    pub(crate) fn cause(&self) -> Cause {
        static CAUSES: [Cause; 15] = [
            Cause::Unfit,
            Cause::NoAutopilot,
            Cause::LinkLost,
            Cause::NotInMode,
            Cause::OnGround,
            Cause::LinkQuiet,
            Cause::StoreDamaged,
            Cause::EntryNeeded,
            Cause::SwitchedOff,
            Cause::Paused,
            Cause::BatteryCritical,
            Cause::BatteryLow,
            Cause::FenceBreached,
            Cause::LinkNoisy,
            Cause::OwnshipLost,
        ];
        let applies = [
            self.unfit,
            !self.has_autopilot,
            self.is_lost,
            !self.obeys,
            self.on_ground,
            self.is_quiet,
            self.store_damaged,
            self.entry_needed,
            self.switched_off,
            self.paused,
            self.battery_critical,
            self.battery_low && !self.seeking,
            self.fence_breached,
            self.is_noisy,
            self.ownship_lost,
        ];
        applies.iter().zip(&CAUSES).find(|(applies, _)| **applies).map_or(Cause::None, |(_, cause)| *cause)
    }
}

impl Cause {
    /// What happens to the stream; `prestream` says whether PX4 gets zero velocity outside of OFFBOARD.
    pub(crate) fn stream(self, software: Software, prestream: bool) -> Stream {
        let waits = match software {
            Software::Px4 if prestream => Stream::Zero,
            _ => Stream::Silent,
        };
        match self {
            Self::None => Stream::Guidance,
            Self::Unfit | Self::NoAutopilot | Self::LinkLost | Self::OwnshipLost => Stream::Silent,
            Self::NotInMode | Self::OnGround => waits,
            _ => Stream::Zero,
        }
    }

    /// Whether the vehicle is kept from seeking by a fault, not by its pilot.
    pub(crate) fn is_critical(self) -> bool {
        matches!(
            self,
            Self::StoreDamaged
                | Self::BatteryCritical
                | Self::BatteryLow
                | Self::FenceBreached
                | Self::LinkNoisy
                | Self::OwnshipLost
        )
    }

    /// The text for the ground station; `None` where guidance's outcome is reported instead.
    #[inline(never)]
    pub(crate) fn text(self) -> Option<&'static str> {
        match self {
            Self::None | Self::NoAutopilot => None,
            Self::Unfit => Some("unfit, no setpoints"),
            Self::LinkLost | Self::LinkQuiet => Some("autopilot is silent"),
            Self::NotInMode => Some("waits for GUIDED or OFFBOARD, armed"),
            Self::OnGround => Some("waits for take-off"),
            Self::StoreDamaged => Some("stored record damaged, does not move"),
            Self::EntryNeeded => Some("leave the mode and enter it again"),
            Self::SwitchedOff => Some("switched off by RC"),
            Self::Paused => Some("paused"),
            Self::BatteryCritical => Some("battery critical, holds"),
            Self::BatteryLow => Some("battery low, does not start"),
            Self::FenceBreached => Some("fence breached, holds"),
            Self::LinkNoisy => Some("link is noisy, holds"),
            Self::OwnshipLost => Some("position lost, no setpoints"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_row_that_applies_decides() {
        let fine = Input { has_autopilot: true, obeys: true, ..Input::default() };
        assert_eq!(fine.cause(), Cause::None);
        let all = Input {
            unfit: true,
            is_lost: true,
            is_quiet: true,
            on_ground: true,
            store_damaged: true,
            entry_needed: true,
            switched_off: true,
            paused: true,
            battery_critical: true,
            battery_low: true,
            fence_breached: true,
            is_noisy: true,
            ownship_lost: true,
            ..Input::default()
        };
        type Lift = fn(&mut Input);
        let lift: [(Lift, Cause); 15] = [
            (|_| {}, Cause::Unfit),
            (|input| input.unfit = false, Cause::NoAutopilot),
            (|input| input.has_autopilot = true, Cause::LinkLost),
            (|input| input.is_lost = false, Cause::NotInMode),
            (|input| input.obeys = true, Cause::OnGround),
            (|input| input.on_ground = false, Cause::LinkQuiet),
            (|input| input.is_quiet = false, Cause::StoreDamaged),
            (|input| input.store_damaged = false, Cause::EntryNeeded),
            (|input| input.entry_needed = false, Cause::SwitchedOff),
            (|input| input.switched_off = false, Cause::Paused),
            (|input| input.paused = false, Cause::BatteryCritical),
            (|input| input.battery_critical = false, Cause::BatteryLow),
            (|input| input.seeking = true, Cause::FenceBreached),
            (|input| input.fence_breached = false, Cause::LinkNoisy),
            (|input| input.is_noisy = false, Cause::OwnshipLost),
        ];
        let mut input = all;
        for (lift, cause) in lift {
            lift(&mut input);
            assert_eq!(input.cause(), cause);
        }
        input.ownship_lost = false;
        assert_eq!(input.cause(), Cause::None);
    }
}
