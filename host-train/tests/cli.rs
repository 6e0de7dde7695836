//! The trainer's command line from outside: exit status, and one line that says what is wrong.

mod support;

use host_train::dataset::pairs::PairSet;
use support::{fail, folder, run, succeed, write_weights};

/// Whether clap finds it or a command.
#[test]
fn bad_usage_is_a_line_of_a_log_in_json() {
    let folder = folder();
    for arguments in [
        "pairs --log json",
        "--log json pairs --data procedural --out p.h5",
    ] {
        let output = run(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        let error = String::from_utf8_lossy(&output.stderr);
        let line: serde_json::Value = serde_json::from_str(&error).expect("one document");
        assert_eq!(line["level"], "ERROR", "{error}");
    }
}

#[test]
fn bad_usage_has_status_2() {
    let folder = folder();
    for arguments in [
        "",
        "no-such-command",
        "train --data procedural --out run",
        "train --stage pretrain --out run",
        "train --data procedural --stage pretrain --out run --learning-rate 0",
        "train --data procedural:0 --stage pretrain --out run",
        "train --data procedural --stage pretrain --out run --resume --init a.rgw",
        "eval --methods icp",
        "eval --weights w.rgw --methods icp --pairs p.h5",
        "eval --methods icp --pairs p.h5 --data procedural --protocol scan",
        "eval --methods icp --data procedural",
        "eval --methods icp --pairs p.h5 --protocol scan",
        "eval --methods icp --pairs p.h5 --threads 0",
        "eval --methods icp --pairs p.h5 --steps -1",
        "eval --methods icp,magic --pairs p.h5",
        "pairs --data procedural --protocol table1 --out p.h5",
        "pairs --data procedural --protocol scan --count 0 --out p.h5",
        "register a.ply",
        "register --pairs l.txt --depth d.png --camera 1,1,1,1",
        "register --pairs l.txt --camera 1,1,1,1",
        "register --pairs l.txt --depth-scale 2",
        "register --pairs l.txt --mask m.png",
        "register a.ply b.ply --mode fast --dense always",
        "register --weights w.rgw a.ply b.ply --init 1,2,3",
        "register --weights w.rgw a.ply b.ply --init 2,0,0,0,0,1,0,0,0,0,1,0",
        "export --run run --format f64 --out w.rgw",
        "publish --weights w.rgw --fleet lab",
        "calibrate --data procedural",
        "keygen --out signing.key --seed 3",
        "--seed 3 keygen --out signing.key",
    ] {
        let output = run(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(output.stdout.is_empty(), "{arguments}");
    }
}

#[test]
fn what_refinement_alone_has_no_use_for_is_refused() {
    let folder = folder();
    for (options, words) in [
        (
            "--mode refine --init none",
            "take mode verify for --init none",
        ),
        ("--mode refine --steps 3", "leave --steps out"),
        ("--mode refine --weights views", "leave --weights out"),
        ("--mode fast --steps 0", "take another mode for --steps 0"),
        ("--steps 1000001", "from 0 to 1000000"),
    ] {
        let output = run(folder.path(), &format!("register a.ply b.ply {options}"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options}: {said}");
        assert!(said.contains(words), "{options}: {said}");
    }
}

#[test]
fn a_seed_is_refused_where_nothing_is_drawn_from_it() {
    let folder = folder();
    for command in [
        "import --pytorch p.zip --out w.rgw",
        "keygen --out k.key",
        "publish --weights w.rgw --key k.key --fleet lab",
        "report run --out r.html",
        "page --out p.html",
        "replay t.jsonl",
    ] {
        for arguments in [format!("--seed 3 {command}"), format!("{command} --seed 3")] {
            let output = run(folder.path(), &arguments);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{arguments}: {said}");
            assert!(said.contains("nothing is drawn from it"), "{said}");
        }
    }
}

#[test]
fn negative_numbers_are_refused_by_the_bounds_of_their_options() {
    let folder = folder();
    for (command, option, words) in [
        (
            "register a.ply b.ply",
            "--seed",
            "from 0 to 18446744073709551615",
        ),
        ("register a.ply b.ply", "--scale", "from 1e-12 to 1e12"),
        ("register a.ply b.ply", "--points", "-1 is not in 16..=4096"),
        ("register a.ply b.ply", "--steps", "from 0 to 1000000"),
        ("register a.ply b.ply", "--best", "-1 is not in 1..=1000000"),
        ("register a.ply b.ply", "--fail-below", "from 0 to 1"),
        ("register a.ply b.ply", "--message", "its number from 0"),
        ("track a.ply b.ply", "--points", "-1 is not in 16..=4096"),
        ("eval --pairs p.h5", "--steps", "-1 is not in 1..=1000000"),
        ("bench", "--points", "-1 is not in"),
        ("publish", "--epoch", "-1 is not in 0..=4294967295"),
        ("train", "--learning-rate", "above 0 and at most 1"),
    ] {
        let output = run(folder.path(), &format!("{command} {option} -1"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{command} {option}: {said}");
        let refused = format!("invalid value '-1' for '{option} ");
        assert!(said.contains(&refused) && said.contains(words), "{said}");
    }
}

#[test]
fn every_command_explains_itself() {
    let folder = folder();
    for (command, draws) in [
        ("train", true),
        ("eval", true),
        ("register", true),
        ("pairs", true),
        ("export", true),
        ("import", false),
        ("keygen", false),
        ("publish", false),
        ("report", false),
        ("page", false),
        ("replay", false),
    ] {
        let help = succeed(folder.path(), &format!("{command} --help"));
        let told = help.contains("--seed <S>") && help.contains("[default: 42]");
        assert_eq!(told, draws, "{command}");
        assert_eq!(help.contains("--seed"), draws, "{command}");
    }
}

#[test]
fn a_short_calibration_is_pointed_out() {
    let folder = folder();
    write_weights(&folder.path().join("w.rgw"));
    for (count, told) in [(63, true), (64, false)] {
        let export = format!(
            "export --run w.rgw --format int8 --calibration procedural:{count} --out int8.rgw"
        );
        let output = run(folder.path(), &export);
        assert!(output.status.success());
        let told_so = String::from_utf8_lossy(&output.stderr).contains("calibrated on 63 clouds");
        assert_eq!(told_so, told, "{count}");
    }
}

#[test]
fn missing_files_are_named() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    fail(at, "eval --methods init --pairs none.h5", &["none.h5"]);
    fail(
        at,
        "eval --methods init --data none --protocol m40-models",
        &["none", "procedural"],
    );
    fail(at, "eval --weights none.rgw --pairs p.h5", &["none.rgw"]);
    fail(
        at,
        "train --data none --stage pretrain --out run",
        &["none", "procedural"],
    );
    fail(at, "export --run none --out w.rgw", &["none"]);
    fail(at, "import --pytorch none.zip --out w.rgw", &["none.zip"]);
    fail(
        at,
        "register --weights w.rgw none.ply none.ply",
        &["none.ply"],
    );
    fail(
        at,
        "register --weights w.rgw a.ply b.ply --init none.json",
        &["none.json"],
    );
    fail(
        at,
        "pairs --data procedural --protocol scan --count 2 --out none/p.h5",
        &["none/p.h5"],
    );
    fail(
        at,
        "pairs --data procedural --protocol scan --count 2 --out p.npz",
        &["p.npz", "HDF5"],
    );
    fail(
        at,
        "publish --weights w.rgw --key none.key --fleet lab",
        &["none.key", "keygen"],
    );
}

#[test]
fn truncated_and_flipped_weights_are_refused() {
    let folder = folder();
    let at = folder.path();
    succeed(
        at,
        "pairs --data procedural --protocol m40-clean --count 1 --out p.h5",
    );
    let good = write_weights(&at.join("good.rgw"));
    succeed(at, "eval --weights good.rgw --pairs p.h5 --steps 1");

    let check = |bytes: &[u8], words: &[&str]| {
        std::fs::write(at.join("bad.rgw"), bytes).expect("written");
        fail(
            at,
            "eval --weights bad.rgw --pairs p.h5",
            &[&["bad.rgw"], words].concat(),
        );
    };
    check(&[], &[]);
    check(&good[..31], &[]);
    check(&good[..good.len() - 1], &[]);
    check(&[&good[..], &[0]].concat(), &[]);
    check(
        b"not a policy at all, but long enough to hold a header",
        &[],
    );
    for at in [0, 5, 17, 100, 5000, good.len() / 2, good.len() - 1] {
        let mut flipped = good.clone();
        flipped[at] ^= 0x10;
        check(&flipped, &[]);
    }
}

#[test]
fn wrong_pairs_files_are_refused() {
    let folder = folder();
    let at = folder.path();
    succeed(
        at,
        "pairs --data procedural --protocol m40-clean --count 2 --out p.h5",
    );
    let good = std::fs::read(at.join("p.h5")).expect("written");
    let eval = "eval --methods init --pairs bad.h5";

    std::fs::write(at.join("bad.h5"), b"no HDF5").expect("written");
    fail(at, eval, &["bad.h5", "HDF5"]);
    std::fs::write(at.join("bad.h5"), &good[..good.len() / 2]).expect("written");
    fail(at, eval, &["bad.h5"]);

    // A poses file is HDF5 without any of the datasets.
    succeed(at, "eval --methods init --pairs p.h5 --poses bad.h5");
    fail(at, eval, &["bad.h5", "source"]);

    // The pair is well formed, but a cloud is beyond the core's capacity: the pair is named.
    let mut set = PairSet::load(&at.join("p.h5")).expect("valid");
    for source in &mut set.source {
        source.resize(5000, [0.1, 0.2, 0.3]);
    }
    set.save(&at.join("big.h5")).expect("written");
    write_weights(&at.join("w.rgw"));
    let output = run(at, "eval --weights w.rgw --pairs big.h5");
    let stderr = String::from_utf8_lossy(&output.stderr);
    let last = stderr.lines().last().unwrap_or_default();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        last.contains("big.h5: pair 0") && last.contains("5000"),
        "{stderr}"
    );
}

#[test]
fn clouds_that_cannot_be_registered_are_refused() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    let write = |name: &str, text: &str| std::fs::write(at.join(name), text).expect("written");
    write("good.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
    write("empty.xyz", "");
    write("one.xyz", "1 2 3\n");
    write("nan.xyz", "0 0 0\n1 0 0\n0 nan 0\n0 0 1\n");
    write("flat.xyz", "1 1 1\n1 1 1\n1 1 1\n");
    write("cloud.las", "");
    fail(
        at,
        "register --weights w.rgw empty.xyz good.xyz",
        &["empty.xyz"],
    );
    fail(
        at,
        "register --weights w.rgw good.xyz one.xyz",
        &["one.xyz", "1 point"],
    );
    // Invalid points are left out and counted; the rest may be registered.
    let output = run(at, "register --weights w.rgw nan.xyz good.xyz");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        stderr.contains("nan.xyz: left out 1 invalid point"),
        "{stderr}"
    );
    assert!(output.status.success(), "{stderr}");
    fail(
        at,
        "register --weights w.rgw good.xyz flat.xyz",
        &["flat.xyz"],
    );
    fail(
        at,
        "register --weights w.rgw cloud.las good.xyz",
        &["cloud.las", ".ply"],
    );
}

#[test]
fn signing_keys_are_never_logged() {
    let folder = folder();
    write_weights(&folder.path().join("w.rgw"));
    succeed(folder.path(), "keygen --out k.key");
    let key = std::fs::read_to_string(folder.path().join("k.key")).expect("just made");
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_host-train"))
        .args(
            "publish --weights w.rgw --key k.key --fleet lab --connect tcp/127.0.0.1:1".split(' '),
        )
        .current_dir(folder.path())
        .env("RUST_LOG", "trace")
        .output()
        .expect("it runs");
    assert!(!run.status.success(), "nothing listens there");
    let said = String::from_utf8_lossy(&[run.stdout, run.stderr].concat()).to_lowercase();
    assert!(said.len() > 1000, "everything is logged");
    let key = key.trim();
    for part in [key, &key[..16], &key[48..]] {
        assert!(!said.contains(part), "the key is in the log");
    }
    // Nor the bytes that it encodes.
    let bytes: Vec<u8> = (0..4)
        .map(|i| u8::from_str_radix(&key[2 * i..2 * i + 2], 16).expect("hexadecimal"))
        .collect();
    let listed = format!("{bytes:?}");
    assert!(
        !said.contains(listed.trim_matches(['[', ']'])),
        "the key is in the log"
    );
}

/// Nobody listens where it would be published; a refusal comes before that, from the comparison.
#[test]
fn a_policy_that_is_worse_on_views_is_not_published_unless_it_is_said() {
    let folder = folder();
    let at = folder.path();
    write_weights(&at.join("w.rgw"));
    succeed(at, "keygen --out k.key");
    let publish = |new: &str, old: &str, rest: &str| {
        let to = "--key k.key --fleet lab --connect tcp/127.0.0.1:1";
        let on = format!("--evaluate views:procedural:3 --against {old}");
        let output = run(at, &format!("publish --weights {new} {to} {on} {rest}"));
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).expect("text")
    };
    let said = publish("w.rgw", "views", "");
    assert!(said.contains("worse than views"), "{said}");
    for said in [
        publish("w.rgw", "views", "--anyway"),
        publish("views", "w.rgw", ""),
    ] {
        assert!(said.contains("no zenoh session"), "{said}");
    }
    fail(
        at,
        "publish --weights w.rgw --key k.key --fleet lab --evaluate procedural:3 --against views",
        &["procedural:3", "views:DIR"],
    );
}
