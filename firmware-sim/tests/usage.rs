//! One line says what is wrong with an option, a name, an endpoint or a file, and what would be right.
#![cfg(feature = "demo")]

use std::net::TcpListener;
use std::path::Path;
use std::process::Command;

/// The first line on standard error of a program that must end with this status.
fn said(folder: &Path, arguments: &str, status: i32) -> String {
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    program.args(arguments.split(' ').map(|word| match word {
        "EMPTY" => "",
        word => word,
    }));
    let output = program.current_dir(folder).output();
    let output = output.expect("the program runs");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{arguments}: {error}");
    let line = error.lines().find(|line| line.starts_with("error: "));
    let line = line.unwrap_or_else(|| panic!("{arguments}: {error}"));
    // clap adds its usage and a hint to its help.
    assert!(status == 2 || error.trim_end().ends_with(line), "{error}");
    for internal in ["Json5Err", "Some(", "Single(", "location:", ".rs:"] {
        assert!(!line.contains(internal), "{arguments}: {line}");
    }
    line.into()
}

#[test]
fn bad_usage_is_status_2() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    for arguments in [
        "node --fleet f",
        "node --fleet f --robot r",
        "node --fleet f --robot r --trust abc",
        "refine --fleet f --robot r",
        "refine --fleet f --robot r only-one.ply",
        "refine --fleet f --robot r --pairs a.h5 --topic /points",
        "refine --fleet f --robot r --pairs a.h5 --message 3",
        "refine --fleet f --robot r --pairs a.h5 --unit mm",
        "refine --fleet f --robot r --pairs a.h5 --scale 2",
        "refine --fleet f --robot r --pairs a.h5 --view origin",
        "refine --fleet f --robot r --pairs a.h5 --camera 1,1,1,1",
        "demo --pairs a.h5 --data b",
        "demo --per-robot 0",
        "fleet --routers 0",
    ] {
        said(folder.path(), arguments, 2);
    }
}

/// So that what reads the log needs no second format.
#[test]
fn bad_usage_is_a_line_of_a_log_in_json() {
    for arguments in [
        "node --log json --fleet f --robot r",
        "--log=json refine --robot r",
        "fleet watch --once --log json",
    ] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
        program.args(arguments.split(' ')).env_remove("RUST_LOG");
        let output = program.output().expect("the program runs");
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(error.lines().count(), 1, "{error}");
        let line: serde_json::Value = serde_json::from_str(&error).expect("JSON");
        let said = line["fields"]["message"].as_str().unwrap_or_default();
        assert!(said.contains("arguments were not provided: "), "{error}");
        assert_eq!(line["level"], "ERROR", "{error}");
    }
}

/// Either option will do.
#[test]
fn a_robot_needs_to_know_whose_policies_it_takes() {
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    let output = program.args(["node", "--fleet", "f", "--robot", "r"]);
    let output = output.output().expect("the program runs");
    let error = String::from_utf8_lossy(&output.stderr);
    let both = error.contains("--trust <HEX>") && error.contains("--trust-any");
    assert!(both, "{error}");
}

#[test]
fn a_bad_value_is_refused_with_its_option_and_with_what_is_taken() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let long = "a".repeat(300);
    let long = [format!("--cloud /{long}"), format!("--robot {long}")];
    let name = "fleet and robot names are 1 to 32 characters of a-z A-Z 0-9 _ -";
    let endpoint = "an endpoint is tcp/HOST:PORT or quic/HOST:PORT, such as tcp/127.0.0.1:7447";
    let domain = "a domain is a number from 0 to 232";
    for (command, option, what) in [
        (
            "ros --model m.ply",
            "--cloud /",
            "it has no name; a topic is /NAME or /NAME/NAME",
        ),
        (
            "ros --model m.ply",
            "--cloud a",
            "it does not begin with a slash; a topic is",
        ),
        (
            "ros --model m.ply",
            "--cloud /a//b",
            "two of them meet; a topic is",
        ),
        ("ros --model m.ply", "--cloud /a/", "it ends with a slash"),
        (
            "ros --model m.ply",
            "--cloud /1a",
            "\"1a\" begins with a digit; a topic is",
        ),
        (
            "ros --model m.ply",
            "--cloud /ä",
            "it has a 'ä'; a topic is",
        ),
        (
            "ros --model m.ply",
            &long[0],
            "it has 301 characters, and a topic at most 247",
        ),
        (
            "ros --model m.ply",
            "--namespace lab",
            "it does not begin with a slash; a namespace is",
        ),
        (
            "ros --model m.ply",
            "--namespace EMPTY",
            "it does not begin with a slash; a namespace is",
        ),
        (
            "ros --model m.ply",
            "--node /a",
            "it has a '/'; a node has one name",
        ),
        (
            "ros --model m.ply",
            "--init -2,0,0,0,0,1,0,0,0,0,1,0",
            "the pose is not a rigid transform",
        ),
        (
            "refine --fleet f --robot r a.ply b.ply",
            "--init -2,0,0,0,0,1,0,0,0,0,1,0",
            "the pose is not a rigid transform",
        ),
        ("ros --model m.ply", "--unit inch", "\"inch\" is no unit"),
        (
            "ros --model m.ply",
            "--tf EMPTY",
            "it is empty; a frame is a name",
        ),
        (
            "ros --model m.ply",
            "--tf /part",
            "it begins with a slash; a frame is",
        ),
        ("ros --model m.ply", "--domain 233", domain),
        ("ros --model m.ply", "--domain -1", domain),
        ("ros --model m.ply", "--domain x", domain),
        (
            "ros --model m.ply",
            "--mode foo",
            "not a mode: refine, fast, polish, verify or best",
        ),
        (
            "node --fleet f --robot r",
            &format!("--trust {}", "0".repeat(64)),
            "a weak ed25519 public key, for which anybody signs",
        ),
        ("ros --model m.ply", "--connect foo", endpoint),
        (
            "ros --model m.ply",
            "--listen tcp/127.0.0.1:99999",
            endpoint,
        ),
        ("router", "--listen EMPTY", endpoint),
        ("router", "--connect tls/127.0.0.1:7447", endpoint),
        ("fleet", "--listen 127.0.0.1:7447", endpoint),
        ("fleet watch --fleet f", "--connect tcp/127.0.0.1", endpoint),
        ("fleet watch", "--fleet EMPTY", name),
        (
            "fleet watch --fleet f",
            "--metrics localhost:1",
            "give a numeric address and a port, such as 127.0.0.1:9100",
        ),
        ("node --robot r --trust-any", "--fleet a/b", name),
        ("node --fleet f --trust-any", "--robot *", name),
        (
            "node --fleet f --trust-any",
            "--robot any",
            "a robot cannot be called \"any\": clients use it for whichever",
        ),
        ("refine --fleet f a.ply b.ply", &long[1], name),
        (
            "refine --fleet f --robot r a.ply b.ply",
            "--deadline x",
            "give .001 to 3600 seconds",
        ),
    ] {
        let line = said(folder.path(), &format!("{command} {option}"), 2);
        let (flag, _) = option.split_once(' ').expect("an option and its value");
        assert!(line.contains(&format!("for '{flag} <")), "{line}");
        assert!(line.contains(what), "{option}: {line}");
    }
}

