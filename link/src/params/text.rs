//! Texts for refused requests. Numbers have at most three decimals: the formatter of the standard library prints any
//! float to the last digit and costs 17 KB of flash.

use foxhound_core::base::error::{ConfigError, Why};
use foxhound_core::guidance::param::{Id, NAME_MAX};

use crate::CharArray;
use crate::dialect::{MavSeverity, STATUSTEXT_DATA};
use crate::framer::fill;

/// Characters of one `STATUSTEXT`.
const PIECE: usize = 50;
/// Longest text; the rest is cut off.
const TEXT_MAX: usize = 4 * PIECE - 1;
/// A number above this is shown as larger than it.
const LARGE: f32 = 1e9;

/// A request that is refused, and why.
#[derive(Clone, Copy, Debug)]
pub(super) enum Trouble {
    /// A parameter that does not exist.
    Unknown([u8; NAME_MAX]),
    /// Not a `REAL32`.
    Type(Id),
    /// The vehicle is seeking.
    Seeking(Id),
    /// Out of its range, or not a whole number.
    Refused(Id, f32, bool),
    /// It does not fit the other parameters.
    Config(Id, f32, ConfigError),
}

/// A text on its way to the station.
#[derive(Clone, Copy, Debug)]
pub(super) struct Worded {
    trouble: Trouble,
    told: u8,
}

impl Worded {
    pub(super) const fn new(trouble: Trouble) -> Self {
        Self { trouble, told: 0 }
    }

    /// The next piece of the text, and whether it is the last one. A text that fits is a single piece; a longer one
    /// ends with the first piece that is not full.
    #[inline(never)]
    pub(super) fn next_piece(&mut self) -> (STATUSTEXT_DATA, bool) {
        let text = self.trouble.text();
        let text = text.as_bytes();
        let start = usize::from(self.told) * PIECE;
        let rest = text.get(start..).unwrap_or_default();
        let piece = rest.get(..PIECE).unwrap_or(rest);
        let is_single = text.len() <= PIECE;
        let mut characters = [0; PIECE];
        fill(&mut characters, piece);
        let message = STATUSTEXT_DATA {
            severity: MavSeverity::MAV_SEVERITY_WARNING as u8,
            text: CharArray::new(characters),
            id: if is_single { 0 } else { self.trouble.number() },
            chunk_seq: self.told,
        };
        self.told += 1;
        (message, is_single || piece.len() < PIECE)
    }
}

impl Trouble {
    /// The id of a text in several pieces, different for each parameter; two texts in a row about the same one differ
    /// only in their values.
    #[inline(never)]
    fn number(&self) -> u16 {
        match self {
            Self::Unknown(_) => 1,
            Self::Type(id) | Self::Seeking(id) | Self::Refused(id, ..) | Self::Config(id, ..) => {
                0x4600 + id.index() as u16
            }
        }
    }

    #[inline(never)]
    fn text(&self) -> Text {
        let mut text = Text::default();
        match *self {
            Self::Unknown(name) => text.word("no parameter ").shown(&name),
            Self::Type(id) => text.shown(id.padded_name()).word(" refused: send REAL32"),
            Self::Seeking(id) => text.shown(id.padded_name()).word(" refused while seeking"),
            Self::Refused(id, value, is_broken) => {
                text.equation(id.padded_name(), value).word(" refused: ");
                if is_broken {
                    text.word("whole ");
                }
                text.range(id.range())
            }
            Self::Config(id, value, error) => {
                text.equation(id.padded_name(), value).word(" refused: ");
                text.equation(error.field.as_bytes(), error.value).word(" ");
                match error.why {
                    Why::NotFinite => text.word("is not finite"),
                    Why::OutOfRange { min, max } => text.word("is not ").range((min, max)),
                    Why::Inconsistent(why) => text.word(why),
                }
            }
        };
        text
    }
}

/// A text that grows.
struct Text {
    bytes: [u8; TEXT_MAX],
    length: usize,
}

impl Default for Text {
    fn default() -> Self {
        Self { bytes: [0; TEXT_MAX], length: 0 }
    }
}

