//! The methods that a command compares, from its arguments.

use super::{bad_usage, source};
use crate::baselines::{FgrSettings, IcpSettings};
use crate::learn::env::Accumulation;
use crate::learn::nn::Parameters;
use crate::measure::method::{Contestant, Finish, Start};
use crate::policy::checkpoint::{Checkpoint, is_checkpoint};
use crate::policy::{ExportError, WeightFile};
use clap::{Args, ValueEnum};
use reagent_core::Decision;
use reagent_core::dims::STEPS;
use reagent_core::pipeline::Mode;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Point-to-plane ICP.
const PLANE: Finish = Finish::Icp(IcpSettings::PLANE);
/// Core's refinement.
const POLISH: Finish = Finish::Core(Mode::Polish);
/// Core's refinement with a comparison with other poses.
const VERIFY: Finish = Finish::Core(Mode::Verify);

#[derive(Debug, Args)]
pub(super) struct MethodArgs {
    /// Policies, run directories (their best) or checkpoints to evaluate, or bundled policies: "reagent" (f32),
    /// "reagent-int8" (the same in 8-bit integers), "compact" (int8), and for single depth views "views",
    /// "views-compact" (int8); each reported under its file stem [default: "views" where all sources are views from known
    /// points, else "reagent"]
    #[arg(long, value_name = "FILE.rgw|RUN_DIR", num_args = 1..)]
    weights: Vec<PathBuf>,
    /// What to run, separated by commas; "policy" stands for every file of --weights [default: policy]
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',')]
    methods: Vec<MethodName>,
    /// How a policy's steps follow from its probabilities [default: as the weight file says; both-ways for runs
    /// and checkpoints]
    #[arg(long, value_enum, value_name = "HOW")]
    decide: Option<Decide>,
    /// Steps of a policy from one look at all points to the next; steps in between look only at the critical points (1:
    /// every step looks at all) [default: as the weight file says; 1 for runs and checkpoints]
    #[arg(long, value_name = "STEPS", value_parser = steps())]
    rescan: Option<u16>,
    /// Refinement steps of a policy
    #[arg(long, value_name = "N", default_value_t = STEPS, value_parser = source::positive())]
    pub(super) steps: usize,
    /// Threads over pairs; times are undisturbed only with 1
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = source::positive())]
    pub(super) threads: usize,
}

/// Values of `--decide`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum Decide {
    /// The most likely step of each axis, as in the paper
    MostLikely,
    /// The step nearest to the mean of each axis
    Mean,
    /// The same; after the first steps the mean of both ways, moving the source onto the target and the inverse of
    /// moving the target onto the source
    BothWays,
}

impl From<Decide> for Decision {
    fn from(decide: Decide) -> Decision {
        match decide {
            Decide::MostLikely => Decision::MostLikely,
            Decide::Mean => Decision::NearestToMean,
            Decide::BothWays => Decision::BothWays,
        }
    }
}

/// Values of `--methods`. Correspondences of ICP are at most 0.5 apart; normals are estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum MethodName {
    /// Every policy of --weights, or the bundled one
    Policy,
    /// "policy", then point-to-plane ICP; reported as NAME+icp
    #[value(name = "policy+icp")]
    PolicyIcp,
    /// "policy", then core's robust refinement by closest points; reported as NAME+polish
    #[value(name = "policy+polish")]
    PolicyPolish,
    /// The same, then compared with other poses; reported as NAME+verify
    #[value(name = "policy+verify")]
    PolicyVerify,
    /// Core's refinement without a policy
    #[value(name = "init+polish")]
    InitPolish,
    /// Core's refinement and comparison with other poses, without a policy
    #[value(name = "init+verify")]
    InitVerify,
    /// The same, where no pose is more probable than another: from anywhere
    #[value(name = "none+verify")]
    NoneVerify,
    /// Point-to-point ICP
    Icp,
    /// Point-to-plane ICP
    IcpPlane,
    /// Point-to-plane ICP on the nearest 80 % of the points
    IcpTrimmed,
    /// Fast global registration on FPFH features, without an initial estimate, with Open3D's defaults
    Fgr,
    /// The same with graduated non-convexity, as in its paper, and normals turned away from the cloud's mean
    FgrGnc,
    /// "fgr", then point-to-plane ICP
    #[value(name = "fgr+icp-plane")]
    FgrIcpPlane,
    /// The initial error
    Init,
}

/// Values of `--rescan`.
pub(super) fn steps() -> clap::builder::RangedI64ValueParser<u16> {
    clap::value_parser!(u16).range(1..)
}

/// How policies are run, as far as options override their files.
#[derive(Clone, Copy)]
struct Run {
    decision: Option<Decision>,
    rescan: Option<u16>,
}

impl Run {
    fn apply(self, file: WeightFile) -> Weights {
        // A file that no option changes keeps its bytes, by which records name it.
        let file = match self.decision {
            Some(decision) => file.deciding(decision),
            None => file,
        };
        Weights::File(match self.rescan {
            Some(rescan) => file.rescanning(rescan),
            None => file,
        })
    }
}

/// Policies, with the names under which they are reported.
pub(super) struct Policies(Vec<(String, Weights)>);

