//! Each source with a simulated server: valid data, damaged data, and a lost connection.

use std::f64::consts::TAU;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::SystemTime;

use foxhound_computer::iq;

use super::heimdall::Header;
use super::kraken::newest;
use super::*;
use crate::autopilot::transport::Listen;
use crate::tools::hci::array_of;

const NOW: time::Instant = time::Instant(10_000_000);

fn options() -> Options {
    Options { array: None, emitter: None, mount_rad: 0.0, sigma_rad: 0.14, age_max: Duration::from_millis(500) }
}

/// Where no age is tested: no bearing is too old, however busy the machine is.
fn patient() -> Options {
    Options { age_max: Duration::from_secs(60), ..options() }
}

/// Polls until a condition holds, for at most a minute.
fn until(live: &mut Live, mut is_so: impl FnMut(&State, Option<Bearing>) -> bool) {
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(60) {
        let bearing = live.poll(NOW);
        if is_so(live.state(), bearing) {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("not within a minute: {:?}", live.state());
}

/// The same, and tells it again after each poll: on a busy machine what was told once may be forgotten before it is polled.
fn until_told(live: &mut Live, mut tell: impl FnMut(), mut is_so: impl FnMut(&State, Option<Bearing>) -> bool) {
    until(live, |state, bearing| {
        let is_so = is_so(state, bearing);
        if !is_so {
            tell();
        }
        is_so
    });
}

fn degrees(bearing: &Bearing) -> f32 {
    bearing.azimuth_rad.to_degrees()
}

#[test]
fn sources_are_read_and_wrong_ones_refused() {
    let read = |text: &str| text.parse::<Source>();
    assert_eq!(read("kraken:10.0.0.2"), Ok(Source::Kraken("10.0.0.2".to_owned(), 8081)));
    assert_eq!(read("heimdall:pi:5001"), Ok(Source::Heimdall("pi".to_owned(), 5001)));
    assert_eq!(read("hci:/dev/ttyACM0:1000000"), Ok(Source::Hci("/dev/ttyACM0".into(), 1_000_000)));
    assert_eq!(read("udp:0.0.0.0:7000"), Ok(Source::Udp("0.0.0.0".to_owned(), 7000)));
    for wrong in [
        "kraken",
        "kraken:",
        "kraken:a:0",
        "kraken:a:70000",
        "udp:0.0.0.0",
        "hci:/dev/x",
        "uudf:/dev/x:1",
        "tcp:a:1",
        "",
    ] {
        assert!(read(wrong).is_err(), "{wrong}");
    }
    let heimdall = Live::open(&Source::Heimdall("localhost".to_owned(), 1), options());
    assert!(heimdall.err().is_some_and(|error| error.to_string().contains("needs --array")));
    // Nor is anything taken that would have no effect.
    let udp = || Source::Udp("127.0.0.1".to_owned(), 0);
    for (given, word) in [
        (Options { emitter: Some(7), ..options() }, "--emitter: not with --bearings udp:127.0.0.1:0"),
        (Options { array: Some(ring().1), ..options() }, "--array: not with --bearings udp:127.0.0.1:0"),
    ] {
        let refused = Live::open(&udp(), given).err().unwrap().to_string();
        assert!(refused.starts_with(word), "{refused}");
    }
}

#[test]
fn json_lines_come_by_udp_with_their_age_and_silence_is_named() {
    let mut live =
        Live::open(&Source::Udp("127.0.0.1".to_owned(), 0), Options { mount_rad: 0.5, ..patient() }).unwrap();
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = live.port().unwrap();
    let send = |text: &str| assert!(socket.send_to(text.as_bytes(), ("127.0.0.1", port)).is_ok());
    let sent = Instant::now();
    assert!(live.poll(NOW).is_none() && *live.state() == State::Waiting);
    send("{\"azimuth_deg\": 10, \"sigma_deg\": 5, \"age_s\": 0.1, \"more\": 1}\n");
    until(&mut live, |_, bearing| {
        bearing.is_some_and(|bearing| {
            assert!((degrees(&bearing) - 38.648).abs() < 0.01 && (bearing.sigma_rad.to_degrees() - 5.0).abs() < 1e-3);
            // A tenth of a second, and what has passed since.
            let most_us = 101_000 + sent.elapsed().as_micros() as u64;
            assert!((90_000..most_us).contains(&NOW.micros_since(bearing.time)), "{:?}", bearing.time);
            bearing.valid
        })
    });
    send("{\"azimuth_deg\": -170}");
    until(&mut live, |_, bearing| bearing.is_some_and(|bearing| (bearing.sigma_rad - 0.14).abs() < 1e-6));
    live.options = options();
    for (line, name) in [
        ("{\"azimuth_deg\": 10, \"age_s\": 0.9}", "stale"),
        ("{\"azimuth_deg\": 10, \"valid\": false}", "no_bearing"),
        ("{\"azimuth_deg\": null}", "no_bearing"),
        ("{\"azimuth_deg\": 10, \"valid\": true, \"mirror_deg\": 80, \"ambiguities\": 1}", "no_bearing"),
        ("{\"azimuth_deg\": 361}", "refused"),
        ("{\"azimuth_deg\": 10, \"sigma_deg\": 0}", "refused"),
        ("{\"azimuth_deg\": 10, \"age_s\": -1}", "refused"),
        ("{\"azimuth_deg\": 1e999}", "refused"),
        ("{\"azimuth_deg\": \"10\"}", "refused"),
        ("[]", "refused"),
        ("\u{1}", "refused"),
    ] {
        until_told(
            &mut live,
            || send(line),
            |state, bearing| {
                // The last good line may come twice.
                assert!(bearing.is_none_or(|bearing| (degrees(&bearing) - 29.648).abs() < 0.01), "{line}");
                state.name() == name
            },
        );
        until_told(&mut live, || send("{\"azimuth_deg\": 1}"), |state, _| *state == State::Hearing);
    }
    until(&mut live, |state, _| *state == State::Silent);
}

/// A line of a `KrakenSDR` as its software writes it.
fn line(time_ms: u64, bearing: f64, frequency_hz: u64) -> String {
    line_with(360.0 - bearing, time_ms, bearing, frequency_hz)
}

fn time_of(unix_ms: u64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_millis(unix_ms)
}

/// The highest place of the spectrum, counter-clockwise, and the other fields.
fn line_with(theta_deg: f64, time_ms: u64, bearing: f64, frequency_hz: u64) -> String {
    let level = |k: u32| 10.0 + 9.0 * (f64::from(k) - theta_deg).to_radians().cos();
    let spectrum: String = (0..360).map(|k| format!(", {:.2}", level(k))).collect();
    format!(
        "{time_ms}, {bearing}, 9.1, -31.2, {frequency_hz}, UCA, 350, NOCALL, 0.0, 0.0, 12.0, 12.0, GPS, R, R, R, R{spectrum} \n"
    )
}

#[test]
fn kraken_lines_are_read_by_frequency_and_torn_ones_are_not_believed() {
    let body = line(1_700_000_000_000, 350.0, 433_920_000) + &line(1_700_000_000_000, 45.0, 868_000_000);
    let read = |body: &str, frequency: Option<u64>| newest(body, frequency, &mut Some(0), Instant::now(), None);
    let azimuth = |event: Option<Event>| match event {
        Some(Event::Measured(measured)) => measured.azimuth_rad.to_degrees(),
        other => panic!("{other:?}"),
    };
    assert!((azimuth(read(&body, None)) - 350.0).abs() < 1e-3);
    assert!((azimuth(read(&body, Some(868_001_000))) - 45.0).abs() < 1e-3);
    assert!(matches!(read(&body, Some(915_000_000)), Some(Event::Nothing(_))));
    assert!(newest(&body, None, &mut Some(1_700_000_000_000), Instant::now(), None).is_none(), "the same as before");
    let (mut last_ms, now) = (None, Instant::now());
    assert!(newest(&body, None, &mut last_ms, now, None).is_none(), "nobody knows how old the first is");
    let begin = time_of(1_700_000_000_000);
    for (number, clock, age_ms) in [(1, None, 350), (2, Some(250), 425), (3, Some(30_000), 30_175)] {
        let clock = clock.map(|after_ms| begin + Duration::from_millis(number * 400 + after_ms));
        let next = newest(&line(1_700_000_000_000 + number * 400, 10.0, 433_920_000), None, &mut last_ms, now, clock);
        let Some(Event::Measured(next)) = next else { panic!("{next:?}") };
        assert_eq!(
            now.duration_since(next.at),
            Duration::from_millis(age_ms),
            "the middle of the samples if that is known"
        );
    }
    // Another computer's clock, which is ahead or behind: the line's latency.
    for (number, clock_ms) in [(9, 1_600_000_000_000), (10, 1_800_000_000_000)] {
        let clock = Some(time_of(clock_ms));
        let next = newest(&line(1_700_000_000_000 + number, 10.0, 433_920_000), None, &mut last_ms, now, clock);
        let Some(Event::Measured(next)) = next else { panic!("{next:?}") };
        assert_eq!(now.duration_since(next.at), Duration::from_millis(350), "{clock_ms}");
    }
    for bearing in [10.0, 60.0, 179.0, 181.0, 300.0] {
        // As the software of May 2023 wrote it.
        let old = read(&line_with(bearing, 1_700_000_000_000, bearing, 433_920_000), None);
        let is_plain = (bearing - 180.0_f64).abs() < 2.0;
        assert!(is_plain || matches!(&old, Some(Event::Refused(why)) if why.contains("counter")), "{bearing}: {old:?}");
        assert!((azimuth(read(&line(1_700_000_000_000, bearing, 433_920_000), None)) - bearing as f32).abs() < 1e-3);
    }
    assert!(matches!(read("", None), Some(Event::Nothing(_))));
    for cut in 0..400 {
        // A line that breaks off, wherever it does, is not taken for a whole one; behind its fixed fields only the spectrum is missing.
        if let Some(Event::Measured(measured)) = read(&body[..cut], None) {
            assert!((measured.azimuth_rad.to_degrees() - 350.0).abs() < 1e-3, "{cut}");
        }
    }
    for wrong in [
        body.replace("350,", "nan,"),
        body.replace("350, 9.1", "361, 9.1"),
        body.replace("GPS", "R"),
        body.replace("UCA, 350", "UCA, -1"),
        "<html>".to_owned(),
    ] {
        let wrong = wrong.lines().next().unwrap();
        assert!(matches!(read(wrong, None), Some(Event::Refused(_))), "{wrong}");
    }
}

#[test]
fn a_kraken_is_heard_over_http_and_its_end_has_a_name() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = server.local_addr().unwrap().port();
    let seen = Arc::new(AtomicUsize::new(0));
    let count = Arc::clone(&seen);
    let begin_ms = SystemTime::now().duration_since(time_of(0)).unwrap().as_millis() as u64;
    let thread = std::thread::spawn(move || {
        // One that has been there, four new bearings, each until it is seen, the last once more and again, an error, and it is gone.
        let (mut last, mut again) = (None, 0);
        while again < 3 {
            let (mut stream, _) = server.accept().unwrap();
            let mut request = [0; 256];
            let length = stream.read(&mut request).unwrap();
            assert!(request[..length].starts_with(b"GET /DOA_value.html HTTP/1.0\r\n"));
            let seen = count.load(Ordering::Relaxed) as u64;
            let number = last.map_or(0, |_| (seen + 1).min(4));
            // Of the same time, it is not new, whatever it says.
            let bearing = if last.replace(number) == Some(number) { 77.0 } else { 20.0 + number as f64 };
            let body = line(begin_ms + 100 * number, bearing, 433_920_000);
            again += u64::from(seen == 4);
            let status = if again < 3 { "200 OK" } else { "404 Not Found" };
            write!(stream, "HTTP/1.0 {status}\r\nContent-Type: text/html\r\n\r\n{body}").unwrap();
        }
        server
    });
    let mut live = Live::open(&Source::Kraken("127.0.0.1".to_owned(), port), patient()).unwrap();
    let mut measured = Vec::new();
    until(&mut live, |state, bearing| {
        measured.extend(bearing.map(|bearing| degrees(&bearing).round() as i32));
        seen.store(measured.len(), Ordering::Relaxed);
        matches!(state, State::Lost(why) if why.contains("status 404"))
    });
    assert_eq!(measured, [21, 22, 23, 24]);
    drop(thread.join().unwrap());
    until(&mut live, |state, _| matches!(state, State::Lost(why) if !why.contains("404")));
}

fn array() -> RadioArray {
    let text = "wavelength_m = 1.0\nantennas_m = [[0.25, 0.0], [-0.1, 0.2], [-0.1, -0.2]]\nsample_rate_hz = 1e6\n";
    RadioArray::parse(text).unwrap()
}

fn header(channels: u32, length: u32) -> [u8; 1024] {
    let mut header = [0; 1024];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &0x2BF7_B95A_u32.to_le_bytes());
    put(28, &channels.to_le_bytes());
    put(56, &1_000_000_u64.to_le_bytes());
    put(64, &length.to_le_bytes());
    put(100, &32_u32.to_le_bytes());
    put(236, &1_u32.to_le_bytes());
    put(240, &1_u32.to_le_bytes());
    put(1020, &7_u32.to_le_bytes());
    header
}

