//! The checksum of a frame: CRC-16/MCRF4XX, which the protocol calls X.25.
//!
//! Our own, because of every byte that we hear this is what takes longest: 6 instructions a byte in fours, where the function
//! of `mavlink-core`, which the tests compare, takes 9.

/// The remainders of all bytes.
static TABLE: [u16; 256] = table();

const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut sum = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            sum = if sum & 1 == 0 { sum >> 1 } else { sum >> 1 ^ 0x8408 };
            bit += 1;
        }
        table[byte] = sum;
        byte += 1;
    }
    table
}

/// Of these bytes, and of the one behind them that fixes the message's layout.
#[inline(never)]
pub(crate) fn checksum(bytes: &[u8], extra: u8) -> u16 {
    let (fours, rest) = bytes.as_chunks();
    let sum = fours.iter().fold(0xFFFF, |sum, &[a, b, c, d]| step(step(step(step(sum, a), b), c), d));
    let sum = rest.iter().fold(sum, |sum, byte| step(sum, *byte));
    step(sum, extra) as u16
}

/// In 32 bits, of which the upper half stays zero: nothing is to be cut off after each step.
#[inline(always)]
fn step(sum: u32, byte: u8) -> u32 {
    let index = (sum as u8 ^ byte) as usize;
    sum >> 8 ^ u32::from(TABLE[index])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_mavlink_core_and_of_the_catalogue() {
        // The check value of CRC-16/MCRF4XX is that of the digits 1 to 9.
        assert_eq!(checksum(b"12345678", b'9'), 0x6F91);
        let bytes: std::vec::Vec<u8> = (0..270_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        for length in 0..bytes.len() {
            let extra = (length * 7) as u8;
            assert_eq!(
                checksum(&bytes[..length], extra),
                mavlink_core::calculate_crc(&bytes[..length], extra),
                "{length}"
            );
        }
    }
}
