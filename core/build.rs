//! Says which kernels of Arm and of WebAssembly the target runs, as `cfg(arm_kernels)` and `cfg(wasm_kernels)`: what the compiler
//! knows of a microcontroller's instructions is not visible to stable Rust code. Says, too, where a policy is not in the package.

use std::env::var;
use std::path::Path;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!(r#"cargo::rustc-check-cfg=cfg(arm_kernels, values("neon", "dsp", "helium"))"#);
    println!(r#"cargo::rustc-check-cfg=cfg(wasm_kernels, values("simd128"))"#);
    let read = |name: &str| var(name).unwrap_or_default();
    let policy = Path::new(&read("CARGO_MANIFEST_DIR")).join("weights/reagent.rgw");
    if var("CARGO_FEATURE_PRETRAINED").is_ok() && !policy.exists() {
        println!(
            "cargo::error=the feature `pretrained` needs weights/reagent.rgw, which is too large for the package: \
             take `pretrained-int8` (the same policy in 8-bit integers), give the policy as a file, or depend on \
             reagent-core by path or git"
        );
        return;
    }
    let target = read("TARGET");
    // -C target-cpu=NAME, from RUSTFLAGS or a configuration file.
    let flags = read("CARGO_ENCODED_RUSTFLAGS");
    let flag = |flag: &str| {
        let name = flag.trim_start_matches("-C").trim_start();
        name.strip_prefix("target-cpu=").map(str::to_owned)
    };
    let cpu = flags.split('\x1f').filter_map(flag).next_back();
    let cpu = cpu.unwrap_or_default();
    let features = read("CARGO_CFG_TARGET_FEATURE");
    let has = |feature: &str| features.split(',').any(|f| f == feature);
    if read("CARGO_CFG_TARGET_ARCH") == "wasm32" && has("simd128") {
        println!("cargo::rustc-cfg=wasm_kernels=\"simd128\"");
    }
    let kernels = match read("CARGO_CFG_TARGET_ARCH").as_str() {
        "aarch64" if has("neon") => "neon",
        "arm" if ["cortex-m52", "cortex-m55", "cortex-m85"].contains(&cpu.as_str()) => "helium",
        "arm" if target.starts_with("thumbv7em") => "dsp",
        "arm" if ["cortex-m33", "cortex-m35p"].contains(&cpu.as_str()) => "dsp",
        _ => return,
    };
    println!("cargo::rustc-cfg=arm_kernels={kernels:?}");
}