/// A noise-like source, channel after channel.
fn payload(azimuth: f64, length: u32) -> Vec<u8> {
    let mut word = 1_u64;
    let mut noise = move || {
        word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (word >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
    };
    let sent: Vec<[f64; 2]> = (0..length).map(|_| [noise(), noise()]).collect();
    let mut bytes = Vec::new();
    for [x, y] in [[0.25, 0.0], [-0.1, 0.2], [-0.1, -0.2]] {
        let (s, c) = (TAU * (x * f64::cos(azimuth) + y * f64::sin(azimuth))).sin_cos();
        for [a, b] in &sent {
            for part in [a * c - b * s + 0.05 * noise(), a * s + b * c + 0.05 * noise()] {
                bytes.extend((part as f32).to_le_bytes());
            }
        }
    }
    bytes
}

#[test]
fn heimdalls_stream_gives_bearings_once_its_channels_are_in_step() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = server.local_addr().unwrap().port();
    let thread = std::thread::spawn(move || {
        let (mut stream, _) = server.accept().unwrap();
        let mut asked = [0; 10];
        stream.read_exact(&mut asked[..9]).unwrap();
        assert_eq!(&asked[..9], b"streaming");
        for number in 0..6 {
            let mut header = header(3, 2500);
            match number {
                // A dummy frame, one before the channels are in step, one of another receiver.
                0 => header[4] = 1,
                1 => header[240] = 0,
                2 => header[56] = 1,
                _ => {}
            }
            stream.write_all(&header).unwrap();
            stream.write_all(&payload(0.6, 2500)).unwrap();
            stream.read_exact(&mut asked).unwrap();
            assert_eq!(&asked, b"IQDownload");
        }
        stream.write_all(&[7; 1024]).unwrap();
    });
    let mut live =
        Live::open(&Source::Heimdall("127.0.0.1".to_owned(), port), Options { array: Some(array()), ..patient() })
            .unwrap();
    let (mut measured, mut seen) = (0, Vec::new());
    until(&mut live, |state, bearing| {
        if let Some(bearing) = bearing {
            assert!((bearing.azimuth_rad - 0.6).abs() < 0.03, "{bearing:?}");
            measured += 1;
        }
        seen.push(state.name());
        matches!(state, State::Lost(why) if why.contains("sync word"))
    });
    assert!(measured >= 1, "{seen:?}");
    thread.join().unwrap();
}

