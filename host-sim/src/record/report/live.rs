//! The live report: the same page during the flight, served only to browsers on this machine, with the records as
//! they are made.
//!
//! | request | answer |
//! |---|---|
//! | `/` | the page, without records; its script `page/live.js` fetches them |
//! | `/records?from=N` | the records from the `N`th on, one line of JSON each; `None` if there are no more yet |
//!
//! A page asks ten times a second until it has the last record. So a browser that comes late gets the whole flight so
//! far, and one that falls behind misses nothing. A request with another host name than this machine's is refused: a
//! foreign page could point its own name here.
//!
//! A client must not affect the flight, whatever it sends and however slowly it reads. The pages are served by a
//! thread of a lower priority; it waits for no other thread, and none waits for it: the flight passes its records on
//! by an unbounded channel. Only GET is answered, once per connection, and no body is read. The limits of a
//! connection:
//!
//! | resource | limit |
//! |---|---|
//! | open connections; more wait to be accepted | [`CONNECTIONS`] |
//! | bytes of the head of a request | [`HEAD_BYTES`] |
//! | headers | [`HEADERS`] |
//! | time until the head has arrived | [`HEAD_TIME`] |
//! | time until the answer has been read | [`LIFE`] |
//! | bytes of the answer that are copied before they are read | [`CHUNK_BYTES`] |

use std::cell::RefCell;
use std::convert::Infallible;
use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::pin::Pin;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::task::{Context, Poll};
use std::thread;
use std::time::{Duration, Instant};

use hyper::body::{Body, Bytes, Frame, SizeHint};
use hyper::header::{CACHE_CONTROL, CONTENT_TYPE, HOST, HeaderValue, X_CONTENT_TYPE_OPTIONS};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::TcpStream;
use tokio::runtime::{self, Runtime};
use tokio::task::{JoinSet, LocalSet};
use tokio::time::{sleep, timeout};

use super::Contact;
use super::record::Record;
use crate::scenario::input::InputError;

/// Largest number of open connections.
const CONNECTIONS: usize = 128;
const HEAD_BYTES: usize = 8 * 1024;
const HEADERS: usize = 32;
const HEAD_TIME: Duration = Duration::from_secs(2);
const LIFE: Duration = Duration::from_secs(10);
const CHUNK_BYTES: usize = 16 * 1024;
/// How often the server checks whether it is still needed.
const ROUND: Duration = Duration::from_millis(100);
/// How long the last records are offered after the end: some requests of a page.
const GRACE: Duration = Duration::from_millis(500);
const PAGE: &str = "text/html; charset=utf-8";
const LINES: &str = "application/x-ndjson";
const TEXT: &str = "text/plain; charset=utf-8";

/// A served flight. The service ends when it is dropped.
pub struct Live {
    records: Sender<String>,
    port: u16,
}

impl Live {
    /// Serves at a port of this machine; 0 for any free one.
    ///
    /// # Errors
    /// The port is taken, or needs privileges.
    pub fn open(port: u16) -> Result<Self, InputError> {
        let refused = |error: io::Error| {
            let why = match error.kind() {
                io::ErrorKind::AddrInUse => {
                    "is taken by another program; use another, or 0 for any free one".to_owned()
                }
                io::ErrorKind::PermissionDenied => {
                    "needs privileges; use one above 1023, or 0 for any free one".to_owned()
                }
                _ => format!("cannot be served at: {error}"),
            };
            InputError::new(format!("--port {port}: {why}"))
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(refused)?;
        let port = listener.local_addr().map_err(refused)?.port();
        listener.set_nonblocking(true).map_err(refused)?;
        let runtime = runtime::Builder::new_current_thread().enable_io().enable_time().build().map_err(refused)?;
        let (records, new) = mpsc::channel();
        let served = Served { port, page: Bytes::from(super::page_of("", Contact::Live)), new, lines: Vec::new() };
        let name = "live".to_owned();
        thread::Builder::new().name(name).spawn(move || serve(&runtime, listener, served)).map_err(refused)?;
        Ok(Self { records, port })
    }

    /// Address of the page.
    #[must_use]
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Offers a record.
    pub fn show(&self, record: &Record) {
        // Numbers, text and lists of them always have a JSON form.
        serde_json::to_string(record).into_iter().for_each(|line| self.send(line));
    }

    fn send(&self, line: String) {
        // If the server has ended nothing is shown, and the flight continues.
        let _ = self.records.send(line);
    }

    /// Keeps serving until it is stopped; for a moment longer if that was before.
    pub fn linger(&self, stop: &AtomicBool) {
        let since = Instant::now();
        while !stop.load(Ordering::Relaxed) || since.elapsed() < GRACE {
            thread::sleep(Duration::from_millis(20));
        }
    }
}

/// The records to be served.
struct Served {
    port: u16,
    page: Bytes,
    new: Receiver<String>,
    lines: Vec<String>,
}

impl Served {
    /// Takes new records; false when there will be no more, and serving ends.
    fn follow(&mut self) -> bool {
        loop {
            match self.new.try_recv() {
                Ok(line) => self.lines.push(line),
                Err(TryRecvError::Empty) => return true,
                Err(TryRecvError::Disconnected) => return false,
            }
        }
    }
}

/// Serves as long as the flight has its [`Live`].
fn serve(runtime: &Runtime, listener: TcpListener, served: Served) {
    // Of this thread alone; on other systems it would be that of the whole process.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::setpriority_process(None, 10);
    let served = Rc::new(RefCell::new(served));
    LocalSet::new().block_on(runtime, async {
        let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
        let mut connections = JoinSet::new();
        while served.borrow_mut().follow() {
            while connections.try_join_next().is_some() {}
            if connections.len() >= CONNECTIONS {
                let _ = timeout(ROUND, connections.join_next()).await;
                continue;
            }
            match timeout(ROUND, listener.accept()).await {
                Ok(Ok((stream, _))) => {
                    connections.spawn_local(converse(stream, Rc::clone(&served)));
                }
                // Too many files are open, say.
                Ok(Err(_)) => sleep(ROUND).await,
                Err(_) => {}
            }
        }
    });
}

/// Answers the one request of a connection.
async fn converse(stream: TcpStream, served: Rc<RefCell<Served>>) {
    let service = service_fn(|request: Request<_>| {
        let response = answer(&request, &served);
        async { Ok::<_, Infallible>(response) }
    });
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEAD_TIME).max_buf_size(HEAD_BYTES).max_headers(HEADERS);
    let connection = builder.keep_alive(false).serve_connection(TokioIo::new(stream), service);
    // The client may have gone, may have sent nonsense, or may not read.
    let _ = timeout(LIFE, connection).await;
}

