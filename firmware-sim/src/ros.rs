//! `firmware-sim ros`: a node of a ROS 2 network whose middleware is Zenoh (`rmw_zenoh`), without ROS. Clouds go in, the pose of
//! a model in them comes out.

mod clock;
mod keys;
mod messages;
mod names;
mod network;
mod node;
mod outputs;
mod parameters;
mod pose;
mod service;

use crate::session::{SessionArgs, endpoints};
use anyhow::{Context, anyhow, bail};
use host_train::cli::{Initial, Input, Units};
use host_train::dataset::Point;
use host_train::dataset::ros::point_cloud2::PointCloud2;
use host_train::policy::{REAGENT, VIEWS, WeightFile};
use host_train::random::{SEED, seeds};
use host_train::register::prepared::Prepared;
use host_train::register::request::{Done, Request};
use host_train::register::track::{POINTS, Tracking, bundled_policy};
use host_train::register::{Memory, Start};
use keys::Qos;
use messages::Triggered;
use network::Network;
use node::Member;
use outputs::Outputs;
use parameters::{FAST_TRACK, Parameters, Settings, Value};
use reagent_core::pipeline::Mode;
use reagent_core::track::TrackState;
use reagent_link::stop::stop_requested;
use service::Services;
use std::path::{Path, PathBuf};
use std::pin::pin;

/// Without one, robots look for peers by multicast. This node does not.
const CONFIGURATION: &str =
    "Zenoh configuration file (JSON5), in place of the router of this machine";

/// Be a node of a ROS 2 network over rmw_zenoh (Jazzy or later): publish where a model is in the clouds of a topic, until Ctrl-C
///
/// Clouds are sensor_msgs/PointCloud2 of the object alone, in the model's unit or that of --unit. While one cloud is registered,
/// only the newest of those that arrive is kept. If the pose is probably right, ~/pose (geometry_msgs/PoseStamped) and
/// ~/pose_with_covariance give the model's frame in the cloud's frame. /diagnostics says what came of every cloud. ~/model is the
/// model, latched, in the frame of --tf, or in one named after the file. The service ~/register (std_srvs/Trigger) registers the
/// newest cloud and answers with the pose as JSON. Settings are parameters: mode and on_request can be set, and
/// /parameter_events reports changes.
///
/// Without --connect, --listen and --zenoh, the node goes to the router that `ros2 run rmw_zenoh_cpp rmw_zenohd` starts on this
/// machine, tcp/localhost:7447, and waits until it answers.
#[derive(clap::Args, Clone, Debug)]
#[command(mut_arg("zenoh", |arg| arg.help(CONFIGURATION)))]
pub struct RosArgs {
    /// Cloud or mesh of the object (.ply .pcd .xyz .txt .asc .csv .pts .npy .off .obj .stl)
    #[arg(long, value_name = "FILE")]
    pub model: PathBuf,
    /// Unit of the model if clouds are in metres, or both units, as in:mm. Units: mm, cm, m, in, ft [default: that of the clouds]
    #[arg(long, value_name = "UNIT[:UNIT]")]
    pub unit: Option<Units>,
    /// Topic of the clouds
    #[arg(long, value_name = "/TOPIC", value_parser = names::topic, default_value = "/points")]
    pub cloud: String,
    /// The clouds are views from the origin of their frame, as a depth camera gives them
    #[arg(long)]
    pub view: bool,
    /// Policy: a file, or a bundled one [default: reagent, or views with --view; with --track the compact ones]
    #[arg(long, value_name = "FILE.rgw")]
    pub weights: Option<PathBuf>,
    /// What follows the policy's steps: fast (nothing), polish (closest points), verify (also compared with other poses), best (the
    /// most that there is memory for, here verify); or refine (closest points from the start, without the policy).
    /// In mode fast nothing judges the pose, and none is published
    #[arg(long, value_name = "MODE", default_value_t = Mode::Verify)]
    pub mode: Mode,
    /// Where each registration starts: none (turned in any way), identity, 12 numbers (rows of [R | t] from the cloud to the model),
    /// or a file with them [default: identity]
    #[arg(long, value_name = "POSE", allow_hyphen_values = true)]
    pub init: Option<Initial>,
    /// Follow one object from cloud to cloud, as `host-train track` does: --mode, which must not be fast, applies when refinement from
    /// the last pose is not enough, --init as long as no cloud has shown the object
    #[arg(long)]
    pub track: bool,
    /// Register clouds only when the service ~/register asks for the newest one
    #[arg(long)]
    pub on_request: bool,
    /// The node's name
    #[arg(long, value_name = "NAME", value_parser = names::node, default_value = "reagent")]
    pub node: String,
    /// The node's namespace
    #[arg(long, value_name = "/NAMESPACE", value_parser = names::namespace, default_value = "/")]
    pub namespace: String,
    /// The network's domain
    #[arg(long, value_name = "N", env = "ROS_DOMAIN_ID", default_value_t = 0, value_parser = names::domain, allow_negative_numbers = true)]
    pub domain: u8,
    /// Also publish the pose as a transform on /tf, from the cloud's frame to this one
    #[arg(long, value_name = "FRAME", value_parser = names::frame)]
    pub tf: Option<String>,
    /// Seed by which points of a mesh are drawn, as `register` draws those of its target
    #[arg(long, value_name = "S", default_value_t = SEED)]
    pub seed: u64,
    /// The network.
    #[command(flatten)]
    pub session: SessionArgs,
}