#[test]
fn heimdalls_header_is_refused_by_field() {
    let read = |change: &dyn Fn(&mut [u8; 1024])| {
        let mut header = header(5, 1 << 18);
        change(&mut header);
        Header::read(&header)
    };
    assert!(read(&|_| ()).is_ok_and(|header| header.channels == 5 && header.is_data && header.is_in_step));
    assert!(read(&|header| header[0] = 0).unwrap_err().contains("sync word"));
    assert!(read(&|header| header[28] = 33).unwrap_err().contains("active_ant_chs = 33"));
    assert!(read(&|header| header[67] = 1).unwrap_err().contains("cpi_length"));
    assert!(read(&|header| header[100] = 8).unwrap_err().contains("sample_bit_depth = 8"));
    assert!(read(&|header| header[248] = 1).is_ok_and(|header| !header.is_in_step), "its noise source is on");
}

#[test]
fn lines_of_a_serial_port_give_bearings_and_its_end_has_a_name() {
    let (mut far, address) = Line::listen(&Listen::Pty).unwrap();
    let Address::Serial { device, baud } = address else { panic!("{address}") };
    let wanted = Some(0x6C1D_EBA4_1845);
    let mut live = Live::open(&Source::Uudf(device, baud), Options { emitter: wanted, ..options() }).unwrap();
    far.read();
    far.write(b"+UUDF:6C1DEBA41845,-56,-11,20,0,39,\"6C1DEBA79D14\",\"\",746675,1\r\n");
    until(&mut live, |_, bearing| bearing.is_some_and(|bearing| (degrees(&bearing) + 11.0).abs() < 1e-3));
    let other = b"+UUDF:6C1DEBA41846,-56,-11,20,0,39,\"6C1DEBA79D14\",\"\",746675,2\r\n";
    until_told(&mut live, || far.write(other), |state, bearing| bearing.is_none() && state.name() == "no_bearing");
    far.write(b"+UUDF:6C1DEBA41845,-56,999,20,0,39,\"6C1DEBA79D14\",\"\",746675,3\r\n");
    until(&mut live, |state, _| matches!(state, State::Refused(why) if why.contains("azimuth")));
    drop(far);
    until(&mut live, |state, _| matches!(state, State::Lost(_)));
}

