//! The memory layout of both boards for each program. RAM is what the budget allows, not what the board has.

use std::{env, fs, path::PathBuf};

/// RAM for everything: clouds, working memory, stack.
const RAM: usize = 50 * 1024;
/// The same, with clouds on a grid.
const RAM_ON_GRID: usize = 38 * 1024;
/// The stack's part of it, at the low end, so that a deeper stack faults instead of overwriting statics.
const STACK: usize = 13 * 1024 + 768;
/// Both for refinement.
const REFINEMENT_RAM: usize = 312 * 1024;
const REFINEMENT_STACK: usize = 51 * 1024;

fn main() {
    let target = env::var("TARGET").expect("set by cargo");
    // The program in tightly coupled or fast RAM that stands in for flash, then the policy's flash, then RAM.
    let (board, flash, policy, ram) = match target.as_str() {
        "thumbv7em-none-eabihf" => ("an500", 0x0000_0000, 0x0010_0000, 0x2000_0000),
        "thumbv8m.main-none-eabihf" => ("an547", 0x1000_0000, 0x6000_0000, 0x3000_0000),
        _ => panic!("build for thumbv7em-none-eabihf or thumbv8m.main-none-eabihf"),
    };
    let all = match env::var_os("CARGO_FEATURE_GRID") {
        Some(_) => RAM_ON_GRID,
        None => RAM,
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("set by cargo"));
    for (program, all, stack) in [
        ("reagent-cortex-m", all, STACK),
        ("registration", all, STACK),
        ("refinement", REFINEMENT_RAM, REFINEMENT_STACK),
    ] {
        let memory = format!(
            "MEMORY {{
                FLASH : ORIGIN = {flash:#x}, LENGTH = 256K
                POLICY : ORIGIN = {policy:#x}, LENGTH = 3M
                RAM : ORIGIN = {ram:#x} + {stack}, LENGTH = {all} - {stack}
            }}
            _stack_start = ORIGIN(RAM);
            _stack_end = ORIGIN(RAM) - {stack};
            _policy_flash = ORIGIN(POLICY);"
        );
        let folder = out.join(program);
        fs::create_dir_all(&folder).expect("cargo's folder is writable");
        fs::write(folder.join("memory.x"), memory).expect("cargo's folder is writable");
        println!("cargo:rustc-link-arg-bin={program}=-L{}", folder.display());
    }
    println!("cargo:rustc-check-cfg=cfg(board, values(\"an500\", \"an547\"))");
    println!("cargo:rustc-cfg=board=\"{board}\"");
    println!("cargo:rerun-if-changed=build.rs");
}
