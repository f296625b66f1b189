//! A `KrakenSDR`'s directions: `DOA_value.html`, lines of comma-separated values, one for each frequency that it receives.
//!
//! Fields: time (ms), bearing (degrees clockwise from the array's zero, as a compass has it), confidence, power, frequency (Hz), array, latency,
//! station, latitude, longitude, heading twice, `GPS`, four reserved, then the spectrum over the circle, which is counter-clockwise. From March 2023
//! to July 2024 the software wrote the bearing counter-clockwise as well: a line whose spectrum says so is refused. The software rewrites the file in
//! place, so a line may be incomplete: it is skipped. A line with the same time as the previous one is not a new bearing, nor is the first after
//! the start or a failure: nobody knows how long it has been there.
//!
//! The time is when the last sample came, and the latency (ms) how long the samples took, without the processing. Where the software runs on this
//! computer a bearing belongs to the middle of the samples. Elsewhere its clock need not be ours: there it is as old as the latency and the time
//! since the file was requested, and the processing is left out.

use std::io::{Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant, SystemTime};

use super::{Event, Measurement};

const PERIOD: Duration = Duration::from_millis(100);
const TIMEOUT: Duration = Duration::from_secs(2);
const AGAIN: Duration = Duration::from_secs(1);
/// Longest response: sixteen lines with a spectrum each.
const ANSWER_MAX: u64 = 1 << 18;
/// Largest difference from the wanted frequency.
const NEAR_HZ: f64 = 5e3;
/// Largest latency that is believed.
const LATENCY_MAX_MS: f64 = 60_000.0;
/// Longer than it takes to process the samples.
const CLOCKS_APART: Duration = Duration::from_secs(60);
/// Fields before the spectrum.
const FIELDS: usize = 17;
/// Largest difference between a direction and the spectrum's highest place, which is at whole degrees.
const PEAK_DEG: f64 = 2.0;

pub(super) fn start(host: &str, port: u16, frequency_hz: Option<u64>) -> Receiver<Event> {
    let (sender, receiver) = channel();
    let host = host.to_owned();
    std::thread::spawn(move || run(&host, port, frequency_hz, &sender));
    receiver
}

/// Requests the file again and again until the receiver is dropped.
fn run(host: &str, port: u16, frequency_hz: Option<u64>, sender: &Sender<Event>) {
    let mut last_ms = None;
    let is_here = (host, port).to_socket_addrs().is_ok_and(|mut all| all.all(|address| address.ip().is_loopback()));
    loop {
        // The answer is no newer than the request.
        let asked = Instant::now();
        let clock = is_here.then(SystemTime::now);
        let (event, pause) = match get(host, port) {
            Ok(body) => (newest(&body, frequency_hz, &mut last_ms, asked, clock), PERIOD),
            Err(why) => {
                last_ms = None;
                (Some(Event::Lost(why)), AGAIN)
            }
        };
        let is_gone = event.is_some_and(|event| sender.send(event).is_err());
        if is_gone {
            return;
        }
        std::thread::sleep(pause);
    }
}

fn get(host: &str, port: u16) -> Result<String, String> {
    let failed = |error: std::io::Error| format!("http://{host}:{port}: {error}");
    let address = (host, port).to_socket_addrs().map_err(failed)?.next();
    let address = address.ok_or_else(|| format!("{host}: no such host"))?;
    let mut stream = TcpStream::connect_timeout(&address, TIMEOUT).map_err(failed)?;
    stream.set_read_timeout(Some(TIMEOUT)).map_err(failed)?;
    stream.set_write_timeout(Some(TIMEOUT)).map_err(failed)?;
    // HTTP 1.0: the response is not chunked, and ends with the connection.
    let request = format!("GET /DOA_value.html HTTP/1.0\r\nHost: {host}\r\n\r\n");
    stream.write_all(request.as_bytes()).map_err(failed)?;
    let mut bytes = Vec::new();
    stream.take(ANSWER_MAX).read_to_end(&mut bytes).map_err(failed)?;
    let text = String::from_utf8_lossy(&bytes);
    let (head, body) = text.split_once("\r\n\r\n").ok_or_else(|| format!("http://{host}:{port}: no HTTP answer"))?;
    match head.split_whitespace().nth(1) {
        Some("200") => Ok(body.to_owned()),
        status => Err(format!("http://{host}:{port}/DOA_value.html: status {}", status.unwrap_or("missing"))),
    }
}

