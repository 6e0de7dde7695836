//! The examples in `deploy/`, checked by the tools that they are for.
#![cfg(unix)]

use std::path::Path;
use std::process::{Command, Stdio};

fn deploy(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("deploy")
        .join(name)
}

#[test]
fn names_that_look_like_options_get_no_certificates() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let certificates = folder.path().join("certificates");
    for [fleet, robot] in [["lab", "-a"], ["-lab", "a"]] {
        let made = Command::new(deploy("make-ca"))
            .arg(&certificates)
            .args([fleet, "localhost", robot])
            .output();
        let made = made.expect("bash runs");
        assert_eq!(made.status.code(), Some(2), "{made:?}");
        assert!(!certificates.exists());
    }
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
        // The tool looks for the program, which is not installed here.
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
    // The tool reports what it does not know, but ends with status 0.
    assert!(said.status.success() && warnings.is_empty(), "{warnings}");
}

#[test]
fn configurations_are_replaced_whole_while_others_read_them() {
    use std::fs::{File, metadata};
    use std::os::unix::fs::MetadataExt;
    if Command::new("openssl").arg("version").output().is_err() {
        return eprintln!("skipped: openssl is not installed");
    }
    let folder = tempfile::tempdir().expect("a temporary directory");
    let make = || {
        let mut made = Command::new(deploy("make-ca"));
        let made = made.arg(folder.path()).args(["lab", "localhost", "arm1"]);
        assert!(made.output().expect("bash runs").status.success());
    };
    make();
    let names = [
        "router.json5",
        "trainer.json5",
        "client.json5",
        "arm1.json5",
    ];
    let paths = names.map(|name| folder.path().join(name));
    let files = paths
        .each_ref()
        .map(|path| File::open(path).expect("readable"));
    make();
    for (path, file) in paths.iter().zip(files) {
        let before = file.metadata().expect("open").ino();
        let after = metadata(path).expect("readable").ino();
        assert_ne!(before, after, "{} was written in place", path.display());
        let text = std::fs::read_to_string(path).expect("readable");
        assert!(text.ends_with("}\n"), "{text}");
    }
    let left = std::fs::read_dir(folder.path()).expect("readable");
    let left = left.map(|entry| entry.expect("readable").file_name());
    let hidden = left.filter(|name| name.to_string_lossy().starts_with('.'));
    assert_eq!(hidden.count(), 0);
}

/// The arguments of every command of this program in a file, one list for each command.
fn commands(text: &str, program: &str) -> Vec<Vec<String>> {
    let joined = text.replace("\\\n", " ").replace("#     ", " ");
    // The curve's base point.
    let key = format!("58{}", "66".repeat(31));
    let filled = joined
        .replace("${PUBLIC_KEY}", &key)
        .replace("PUBLIC_KEY", &key);
    let filled = filled
        .replace("%i", "arm1")
        .replace("$NODE_OPTIONS", "--metrics 127.0.0.1:9100 --log json");
    let filled = filled
        .replace("${POLICY_VERSION}", "1")
        .replace("${FLEET}", "lab");
    let after = filled.lines().filter_map(|line| line.split_once(program));
    let words = after.map(|(_, arguments)| {
        arguments
            .split_whitespace()
            .map(|word| word.trim_matches('"').into())
    });
    words.map(Iterator::collect).collect()
}

#[test]
fn the_program_takes_the_commands_of_units_and_container() {
    let container = std::fs::read_to_string(deploy("Containerfile")).expect("readable");
    let mut found = commands(&container, " reagent-robot ");
    found.retain(|arguments| arguments[0] != ".");
    for unit in ["reagent-router.service", "reagent-node@.service"] {
        let text = std::fs::read_to_string(deploy("systemd").join(unit)).expect("readable");
        found.extend(commands(&text, "ExecStart=/usr/bin/firmware-sim "));
    }
    assert_eq!(found.len(), 3, "{found:?}");
    for arguments in found {
        // clap checks the arguments before it comes to --help.
        let program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"))
            .args(&arguments)
            .arg("--help")
            .stdout(Stdio::null())
            .output();
        let said = program.expect("the program runs");
        let error = String::from_utf8_lossy(&said.stderr);
        assert!(said.status.success(), "{arguments:?}: {error}");
    }
}

