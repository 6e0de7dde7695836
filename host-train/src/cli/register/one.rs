//! Registration of one pair: its text and its files.

use super::pairs::Pair;
use super::{Pairing, RegisterArgs, series, text};
use crate::cli::output::{write_json, write_text};
use crate::dataset::Point;
use crate::dataset::cloud_file::{CloudFile, STANDARD, extension, write_cloud};
use crate::policy::WeightFile;
use crate::register::Start;
use crate::register::trace::{self, FinalAnswer, Header, Traced};
use crate::report::Report;
use std::path::Path;

impl RegisterArgs {
    /// Registers one pair, and prints and writes what was asked for.
    pub(super) fn run_one(
        &self,
        weights: &WeightFile,
        starts: &[Start],
        pair: &Pair,
        seed: u64,
    ) -> anyhow::Result<()> {
        let pairing = self.register(weights, starts, pair, seed)?;
        let Pairing { inputs, done } = &pairing;
        let [source, target] = inputs.each_ref().map(|input| &input.cloud.notes);
        for note in source {
            let advice = self.sources.note_advice(note);
            eprintln!("{}: {note}{advice}", pair.source.display());
        }
        for note in target {
            eprintln!("{}: {note}", pair.target.display());
        }
        let text = text::report(
            done,
            &self.sources.size_advice(source),
            self.best.unwrap_or(1),
        );
        if self
            .outputs()
            .iter()
            .any(|path| path.as_deref() == Some(Path::new(STANDARD)))
        {
            eprintln!("{}", text.trim_end());
        } else {
            print!("{text}");
        }
        if let Some(path) = &self.out {
            write_cloud(path, &aligned(&pairing, path))?;
        }
        if let Some(path) = &self.trace {
            write_text(path, &trace::to_text(&[self.traced(&pairing, pair)])?)?;
        }
        if let Some(path) = &self.html {
            let report = Report::of_registrations(vec![self.traced(&pairing, pair)]);
            write_text(path, &report.html()?)?;
        }
        if let Some(folder) = &self.series {
            series::write(folder, &self.traced(&pairing, pair))?;
        }
        if let Some(path) = &self.json {
            write_json(path, &self.document(&pairing))?;
        }
        if let Some(path) = &self.matrix {
            write_text(path, &text::matrix(&done.pose))?;
        }
        self.judge([done].into_iter())
    }

    fn traced(&self, pairing: &Pairing, pair: &Pair) -> Traced {
        let Pairing { inputs, done } = pairing;
        let [source, target] = inputs.each_ref().map(|input| input.cloud.points().to_vec());
        let origins = inputs.each_ref().map(|input| input.cloud.origin);
        Traced {
            header: Header {
                name: format!("{} to {}", file_name(&pair.source), file_name(&pair.target)),
                policy: stem(self.policy(false)),
                source,
                target,
                truth: None,
                initial: done.initial.to_rows(),
                origins: (origins != [[0.0; 3]; 2]).then_some(origins),
            },
            steps: done.found.trace.clone(),
            answer: FinalAnswer::of(&done.found.answer, self.mode).map(|answer| FinalAnswer {
                target_from_source: done.near().to_rows(),
                ..answer
            }),
        }
    }
}

/// The moved source: a mesh if the format can hold one, else the points of its surface.
fn aligned(pairing: &Pairing, path: &Path) -> CloudFile {
    let Pairing { inputs, done } = pairing;
    let [source, _] = inputs;
    let mut moved = source.file.moved(&done.pose);
    let cloud_only = ["pcd", "npy", "xyz"].contains(&extension(path).as_str());
    if moved.faces.is_some() && cloud_only {
        let [a, b, c] = source.cloud.origin;
        let placed = |p: &Point| {
            let [x, y, z] = p.map(f64::from);
            done.pose.apply([x + a, y + b, z + c])
        };
        moved = CloudFile {
            points: source.cloud.all.iter().map(placed).collect(),
            ..Default::default()
        };
    }
    moved
}

/// Last part of a path.
fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

/// Name under which a policy is reported.
fn stem(path: &Path) -> String {
    file_name(&path.with_extension(""))
}
