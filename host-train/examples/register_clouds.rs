//! Registers two clouds from files and moves the source onto the target:
//! `cargo run --release -p host-train --example register_clouds -- scan.ply part.ply aligned.ply`.

use anyhow::bail;
use host_train::dataset::cloud_file::{read_cloud, write_cloud};
use host_train::policy::WeightFile;
use host_train::pose64::Pose64;
use host_train::register::{Start, register, within_capacity};
use reagent_core::Verdict;
use reagent_core::pipeline::Task;
use std::path::Path;

fn main() -> anyhow::Result<()> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let [scan, part, aligned] = &files[..] else {
        bail!("usage: register_clouds SCAN PART ALIGNED");
    };
    // Any unit, the same for both. The seeds draw the points of meshes; clouds that are too large are thinned.
    let (source, target) = (
        read_cloud(Path::new(scan), 1)?,
        read_cloud(Path::new(part), 2)?,
    );
    // The core computes in f32, so clouds far from zero are taken relative to an origin of their own.
    let origins = [source.origin(), target.origin()];
    let source_points = within_capacity(&source.relative_to(origins[0]));
    let target_points = within_capacity(&target.relative_to(origins[1]));

    let weights = WeightFile::pretrained(); // or WeightFile::load(path)
    let start = Start::Identity; // or an estimate
    let task = Task::new(start.start(origins[0], origins[1])); // the best pose within ten steps
    let found = register(weights.policy(), &source_points, &target_points, &task)?.answer;

    let target_from_source = Pose64::of(found.target_from_source, origins[0], origins[1]);
    println!("target_from_source {:?}", target_from_source.to_rows());
    if let Some(refinement) = &found.refinement {
        println!(
            "right with probability {:.3}",
            refinement.evidence.probability()
        );
    }
    if found.verdict != Verdict::Converged {
        bail!("not to be trusted: {}", found.verdict);
    }
    write_cloud(Path::new(aligned), &source.moved(&target_from_source))?;
    Ok(())
}
