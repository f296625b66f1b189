//! What we ask of the autopilot, and what others ask of us.

use foxhound_core::guidance::mission::Control;
use foxhound_link::companion::Config;
use foxhound_link::dialect::*;

use crate::bench::*;

#[test]
fn the_messages_we_need_are_asked_for_once_when_each_is_acknowledged() {
    let mut bench = Bench::new(Config::default());
    bench.run(3.0);
    assert_eq!(bench.commands().len(), 0, "nobody to ask yet");
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.step(10_000);
    let commands = bench.commands();
    let asked: Vec<(f32, f32)> = commands.iter().map(|(_, command)| (command.param1, command.param2)).collect();
    assert_eq!(asked, [(32.0, 20_000.0), (30.0, 20_000.0), (245.0, 500_000.0), (330.0, 100_000.0)]);
    for (_, command) in &commands {
        assert_eq!((command.target_system, command.target_component), (1, 1));
        assert_eq!((command.command, command.confirmation), (511, 0));
        let rest = [command.param3, command.param4, command.param5, command.param6, command.param7];
        assert_eq!(rest, [0.0; 5]);
    }
    // The rest follows as soon as these are acknowledged.
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    bench.answers = true;
    bench.run(0.1);
    let rest: Vec<f32> = bench.commands().iter().map(|(_, command)| command.param1).collect();
    assert_eq!(rest, [132.0, 1.0, 147.0, 49.0, 193.0, 162.0]);
    bench.run(2.8);
    assert_eq!(bench.commands().len(), 0);
}

#[test]
fn px4_is_asked_for_its_own_messages_and_for_channels_only_where_a_switch_is_wanted() {
    let mut bench = Bench::new(Config { switch_channel: 7, ..Config::default() });
    bench.heartbeat = Some(heartbeat(PX4, 0, DISARMED));
    bench.answers = true;
    bench.run(0.2);
    let asked: Vec<f32> = bench.commands().iter().map(|(_, command)| command.param1).collect();
    assert_eq!(asked, [32.0, 30.0, 245.0, 330.0, 132.0, 1.0, 147.0, 49.0, 65.0, 230.0, 331.0]);
}

#[test]
fn without_acknowledgement_each_request_is_repeated_five_times_four_requests_every_half_second() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.run(2.9);
    let commands = bench.commands();
    let times: Vec<u64> = commands.iter().map(|(at_us, _)| (*at_us - 10_010_000) / 500_000).collect();
    assert_eq!(
        times,
        [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5],
        "ten: four, four and two in a round"
    );
    assert!(commands.iter().all(|(at_us, _)| (*at_us - 10_010_000) % 500_000 == 0));
    bench.run(5.0);
    let commands = [commands, bench.commands()].concat();
    for message_id in [32.0, 30.0, 245.0, 330.0, 132.0, 193.0] {
        let of_it = commands.iter().filter(|(_, command)| command.param1 == message_id);
        let tries: Vec<u8> = of_it.map(|(_, command)| command.confirmation).take(5).collect();
        assert_eq!(tries, [0, 1, 2, 3, 4], "message {message_id}");
    }
}

#[test]
fn other_peoples_acknowledgements_do_not_count() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.step(10_000);
    for _ in 0..4 {
        let data =
            COMMAND_ACK_DATA { command: 511, target_system: 255, target_component: 190, ..COMMAND_ACK_DATA::DEFAULT };
        bench.say(&MavMessage::COMMAND_ACK(data));
        bench.say(&ack(512, 0));
        bench.say(&ack(511, 5));
        bench.say_as((1, 154), &ack(511, 0));
    }
    bench.take_sent();
    bench.run(0.6);
    assert_eq!(bench.commands().len(), 4);
}

/// Plays an autopilot that sends the three messages that must come, at a share of the wished rates.
fn stream(bench: &mut Bench, seconds: u32, share: f32) {
    for step in 0..seconds * 100 {
        let due = |rate_hz: f32| {
            let per_step = rate_hz * share * 0.01;
            (step as f32 * per_step).floor() != ((step + 1) as f32 * per_step).floor()
        };
        let time_boot_ms = (bench.now_us / 1000) as u32;
        if due(50.0) {
            bench.say(&position(time_boot_ms));
            bench.say(&attitude(time_boot_ms, 0.0));
        }
        if due(2.0) {
            bench.say(&extended(1));
        }
        bench.step(10_000);
    }
}

