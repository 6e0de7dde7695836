//! A robot's registrations, replayed on the host from its traces.

mod support;

use firmware_sim::client;
use host_train::policy::WeightFile;
use host_train::register::replay::{Difference, ReplayError, replay};
use reagent_core::kernels::Isa;
use reagent_core::wire::{
    self, CloudView, KernelName, Message, Mode, RefineRequest, StepsView, Trace, keys, serial,
    step_bytes,
};
use reagent_core::{Grid, wire::STEP_BYTES};
use support::{FLEET, Network, int8_policy, publisher, random_cloud, request, until};

fn line(trace: Trace<'_>) -> Vec<u8> {
    let mut buffer = vec![0; 200_000];
    let frame = wire::encode(&Message::Trace(trace), &mut buffer).expect("it fits");
    let mut line = Vec::new();
    serial::write(frame, |byte| line.push(byte));
    line
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_robot_did_comes_out_the_same_and_every_change_is_found() {
    let network = Network::start().await;
    let node = network.node(FLEET, "r1").await;
    let policies = [int8_policy(), WeightFile::pretrained()];
    let mut publisher = publisher(&network).await;
    let session = network.join().await;
    let key = keys::trace(FLEET, "r1").expect("good names");
    let published = session.declare_subscriber(key.as_str()).await;
    let published = published.expect("an open session");
    let (source, target) = (random_cloud(1, 301), random_cloud(2, 400));
    let grid = Grid::of(&target).expect("a good cloud");
    let codes: Vec<_> = target.iter().map(|&p| grid.encode(p)).collect();

    let (mut traces, mut taken) = (Vec::new(), Vec::new());
    for (version, policy) in (1..).zip(&policies) {
        let shipped = publisher.publish(version, "one", policy.clone()).await;
        let shipped = shipped.expect("a good policy");
        until(&node, |view| view.policy.as_ref() == Some(&shipped)).await;
        for (mode, target) in [
            (Mode::Fast, CloudView::of(&target)),
            (Mode::Verify, CloudView::on_grid(grid, &codes)),
        ] {
            let request = RefineRequest {
                mode,
                target,
                trace: true,
                initial: Some([[0., -1., 0., 0.5], [1., 0., 0., 0.], [0., 0., 1., -2.]]),
                ..request(&source, &source)
            };
            // A trace that is not asked for is not published.
            let quiet = RefineRequest {
                trace: false,
                ..request
            };
            let mut steps = [0; 2];
            for (steps, request) in steps.iter_mut().zip([quiet, request]) {
                let reply = client::refine(&session, FLEET, "r1", &request).await;
                *steps = reply.expect("a pose").steps;
            }
            assert_eq!(steps[0], steps[1]);
            taken.push((mode, steps[0]));
            let sample = published.recv_async().await.expect("an open session");
            traces.push(sample.payload().to_bytes().into_owned());
        }
    }
    let mut lines = Vec::new();
    for trace in &traces {
        serial::write(trace, |byte| lines.push(byte));
    }
    let replayed = replay(&lines, &policies).expect("traces");
    assert_eq!(replayed.len(), 4);
    for (again, (mode, steps)) in replayed.iter().zip(taken) {
        assert_eq!(again.difference, None);
        assert_eq!(
            (again.id, again.mode, again.steps),
            (77, mode, usize::from(steps))
        );
    }

    let Ok(Message::Trace(trace)) = wire::decode(&traces[1]) else {
        panic!("it is a trace");
    };
    // In 8-bit integers other kernels give the same result.
    let portable = Trace {
        kernels: KernelName::try_from(Isa::PORTABLE.name()).expect("fits"),
        ..trace.clone()
    };
    let again = &replay(&line(portable), &policies).expect("a trace")[0];
    assert_eq!(
        (&again.difference, again.kernels[1].as_str()),
        (&None, "portable")
    );

    let steps: Vec<[u8; STEP_BYTES]> = trace.steps.iter().map(|(a, p)| step_bytes(a, p)).collect();
    let difference = |trace: Trace<'_>| {
        let replayed = replay(&line(trace), &policies).expect("a trace");
        replayed[0].difference.clone()
    };
    let (count, middle) = (steps.len(), steps.len() / 2);
    for (byte, bit) in [(0, 1), (STEP_BYTES - 4, 1)] {
        let mut changed = steps.clone();
        changed[middle][byte] ^= bit;
        let changed = Trace {
            steps: StepsView::of(&changed),
            ..trace.clone()
        };
        let found = difference(changed);
        assert!(
            matches!(found, Some(Difference::Step { number, .. }) if number == middle + 1),
            "{found:?}"
        );
    }
    let fewer = Trace {
        steps: StepsView::of(&steps[..count - 1]),
        ..trace.clone()
    };
    let (robot, here) = (count - 1, count);
    let expected = Difference::Steps { robot, here };
    assert_eq!(difference(fewer), Some(expected));
    let mut other = trace.clone();
    other.reply.target_from_source[2][3] += 1e-3;
    let found = difference(other);
    assert!(
        matches!(found, Some(Difference::Answer { .. })),
        "{found:?}"
    );

    let unknown = replay(&lines, &policies[1..]);
    assert!(
        matches!(
            unknown,
            Err(ReplayError::Policy {
                number: 1,
                version: 1,
                ..
            })
        ),
        "{unknown:?}"
    );
    let mut flipped = lines.clone();
    flipped[1000] ^= 4;
    for damaged in [&lines[..lines.len() - 1], &flipped, &[], &[9; 50]] {
        let refused = replay(damaged, &policies);
        assert!(
            matches!(refused, Err(ReplayError::Damaged { .. })),
            "{refused:?}"
        );
    }
}
