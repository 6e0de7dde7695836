//! Registers two clouds from files and moves the source onto the target:
//! `cargo run --release -p host-train --example register_clouds -- scan.ply part.ply aligned.ply`.

use anyhow::bail;
use host_train::dataset::cloud_file::{read_cloud, write_cloud};
use host_train::export::WeightFile;
use host_train::refine::Mode;
use host_train::register::{register, within_capacity};
use reagent_core::{Pose, Verdict};
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let [scan, part, aligned] = &files[..] else {
        bail!("usage: register_clouds SCAN PART ALIGNED");
    };
    // Any unit, the same for both. Seeds draw the points of meshes and of clouds that are too large.
    let (source, target) = (
        read_cloud(Path::new(scan), 1)?,
        read_cloud(Path::new(part), 2)?,
    );
    let source_points = within_capacity(source.points.clone(), 1, 0);
    let target_points = within_capacity(target.points, 1, 1);

    let weights = WeightFile::pretrained(); // or WeightFile::load(path)
    let initial = Pose::IDENTITY; // or an estimate
    let found = register(
        weights.policy(),
        &source_points,
        &target_points,
        initial,
        10,
        Mode::Verify,
    )?;

    println!(
        "target_from_source {:?}",
        found.target_from_source.to_rows()
    );
    if let Some(refinement) = &found.refinement {
        println!(
            "right with probability {:.3}",
            refinement.evidence.probability()
        );
    }
    if found.verdict != Verdict::Converged {
        bail!("not to be trusted: {}", found.verdict);
    }
    write_cloud(Path::new(aligned), &source.moved(&found.target_from_source))?;
    Ok(())
}