/// One of --weights.
enum Weights {
    /// A policy that robots can run.
    File(WeightFile),
    /// One that only the trainer can run, with another network or accumulation. It looks one way, at all points.
    Trained(Box<Parameters>, Accumulation, Decision),
}

impl Weights {
    fn load(path: &Path, run: Run) -> Result<Self, ExportError> {
        if let Some(bundled) = WeightFile::bundled(path) {
            return Ok(run.apply(bundled));
        }
        if !is_checkpoint(path) {
            return Ok(run.apply(WeightFile::load(path)?));
        }
        let checkpoint = Checkpoint::load(&Checkpoint::find(path)?)?;
        let accumulation = checkpoint.accumulation;
        let deployable = accumulation == Accumulation::Global
            && checkpoint.parameters.shape.deployed().is_some();
        if deployable {
            Ok(run.apply(WeightFile::from_checkpoint(checkpoint)?))
        } else {
            Ok(Weights::Trained(
                Box::new(checkpoint.result()),
                accumulation,
                run.decision.unwrap_or_default(),
            ))
        }
    }

    /// The method's start with this policy.
    fn start(&self) -> Start<'_> {
        match self {
            Weights::File(file) => Start::Policy(file.policy()),
            Weights::Trained(parameters, accumulation, decision) => Start::Trained {
                parameters,
                accumulation: *accumulation,
                decision: *decision,
            },
        }
    }
}

impl Policies {
    /// SHA-256, in hexadecimal, of each policy that is a file, by its name.
    pub(super) fn sha256(&self) -> BTreeMap<&str, String> {
        let files = self.0.iter().filter_map(|(name, weights)| match weights {
            Weights::File(file) => Some((name.as_str(), const_hex::encode(file.sha256()))),
            Weights::Trained(..) => None,
        });
        files.collect()
    }
}

impl MethodArgs {
    /// Reads the weight files given. Exits as `command` does on bad usage if no method uses them.
    pub(super) fn policies(&self, command: &str) -> Result<Policies, ExportError> {
        let uses_policy = |name: &MethodName| {
            use MethodName::*;
            matches!(name, Policy | PolicyIcp | PolicyPolish | PolicyVerify)
        };
        if !self.weights.is_empty() && !self.names().iter().any(uses_policy) {
            bad_usage(
                command,
                "--weights is given, but no policy is among --methods",
            );
        }
        let given = self.weights.iter().map(|path| self.load(path));
        Ok(Policies(given.collect::<Result<_, _>>()?))
    }

    /// The policies given, or else the bundled one called `name`.
    pub(super) fn or_bundled(&self, given: Policies, name: &str) -> Result<Policies, ExportError> {
        match given.0.is_empty() {
            true => Ok(Policies(vec![self.load(Path::new(name))?])),
            false => Ok(given),
        }
    }

    fn load(&self, path: &Path) -> Result<(String, Weights), ExportError> {
        let run = Run {
            decision: self.decide.map(Decision::from),
            rescan: self.rescan,
        };
        Ok((stem(path), Weights::load(path, run)?))
    }

    /// All methods to run, in the order of `--methods`; `seed` is for methods that draw.
    pub(super) fn contestants<'w>(&self, policies: &'w Policies, seed: u64) -> Vec<Contestant<'w>> {
        let of_policies = |suffix: &str, finish: Finish| -> Vec<Contestant<'w>> {
            let contestant = |(stem, weights): &'w (String, Weights)| Contestant {
                name: format!("{stem}{suffix}"),
                method: weights.start().then(finish),
            };
            policies.0.iter().map(contestant).collect()
        };
        let fgr = |settings| Start::Fgr { settings, seed };
        let contestants = |&name: &MethodName| -> Vec<Contestant<'w>> {
            let (start, finish) = match name {
                MethodName::Policy => return of_policies("", Finish::Nothing),
                MethodName::PolicyIcp => return of_policies("+icp", PLANE),
                MethodName::PolicyPolish => return of_policies("+polish", POLISH),
                MethodName::PolicyVerify => return of_policies("+verify", VERIFY),
                MethodName::InitPolish => (Start::Identity, POLISH),
                MethodName::InitVerify => (Start::Identity, VERIFY),
                MethodName::NoneVerify => (Start::Anywhere, VERIFY),
                MethodName::Icp => (Start::Identity, Finish::Icp(IcpSettings::POINT)),
                MethodName::IcpPlane => (Start::Identity, PLANE),
                MethodName::IcpTrimmed => (Start::Identity, Finish::Icp(IcpSettings::TRIMMED)),
                MethodName::Fgr => (fgr(FgrSettings::OPEN3D), Finish::Nothing),
                MethodName::FgrGnc => (fgr(FgrSettings::GRADUATED), Finish::Nothing),
                MethodName::FgrIcpPlane => (fgr(FgrSettings::OPEN3D), PLANE),
                MethodName::Init => (Start::Identity, Finish::Nothing),
            };
            let value = name.to_possible_value().expect("no value is hidden");
            let name = value.get_name().to_owned();
            let method = start.then(finish);
            vec![Contestant { name, method }]
        };
        self.names().iter().flat_map(contestants).collect()
    }

    fn names(&self) -> &[MethodName] {
        if self.methods.is_empty() {
            &[MethodName::Policy]
        } else {
            &self.methods
        }
    }
}

/// Name under which a weight file is reported.
fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}
