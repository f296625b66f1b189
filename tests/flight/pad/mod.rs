//! The pad detector over thousands of pictures, beside `OpenCV` on the same ones; the signs; bad frames; the command.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod beside;
mod command;
mod frames;