#[cfg(feature = "demo")]
#[test]
fn the_publisher_takes_the_command_of_its_unit() {
    #[derive(clap::Parser)]
    struct Publish {
        #[command(flatten)]
        _args: host_train::publish::PublishArgs,
    }
    let unit = deploy("systemd").join("reagent-publisher.service");
    let text = std::fs::read_to_string(unit).expect("readable");
    let found = commands(&text, "ExecStart=/usr/bin/host-train ");
    let parsed = <Publish as clap::Parser>::try_parse_from(&found[0]);
    if let Err(wrong) = parsed {
        panic!("{:?}: {wrong}", found[0]);
    }
}

#[test]
fn the_container_holds_the_program_and_all_that_it_needs() {
    let text = std::fs::read_to_string(deploy("Containerfile")).expect("readable");
    let line = |start: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(start));
        line.unwrap_or_else(|| panic!("{start}"))
    };
    let built = Path::new(env!("CARGO_BIN_EXE_firmware-sim"));
    let name = built.file_name().expect("a file").to_string_lossy();
    let package = env!("CARGO_PKG_NAME");
    assert!(line("RUN cargo build ").contains(&format!("-p {package} ")));
    let copied = line("COPY --from=build ")
        .split_once(' ')
        .expect("from and to");
    assert_eq!(
        copied.0,
        format!("{}/target/release/{name}", line("WORKDIR "))
    );
    assert_eq!(line("ENTRYPOINT "), format!("[{:?}]", copied.1));
    assert!(text.contains(&format!("--state {}\n", line("VOLUME "))));
    // Debian's smallest image has only these libraries, of the packages libc6 and libgcc-s1.
    let Ok(needs) = Command::new("ldd").arg(built).output() else {
        return eprintln!("skipped: ldd is not installed");
    };
    for needed in String::from_utf8_lossy(&needs.stdout).lines() {
        let there = [
            "linux-vdso.",
            "ld-linux-",
            "libc.so.6 ",
            "libm.so.6 ",
            "libgcc_s.so.1 ",
        ];
        assert!(
            there.iter().any(|library| needed.contains(library)),
            "{needed}"
        );
    }
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

/// The router's configuration is of the robots that are named: whoever forgets one is told.
#[test]
fn a_robot_that_is_not_named_again_is_told() {
    if Command::new("openssl").arg("version").output().is_err() {
        return eprintln!("skipped: openssl is not installed");
    }
    let folder = tempfile::tempdir().expect("a temporary directory");
    let warned = |robots: &[&str]| {
        let mut command = Command::new(deploy("make-ca"));
        command.arg(folder.path()).args(["lab", "localhost"]);
        let output = command.args(robots).output().expect("the script runs");
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert_eq!(warned(&["arm1", "arm2"]), "");
    let said = warned(&["arm2", "arm3"]);
    assert!(
        said.starts_with("make-ca: arm1 has a certificate here and was not named"),
        "{said}"
    );
    assert_eq!(said.lines().count(), 1, "{said}");
    assert_eq!(warned(&["arm1", "arm2", "arm3"]), "");
}

/// Names and IPv4 addresses, with and without a port; with those of IPv6 no client would connect.
#[test]
fn the_router_is_reached_under_names_and_addresses() {
    let make_ca = |address: &str| {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let mut command = Command::new(deploy("make-ca"));
        command.arg(folder.path()).args(["lab", address, "arm1"]);
        let output = command.output().expect("the script runs");
        let robot = std::fs::read_to_string(folder.path().join("arm1.json5"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), robot.unwrap_or_default(), said)
    };
    if Command::new("openssl").arg("version").output().is_err() {
        return eprintln!("skipped: openssl is not installed");
    }
    for (address, endpoint) in [
        ("router_1.local", "quic/router_1.local:7447?"),
        ("192.168.1.5:7450", "quic/192.168.1.5:7450?"),
    ] {
        let (status, robot, said) = make_ca(address);
        assert_eq!(status, Some(0), "{address}: {said}");
        assert!(robot.contains(endpoint), "{address}: {robot}");
    }
    for address in [
        "router:x",
        "router:",
        "router:70000",
        "a router",
        "a:b:c",
        "::1",
        "[fe80::1:2]:7450",
    ] {
        let (status, robot, said) = make_ca(address);
        assert_eq!((status, robot.as_str()), (Some(2), ""), "{address}");
        assert!(said.starts_with("make-ca: "), "{address}: {said}");
    }
}
