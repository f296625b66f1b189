//! The test tone: DAC1 channel 1 on PA4 (CN8-3, A2), at the pace of the antennas' samples.
//!
//! TIM6, which triggers the antennas' converters, triggers this one, too (RM0440, DAC: trigger 7 is `TIM6_TRGO`);
//! DMA2 channel 5 fetches [`foxhound_computer::tone`]'s table from flash, in circles (DMAMUX: request 6 is DAC1
//! channel 1), with a lower priority than the antennas' channels. So the tone has a fixed ratio to the sample rate:
//! 14.806 kHz by default.
//!
//! It is on only during a self-test that needs it: the pin is between those of the antennas. A step of the output and
//! the sampling begin at the same trigger, so the output is still settling while the converters sample. That is the
//! same in all channels, and does not affect relative phases and gains; how much it reduces the amplitude only a
//! board can show.

use embassy_stm32::pac::bdma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::dac::vals::Mode;
use embassy_stm32::pac::gpio::vals::{Moder, Pupdr};
use embassy_stm32::pac::{DAC1, DMA2, DMAMUX1, GPIOA, RCC};
use foxhound_computer::tone::{SAMPLES, TABLE};

/// `TIM6_TRGO`.
const TRIGGER: u8 = 7;
/// DAC1 channel 1, of the DMA multiplexer.
const REQUEST: u8 = 6;
/// DMA2 channel 5, and its channel of the multiplexer.
const DMA: usize = 4;
const DMAMUX: usize = 8 + DMA;
/// The bus runs faster than 160 MHz.
const ABOVE_160_MHZ: u8 = 0b10;

/// The output, off.
#[derive(Debug)]
pub struct Tone {
    sounds: bool,
}

impl Tone {
    /// Takes the pin. Call it once, when the clocks run.
    pub fn new() -> Self {
        RCC.ahb2enr().modify(|w| {
            w.set_dac1en(true);
            w.set_gpioaen(true);
        });
        // A clock takes two cycles to arrive: the read is the wait.
        let _ = RCC.ahb2enr().read();
        GPIOA.moder().modify(|w| w.set_moder(4, Moder::ANALOG));
        GPIOA.pupdr().modify(|w| w.set_pupdr(4, Pupdr::FLOATING));
        DAC1.mcr().modify(|w| {
            w.set_hfsel(ABOVE_160_MHZ);
            w.set_mode(0, Mode::NORMAL_EXT_BUFEN);
        });
        Self { sounds: false }
    }

    /// Switches the tone on or off.
    pub fn sound(&mut self, sounds: bool) {
        if sounds == self.sounds {
            return;
        }
        self.sounds = sounds;
        DAC1.cr().modify(|w| {
            w.set_en(0, false);
            w.set_dmaen(0, false);
        });
        let dma = DMA2.ch(DMA);
        dma.cr().modify(|w| w.set_en(false));
        if !sounds {
            return;
        }
        DMA2.ifcr().write(|w| w.set_gif(DMA, true));
        DMAMUX1.ccr(DMAMUX).write(|w| w.set_dmareq_id(REQUEST));
        dma.par().write_value(DAC1.dhr12r(0).as_ptr() as u32);
        dma.mar().write_value(TABLE.as_ptr() as u32);
        dma.ndtr().write(|w| w.set_ndt(SAMPLES as u16));
        dma.cr().write(|w| {
            w.set_dir(Dir::FROM_MEMORY);
            w.set_circ(true);
            w.set_minc(true);
            // Its registers take whole words.
            w.set_psize(Size::BITS32);
            w.set_msize(Size::BITS16);
            w.set_pl(Pl::LOW);
            w.set_en(true);
        });
        // Flags of the last time.
        DAC1.sr().write(|w| w.set_dmaudr(0, true));
        DAC1.cr().modify(|w| {
            w.set_tsel(0, TRIGGER);
            w.set_ten(0, true);
            w.set_dmaen(0, true);
            w.set_en(0, true);
        });
    }
}
