//! `host-train bench`

use super::output::{check_outputs, write_json, write_text};
use super::source::{DataSource, positive};
use crate::measure::latency;
use crate::measure::microcontrollers::{self, Limit, Measured};
use crate::policy::WeightFile;
use crate::train::{self, Stage, TrainConfig};
use anyhow::Context;
use clap::Args;
use clap::builder::RangedI64ValueParser;
use reagent_core::dims::{MAX_POINTS, MIN_POINTS};
use reagent_core::kernels::Isa;
use std::path::PathBuf;

/// Number of points that a cloud may have.
fn points() -> RangedI64ValueParser<usize> {
    RangedI64ValueParser::new().range(MIN_POINTS as i64..=MAX_POINTS as i64)
}

/// Kernels by name, if this machine can run them.
fn kernels(name: &str) -> Result<Isa, String> {
    Isa::named(name).ok_or_else(|| {
        let names: Vec<&str> = Isa::all().map(Isa::name).collect();
        format!("this machine runs {}", names.join(", "))
    })
}

/// Measure how fast this machine registers, or trains
///
/// Registers clouds of 1024 and 2048 points in f32 and in 8-bit integers, on one thread and on two, and compares with
/// the core's arithmetic peak. With --train: runs a few updates of the stages pretrain and ilrl with the paper's
/// settings, after one of each to warm up, and says where the time goes. With --mcu: runs the policy in 8-bit integers,
/// and refinement, on simulated microcontrollers (QEMU) and says what they need: flash, RAM, instructions. Only the
/// files named by options are written.
#[derive(Debug, Args)]
pub(super) struct BenchArgs {
    /// Measure training instead: observations a second
    #[arg(long)]
    train: bool,
    /// Measure microcontrollers instead, in QEMU: bytes, and simulated instructions (not cycles)
    #[arg(long, conflicts_with = "train")]
    mcu: bool,
    /// With --mcu: fail if a number is over its budget, or missing from this file of an earlier --json, or worse than
    /// there by more than 5 %
    #[arg(long, value_name = "FILE", requires = "mcu")]
    expect: Option<PathBuf>,
    /// With --mcu: put the tables into this page, between the comments "host-train bench --mcu" and "end"
    #[arg(long, value_name = "FILE.md", requires = "mcu")]
    page: Option<PathBuf>,
    /// Policy to register with, in f32 [default: the bundled one]
    #[arg(long, value_name = "FILE.rgw")]
    weights: Option<PathBuf>,
    /// Steps from one look at all points to the next [default: as the weight file says]
    #[arg(long, value_name = "STEPS", value_parser = super::methods::steps(), conflicts_with_all = ["train", "mcu"])]
    rescan: Option<u16>,
    /// Registrations of each configuration
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = 100)]
    count: usize,
    /// With --train: clouds to train on
    #[arg(long, value_name = "DIR|procedural[:COUNT]", num_args = 1.., default_value = "procedural:64")]
    data: Vec<DataSource>,
    /// Threads [default: all cores; 1 and 2 to register]
    #[arg(long, value_name = "N", value_parser = positive())]
    threads: Option<usize>,
    /// Points of a cloud [default: 1024; 1024 and 2048 to register]
    #[arg(long, value_name = "N", value_parser = points())]
    points: Option<usize>,
    /// With --train: updates to measure in each stage, of 1280 observations each
    #[arg(long, value_name = "N", value_parser = positive(), default_value_t = 4)]
    updates: usize,
    /// Kernels to register with, by the name that is printed first [default: the fastest]
    #[arg(long, value_name = "KERNELS", value_parser = kernels, conflicts_with = "train")]
    isa: Option<Isa>,
    /// Write the measurements as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl BenchArgs {
    pub(super) fn run(self, seed: u64) -> anyhow::Result<()> {
        check_outputs([&self.json, &self.page])?;
        if self.train {
            self.training(seed)
        } else if self.mcu {
            self.microcontrollers(seed)
        } else {
            self.registration(seed)
        }
    }

    fn registration(self, seed: u64) -> anyhow::Result<()> {
        let file = WeightFile::load_or_pretrained(self.weights.as_deref())?;
        let file = match self.rescan {
            Some(steps) => file.rescanning(steps),
            None => file,
        };
        let threads = self.threads.map_or(vec![1, 2], |n| vec![n]);
        let isa = self.isa.unwrap_or(Isa::best());
        let points = self.points.map_or(vec![1024, 2048], |n| vec![n]);
        let report = latency::measure(isa, &file, &threads, &points, self.count, seed)?;
        if let Some(processor) = &report.processor {
            println!("{processor}");
        }
        let [f32, bytes] = report.peak_gmac_per_s;
        println!(
            "kernels {}, one core's peak: {f32:.0} G fused multiply-adds/s in f32, {bytes:.0} in bytes",
            report.kernels
        );
        println!(
            "format  points  threads  ms median   best   cpu  registrations/s  of peak  clouds embedded"
        );
        for row in &report.rows {
            let share = row
                .share_of_peak
                .map_or("-".into(), |s| format!("{:.0} %", 100.0 * s));
            println!(
                "{:<6}  {:>6}  {:>7}  {:>9.2}  {:>5.2} {:>5.2}  {:>15.1}  {share:>7}  {:>15.1}",
                row.format,
                row.points,
                row.threads,
                row.ms_median,
                row.ms_best,
                row.cpu_ms_best,
                row.per_second,
                row.clouds_embedded,
            );
        }
        println!(
            "weights {} bytes in f32, {} in int8; working memory {} bytes and {} a registration, {} for all in f32",
            report.weight_bytes[0],
            report.weight_bytes[1],
            report.scratch_bytes,
            report.registration_bytes,
            report.packed_bytes,
        );
        if let Some(path) = &self.json {
            write_json(path, &serde_json::json!({ "registration": report }))?;
        }
        Ok(())
    }

    fn microcontrollers(self, seed: u64) -> anyhow::Result<()> {
        let file = WeightFile::load_or_pretrained(self.weights.as_deref())?;
        println!(
            "registration of 1024 + 1024 points, 10 steps, int8; instructions as QEMU counts them"
        );
        println!(
            "board       network              policy   library  program  clouds  all static  stack   RAM    on a grid  multiply-adds  instructions  per multiply-add  slice"
        );
        let measured = microcontrollers::measure_all(&file, seed)?;
        for budget in &measured.registration {
            println!(
                "{:<10}  {:<19}  {:>7}  {:>7}  {:>7}  {:>6}  {:>10}  {:>5}  {:>5}  {:>9}  {:>11.3} G  {:>10.3} G  {:>16.3}  {:.2} M",
                budget.board,
                budget.network,
                budget.policy_bytes,
                budget.library_bytes,
                budget.program_bytes,
                budget.cloud_bytes,
                budget.static_bytes,
                budget.stack_bytes,
                budget.static_bytes + budget.stack_bytes,
                budget.grid_ram_bytes,
                budget.multiply_adds as f64 / 1e9,
                budget.instructions as f64 / 1e9,
                budget.instructions_per_multiply_add,
                budget.slice_instructions as f64 / 1e6,
            );
        }
        println!("refinement of a pose of 1024 + 1024 points; the target is made ready once");
        println!(
            "board       program  all static  stack  to verify   RAM     make ready  refine     verify"
        );
        for budget in &measured.refinement {
            let millions = |instructions: u64| instructions as f64 / 1e6;
            println!(
                "{:<10}  {:>7}  {:>10}  {:>5}  {:>9}  {:>6}  {:>8.1} M  {:>6.1} M  {:>6.1} M",
                budget.board,
                budget.program_bytes,
                budget.static_bytes,
                budget.stack_bytes,
                budget.verify_stack_bytes,
                budget.ram_bytes(),
                millions(budget.target_instructions),
                millions(budget.instructions),
                millions(budget.verify_instructions),
            );
        }
        println!("of what reagent_core::budget allows:");
        let shares = |limits: Vec<Limit>| -> String {
            let share = |(what, now, most): &Limit| format!("{what} {:.0} %", 100.0 * now / most);
            limits.iter().map(share).collect::<Vec<_>>().join(", ")
        };
        for budget in &measured.registration {
            let shares = shares(microcontrollers::limits(budget));
            println!("{}, {}: {shares}", budget.board, budget.network);
        }
        for budget in &measured.refinement {
            println!("{}, refinement: {}", budget.board, shares(budget.limits()));
        }
        if let Some(path) = &self.json {
            write_json(path, &measured)?;
        }
        if let Some(path) = &self.page {
            let page = std::fs::read_to_string(path)
                .with_context(|| format!("cannot read {}", path.display()))?;
            let page = microcontrollers::with_tables(&page, &measured)
                .with_context(|| format!("{} has no place for the tables", path.display()))?;
            write_text(path, &page)?;
        }
        if let Some(path) = &self.expect {
            let text =
                std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
            let before: Measured = serde_json::from_slice(&text)
                .with_context(|| format!("{} is no file of bench --mcu --json", path.display()))?;
            let complaints = microcontrollers::complaints(&measured, &before);
            anyhow::ensure!(
                complaints.is_empty(),
                "not as in {}: {}",
                path.display(),
                complaints.join("; ")
            );
        }
        Ok(())
    }

    fn training(self, seed: u64) -> anyhow::Result<()> {
        let mut speeds = Vec::new();
        println!("stage     threads  samples/s  roll-out  reward  update  data");
        for stage in [Stage::Pretrain, Stage::Ilrl] {
            let config = TrainConfig {
                seed,
                points: self.points.unwrap_or(1024),
                threads: self.threads.unwrap_or(0),
                ..TrainConfig::new(stage, self.data.clone(), PathBuf::new())
            };
            let speed = train::bench(&config, self.updates)?;
            let share = |seconds: f64| 100.0 * seconds / speed.seconds;
            println!(
                "{:<9} {:>7}  {:>9.0}  {:>6.1} %  {:>4.1} %  {:>4.1} %  {:>2.1} %",
                stage.to_string(),
                speed.threads,
                speed.samples_per_s,
                share(speed.roll_out_s),
                share(speed.reward_s),
                share(speed.update_s),
                share(speed.data_s),
            );
            speeds.push(speed);
        }
        if let Some(path) = &self.json {
            write_json(path, &serde_json::json!({ "train": speeds }))?;
        }
        Ok(())
    }
}
