//! Training runs as a user sees them: killed at random moments, asked to stop, resumed, out of disk space.
#![cfg(unix)]

mod support;

use host_train::policy::checkpoint::{Checkpoint, LAST};
use host_train::random::{Purpose, stream};
use rand::RngExt;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use support::{fail, folder, read_json, run, succeed};

/// A run of 12 small updates.
const TRAIN: &str = "train --data procedural:9 --stage ilrl --points 48 --problems 2 --trajectories 1 \
                     --mini-batch 10 --epochs 3 --checkpoint-minutes 0";

fn start(folder: &Path, arguments: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_host-train"))
        .current_dir(folder)
        .args(arguments.split_whitespace())
        .stderr(Stdio::piped())
        .spawn()
        .expect("host-train runs")
}

/// The updates in a run's metrics, in their order.
fn updates(run: &Path) -> Vec<u64> {
    let text = std::fs::read_to_string(run.join("metrics.jsonl")).expect("the run's metrics");
    let lines = text
        .lines()
        .map(|line| -> serde_json::Value { serde_json::from_str(line).expect("a whole line") });
    lines.filter_map(|line| line["update"].as_u64()).collect()
}

#[test]
fn a_run_killed_at_random_moments_ends_as_an_undisturbed_one() {
    let folder = folder();
    let at = folder.path();
    succeed(at, &format!("{TRAIN} --out whole"));
    let last = |name: &str| Checkpoint::load(&at.join(name).join(LAST)).expect("a checkpoint");
    let mut rng = stream(1, Purpose::Split, 0);
    let mut kills = 0;
    for attempt in 0.. {
        let resume = at.join("killed/config.json").exists();
        let mut child = match resume {
            true => start(at, "train --resume --out killed"),
            false => start(at, &format!("{TRAIN} --out killed")),
        };
        // Only the moment is random; nothing is waited for. The last attempts run to their end.
        let moment = Duration::from_millis(rng.random_range(20..1500));
        if attempt < 8 {
            std::thread::sleep(moment);
            child.kill().expect("it was started");
        }
        if child.wait().expect("it was started").success() {
            break;
        }
        kills += 1;
        assert!(kills <= 8, "the run fails by itself");
        for name in ["last", "previous", "best/checkpoint"] {
            let path = at.join(format!("killed/{name}.safetensors"));
            if path.exists() {
                Checkpoint::load(&path).expect("no torn checkpoint is ever seen");
            }
        }
    }
    assert!(kills > 0, "nothing was killed");
    let same = last("whole") == last("killed");
    assert!(same, "other bits after {kills} kills");
    assert_eq!(updates(&at.join("killed")), (0..12).collect::<Vec<_>>());
}

#[test]
fn a_run_told_to_terminate_leaves_a_checkpoint() {
    let folder = folder();
    let at = folder.path();
    let arguments = TRAIN.replace("--epochs 3", "--epochs 100000");
    let arguments = arguments.replace("--checkpoint-minutes 0", "--checkpoint-minutes 99");
    let mut child = start(at, &format!("{arguments} --out run"));
    let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines();
    let epoch = lines.find(|line| line.as_ref().is_ok_and(|line| line.starts_with("epoch")));
    assert!(epoch.is_some(), "an epoch passes");
    // With an end that the run has passed, so that a missing lock is an error, too, and no endless run.
    let again = "train --resume --out run --epochs 1";
    fail(at, again, &["run: another process trains here"]);
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-TERM", &id]).status();
    assert!(sent.expect("kill is there").success());
    let rest: Vec<String> = lines.map_while(Result::ok).collect();
    assert_eq!(child.wait().expect("it was started").code(), Some(1));
    assert!(
        rest.iter().any(|line| line.contains("--resume")),
        "{rest:?}"
    );
    let checkpoint = Checkpoint::load(&at.join("run").join(LAST)).expect("whole");
    let metrics = updates(&at.join("run"));
    assert_eq!(checkpoint.progress.updates, metrics.len() as u64);
}

#[test]
fn what_cannot_be_resumed_is_named() {
    let folder = folder();
    let at = folder.path();
    fail(at, "train --resume --out run", &["config.json"]);
    succeed(at, &format!("{TRAIN} --out run"));
    let again = "train --resume --out run";
    fail(at, &format!("{TRAIN} --out run"), &["--resume"]);
    fail(
        at,
        &format!("{again} --points 50"),
        &["points was 48 and is 50"],
    );
    fail(at, &format!("{again} --seed 7"), &["seed was 42 and is 7"]);
    fail(
        at,
        &format!("{again} --expert greedy --alpha 0.1"),
        &["method.expert", "method.ppo.alpha"],
    );
    // It has an end, and nothing before that can be asked for.
    let ended = ["12 updates", "2 epochs would end after 8", "--epochs"];
    fail(at, &format!("{again} --epochs 2"), &ended);
    assert_eq!(read_json(&at.join("run/config.json"))["epochs"], 3);
    let said = run(at, again);
    let said = String::from_utf8_lossy(&said.stderr);
    assert!(
        said.contains("nothing left to do: all 12 updates are done"),
        "{said}"
    );
    // With more epochs it is still the same run.
    let output = run(at, &format!("{again} --epochs 4"));
    assert!(output.status.success());
    assert_eq!(updates(&at.join("run")), (0..16).collect::<Vec<_>>());
}