#[test]
fn files_that_are_none_are_named_once() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let at = folder.path();
    for (name, text) in [
        ("empty.xyz", ""),
        ("point.obj", "v 0 0 0\n"),
        ("part.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"),
        ("wrong.json5", "{ mode: \"nonsense\" }"),
        ("endpoint.json5", "{ connect: { endpoints: [\"foo\"] } }"),
        (
            "tls.json5",
            "{ connect: { endpoints: [\"tls/127.0.0.1:1\"] } }",
        ),
        (
            "udp.json5",
            "{ mode: \"router\", listen: { endpoints: { router: [\"udp/127.0.0.1:0\"] } } }",
        ),
    ] {
        std::fs::write(at.join(name), text).expect("a writable directory");
    }
    let node = "node --fleet f --robot r --trust-any";
    let listen = "--listen tcp/127.0.0.1:0";
    for (arguments, words) in [
        (
            "ros --model none.xyz",
            "--model: none.xyz: No such file or directory (os error 2)",
        ),
        ("ros --model empty.xyz", "--model: empty.xyz: no points"),
        (
            "ros --model point.obj",
            "--model: point.obj: the cloud has 1 point; give at least 3",
        ),
        ("ros --model .", "--model: .: is a directory"),
        (
            "demo --data procedural",
            "--data: no directory procedural; unpack https://",
        ),
        (
            "ros --model part.xyz --weights none.rgw",
            "--weights: no policy none.rgw",
        ),
        (
            "ros --model part.xyz --init foo",
            "--init: initial pose \"foo\": give none, identity, 12 numbers",
        ),
        (
            "ros --model part.xyz --zenoh none.json5",
            "zenoh configuration none.json5: No such file",
        ),
        (
            "router --zenoh wrong.json5",
            "wrong.json5: unknown variant `nonsense`, expected one of `router`",
        ),
        ("router --zenoh endpoint.json5", "foo, line 1, column 26"),
        (
            &format!("{node} --zenoh tls.json5"),
            "tls.json5: tls/127.0.0.1:1: an endpoint is tcp/HOST:PORT or quic/HOST:PORT",
        ),
        (
            "router --zenoh udp.json5",
            "udp.json5: udp/127.0.0.1:0: an endpoint is tcp/HOST:PORT or quic/HOST:PORT",
        ),
        (
            "refine --fleet f --robot r none.xyz part.xyz",
            "none.xyz: No such file or directory (os error 2)",
        ),
        (
            &format!("{node} {listen} --state part.xyz"),
            "part.xyz: it is no directory",
        ),
    ] {
        let line = said(at, arguments, 1);
        assert_eq!(line.matches(words).count(), 1, "{arguments}: {line}");
    }
}

/// An endpoint that cannot be listened on is not reported as a router that does not run.
#[test]
fn endpoints_that_do_not_work_come_with_a_hint_that_fits() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let taken = taken.local_addr().expect("it is bound");
    let port = "is it an address of this machine, and is its port free?";
    for (arguments, words) in [
        (
            format!("router --connect tcp/{taken}"),
            "is the router running there?",
        ),
        (
            "router --connect tcp/router.invalid:7447".into(),
            "is the name right?",
        ),
        (format!("router --listen tcp/{taken}"), port),
        ("router --listen tcp/192.0.2.1:7447".into(), port),
        ("fleet --robots 1 --listen tcp/192.0.2.1:7447".into(), port),
        (
            "router --listen quic/127.0.0.1:0".into(),
            "quic needs certificates: name them in a configuration, --zenoh",
        ),
    ] {
        let line = said(folder.path(), &arguments, 1);
        assert!(line.ends_with(words), "{line}");
        let (_, endpoint) = arguments.rsplit_once(' ').expect("an endpoint");
        assert!(line.contains(endpoint), "{line}");
    }
}