/// The bearing of the wanted frequency, or of the first line; `None` if it is the previous one again, or the first. With the clock that the
/// lines' times are of, if it is known.
pub(super) fn newest(
    body: &str,
    frequency_hz: Option<u64>,
    last_ms: &mut Option<u64>,
    now: Instant,
    clock: Option<SystemTime>,
) -> Option<Event> {
    let lines: Vec<&str> = body.lines().filter(|line| !line.trim().is_empty()).collect();
    let mut torn = None;
    for line in &lines {
        match read(line) {
            Ok(read) if frequency_hz.is_some_and(|wanted| (read.frequency_hz - wanted as f64).abs() > NEAR_HZ) => {}
            Ok(read) => {
                let before_ms = last_ms.replace(read.time_ms);
                if before_ms.is_none_or(|before_ms| before_ms == read.time_ms) {
                    return None;
                }
                let azimuth_rad = read.bearing_deg.to_radians() as f32;
                // Behind a tunnel it may be another computer's clock after all.
                let written = SystemTime::UNIX_EPOCH + Duration::from_millis(read.time_ms);
                let since = clock.and_then(|clock| clock.duration_since(written).ok());
                let since = since.filter(|since| *since < CLOCKS_APART);
                let age = since.map_or(read.latency, |since| since + read.latency / 2);
                let at = now.checked_sub(age).unwrap_or(now);
                return Some(Event::Measured(Measurement::plain(at, azimuth_rad, None)));
            }
            Err(why) if frequency_hz.is_none() => return Some(Event::Refused(why)),
            Err(why) => torn = Some(Event::Refused(why)),
        }
    }
    Some(torn.unwrap_or_else(|| Event::Nothing("no line of this frequency".to_owned())))
}

struct Line {
    time_ms: u64,
    bearing_deg: f64,
    frequency_hz: f64,
    latency: Duration,
}

fn read(line: &str) -> Result<Line, String> {
    let fields: Vec<&str> = line.split(',').map(str::trim).collect();
    if fields.len() < FIELDS {
        return Err(format!("{} fields of at least {FIELDS}", fields.len()));
    }
    if fields[12] != "GPS" {
        return Err(format!("field 13 is `{}`, not GPS", fields[12].chars().take(20).collect::<String>()));
    }
    let number = |at: usize, name: &str, least: f64, most: f64| {
        let value: f64 = fields[at].parse().map_err(|_| format!("{name} is no number"))?;
        if (least..=most).contains(&value) {
            Ok(value)
        } else {
            Err(format!("{name} = {value} is outside {least}..={most}"))
        }
    };
    let bearing_deg = number(1, "bearing", 0.0, 360.0)?;
    if is_counterclockwise(bearing_deg, &fields[FIELDS..]) {
        return Err("the bearing is counter-clockwise: the KrakenSDR's software is older than July 2024".to_owned());
    }
    Ok(Line {
        time_ms: fields[0].parse().map_err(|_| "time is no number".to_owned())?,
        bearing_deg,
        frequency_hz: number(4, "frequency", 0.0, 1e11)?,
        latency: Duration::from_secs_f64(1e-3 * number(6, "latency", 0.0, LATENCY_MAX_MS)?),
    })
}

/// Whether a bearing has the sense of the spectrum, and is not its mirror image.
fn is_counterclockwise(bearing_deg: f64, spectrum: &[&str]) -> bool {
    if spectrum.len() != 360 {
        return false;
    }
    let value = |text: &&str| text.parse::<f64>().unwrap_or(f64::NEG_INFINITY);
    let Some(highest) = spectrum.iter().map(value).enumerate().max_by(|a, b| a.1.total_cmp(&b.1)) else { return false };
    let off_deg = |direction_deg: f64| (bearing_deg - direction_deg + 180.0).rem_euclid(360.0) - 180.0;
    let peak_deg = highest.0 as f64;
    off_deg(peak_deg).abs() <= PEAK_DEG && off_deg(-peak_deg).abs() > PEAK_DEG
}
