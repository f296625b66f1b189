//! The parameter protocol from a ground station's side: frames in, frames out.

use foxhound_core::base::error::{ConfigError, Why};
use foxhound_core::base::time::Instant;
use foxhound_core::guidance;
use foxhound_core::guidance::param::{self, COUNT, Id, TABLE, Values};
use foxhound_link::CharArray;
use foxhound_link::companion;
use foxhound_link::dialect::*;
use foxhound_link::framer::Header;
use foxhound_link::params::{Params, Reply, Storage};
use rand_core::Rng;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

const US: (u8, u8) = (7, 191);
const STATION: Header = Header { system_id: 255, component_id: 190, sequence: 0 };
const REAL32: u8 = 9;

/// The parameters and the station's clock; a guidance configuration decides about proposals as an application would.
struct Link {
    params: Params,
    now: Instant,
    is_seeking: bool,
}

fn build(values: &Values) -> Result<(), ConfigError> {
    let mut config = guidance::Config::default();
    values.apply(&mut config);
    config.build::<256>().map(|_| ())
}

impl Link {
    fn new() -> Self {
        Self { params: Params::new(Values::DEFAULT), now: Instant(0), is_seeking: false }
    }

    fn hear(&mut self, message: &MavMessage) -> bool {
        self.params.hear(US, STATION, &message.into(), self.is_seeking)
    }

    fn settle(&mut self) {
        while let Some(values) = self.params.proposal(self.is_seeking) {
            self.params.settle(build(&values));
        }
    }

    /// All that is sent within that time, polled every 5 ms.
    fn replies(&mut self, milliseconds: u64) -> Vec<(Instant, Reply)> {
        let mut replies = Vec::new();
        for _ in 0..milliseconds / 5 {
            self.now = self.now.plus_micros(5_000);
            replies.extend(self.params.next(self.now).map(|reply| (self.now, reply)));
        }
        replies
    }

    fn values(&mut self, milliseconds: u64) -> Vec<PARAM_VALUE_DATA> {
        let value = |reply| if let Reply::Value(value) = reply { Some(value) } else { None };
        self.replies(milliseconds).into_iter().filter_map(|(_, reply)| value(reply)).collect()
    }

    /// Sets, lets the application decide, and returns the value that is answered and what is said besides.
    fn set(&mut self, name: &str, value: f32) -> (Option<f32>, String) {
        self.set_as(name, value, REAL32, US.1)
    }

    fn set_as(&mut self, name: &str, value: f32, param_type: u8, component: u8) -> (Option<f32>, String) {
        assert!(self.hear(&set(name, value, param_type, component)));
        self.settle();
        let (mut answered, mut said) = (None, String::new());
        for (_, reply) in self.replies(1_000) {
            match reply {
                Reply::Value(value) => {
                    assert_eq!(value.param_id.to_str(), Ok(name));
                    assert_eq!(usize::from(value.param_index), Id::named(name.as_bytes()).unwrap().index());
                    assert_eq!((usize::from(value.param_count), value.param_type), (COUNT, REAL32));
                    assert_eq!(answered.replace(value.param_value), None, "one answer");
                }
                Reply::Text(text) => said.push_str(text.text.to_str().unwrap()),
                Reply::Ack(ack) => assert_eq!(ack.command, 0, "nobody asked"),
            }
        }
        (answered, said)
    }

    fn store(&mut self, param1: f32, component: u8) -> Vec<u8> {
        assert!(self.hear(&storage(param1, component)));
        let replies = self.replies(200).into_iter();
        let ack = |reply| if let Reply::Ack(ack) = reply { Some(ack) } else { None };
        replies
            .filter_map(|(_, reply)| ack(reply))
            .map(|ack| {
                assert_eq!((ack.command, ack.target_system, ack.target_component), (245, 255, 190));
                ack.result
            })
            .collect()
    }
}

fn list(system: u8, component: u8) -> MavMessage {
    MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA { target_system: system, target_component: component })
}

fn read(index: i16, name: &str) -> MavMessage {
    MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
        target_system: US.0,
        target_component: US.1,
        param_index: index,
        param_id: CharArray::from(name),
    })
}

fn set(name: &str, value: f32, param_type: u8, component: u8) -> MavMessage {
    MavMessage::PARAM_SET(PARAM_SET_DATA {
        target_system: US.0,
        target_component: component,
        param_id: CharArray::from(name),
        param_value: value,
        param_type,
    })
}

