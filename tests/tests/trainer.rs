//! Parts of the trainer: what roll-outs record, what a step does to the parameters, and roll-outs that decide.

use host_train::augment::{clean_sample, noisy_sample};
use host_train::dataset::pairs::PairSet;
use host_train::dataset::procedural;
use host_train::learn::acting::poses_of;
use host_train::learn::env::{Accumulation, Problem};
use host_train::learn::nn::{Parameters, Shape};
use host_train::learn::optim::Adam;
use host_train::learn::reward::{CLOSER, FARTHER, SAME, chamfer};
use host_train::measure::eval::{EvalSettings, evaluate};
use host_train::measure::method::{Contestant, Finish, Start};
use host_train::policy::WeightFile;
use host_train::random::{Purpose, stream};
use host_train::train::{Follow, Method, RollOut, Trainer};
use host_train::views::Views;
use reagent_core::cut::Cut;
use reagent_core::sight::Sight;
use reagent_core::{Action, Decision};

fn problems(count: u64, points: usize) -> Vec<Problem> {
    (0..count)
        .map(|i| {
            let mut rng = stream(4, Purpose::Augment, i);
            let model = procedural::model(2, i);
            Problem::from(noisy_sample(&mut rng, &model.points, points))
        })
        .collect()
}

/// A trainer with a small network.
fn small(method: Method) -> Trainer {
    let shape = Shape {
        embed: [16, 16, 32],
        extra: 0,
        head: [16, 16],
    };
    let parameters = Parameters::random(shape, 1);
    let adam = Adam::new(parameters.values.len());
    Trainer::new(parameters, adam, 0, 5, RollOut::default(), method)
}

#[test]
fn rewards_belong_to_the_steps_that_earned_them() {
    let buffer = small(Method::new(2.0)).gather(problems(4, 50));
    let (runs, steps) = (buffer.trajectories, 10);
    assert_eq!((runs, buffer.observations.len()), (16, 160));
    let distance = |i: usize| {
        let o = &buffer.observations[i];
        let problem = &buffer.problems[o.problem];
        let view = Accumulation::Global.view(problem.centroid, &o.pose);
        let seen: Vec<_> = problem.source.iter().map(|&p| view.see(p)).collect();
        chamfer(&seen, &problem.truth())
    };
    let mut met = [0; 3];
    for i in 0..runs * (steps - 1) {
        let (o, next) = (&buffer.observations[i], &buffer.observations[i + runs]);
        assert_eq!(o.problem, next.problem);
        assert_eq!(Accumulation::Global.step(&o.pose, o.action), next.pose);
        let (before, after) = (distance(i), distance(i + runs));
        let (kind, expected) = if after < before {
            (0, CLOSER)
        } else if after > before {
            (1, FARTHER)
        } else {
            (2, SAME)
        };
        met[kind] += 1;
        assert_eq!(o.reward, expected, "{i}");
    }
    assert!(met[0] > 0 && met[1] > 0, "{met:?}");

    // A step that stops on all axes leaves the distance unchanged, bit for bit.
    let mut method = Method::new(2.0);
    method.follow = Follow::Expert;
    let mut solved = problems(2, 50);
    for problem in &mut solved {
        problem.true_pose = reagent_core::Pose::IDENTITY;
    }
    for o in small(method).gather(solved).observations {
        assert_eq!((o.action, o.reward), (Action::STOP, SAME));
    }
}

#[test]
fn trajectories_follow_whom_they_should() {
    for follow in [Follow::Stochastic, Follow::Expert, Follow::Argmax] {
        let mut method = Method::new(0.0);
        method.follow = follow;
        let buffer = small(method).gather(problems(4, 50));
        let runs = buffer.trajectories;
        let all = || buffer.observations.iter();
        assert_eq!(
            all().all(|o| o.action == o.expert),
            follow == Follow::Expert
        );
        // The trajectories of one problem are equal unless they are random.
        let equal = all()
            .enumerate()
            .all(|(i, o)| o.action == buffer.observations[i / runs * runs + i % 4].action);
        assert_eq!(equal, follow != Follow::Stochastic, "{follow:?}");
        // The recorded probability is that under the policy that took the action.
        for o in all().filter(|_| follow == Follow::Argmax) {
            assert!(o.log_probability.iter().all(|&p| p > -(11f32.ln())));
        }
    }
}

