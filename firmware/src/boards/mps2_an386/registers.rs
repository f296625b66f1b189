//! The CMSDK peripherals of the mps2-an386 (Arm DDI 0479, "Cortex-M System Design Kit", chapter 4) as plain words.

/// A peripheral by its base address; only those below exist.
#[derive(Clone, Copy, Debug)]
pub struct Peripheral {
    base: usize,
}

/// MAVLink.
pub const UART0: Peripheral = Peripheral { base: 0x4000_4000 };
/// The doorbell.
pub const UART1: Peripheral = Peripheral { base: 0x4000_5000 };
/// The maintenance port.
pub const UART2: Peripheral = Peripheral { base: 0x4000_6000 };
/// Free-running: the time.
pub const TIMER0: Peripheral = Peripheral { base: 0x4000_0000 };
/// Runs down: the alarm.
pub const TIMER1: Peripheral = Peripheral { base: 0x4000_1000 };

/// Two timers; the first one of them.
pub const DUAL_TIMER: Peripheral = Peripheral { base: 0x4000_2000 };
/// Restarts the board when it has run down twice.
pub const WATCHDOG: Peripheral = Peripheral { base: 0x4000_8000 };

/// A register by its offset.
#[derive(Clone, Copy, Debug)]
#[repr(usize)]
pub enum Register {
    /// UART: data. Timer: control.
    Data = 0x00,
    /// UART: state. Timer: current value.
    State = 0x04,
    /// UART: control. Timer: reload value.
    Control = 0x08,
    /// Interrupt status when read; interrupts to clear when written.
    Interrupt = 0x0c,
    /// UART: clock divider.
    Divider = 0x10,
    /// Watchdog: unlocks it.
    Lock = 0xc00,
}

impl Register {
    /// Control of a timer.
    pub const TIMER_CONTROL: Self = Self::Data;
    /// Current value of a timer, counting down.
    pub const TIMER_VALUE: Self = Self::State;
    /// Reload value of a timer after zero.
    pub const TIMER_RELOAD: Self = Self::Control;
    /// Start value of the watchdog; writing restarts it.
    pub const WATCHDOG_LOAD: Self = Self::Data;
    /// Control of the watchdog.
    pub const WATCHDOG_CONTROL: Self = Self::Control;
    /// Start value of the dual timer.
    pub const DUAL_LOAD: Self = Self::Data;
    /// Current value of the dual timer.
    pub const DUAL_VALUE: Self = Self::State;
    /// Control of the dual timer.
    pub const DUAL_CONTROL: Self = Self::Control;
    /// Clears the dual timer's interrupt.
    pub const DUAL_CLEAR: Self = Self::Interrupt;
    /// Clears the watchdog's interrupt and restarts it.
    pub const WATCHDOG_CLEAR: Self = Self::Interrupt;
}

impl Peripheral {
    /// Reads a register.
    pub fn read(self, register: Register) -> u32 {
        let address = (self.base + register as usize) as *const u32;
        // SAFETY: the address is a word-aligned register of a peripheral that this board always has; reading has no
        // effect on memory.
        unsafe { address.read_volatile() }
    }

    /// Writes a register.
    pub fn write(self, register: Register, value: u32) {
        let address = (self.base + register as usize) as *mut u32;
        // SAFETY: as above; none of these peripherals can write memory.
        unsafe { address.write_volatile(value) }
    }
}