/// Half a line before a radio was unplugged and half of one after it are no line.
#[test]
fn a_radio_that_is_plugged_in_again_begins_anew() {
    let device = std::env::temp_dir().join(format!("foxhound-radio-{}", std::process::id()));
    let plug_in = || {
        let (far, address) = Line::listen(&Listen::Pty).unwrap();
        let Address::Serial { device: real, baud } = address else { panic!("{address}") };
        std::fs::remove_file(&device).ok();
        std::os::unix::fs::symlink(real, &device).unwrap();
        (far, baud)
    };
    let line: &[u8] = b"+UUDF:6C1DEBA41845,-56,-11,20,0,39,\"6C1DEBA79D14\",\"\",746675,1\r\n";
    let (mut far, baud) = plug_in();
    let mut live = Live::open(&Source::Uudf(device.clone(), baud), options()).unwrap();
    far.read();
    far.write(line);
    until(&mut live, |_, bearing| bearing.is_some());
    far.write(&line[..23]);
    std::thread::sleep(Duration::from_millis(50));
    live.poll(NOW);
    drop(far);
    until(&mut live, |state, _| matches!(state, State::Lost(_)));
    let (mut far, _) = plug_in();
    until(&mut live, |_, _| {
        far.read();
        far.is_open()
    });
    far.write(&line[23..]);
    far.write(b"+UUDF:6C1DEBA41845,-56,25,20,0,39,\"6C1DEBA79D14\",\"\",1,1\r\n");
    let mut first = None;
    until(&mut live, |_, bearing| {
        first = first.or(bearing.map(|bearing| degrees(&bearing).round()));
        first.is_some()
    });
    assert_eq!(first, Some(25.0));
    std::fs::remove_file(&device).unwrap();
}

