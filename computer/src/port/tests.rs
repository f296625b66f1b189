use super::*;
use crate::restart::{Cause, End, Record};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::string::{String as Text, ToString as _};
use std::vec::Vec as List;

fn typed(text: &[u8]) -> List<Result<Command, Refusal>> {
    let mut lines = Lines::new();
    text.iter().filter_map(|byte| lines.push(*byte)).collect()
}

#[test]
fn commands_are_understood_however_their_lines_end() {
    let all = typed(
        b"help\r\nstatus\n\n\r  restart \rselftest\tfactory-reset\ncalibrate\nfactory-reset\nfactory-reset  yes\n",
    );
    let sure = |is_sure| Ok(Command::FactoryReset { is_sure });
    let [help, status, restart] = [Command::Help, Command::Status, Command::Restart].map(Ok);
    assert_eq!(all[..3], [help, status, restart]);
    assert_eq!(all[3..], [Err(Refusal::Surplus), Ok(Command::Calibrate), sure(false), sure(true)]);
    assert_eq!(typed(b"dump 1\ndump 10000\n"), [1, 10_000].map(|frames| Ok(Command::Dump { frames })));
    assert_eq!(typed(b"watchdog\nwatchdog yes\n"), [false, true].map(|is_sure| Ok(Command::Watchdog { is_sure })));
    assert_eq!(typed(b"stauts\x08\x08\x08\x7fatus\n"), [status]);
}

#[test]
fn a_bad_line_is_refused_whole_and_the_next_one_counts() {
    let long = [&b"restart "[..], &[b' '; LINE_MAX], b"\nhelp\n"].concat();
    assert_eq!(typed(&long), [Err(Refusal::TooLong), Ok(Command::Help)]);
    assert_eq!(typed(b"restart\xc3\xa4\nhelp\n"), [Err(Refusal::NotText), Ok(Command::Help)]);
    assert_eq!(typed(b"factory-reset no\n"), [Err(Refusal::Surplus)]);
    assert_eq!(typed(b"factory-reset yes yes\n"), [Err(Refusal::Surplus)]);
    assert_eq!(typed(b"RESTART\nrestart now\n"), [Err(Refusal::Unknown), Err(Refusal::Surplus)]);
    assert_eq!(typed(b"dump\ndump 0\ndump 10001\ndump -1\ndump 1x\n"), [Err(Refusal::Frames); 5]);
    assert_eq!(typed(b"dump 7 8\nwatchdog now\n"), [Err(Refusal::Surplus); 2]);
    assert_eq!(typed(b"restart"), [], "a line that is not ended is none");
}

#[test]
fn in_control_nothing_is_done_that_disturbs() {
    let all = typed(b"help\nstatus\nselftest\ncalibrate\nfactory-reset yes\nrestart\ndump 9\nwatchdog yes\n");
    let admitted = |control| all.iter().map(|line| line.unwrap().admit(control).is_ok()).collect::<List<_>>();
    assert_eq!(admitted(Control::Granted), [true, true, false, false, false, false, false, false]);
    assert_eq!(admitted(Control::NotInControl), [true; 8]);
    assert_eq!(admitted(Control::LinkLost), [true; 8]);
}

#[test]
fn any_bytes_are_lines_or_nothing_and_noise_never_resets_anything() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
    let mut lines = Lines::new();
    let mut refused = 0;
    for _ in 0..1_000_000 {
        match lines.push(random.next_u32() as u8) {
            None | Some(Ok(Command::Help)) => {}
            Some(Err(_)) => refused += 1,
            Some(Ok(command)) => panic!("{command:?} out of noise"),
        }
    }
    assert!(refused > 1000);
}