fn storage(param1: f32, component: u8) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        target_system: US.0,
        target_component: component,
        command: MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16,
        param1,
        ..COMMAND_LONG_DATA::DEFAULT
    })
}

#[test]
fn a_list_tells_every_parameter_once_in_order_and_twenty_a_second_at_most() {
    let mut link = Link::new();
    link.hear(&list(US.0, US.1));
    let replies = link.replies(10_000);
    assert_eq!(replies.len(), COUNT);
    for (index, (_, reply)) in replies.iter().enumerate() {
        let Reply::Value(value) = reply else { panic!() };
        let row = TABLE[index];
        assert_eq!((value.param_id.to_str(), value.param_value), (Ok(row.name), row.default));
        assert_eq!((usize::from(value.param_index), usize::from(value.param_count)), (index, COUNT));
    }
    for pair in replies.windows(2) {
        assert_eq!(pair[1].0.micros_since(pair[0].0), 50_000);
    }
}

#[test]
fn a_list_that_is_asked_for_again_starts_anew() {
    let mut link = Link::new();
    link.hear(&list(US.0, 0));
    assert_eq!(link.values(500).len(), 10);
    link.hear(&list(US.0, 0));
    let again = link.values(10_000);
    let indices: Vec<_> = again.iter().map(|value| usize::from(value.param_index)).collect();
    assert_eq!(indices, (0..COUNT).collect::<Vec<_>>());
}

#[test]
fn only_what_is_for_our_system_and_for_us_or_for_all_is_heard() {
    for (system, component, is_heard) in [(7, 191, true), (7, 0, true), (7, 1, false), (1, 191, false), (0, 0, false)] {
        let mut link = Link::new();
        assert_eq!(link.hear(&list(system, component)), is_heard);
        assert_eq!(!link.values(100).is_empty(), is_heard);
    }
    let mut link = Link::new();
    assert!(!link.hear(&set("FH_SPD_MAX", 2.0, REAL32, 1)));
    assert!(!link.hear(&storage(1.0, 1)));
    let mut other = COMMAND_LONG_DATA { target_system: 7, target_component: 191, ..COMMAND_LONG_DATA::DEFAULT };
    other.command = MavCmd::MAV_CMD_REQUEST_MESSAGE as u16;
    assert!(!link.hear(&MavMessage::COMMAND_LONG(other)), "that is not about parameters");
    assert!(link.params.proposal(false).is_none() && link.params.take_storage().is_none());
    assert!(link.replies(200).is_empty());
}

#[test]
fn one_is_read_by_its_number_or_its_name_and_what_does_not_exist_is_not_answered() {
    let mut link = Link::new();
    for id in Id::all() {
        link.hear(&read(id.index() as i16, "ignored"));
        link.hear(&read(-1, id.name()));
        let [value] = &link.values(200)[..] else { panic!("two requests that wait are one answer") };
        assert_eq!((value.param_id.to_str(), usize::from(value.param_index)), (Ok(id.name()), id.index()));
    }
    for (index, name) in [(COUNT as i16, ""), (i16::MAX, ""), (-1, "FH_NONE"), (-1, ""), (-1, "_HASH_CHECK"), (-2, "")]
    {
        assert!(link.hear(&read(index, name)));
        assert!(link.replies(200).is_empty(), "{index} {name}");
    }
}

/// A station that loses half of what it is told asks for what is missing, as `QGroundControl` does.
#[test]
fn a_station_on_a_bad_line_gets_all_of_them_by_asking_for_what_is_missing() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut link = Link::new();
    link.hear(&list(US.0, US.1));
    let mut known = [None; COUNT];
    for _round in 0..40 {
        for value in link.values(4_000) {
            if random.next_u32() % 2 == 0 {
                known[usize::from(value.param_index)] = Some(value.param_value);
            }
        }
        for index in (0..COUNT).filter(|index| known[*index].is_none()) {
            if random.next_u32() % 2 == 0 {
                link.hear(&read(index as i16, ""));
            }
        }
    }
    assert_eq!(known.map(Option::unwrap), *Values::DEFAULT.as_array());
}

#[test]
fn a_list_and_single_answers_take_turns_and_neither_waits_for_ever() {
    let mut link = Link::new();
    link.hear(&list(US.0, US.1));
    // Another station reads the same ten again and again, far faster than they can be told.
    let flood: Vec<_> = (0..10).collect();
    let mut told = [0_u32; COUNT];
    for _ in 0..2 * COUNT {
        flood.iter().for_each(|index| assert!(link.hear(&read(*index, ""))));
        for value in link.values(50) {
            told[usize::from(value.param_index)] += 1;
        }
    }
    assert!(told.iter().all(|times| *times > 0), "{told:?}");
    let (least, most) = (told[..10].iter().min().unwrap(), told[..10].iter().max().unwrap());
    assert!(most - least <= 2, "{told:?}");
    assert_eq!(told.iter().sum::<u32>() as usize, 2 * COUNT, "twenty a second all the time");
}