/// On a line each bearing has a mirror image that fits as well: half of the directions would be wrong.
#[test]
fn antennas_on_a_line_are_refused() {
    let text = "wavelength_m = 1.0\nantennas_m = [[0.0, -0.25], [0.0, 0.0], [0.0, 0.25]]\nsample_rate_hz = 1e6\ntone_hz = 250e3\n\
        [switch]\nslot_s = 4e-6\npattern = [2, 3, 1]\n";
    let array = RadioArray::parse(text).unwrap();
    for source in [Source::Heimdall("127.0.0.1".to_owned(), 1), Source::Hci("/dev/null".into(), 115_200)] {
        let refused = Live::open(&source, Options { array: Some(array.clone()), ..options() });
        let why = refused.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(why.contains("antennas_m = 3: antennas on a line"), "{source}: {why}");
    }
    let mut finder = iq::Finder::<1>::new();
    let refused = finder.begin(&array_of(&array).unwrap(), 0.0).unwrap_err();
    assert_eq!(refused.field, "antennas_m", "{refused}");
}

/// A ring of eight antennas behind a switch, as Bluetooth controllers report it.
fn ring() -> (Vec<[f64; 2]>, RadioArray) {
    let ring: Vec<[f64; 2]> =
        (0..8).map(|k| [0.5 * (TAU * f64::from(k) / 8.0).cos(), 0.5 * (TAU * f64::from(k) / 8.0).sin()]).collect();
    let text = format!(
        "wavelength_m = 1.0\nantennas_m = {ring:?}\nsample_rate_hz = 1e6\ntone_hz = 250e3\n[switch]\nslot_s = 4e-6\npattern = [2, 3, 4, 5, 6, 7, 8, 1]\n"
    );
    let array = RadioArray::parse(&text).unwrap();
    (ring, array)
}

/// An H4 packet with a report of a transmitter in this direction, with this offset of its frequency.
fn iq_report(handle: u8, azimuth: f64, offset_mhz: f64) -> Vec<u8> {
    let (ring, _) = ring();
    let mut report = vec![4, 0x3E, 103, 0x15, handle, 0, 17, 0x18, 0xFD, 0, 0, 2, 0, 1, 0, 45];
    let reference = (0..8).map(|k| (0, 4.5 + f64::from(k)));
    for (antenna, time_us) in reference.chain((0..37).map(|s: usize| ((s + 1) % 8, 15.0 + 4.0 * s as f64))) {
        let [x, y] = ring[antenna];
        let phase = TAU * (x * azimuth.cos() + y * azimuth.sin()) + TAU * (0.25 + offset_mhz) * time_us;
        report.extend([(100.0 * phase.cos()) as i8 as u8, (100.0 * phase.sin()) as i8 as u8]);
    }
    report
}

