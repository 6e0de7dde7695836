//! Many pairs in one call: a folder, or a list.

use super::RegisterArgs;
use crate::cli::output::write_text;
use crate::dataset::cloud_file::{EXTENSIONS, extension};
use crate::policy::WeightFile;
use crate::register::Start;
use crate::register::document::Document;
use crate::words::count;
use anyhow::{Context, anyhow, bail};
use reagent_link::log::one_line;
use serde::Serialize;
use std::path::{Path, PathBuf};
use walkdir::WalkDir;

/// Two files to be registered.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pair {
    pub(super) source: PathBuf,
    pub(super) target: PathBuf,
    /// Where the sensor stood, if the source is a view with a view point of its own.
    pub(super) view_point: Option<[f64; 3]>,
}

/// A file of a folder that has no partner, or several.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Lone {
    /// `source` or `target`.
    role: &'static str,
    path: PathBuf,
    reason: &'static str,
}

/// The pairs of a folder or of a list. In a folder, pairs are `NAME_source.EXT` and `NAME_target.EXT`, or `source.EXT`
/// and `target.EXT` in folders of their own, ordered by path. In a list, each line has two paths relative to its
/// folder, and the coordinates of the source's view point if it has one of its own, separated by tabs, commas or
/// blanks; `#` begins a comment.
pub(super) fn find(path: &Path) -> anyhow::Result<Vec<Result<Pair, Lone>>> {
    let pairs = if path.is_dir() {
        in_folder(path)?
    } else {
        listed(path)?.into_iter().map(Ok).collect()
    };
    if pairs.is_empty() {
        bail!("{}: no pairs", path.display());
    }
    Ok(pairs)
}

fn in_folder(folder: &Path) -> anyhow::Result<Vec<Result<Pair, Lone>>> {
    let mut sources = Vec::new();
    let mut targets = Vec::new();
    for entry in WalkDir::new(folder).sort_by_file_name() {
        let path = entry?.into_path();
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("");
        if !EXTENSIONS.contains(&extension(&path).as_str()) {
            continue;
        }
        let named = |role: &str| {
            let name = stem.strip_suffix(role)?;
            let ended = name.is_empty() || name.ends_with(['_', '-', '.']);
            ended.then(|| path.with_file_name(name))
        };
        if let Some(name) = named("source") {
            sources.push((name, path));
        } else if let Some(name) = named("target") {
            targets.push((name, path));
        }
    }
    let lone = |role, path: &Path, reason| Lone {
        role,
        path: path.into(),
        reason,
    };
    let mut pairs = Vec::with_capacity(sources.len());
    for (name, source) in &sources {
        let mut partners = targets.iter().filter(|target| target.0 == *name);
        pairs.push(match (partners.next(), partners.next()) {
            (Some((_, target)), None) => Ok(Pair {
                source: source.clone(),
                target: target.clone(),
                view_point: None,
            }),
            (None, _) => Err(lone("source", source, "no target beside it")),
            (Some(_), Some(_)) => Err(lone("source", source, "two targets beside it")),
        });
    }
    for (name, target) in &targets {
        if !sources.iter().any(|source| source.0 == *name) {
            pairs.push(Err(lone("target", target, "no source beside it")));
        }
    }
    Ok(pairs)
}

fn listed(list: &Path) -> anyhow::Result<Vec<Pair>> {
    let text = std::fs::read_to_string(list).with_context(|| format!("list {}", list.display()))?;
    let folder = list.parent().unwrap_or(Path::new("."));
    let mut pairs = Vec::new();
    for (number, line) in (1..).zip(text.trim_start_matches('\u{feff}').lines()) {
        let line = line.split('#').next().unwrap_or("").trim();
        if line.is_empty() {
            continue;
        }
        let separator = ['\t', ','].into_iter().find(|&c| line.contains(c));
        let names: Vec<&str> = match separator {
            Some(c) => line.split(c).map(str::trim).collect(),
            None => line.split_whitespace().collect(),
        };
        // As spreadsheets write them.
        let unquoted = |name| str::strip_prefix(name, '"')?.strip_suffix('"');
        let names: Vec<&str> = names
            .into_iter()
            .map(|name| unquoted(name).unwrap_or(name))
            .collect();
        let (source, target, view_point) = match names.as_slice() {
            &[source, target] => (source, target, None),
            &[source, target, x, y, z] => {
                let point = super::view_point(&[x, y, z].join(","));
                let point = point.with_context(|| format!("{}: line {number}", list.display()))?;
                (source, target, Some(point))
            }
            names => bail!(
                "{}: line {number}: expected two files, and three coordinates where the sensor stood, or not, separated by tabs; found {} values",
                list.display(),
                names.len()
            ),
        };
        pairs.push(Pair {
            source: folder.join(source),
            target: folder.join(target),
            view_point,
        });
    }
    Ok(pairs)
}