#[test]
fn a_value_that_is_accepted_holds_and_is_answered() {
    let mut link = Link::new();
    assert_eq!(link.set("FH_SPD_MAX", 3.5), (Some(3.5), String::new()));
    assert_eq!(link.params.values().get(param::FH_SPD_MAX), 3.5);
    assert_eq!(link.set_as("FH_OBS_REQ", 0.0, REAL32, 0), (Some(0.0), String::new()));
    assert_eq!(link.set("FH_PRESTREAM", 0.0), (Some(0.0), String::new()));
}

#[test]
fn nothing_holds_before_the_application_has_accepted_it() {
    let mut link = Link::new();
    link.hear(&set("FH_RADIUS", 0.3, REAL32, US.1));
    assert_eq!(link.params.values(), &Values::DEFAULT);
    assert!(link.replies(1_000).is_empty(), "and it is not answered before");
    let proposed = link.params.proposal(false).unwrap();
    assert_eq!(proposed.get(param::FH_RADIUS), 0.3);
    link.params.settle(Ok(()));
    assert_eq!(link.params.values(), &proposed);
    assert_eq!(link.values(200)[0].param_value, 0.3);
    // A verdict about nothing.
    link.params.settle(Ok(()));
    assert_eq!(link.params.values(), &proposed);
}

#[test]
fn sets_in_a_row_are_settled_in_a_row_and_what_there_is_no_room_for_is_not_answered() {
    let mut link = Link::new();
    for id in Id::all().take(10) {
        let (min, max) = id.range();
        link.hear(&set(id.name(), 0.5 * (min + max), REAL32, US.1));
    }
    // The same one twice, there and back: both are answered by what holds in the end.
    link.settle();
    assert_eq!(link.values(2_000).len(), 4);
    link.hear(&set("FH_LAG", 1.0, REAL32, US.1));
    link.hear(&set("FH_LAG", 0.5, REAL32, US.1));
    link.settle();
    assert_eq!(link.params.values().get(param::FH_LAG), 0.5);
    assert_eq!(link.values(200).iter().map(|value| value.param_value).collect::<Vec<_>>(), [0.5]);
}

#[test]
fn every_refusal_is_answered_by_the_old_value_and_told_in_words() {
    let mut link = Link::new();
    let said = |text: &str| text.to_owned();
    for (name, value, text) in [
        ("FH_SPD_MAX", 99.0, "FH_SPD_MAX=99 refused: 0.05 to 20"),
        ("FH_SPD_MAX", 0.0, "FH_SPD_MAX=0 refused: 0.05 to 20"),
        ("FH_SPD_MAX", f32::NAN, "FH_SPD_MAX=nan refused: 0.05 to 20"),
        ("FH_SPD_MAX", f32::NEG_INFINITY, "FH_SPD_MAX=<-1e9 refused: 0.05 to 20"),
        ("FH_SPD_MAX", f32::MAX, "FH_SPD_MAX=>1e9 refused: 0.05 to 20"),
        ("FH_PRESTREAM", 0.5, "FH_PRESTREAM=0.5 refused: whole 0 to 1"),
        ("FH_RC_CH", 19.0, "FH_RC_CH=19 refused: 0 to 18"),
        ("FH_MARGIN_TGT", 0.06, "FH_MARGIN_TGT=0.06 refused: planner.tight_margin_m=0.06 is not 0 to 0.05"),
        (
            "FH_ARR_SIDE",
            0.2,
            "FH_ARR_SIDE=0.2 refused: side_m=0.2 with antennas half a wavelength or more apart opposite directions are ambiguous",
        ),
    ] {
        let old = Id::named(name.as_bytes()).unwrap().default();
        assert_eq!(link.set(name, value), (Some(old), said(text)));
    }
    let integer = 6;
    assert_eq!(link.set_as("FH_RC_CH", 5.0, integer, US.1), (Some(0.0), said("FH_RC_CH refused: send REAL32")));
    assert_eq!(link.set("NO_SUCH", 5.0), (None, said("no parameter NO_SUCH")));
    assert_eq!(link.set_as("SYSID_THISMAV", 5.0, REAL32, 0), (None, String::new()), "to all: it is the autopilot's");
    assert_eq!(link.params.values(), &Values::DEFAULT);
}