fn answer<B>(request: &Request<B>, served: &Rc<RefCell<Served>>) -> Response<Answer> {
    let port = served.borrow().port;
    let host = request.headers().get(HOST).map(HeaderValue::as_bytes);
    let ours = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let (path, query) = (request.uri().path(), request.uri().query().unwrap_or_default());
    let text = |status, text: &'static str| (status, TEXT, Answer::Whole(Bytes::from_static(text.as_bytes())));
    let (status, kind, body) = if !host.is_some_and(|host| ours.iter().any(|name| name.as_bytes() == host)) {
        text(StatusCode::FORBIDDEN, "this page is for browsers on this machine\n")
    } else if request.method() != Method::GET {
        text(StatusCode::METHOD_NOT_ALLOWED, "only GET is supported\n")
    } else {
        match (path, query.strip_prefix("from=").map(str::parse::<usize>)) {
            ("/", _) => (StatusCode::OK, PAGE, Answer::Whole(served.borrow().page.clone())),
            ("/records", Some(Ok(from))) => (StatusCode::OK, LINES, Answer::lines(served, from)),
            ("/records", _) => text(StatusCode::BAD_REQUEST, "expected /records?from=N\n"),
            _ => text(StatusCode::NOT_FOUND, "use / or /records?from=N\n"),
        }
    };
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    response
}

/// The body of an answer. Records are copied as they are read, so that a slow client costs no more than a fast one.
enum Answer {
    Whole(Bytes),
    Lines { served: Rc<RefCell<Served>>, next: usize, end: usize, left_bytes: u64 },
}

impl Answer {
    /// The records so far, from one of them on.
    fn lines(served: &Rc<RefCell<Served>>, from: usize) -> Self {
        let mut all = served.borrow_mut();
        all.follow();
        let left_bytes = all.lines.iter().skip(from).map(|line| line.len() as u64 + 1).sum();
        Self::Lines { served: Rc::clone(served), next: from, end: all.lines.len(), left_bytes }
    }
}

impl Body for Answer {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        let chunk = match self.get_mut() {
            Self::Whole(bytes) => std::mem::take(bytes),
            Self::Lines { served, next, end, left_bytes } => {
                let mut chunk = Vec::new();
                for line in served.borrow().lines.get(*next..*end).unwrap_or_default() {
                    if chunk.len() >= CHUNK_BYTES {
                        break;
                    }
                    chunk.extend_from_slice(line.as_bytes());
                    chunk.push(b'\n');
                    *next += 1;
                }
                *left_bytes -= chunk.len() as u64;
                Bytes::from(chunk)
            }
        };
        Poll::Ready((!chunk.is_empty()).then(|| Ok(Frame::data(chunk))))
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(match self {
            Self::Whole(bytes) => bytes.len() as u64,
            Self::Lines { left_bytes, .. } => *left_bytes,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};
    use std::net::TcpStream;

    use super::*;

    /// The answer to a request, head and body.
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
        lines(0..5).into_iter().for_each(|line| live.send(line));
        let (head, body) = get(&live, "/records?from=0");
        assert!(head.starts_with("HTTP/1.1 200") && head.contains("content-type: application/x-ndjson"), "{head}");
        assert_eq!(body.lines().collect::<Vec<_>>(), lines(0..5));
        assert_eq!(get(&live, "/records?from=3").1.lines().collect::<Vec<_>>(), lines(3..5));
        assert_eq!(get(&live, "/records?from=5").1, "");
        assert_eq!(get(&live, "/records?from=99999999999").1, "");
    }

    #[test]
    fn the_page_may_ask_the_one_that_it_came_from_and_nobody_else() {
        let live = Live::open(0).unwrap();
        let (head, body) = get(&live, "/");
        assert!(head.starts_with("HTTP/1.1 200") && head.contains("content-type: text/html"), "{head}");
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
        assert!(error.starts_with(&format!("--port {port}: is taken by another program")), "{error}");
    }

    #[test]
    fn the_last_records_are_offered_for_a_moment_after_the_stop() {
        let live = Live::open(0).unwrap();
        let (stop, since) = (AtomicBool::new(true), Instant::now());
        live.linger(&stop);
        assert!(since.elapsed() >= GRACE);
    }
}
