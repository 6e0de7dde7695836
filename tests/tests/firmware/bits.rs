//! The same actions and poses on every kernel and board, bit for bit.

use super::boards::on_boards_with;
use super::{COMPACT, POLICY, manifest_of, on_boards, on_boards_for, request, request_of};
use firmware_sim::board::{Board, Clouds, Kind, flash_content};
use host_train::dataset::pairs::PairSet;
use host_train::dataset::procedural;
use host_train::policy::WeightFile;
use host_train::protocol::{self, Protocol};
use reagent_core::budget::{GRID_RAM_BUDGET, RAM_BUDGET};
use reagent_core::grid::Grid;
use reagent_core::kernels::Isa;
use reagent_core::net::Scratch;
use reagent_core::order::put_in_order;
use reagent_core::wire::{Cloud, CloudView, Reason, Refusal, StepTaken};
use reagent_core::{Action, Frame, Policy, Pose, Registrar};
use reagent_tests::shared;
use std::ops::ControlFlow;
use std::sync::LazyLock;

/// Actions, and the bits of the pose after each.
pub(crate) type Trajectory = Vec<(Action, [[u32; 4]; 3])>;

pub(crate) fn bits(rows: [[f32; 4]; 3]) -> [[u32; 4]; 3] {
    rows.map(|row| row.map(f32::to_bits))
}

/// The trajectory of a policy on a pair.
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
    while steps.len() < 10 && !registration.is_settled() {
        let action = registrar.step(&mut registration).expect("started").action;
        let pose = registration.target_from_source().to_rows();
        steps.push((action, bits(pose)));
    }
    steps
}

/// Source and target.
pub(crate) type Pair = [Vec<[f32; 3]>; 2];

/// Twenty pairs of 1024 points: real ones if there are any, otherwise of shapes that every machine can draw.
static PAIRS: LazyLock<PairSet> = LazyLock::new(|| {
    let drawn = || protocol::draw(&procedural::models(7, 20), Protocol::M40Models, 20, 7);
    shared("data/pairs_models.h5")
        .map_or_else(drawn, |path| PairSet::load(&path).expect("it is readable"))
});

/// Pairs with as many points as the board has time for; Helium is slow to simulate.
fn pairs_for(kind: Kind) -> Vec<Pair> {
    let points = |i: usize| match kind {
        _ if i == 0 => 1024,
        Kind::CortexM7 => 120 + 3 * i,
        Kind::CortexM55 => 20 + 3 * i,
    };
    let first = |cloud: &Vec<[f32; 3]>, i| {
        let mut cloud: Vec<_> = cloud.iter().copied().take(points(i)).collect();
        // Boards skip most of the work if neighbours follow each other.
        if i.is_multiple_of(2) {
            put_in_order(&mut cloud);
        }
        cloud
    };
    (0..20)
        .map(|i| [&PAIRS.source[i], &PAIRS.target[i]].map(|cloud| first(cloud, i)))
        .collect()
}

/// The pairs for the slower board.
pub(crate) fn pairs() -> Vec<Pair> {
    pairs_for(Kind::CortexM55)
}

/// The trajectory of a policy, after checking that every kernel of this machine agrees.
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
    assert_taken(board, id, &request(id, 10, source, target), expected);
}

/// Sends the frame of a request and compares every step.
fn assert_taken(board: &mut Board, id: u64, frame: &[u8], expected: &Trajectory) {
    let mut found = Trajectory::new();
    let step = |taken: StepTaken| {
        found.push((taken.action, bits(taken.target_from_source)));
        ControlFlow::Continue(())
    };
    let reply = board.refine(frame, step).expect("it runs");
    let reply = reply.expect("a pose");
    assert_eq!(&found, expected, "pair {id}");
    let last = expected.last().expect("steps").1;
    assert_eq!(bits(reply.target_from_source), last);
    assert_eq!((reply.id, usize::from(reply.steps)), (id, expected.len()));
}

#[test]
fn boards_take_the_same_steps_to_the_same_bits() {
    on_boards(true, |kind, mut board| {
        let (status, report) = board.status_and_report().expect("it runs");
        assert_eq!(status.policy.map(|policy| policy.version), Some(5));
        assert_eq!(report.points, 1024);
        for (id, pair) in pairs_for(kind).iter().enumerate() {
            assert_same(&mut board, id as u64, pair, &expected_of(&POLICY, pair));
        }
        let (status, report) = board.ask().expect("it runs");
        assert_eq!((status.served, status.refused), (20, 0));
        let ram = report.static_bytes + report.stack_bytes;
        assert!(ram as usize <= RAM_BUDGET, "{ram} bytes of RAM");
    });
}

/// A pair with clouds on grids: the frame of its request, with source and target as codes or as floats, and the points
/// that the codes stand for.
fn on_grid(id: u64, steps: u8, pair: &Pair, formats: [bool; 2]) -> (Vec<u8>, Pair) {
    let grids = pair
        .each_ref()
        .map(|cloud| Grid::of(cloud).expect("a good cloud"));
    let codes = [0, 1].map(|i| -> Vec<_> { pair[i].iter().map(|&p| grids[i].encode(p)).collect() });
    let view = |i: usize| match formats[i] {
        true => CloudView::on_grid(grids[i], &codes[i]),
        false => CloudView::of(&pair[i]),
    };
    let stand_for = |i: usize| match formats[i] {
        true => codes[i].iter().map(|&c| grids[i].decode(c)).collect(),
        false => pair[i].clone(),
    };
    let frame = request_of(id, steps, view(0), view(1));
    (frame, [0, 1].map(stand_for))
}

