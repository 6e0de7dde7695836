//! A client of a fleet: asks the robot with the least to do for the pose of a part.
//! `cargo run --release -p firmware-sim --example client -- lab tcp/127.0.0.1:7447 scan.ply part.ply`.

use anyhow::bail;
use firmware_sim::client::Client;
use firmware_sim::session::{SessionArgs, open};
use host_train::dataset::cloud_file::read_cloud;
use host_train::register::within_capacity;
use reagent_core::wire::{CloudView, RefineRequest};
use std::path::Path;

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [fleet, endpoint, scan, part] = &arguments[..] else {
        bail!("usage: client FLEET ENDPOINT SCAN PART");
    };
    let cloud = |path: &String, seed: u64| {
        let cloud = read_cloud(Path::new(path), seed)?;
        anyhow::Ok(within_capacity(&cloud.relative_to([0.0; 3])))
    };
    let (source, target) = (cloud(scan, 1)?, cloud(part, 2)?);

    let session = SessionArgs {
        zenoh: None, // or a configuration with certificates
        connect: vec![endpoint.clone()],
        listen: Vec::new(),
    };
    let client = Client::new(open(&session).await?, fleet).await?;
    let request = RefineRequest {
        budget_ms: 2000, // then the robot answers that it had no time
        ..RefineRequest::new(1, CloudView::of(&source), CloudView::of(&target))
    };
    // A refusal is an error that says why: busy, no policy, too many points, …
    let (robot, reply) = client.refine_any(&request).await?;
    println!(
        "robot {robot}, policy {}: {}, {:?}",
        reply.policy_version, reply.verdict, reply.target_from_source
    );
    Ok(())
}
