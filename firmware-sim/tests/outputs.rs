//! Files that commands write, and files that a robot keeps: through links and devices, and on a full disk.
#![cfg(all(feature = "demo", unix))]

use ed25519_dalek::SigningKey;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::view::View;
use host_train::learn::nn::{Parameters, Shape};
use host_train::policy::WeightFile;
use host_train::publish::Publisher;
use reagent_core::wire::{WhyNot, keys};
use reagent_tests::network::network;
use std::fs::{self, Permissions};
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;
use zenoh::Session;

/// A router, a robot with a policy, and two clouds to ask it about.
struct Fleet {
    endpoint: String,
    publisher: Publisher,
    node: Node,
    router: Session,
    clouds: [PathBuf; 2],
    folder: tempfile::TempDir,
}

/// Only one test runs at a time: a process that another test starts would hold the locks of this one's files for a moment.
static ALONE: tokio::sync::Mutex<()> = tokio::sync::Mutex::const_new(());

fn policy(seed: u64) -> WeightFile {
    WeightFile::from_parameters(&Parameters::random(Shape::COMPACT, seed)).expect("deployable")
}

async fn until(node: &Node, wanted: impl FnMut(&View) -> bool) -> View {
    let mut view = node.watch();
    let reached = tokio::time::timeout(Duration::from_secs(60), view.wait_for(wanted));
    let reached = reached.await.expect("the node gets there within a minute");
    reached.expect("the node runs").clone()
}

impl Fleet {
    async fn start(state: Option<&Path>) -> Fleet {
        let (router, endpoint) = network().await;
        let config = NodeConfig {
            fleet: "f".into(),
            robot: "r1".into(),
            trust: Trust::AnyKey,
            state: state.map(Path::to_owned),
        };
        let node = Node::start(router.clone(), config).await;
        let node = node.expect("good names");
        let publisher = Publisher::new(router.clone(), "f", SigningKey::from_bytes(&[1; 32]));
        let folder = tempfile::tempdir().expect("a temporary directory");
        let cloud = |name: &str, shift: usize| {
            let point = |i: usize| format!("{} {} {}\n", i % 7, i % 11 + shift, i % 13);
            let path = folder.path().join(name);
            fs::write(&path, (0..900).map(point).collect::<String>()).expect("written");
            path
        };
        Fleet {
            clouds: [cloud("a.xyz", 0), cloud("b.xyz", 1)],
            endpoint,
            publisher: publisher.expect("a good name"),
            node,
            router,
            folder,
        }
    }

    async fn give_policy(&mut self, version: u64) {
        let shipped = self.publisher.publish(version, "p", policy(version)).await;
        shipped.expect("a good policy");
    }

    /// Asks the robot, with these further options.
    async fn refine(&self, options: &[&Path]) -> Output {
        let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
        program.args(["refine", "--fleet", "f", "--robot", "r1"]);
        program.args(["--deadline", "60", "--connect", &self.endpoint]);
        program.args(&self.clouds).args(options);
        let asked = tokio::task::spawn_blocking(move || program.output());
        let output = asked.await.expect("it does not panic");
        output.expect("the program runs")
    }
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).expect("a file").permissions().mode() & 0o7777
}

