//! `host-train page`

use super::output::write_text;
use crate::report::try_page;
use anyhow::Context;
use clap::Args;
use std::path::{Path, PathBuf};

/// Where cargo builds the program, in the checkout.
const BUILT: &str = "target/page/wasm32-unknown-unknown/release/reagent_page.wasm";

/// Write one HTML file that registers in a browser, without a network
///
/// A scan and a part are dropped on the page, which shows the steps, the verdict and the pose, as `register` gives them
/// with `--weights compact`. Its program is built by `cargo build --release` in host-train/page.
#[derive(Debug, Args)]
pub(super) struct PageArgs {
    /// The program, as built by cargo [default: reagent_page.wasm in target/page/wasm32-unknown-unknown/release of the
    /// checkout that this command line was built from, or if that is gone, of the working folder]
    #[arg(long, value_name = "FILE.wasm")]
    wasm: Option<PathBuf>,
    /// HTML file to write
    #[arg(long, value_name = "PAGE.html")]
    out: PathBuf,
}

impl PageArgs {
    pub(super) fn run(self) -> anyhow::Result<()> {
        let wasm = self.wasm.unwrap_or_else(built);
        let file = wasm.display();
        let program = std::fs::read(&wasm).with_context(|| {
            format!(
                "cannot read {file}; build it in host-train/page with `cargo build --release`, \
                 after `rustup target add wasm32-unknown-unknown`"
            )
        })?;
        let page = try_page(&program).with_context(|| file.to_string())?;
        write_text(&self.out, &page)?;
        println!("{}", self.out.display());
        Ok(())
    }
}

/// The program of the checkout that this was built from, wherever it is called; if there is none any more, of the working folder.
fn built() -> PathBuf {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR"));
    match sources.parent().filter(|_| sources.join("page").is_dir()) {
        Some(checkout) => checkout.join(BUILT),
        None => BUILT.into(),
    }
}
