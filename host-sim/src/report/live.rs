//! The report of a flight under way: the same page, served to browsers on this machine only, and the records as they are
//! made.
//!
//! | asked for | answered |
//! |---|---|
//! | `/` | the page, without records; its script `page/live.js` fetches them |
//! | `/records?from=N` | the records from the `N`th on, a line of JSON each; none where there are no more yet |
//!
//! A page asks ten times a second until it has the last record. So a browser that comes late has the whole flight so far, and
//! one that falls behind misses nothing. Whoever asks by another name than that of this machine is refused: a foreign page
//! could have its own name lead here.

use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use tiny_http::{Header, Method, Request, Response, Server};

use super::Contact;
use crate::input::InputError;

/// Browsers that are answered at the same time.
const WORKERS: usize = 4;
/// How long the last records are offered after everybody has been told to stop: some rounds of a page's questions.
const GRACE: Duration = Duration::from_millis(500);
const PAGE: &str = "text/html; charset=utf-8";
const LINES: &str = "application/x-ndjson";
const TEXT: &str = "text/plain; charset=utf-8";

/// A served flight. Its last owner ends the service.
pub struct Live {
    server: Arc<Server>,
    records: Arc<Mutex<Vec<String>>>,
    port: u16,
}

impl Live {
    /// Serves at a port of this machine; 0 is any that is free.
    ///
    /// # Errors
    /// The port is taken, or not ours to take.
    pub fn open(port: u16) -> Result<Self, InputError> {
        let refused = |error: &io::Error| {
            let why = match error.kind() {
                io::ErrorKind::AddrInUse => {
                    "is taken by another program; give another, or 0 for any that is free".to_owned()
                }
                io::ErrorKind::PermissionDenied => {
                    "is not for everybody; give one above 1023, or 0 for any that is free".to_owned()
                }
                _ => format!("cannot be served at: {error}"),
            };
            InputError::new(format!("--port {port}: it {why}"))
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(|error| refused(&error))?;
        let port = listener.local_addr().map_err(|error| refused(&error))?.port();
        let server = Server::from_listener(listener, None)
            .map_err(|error| InputError::new(format!("--port {port}: {error}")))?;
        let (server, records) = (Arc::new(server), Arc::default());
        for _ in 0..WORKERS {
            let (server, records) = (Arc::clone(&server), Arc::clone(&records));
            thread::spawn(move || {
                while let Ok(request) = server.recv() {
                    answer(request, port, &records);
                }
            });
        }
        Ok(Self { server, records, port })
    }

    /// Where the page is.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Offers the records that are new among all those so far.
    pub fn show(&self, lines: &[String]) {
        let mut records = hold(&self.records);
        let known = records.len().min(lines.len());
        records.extend_from_slice(&lines[known..]);
    }

    /// Goes on serving until told to stop; for a moment longer where that was before.
    pub fn linger(&self, stop: &AtomicBool) {
        let since = Instant::now();
        while !stop.load(Ordering::Relaxed) || since.elapsed() < GRACE {
            thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        for _ in 0..WORKERS {
            self.server.unblock();
        }
    }
}

/// A list of lines is whole whoever left it.
fn hold(records: &Mutex<Vec<String>>) -> MutexGuard<'_, Vec<String>> {
    records.lock().unwrap_or_else(PoisonError::into_inner)
}

fn answer(request: Request, port: u16, records: &Mutex<Vec<String>>) {
    let is_host = |header: &&Header| header.field.equiv("Host");
    let host = request.headers().iter().find(is_host).map(|header| header.value.as_str());
    let ours = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let (path, query) = request.url().split_once('?').unwrap_or((request.url(), ""));
    let (status, kind, body) = if !host.is_some_and(|host| ours.iter().any(|name| name == host)) {
        (403, TEXT, "this page is for browsers on this machine\n".to_owned())
    } else if !matches!(request.method(), Method::Get | Method::Head) {
        (405, TEXT, "there is nothing here but to be read\n".to_owned())
    } else {
        match (path, query.strip_prefix("from=").map(str::parse::<usize>)) {
            ("/", _) => (200, PAGE, super::page_of(&[], Contact::Live)),
            ("/records", Some(Ok(from))) => (200, LINES, lines_from(&hold(records), from)),
            ("/records", _) => (400, TEXT, "expected /records?from=N\n".to_owned()),
            _ => (404, TEXT, "there are / and /records?from=N\n".to_owned()),
        }
    };
    let mut response = Response::from_string(body).with_status_code(status);
    let headers = [("Content-Type", kind), ("Cache-Control", "no-store"), ("X-Content-Type-Options", "nosniff")];
    for (name, value) in headers {
        if let Ok(header) = Header::from_bytes(name, value) {
            response.add_header(header);
        }
    }
    // Who asked may have gone.
    let _ = request.respond(response);
}

fn lines_from(records: &[String], from: usize) -> String {
    let mut text = String::new();
    for line in records.iter().skip(from) {
        text.push_str(line);
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};
    use std::net::TcpStream;

    use super::*;

    /// What is answered to a request, head and body.
    fn ask(live: &Live, request: &str) -> (String, String) {
        let mut stream = TcpStream::connect(("127.0.0.1", live.port)).unwrap();
        write!(stream, "{request}\r\nConnection: close\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        (head.to_owned(), body.to_owned())
    }

    fn get(live: &Live, path: &str) -> (String, String) {
        ask(live, &format!("GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{}", live.port))
    }

    fn lines(numbers: std::ops::Range<u32>) -> Vec<String> {
        numbers.map(|number| format!("{{\"number\":{number}}}")).collect()
    }

    #[test]
    fn whoever_asks_is_told_the_records_that_he_has_not() {
        let live = Live::open(0).unwrap();
        assert_eq!(get(&live, "/records?from=0").1, "");
        live.show(&lines(0..3));
        live.show(&lines(0..5));
        live.show(&lines(0..5));
        let (head, body) = get(&live, "/records?from=0");
        assert!(head.starts_with("HTTP/1.1 200") && head.contains("Content-Type: application/x-ndjson"), "{head}");
        assert_eq!(body.lines().collect::<Vec<_>>(), lines(0..5));
        assert_eq!(get(&live, "/records?from=3").1.lines().collect::<Vec<_>>(), lines(3..5));
        assert_eq!(get(&live, "/records?from=5").1, "");
        assert_eq!(get(&live, "/records?from=99999999999").1, "");
    }

    #[test]
    fn the_page_may_ask_the_one_that_it_came_from_and_nobody_else() {
        let live = Live::open(0).unwrap();
        let (head, body) = get(&live, "/");
        assert!(head.starts_with("HTTP/1.1 200") && head.contains("Content-Type: text/html"), "{head}");
        assert!(body.contains("default-src 'none';") && body.contains("connect-src 'self'"));
    }

    #[test]
    fn what_is_not_there_is_refused_and_so_is_whoever_comes_by_another_name() {
        let live = Live::open(0).unwrap();
        for (path, status) in
            [("/records", "400"), ("/records?from=-1", "400"), ("/records?from=", "400"), ("/x", "404")]
        {
            let (head, _) = get(&live, path);
            assert!(head.starts_with(&format!("HTTP/1.1 {status}")), "{path}: {head}");
        }
        let by_name = |name: &str| ask(&live, &format!("GET / HTTP/1.1\r\nHost: {name}:{}", live.port)).0;
        assert!(by_name("localhost").starts_with("HTTP/1.1 200"));
        assert!(by_name("a.foreign.example").starts_with("HTTP/1.1 403"));
        let (head, _) = ask(&live, &format!("DELETE / HTTP/1.1\r\nHost: 127.0.0.1:{}", live.port));
        assert!(head.starts_with("HTTP/1.1 405"), "{head}");
    }

    #[test]
    fn a_port_that_is_taken_is_refused_by_its_number_and_one_that_is_left_is_free_again() {
        let live = Live::open(0).unwrap();
        let port = live.port;
        assert_eq!(live.address(), format!("http://127.0.0.1:{port}/"));
        let error = Live::open(port).err().unwrap().to_string();
        assert!(error.starts_with(&format!("--port {port}: it is taken by another program")), "{error}");
    }

    #[test]
    fn the_last_records_are_offered_for_a_moment_after_the_stop() {
        let live = Live::open(0).unwrap();
        let (stop, since) = (AtomicBool::new(true), Instant::now());
        live.linger(&stop);
        assert!(since.elapsed() >= GRACE);
    }
}
