//! The boards that can run here, side by side.

use super::{POLICY, manifest_of};
use firmware_sim::board::{
    Board, BoardError, Clouds, Kind, Simulation, build_image, flash_content,
};
use std::path::{Path, PathBuf};
use std::thread;

/// Images that can be built here; says why others cannot.
pub(crate) fn images() -> Vec<(Kind, PathBuf)> {
    images_for(Clouds::Floats)
}

/// The same, with memory for clouds of this kind.
pub(crate) fn images_for(clouds: Clouds) -> Vec<(Kind, PathBuf)> {
    let build = |kind| match build_image(kind, clouds) {
        Ok(image) => Some((kind, image)),
        Err(error @ BoardError::NoTarget { .. }) => {
            eprintln!("skipped: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    };
    Kind::ALL.into_iter().filter_map(build).collect()
}

/// Runs `test` on each board, side by side, with the policy in flash.
pub(crate) fn on_boards(with_policy: bool, test: impl Fn(Kind, Board) + Sync) {
    on_boards_for(Clouds::Floats, with_policy, test);
}

/// The same, on boards with memory for clouds of this kind.
pub(crate) fn on_boards_for(clouds: Clouds, with_policy: bool, test: impl Fn(Kind, Board) + Sync) {
    let content = with_policy.then(|| flash_content(&manifest_of(&POLICY, 5), POLICY.bytes()));
    on_boards_with(clouds, content.as_deref(), test);
}

/// Runs `test` on each board with memory for clouds of this kind, side by side, with `content` in its flash.
pub(crate) fn on_boards_with(
    clouds: Clouds,
    content: Option<&[u8]>,
    test: impl Fn(Kind, Board) + Sync,
) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let path = directory.path().join("flash");
    let flash = content.map(|content| {
        std::fs::write(&path, content).expect("it is writable");
        path.as_path()
    });
    start(images_for(clouds), flash, test);
}

/// Runs `test` on each board, side by side, with the program for refinement.
pub(crate) fn on_refining_boards(test: impl Fn(Kind, Board) + Sync) {
    let images = images().into_iter();
    let images = images.map(|(kind, image)| (kind, image.with_file_name("refinement")));
    start(images.collect(), None, test);
}

fn start(images: Vec<(Kind, PathBuf)>, flash: Option<&Path>, test: impl Fn(Kind, Board) + Sync) {
    thread::scope(|scope| {
        for (kind, image) in images {
            let test = &test;
            scope.spawn(move || {
                let simulation = Simulation {
                    flash,
                    ..Simulation::default()
                };
                match Board::start(kind, &image, simulation) {
                    Err(error @ BoardError::NoQemu) => eprintln!("skipped: {error}"),
                    board => test(kind, board.expect("QEMU starts")),
                }
            });
        }
    });
}
