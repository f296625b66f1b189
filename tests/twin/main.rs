//! The firmware images do the same as the desktop, in QEMU and in an emulator of the NUCLEO-G474RE.

mod faults;
mod g474;
mod image;
mod landing;
mod orphan;
mod port;
mod store;
