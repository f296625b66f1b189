use super::*;
use std::time::{Duration, Instant};

fn frame(mark: u8) -> Vec<u8> {
    let mut frame = vec![mark; 12 + 9];
    (frame[0], frame[1], frame[2]) = (0xFD, 9, 0);
    frame
}

/// Reads until so many bytes have come, for a minute at most.
fn read(line: &mut Line, count: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let begin = Instant::now();
    while bytes.len() < count && begin.elapsed() < Duration::from_secs(60) {
        bytes.extend(line.read());
        std::thread::sleep(Duration::from_millis(1));
    }
    bytes
}

fn wait(line: &mut Line) {
    let begin = Instant::now();
    while !line.is_open() && begin.elapsed() < Duration::from_secs(60) {
        assert!(line.read().is_empty());
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(line.is_open());
}

fn speaks_both_ways(listen: &str) -> (Line, Line, Address) {
    let (mut there, address) = Line::listen(&listen.parse().unwrap()).unwrap();
    let mut here = Line::open(&address).unwrap();
    wait(&mut here);
    here.write(&frame(7));
    assert_eq!(read(&mut there, 21), frame(7));
    there.write(&[frame(10), frame(13)].concat());
    assert_eq!(read(&mut here, 42), [frame(10), frame(13)].concat(), "no byte is changed on the way");
    (there, here, address)
}

#[test]
fn every_line_carries_bytes_both_ways() {
    speaks_both_ways("tcp:127.0.0.1:0");
    speaks_both_ways("udp:127.0.0.1:0");
    speaks_both_ways("pty");
}

#[test]
fn a_server_takes_one_client_after_another_and_a_client_calls_again() {
    // Nobody else listens at this address of the machine: the port can be left and taken again.
    let (mut there, here, address) = speaks_both_ways("tcp:127.0.0.2:0");
    drop(here);
    let mut next = Line::open(&address).unwrap();
    wait(&mut next);
    next.write(&frame(9));
    assert_eq!(read(&mut there, 21), frame(9));
    drop(there);
    let begin = Instant::now();
    while next.is_open() && begin.elapsed() < Duration::from_secs(60) {
        next.read();
    }
    let Address::Tcp(endpoint) = address else { unreachable!("it listens for TCP") };
    let (mut again, _) = Line::listen(&Listen::Tcp(endpoint)).unwrap();
    wait(&mut next);
    next.write(&frame(8));
    assert_eq!(read(&mut again, 21), frame(8));
}

#[test]
fn between_two_clients_that_follow_each_other_at_once_a_server_is_not_open() {
    let (mut there, here, address) = speaks_both_ways("tcp:127.0.0.1:0");
    let mut next = Line::open(&address).unwrap();
    wait(&mut next);
    drop(here);
    let begin = Instant::now();
    while there.is_open() && begin.elapsed() < Duration::from_secs(60) {
        there.read();
        there.write(&frame(5));
    }
    assert!(!there.is_open());
    next.write(&frame(9));
    assert_eq!(read(&mut there, 21), frame(9));
    assert!(there.is_open());
}

#[test]
fn a_serial_port_may_be_left_and_opened_again() {
    let (mut there, here, address) = speaks_both_ways("pty");
    drop(here);
    there.read();
    there.write(&frame(3));
    let mut here = Line::open(&address).unwrap();
    there.read();
    there.write(&frame(4));
    assert_eq!(read(&mut here, 21), frame(4), "what was said to nobody is not kept");
}

#[test]
fn a_datagram_of_a_stranger_is_not_heard() {
    let (mut there, mut here, address) = speaks_both_ways("udp:127.0.0.1:0");
    let mut stranger = Line::open(&address).unwrap();
    stranger.write(&frame(66));
    here.write(&frame(7));
    assert_eq!(read(&mut there, 21), frame(7));
    let Address::UdpOut(Endpoint { host, port }) = address else { unreachable!("it listens for UDP") };
    assert_eq!((host.as_str(), port > 0), ("127.0.0.1", true));
}

#[test]
fn where_udp_listens_the_first_that_speaks_is_heard_and_later_only_the_same_system() {
    let port = free_port("127.0.0.3");
    let mut here = Line::open(&format!("udp:127.0.0.3:{port}").parse().unwrap()).unwrap();
    assert!(here.turned().is_none() && !here.is_open());
    let at = |text: &str| Line::open(&format!("{text}:127.0.0.3:{port}").parse().unwrap()).unwrap();
    // To listen there, too, cannot be meant.
    let mut autopilot = at("udp");
    assert_eq!(autopilot.turned(), Some(format!("udpout:127.0.0.3:{port}")));
    let mut stranger = at("udpout");
    assert!(stranger.turned().is_none());
    stranger.write(b"no MAVLink");
    autopilot.write(&frame(1));
    assert_eq!(read(&mut here, 21), frame(1));
    stranger.write(&frame(66));
    std::thread::sleep(Duration::from_millis(3_200));
    assert!(here.read().is_empty(), "not while the first speaks");
    stranger.write(&frame(66));
    std::thread::sleep(Duration::from_millis(50));
    assert!(here.read().is_empty(), "nor as another system");
    let mut again = at("udpout");
    again.write(&frame(1));
    assert_eq!(read(&mut here, 21), frame(1), "it has started anew, with another port");
}

#[test]
fn an_autopilot_takes_the_place_of_a_ground_station_that_spoke_first() {
    let port = free_port("127.0.0.4");
    let mut here = Line::open(&format!("udp:127.0.0.4:{port}").parse().unwrap()).unwrap();
    let at = || Line::open(&format!("udpout:127.0.0.4:{port}").parse().unwrap()).unwrap();
    let (mut station, mut autopilot) = (at(), at());
    station.write(&frame(66));
    assert_eq!(read(&mut here, 21), frame(66));
    autopilot.write(&frame(1));
    assert_eq!(read(&mut here, 21), frame(1));
    here.write(&frame(2));
    assert_eq!(read(&mut autopilot, 21), frame(2));
    station.write(&frame(66));
    std::thread::sleep(Duration::from_millis(50));
    assert!(here.read().is_empty());
}

/// A port that was free a moment ago, of an address of this machine at which no other test listens.
fn free_port(address: &str) -> u16 {
    std::net::UdpSocket::bind((address, 0)).unwrap().local_addr().unwrap().port()
}

#[test]
fn addresses_are_read_as_people_write_them() {
    let read = |text: &str| text.parse::<Address>().unwrap();
    let at = |host: &str, port| Endpoint { host: host.to_owned(), port };
    assert_eq!(read("tcp:localhost:5760"), Address::Tcp(at("localhost", 5760)));
    assert_eq!(read("udp:0.0.0.0:14550"), Address::UdpIn(at("0.0.0.0", 14550)), "as pymavlink and MAVSDK have it");
    assert_eq!(read("udpout:10.0.0.1:14550"), Address::UdpOut(at("10.0.0.1", 14550)));
    assert_eq!(read("udpin:0.0.0.0:14550"), Address::UdpIn(at("0.0.0.0", 14550)));
    assert_eq!(read("tcp:[::1]:5760"), Address::Tcp(at("::1", 5760)));
    let by_path = "serial:/dev/serial/by-path/pci-0000:00:14.0-usb:921600";
    let device = "/dev/serial/by-path/pci-0000:00:14.0-usb".into();
    assert_eq!(read(by_path), Address::Serial { device, baud: 921_600 });
    for text in ["tcp:localhost:5760", "udpin:0.0.0.0:14550", "tcp:[::1]:5760", by_path] {
        assert_eq!(read(text).to_string(), text);
    }
}

#[test]
fn what_is_wrong_with_an_address_is_said() {
    for (text, words) in [
        ("localhost", "expected tcp:HOST:PORT"),
        ("tpc:localhost:5760", "did you mean `tcp`?"),
        ("http://localhost:80", "unknown scheme `http`"),
        ("/dev/ttyACM0", "did you mean `serial:/dev/ttyACM0:115200`?"),
        ("/dev/ttyACM0:57600", "did you mean `serial:/dev/ttyACM0:57600`?"),
        ("/dev/ttyACM0,57600", "did you mean `serial:/dev/ttyACM0:57600`?"),
        ("localhost:5760", "did you mean `tcp:localhost:5760`?"),
        ("127.0.0.1:5760", "did you mean `tcp:127.0.0.1:5760`?"),
        ("tcp://127.0.0.1:5760", "did you mean `tcp:127.0.0.1:5760`?"),
        ("udp://:14540", "did you mean `udp:0.0.0.0:14540`?"),
        ("serial:///dev/ttyACM0:57600", "did you mean `serial:/dev/ttyACM0:57600`?"),
        ("tcp:localhost", "has no port"),
        ("tcp::5760", "the host is missing"),
        ("tcp:localhost:0", "port 0 is outside 1..=65535"),
        ("udp:localhost:65536", "port 65536 is outside 1..=65535"),
        ("udpin:localhost:-1", "port `-1` is not a number"),
        ("serial:/dev/ttyUSB0", "expected serial:DEVICE:BAUD"),
        ("serial:/dev/ttyUSB0:fast", "baud rate `fast` is not a number"),
        ("serial:/dev/ttyUSB0:9", "baud rate 9 is outside"),
        ("serial::57600", "expected serial:DEVICE:BAUD"),
    ] {
        let error = text.parse::<Address>().unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
    for (text, words) in
        [("pyt", "expected tcp"), ("tcpp:localhost:1", "did you mean `tcp`?"), ("tcp:localhost", "has no port")]
    {
        let error = text.parse::<Listen>().unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn another_system_refuses_serial_ports_and_terminals_by_name() {
    let port = no_serial::Serial::open("COM3".as_ref(), 115_200).unwrap_err();
    let terminal = no_serial::Serial::pseudo_terminal().unwrap_err();
    assert!(port.to_string().starts_with("serial ports need Linux or macOS"), "{port}");
    assert!(terminal.to_string().starts_with("pty needs Linux or macOS"), "{terminal}");
}