#[tokio::test(flavor = "multi_thread")]
async fn links_are_followed_modes_kept_and_devices_written_through() {
    let _alone = ALONE.lock().await;
    let mut fleet = Fleet::start(None).await;
    fleet.give_policy(1).await;
    until(&fleet.node, |view| view.policy.is_some()).await;
    let at = |name: &str| fleet.folder.path().join(name);
    fs::write(at("kept.json"), "old").expect("written");
    fs::set_permissions(at("kept.json"), Permissions::from_mode(0o640)).expect("its owner");
    symlink("kept.json", at("link.json")).expect("linked");
    let (json, trace) = (at("link.json"), at("run.trace"));
    let options = [
        Path::new("--json"),
        &json,
        Path::new("--mode"),
        Path::new("fast"),
        Path::new("--trace"),
        trace.as_path(),
    ];
    let output = fleet.refine(&options).await;
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("pose not judged after"), "{said}");
    assert!(json.is_symlink());
    assert_eq!(mode(&at("kept.json")), 0o640);
    let text = fs::read_to_string(&json).expect("readable");
    let answer: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(answer["robot"], "r1");
    // What is undetermined is reported in the mode that looks for it.
    for (mode, is_looked_for) in [("polish", false), ("refine", false), ("verify", true)] {
        let options = [Path::new("--mode"), Path::new(mode), options[0], &json];
        let output = fleet.refine(&options).await;
        assert!(output.status.success(), "{output:?}");
        let text = fs::read_to_string(&json).expect("readable");
        let answer: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let fit = &answer["fit"];
        assert!(fit["overlap"].is_number(), "{mode}");
        let open = fit.get("undetermined").map(serde_json::Value::is_object);
        assert_eq!(open, is_looked_for.then_some(true), "{mode}");
    }
    assert!(fs::read(&trace).expect("readable").len() > 2 * 900 * 12);
    // What `host-train register` remarks on a pose, a robot's answer lets say, too.
    let options = ["--mode", "polish", "--scale", "25.4"].map(Path::new);
    let output = fleet.refine(&options).await;
    let said = String::from_utf8_lossy(&output.stdout);
    for words in [
        "sizes differ: the source is about 25.4 times as large",
        "See --unit and --scale",
        " likely to be right; mode polish)",
    ] {
        assert!(said.contains(words), "{said}");
    }

    let null = Path::new("/dev/null");
    let options = [Path::new("--json"), null, Path::new("--trace"), null];
    let output = fleet.refine(&options).await;
    assert!(output.status.success(), "{output:?}");
    let null = fs::symlink_metadata(null).expect("there");
    assert!(null.file_type().is_char_device());

    // A file that cannot be written is noticed before any robot is asked, and old files stay.
    let before = fleet.node.watch().borrow().served;
    for option in ["--json", "--trace"] {
        let missing = at("no/such/file");
        let output = fleet.refine(&[Path::new(option), &missing]).await;
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.contains("cannot write") && said.contains("no/such/file"),
            "{said}"
        );
    }
    assert_eq!(fleet.node.watch().borrow().served, before);
    fleet.router.close().await.expect("it was open");
}

/// What a robot says of its state directory until it is up.
async fn said_of(router: &Session, endpoint: &str, state: &Path) -> String {
    let alive = keys::alive("f", "r2").expect("good names");
    let tokens = router.liveliness().declare_subscriber(alive.as_str());
    let tokens = tokens.await.expect("an open session");
    let mut program = Command::new(env!("CARGO_BIN_EXE_firmware-sim"));
    program.args(["node", "--fleet", "f", "--robot", "r2", "--trust-any"]);
    program.args(["--connect", endpoint, "--state"]).arg(state);
    program.env_remove("RUST_LOG").stderr(Stdio::piped());
    let mut node = program.spawn().expect("the program runs");
    tokens.recv_async().await.expect("it comes up");
    node.kill().expect("it runs");
    let output = node.wait_with_output().expect("it was started");
    // Wait until it is gone, before the next robot starts.
    tokens.recv_async().await.expect("an open session");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_knows_of_no_version_says_so() {
    let _alone = ALONE.lock().await;
    let (router, endpoint) = network().await;
    let state = tempfile::tempdir().expect("a temporary directory");
    let new = said_of(&router, &endpoint, state.path()).await;
    assert!(new.contains("is new"), "{new}");
    let wiped = said_of(&router, &endpoint, state.path()).await;
    assert!(
        wiped.contains("WARN") && wiped.contains("was wiped"),
        "{wiped}"
    );
}

#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn a_folder_that_takes_no_file_is_named_without_a_temporary_one() {
    let (router, _) = network().await;
    let config = NodeConfig {
        fleet: "f".into(),
        robot: "r1".into(),
        trust: Trust::AnyKey,
        state: Some("/proc/self".into()),
    };
    let error = Node::start(router, config)
        .await
        .expect_err("no file is made there");
    let said = error.to_string();
    assert!(said.contains("--state /proc/self: "), "{said}");
    assert!(!said.contains(".tmp"), "{said}");
}

