//! System tests of the link, from outside: real bytes in, real bytes out.
#![expect(clippy::expect_used, clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod behaviour;
mod bench;
mod dialect;
mod noise;
mod recorded;
