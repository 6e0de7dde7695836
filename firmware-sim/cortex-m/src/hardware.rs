//! The hardware of the two boards: a CMSDK UART, a counter, a watchdog, flash for a policy. Nearly all of the image's `unsafe` is
//! here; `main` takes the flash.

use core::arch::asm;
use core::ptr::{addr_of, addr_of_mut};

#[cfg(board = "an500")]
mod addresses {
    pub(super) const UART: usize = 0x4000_4000;
    pub(super) const UART_RECEIVE_IRQ: usize = 0;
    pub(super) const FPGA_IO: usize = 0x4002_8000;
    /// Rate of the counter, measured against the board's 100 Hz clock, as on the other board.
    pub(crate) const HERTZ: u32 = 25_000_000;
    pub(super) const WATCHDOG: usize = 0x4000_8000;
    pub(super) const WATCHDOG_HERTZ: u32 = 25_000_000;
}
#[cfg(board = "an547")]
mod addresses {
    pub(super) const UART: usize = 0x5930_3000;
    pub(super) const UART_RECEIVE_IRQ: usize = 33;
    pub(super) const FPGA_IO: usize = 0x5930_2000;
    /// Rate of the counter.
    pub(crate) const HERTZ: u32 = 20_000_000;
    pub(super) const WATCHDOG: usize = 0x4802_e000;
    pub(super) const WATCHDOG_HERTZ: u32 = 32_000;
}
pub(crate) use addresses::HERTZ;
use addresses::{FPGA_IO, UART, UART_RECEIVE_IRQ, WATCHDOG, WATCHDOG_HERTZ};

unsafe extern "C" {
    static mut _policy_flash: u8;
    static __vector_table: u8;
    static __sidata: u8;
    static __sdata: u8;
    static __edata: u8;
    static __sheap: u8;
    static _stack_end: u32;
    static _stack_start: u32;
}

fn read(address: usize) -> u32 {
    // SAFETY: only called with addresses of this file, registers of the board.
    unsafe { (address as *const u32).read_volatile() }
}

fn write(address: usize, value: u32) {
    // SAFETY: as above.
    unsafe { (address as *mut u32).write_volatile(value) }
}

/// The serial line.
pub(crate) struct Uart(());

const DATA: usize = UART;
const STATE: usize = UART + 0x4;
const CONTROL: usize = UART + 0x8;
const INTERRUPT: usize = UART + 0xc;
const BAUD_DIVIDER: usize = UART + 0x10;
const NVIC_ENABLE: usize = 0xe000_e100 + UART_RECEIVE_IRQ / 32 * 4;
const NVIC_CLEAR_PENDING: usize = 0xe000_e280 + UART_RECEIVE_IRQ / 32 * 4;
const NVIC_BIT: u32 = 1 << (UART_RECEIVE_IRQ % 32);

impl Uart {
    /// Enables sending and receiving. The receive interrupt wakes the processor but is never taken.
    pub(crate) fn open() -> Uart {
        // SAFETY: masks interrupts, touches no memory.
        unsafe { asm!("cpsid i", options(nomem, nostack)) };
        write(BAUD_DIVIDER, 16);
        write(CONTROL, 0b1011);
        write(NVIC_ENABLE, NVIC_BIT);
        Uart(())
    }

    /// A byte, if one has come.
    pub(crate) fn receive(&mut self) -> Option<u8> {
        (read(STATE) & 2 != 0).then(|| {
            let byte = read(DATA) as u8;
            write(INTERRUPT, 2);
            byte
        })
    }

    /// Sleeps until a byte or the tick comes. Does not sleep if the tick is pending already ([`clear_tick`]).
    pub(crate) fn wait(&mut self) {
        write(NVIC_CLEAR_PENDING, NVIC_BIT);
        if read(STATE) & 2 == 0 {
            // SAFETY: sleeps, touches no memory.
            unsafe { asm!("wfi", options(nomem, nostack)) };
        }
    }

    /// Sends a byte.
    pub(crate) fn send(&mut self, byte: u8) {
        while read(STATE) & 1 != 0 {}
        write(DATA, u32::from(byte));
    }
}

/// Ticks of the board's counter; wraps after minutes.
pub(crate) fn ticks() -> u32 {
    read(FPGA_IO + 0x18)
}

const SYSTEM_TICK: usize = 0xe000_e010;
const SYSTEM_CONTROL: usize = 0xe000_ed04;
const CLEAR_PENDING_TICK: u32 = 1 << 25;
/// After this time without being fed, the watchdog raises its interrupt, which hangs. After as long again it resets the board. A
/// real controller would use a few of its periods; a simulator may have to wait for its host.
const WATCHDOG_SECONDS: u32 = 30;

/// Starts the watchdog, and the tick that wakes the processor to feed it.
pub(crate) fn start_watchdog() {
    write(WATCHDOG + 0xc00, 0x1acc_e551);
    write(WATCHDOG, WATCHDOG_SECONDS * WATCHDOG_HERTZ);
    write(WATCHDOG + 0x8, 0b11);
    write(SYSTEM_TICK + 0x4, 0x00ff_ffff);
    write(SYSTEM_TICK + 0x8, 0);
    write(SYSTEM_TICK, 0b111);
}

/// Clears the pending tick, which comes about twice a second.
pub(crate) fn clear_tick() {
    write(SYSTEM_CONTROL, CLEAR_PENDING_TICK);
}

/// Feeds the watchdog.
pub(crate) fn feed_watchdog() {
    write(WATCHDOG + 0xc, 1);
}

/// Flash for one policy. The board's simulator has RAM there, which can be written like any RAM.
pub(crate) struct Flash(());

impl Flash {
    /// Bytes of the flash.
    pub(crate) const LENGTH: usize = 3 << 20;

    /// The one flash.
    ///
    /// # Safety
    /// Must be called once only.
    pub(crate) unsafe fn take() -> Flash {
        Flash(())
    }

    /// All bytes.
    pub(crate) fn bytes(&self) -> &[u8] {
        // SAFETY: the linker script reserves it; writing takes `&mut self`.
        unsafe { core::slice::from_raw_parts(addr_of!(_policy_flash), Self::LENGTH) }
    }

    /// Writes as many bytes as fit.
    pub(crate) fn write(&mut self, at: usize, bytes: &[u8]) {
        // SAFETY: as above.
        let all =
            unsafe { core::slice::from_raw_parts_mut(addr_of_mut!(_policy_flash), Self::LENGTH) };
        for (place, &byte) in all.iter_mut().skip(at).zip(bytes) {
            *place = byte;
        }
    }
}

/// Bytes of program and constants, and of RAM that is not stack.
pub(crate) fn program_and_static_bytes() -> (u32, u32) {
    let [start, end] = [addr_of!(__vector_table).addr(), addr_of!(__sidata).addr()];
    let [data, data_end] = [addr_of!(__sdata).addr(), addr_of!(__edata).addr()];
    let statics_end = addr_of!(__sheap).addr();
    let program = end - start + (data_end - data);
    (program as u32, (statics_end - data) as u32)
}

/// The most bytes of the stack used so far, and all its bytes. `Reset` has painted the stack.
pub(crate) fn stack_bytes() -> (u32, u32) {
    let (mut at, start) = (addr_of!(_stack_end), addr_of!(_stack_start));
    let all = start.addr() - at.addr();
    let mut unused = 0;
    // SAFETY: words between both ends of the stack.
    while unused < all && unsafe { at.read_volatile() } == cortex_m_rt::STACK_PAINT_VALUE {
        unused += 4;
        at = at.wrapping_add(1);
    }
    ((all - unused) as u32, all as u32)
}
