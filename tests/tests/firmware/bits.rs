//! The same actions and poses, to the bit, on every kernel and board.

use super::{COMPACT, POLICY, manifest_of, on_boards, request};
use firmware_sim::board::Board;
use host_train::dataset::pairs::PairSet;
use host_train::dataset::procedural;
use host_train::export::WeightFile;
use host_train::protocol::{self, Protocol};
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::wire::StepTaken;
use reagent_core::{Action, Frame, Pose, Registrar, Verdict};
use reagent_tests::shared;
use std::ops::ControlFlow;
use std::sync::LazyLock;

/// Actions and bits of the poses after them.
pub(crate) type Trajectory = Vec<(Action, [[u32; 4]; 3])>;

pub(crate) fn bits(rows: [[f32; 4]; 3]) -> [[u32; 4]; 3] {
    rows.map(|row| row.map(f32::to_bits))
}

/// What a policy does.
pub(crate) fn trajectory(
    file: &WeightFile,
    isa: Isa,
    source: &[[f32; 3]],
    target: &[[f32; 3]],
) -> Trajectory {
    let mut scratch = Box::new(Scratch::new());
    let mut registrar = Registrar::with_isa(isa, file.policy(), &mut scratch);
    let frame = Frame::of(target).expect("a cloud");
    let mut registration = registrar
        .start(source, target, frame, Pose::IDENTITY)
        .expect("sound clouds");
    let mut steps = Vec::new();
    while steps.len() < 10 && registration.verdict() != Verdict::Converged {
        let action = registrar.step(&mut registration).action;
        let pose = registration.target_from_source().to_rows();
        steps.push((action, bits(pose)));
    }
    steps
}

/// Source and target.
type Pair = [Vec<[f32; 3]>; 2];

/// Twenty pairs: ten real ones where there are any, the others of shapes that every machine can draw; of few
/// points but for one of each, since Helium is slow to simulate.
static PAIRS: LazyLock<Vec<Pair>> = LazyLock::new(|| {
    let drawn = protocol::draw(&procedural::models(7, 20), Protocol::M40Models, 20, 7);
    let real =
        shared("data/pairs_models.h5").map(|path| PairSet::load(&path).expect("it is readable"));
    let pair = |i: usize| {
        let set = real
            .as_ref()
            .filter(|set| i.is_multiple_of(2) && i < set.source.len());
        let set = set.unwrap_or(&drawn);
        let points = if i < 2 { 1024 } else { 20 + 3 * i };
        [&set.source[i], &set.target[i]].map(|cloud| cloud.iter().copied().take(points).collect())
    };
    (0..20).map(pair).collect()
});

pub(crate) fn pairs() -> &'static [Pair] {
    &PAIRS
}

/// The steps of a policy, the same on every kernel of this machine.
fn expected_of(file: &WeightFile, [source, target]: &Pair) -> Trajectory {
    let expected = trajectory(file, Isa::PORTABLE, source, target);
    for isa in Isa::all() {
        let found = trajectory(file, isa, source, target);
        assert_eq!(found, expected, "{}", isa.name());
    }
    expected
}

/// Asks a board for the pair's pose and compares every step.
fn assert_same(board: &mut Board, id: u64, [source, target]: &Pair, expected: &Trajectory) {
    let mut found = Trajectory::new();
    let step = |taken: StepTaken| {
        found.push((taken.action, bits(taken.target_from_source)));
        ControlFlow::Continue(())
    };
    let frame = request(id, 10, source, target);
    let reply = board.refine(&frame, step).expect("it runs");
    let reply = reply.expect("a pose");
    assert_eq!(&found, expected, "pair {id}");
    let last = expected.last().expect("steps").1;
    assert_eq!(bits(reply.target_from_source), last);
    assert_eq!((reply.id, usize::from(reply.steps)), (id, expected.len()));
}

#[test]
fn boards_take_the_same_steps_to_the_same_bits() {
    let expected: Vec<Trajectory> = pairs().iter().map(|p| expected_of(&POLICY, p)).collect();
    on_boards(true, |_, mut board| {
        let (status, report) = board.status_and_report().expect("it runs");
        assert_eq!(status.policy.map(|policy| policy.version), Some(5));
        assert_eq!(report.points, 1024);
        for (id, (pair, expected)) in pairs().iter().zip(&expected).enumerate() {
            assert_same(&mut board, id as u64, pair, expected);
        }
        let (status, report) = board.ask().expect("it runs");
        assert_eq!((status.served, status.refused), (20, 0));
        let ram = report.static_bytes + report.stack_bytes;
        assert!(ram <= 48 * 1024, "{ram} bytes of RAM");
    });
}

#[test]
fn a_compact_network_runs_on_every_board_to_the_same_bits() {
    assert!(COMPACT.bytes().len() <= 256 * 1024);
    let pairs = &pairs()[2..6];
    let expected: Vec<Trajectory> = pairs.iter().map(|p| expected_of(&COMPACT, p)).collect();
    let manifest = manifest_of(&COMPACT, 3);
    on_boards(false, |_, mut board| {
        board.load(&manifest, COMPACT.bytes()).expect("it is sound");
        for (id, (pair, expected)) in pairs.iter().zip(&expected).enumerate() {
            assert_same(&mut board, id as u64, pair, expected);
        }
    });
}
