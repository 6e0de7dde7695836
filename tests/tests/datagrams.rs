//! Secured links over a network that loses, delays and reorders datagrams.

mod support;

use firmware_sim::client::Client;
use firmware_sim::session::{SessionArgs, open};
use futures::future::join_all;
use host_train::publish::Publisher;
use reagent_core::Pose;
use reagent_core::wire::RefineRequest;
use std::time::Duration;
use support::datagrams::Datagrams;
use support::secured::{LAB, Secured};
use support::{int8_policy, key, local_pose, random_cloud, request, until};
use tokio::net::UdpSocket;

#[tokio::test(flavor = "multi_thread")]
async fn what_is_lost_late_or_overtaken_changes_no_pose() {
    let Some(secured) = Secured::start().await else {
        return;
    };
    let link = Datagrams::to(secured.port, 1).await;
    let robot = secured.robot_at("arm1", link.port).await;
    let mut publisher = Publisher::new(secured.join("trainer").await, LAB, key(1));
    let publisher = publisher.as_mut().expect("a good name");
    let policy = int8_policy();
    let published = publisher.publish(1, "first", policy.clone()).await;
    published.expect("a good policy");
    until(&robot, |view| view.policy.is_some()).await;

    let client = Client::new(secured.join("client").await, LAB).await;
    let client = client.expect("a good name");
    link.spoil();
    let clouds: Vec<_> = [50, 60, 400].map(|points| random_cloud(1, points)).into();
    let asked = clouds.iter().zip(1..).map(|(cloud, id)| {
        let request = RefineRequest {
            id,
            ..request(cloud, cloud)
        };
        let client = &client;
        async move { client.refine("arm1", &request).await }
    });
    for (answer, cloud) in join_all(asked).await.into_iter().zip(&clouds) {
        let reply = answer.expect("a pose, if late");
        let expected = local_pose(&policy, cloud, cloud, Pose::IDENTITY);
        assert_eq!(reply.target_from_source, expected.to_rows());
    }
    let [lost, overtaken] = link.harm();
    assert!(
        lost > 0 && overtaken > 0,
        "{lost} lost, {overtaken} overtaken"
    );
}

/// Zenoh 1.10 then waits for the rest of a handshake that never comes, before it lets anybody else in.
#[tokio::test(flavor = "multi_thread")]
async fn one_forged_datagram_ends_no_link() {
    let Some(secured) = Secured::start().await else {
        return;
    };
    let robot = secured.robot("arm1").await;
    let mut publisher = Publisher::new(secured.join("trainer").await, LAB, key(1));
    let publisher = publisher.as_mut().expect("a good name");
    let published = publisher.publish(1, "first", int8_policy()).await;
    published.expect("a good policy");
    until(&robot, |view| view.policy.is_some()).await;
    let client = Client::new(secured.join("client").await, LAB).await;
    let client = client.expect("a good name");

    // The first datagram of a client that comes by another port, without its certificate.
    let strange = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
    let port = strange.local_addr().expect("it is bound").port();
    let args = SessionArgs {
        connect: vec![format!("quic/localhost:{port}?multistream=0")],
        zenoh: Some(secured.config("client")),
        ..SessionArgs::default()
    };
    let knocking = tokio::spawn(async move { open(&args).await.is_err() });
    let mut datagram = [0; 2048];
    let (length, _) = strange.recv_from(&mut datagram).await.expect("it comes");
    let forged = strange.send_to(&datagram[..length], ("127.0.0.1", secured.port));
    forged.await.expect("it is sent");

    let cloud = random_cloud(1, 60);
    for id in 1..=20 {
        let request = RefineRequest {
            id,
            ..request(&cloud, &cloud)
        };
        let answer = client.refine("arm1", &request);
        let answer = tokio::time::timeout(Duration::from_secs(20), answer).await;
        answer.expect("in time").expect("a pose");
    }
    knocking.abort();
}