#[test]
fn long_gradients_are_clipped_and_averages_follow() {
    let mut method = Method::new(2.0);
    method.clip_gradient = Some(0.01);
    method.average = Some(0.5);
    let mut trainer = small(method);
    let start = trainer.agent.parameters.values.clone();
    let stats = trainer.update(problems(4, 50), 1e-3).expect("finite");
    assert!(stats.gradient_norm > 0.01, "measured before clipping");
    let squares = trainer.last_gradient().values.iter().map(|g| g * g);
    let norm = squares.sum::<f32>().sqrt();
    assert!((norm - 0.01).abs() < 1e-5, "{norm}");
    let (now, mean) = (&trainer.agent.parameters.values, trainer.result().values);
    let between = |i: usize| {
        let (low, high) = (start[i].min(now[i]), start[i].max(now[i]));
        low - 1e-3 <= mean[i] && mean[i] <= high + 1e-3
    };
    assert!((0..now.len()).all(between));
    assert!(mean != *now && mean != start);
}

#[test]
fn the_trainer_registers_as_the_robot_does() {
    let parameters = Parameters::random(Shape::PAPER, 8);
    let mut pairs = PairSet::default();
    let mut problems = Vec::new();
    for i in 0..3 {
        let mut rng = stream(6, Purpose::Pairs, i);
        let model = procedural::model(3, i).points;
        let sample = clean_sample(&mut rng, &model, 100);
        problems.push(Problem::from(sample.clone()));
        pairs.push(sample, model, 0);
    }
    let file = WeightFile::from_parameters(&parameters).expect("deployable");
    let robot = Contestant {
        name: "robot".into(),
        method: Start::Policy(file.policy()).then(Finish::Nothing),
    };
    let trainer = Contestant {
        name: "trainer".into(),
        method: Start::Trained {
            parameters: &parameters,
            accumulation: Accumulation::Global,
            decision: Decision::MostLikely,
        }
        .then(Finish::Nothing),
    };
    let settings = EvalSettings {
        steps: 10,
        threads: 1,
        per_step: true,
    };
    let outcomes = evaluate(&pairs, &[robot, trainer], &settings, &|| {}).expect("sound pairs");
    assert_eq!(outcomes[1].per_step.len(), 11);
    let rules = (Accumulation::Global, Decision::MostLikely);
    let found = poses_of(parameters, rules, &problems, 10);
    for (i, (poses, robot)) in found
        .iter()
        .zip(&outcomes[0].target_from_source)
        .enumerate()
    {
        assert_eq!(poses.len(), 11);
        assert_eq!(poses[10], outcomes[1].target_from_source[i]);
        assert!(poses[10].rotation.abs_diff_eq(robot.rotation, 1e-5));
        assert!(poses[10].translation.abs_diff_eq(robot.translation, 1e-5));
    }
}

/// The trainer and robots agree on what a policy for views looks at, at the start and after every few steps.
#[test]
fn the_trainer_looks_where_the_robot_does() {
    let network = WeightFile::pretrained();
    let parameters = network.parameters(0).expect("a policy in f32");
    let sight = Sight {
        cut: Cut::within(1.25).expect("a number of radii"),
        focus: 3,
    };
    let views = Views::procedural(4, 0..6);
    let mut pairs = PairSet::default();
    views.draw(6, 300, 9, &mut pairs);
    let samples = pairs.samples();
    let problems: Vec<Problem> = samples.map(|pair| Problem::seen(sight, pair)).collect();
    let decision = Decision::NearestToMean;
    let file = network.deciding(decision).seeing(sight);
    let robot = Contestant {
        name: "robot".into(),
        method: Start::Policy(file.policy()).then(Finish::Nothing),
    };
    let settings = EvalSettings {
        steps: 7,
        threads: 1,
        per_step: false,
    };
    let outcomes = evaluate(&pairs, &[robot], &settings, &|| {}).expect("sound pairs");
    let found = poses_of(parameters, (Accumulation::Global, decision), &problems, 7);
    for (poses, robot) in found.iter().zip(&outcomes[0].target_from_source) {
        assert!(poses[7].rotation.abs_diff_eq(robot.rotation, 1e-4));
        assert!(poses[7].translation.abs_diff_eq(robot.translation, 1e-4));
    }
    let looked_at = problems.iter().filter(|p| p.chosen.len() < p.target.len());
    assert_eq!(looked_at.count(), problems.len());
}
