//! The C interface gives the same bits on the host, on aarch64 and on a board.

use super::bits::{Pair, Trajectory, pairs, trajectory};
use super::{POLICY, image};
use firmware_sim::board::Kind;
use reagent_core::grid::Grid;
use reagent_core::kernels::Isa;
use std::ffi::OsStr;
use std::fmt::Write;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A file of the C interface.
pub(crate) fn capi(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../core/capi")
        .join(path)
}

/// Builds the static library and returns its path; says why not if the target is not installed.
pub(crate) fn library(target: Option<&str>, profile: &str) -> Option<PathBuf> {
    let directory = capi("../../target/capi");
    let mut build = Command::new(env!("CARGO"));
    build
        .args(["rustc", "--crate-type", "staticlib", "--locked"])
        .args(["-p", "reagent-capi", "--profile", profile])
        .args(target.iter().flat_map(|target| ["--target", target]))
        .arg("--target-dir")
        .arg(&directory)
        .current_dir(capi("."));
    let output = build.output().expect("cargo runs");
    let text = String::from_utf8_lossy(&output.stderr);
    if text.contains("can't find crate for `core`") {
        eprintln!("skipped: the compiler has no core library for {target:?}");
        return None;
    }
    assert!(output.status.success(), "{text}");
    let folder = target.map_or(directory.clone(), |target| directory.join(target));
    Some(folder.join(profile).join("libreagent.a"))
}

/// Output of a program that must succeed; `None`, with a message, if it is not installed.
pub(crate) fn output(program: &str, arguments: &[&OsStr]) -> Option<String> {
    match Command::new(program).args(arguments).output() {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            eprintln!("skipped: {program} is not installed");
            None
        }
        output => {
            let output = output.expect("it runs");
            let error = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{program}: {error}");
            Some(String::from_utf8(output.stdout).expect("text"))
        }
    }
}

/// A trajectory as the examples print it.
fn lines(steps: Trajectory) -> String {
    let mut lines = String::new();
    for (action, pose) in steps {
        let ids = action.translation.into_iter().chain(action.rotation);
        for word in ids.map(u32::from).chain(pose.into_iter().flatten()) {
            write!(lines, "{word:08x} ").expect("memory");
        }
        lines.push('\n');
    }
    lines
}

/// The output of `core/capi/examples/register.c`, computed in Rust.
fn lines_of_the_c_example() -> String {
    let mut random = 1u32;
    let mut draw = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let target: Vec<[f32; 3]> = (0..200).map(|_| [draw(), draw(), draw()]).collect();
    let source: Vec<[f32; 3]> = target.iter().map(|&[x, y, z]| [x + 0.125, y, z]).collect();
    lines(trajectory(&POLICY, Isa::best(), &source, &target))
}

#[test]
fn c_takes_the_same_steps_on_the_host_and_on_the_board() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let path = |name: &str| directory.path().join(name);
    let (policy, host, board) = (path("policy.rgw"), path("host"), path("board"));
    POLICY.save(&policy).expect("it is writable");
    let include = capi("include");
    let [example, host_c, mps2_c, mps2_ld] =
        ["register.c", "host.c", "mps2.c", "mps2.ld"].map(|name| capi("examples").join(name));
    let strict = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-I"].map(OsStr::new);
    let expected = lines_of_the_c_example();
    assert!(expected.lines().count() > 1);

    let library_here = library(None, "release").expect("this machine's own target");
    let files = [&include, &example, &host_c, &library_here].map(|path| path.as_os_str());
    let end = ["-lpthread", "-ldl", "-lm", "-o"].map(OsStr::new);
    if output(
        "cc",
        &[&strict[..], &files, &end, &[host.as_os_str()]].concat(),
    )
    .is_some()
    {
        let text = host.to_str().expect("a plain path");
        assert_eq!(output(text, &[policy.as_os_str()]), Some(expected.clone()));
    }

    let Some(library) = library(Some(Kind::CortexM7.target()), "firmware") else {
        return;
    };
    let processor = [
        "-mcpu=cortex-m7",
        "-mfpu=fpv5-d16",
        "-mfloat-abi=hard",
        "-mthumb",
    ];
    let bare = ["-ffreestanding", "-nostdlib", "-Wl,--gc-sections", "-T"].map(OsStr::new);
    let files = [&include, &example, &mps2_c, &library].map(|path| path.as_os_str());
    let arguments = [
        &processor.map(OsStr::new)[..],
        &strict,
        &files,
        &bare,
        &[
            mps2_ld.as_os_str(),
            "-lgcc".as_ref(),
            "-o".as_ref(),
            board.as_os_str(),
        ],
    ];
    if output("arm-none-eabi-gcc", &arguments.concat()).is_none() {
        return;
    }
    image::assert_cannot_panic(&board);
    let weights = format!(
        "loader,file={},addr=0x00100000,force-raw=on",
        policy.display()
    );
    let simulator = [
        "-machine",
        "mps2-an500",
        "-display",
        "none",
        "-monitor",
        "none",
        "-serial",
        "stdio",
        "-semihosting-config",
        "enable=on,target=native",
        "-device",
        &weights,
        "-kernel",
    ];
    let simulator = simulator.map(OsStr::new);
    let printed = output(
        "qemu-system-arm",
        &[&simulator[..], &[board.as_os_str()]].concat(),
    );
    if let Some(printed) = printed {
        assert_eq!(printed, expected);
    }
}

