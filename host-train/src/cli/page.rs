//! `host-train page`

use super::output::write_text;
use crate::report::try_page;
use anyhow::{Context, bail};
use clap::Args;
use std::path::PathBuf;

/// Write one HTML file that registers in a browser, without a network
///
/// A scan and a part are dropped on the page, which shows the steps, the verdict and the pose, as `register` gives them
/// with `--weights compact`. Its program is built by `cargo build --release` in host-train/page.
#[derive(Debug, Args)]
pub(super) struct PageArgs {
    /// The program, as built by cargo
    #[arg(
        long,
        value_name = "FILE.wasm",
        default_value = "target/page/wasm32-unknown-unknown/release/reagent_page.wasm"
    )]
    wasm: PathBuf,
    /// HTML file to write
    #[arg(long, value_name = "PAGE.html")]
    out: PathBuf,
}

impl PageArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let file = self.wasm.display();
        let program = std::fs::read(&self.wasm).with_context(|| {
            format!(
                "cannot read {file}; build it in host-train/page with `cargo build --release`, \
                 after `rustup target add wasm32-unknown-unknown`"
            )
        })?;
        let Some(page) = try_page(&program) else {
            bail!("{file} is not the page's program; name what host-train/page was compiled to");
        };
        write_text(&self.out, &page)?;
        println!("{}", self.out.display());
        Ok(())
    }
}
