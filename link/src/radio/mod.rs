//! Readers for what direction-finding radios send over a serial line. Bytes go in, measurements come out: no heap, no
//! clock, no IO.
//!
//! | module | what it reads |
//! |---|---|
//! | [`hci`] | Bluetooth IQ reports of an antenna array behind a switch, as HCI events in H4 framing |
//! | [`uudf`] | angles of u-blox modules, as `+UUDF` lines |

pub mod hci;
pub mod uudf;
