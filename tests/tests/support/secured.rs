//! A fleet whose members are authenticated, with certificates and configurations by `firmware-sim/deploy/make-ca`.

use super::key;
use firmware_sim::node::{Node, NodeConfig};
use firmware_sim::policy::Trust;
use firmware_sim::session::{SessionArgs, open};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Command;
use zenoh::Session;

/// The fleet of these tests.
pub(crate) const LAB: &str = "lab";

/// Certificates and configurations of a fleet with two robots, and its router.
pub(crate) struct Secured {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) port: u16,
    _router: Option<Session>,
}

pub(crate) fn make_ca(folder: &Path, port: u16) -> bool {
    if Command::new("openssl").arg("version").output().is_err() {
        eprintln!("skipped: openssl is not installed");
        return false;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/deploy/make-ca");
    let made = Command::new(script)
        .arg(folder)
        .args([LAB, &format!("localhost:{port}"), "arm1", "arm2"])
        .output()
        .expect("bash runs");
    let said = String::from_utf8_lossy(&made.stderr);
    assert!(made.status.success(), "{said}");
    true
}

/// A second router beside the first, for other members.
pub(crate) struct Second {
    pub(crate) port: u16,
    _router: Session,
}

/// A port that is free as soon as the socket is dropped.
fn free_port() -> (UdpSocket, u16) {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let port = socket.local_addr().expect("it is bound").port();
    (socket, port)
}

async fn router(config: PathBuf, port: u16, connect: Vec<String>) -> Session {
    let args = SessionArgs {
        zenoh: Some(config),
        listen: vec![format!("quic/127.0.0.1:{port}?multistream=0")],
        connect,
    };
    open(&args).await.expect("the port is free")
}

impl Secured {
    pub(crate) async fn start() -> Option<Secured> {
        Secured::with(|_| {}).await
    }

    /// With a router that accepts so many sessions.
    pub(crate) async fn with_sessions(most: usize) -> Option<Secured> {
        let limit = |folder: &Path| {
            let path = folder.join("router.json5");
            let text = std::fs::read_to_string(&path).expect("readable");
            let limited = text.replace("max_sessions: 1000", &format!("max_sessions: {most}"));
            assert_ne!(text, limited);
            std::fs::write(path, limited).expect("writable");
        };
        Secured::with(limit).await
    }

    async fn with(change: impl FnOnce(&Path)) -> Option<Secured> {
        let mut secured = Secured::without_router()?;
        change(secured.folder.path());
        secured._router = Some(router(secured.config("router"), secured.port, vec![]).await);
        Some(secured)
    }

    /// Only the files, without a router.
    pub(crate) fn without_router() -> Option<Secured> {
        let folder = tempfile::tempdir().expect("a temporary directory");
        // Held while the keys are made, which takes long enough for others to take the port.
        let (_socket, port) = free_port();
        make_ca(folder.path(), port).then_some(Secured {
            folder,
            port,
            _router: None,
        })
    }

    /// Renews every key and certificate, including the authority's.
    pub(crate) fn renew(&self) {
        let read = || std::fs::read(self.folder.path().join("ca.pem")).expect("readable");
        let old = read();
        for entry in std::fs::read_dir(self.folder.path()).expect("readable") {
            let path = entry.expect("readable").path();
            if path
                .extension()
                .is_some_and(|end| end == "pem" || end == "key")
            {
                std::fs::remove_file(path).expect("writable");
            }
        }
        assert!(make_ca(self.folder.path(), self.port));
        assert_ne!(old, read());
    }

    /// Starts another router of the network, connected to the first.
    pub(crate) async fn second_router(&self) -> Second {
        let (_, port) = free_port();
        let first = vec![format!("quic/localhost:{}?multistream=0", self.port)];
        Second {
            port,
            _router: router(self.config("router"), port, first).await,
        }
    }

    pub(crate) fn config(&self, name: &str) -> PathBuf {
        self.folder.path().join(format!("{name}.json5"))
    }

    pub(crate) async fn join(&self, name: &str) -> Session {
        self.join_at(name, self.port).await
    }

    /// Joins through another port of this machine than the router's own.
    pub(crate) async fn join_at(&self, name: &str, port: u16) -> Session {
        let args = SessionArgs {
            zenoh: Some(self.config(name)),
            connect: vec![format!("quic/localhost:{port}?multistream=0")],
            ..SessionArgs::default()
        };
        open(&args).await.expect("the router lets it in")
    }

    pub(crate) async fn robot(&self, robot: &str) -> Node {
        self.robot_at(robot, self.port).await
    }

    pub(crate) async fn robot_at(&self, robot: &str, port: u16) -> Node {
        self.run(self.join_at(robot, port).await, robot).await
    }

    /// A robot that uses another name than its certificate's.
    pub(crate) async fn named(&self, certificate: &str, robot: &str) -> Node {
        self.run(self.join(certificate).await, robot).await
    }

    async fn run(&self, session: Session, robot: &str) -> Node {
        let config = NodeConfig {
            fleet: LAB.into(),
            robot: robot.into(),
            trust: Trust::Keys(vec![key(1).verifying_key()]),
            state: None,
        };
        let node = Node::start(session, config).await;
        node.expect("good names")
    }
}
