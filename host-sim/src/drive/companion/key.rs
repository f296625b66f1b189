//! The key with which everybody on the link signs.

use std::time::{SystemTime, UNIX_EPOCH};

use foxhound_core::base::time::Instant;
use foxhound_link::signing::{Key, Signing};

use crate::scenario::input::InputError;

/// The link by which the driver signs; the computer signs by the first one.
pub(super) const DRIVER: u8 = 1;

/// Reads a key file: 32 bytes, two hexadecimal digits each, not all of them zero.
///
/// # Errors
/// What is wrong with it, without any of its contents.
pub fn parse_key(text: &str) -> Result<Key, InputError> {
    let digits: Vec<u32> = text.trim().chars().map_while(|digit| digit.to_digit(16)).collect();
    let bytes: Vec<u8> = digits.as_chunks().0.iter().map(|[high, low]| (high * 16 + low) as u8).collect();
    let is_whole = digits.len() == 64 && text.trim().len() == 64;
    let key = <[u8; 32]>::try_from(bytes).ok().filter(|_| is_whole).and_then(Key::new);
    key.ok_or_else(|| InputError::new("expected 64 hexadecimal digits, not all of them 0"))
}

/// Signs from now on, with the time of day, where it is `now` for whoever asks.
#[must_use]
pub fn signing(key: &Key, link_id: u8, now: Instant) -> Signing {
    let mut signing = Signing::new(key.clone(), link_id);
    let unix_us = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_micros() as u64);
    signing.set_clock(now, unix_us);
    signing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_64_digits_and_an_error_tells_none_of_them() {
        let digits = "00112233445566778899aabbccddeeffFF0123456789abcdef0123456789abcd";
        let key = parse_key(&format!("  {digits}\n")).unwrap();
        assert_eq!((key.secret()[1], key.secret()[16], key.secret()[31]), (0x11, 0xFF, 0xCD));
        let zeros = "0".repeat(64);
        for text in [
            "",
            &digits[1..],
            &digits[2..],
            &format!("{digits}0"),
            &format!("{digits} 00"),
            &zeros,
            &digits.replace('8', "x"),
        ] {
            let error = parse_key(text).unwrap_err().to_string();
            assert!(error.contains("64 hexadecimal digits") && !error.contains("22"), "{error}");
        }
    }
}