/// What registers clouds to the model.
struct Registration {
    model: Prepared<'static>,
    weights: WeightFile,
    request: Request,
    memory: Box<Memory>,
    /// The track, if one object is followed.
    tracking: Option<Tracking>,
    /// Most points used of each cloud.
    points: Option<usize>,
    /// The topic, for error messages.
    topic: PathBuf,
}

impl RosArgs {
    /// Runs the command.
    ///
    /// # Errors
    /// Files that cannot be read, no session, or a session that fails. Clouds that cannot be registered are no error.
    pub async fn run(self) -> anyhow::Result<()> {
        if self.track && self.mode == Mode::Fast {
            bail!("--mode: {FAST_TRACK}");
        }
        let mut registration = self.registration()?;
        let namespace = self.namespace.trim_end_matches('/');
        let longest = format!("{namespace}/{}/{}", self.node, outputs::LONGEST);
        names::short(&longest).map_err(|wrong| {
            anyhow!("--namespace and --node are too long for {longest}: {wrong}")
        })?;
        let mut stopped = pin!(stop_requested());
        let network = Network::named(self.session.clone());
        let session = tokio::select! {
            stopped = &mut stopped => return Ok(stopped?),
            session = network.join(|said| eprintln!("{said}")) => session?,
        };
        let mut member = Member::join(session, self.domain, &self.namespace, &self.node)
            .await
            .map_err(failed)?;
        if member.has_namesake().await.map_err(failed)? {
            let name = member.node.full_name();
            eprintln!(
                "another node is called {name}: both publish on its topics; see --node and --namespace"
            );
        }
        let model = self.model.file_stem().unwrap_or_default();
        let model = model.to_string_lossy().into_owned();
        let frame = self.tf.clone().unwrap_or_else(|| model.clone());
        let shown = registration.model_message(frame);
        let topic = member.node.own_topic("model");
        let shown = member.latch(&topic, keys::POINT_CLOUD, &shown).await;
        let _shown = shown.map_err(failed)?;
        let outputs = Outputs::declare(&mut member, model, self.tf.clone()).await;
        let mut outputs = outputs.map_err(failed)?;
        let mut services = Services::new();
        let of_parameters = parameters::SERVICES.map(|(name, of)| (name, of, Qos::Parameters));
        for service in [("register", keys::TRIGGER, Qos::Reliable)]
            .into_iter()
            .chain(of_parameters)
        {
            let served = member.serve(&mut services, service).await;
            served.map_err(failed)?;
        }
        let mut parameters = self.parameters();
        let events = parameters::Events::declare(&mut member, parameters.told()).await;
        let mut events = events.map_err(failed)?;
        let clouds = member
            .subscribe(&self.cloud, keys::POINT_CLOUD)
            .await
            .map_err(failed)?;
        println!(
            "node {} of domain {} hears {} ({}); Ctrl-C ends it",
            member.node.full_name(),
            self.domain,
            self.cloud,
            endpoints(&network.args)
        );
        let mut register = |bytes: &[u8], mode| {
            registration.request.mode = mode;
            tokio::task::block_in_place(|| outputs.answer(&mut registration, bytes)).map_err(failed)
        };
        let mut newest = None;
        loop {
            tokio::select! {
                // Requests come first, however fast clouds arrive.
                biased;
                stopped = &mut stopped => return Ok(stopped?),
                call = services.next() => {
                    if call.of != keys::TRIGGER {
                        events.set(parameters.answer(call)).map_err(failed)?;
                        continue;
                    }
                    newest = clouds.waiting().map_err(failed)?.or(newest);
                    let done = match &newest {
                        Some(bytes) => register(bytes, parameters.settings.mode)?,
                        None => Triggered {
                            success: false,
                            message: format!("no cloud has come on {} so far", self.cloud),
                        },
                    };
                    call.answer(&done);
                }
                bytes = clouds.next() => {
                    let bytes = newest.insert(bytes.map_err(failed)?);
                    let Settings { mode, on_request } = parameters.settings;
                    if !on_request {
                        register(bytes, mode)?;
                    }
                }
            }
        }
    }

    fn policy(&self) -> &Path {
        let bundled = match (self.track, self.view) {
            (true, of_views) => bundled_policy(of_views),
            (false, true) => VIEWS,
            (false, false) => REAGENT,
        };
        self.weights.as_deref().unwrap_or(Path::new(bundled))
    }

