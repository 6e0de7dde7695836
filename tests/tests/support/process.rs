//! Members of a fleet as separate processes, which can be killed: a test program that runs itself again.

use super::{FLEET, key};
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::session::{SessionArgs, open};
use host_train::policy::WeightFile;
use host_train::publish::Publisher;
use std::future::pending;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Variable with a process's role, one word a line.
const ROLE: &str = "REAGENT_ROLE";
/// What a member prints when it is ready.
const UP: &str = "this member is up";

/// A process with a role. It ends when this value is dropped, and with this program.
pub(crate) struct Member(Child);

impl Member {
    /// Runs this program's test `test` with a role: `router CONFIG`, `node CONFIG ROBOT STATE` or `publisher CONFIG
    /// POLICY VERSION`.
    pub(crate) fn start(test: &str, role: &[&str]) -> Member {
        let program = std::env::current_exe().expect("this one");
        let mut process = Command::new(program);
        process.args([test, "--exact", "--nocapture"]);
        process.env(ROLE, role.join("\n")).stdin(Stdio::piped());
        process.stdout(Stdio::piped()).stderr(Stdio::null());
        Member(process.spawn().expect("it runs"))
    }

    /// Waits until it is ready.
    pub(crate) fn wait_until_up(&mut self) {
        let said = self.0.stdout.as_mut().expect("piped");
        let mut lines = BufReader::new(said).lines();
        let up = lines.any(|line| line.expect("text").contains(UP));
        assert!(up, "it ended");
    }

    /// Whether it has ended by itself.
    pub(crate) fn has_ended(&mut self) -> bool {
        self.0.try_wait().expect("a child").is_some()
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// If this process has a role, plays it without end.
pub(crate) async fn play() {
    let Ok(role) = std::env::var(ROLE) else {
        return;
    };
    // The other end closes when the program that started this one ends, in whatever way.
    std::thread::spawn(|| {
        std::io::stdin().read_to_end(&mut Vec::new()).ok();
        std::process::exit(0);
    });
    let join = async |config: &str| {
        let args = SessionArgs {
            zenoh: Some(config.into()),
            ..SessionArgs::default()
        };
        open(&args).await.expect("a session")
    };
    match role.lines().collect::<Vec<_>>()[..] {
        ["router", config] => {
            let _router = join(config).await;
            println!("{UP}");
            pending().await
        }
        ["node", config, robot, state] => {
            let config_of_node = NodeConfig {
                fleet: FLEET.into(),
                robot: robot.into(),
                trust: Trust::Keys(vec![key(1).verifying_key()]),
                state: Some(state.into()),
            };
            let node = Node::start(join(config).await, config_of_node).await;
            let _node = node.expect("nobody else of this name");
            println!("{UP}");
            pending().await
        }
        ["publisher", config, policy, version] => {
            let publisher = Publisher::new(join(config).await, FLEET, key(1));
            let mut publisher = publisher.expect("a good name");
            let policy = WeightFile::load(Path::new(policy)).expect("a policy");
            let version = version.parse().expect("a number");
            let published = publisher.publish(version, "soak", policy).await;
            published.expect("a newer version");
            println!("{UP}");
            pending().await
        }
        _ => panic!("{role:?}: no such role"),
    }
}