#[test]
fn clouds_on_a_grid_take_the_steps_of_their_points_in_less_memory() {
    // The largest pair, and pairs whose second cloud has to be aligned after an odd number of codes.
    let cases = [
        (0, [true, true]),
        (3, [true, true]),
        (5, [true, false]),
        (7, [false, true]),
    ];
    let pairs = pairs();
    let cases = cases.map(|(i, formats)| {
        // The large pair takes a while.
        let steps = if i == 0 { 2 } else { 10 };
        let (frame, points) = on_grid(i as u64, steps, &pairs[i], formats);
        assert!(i == 0 || points[0].len() % 2 == 1 && points != pairs[i]);
        let mut expected = expected_of(&POLICY, &points);
        expected.truncate(steps.into());
        (i as u64, frame, expected)
    });
    let compact = expected_of(&COMPACT, &pairs[4]);
    for clouds in [Clouds::Grid, Clouds::Floats] {
        on_boards_for(clouds, true, |_, mut board| {
            let (_, report) = board.status_and_report().expect("it runs");
            assert_eq!(report.points, 1024);
            for (id, frame, expected) in &cases {
                assert_taken(&mut board, *id, frame, expected);
            }
            if clouds == Clouds::Floats {
                return;
            }
            let (_, report) = board.ask().expect("it runs");
            let ram = (report.static_bytes + report.stack_capacity) as usize;
            assert!(ram <= GRID_RAM_BUDGET, "{ram} bytes of RAM");
            // As floats the clouds do not fit, but a policy's chunks do.
            let [source, target] = &pairs[0];
            let refused = board.refine(&request(9, 10, source, target), |_| {
                ControlFlow::Continue(())
            });
            let reason = Reason::TooManyPoints(Cloud::Target, 1024);
            assert_eq!(refused.expect("it runs"), Err(Refusal { id: 9, reason }));
            let manifest = manifest_of(&COMPACT, 6);
            board.load(&manifest, COMPACT.bytes()).expect("it is sound");
            assert_same(&mut board, 10, &pairs[4], &compact);
        });
    }
}

#[test]
fn a_compact_network_runs_on_every_board_to_the_same_bits() {
    assert!(COMPACT.bytes().len() <= 256 * 1024);
    let pairs = pairs();
    let pairs = &pairs[2..6];
    let expected: Vec<Trajectory> = pairs.iter().map(|p| expected_of(&COMPACT, p)).collect();
    let manifest = manifest_of(&COMPACT, 3);
    on_boards(false, |_, mut board| {
        board.load(&manifest, COMPACT.bytes()).expect("it is sound");
        for (id, (pair, expected)) in pairs.iter().zip(&expected).enumerate() {
            assert_same(&mut board, id as u64, pair, expected);
        }
    });
}

#[test]
fn the_shipped_compact_policy_finds_a_pose_on_the_board() {
    let file = WeightFile::from_bytes(Policy::pretrained_compact_bytes()).expect("it is sound");
    // The third pair: on the host, the policy alone comes within 5 degrees for 14 of the 20.
    let shapes = protocol::draw(&procedural::models(7, 20), Protocol::M40Models, 20, 7);
    let pair = [&shapes.source[2], &shapes.target[2]].map(Clone::clone);
    let truth = shapes.target_from_source[2];
    let off_deg = |pose: Pose| {
        let off = pose.after(truth.inverse()).rotation.to_cols_array_2d();
        let trace = off[0][0] + off[1][1] + off[2][2];
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
    };
    assert!(off_deg(Pose::IDENTITY) > 20.0);
    let expected = trajectory(&file, Isa::PORTABLE, &pair[0], &pair[1]);
    let manifest = manifest_of(&file, 8);
    on_boards(false, |kind, mut board| {
        if kind != Kind::CortexM7 {
            return;
        }
        board.load(&manifest, file.bytes()).expect("it is sound");
        assert_same(&mut board, 1, &pair, &expected);
    });
    let found = expected.last().expect("steps").1;
    let off = off_deg(Pose::from_rows(found.map(|row| row.map(f32::from_bits))));
    assert!(off < 5.0, "{off} degrees");
}

#[test]
fn boards_look_at_critical_points_alone_as_hosts_do() {
    let policy = POLICY.clone().rescanning(3);
    let content = flash_content(&manifest_of(&policy, 5), policy.bytes());
    on_boards_with(Clouds::Floats, Some(&content), |kind, mut board| {
        let pairs = pairs_for(kind);
        for (id, pair) in pairs.iter().enumerate().skip(1).step_by(9) {
            assert_same(&mut board, id as u64, pair, &expected_of(&policy, pair));
        }
        // A stack that was used up may have overwritten what lies below.
        let (_, report) = board.ask().expect("it runs");
        assert!(report.stack_bytes < report.stack_capacity, "{report:?}");
    });
}
