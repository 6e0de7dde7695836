//! What lets a roll-out in stages go on, what halts it, and what becomes of the policy then.

mod support;

use firmware_sim::client::Client;
use firmware_sim::node::Node;
use host_train::dataset::pairs::PairSet;
use host_train::dataset::procedural;
use host_train::protocol::{self, Protocol};
use host_train::publish::{Gate, Halt, PublishArgs, PublishError, Publisher, Stages};
use reagent_core::wire::Manifest;
use std::time::Duration;
use support::rollout::{ask_one, gate, good_policy, negated};
use support::{FLEET, Network, publisher, until};

/// Number of poses by which a stage is judged.
const POSES: u64 = 60;

/// A fleet whose robots run the good policy, version 1.
struct Fleet {
    network: Network,
    nodes: Vec<(&'static str, Node)>,
    publisher: Publisher,
}

impl Fleet {
    async fn start(robots: &[&'static str]) -> Fleet {
        let network = Network::start().await;
        let mut nodes = Vec::new();
        for &robot in robots {
            nodes.push((robot, network.node(FLEET, robot).await));
        }
        let mut publisher = publisher(&network).await;
        let shipped = publisher.publish(1, "good", good_policy()).await;
        shipped.expect("a good policy");
        let fleet = Fleet {
            network,
            nodes,
            publisher,
        };
        fleet.all_run(1).await;
        fleet
    }

    async fn all_run(&self, version: u64) {
        for (_, node) in &self.nodes {
            runs(node, version).await;
        }
    }

    /// Asks every robot on and on for poses of its pairs, until each has given enough to be judged.
    async fn ask(&self, pairs: impl Fn(&str) -> PairSet) {
        for (robot, _) in &self.nodes {
            let client = Client::new(self.network.join().await, FLEET).await;
            let client = client.expect("a good name");
            tokio::spawn(ask_one(client, robot.to_string(), pairs(robot)));
        }
        self.all_have_given_poses().await;
    }

    async fn all_have_given_poses(&self) {
        for (_, node) in &self.nodes {
            until(node, |view| view.tally.poses() >= POSES).await;
        }
    }

    async fn prepare(&mut self, version: u64, policy: &host_train::policy::WeightFile) -> Manifest {
        let manifest = self.publisher.prepare(version, "next", policy).await;
        manifest.expect("a sound policy")
    }
}

async fn runs(node: &Node, version: u64) {
    until(node, |view| {
        let policy = view.policy.as_ref();
        policy.is_some_and(|policy| policy.version == version)
    })
    .await;
}

/// The robot that a policy reaches first.
fn first_of<'r>(manifest: &Manifest, robots: &[&'r str]) -> &'r str {
    let first = robots.iter().min_by_key(|robot| manifest.draw(robot));
    first.expect("there are robots")
}

fn stages(text: &str) -> Stages {
    text.parse().expect("stages")
}

/// Pairs of the same points, turned and moved a little, so that refinement finds the pose whatever the policy does.
fn easy() -> PairSet {
    let models = procedural::models(3, 16);
    let mut pairs = protocol::draw(&models, Protocol::M40Models, 32, 3);
    let (sine, cosine) = 15.0_f32.to_radians().sin_cos();
    for (source, target) in pairs.source.iter_mut().zip(&pairs.target) {
        let turned =
            |&[x, y, z]: &[f32; 3]| [cosine * x - sine * y + 0.1, sine * x + cosine * y, z];
        *source = target.iter().map(turned).collect();
    }
    pairs
}

