//! Registration and nothing else: no line, no frames. It is not meant to run. Its size is what the library adds to a program,
//! including start-up code.
#![no_std]
#![no_main]

use core::hint::black_box;
use cortex_m_rt::entry;
use reagent_core::net::Scratch;
use reagent_core::{Frame, Policy, Pose, Registrar, Registration};

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}

#[entry]
fn main() -> ! {
    static mut SCRATCH: Scratch = Scratch::new();

    // The compiler must not know their values.
    let file: &'static [u8] = black_box(&[]);
    let [source, target]: [&[[f32; 3]]; 2] = black_box([&[], &[]]);
    if let Ok(policy) = Policy::parse(file)
        && let Ok(frame) = Frame::of(target)
    {
        let mut registrar = Registrar::new(policy, SCRATCH);
        let mut registration = Registration::new();
        let last = black_box(Pose::IDENTITY);
        let started = registrar.start_in(&mut registration, source, target, frame, last);
        if black_box(started).is_ok() {
            for _ in 0..black_box(10) {
                black_box(registrar.step(&mut registration).is_ok());
            }
            black_box(registration.target_from_source());
            black_box(registration.verdict());
        }
    }
    loop {
        core::hint::spin_loop();
    }
}