#[test]
fn a_message_that_comes_too_slowly_is_asked_for_again_and_one_that_never_comes_ever_more_seldom() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.answers = true;
    bench.run(0.1);
    bench.take_sent();
    let asked = |bench: &mut Bench, seconds, share| {
        stream(bench, seconds, share);
        bench.commands().iter().map(|(_, command)| command.param1 as u32).collect::<Vec<u32>>()
    };
    let fine = asked(&mut bench, 12, 0.8);
    assert!([30, 32, 245].iter().all(|id| !fine.contains(id)), "80 % is enough: {fine:?}");
    let mut slow = asked(&mut bench, 7, 0.4);
    slow.sort_unstable();
    slow.dedup();
    assert!([30, 32, 245].iter().all(|id| slow.contains(id)), "{slow:?}");
    // Nobody sends distances: asked for after 3, 9, 21, 45 s, and after 93 s given up.
    let before = fine.iter().chain(&slow).filter(|id| **id == 330).count();
    let later = asked(&mut bench, 120, 1.0).iter().filter(|id| **id == 330).count();
    assert_eq!((before, later), (2, 2));
    let forever = asked(&mut bench, 600, 1.0);
    assert!(forever.is_empty(), "{forever:?}");
}

#[test]
fn what_the_autopilot_refuses_is_asked_for_once_more_and_given_up() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    let mut asked = Vec::new();
    for step in 0..60_000_u32 {
        bench.step(10_000);
        if step % 100 == 0 {
            bench.say(&position(0));
        }
        for (_, command) in bench.commands() {
            let message_id = command.param1 as u32;
            asked.push(message_id);
            // Denied, failed, unsupported.
            let result = [2, 4, 3][asked.len() % 3];
            bench.say(&ack(511, if message_id == 330 { result } else { 0 }));
        }
    }
    assert_eq!(asked.iter().filter(|id| **id == 330).count(), 2, "{asked:?}");
    assert!(asked.iter().filter(|id| **id == 32).count() > 100, "what is vital is asked for without end");
}

#[test]
fn a_restart_of_the_autopilot_forgets_what_it_said_and_asks_for_everything_again() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    bench.say(&position(60_000));
    bench.say(&attitude(59_500, 0.0));
    bench.say(&extended(2));
    bench.step(10_000);
    assert!(bench.companion.ownship().is_some(), "messages may overtake each other");
    assert_eq!(bench.companion.counters().reboots, 0);
    bench.take_sent();

    bench.say(&position(900));
    assert_eq!(bench.companion.counters().reboots, 1);
    assert_eq!(bench.companion.ownship(), None);
    assert_eq!(bench.companion.landed(), None);
    assert_eq!(bench.companion.control(bench.now()), Control::NotInControl, "until it says so again");
    bench.step(10_000);
    assert_eq!(bench.commands().len(), 4);
}

#[test]
fn after_a_lost_link_everything_is_asked_for_again() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    let data = bench.heartbeat.take();
    bench.run(3.5);
    bench.take_sent();
    bench.heartbeat = data;
    bench.step(10_000);
    assert_eq!(bench.commands().len(), 4);
}

#[test]
fn commands_for_us_are_refused_and_commands_for_others_are_not_answered() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    let command = |target_system, target_component, command| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            target_system,
            target_component,
            command,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    };
    for (number, result) in [(400, 2), (176, 2), (512, 3), (22, 3), (65_000, 3)] {
        bench.take_sent();
        bench.say_as((255, 190), &command(1, 191, number));
        bench.drain();
        let sent = bench.take_sent();
        assert_eq!(sent.len(), 1);
        let MavMessage::COMMAND_ACK(ack) = &sent[0].message else { panic!() };
        assert_eq!((ack.command, ack.result), (number, result));
        assert_eq!((ack.target_system, ack.target_component), (255, 190));
    }
    for (target_system, target_component) in [(1, 1), (1, 0), (0, 0), (2, 191), (1, 195)] {
        bench.say_as((255, 190), &command(target_system, target_component, 400));
    }
    bench.drain();
    assert_eq!(bench.take_sent().len(), 0);
}

#[test]
fn clock_requests_are_answered_with_our_clock_and_answers_are_not() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.take_sent();
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: -77, ..TIMESYNC_DATA::DEFAULT }));
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 5, ts1: 6, ..TIMESYNC_DATA::DEFAULT }));
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 8, target_system: 9, target_component: 1 }));
    bench.drain();
    let sent = bench.take_sent();
    assert_eq!(sent.len(), 1);
    let MavMessage::TIMESYNC(answer) = &sent[0].message else { panic!() };
    assert_eq!((answer.tc1, answer.ts1), (10_010_000_000, -77));
    assert_eq!((answer.target_system, answer.target_component), (1, 1));
    // Another program's question to everybody is meant for the autopilot, and it would take our answer for the autopilot's.
    bench.say_as((1, 240), &MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 9, ..TIMESYNC_DATA::DEFAULT }));
    let to_us = TIMESYNC_DATA { tc1: 0, ts1: 10, target_system: 1, target_component: 191 };
    bench.say_as((1, 240), &MavMessage::TIMESYNC(to_us));
    bench.drain();
    let sent = bench.take_sent();
    let [answer] = sent.as_slice() else { panic!("{}", sent.len()) };
    assert!(
        matches!(&answer.message, MavMessage::TIMESYNC(answer) if answer.ts1 == 10 && answer.target_component == 240)
    );
}