/// The same, but every other source belongs to another target.
fn hard() -> PairSet {
    let mut pairs = easy();
    let other = easy().source;
    for pair in (0..other.len()).step_by(2) {
        pairs.source[pair] = other[(pair + 7) % other.len()].clone();
    }
    pairs
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worse_policy_is_caught_where_refinement_finds_the_pose_all_the_same() {
    let mut fleet = Fleet::start(&["a", "b"]).await;
    fleet.ask(|_| easy()).await;
    let worse = negated(15);
    let manifest = fleet.prepare(2, &worse).await;
    let told = |line| println!("{line}");
    let outcome = fleet
        .publisher
        .roll_out(&manifest, &worse, &stages("1,100%"), &gate(POSES), told)
        .await;
    let halt = outcome.expect("an open session").expect_err("it is worse");
    let why = "fewer poses are reached by the policy itself";
    assert!(halt.to_string().starts_with(why), "{halt}");
}

/// The robot of the first stage sees harder things than the others, before the roll-out as well as afterwards.
#[tokio::test(flavor = "multi_thread")]
async fn a_robot_is_compared_with_its_own_past() {
    let robots = ["a", "b", "c"];
    let mut fleet = Fleet::start(&robots).await;
    let good = good_policy();
    let manifest = fleet.prepare(2, &good).await;
    let first = first_of(&manifest, &robots);
    let seen = |robot: &str| if robot == first { hard() } else { easy() };
    fleet.ask(seen).await;
    let told = |line| println!("{line}");
    let outcome = fleet
        .publisher
        .roll_out(&manifest, &good, &stages("1,100%"), &gate(POSES), told)
        .await;
    assert_eq!(outcome.expect("an open session").map(drop), Ok(()));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_fleet_of_one_is_judged_by_its_past_and_anyway_is_followed() {
    let mut fleet = Fleet::start(&["a"]).await;
    let worse = negated(7);
    let anyway = Gate {
        anyway: true,
        ..gate(POSES)
    };
    let mut lines = Vec::new();
    // Nothing is known of the past.
    let manifest = fleet.prepare(2, &good_policy()).await;
    let stages = stages("1,10%,100%");
    let told = |line| lines.push(line);
    let good = good_policy();
    let outcome = fleet
        .publisher
        .roll_out(&manifest, &good, &stages, &gate(POSES), told)
        .await;
    assert_eq!(outcome.expect("an open session").map(drop), Ok(()));
    let unjudged = "stage of 1 robot: taken; not judged: the old policy gave 0 poses there where 60 are needed";
    assert_eq!(lines, [unjudged]);

    fleet.ask(|_| easy()).await;
    for (version, gate, is_halted) in [(3, gate(POSES), true), (5, anyway, false)] {
        let manifest = fleet.prepare(version, &worse).await;
        let mut lines = Vec::new();
        let told = |line| lines.push(line);
        let outcome = fleet
            .publisher
            .roll_out(&manifest, &worse, &stages, &gate, told);
        let outcome = outcome.await.expect("an open session");
        let is_worse = matches!(outcome, Err(Halt::Worse(_)));
        assert_eq!(is_worse, is_halted, "{outcome:?}: {lines:?}");
        assert_eq!(lines[0], "stage of 1 robot: taken");
        let goes_on = |line: &String| line.starts_with("it goes on all the same");
        assert_eq!(lines.iter().any(goes_on), !is_halted, "{lines:?}");
        let back = fleet.publisher.publish(version + 1, "good", good_policy());
        back.await.expect("a good policy");
        fleet.all_run(version + 1).await;
        fleet.all_have_given_poses().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_old_policy_must_be_one_that_robots_run() {
    let network = Network::start().await;
    let mut publisher = publisher(&network).await;
    let manifest = publisher.prepare(2, "next", &negated(7)).await;
    let manifest = manifest.expect("a sound policy");
    let (good, other) = (gate(0).old, [7; 32]);
    let nobody = publisher.check_old(&manifest, good).await;
    assert!(
        matches!(nobody, Err(PublishError::Nobody { .. })),
        "{nobody:?}"
    );
    // Robots without a policy do not count.
    let node = network.node(FLEET, "a").await;
    let none_has_any = publisher.check_old(&manifest, other).await;
    none_has_any.expect("nothing is known");
    let shipped = publisher.publish(1, "good", good_policy()).await;
    shipped.expect("a good policy");
    runs(&node, 1).await;
    publisher.check_old(&manifest, good).await.expect("it runs");
    let wrong = publisher.check_old(&manifest, other).await;
    let wrong = wrong.expect_err("nobody runs it").to_string();
    assert!(
        wrong.contains("0707") && wrong.contains("a runs version 1"),
        "{wrong}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stage_that_cannot_succeed_any_more_halts() {
    let robots = ["a", "b", "c"];
    let mut fleet = Fleet::start(&robots).await;
    let mut other = publisher(&fleet.network).await;
    let good = good_policy();
    let manifest = fleet.prepare(10, &good).await;
    let first = first_of(&manifest, &robots);
    let (stages, told) = (stages("1,100%"), |line| println!("{line}"));
    let at_first = fleet.nodes.iter().find(|(robot, _)| *robot == first);
    let (_, at_first) = at_first.expect("it is one of them");
    let gate_of_many = gate(1_000_000);
    let rolled_out = fleet
        .publisher
        .roll_out(&manifest, &good, &stages, &gate_of_many, told);
    let (outcome, ()) = tokio::join!(rolled_out, async {
        runs(at_first, 10).await;
        let shipped = other.publish(11, "other", good_policy()).await;
        shipped.expect("a good policy");
    });
    let halt = outcome
        .expect("an open session")
        .expect_err("it is overtaken");
    assert!(
        matches!(&halt, Halt::Overtaken { policy, .. } if policy.version == 11),
        "{halt}"
    );
    fleet.all_run(11).await;

    let manifest = fleet.prepare(12, &good).await;
    let first = first_of(&manifest, &robots);
    let place = robots.iter().position(|robot| *robot == first);
    let (_, gone) = fleet.nodes.remove(place.expect("it is one of them"));
    let gate = Gate {
        wait: Duration::from_secs(5),
        ..gate(1_000_000)
    };
    let rolled_out = fleet
        .publisher
        .roll_out(&manifest, &good, &stages, &gate, told);
    let (outcome, ()) = tokio::join!(rolled_out, async {
        runs(&gone, 12).await;
        drop(gone);
    });
    let halt = outcome
        .expect("an open session")
        .expect_err("nobody gives poses");
    assert!(
        halt.to_string()
            .ends_with(&format!("no longer there: {first}")),
        "{halt}"
    );
}

/// A key, the good policy in `old.rgw`, and a worse one in `new.rgw`.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let at = |name: &str| folder.path().join(name);
        host_train::publish::keygen(&at("key")).expect("written");
        good_policy().save(&at("old.rgw")).expect("written");
        negated(7).save(&at("new.rgw")).expect("written");
        Folder(folder)
    }

    /// Arguments that publish the worse policy against one of the folder's files.
    fn args(&self, against: &str, endpoint: &str, options: &str) -> PublishArgs {
        #[derive(clap::Parser)]
        struct Publish {
            #[command(flatten)]
            args: PublishArgs,
        }
        let folder = self.0.path().display();
        let arguments = format!(
            "publish --weights {folder}/new.rgw --key {folder}/key --fleet {FLEET} --policy-version 2 \
             --against {folder}/{against} --connect {endpoint} {options}"
        );
        let parsed = <Publish as clap::Parser>::try_parse_from(arguments.split_whitespace());
        parsed.expect("good usage").args
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn files_are_read_before_anything_is_announced() {
    let folder = Folder::new();
    let nowhere = "tcp/127.0.0.1:1";
    let path = folder.0.path().display();
    let evaluated = format!("--evaluate {path}");
    for (against, options, why) in [
        ("none.rgw", "--stages 100%", "none.rgw"),
        (
            "old.rgw",
            &*evaluated,
            "is a folder; give a file of pairs, or views:DIR",
        ),
    ] {
        let args = folder.args(against, nowhere, options);
        let refused = host_train::publish::run(args).await;
        let refused = refused.expect_err("it cannot be read").to_string();
        assert!(refused.contains(why), "{refused}");
    }
}

/// A robot that was away while the policy was taken back gets the old one when it comes.
#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_was_taken_back_is_served_to_those_who_come_later() {
    let fleet = Fleet::start(&["a", "b"]).await;
    fleet.ask(|_| easy()).await;
    let folder = Folder::new();
    let options = format!("--stages 1,100% --gate-poses {POSES} --wait 0");
    let args = folder.args("old.rgw", &fleet.network.endpoint, &options);
    let publishing = host_train::publish::run(args);
    let ended = tokio::select! {
        ended = publishing => Some(ended),
        () = async {
            fleet.all_run(3).await;
            let late = fleet.network.node(FLEET, "c").await;
            runs(&late, 3).await;
        } => None,
    };
    assert!(ended.is_none(), "{ended:?}");
}

/// The first robot of a roll-out dies of its policy, and nobody asks the other one; or no pose converges.
#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_cannot_be_judged_is_taken_back() {
    let robots = ["a", "b"];
    let folder = Folder::new();
    let sizes_differ = |_: &str| {
        let mut pairs = easy();
        let points = pairs.source.iter_mut().flatten();
        points.for_each(|point| *point = point.map(|value| 5.0 * value));
        pairs
    };
    for is_killed in [true, false] {
        let mut fleet = Fleet::start(&robots).await;
        let manifest = fleet.prepare(2, &negated(7)).await;
        let first = first_of(&manifest, &robots);
        let place = robots.iter().position(|robot| *robot == first);
        if !is_killed {
            fleet.ask(sizes_differ).await;
        }
        let wait = if is_killed { 5 } else { 60 };
        let options = format!("--stages 1,100% --gate-poses {POSES} --gate-wait {wait} --wait 0");
        let args = folder.args("old.rgw", &fleet.network.endpoint, &options);
        let publishing = host_train::publish::run(args);
        let ended = tokio::select! {
            ended = publishing => Some(ended),
            () = async {
                if is_killed {
                    let (_, dying) = fleet.nodes.remove(place.expect("it is one of them"));
                    runs(&dying, 2).await;
                    dying.stop().await;
                }
                fleet.all_run(3).await;
                let again = fleet.network.node(FLEET, "again").await;
                runs(&again, 3).await;
            } => None,
        };
        assert!(ended.is_none(), "{ended:?}");
    }
}
