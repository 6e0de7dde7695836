//! What a robot keeps over restarts when it is damaged, deleted, or put back to an earlier state.

mod support;

use firmware_sim::flash::FILE;
use firmware_sim::node::{Node, NodeError};
use firmware_sim::policy::UpdateError;
use host_train::publish::{Publisher, manifest};
use reagent_core::wire::WhyNot;
use std::path::{Path, PathBuf};
use support::{Host, Network, config, int8_policy, publisher, until};

/// Bytes of each copy of the record.
const RECORD: usize = 8192;

async fn start(network: &Network, state: &Path) -> Result<Node, NodeError> {
    Node::start(network.join().await, config(state)).await
}

/// The state of a robot that has taken these versions.
async fn state_of(network: &Network, state: &Path, versions: &[u64]) -> PathBuf {
    let node = start(network, state).await.expect("good names");
    let mut publisher: Publisher = publisher(network).await;
    for &version in versions {
        let shipped = publisher.publish(version, "kept", int8_policy()).await;
        let shipped = shipped.expect("a good policy");
        until(&node, |view| view.policy.as_ref() == Some(&shipped)).await;
    }
    node.stop().await;
    state.join(FILE)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lost_record_does_not_lead_back_to_an_old_version() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let network = Network::start().await;
    let file = state_of(&network, folder.path(), &[1, 2]).await;
    let whole = std::fs::read(&file).expect("readable");
    let end = whole.len() - RECORD;

    for lost in [0..RECORD, end..whole.len()] {
        let mut bytes = whole.clone();
        bytes[lost.clone()].fill(0);
        std::fs::write(&file, bytes).expect("writable");
        let node = start(&network, folder.path())
            .await
            .expect("the other copy is there");
        let session = network.join().await;
        let policy = int8_policy();
        let older = manifest(1, "older", &policy).expect("a good policy");
        let host = Host::of_file(&session, older, policy.bytes().to_vec()).await;
        host.announce(&session).await;
        let view = until(&node, |view| view.updates_refused == 1).await;
        let told = view.not_taken.expect("it is told").reason;
        assert!(
            matches!(told, WhyNot::NotNewer(last) if last.version == 2),
            "{told}"
        );
        assert_eq!(view.policy.map(|p| p.version), Some(2), "{lost:?}");
        node.stop().await;
    }

    // Both copies erased, or the file cut at its front or at its end.
    let mut erased = whole.clone();
    erased[..RECORD].fill(0);
    erased[end..].fill(0);
    let noise = vec![0x5a; whole.len()];
    for bytes in [
        &erased[..],
        &whole[RECORD..],
        &erased[..end / 2],
        &noise,
        &[],
    ] {
        std::fs::write(&file, bytes).expect("writable");
        let error = start(&network, folder.path()).await;
        let error = error.expect_err("nobody knows the version");
        assert!(
            matches!(error, NodeError::Store(UpdateError::Lost { .. })),
            "{error}"
        );
        let text = error.to_string();
        assert!(text.contains(FILE) && text.contains("backup"), "{text}");
    }
    let longer = [&whole[..], &[0]].concat();
    std::fs::write(&file, longer).expect("writable");
    let error = start(&network, folder.path()).await;
    let error = error.expect_err("it is something else").to_string();
    assert!(error.contains("more than a robot's flash"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn slots_put_back_to_an_older_version_are_not_used() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let network = Network::start().await;
    let file = state_of(&network, folder.path(), &[1]).await;
    let old = std::fs::read(&file).expect("readable");
    let file = state_of(&network, folder.path(), &[2, 3]).await;
    let mut bytes = std::fs::read(&file).expect("readable");
    let slots = RECORD..bytes.len() - RECORD;
    bytes[slots.clone()].copy_from_slice(&old[slots]);
    std::fs::write(&file, bytes).expect("writable");
    let node = start(&network, folder.path()).await.expect("it starts");
    let view = until(&node, |_| true).await;
    assert_eq!(view.policy, None);
    let error = view.last_refusal.expect("it is said");
    let is_older = |error: &UpdateError| match error {
        UpdateError::Kept { reason, .. } => matches!(**reason, UpdateError::NotNewer { .. }),
        _ => false,
    };
    assert!(is_older(&error), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_damaged_kept_policy_is_told_by_its_file_and_not_as_an_announcement() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let network = Network::start().await;
    let file = state_of(&network, folder.path(), &[1]).await;
    let mut bytes = std::fs::read(&file).expect("readable");
    // A bit within the first slot's manifest.
    bytes[RECORD + 40] ^= 1;
    std::fs::write(&file, bytes).expect("writable");
    let node = start(&network, folder.path()).await.expect("it starts");
    let view = until(&node, |_| true).await;
    assert_eq!((view.policy, view.not_taken), (None, None));
    let said = view.last_refusal.expect("it is said").to_string();
    assert!(
        said.starts_with(&file.display().to_string()) && said.contains("policy kept there"),
        "{said}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_state_directory_deleted_under_a_robot_is_noticed() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let state = folder.path().join("state");
    let network = Network::start().await;
    let node = start(&network, &state).await.expect("good names");
    // One publisher, since a new one is asked for its policy besides announcing it, and would be refused twice.
    let mut publisher = publisher(&network).await;
    let published = publisher.publish(1, "first", int8_policy()).await;
    published.expect("a good policy");
    until(&node, |view| view.policy.is_some()).await;
    std::fs::remove_dir_all(&state).expect("deletable");
    let view = until(&node, |view| view.state_lost).await;
    assert!(view.status().health.state_lost, "others see it");

    // The robot does not take what it cannot keep, and it says so.
    let published = publisher.publish(2, "second", int8_policy()).await;
    published.expect("a good policy");
    let view = until(&node, |view| view.updates_refused == 1).await;
    let told = view.not_taken.expect("it is told").reason;
    assert_eq!(told, WhyNot::NotKept);
    assert_eq!(view.policy.map(|p| p.version), Some(1));
}

/// A robot's file has its full length from the start: one that was cut off has lost what was in it, though only zeros are left.
#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_was_cut_off_is_no_new_robot() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let network = Network::start().await;
    let file = state_of(&network, folder.path(), &[1]).await;
    let whole = std::fs::read(&file).expect("readable");
    for length in [0, 1, RECORD, whole.len() - 1] {
        std::fs::write(&file, vec![0; length]).expect("writable");
        let error = start(&network, folder.path()).await;
        let error = error.expect_err("nobody knows the version");
        let is_lost = matches!(error, NodeError::Store(UpdateError::Lost { .. }));
        assert!(is_lost, "{length}: {error}");
        let found = std::fs::metadata(&file).expect("there").len();
        assert_eq!(found, length as u64, "it is as it was found");
    }
    // A copy of the record tells the version, whatever else is lost, and erased flash is a new robot.
    for bytes in [&whole[..whole.len() - 1], &vec![0; whole.len()]] {
        std::fs::write(&file, bytes).expect("writable");
        let node = start(&network, folder.path()).await.expect("it starts");
        node.stop().await;
    }
}