/// A file system in memory, mounted on a folder.
struct Disk(tempfile::TempDir);

impl Disk {
    /// A disk of so many kilobytes. If there is none, prints why.
    fn of(kilobytes: usize) -> Option<Disk> {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let size = format!("size={kilobytes}k");
        let mount = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &size, "none"])
            .arg(folder.path())
            .output();
        if mount.is_ok_and(|output| output.status.success()) {
            return Some(Disk(folder));
        }
        eprintln!("skipped: no file system may be mounted here");
        None
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Fills the disk.
    fn fill(&self) {
        let mut bytes = 1 << 20;
        while bytes > 0 {
            let path = self.at(&format!("filler-{bytes}"));
            if fs::write(&path, vec![1; bytes]).is_err() {
                fs::remove_file(&path).ok();
                bytes /= 2;
                continue;
            }
            bytes = bytes.min(1 << 12) / 2;
        }
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        Command::new("umount").arg(self.0.path()).output().ok();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn on_a_full_disk_old_answers_and_traces_stay() {
    let _alone = ALONE.lock().await;
    let Some(disk) = Disk::of(64) else { return };
    let mut fleet = Fleet::start(None).await;
    fleet.give_policy(1).await;
    until(&fleet.node, |view| view.policy.is_some()).await;
    fs::write(disk.at("old"), "old content").expect("written");
    disk.fill();
    for option in ["--json", "--trace"] {
        for (name, kept) in [("old", Some("old content")), ("new", None)] {
            let output = fleet.refine(&[Path::new(option), &disk.at(name)]).await;
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(1), "{said}");
            assert!(said.contains("No space left"), "{said}");
            let found = fs::read_to_string(disk.at(name)).ok();
            assert_eq!(found.as_deref(), kept, "{option} {name}");
        }
    }
    let entries = fs::read_dir(disk.0.path()).expect("a folder");
    let names = entries.map(|entry| entry.expect("an entry").file_name());
    let strange = names
        .map(|name| name.to_string_lossy().into_owned())
        .find(|name| name != "old" && !name.starts_with("filler"));
    assert_eq!(strange, None);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_with_a_full_disk_keeps_its_policy_and_says_that_it_cannot_take_another() {
    let _alone = ALONE.lock().await;
    // Room for one policy, but not for two.
    let Some(disk) = Disk::of(1600) else { return };
    let state = disk.at("state");
    let mut fleet = Fleet::start(Some(&state)).await;
    fleet.give_policy(1).await;
    until(&fleet.node, |view| view.policy.is_some()).await;
    disk.fill();
    fleet.give_policy(2).await;
    let view = until(&fleet.node, |view| view.updates_refused == 1).await;
    assert_eq!(view.not_taken.map(|not| not.reason), Some(WhyNot::NotKept));
    let error = view.last_refusal.expect("it is said").to_string();
    assert!(error.contains("No space left"), "{error}");
    assert_eq!(view.policy.map(|policy| policy.version), Some(1));
    fleet.node.stop().await;

    // The robot starts with the old policy.
    let config = NodeConfig {
        fleet: "f".into(),
        robot: "r2".into(),
        trust: Trust::AnyKey,
        state: Some(state),
    };
    drop(fleet.publisher);
    let node = Node::start(fleet.router, config).await.expect("it starts");
    let view = until(&node, |view| view.policy.is_some()).await;
    assert_eq!(view.policy.map(|policy| policy.version), Some(1));
}