impl Text {
    fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    #[inline(never)]
    fn byte(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.length) {
            *place = byte;
            self.length += 1;
        }
    }

    /// As much as can be shown.
    #[inline(never)]
    fn shown(&mut self, bytes: &[u8]) -> &mut Self {
        bytes.iter().take_while(|byte| byte.is_ascii_graphic()).for_each(|byte| self.byte(*byte));
        self
    }

    #[inline(never)]
    fn word(&mut self, word: &str) -> &mut Self {
        word.bytes().for_each(|byte| self.byte(byte));
        self
    }

    #[inline(never)]
    fn equation(&mut self, name: &[u8], value: f32) -> &mut Self {
        self.shown(name).word("=").number(value)
    }

    #[inline(never)]
    fn range(&mut self, (min, max): (f32, f32)) -> &mut Self {
        self.number(min).word(" to ").number(max)
    }

    /// A number, rounded to three decimals as the standard library rounds, without zeros at its end.
    fn number(&mut self, value: f32) -> &mut Self {
        if value.is_nan() {
            return self.word("nan");
        }
        let is_large = libm::fabsf(value) >= LARGE;
        if value.is_sign_negative() {
            self.word(if is_large { "<-" } else { "-" });
        } else if is_large {
            self.byte(b'>');
        }
        if is_large {
            return self.word("1e9");
        }
        let (mut whole, mut thousandths) = fixed_point(libm::fabsf(value));
        if thousandths == 1000 {
            (whole, thousandths) = (whole + 1, 0);
        }
        self.digits(whole, 1_000_000_000);
        if thousandths != 0 {
            self.byte(b'.');
            while thousandths != 0 {
                self.byte(b'0' + (thousandths / 100) as u8);
                thousandths = thousandths % 100 * 10;
            }
        }
        self
    }

    #[inline(never)]
    fn digits(&mut self, number: u32, mut place: u32) {
        while place > 1 && number < place {
            place /= 10;
        }
        while place > 0 {
            self.byte(b'0' + (number / place % 10) as u8);
            place /= 10;
        }
    }
}

