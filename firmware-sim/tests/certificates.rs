//! What the program says of certificates that expire soon, have expired, or are not valid yet.
#![cfg(all(feature = "demo", unix))]

use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

/// A child process that does not outlive the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

fn program() -> Command {
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    program.env_remove("RUST_LOG");
    program
}

/// Makes the client's certificate again, with other times.
fn renew(folder: &Path, times: &[&str]) -> bool {
    let script = "openssl req -new -key client.key -subj /CN=client | \
        openssl x509 -req -CA ca.pem -CAkey ca.key -CAcreateserial -sha256 \
        -extfile <(echo extendedKeyUsage=clientAuth; echo subjectAltName=DNS:client) -out client.pem \"$@\"";
    let made = Command::new("bash")
        .args(["-euo", "pipefail", "-c", script, "renew"])
        .args(times)
        .current_dir(folder)
        .output()
        .expect("bash runs");
    made.status.success()
}

/// Makes the client's certificate again, as on a machine whose clock is years ahead of this one.
fn renew_from_2090(folder: &Path) -> bool {
    let script = "openssl req -new -key client.key -subj /CN=client -out client.csr; : > index; \
        printf '[ca]\\ndefault_ca=d\\n[d]\\ndatabase=index\\nrand_serial=yes\\nnew_certs_dir=.\\npolicy=p\\ndefault_md=sha256\\n[p]\\ncommonName=supplied\\n[e]\\nextendedKeyUsage=clientAuth\\nsubjectAltName=DNS:client\\n' > ca.cnf; \
        openssl ca -batch -notext -config ca.cnf -cert ca.pem -keyfile ca.key -in client.csr -extensions e \
        -startdate 20900101000000Z -enddate 20910101000000Z -out client.pem";
    let made = Command::new("bash")
        .args(["-euo", "pipefail", "-c", script])
        .current_dir(folder)
        .output()
        .expect("bash runs");
    made.status.success()
}

#[test]
fn a_certificate_that_has_expired_or_will_soon_is_told() {
    if Command::new("openssl").arg("version").output().is_err() {
        return eprintln!("skipped: openssl is not installed");
    }
    let folder = tempfile::tempdir().expect("a temporary directory");
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let port = socket.local_addr().expect("it is bound").port();
    let deploy = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/make-ca");
    let made = Command::new(deploy)
        .arg(folder.path())
        .args(["lab", &format!("localhost:{port}"), "arm1"])
        .output();
    assert!(made.expect("bash runs").status.success());
    drop(socket);
    let config = |name: &str| folder.path().join(name);

    let mut router = program();
    router.args(["router", "--log", "json", "--zenoh"]);
    router.arg(config("router.json5")).stderr(Stdio::piped());
    let mut router = Running(router.spawn().expect("the program runs"));
    let mut log = BufReader::new(router.0.stderr.take().expect("piped")).lines();
    let up = log.find_map(|line| {
        let line: serde_json::Value = serde_json::from_str(&line.expect("text")).expect("JSON");
        let message = line["fields"]["message"].as_str().unwrap_or_default();
        message.contains("is up").then(|| line.clone())
    });
    assert_eq!(up.expect("it is up")["level"], "INFO");

    let watch = |options: &[&str]| -> (Output, String) {
        let mut watch = program();
        watch.args(["fleet", "watch", "--fleet", "lab", "--once", "--zenoh"]);
        let output = watch.arg(config("client.json5")).args(options).output();
        let output = output.expect("the program runs");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        (output, said)
    };
    // With another peer's certificate, and with one that another authority has signed.
    let clouds = ["1 2 3", "2 3 5", "5 3 1", "4 4 9"].join("\n");
    std::fs::write(config("cloud.xyz"), clouds).expect("writable");
    let refine = |name: &str| {
        let mut refine = program();
        refine.args([
            "refine",
            "--fleet",
            "lab",
            "--robot",
            "any",
            "--deadline",
            "1",
            "--zenoh",
        ]);
        refine.arg(config(name));
        let output = refine.args([config("cloud.xyz"), config("cloud.xyz")]);
        let output = output.output().expect("the program runs");
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let said = refine("arm1.json5");
    assert!(said.contains("not let this certificate ask"), "{said}");
    let text = std::fs::read_to_string(config("client.json5")).expect("readable");
    let foreign = text.replace("/ca.pem", "/client.pem");
    std::fs::write(config("foreign.json5"), foreign).expect("writable");
    let said = refine("foreign.json5");
    assert!(
        said.contains("of one authority, and do both certificates hold by both clocks?"),
        "{said}"
    );
    for (own, other, wrong) in [
        ("client.pem", "none.pem", "none.pem: No such file"),
        ("client.key", "none.key", "none.key: No such file"),
        (
            "client.key",
            "arm1.key",
            "arm1.key does not seem to be the key of",
        ),
    ] {
        let other = text.replace(&format!("/{own}"), &format!("/{other}"));
        std::fs::write(config("other.json5"), other).expect("writable");
        let said = refine("other.json5");
        assert!(said.contains(wrong), "{said}");
    }
    let (output, said) = watch(&[]);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("not let this certificate see"), "{said}");
    assert!(!said.contains("expire"), "{said}");
    assert!(renew(folder.path(), &["-days", "1"]));
    let (_, said) = watch(&[]);
    assert!(said.contains("client.pem expires in"), "{said}");

    if renew_from_2090(folder.path()) {
        let (output, said) = watch(&[]);
        assert_eq!(output.status.code(), Some(1), "{said}");
        let error = said.lines().last().unwrap_or_default();
        assert!(
            error.starts_with("error: ") && error.contains("holds from"),
            "{said}"
        );
    } else {
        eprintln!("skipped: this openssl makes no certificates of other times");
    }

    if !renew(folder.path(), &["-days", "-1"]) {
        return eprintln!("skipped: this openssl makes no certificates that have expired");
    }
    let (output, said) = watch(&[]);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let error = said.lines().last().unwrap_or_default();
    assert!(
        error.starts_with("error: ") && error.contains("has expired on"),
        "{said}"
    );
    let (output, said) = watch(&["--log", "json"]);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for line in said.lines() {
        let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
        assert!(
            line["level"].is_string() && line["fields"]["message"].is_string(),
            "{line}"
        );
    }
}