    /// The options that the node was started with.
    fn parameters(&self) -> Parameters {
        let path = |path: &Path| Value::text(path.to_string_lossy().into_owned());
        let settings = Settings {
            mode: self.mode,
            on_request: self.on_request,
        };
        let fixed = vec![
            ("cloud", Value::text(self.cloud.clone())),
            ("model", path(&self.model)),
            ("tf", Value::text(self.tf.clone().unwrap_or_default())),
            ("track", Value::flag(self.track)),
            ("view", Value::flag(self.view)),
            ("weights", path(self.policy())),
        ];
        Parameters::new(settings, fixed)
    }

    fn registration(&self) -> anyhow::Result<Registration> {
        let start = self
            .init
            .clone()
            .map_or(Ok(Start::Identity), Initial::load)
            .context("--init")?;
        let points = self.track.then_some(POINTS);
        let request = Request {
            start,
            mode: self.mode,
            view_point: self.view.then_some([0.0; 3]),
            ..Request::default()
        };
        let model = self.prepared(points).context("--model")?;
        request.get_ready(&model);
        Ok(Registration {
            model,
            weights: WeightFile::load(self.policy()).context("--weights")?,
            request,
            memory: Box::new(Memory::new()),
            tracking: self.track.then(Tracking::new),
            points,
            topic: self.cloud.clone().into(),
        })
    }

    fn prepared(&self, points: Option<usize>) -> anyhow::Result<Prepared<'static>> {
        let scale = self.unit.map_or(1.0, |units| units.scale);
        let [_, of_target] = seeds(self.seed);
        Ok(Input::read(&self.model, scale, points, of_target)?.cloud)
    }
}

fn failed(error: zenoh::Error) -> anyhow::Error {
    anyhow!("zenoh: {}", crate::session::plain(&error))
}

impl Registration {
    /// The model as a cloud in its own frame.
    fn model_message(&self, frame: String) -> PointCloud2 {
        let origin = self.model.origin;
        let placed = |p: &Point| std::array::from_fn(|k| (f64::from(p[k]) + origin[k]) as f32);
        PointCloud2::of(self.model.all.iter().map(placed), frame)
    }

    /// The pose, and if an object is followed, whether it is there.
    fn register(&mut self, cloud: &PointCloud2) -> anyhow::Result<(Done, Option<TrackState>)> {
        let source = Prepared::of_positions(cloud.positions()?, &self.topic, self.points)?;
        let (policy, memory) = (self.weights.policy(), &mut self.memory);
        let clouds = [&source, &self.model];
        let Some(tracking) = &mut self.tracking else {
            let [source, model] = clouds;
            let done = self.request.register(policy, memory, source, model);
            return Ok((done.context("no pose")?, None));
        };
        let tracked = tracking.follow(&self.request, policy, memory, clouds);
        let tracked = tracked.context("no pose")?;
        Ok((tracked.done, Some(tracked.state)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Args, Command, FromArgMatches};
    use std::fs;

    fn args(options: &[&str]) -> RosArgs {
        let command = RosArgs::augment_args(Command::new("ros"));
        let given = command.get_matches_from([&["ros"], options].concat());
        RosArgs::from_arg_matches(&given).expect("options")
    }

    #[test]
    fn the_help_names_the_network_that_nodes_of_ros_have() {
        let mut command = RosArgs::augment_args(Command::new("ros"));
        let help = command.render_long_help().to_string();
        assert!(
            help.contains("tcp/localhost:7447") && help.contains(CONFIGURATION),
            "{help}"
        );
        assert!(!help.contains("multicast"), "{help}");
    }

    #[test]
    fn the_first_view_of_a_mesh_takes_no_longer_than_the_next() {
        let folder = tempfile::tempdir().expect("a temporary directory");
        let path = folder.path().join("roof.off");
        let mesh = "OFF 4 4 0\n0 0 0\n2 0 0\n0 3 0\n0 0 4\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
        fs::write(&path, mesh).expect("writable");
        let model = path.to_str().expect("text");
        for track in [&[][..], &["--track"]] {
            let views = args(&[&["--model", model, "--view"], track].concat());
            let ready = views.registration().expect("a model").model;
            let points = views.track.then_some(POINTS);
            let seen = views.prepared(points).expect("a model");
            assert_ne!(ready, seen, "nothing was looked at so far");
            assert!(!seen.outward().is_empty());
            assert_eq!(ready, seen);
        }
    }

    #[tokio::test]
    async fn a_mode_that_judges_nothing_follows_nothing() {
        let options = ["--model", "none.ply", "--track", "--mode", "fast"];
        let refused = args(&options).run().await.expect_err("refused");
        let said =
            "--mode: fast does not tell whether the object is lost: take another mode to follow it";
        assert_eq!(refused.to_string(), said);
    }
}
