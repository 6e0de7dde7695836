//! The contents of the images: no way to panic, and no larger than was committed.

use super::{images, on_boards};
use firmware_sim::board::Kind;
use host_train::measure::elf::{self, Image};
use host_train::measure::microcontrollers::{self, Measured};
use reagent_core::budget::{CODE_BUDGET, RAM_BUDGET, REFINEMENT_CODE_BUDGET, STACK_BUDGET};
use std::path::{Path, PathBuf};

fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

pub(crate) fn assert_cannot_panic(path: &Path) -> Image {
    let image = elf::read(path).expect("an image");
    assert_eq!(image.panics, [""; 0], "{}", path.display());
    image
}

#[test]
fn images_cannot_panic_and_the_library_is_small() {
    for (kind, node) in images() {
        assert_cannot_panic(&node);
        let library = assert_cannot_panic(&node.with_file_name("registration"));
        let bytes = library.flash_bytes;
        assert!(bytes <= CODE_BUDGET, "{kind:?}: {bytes} bytes of flash");
        let refinement = assert_cannot_panic(&node.with_file_name("refinement"));
        let bytes = refinement.flash_bytes;
        assert!(
            bytes <= REFINEMENT_CODE_BUDGET,
            "{kind:?}: {bytes} bytes of flash"
        );
    }
    // A program on the host can panic.
    let host = std::env::current_exe().expect("this program");
    assert!(!elf::read(&host).expect("an image").panics.is_empty());
}

#[test]
fn the_page_has_the_committed_budget() {
    let read = |path| std::fs::read_to_string(file(path)).expect("it is there");
    let measured: Measured =
        serde_json::from_str(&read("firmware-sim/cortex-m/budget.json")).expect("budgets");
    assert_eq!(measured.registration.len(), 2 * Kind::ALL.len());
    assert_eq!(measured.refinement.len(), Kind::ALL.len());
    let page = read("firmware-sim/cortex-m/README.md");
    let made = microcontrollers::with_tables(&page, &measured);
    assert!(
        made == Some(page),
        "host-train bench --mcu --json firmware-sim/cortex-m/budget.json --page firmware-sim/cortex-m/README.md"
    );
}

#[test]
fn memory_is_within_its_budget() {
    on_boards(true, |kind, mut board| {
        let (_, report) = board.status_and_report().expect("it runs");
        let ram = (report.static_bytes + report.stack_capacity) as usize;
        assert!(ram <= RAM_BUDGET, "{kind:?}: {ram} bytes of RAM");
        assert_eq!(report.stack_capacity as usize, STACK_BUDGET);
    });
}