#[test]
fn the_status_says_all_of_it_and_the_longest_numbers_fit() {
    let record = Record::new(End::Panic, 0, 0, 0, b"computer/src/flight.rs:4294967295");
    let restart = Restart { cause: Cause::Software, record: Some(record) };
    let most = u32::MAX;
    let mut link = companion::Counters { rejected: most, setpoints_late: most, reboots: most, ..Default::default() };
    (link.framer.frames, link.framer.bad_crc, link.framer.lost) = (most, most, 10);
    let mut times = timing::table();
    for ticks in [1, 1 << 8, 1 << 11, 1 << 15, 1 << 16, 1 << 21, 1 << 22, 1 << 30] {
        times[Task::Step as usize].add(ticks);
    }
    times[Task::Plan as usize].add(most);
    let mut feeds = Feeds::default();
    [0, u64::MAX].into_iter().for_each(|now_us| feeds.feed(now_us));
    let status = Status {
        board: "nucleo_g474re",
        uptime_s: most,
        restart: &restart,
        clock: Clock::Internal,
        deadlines: Counts { steps: most, late: 0, longest_us: 10_203 },
        stack_bytes: 45_056,
        outcome: Some(Outcome::StaleObstacles),
        link,
        line_errors: most,
        received: Waiting { most, room: most, lost: most },
        sensor: Some(SensorStatus {
            counters: SensorCounters::Lidar(lidar::Counters { frames: most, bad: most, turns: 12 }),
            received: Waiting { most: 353, room: 1024, lost: 0 },
            line_errors: 3,
        }),
        sent: Waiting { most: 512, room: 512, lost: 0 },
        log: Waiting { most: 2000, room: 2047, lost: 7 },
        starts: most,
        feeds,
        watchdog_us: 500_000,
    };
    let mut told = List::new();
    (0..Status::LINES).for_each(|part| status.tell(part, &times, |line| told.push(line.to_string())));
    let expected = [
        concat!("foxhound ", env!("CARGO_PKG_VERSION"), " on nucleo_g474re, up 4294967295 s"),
        "restart: panic computer/src/flight.rs:4294967295",
        "clock: no crystal; HSI, sample rate and times off by up to 1 %",
        "steps 4294967295, late 0, longest 10203 us, stack 45056 bytes",
        "outcome stale_obstacles",
        "link: frames 4294967295, damaged 4294967295, missing 10, rejected 4294967295, setpoints late 4294967295, reboots 4294967295",
        "received: at most 4294967295 of 4294967295 bytes waited, lost 4294967295, damaged 4294967295",
        "sent: at most 512 of 512 bytes waited",
        "lidar: turns 12, frames 4294967295, damaged 4294967295",
        "lidar: at most 353 of 1024 bytes waited, lost 0, damaged 3",
        "log: frames left out 7, at most 2000 of 2047 bytes waited",
        "watchdog: fed after 4294967295 us at the longest, of 500000 us; start 4294967295",
        "cycles of 170 MHz",
        "receive: 0 times, cycles 0 0 0 (min, mean, max)",
        "step: 8 times, cycles 1 135016736 1073741824 (min, mean, max)",
        "   <2^8 1 <2^9 1 <2^12 1 <2^16 1 <2^17 1 <2^22 1",
        "   <2^23 1 more 1",
        "plan: 1 times, cycles 4294967295 4294967295 4294967295 (min, mean, max)",
        "   more 1",
        "transmit: 0 times, cycles 0 0 0 (min, mean, max)",
        "listen: 0 times, cycles 0 0 0 (min, mean, max)",
        "speak: 0 times, cycles 0 0 0 (min, mean, max)",
    ];
    let cut: List<Text> = expected.iter().map(|line| line.chars().take(ANSWER_MAX).collect()).collect();
    assert_eq!(told, cut);
    let twin = Status { clock: Clock::Simulated, ..status };
    twin.tell(HEAD_LINES - 1, &times, |line| assert!(line.contains("1.5 an instruction assumed"), "{line}"));
    let mut told = List::new();
    let without = Status { sensor: None, ..twin };
    (0..HEAD_LINES).for_each(|part| without.tell(part, &times, |line| told.push(line.to_string())));
    assert!(told.len() == HEAD_LINES - 2 && told.iter().all(|line| !line.contains("lidar")));
    assert!(HELP.iter().all(|line| line.len() <= ANSWER_MAX));
}
