use super::*;
use crate::dataset::cloud_file::CloudFile;
use crate::dataset::mesh::Mesh;
use crate::dataset::winding::tests::block;
use crate::dataset::{Point, procedural};
use crate::policy::WeightFile;
use crate::random::{Purpose, stream};
use reagent_core::polish::Refined;
use reagent_core::pose::rotation_from_euler;
use std::path::Path;

#[test]
fn without_steps_the_start_is_verified() {
    let mesh = procedural::shape(1, 1).mesh;
    let clouds = [1, 2].map(|i| mesh.sample(400, &mut stream(3, Purpose::Surface, i)));
    let [source, target] = clouds
        .each_ref()
        .map(|cloud| Prepared::of_points(cloud, Path::new("cloud"), None).expect("a cloud"));
    let file = WeightFile::pretrained();
    let memory = &mut Box::new(Memory::new());
    let mut register = |request: Request| {
        let done = request.register(file.policy(), memory, &source, &target);
        done.expect("two clouds").found
    };
    let verified = register(Request {
        steps: 0,
        ..Request::default()
    });
    assert!(verified.trace.is_empty() && verified.answer.policy.is_none());
    let refinement = verified.answer.refinement.expect("a refinement");
    assert!(refinement.hypotheses.is_some());
    // The refined pose is where verification begins.
    let refined = register(Request {
        mode: Mode::Refine,
        ..Request::default()
    });
    let alone = refined.answer.refinement.expect("a refinement");
    assert_eq!(alone.polished, refinement.polished);
    let stepped = register(Request::default());
    assert!(stepped.answer.policy.is_some_and(|policy| policy.steps > 0));
}

/// The upper side of a plate as a sensor above it sees it, starting nearer to the lower side.
#[test]
fn a_solid_is_registered_by_the_side_that_was_seen() {
    let plate = block(Vec3::ZERO, Vec3::new(1.6, 1.0, 0.06));
    let side = |p: &Point| p[2] > 0.0299 && p[0].abs() < 0.79 && p[1].abs() < 0.49;
    let seen = plate.sample(1500, &mut stream(3, Purpose::Surface, 0));
    let seen: Vec<Point> = seen.into_iter().filter(side).collect();
    let name = Path::new("cloud");
    let source = Prepared::of_points(&seen, name, None).expect("a cloud");
    let nearer_the_lower = Pose {
        translation: Vec3::new(0.0, 0.0, -0.05),
        ..Pose::IDENTITY
    };
    let request = Request {
        start: Start::Pose(Pose64::of(nearer_the_lower, [0.0; 3], [0.0; 3])),
        mode: Mode::Refine,
        view_point: Some([0.0, 0.0, 4.0]),
        ..Request::default()
    };
    let policy = WeightFile::pretrained();
    let memory = &mut Box::new(Memory::new());
    let mut height = |mesh: &Mesh, dense| {
        let file = CloudFile {
            faces: Some(mesh.faces.clone()),
            ..CloudFile::of(
                &mesh
                    .vertices
                    .iter()
                    .map(|v| v.to_array())
                    .collect::<Vec<_>>(),
            )
        };
        let target = Prepared::of_file(&file, name, None, 1).expect("a mesh");
        let request = Request { dense, ..request };
        let done = request.register(policy.policy(), memory, &source, &target);
        done.expect("two clouds").near().translation.z
    };
    let mut inside_out = plate.clone();
    inside_out.faces.iter_mut().for_each(|face| face.swap(0, 1));
    // Without one of its narrow sides it encloses nothing.
    let mut open = plate.clone();
    open.faces.remove(0);
    for solid in [&plate, &inside_out, &open] {
        for dense in [Dense::Never, Dense::Always] {
            assert!(height(solid, dense).abs() < 0.006);
        }
    }
}

/// Two starts that lead astray, and one near the truth.
#[test]
fn the_best_of_several_starts_wins_and_others_follow() {
    let mesh = procedural::shape(1, 1).mesh;
    let clouds = [1, 2].map(|i| mesh.sample(400, &mut stream(3, Purpose::Surface, i)));
    let [source, target] = clouds
        .each_ref()
        .map(|cloud| Prepared::of_points(cloud, Path::new("cloud"), None).expect("a cloud"));
    let turned = |angles: [f32; 3]| {
        let pose = Pose {
            rotation: rotation_from_euler(Vec3::from(angles)),
            translation: Vec3::ZERO,
        };
        Start::Pose(Pose64::of(pose, [0.0; 3], [0.0; 3]))
    };
    let starts = [
        turned([2.5, 0.3, 0.0]),
        turned([0.1, 0.1, 0.0]),
        turned([0.0, 2.0, 1.0]),
    ];
    let file = WeightFile::pretrained();
    let memory = &mut Box::new(Memory::new());
    let mut register = |mode, starts: &[Start], best| {
        let request = Request {
            mode,
            ..Request::default()
        };
        let clouds = [&source, &target];
        let go_on = || Ok::<_, Error>(());
        let done = request.register_from(starts, best, file.policy(), memory, clouds, go_on);
        done.expect("two clouds")
    };
    for mode in [Mode::Refine, Mode::Verify] {
        let done = register(mode, &starts, 4);
        assert_eq!(done.start, Some(1), "{mode}");
        let near = done.near();
        assert!(near.rotation.x_axis.x > 0.999 && near.rotation.y_axis.y > 0.999);
        // Each is another pose, and fits less well.
        let fit = done.found.answer.refinement.expect("a refinement").refined;
        assert!(!done.others.is_empty() && done.others.len() <= 3, "{mode}");
        for (i, other) in done.others.iter().enumerate() {
            let Refined {
                target_from_source,
                residual,
                ..
            } = other.refined;
            assert!(residual.mean() > fit.residual.mean());
            let rest = done.others[..i].iter();
            let mut named = rest.map(|o| o.refined.target_from_source).chain([near]);
            assert!(named.all(|named| named != target_from_source));
        }
    }
    let alone = register(Mode::Verify, &starts[1..2], 1);
    assert_eq!((alone.start, alone.others.len()), (None, 0));
    // Refined further, a pose may become a better one, which is then given out.
    let probability = |done: &Done| done.found.answer.probability.expect("a refinement");
    let mut found_further = 0;
    for turn in 1..24 {
        let start = [turned([0.25 * turn as f32, 0.4, 0.2])];
        let once = register(Mode::Refine, &start, 1);
        let best = register(Mode::Refine, &start, 3);
        found_further += usize::from(probability(&best) > probability(&once));
        for (best, least) in [
            (&best, probability(&once)),
            (&register(Mode::Verify, &start, 3), 0.0),
        ] {
            assert!(probability(best) >= least, "{turn}");
            let others = best.others.iter().map(|other| other.probability);
            let falling: Vec<f32> = [probability(best)].into_iter().chain(others).collect();
            assert!(falling.is_sorted_by(|a, b| a >= b), "{turn}: {falling:?}");
        }
    }
    assert!(found_further > 0);
}
