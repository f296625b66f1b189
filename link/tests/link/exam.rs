//! The commands that examine the receiver.

use foxhound_link::companion::{Exam, Examined, Tone};
use foxhound_link::dialect::*;

use crate::bench::*;

const STATION: (u8, u8) = (255, 190);
const ACCEPTED: u8 = 0;
const REJECTED: u8 = 1;
const DENIED: u8 = 2;
const FAILED: u8 = 4;
const IN_PROGRESS: u8 = 5;

fn disarmed() -> Bench {
    let mut bench = Bench::flying();
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, DISARMED));
    bench.step(10_000);
    bench
}

/// Says a command and gives the answers.
fn order(bench: &mut Bench, command: u16, param1: f32, param2: f32) -> Vec<u8> {
    bench.take_sent();
    let message = COMMAND_LONG_DATA {
        target_system: 1,
        target_component: 191,
        command,
        param1,
        param2,
        ..COMMAND_LONG_DATA::DEFAULT
    };
    bench.say_as(STATION, &MavMessage::COMMAND_LONG(message));
    bench.drain();
    answers(bench, command)
}

fn answers(bench: &mut Bench, command: u16) -> Vec<u8> {
    let pick = |sent: Sent| match sent.message {
        MavMessage::COMMAND_ACK(ack) => {
            assert_eq!((ack.command, (ack.target_system, ack.target_component)), (command, STATION));
            Some(ack.result)
        }
        _ => None,
    };
    bench.take_sent().into_iter().filter_map(pick).collect()
}

#[test]
fn an_examination_is_in_progress_at_once_and_answered_again_when_it_has_ended() {
    let quarter_rad = std::f32::consts::FRAC_PI_2;
    for (command, param1, param2, exam) in [
        (31_010, 0.0, 0.0, Exam::SelfTest(Tone::Splitter)),
        (31_010, f32::NAN, f32::NAN, Exam::SelfTest(Tone::Splitter)),
        (31_010, -90.0, 1.0, Exam::SelfTest(Tone::Ahead { azimuth_rad: -quarter_rad })),
        (31_010, 0.0, 2.0, Exam::SelfTest(Tone::Board)),
        // A direction that nobody vouches for may be one that was left out.
        (31_011, 30.0, 0.0, Exam::Calibrate { azimuth_rad: None }),
        (31_011, 90.0, 1.0, Exam::Calibrate { azimuth_rad: Some(quarter_rad) }),
    ] {
        for (examined, result) in
            [(Examined::Passed, ACCEPTED), (Examined::Failed, FAILED), (Examined::Refused, REJECTED)]
        {
            let mut bench = disarmed();
            assert_eq!(order(&mut bench, command, param1, param2), [IN_PROGRESS]);
            assert_eq!(order(&mut bench, command, param1, param2).last(), Some(&IN_PROGRESS), "asked again");
            assert_eq!(bench.companion.take_exam(), Some(exam));
            assert_eq!(bench.companion.take_exam(), None, "told once");
            assert_eq!(order(&mut bench, 31_010, 7.0, 1.0), [REJECTED], "one at a time");
            bench.companion.examined(examined);
            bench.drain();
            assert_eq!(answers(&mut bench, command), [result]);
            bench.companion.examined(examined);
            bench.drain();
            assert_eq!(answers(&mut bench, command), [], "nobody waits any more");
        }
    }
}

#[test]
fn armed_in_control_and_with_parameters_that_say_nothing_known_it_is_refused() {
    for armed in [heartbeat(ARDUPILOT, GUIDED, ARMED), heartbeat(ARDUPILOT, 5, ARMED)] {
        let mut bench = Bench::flying();
        bench.heartbeat = Some(armed);
        bench.step(10_000);
        for command in [31_010, 31_011] {
            assert_eq!(order(&mut bench, command, 0.0, 0.0), [REJECTED]);
        }
        assert_eq!(bench.companion.take_exam(), None);
    }
    let mut bench = disarmed();
    for (command, param1, param2) in [
        (31_010, 0.0, 3.0),
        (31_010, 0.0, 0.5),
        (31_010, f32::NAN, 1.0),
        (31_010, 400.0, 1.0),
        (31_010, 0.0, f32::INFINITY),
        // The board's own tone does not go through the receiver.
        (31_011, 0.0, 2.0),
        (31_011, f32::NAN, 1.0),
    ] {
        assert_eq!(order(&mut bench, command, param1, param2), [DENIED], "{command} {param1} {param2}");
    }
    assert_eq!(bench.companion.take_exam(), None);
}