/// The whole part and the thousandths, 1000 included, of a positive number below 2^32; half goes to even.
#[inline(never)]
fn fixed_point(value: f32) -> (u32, u32) {
    // value = mantissa / 2^shift, exactly.
    let bits = value.to_bits();
    let exponent = (bits >> 23) as i32;
    let mantissa = if exponent == 0 { bits } else { bits & 0x7F_FFFF | 0x80_0000 };
    let shift = 150 - exponent.max(1);
    if shift <= 0 {
        return (mantissa << -shift, 0);
    }
    let shift = shift as u32;
    let whole = mantissa.checked_shr(shift).unwrap_or(0);
    let rest = u64::from(mantissa - whole.checked_shl(shift).unwrap_or(0)) * 1000;
    // Below 2^34, so nothing is left of it by then.
    if shift > 40 {
        return (whole, 0);
    }
    let floor = rest >> shift;
    let beyond = rest & ((1 << shift) - 1);
    let half = 1 << (shift - 1);
    let up = beyond > half || (beyond == half && floor & 1 == 1);
    (whole, (floor + u64::from(up)) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::guidance::param::{Kind, TABLE};
    use rand_core::Rng;
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;
    use std::borrow::ToOwned;
    use std::format;
    use std::string::String;
    use std::vec::Vec;

    fn written(value: f32) -> String {
        let mut text = Text::default();
        text.number(value);
        String::from_utf8(text.as_bytes().to_owned()).unwrap()
    }

    fn expected(value: f32) -> String {
        if value.is_nan() {
            return "nan".to_owned();
        }
        if value.abs() >= LARGE {
            return if value > 0.0 { ">1e9" } else { "<-1e9" }.to_owned();
        }
        format!("{value:.3}").trim_end_matches('0').trim_end_matches('.').to_owned()
    }

    #[test]
    fn numbers_are_written_as_the_standard_library_writes_them_with_three_decimals() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(6);
        let ends = TABLE.iter().flat_map(|param| [param.min, param.max, param.default]);
        let halves = (0..4000).map(|k| k as f32 * 0.0005);
        let eighths = (0..4000).map(|k| k as f32 / 16.0 - 100.0);
        let any = (0..1_000_000).map(|_| f32::from_bits(random.next_u32()));
        let odd = [0.0, -0.0, 0.9999, 0.9995, 999_999_936.0, 1e9, 8_388_607.5, 1e-45, f32::INFINITY, -f32::INFINITY];
        for value in ends.chain(halves).chain(eighths).chain(any).chain(odd) {
            assert_eq!(written(value), expected(value), "{value:e}");
        }
        let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
        for _ in 0..1_000_000 {
            let value = (random.next_u32() as f32 / u32::MAX as f32 - 0.5)
                * [2e9, 2e4, 20.0, 0.02][random.next_u32() as usize % 4];
            assert_eq!(written(value), expected(value), "{value:e}");
        }
    }

    fn pieces(trouble: Trouble) -> Vec<(STATUSTEXT_DATA, bool)> {
        let mut worded = Worded::new(trouble);
        let mut pieces = Vec::new();
        while pieces.last().is_none_or(|(_, is_last)| !is_last) {
            pieces.push(worded.next_piece());
        }
        pieces
    }

    fn told(trouble: Trouble) -> String {
        pieces(trouble).iter().map(|(piece, _)| piece.text.to_str().unwrap()).collect()
    }

    #[test]
    fn the_refusal_of_a_range_fits_one_message_whatever_the_value() {
        for id in Id::all() {
            let (_, max) = id.range();
            let far = [-999_999_936.0, -123_456.79, f32::NAN, f32::MAX];
            let far = far.map(|value| Trouble::Refused(id, value, false));
            let between = Trouble::Refused(id, max - 0.125, true);
            let is_whole = TABLE[id.index()].kind == Kind::Whole;
            for trouble in far.into_iter().chain(is_whole.then_some(between)) {
                let told = told(trouble);
                assert!(told.len() <= PIECE, "{told}");
                assert_eq!((pieces(trouble).len(), pieces(trouble)[0].0.id), (1, 0));
            }
        }
        let id = Id::named(b"FH_SPD_MAX").unwrap();
        assert_eq!(told(Trouble::Refused(id, 99.0, false)), "FH_SPD_MAX=99 refused: 0.05 to 20");
        assert_eq!(told(Trouble::Refused(id, f32::NAN, false)), "FH_SPD_MAX=nan refused: 0.05 to 20");
        let id = Id::named(b"FH_RC_CH").unwrap();
        assert_eq!(told(Trouble::Refused(id, 7.5, true)), "FH_RC_CH=7.5 refused: whole 0 to 18");
        assert_eq!(told(Trouble::Type(id)), "FH_RC_CH refused: send REAL32");
        assert_eq!(told(Trouble::Seeking(id)), "FH_RC_CH refused while seeking");
        assert_eq!(told(Trouble::Unknown(*b"SIXTEEN_LETTERS_")), "no parameter SIXTEEN_LETTERS_");
        assert_eq!(told(Trouble::Unknown(*b"A\nB\0\0\0\0\0\0\0\0\0\0\0\0\0")), "no parameter A");
    }

    #[test]
    fn a_long_text_comes_in_pieces_that_end_with_one_that_is_not_full() {
        let id = Id::named(b"FH_ARR_SIDE").unwrap();
        for length in 0..300 {
            let why: String = ('a'..='z').cycle().take(length).collect();
            let why: &'static str = why.leak();
            let trouble =
                Trouble::Config(id, 0.2, ConfigError { field: "side_m", value: 0.2, why: Why::Inconsistent(why) });
            let pieces = pieces(trouble);
            let whole = format!("FH_ARR_SIDE=0.2 refused: side_m=0.2 {why}");
            assert!(whole.starts_with(&told(trouble)));
            assert_eq!(told(trouble).len(), whole.len().min(TEXT_MAX));
            for (number, (piece, is_last)) in pieces.iter().enumerate() {
                let is_full = piece.text.to_str().unwrap().len() == PIECE;
                assert_eq!(usize::from(piece.chunk_seq), number);
                assert_eq!(piece.id == 0, whole.len() <= PIECE);
                assert!(is_full != *is_last || whole.len() == PIECE);
            }
        }
    }
}
