//! A refined pose and what is said of it are the host's, bit for bit.

use super::bits::{bits, pairs};
use super::boards::on_refining_boards;
use super::frame_of;
use firmware_sim::board::Board;
use reagent_core::Pose;
use reagent_core::budget::{REFINEMENT_RAM_BUDGET, REFINEMENT_STACK_BUDGET};
use reagent_core::kernels::Isa;
use reagent_core::pipeline::{self, Answer, Refinement};
use reagent_core::polish::Workspace;
use reagent_core::wire::{CloudView, Fit, Mode, Reason, RefineReply, RefineRequest, Refusal};
use std::ops::ControlFlow;

/// The host's result, the same on every kernel.
fn expected(request: &RefineRequest<'_>, pair: [&[[f32; 3]]; 2]) -> (Answer, Refinement) {
    let on = |isa| {
        let mut workspace = Box::new(Workspace::with_isa(isa));
        let start = request.task(&[], &[]).start.pose();
        let found = pipeline::refine(&mut workspace, pair, start, &request.task(&[], &[]), || {
            Ok::<_, reagent_core::Error>(())
        });
        let found = found.expect("sound clouds").expect("a mode that refines");
        (Answer::refined(found, None).expect("a rigid pose"), found)
    };
    let found = on(Isa::PORTABLE);
    for isa in Isa::all() {
        assert_eq!(on(isa), found, "{}", isa.name());
    }
    found
}

fn refine(board: &mut Board, request: RefineRequest<'_>) -> Result<RefineReply, Refusal> {
    let answer = board.refine(&frame_of(request), |_| ControlFlow::Continue(()));
    answer.expect("it runs")
}

#[test]
fn boards_refine_and_verify_to_the_same_bits() {
    let off = Pose::from_rows([
        [0.98, -0.199, 0.0, 0.03],
        [0.199, 0.98, 0.0, -0.02],
        [0.0, 0.0, 1.0, 0.01],
    ]);
    let pairs = pairs();
    // One pair of 1024 points, with a new target and with a prepared one.
    let large = &pairs[0];
    let requests: Vec<_> = [(large, Mode::Refine), (large, Mode::Refine)]
        .into_iter()
        .chain(pairs[8..11].iter().map(|pair| (pair, Mode::Refine)))
        .chain(pairs[17..].iter().map(|pair| (pair, Mode::Verify)))
        .enumerate()
        .map(|(id, ([source, target], mode))| {
            let request = RefineRequest {
                mode,
                initial: Some(off.to_rows()),
                ..RefineRequest::new(id as u64, CloudView::of(source), CloudView::of(target))
            };
            (request, expected(&request, [source, target]))
        })
        .collect();
    assert!(
        requests
            .iter()
            .any(|(_, (answer, _))| answer.target_from_source != off)
    );
    on_refining_boards(|_, mut board| {
        let (_, report) = board.status_and_report().expect("it runs");
        let ram = (report.static_bytes + report.stack_capacity) as usize;
        assert!(ram <= REFINEMENT_RAM_BUDGET, "{ram} bytes of RAM");
        assert_eq!(report.stack_capacity as usize, REFINEMENT_STACK_BUDGET);
        for (request, (answer, found)) in &requests {
            let reply = refine(&mut board, *request).expect("a pose");
            let pose = answer.target_from_source.to_rows();
            assert_eq!(bits(reply.target_from_source), bits(pose), "{}", request.id);
            assert_eq!((reply.id, reply.mode), (request.id, request.mode));
            assert_eq!(reply.verdict, answer.verdict);
            assert_eq!(reply.probability, answer.probability);
            assert_eq!(reply.fit, Some(Fit::of(found)));
        }
        let no_policy = RefineRequest {
            mode: Mode::Polish,
            ..requests[0].0
        };
        let reason = Reason::NoSuchMode(Mode::Polish);
        let refused = refine(&mut board, no_policy);
        assert_eq!(refused, Err(Refusal { id: 0, reason }));
    });
}