#[test]
fn the_value_that_holds_already_is_answered_without_asking_the_application() {
    let mut link = Link::new();
    link.is_seeking = true;
    assert_eq!(link.set("FH_SPD_MAX", 1.0), (Some(1.0), String::new()));
}

#[test]
fn while_seeking_nothing_is_set_and_everything_can_be_read() {
    let mut link = Link::new();
    // Heard before, but not settled by then.
    link.hear(&set("FH_LAG", 1.0, REAL32, US.1));
    link.is_seeking = true;
    assert!(link.params.proposal(true).is_none());
    let lag_s = Values::DEFAULT.get(param::FH_LAG);
    assert_eq!(link.values(500)[0].param_value, lag_s);
    assert_eq!(link.set("FH_LAG", 1.0), (Some(lag_s), "FH_LAG refused while seeking".to_owned()));
    assert_eq!(link.set("FH_V1", 1.0), (Some(0.0), "FH_V1 refused while seeking".to_owned()));
    link.hear(&list(US.0, US.1));
    assert_eq!(link.values(10_000).len(), COUNT);
    for action in [0.0, 1.0, 2.0] {
        assert_eq!(link.store(action, US.1), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED as u8]);
    }
    assert_eq!(link.params.take_storage(), None);
    link.is_seeking = false;
    assert_eq!(link.params.proposal(false), None, "nothing comes late");
    assert_eq!(link.set("FH_LAG", 1.0), (Some(1.0), String::new()));
}

/// Two sets and the command to store in one step: what is stored is what was set.
#[test]
fn nothing_is_stored_before_what_was_set_is_settled() {
    let mut link = Link::new();
    link.hear(&set("FH_LAG", 0.3, REAL32, US.1));
    link.hear(&set("FH_SPD_MAX", 1.1, REAL32, US.1));
    assert_eq!(link.store(1.0, US.1), [0_u8; 0]);
    for _ in 0..2 {
        assert!(link.params.take_storage().is_none() && link.params.proposal(false).is_some());
        link.params.settle(Ok(()));
    }
    assert_eq!(link.params.take_storage(), Some(Storage::Save));
    assert_eq!((link.params.values().get(param::FH_LAG), link.params.values().get(param::FH_SPD_MAX)), (0.3, 1.1));
}

#[test]
fn the_storage_is_the_applications_and_the_station_hears_what_became_of_it() {
    let mut link = Link::new();
    for (action, storage) in [(0.0, Storage::Load), (1.0, Storage::Save), (2.0, Storage::Reset)] {
        for is_done in [true, false] {
            assert_eq!(link.store(action, US.1), [0_u8; 0], "not before it is done");
            assert_eq!(link.store(action, US.1), [0_u8; 0], "asked again");
            assert_eq!(link.store((action + 1.0) % 3.0, US.1), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED as u8]);
            assert_eq!(link.params.take_storage(), Some(storage));
            assert_eq!(link.params.take_storage(), None, "once");
            link.params.stored(is_done);
            let [(_, Reply::Ack(ack))] = &link.replies(200)[..] else { panic!() };
            assert_eq!(ack.result, if is_done { 0 } else { MavResult::MAV_RESULT_FAILED as u8 });
        }
    }
    // As `COMMAND_INT`, as newer stations send it.
    assert!(link.hear(&MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        target_system: US.0,
        target_component: US.1,
        command: MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16,
        param1: 1.0,
        ..COMMAND_INT_DATA::DEFAULT
    })));
    assert_eq!(link.params.take_storage(), Some(Storage::Save));
    link.params.stored(true);
    assert!(matches!(&link.replies(200)[..], [(_, Reply::Ack(ack))] if ack.result == 0));
    // To all components: done, but the autopilot's answer is the one that the station waits for.
    assert_eq!(link.store(1.0, 0), [0_u8; 0]);
    assert_eq!(link.params.take_storage(), Some(Storage::Save));
    link.params.stored(true);
    assert!(link.replies(200).is_empty());
    assert_eq!(link.store(2.0, 0), [0_u8; 0]);
    assert_eq!(link.params.take_storage(), None, "a station that resets its autopilot must not erase our key");
    for action in [-1.0, 3.0, 4.0, 0.5, f32::NAN] {
        assert_eq!(link.store(action, US.1), [MavResult::MAV_RESULT_DENIED as u8], "{action}");
        assert_eq!(link.params.take_storage(), None);
    }
}

