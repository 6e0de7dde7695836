//! The examples in `deploy/`, read by the tools that they are for.
#![cfg(unix)]

use std::path::Path;
use std::process::Command;

fn deploy(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("deploy")
        .join(name)
}

#[test]
fn systemd_understands_every_line_of_the_units() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let mut verify = Command::new("systemd-analyze");
    verify.arg("verify");
    for (unit, copy) in [
        ("reagent-router.service", "reagent-router.service"),
        ("reagent-publisher.service", "reagent-publisher.service"),
        ("reagent-node@.service", "reagent-node@arm1.service"),
    ] {
        let text = std::fs::read_to_string(deploy("systemd").join(unit)).expect("readable");
        // It looks for the program, which is installed nowhere here.
        let built = env!("CARGO_BIN_EXE_firmware-sim");
        let placed = text
            .replace("/usr/bin/firmware-sim", built)
            .replace("/usr/bin/host-train", built);
        assert_ne!(placed, text);
        let path = folder.path().join(copy);
        std::fs::write(&path, placed).expect("writable");
        verify.arg(path);
    }
    let Ok(said) = verify.output() else {
        return eprintln!("skipped: systemd-analyze is not installed");
    };
    let warnings = String::from_utf8_lossy(&said.stderr);
    // It says what it does not know, and ends with status 0.
    assert!(said.status.success() && warnings.is_empty(), "{warnings}");
}

#[test]
fn nft_understands_the_limit_of_connections() {
    let checked = Command::new("nft")
        .arg("--check")
        .arg("--file")
        .arg(deploy("nftables.conf"))
        .output();
    let Ok(said) = checked else {
        return eprintln!("skipped: nft is not installed");
    };
    let warnings = String::from_utf8_lossy(&said.stderr);
    if warnings.contains("Operation not permitted") {
        return eprintln!("skipped: nft may not be used here");
    }
    assert!(said.status.success(), "{warnings}");
}
