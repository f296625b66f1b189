//! Commands, streams, parameters and time.

use foxhound_link::dialect::{
    PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, REQUEST_DATA_STREAM_DATA, TIMESYNC_DATA,
};

use super::super::Start;
use super::*;
use crate::scenario::Software;

fn both() -> [Autopilot; 2] {
    [Software::ArduCopter, Software::Px4].map(|software| Autopilot::new(software, Start::Hovering))
}

fn receive(autopilot: &mut Autopilot, bytes: &[u8]) {
    autopilot.receive(5_000_000, &eastward(PLACE), bytes);
}

#[test]
fn what_is_not_known_is_unsupported_and_what_is_for_others_is_not_answered() {
    for mut autopilot in both() {
        receive(&mut autopilot, &bytes(&command(31_000, [0.0; 7])));
        assert_eq!(results(&mut autopilot), [3]);
        let mut other = command(31_000, [0.0; 7]);
        other.target_component = 191;
        receive(&mut autopilot, &bytes(&other));
        assert!(results(&mut autopilot).is_empty());
    }
}

#[test]
fn answers_name_who_asked() {
    let mut autopilot = Autopilot::default();
    receive(&mut autopilot, &bytes(&command(511, [32.0, 1e5, 0.0, 0.0, 0.0, 0.0, 0.0])));
    let said = heard(&mut autopilot);
    let Some((header, MavMessage::COMMAND_ACK(answer))) = said.first() else { panic!("{said:?}") };
    assert_eq!((header.system_id, header.component_id), (1, 1));
    assert_eq!((answer.command, answer.target_system, answer.target_component), (511, 1, 191));
}

#[test]
fn a_message_without_a_stream_cannot_be_asked_for() {
    for mut autopilot in both() {
        for order in [511, 512] {
            receive(&mut autopilot, &bytes(&command(order, [330.0, 1e5, 0.0, 0.0, 0.0, 0.0, 0.0])));
        }
        let refused = if autopilot.software() == Software::Px4 { 2 } else { 4 };
        assert_eq!(results(&mut autopilot), [4, refused]);
    }
}

#[test]
fn a_message_is_said_once_on_request() {
    for mut autopilot in both() {
        let own = if autopilot.software() == Software::Px4 { [230, 331] } else { [193, 162] };
        for id in [0, 1, 2, 30, 31, 32, 49, 65, 147, 245].into_iter().chain(own) {
            receive(&mut autopilot, &bytes(&command(512, [id as f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])));
            assert_eq!(heard_ids(&mut autopilot), [id, 77]);
        }
    }
}

#[test]
fn a_request_for_a_data_stream_overwrites_the_rates_of_its_group_on_ardupilot_only() {
    let greedy = |group, rate| {
        bytes(&REQUEST_DATA_STREAM_DATA {
            target_system: 1,
            target_component: 1,
            req_stream_id: group,
            req_message_rate: rate,
            start_stop: 1,
        })
    };
    let heard_hz = |autopilot: &mut Autopilot, id: u32, from_s: u64| {
        autopilot.transmit();
        for tick in 50 * from_s..50 * (from_s + 4) {
            autopilot.telemetry(tick * TICK_US, &Motion::default(), false);
        }
        heard_ids(autopilot).iter().filter(|heard| **heard == id).count() / 4
    };
    let mut autopilot = Autopilot::default();
    for id in [30.0, 32.0, 245.0] {
        receive(&mut autopilot, &bytes(&command(511, [id, 2e4, 0.0, 0.0, 0.0, 0.0, 0.0])));
    }
    assert_eq!(heard_hz(&mut autopilot, 32, 10), 50);
    receive(&mut autopilot, &greedy(6, 4));
    assert_eq!(heard_hz(&mut autopilot, 32, 20), 4, "POSITION");
    assert_eq!(heard_hz(&mut autopilot, 30, 30), 50, "EXTRA1 is another group");
    receive(&mut autopilot, &greedy(0, 2));
    assert_eq!(heard_hz(&mut autopilot, 30, 40), 2, "all groups");
    assert_eq!(heard_hz(&mut autopilot, 1, 50), 2, "and what was never asked for");
    assert_eq!(heard_hz(&mut autopilot, 245, 60), 50, "in no group");
    let mut px4 = Autopilot::new(Software::Px4, Start::Hovering);
    receive(&mut px4, &greedy(0, 1));
    assert_eq!(heard_hz(&mut px4, 245, 10), 5);
}

#[test]
fn the_time_is_told_and_asked_for() {
    for mut autopilot in both() {
        autopilot.transmit();
        receive(&mut autopilot, &bytes(&TIMESYNC_DATA { tc1: 0, ts1: 77, target_system: 0, target_component: 0 }));
        let said = heard(&mut autopilot);
        let Some((_, MavMessage::TIMESYNC(answer))) = said.first() else { panic!("{said:?}") };
        assert_eq!((answer.ts1, answer.tc1, answer.target_component), (77, 5_000_000_000, 191));
        receive(&mut autopilot, &bytes(&TIMESYNC_DATA { tc1: 9, ts1: 77, target_system: 0, target_component: 0 }));
        assert!(heard(&mut autopilot).is_empty(), "an answer is not answered");
        autopilot.telemetry(5_000_000, &Motion::default(), false);
        let asks = |(_, message): &(Header, MavMessage)| match message {
            MavMessage::TIMESYNC(ask) => ask.tc1 == 0 && ask.ts1 / 1000 == 5_000_000,
            _ => false,
        };
        assert_eq!(heard(&mut autopilot).iter().filter(|said| asks(said)).count(), 1);
    }
}

#[test]
fn parameters_are_read_and_set_by_name_cast_on_ardupilot_and_by_bytes_on_px4() {
    let read = |autopilot: &mut Autopilot, name: &str| {
        let request =
            PARAM_REQUEST_READ_DATA { target_system: 1, target_component: 1, param_id: name.into(), param_index: -1 };
        receive(autopilot, &bytes(&request));
        heard(autopilot).into_iter().find_map(|(_, message)| match message {
            MavMessage::PARAM_VALUE(value) => Some((value.param_value, value.param_type)),
            _ => None,
        })
    };
    let [mut ardupilot, mut px4] = both();
    assert_eq!(read(&mut ardupilot, "GUID_TIMEOUT"), Some((3.0, 9)));
    assert_eq!(read(&mut ardupilot, "AVOID_ENABLE"), Some((3.0, 2)), "cast");
    assert_eq!(read(&mut px4, "COM_OF_LOSS_T"), Some((1.0, 9)));
    assert_eq!(read(&mut px4, "COM_RC_OVERRIDE"), Some((f32::from_bits(1), 6)), "1.4e-45");
    assert_eq!(read(&mut px4, "GUID_TIMEOUT"), None);
    let wish = PARAM_SET_DATA {
        target_system: 1,
        target_component: 1,
        param_id: "COM_OBL_RC_ACT".into(),
        param_value: f32::from_bits(5),
        param_type: 6,
    };
    receive(&mut px4, &bytes(&wish));
    assert_eq!(read(&mut px4, "COM_OBL_RC_ACT"), Some((f32::from_bits(5), 6)));
    receive(&mut ardupilot, &bytes(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 0 }));
    assert_eq!(heard_ids(&mut ardupilot), [22; 5]);
}
