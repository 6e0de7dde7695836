//! `host-train report`

use super::output::{check_files, write_text};
use crate::report::Report;
use crate::words::count;
use clap::Args;
use std::path::PathBuf;

/// Make one HTML file of training runs, evaluations, sweeps and traces
///
/// Tables, curves, box plots, and registrations to turn and step through. The file needs no other and no
/// network. Inputs are told apart by what is in them; several runs are overlaid.
#[derive(Debug, Args)]
pub(super) struct ReportArgs {
    /// RUN_DIR of `train`, JSON of `eval --json`, `sweep --json` or `calibrate --json`, traces of `--trace`
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// HTML file to write
    #[arg(long, value_name = "REPORT.html")]
    out: PathBuf,
    /// Also write every chart into this folder, as SVG and PNG
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

impl ReportArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        check_files(&self.inputs, [&Some(self.out.clone())])?;
        let report = Report::read(&self.inputs)?;
        for note in report.notes() {
            eprintln!("{note}");
        }
        write_text(&self.out, &report.html()?)?;
        println!("{}", self.out.display());
        if let Some(folder) = &self.plots {
            let charts = report.write_plots(folder)?;
            let charts = count(charts, "chart", "charts");
            println!("{}: {charts}, each as SVG and PNG", folder.display());
        }
        Ok(())
    }
}