#[test]
fn values_from_elsewhere_are_told_to_all_stations() {
    let mut link = Link::new();
    link.hear(&set("FH_SPD_MAX", 2.0, REAL32, US.1));
    let mut loaded = Values::DEFAULT;
    loaded.set(param::FH_RADIUS, 0.4).unwrap();
    link.params.replace(loaded);
    assert_eq!(link.params.proposal(false), None);
    assert_eq!(link.params.values(), &loaded);
    let told: Vec<_> = link.values(10_000).iter().map(|value| value.param_value).collect();
    assert_eq!(told, loaded.as_array());
}

#[test]
fn whatever_stations_send_values_stay_in_their_ranges_and_the_pace_is_kept() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(11);
    let mut link = Link::new();
    let mut last = None;
    for _ in 0..200_000 {
        let id = Id::at(random.next_u32() as usize % COUNT).unwrap();
        let (min, max) = id.range();
        let value = match random.next_u32() % 4 {
            0 => f32::from_bits(random.next_u32()),
            1 => (min + (max - min) * (random.next_u32() as f32 / u32::MAX as f32)).round(),
            _ => min + (max - min) * (random.next_u32() as f32 / u32::MAX as f32) * 1.1,
        };
        link.is_seeking = random.next_u32() % 8 == 0;
        let any = random.next_u32() as i16;
        let message = match random.next_u32() % 8 {
            0 if any % 64 == 0 => list(US.0, US.1),
            1 => read(any % 80, id.name()),
            2 => storage(f32::from(any % 4), US.1),
            _ => set(id.name(), value, if any % 16 == 0 { 6 } else { REAL32 }, US.1),
        };
        link.hear(&message);
        let before = *link.params.values();
        if random.next_u32() % 2 == 0 {
            link.settle();
        }
        if link.is_seeking {
            assert_eq!(link.params.values(), &before);
        }
        if let Some(storage) = link.params.take_storage() {
            if storage == Storage::Reset {
                link.params.replace(Values::DEFAULT);
            }
            link.params.stored(random.next_u32() % 2 == 0);
        }
        for (time, _) in link.replies(u64::from(random.next_u32() % 30)) {
            assert!(last.is_none_or(|last| time.micros_since(last) >= 50_000));
            last = Some(time);
        }
        let values = link.params.values();
        assert!(Id::all().all(|id| id.check(values.get(id)).is_ok()));
        assert!(values == &before || build(values).is_ok());
    }
}

/// The rows of the link are in the core, which does not know the link; here they meet.
#[test]
fn the_links_rows_have_its_defaults_and_its_ranges() {
    let default = companion::Config::default();
    let frame = |frame| match frame {
        companion::ObstacleFrame::Auto => 0.0,
        companion::ObstacleFrame::Field => 1.0,
        companion::ObstacleFrame::Body => 2.0,
    };
    for (id, value) in [
        (param::FH_SP_AGE, default.setpoint_age_max_s),
        (param::FH_HB_TMO, default.heartbeat_timeout_s),
        (param::FH_SILENT, default.silence_after_s),
        (param::FH_PRESTREAM, f32::from(u8::from(default.prestream))),
        (param::FH_OBS_FRAME, frame(default.obstacle_frame)),
    ] {
        assert_eq!(id.default(), value, "{}", id.name());
    }
    let refused = |config: companion::Config| config.build().err().map(|error| (error.field, error.why));
    for id in [param::FH_SP_AGE, param::FH_HB_TMO, param::FH_SILENT] {
        let (min, max) = id.range();
        let with = |value| match id {
            param::FH_SP_AGE => companion::Config { setpoint_age_max_s: value, ..default },
            param::FH_HB_TMO => companion::Config { heartbeat_timeout_s: value, silence_after_s: 30.0, ..default },
            _ => companion::Config { silence_after_s: value, heartbeat_timeout_s: 1.5, ..default },
        };
        assert_eq!((refused(with(min)), refused(with(max))), (None, None), "{}", id.name());
        for beyond in [0.99 * min, 1.01 * max] {
            let range = Why::OutOfRange { min, max };
            assert_eq!(refused(with(beyond)).map(|(_, why)| why), Some(range), "{}", id.name());
        }
    }
}

#[test]
fn the_state_is_the_values_and_little_more() {
    assert!(size_of::<Params>() <= 4 * COUNT + 180, "{}", size_of::<Params>());
}
