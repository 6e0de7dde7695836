//! Policies that are worse, and clients that ask robots on and on, for tests of roll-outs in stages.

use firmware_sim::client::Client;
use host_train::dataset::pairs::PairSet;
use host_train::policy::WeightFile;
use host_train::publish::Gate;
use reagent_core::weights::{FORMAT_INT8, checksum, offsets};
use reagent_core::wire::{CloudView, Mode, RefineRequest};
use sha2::{Digest, Sha256};
use std::path::Path;
use std::time::Duration;

/// Points of each cloud of a request.
const POINTS: usize = 256;

/// A gate with that many poses; the good policy is the old one.
pub(crate) fn gate(poses: u64) -> Gate {
    Gate {
        poses,
        wait: Duration::from_secs(60),
        except: Vec::new(),
        old: Sha256::digest(good_policy().bytes()).into(),
        anyway: false,
    }
}

/// The bundled policy for small memories.
pub(crate) fn good_policy() -> WeightFile {
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../core/weights");
    WeightFile::load(&weights.join("reagent-compact-int8.rgw")).expect("it is bundled")
}

/// The same with every so manieth weight negated: a valid file that passes its self-test.
pub(crate) fn negated(every: usize) -> WeightFile {
    let good = good_policy();
    let mut bytes = good.bytes().to_vec();
    let shape = good.policy().shape;
    for ((inputs, outputs), (weights, _)) in
        shape.layers().into_iter().zip(offsets(&shape, FORMAT_INT8))
    {
        let weights = &mut bytes[weights..][..inputs * outputs];
        for weight in weights.iter_mut().step_by(every) {
            *weight = (*weight as i8).saturating_neg() as u8;
        }
    }
    let (body, sum) = bytes.split_last_chunk_mut().expect("it ends with a sum");
    *sum = checksum(body).to_le_bytes();
    WeightFile::from_bytes(&bytes).expect("a sound file")
}

/// A request for a polished pose of one of the pairs.
fn request(id: u64, pair: u64, pairs: &PairSet) -> RefineRequest<'_> {
    let pair = pair as usize % pairs.source.len();
    let clouds = [&pairs.source[pair], &pairs.target[pair]];
    let [source, target] = clouds.map(|cloud| CloudView::of(&cloud[..POINTS]));
    RefineRequest {
        mode: Mode::Polish,
        budget_ms: 60_000,
        ..RefineRequest::new(id, source, target)
    }
}

/// Asks one robot for poses as long as it is there.
pub(crate) async fn ask_one(client: Client, robot: String, pairs: PairSet) {
    for id in 0.. {
        if client
            .refine(&robot, &request(id, id, &pairs))
            .await
            .is_err()
        {
            return;
        }
    }
}

/// Asks robots for poses without end; every other request goes to one that has the newest policy.
pub(crate) async fn ask_on_and_on(client: Client, pairs: PairSet) {
    client.follow_robots().await.expect("an open session");
    for id in 0.. {
        let heard = client.heard();
        let version = |i: usize| heard[i].status.policy.map(|policy| policy.version);
        let newest = (0..heard.len()).filter_map(version).max();
        let (new, old): (Vec<_>, Vec<_>) =
            (0..heard.len()).partition(|&i| version(i).is_some() && version(i) == newest);
        let group = match id % 2 {
            0 if !old.is_empty() => old,
            _ => new,
        };
        let Some(&robot) = group.get(id as usize / 2 % group.len().max(1)) else {
            tokio::task::yield_now().await;
            continue;
        };
        // Both groups see the same pairs.
        let request = request(id, id / 2, &pairs);
        let answer = client.refine(&heard[robot].robot, &request).await;
        answer.expect("a pose");
    }
}
