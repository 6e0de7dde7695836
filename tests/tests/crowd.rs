//! A member who opens more sessions than anybody needs, and strangers who connect and say nothing.

mod support;

use firmware_sim::client;
use firmware_sim::session::{SessionArgs, open};
use host_train::publish::Publisher;
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use support::secured::{LAB, Secured};
use support::{Network, key, random_cloud, random_policy, request, until};
use tokio::net::UdpSocket;
use zenoh::Session;

/// Set in the process that has its own network namespace.
const WITHIN: &str = "REAGENT_LIMITED";
const LIMITED: &str = "one_address_takes_no_more_connections_than_the_kernel_lets_it";

/// Opens sessions with one robot's certificate until no more are accepted.
async fn crowd(secured: &Secured, most: usize) -> Vec<Session> {
    let mut sessions = Vec::new();
    while sessions.len() < most {
        let args = SessionArgs {
            zenoh: Some(secured.config("arm2")),
            ..SessionArgs::default()
        };
        match open(&args).await {
            Ok(session) => sessions.push(session),
            Err(_) => break,
        }
    }
    sessions
}

/// With `firmware-sim/deploy/nftables.conf`, in a network namespace of its own.
#[tokio::test(flavor = "multi_thread")]
async fn one_address_takes_no_more_connections_than_the_kernel_lets_it() {
    if std::env::var_os(WITHIN).is_none() {
        let program = std::env::current_exe().expect("this one");
        let mut inside = Command::new("unshare");
        inside.arg("--net").arg(program);
        inside.args([LIMITED, "--exact", "--nocapture"]);
        let ended = inside.env(WITHIN, "1").output();
        let Ok(ended) = ended else {
            return eprintln!("skipped: unshare is not installed");
        };
        let said = String::from_utf8_lossy(&ended.stderr);
        if said.contains("Operation not permitted") {
            return eprintln!("skipped: no network of its own may be made here");
        }
        eprintln!("{said}");
        let printed = String::from_utf8_lossy(&ended.stdout);
        return assert!(ended.status.success(), "{printed}");
    }
    let up = Command::new("ip")
        .args(["link", "set", "lo", "up"])
        .status();
    assert!(up.is_ok_and(|up| up.success()), "loopback");
    let Some(secured) = Secured::start().await else {
        return;
    };
    let rules = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-sim/deploy/nftables.conf");
    let rules = std::fs::read_to_string(rules).expect("readable");
    let port = format!("define port = {}", secured.port);
    let rules = rules.replace("define port = 7447", &port);
    let rules = rules.replace("ct count over 32", "ct count over 4");
    let rules = rules.replace("127.0.0.0/8", "127.0.0.1, 127.0.0.2");
    let file = secured.folder.path().join("nftables.conf");
    std::fs::write(&file, rules).expect("writable");
    let loaded = Command::new("nft").arg("-f").arg(&file).status();
    if !loaded.is_ok_and(|loaded| loaded.success()) {
        return eprintln!("skipped: nft cannot set rules here");
    }

    let sessions = crowd(&secured, 10).await;
    assert_eq!(sessions.len(), 4);
    // There is still room for another address, even while a stranger begins a handshake and then says nothing.
    let stranger = UdpSocket::bind("127.0.0.3:0").await.expect("loopback");
    let hello = first_datagram(&secured).await;
    let router = ("127.0.0.1", secured.port);
    stranger.send_to(&hello, router).await.expect("sent");
    let other = SessionArgs {
        zenoh: Some(secured.config("client")),
        connect: vec![format!(
            "quic/localhost:{}?multistream=0#bind=127.0.0.2:0",
            secured.port
        )],
        ..SessionArgs::default()
    };
    open(&other).await.expect("room for others");
}

/// The first datagram of a QUIC client.
async fn first_datagram(secured: &Secured) -> Vec<u8> {
    let trap = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
    let port = trap.local_addr().expect("it is bound").port();
    let args = SessionArgs {
        zenoh: Some(secured.config("client")),
        connect: vec![format!("quic/localhost:{port}?multistream=0")],
        ..SessionArgs::default()
    };
    let joining = tokio::spawn(async move { open(&args).await });
    let mut datagram = vec![0; 1 << 16];
    let (length, _) = trap.recv_from(&mut datagram).await.expect("it comes");
    joining.abort();
    datagram.truncate(length);
    datagram
}

/// With robots and operators on separate routers, a robot that takes every session of its router shuts out only robots.
#[tokio::test(flavor = "multi_thread")]
async fn a_zone_with_a_router_of_its_own_is_not_shut_out() {
    let Some(robots) = Secured::with_sessions(6).await else {
        return;
    };
    let operators = robots.second_router().await;
    let arm1 = robots.robot("arm1").await;
    let mut publisher =
        Publisher::new(robots.join_at("trainer", operators.port).await, LAB, key(1));
    let publisher = publisher.as_mut().expect("a good name");
    let published = publisher.publish(1, "first", random_policy(1)).await;
    published.expect("a good policy");
    until(&arm1, |view| view.policy.is_some()).await;

    let taken = crowd(&robots, 12).await;
    assert!(taken.len() < 6, "{} sessions", taken.len());
    let operator = robots.join_at("client", operators.port).await;
    let cloud = random_cloud(1, 50);
    let answer = client::refine(&operator, LAB, "arm1", &request(&cloud, &cloud)).await;
    answer.expect("a pose");
}

/// As many strangers as a router waits for at once, none of whom says anything.
#[tokio::test(flavor = "multi_thread")]
async fn those_who_connect_and_say_nothing_keep_nobody_out() {
    let network = Network::start().await;
    let address = network.endpoint.strip_prefix("tcp/").expect("over TCP");
    let silent: Vec<_> = (0..150)
        .map(|_| TcpStream::connect(address).expect("it listens"))
        .collect();
    network.join().await;
    drop(silent);
}