/// An H4 packet by which a controller says that it has synchronised with a periodic advertising train.
fn synchronised(handle: u8, address: u64) -> Vec<u8> {
    let mut event = vec![4, 0x3E, 16, 0x0E, 0, handle, 0, 0, 0];
    event.extend(&address.to_le_bytes()[..6]);
    event.extend([1, 80, 0, 0]);
    event
}

/// An open line of a Bluetooth controller, and its far end.
fn controller(emitter: Option<u64>) -> (Line, Live) {
    let (mut far, address) = Line::listen(&Listen::Pty).unwrap();
    let Address::Serial { device, baud } = address else { panic!("{address}") };
    let options = Options { array: Some(ring().1), emitter, ..options() };
    let live = Live::open(&Source::Hci(device, baud), options).unwrap();
    far.read();
    (far, live)
}

#[test]
fn of_two_beacons_that_send_in_turn_the_wanted_address_is_heard() {
    let (near, far_away) = (0x6C1D_EBA4_1845, 0x6C1D_EBA4_1846);
    let reports = |handles: [u8; 2]| [iq_report(handles[0], 1.2, 0.007), iq_report(handles[1], -2.0, -0.011)];
    for (wanted, azimuth) in [(near, 1.2), (far_away, -2.0)] {
        let (mut line, mut live) = controller(Some(wanted));
        // Before the controller says whose handles these are, neither is believed.
        for report in reports([1, 2]) {
            line.write(&report);
            until(&mut live, |state, bearing| {
                assert!(bearing.is_none());
                matches!(state, State::NoBearing(why) if why.contains("no known address"))
            });
        }
        // The handles change hands after a while.
        for handles in [[1, 2], [2, 1]] {
            line.write(&synchronised(handles[0], near));
            line.write(&synchronised(handles[1], far_away));
            for _ in 0..20 {
                let heard = usize::from(wanted == far_away);
                for (number, report) in reports(handles).iter().enumerate() {
                    line.write(report);
                    until(&mut live, |state, bearing| {
                        if let Some(bearing) = bearing {
                            assert!(number == heard && (bearing.azimuth_rad - azimuth).abs() < 0.02, "{bearing:?}");
                        }
                        match (number == heard, state) {
                            (true, _) => bearing.is_some(),
                            // Between two bearings of the wanted one that is nothing to speak of.
                            (false, state) => {
                                bearing.is_none() && *state == State::Hearing
                                    || matches!(state, State::NoBearing(why) if why == "another transmitter")
                            }
                        }
                    });
                }
            }
        }
        // A handle that is lost has no address.
        line.write(&[4, 0x3E, 3, 0x10, 1, 0]);
        line.write(&[4, 0x3E, 3, 0x10, 2, 0]);
        let lost = &reports([1, 2])[usize::from(wanted == far_away)];
        let tell = || line.write(lost);
        until_told(&mut live, tell, |state, bearing| {
            assert!(bearing.is_none());
            matches!(state, State::NoBearing(why) if why.contains("no known address"))
        });
    }
}

#[test]
fn a_beacon_is_wanted_by_its_handle_as_well() {
    let (mut line, mut live) = controller(Some(2));
    line.write(&iq_report(1, 1.2, 0.007));
    until(&mut live, |state, bearing| {
        bearing.is_none() && *state == State::NoBearing("another transmitter".to_owned())
    });
    line.write(&iq_report(2, -2.0, -0.011));
    until(&mut live, |_, bearing| bearing.is_some_and(|bearing| (bearing.azimuth_rad + 2.0).abs() < 0.02));
}

#[test]
fn iq_reports_over_serial_give_bearings() {
    let mut report = iq_report(1, 1.2, 0.007);
    let (mut far, mut live) = controller(None);
    far.write(&report);
    until(&mut live, |_, bearing| bearing.is_some_and(|bearing| (bearing.azimuth_rad - 1.2).abs() < 0.02));
    report[12] = 1;
    let tell = || far.write(&report);
    until_told(&mut live, tell, |state, bearing| bearing.is_none() && state.name() == "no_bearing");
    report[12] = 9;
    far.write(&report);
    until(&mut live, |state, _| matches!(state, State::Refused(why) if why.contains("Packet_Status = 9")));
}