impl RegisterArgs {
    /// Prints a line for each pair once it is done. A pair that fails, or a file without a partner, has the reason.
    pub(super) fn run_pairs(
        &self,
        weights: &WeightFile,
        starts: &[Start],
        pairs: &[Result<Pair, Lone>],
        seed: u64,
    ) -> anyhow::Result<()> {
        let mut lines = String::new();
        let mut done = Vec::new();
        for pair in pairs {
            let registered = match pair {
                Ok(pair) => self.register(weights, starts, pair, seed),
                Err(lone) => Err(anyhow!(lone.reason)),
            };
            let line = Line {
                error: registered.as_ref().err().map(|e| one_line(e.as_ref())),
                done: registered.as_ref().ok().map(|found| self.document(found)),
                ..Line::of(pair)
            };
            let line = serde_json::to_string(&line)? + "\n";
            done.extend(registered);
            if self.json.is_some() {
                lines += &line;
            } else {
                print!("{line}");
            }
        }
        if let Some(path) = &self.json {
            write_text(path, &lines)?;
        }
        let failed = pairs.len() - done.len();
        if failed > 0 {
            bail!(
                "{failed} of {} could not be registered",
                count(pairs.len(), "pair", "pairs")
            );
        }
        self.judge(done.iter().map(|pairing| &pairing.done))
    }
}

/// A line of the output, with fields in the order of a single pair's `--json`.
#[derive(Default, Serialize)]
struct Line {
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<String>,
    #[serde(flatten)]
    done: Option<Document>,
    /// Why the pair was not registered.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Line {
    /// A line with the names of a pair, or of a file without a partner.
    fn of(pair: &Result<Pair, Lone>) -> Line {
        let [source, target] = match pair {
            Ok(pair) => [Some(&pair.source), Some(&pair.target)],
            Err(lone) if lone.role == "source" => [Some(&lone.path), None],
            Err(lone) => [None, Some(&lone.path)],
        };
        let name = |path: &PathBuf| path.display().to_string();
        Line {
            source: source.map(name),
            target: target.map(name),
            ..Line::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_and_lists_name_pairs() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("c")).expect("created");
        for name in [
            "a_source.ply",
            "a_target.xyz",
            "b-target.ply",
            "b-source.PLY",
            "c/source.pcd",
            "c/target.stl",
            "notes_source.md",
            "resource.ply",
        ] {
            std::fs::write(at(name), "").expect("written");
        }
        let pair = |source: &str, target: &str| {
            Ok(Pair {
                source: at(source),
                target: at(target),
                view_point: None,
            })
        };
        let mut expected = vec![
            pair("a_source.ply", "a_target.xyz"),
            pair("b-source.PLY", "b-target.ply"),
            pair("c/source.pcd", "c/target.stl"),
        ];
        assert_eq!(find(folder.path()).expect("pairs"), expected);
        let list = "# two\na_source.ply a_target.xyz\n\nb-source.PLY\tb-target.ply # one\n\"c/source.pcd\", c/target.stl\n";
        std::fs::write(at("list.txt"), list).expect("written");
        assert_eq!(find(&at("list.txt")).expect("pairs"), expected);
        std::fs::write(at("list.txt"), "one\n").expect("written");
        let said = find(&at("list.txt")).expect_err("refused").to_string();
        assert!(said.contains("line 1: expected two files"), "{said}");
        // A view with a view point of its own.
        let views = "a_source.ply a_target.xyz 1 -2.5 3e2\nb-source.PLY, b-target.ply\n";
        std::fs::write(at("list.txt"), views).expect("written");
        let found = find(&at("list.txt")).expect("pairs");
        let points: Vec<_> = found.iter().flatten().map(|pair| pair.view_point).collect();
        assert_eq!(points, [Some([1.0, -2.5, 300.0]), None]);
        std::fs::write(at("list.txt"), "a b 1 2 nan\n").expect("written");
        let said = format!("{:#}", find(&at("list.txt")).expect_err("refused"));
        assert!(
            said.contains("line 1: a view point is three finite"),
            "{said}"
        );
        // A file without its partner is named, and the other pairs stay.
        std::fs::remove_file(at("a_target.xyz")).expect("removed");
        std::fs::remove_file(at("c/source.pcd")).expect("removed");
        let lone = |role, name: &str, reason| {
            Err(Lone {
                role,
                path: at(name),
                reason,
            })
        };
        expected[0] = lone("source", "a_source.ply", "no target beside it");
        expected[2] = lone("target", "c/target.stl", "no source beside it");
        assert_eq!(find(folder.path()).expect("pairs"), expected);
    }
}