#[test]
fn the_c_header_is_what_cbindgen_makes() {
    let config = capi("cbindgen.toml");
    let arguments = ["--quiet", "--config"].map(OsStr::new);
    let package = capi("");
    let arguments = [&arguments[..], &[config.as_os_str(), package.as_os_str()]].concat();
    if let Some(made) = output("cbindgen", &arguments) {
        let checked_in = std::fs::read_to_string(capi("include/reagent.h")).expect("a header");
        assert_eq!(
            checked_in, made,
            "in core/capi: cbindgen --config cbindgen.toml --output include/reagent.h ."
        );
    }
}

/// Microsoft's compiler has its own names for processors; the library writes 65 kB whatever compiler built the program.
#[test]
fn memory_is_small_only_on_a_microcontroller() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let file = directory.path().join("words.c");
    std::fs::write(&file, "#include <reagent.h>\nREAGENT_MEMORY_WORDS").expect("it is writable");
    let include = capi("include");
    let unnamed = ["-U__x86_64__", "-U__aarch64__", "-U__arm__"];
    for (name, words) in [
        ("_M_X64", "8128"),
        ("_M_ARM64", "8128"),
        ("__arm__", "2240"),
    ] {
        let name = format!("-D{name}");
        let plain = ["-ffreestanding", "-E", "-P"].into_iter().chain(unnamed);
        let plain = plain.chain([name.as_str(), "-I"]).map(OsStr::new);
        let arguments: Vec<&OsStr> = plain
            .chain([include.as_os_str(), file.as_os_str()])
            .collect();
        if let Some(text) = output("cc", &arguments) {
            assert_eq!(text.lines().last(), Some(words), "{name}");
        }
    }
}

/// A pair as `core/capi/examples/pairs.c` registers it: two of every four on grids, as the points that their codes
/// stand for.
fn as_registered(index: usize, pair: Pair) -> Pair {
    if index % 4 < 2 {
        return pair;
    }
    let on_grid = pair.each_ref().map(|cloud| {
        let grid = Grid::of(cloud).expect("a good cloud");
        let points = cloud.iter().map(|&point| grid.decode(grid.encode(point)));
        points.collect()
    });
    assert!(on_grid != pair);
    on_grid
}

/// The pairs in the format that `core/capi/examples/pairs.c` reads.
fn file_of_pairs() -> Vec<u8> {
    let count = |n: usize| u32::try_from(n).expect("small").to_le_bytes();
    let mut file = count(pairs().len()).to_vec();
    for [source, target] in &pairs() {
        file.extend([count(source.len()), count(target.len())].as_flattened());
        let coordinates = source.iter().chain(target).flatten();
        file.extend(coordinates.flat_map(|x| x.to_le_bytes()));
    }
    file
}

#[test]
fn aarch64_takes_the_same_steps_in_one_piece_and_in_slices() {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let path = |name: &str| directory.path().join(name);
    let (policy, clouds, program) = (path("policy.rgw"), path("clouds"), path("pairs"));
    let Some(library) = library(Some("aarch64-unknown-linux-gnu"), "release") else {
        return;
    };
    let (include, source) = (capi("include"), capi("examples/pairs.c"));
    let files = [&include, &source, &library].map(|path| path.as_os_str());
    let before = ["-static", "-std=c11", "-O2", "-Wall", "-Wextra", "-I"].map(OsStr::new);
    let after = ["-lpthread", "-ldl", "-lm", "-o"].map(OsStr::new);
    let arguments = [&before[..], &files, &after, &[program.as_os_str()]].concat();
    if output("aarch64-linux-gnu-gcc", &arguments).is_none() {
        return;
    }
    POLICY.save(&policy).expect("it is writable");
    std::fs::write(&clouds, file_of_pairs()).expect("it is writable");
    let trajectories = pairs().into_iter().enumerate().map(|(index, pair)| {
        let [source, target] = as_registered(index, pair);
        trajectory(&POLICY, Isa::PORTABLE, &source, &target)
    });
    let expected: String = trajectories.map(lines).collect();
    // With the dot-product instructions for bytes, and without.
    for processor in ["max", "cortex-a72"] {
        let files = [&program, &policy, &clouds].map(|path| path.as_os_str());
        let arguments = [&["-cpu", processor].map(OsStr::new)[..], &files].concat();
        if let Some(printed) = output("qemu-aarch64", &arguments) {
            assert!(printed == expected, "{processor}");
        }
    }
}