/// A tree of 21 categories, of which the paper's protocol takes 20.
#[test]
fn what_a_run_consists_of_and_leaves_out_is_told() {
    let folder = folder();
    let at = folder.path();
    for category in 0..21 {
        let dir = at.join(format!("data/c{category:02}"));
        std::fs::create_dir_all(&dir).expect("made");
        let point = |i: usize| format!("{} {} {}\n", i % 5, i % 7 + category, i % 11);
        let cloud: String = (0..60).map(point).collect();
        std::fs::write(dir.join("a.xyz"), cloud).expect("written");
    }
    let train = TRAIN.replace("--epochs 3", "--epochs 1");
    let train = train.replace("procedural:9", "data");
    let said = run(at, &format!("{train} --out run"));
    let said = String::from_utf8_lossy(&said.stderr);
    for words in [
        "training on 19 clouds, validating on 100 pairs drawn from 1 more, 10 updates of 20 observations",
        "\n1 category left out: training takes the first 20 (--categories all)\n",
        "\n10 updates will teach little: with --epochs 22 there are 200",
        "\nepoch 0 was best on validation: host-train export --run run --out run.rgw",
        "training and evaluation read the same 21 files",
    ] {
        assert!(said.contains(words), "no {words} in {said}");
    }
    let all = run(at, &format!("{train} --out all --categories all"));
    assert!(!String::from_utf8_lossy(&all.stderr).contains("left out"));
    let eval = "eval --data data --protocol m40-models --methods init";
    let said = run(at, eval);
    let said = String::from_utf8_lossy(&said.stderr);
    let words = "1 of 21 categories left out: protocol m40-models takes labels 0 to 19";
    assert!(said.contains(words), "{said}");
}

/// A limit on the size of files stands in for a full disk.
#[test]
fn a_full_disk_is_named_before_training_starts() {
    let folder = folder();
    let program = env!("CARGO_BIN_EXE_host-train");
    let script = format!("trap '' XFSZ; ulimit -f 20000; exec {program} {TRAIN} --out run");
    let output = Command::new("sh")
        .args(["-c", &script])
        .current_dir(folder.path())
        .output()
        .expect("sh runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(
        stderr.starts_with("error: cannot write to run directory run"),
        "{stderr}"
    );
    assert_eq!(stderr.lines().count(), 1, "nothing was trained: {stderr}");
}

/// A run directory stands for its best policy, even if no robot could run that.
#[test]
fn run_directories_are_evaluated() {
    let folder = folder();
    let at = folder.path();
    let train = TRAIN.replace("--epochs 3", "--epochs 1");
    succeed(at, &format!("{train} --out wide"));
    succeed(
        at,
        &format!("{train} --shape deep --accumulation local --out deep"),
    );
    let pairs = "--data procedural --protocol m40-models --count 2 --per-step";
    let table = succeed(at, &format!("eval --weights wide deep {pairs}"));
    assert!(table.contains("wide") && table.contains("deep"), "{table}");
    // Its poses can still be refined.
    let refined = "--methods policy+icp,policy+polish,policy+verify --json deep.json";
    let pairs = "--data procedural --protocol m40-models --count 2";
    succeed(at, &format!("eval --weights deep {refined} {pairs}"));
    let rows = &read_json(&at.join("deep.json"))["methods"];
    for name in ["deep+icp", "deep+polish", "deep+verify"] {
        assert!(rows[name]["r_iso_deg"].is_f64(), "{name} in {rows}");
    }
    succeed(at, "export --run wide --out wide.rgw");
    let refused = "export --run deep --out deep.rgw";
    fail(at, refused, &["local accumulation"]);
    // What was trained registers at once.
    let clouds = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 0\n";
    std::fs::write(at.join("a.xyz"), clouds).expect("written");
    let [run, file] = ["wide", "wide.rgw"].map(|weights| {
        let register = format!("register a.xyz a.xyz --mode fast --weights {weights} --json -");
        let mut answer: serde_json::Value =
            serde_json::from_str(&succeed(at, &register)).expect("JSON");
        answer["target_from_source"].take()
    });
    assert!(run.is_array() && run == file, "{run} {file}");
    let unknown = "register a.xyz a.xyz --weights wider";
    fail(at, unknown, &["no policy wider", "reagent-int8, compact"]);
    assert!(!at.join("deep.rgw").exists());
}
