//! What the program says of certificates that expire soon, have expired, or are not valid yet, and what becomes of a batch while
//! all of them are replaced.
#![cfg(all(feature = "demo", unix))]

use ed25519_dalek::SigningKey;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use host_train::dataset::pairs::PairSet;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::publish::Publisher;
use reagent_core::Pose;
use reagent_link::session::{SessionArgs, open};
use std::io::{BufRead, BufReader, Lines};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Output, Stdio};
use std::time::Duration;

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

/// Makes certificates and configurations of a fleet whose router gets a free port.
fn make_ca(folder: &Path) -> bool {
    if Command::new("openssl").arg("version").output().is_err() {
        eprintln!("skipped: openssl is not installed");
        return false;
    }
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    make_ca_at(folder, socket.local_addr().expect("it is bound").port());
    true
}

fn make_ca_at(folder: &Path, port: u16) {
    let deploy = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/make-ca");
    let made = Command::new(deploy)
        .arg(folder)
        .args(["lab", &format!("localhost:{port}"), "arm1"])
        .output();
    assert!(made.expect("bash runs").status.success());
}

/// A router, with its log. Returns the line that says that it is up, too.
fn start_router(config: &Path) -> ((Running, Lines<BufReader<ChildStderr>>), serde_json::Value) {
    let mut router = program();
    router.args(["router", "--log", "json", "--zenoh"]);
    router.arg(config).stderr(Stdio::piped());
    let mut router = Running(router.spawn().expect("the program runs"));
    let mut log = BufReader::new(router.0.stderr.take().expect("piped")).lines();
    let up = log.find_map(|line| {
        let line: serde_json::Value = serde_json::from_str(&line.expect("text")).expect("JSON");
        let message = line["fields"]["message"].as_str().unwrap_or_default();
        message.contains("is up").then(|| line.clone())
    });
    ((router, log), up.expect("it is up"))
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
    let folder = tempfile::tempdir().expect("a temporary directory");
    if !make_ca(folder.path()) {
        return;
    }
    let config = |name: &str| folder.path().join(name);
    let (_router, up) = start_router(&config("router.json5"));
    assert_eq!(up["level"], "INFO");

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

/// The keys and certificates of a folder, by their paths.
fn keys(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    let is_key = |path: &PathBuf| {
        path.extension()
            .is_some_and(|end| end == "pem" || end == "key")
    };
    let read = |path: PathBuf| (path.clone(), std::fs::read(path).expect("readable"));
    paths.filter(is_key).map(read).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_batch_loses_no_pair_while_all_certificates_are_replaced() {
    const PAIRS: usize = 1500;
    let folder = tempfile::tempdir().expect("a temporary directory");
    if !make_ca(folder.path()) {
        return;
    }
    let config = |name: &str| folder.path().join(name);
    let join = async |name: &str| {
        let args = SessionArgs {
            zenoh: Some(config(name)),
            ..SessionArgs::default()
        };
        open(&args).await.expect("the router lets it in")
    };
    // The same once more, of another authority.
    let port = std::fs::read_to_string(config("client.json5")).expect("readable");
    let (_, port) = port.split_once("quic/localhost:").expect("its endpoint");
    let digits: String = port.chars().take_while(char::is_ascii_digit).collect();
    let old = keys(folder.path());
    for (path, _) in &old {
        std::fs::remove_file(path).expect("writable");
    }
    make_ca_at(folder.path(), digits.parse().expect("a port"));
    let new = keys(folder.path());
    let put = |keys: &[(PathBuf, Vec<u8>)]| {
        for (path, bytes) in keys {
            std::fs::write(path, bytes).expect("writable");
        }
    };
    put(&old);

    let (mut router, _) = start_router(&config("router.json5"));
    let node = NodeConfig {
        fleet: "lab".into(),
        robot: "arm1".into(),
        trust: Trust::AnyKey,
        state: None,
    };
    let node = Node::start(join("arm1.json5").await, node).await;
    let node = node.expect("good names");
    let key = SigningKey::from_bytes(&[1; 32]);
    let publisher = Publisher::new(join("trainer.json5").await, "lab", key);
    let mut publisher = publisher.expect("a good name");
    let policy = WeightFile::from_parameters(&Parameters::random(Shape::COMPACT, 1));
    let published = publisher.publish(1, "p", policy.expect("deployable")).await;
    published.expect("a good policy");
    let mut view = node.watch();
    let within = Duration::from_secs(60);
    let taken = tokio::time::timeout(within, view.wait_for(|view| view.policy.is_some()));
    taken.await.expect("it is taken").expect("the node runs");

    let cloud: Vec<_> = (0..60u8)
        .map(|i| [i % 5, i % 7, i % 11].map(|x| 0.1 * f32::from(x) - 0.3))
        .collect();
    let pairs = PairSet {
        source: vec![cloud.clone(); PAIRS],
        target: vec![cloud; PAIRS],
        target_from_source: vec![Pose::IDENTITY; PAIRS],
        raw: None,
        label: vec![0; PAIRS],
        symmetries: None,
        seen: vec![None; PAIRS],
    };
    pairs.save(&config("pairs.h5")).expect("written");
    let mut batch = program();
    batch.args([
        "refine", "--fleet", "lab", "--robot", "arm1", "--mode", "fast",
    ]);
    batch
        .args(["--deadline", "60", "--zenoh"])
        .arg(config("client.json5"));
    batch.arg("--pairs").arg(config("pairs.h5"));
    let batch = tokio::task::spawn_blocking(move || batch.output());
    let begun = tokio::time::timeout(within, view.wait_for(|view| view.served > 20));
    begun.await.expect("it answers").expect("the node runs");
    put(&new);
    let served = view.borrow().served as usize;
    let id = router.0.0.id().to_string();
    let told = Command::new("kill").args(["-TERM", &id]).status();
    assert!(told.expect("kill runs").success());
    router.0.0.wait().expect("it ends");
    assert!(served < PAIRS, "the batch is over");
    let (_router, _) = start_router(&config("router.json5"));
    let output = batch
        .await
        .expect("it does not panic")
        .expect("the program runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert!(view.borrow().served as usize >= PAIRS);
}
