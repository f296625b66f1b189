//! Detects converters that have stopped.
//!
//! A converter or its DMA that has stopped leaves the same samples as before, which look like a frame: one channel of
//! an old block among three new ones gives an arbitrary bearing. Noise never repeats itself. So if a channel's
//! samples are those of the frame before, and are not all equal (then the channel is dead, and the chain goes on
//! without it), the frame counts as missing.
//!
//! Every twelfth sample of a channel is used: 22 of 256, as a polynomial in 32 bits. Two frames of a working receiver
//! have the same value once in 4 10^9, and the same samples only if the noise is far below one step.

use foxhound_core::base::adc::{AdcFrame, CHANNELS};

/// One in this many samples is used.
const STRIDE: usize = 12;
/// Odd, so that no sample is multiplied to zero.
const FACTOR: u32 = 0x9e37_79b1;

/// The marks of the frame before.
#[derive(Clone, Copy, Debug, Default)]
pub struct Watch {
    /// Zero: all samples equal, or unknown.
    marks: [u32; CHANNELS],
    frames: u32,
}

impl Watch {
    /// Before the first frame.
    #[must_use]
    pub const fn new() -> Self {
        Self { marks: [0; CHANNELS], frames: 0 }
    }

    /// The first channel, 0..4, that stands still.
    #[inline(never)]
    pub fn look<const N: usize>(&mut self, snapshot: &AdcFrame<N>) -> Option<usize> {
        let mut frozen = None;
        for (channel, (row, last)) in snapshot.codes.iter().zip(&mut self.marks).enumerate().rev() {
            let mark = mark(row);
            if mark != 0 && mark == *last {
                frozen = Some(channel);
            }
            *last = mark;
        }
        self.frames = self.frames.saturating_add(u32::from(frozen.is_some()));
        frozen
    }

    /// Number of unusable frames since the start.
    #[must_use]
    pub const fn frames(&self) -> u32 {
        self.frames
    }
}

/// The mark of a channel; zero if all samples are equal.
fn mark<const N: usize>(row: &[i16; N]) -> u32 {
    let (mut mark, mut differs) = (0_u32, 0);
    let first = row.first().copied().unwrap_or_default();
    for code in row.iter().step_by(STRIDE) {
        mark = mark.wrapping_mul(FACTOR).wrapping_add(*code as u32);
        differs |= *code ^ first;
    }
    if differs == 0 { 0 } else { mark.max(1) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::rng::Rng;

    /// Noise of so many codes, and a tone.
    fn frame(rng: &mut Rng, sigma_codes: f32) -> AdcFrame<256> {
        let mut snapshot = AdcFrame::zeroed();
        for code in snapshot.codes.iter_mut().flatten() {
            *code = libm::roundf(sigma_codes * rng.gaussian()) as i16;
        }
        snapshot
    }

    #[test]
    fn a_channel_that_repeats_itself_is_named_and_the_next_fresh_frame_is_fresh() {
        let mut rng = Rng::new(1, 1);
        for channel in 0..CHANNELS {
            let mut watch = Watch::new();
            let mut last = frame(&mut rng, 1.0);
            assert_eq!(watch.look(&last), None);
            for _ in 0..10 {
                let mut stale = frame(&mut rng, 1.0);
                stale.codes[channel] = last.codes[channel];
                assert_eq!(watch.look(&stale), Some(channel));
                last = frame(&mut rng, 1.0);
                assert_eq!(watch.look(&last), None);
            }
            assert_eq!(watch.frames(), 10);
        }
    }

    #[test]
    fn a_channel_that_says_nothing_at_all_is_dead_and_not_frozen() {
        let mut watch = Watch::new();
        for code in [0, -2048, 2047] {
            for _ in 0..3 {
                assert_eq!(watch.look(&AdcFrame { codes: [[code; 256]; CHANNELS], ..AdcFrame::zeroed() }), None);
            }
        }
    }

    #[test]
    fn no_two_frames_of_noise_of_one_code_look_the_same() {
        let mut rng = Rng::new(2, 1);
        let mut watch = Watch::new();
        assert!((0..5_000).all(|_| watch.look(&frame(&mut rng, 1.0)).is_none()));
    }
}
