//! Serves metrics of robots in the text format of Prometheus, and whether all is well, over HTTP.

use crate::certificate::{self, Certificate};
use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::CONTENT_TYPE;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use prometheus_client::encoding::prometheus_text;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use reagent_core::Verdict;
use reagent_core::wire::Status;
use reagent_core::wire::keys::Hex;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;
use thiserror::Error;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::task::JoinHandle;

/// Most connections at once; more wait.
const CONNECTIONS: usize = 64;
/// A client that has not sent its request within this time is dropped.
const ASKING_TIME: Duration = Duration::from_secs(1);
/// A client that has not read its answer within this time is dropped, too.
const PATIENCE: Duration = Duration::from_secs(5);

/// Where a program's metrics are served.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct MetricsArgs {
    /// Serve metrics for Prometheus (/metrics) and whether all is well (/health) over HTTP, for example at 127.0.0.1:9100
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    pub metrics: Option<SocketAddr>,
}

fn address(text: &str) -> Result<SocketAddr, String> {
    text.parse()
        .map_err(|_| "give a numeric address and a port, such as 127.0.0.1:9100".into())
}

/// What is known of a robot.
#[derive(Clone, Debug)]
pub struct Robot {
    /// Its name.
    pub name: String,
    /// Its last status.
    pub status: Status,
    /// Whether it is there.
    pub online: bool,
    /// Whether two robots publish under this name.
    pub duplicate: bool,
}

/// What is served.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// Robots that are or were there.
    pub robots: Vec<Robot>,
    /// Certificates of the session.
    pub certificates: Vec<Certificate>,
    /// What else is wrong, if anything is.
    pub wrong: Option<String>,
}

/// Why nothing is served.
#[derive(Debug, Error)]
#[error("no metrics at {address}: {reason}")]
pub struct MetricsError {
    /// As given.
    pub address: SocketAddr,
    /// What the system says.
    pub reason: std::io::Error,
}

/// A server. It runs until it is dropped.
#[derive(Debug)]
pub struct Serving {
    /// Where it listens.
    pub address: SocketAddr,
    task: JoinHandle<()>,
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl MetricsArgs {
    /// Starts the server, if an address was given. Every request calls `figures`.
    ///
    /// # Errors
    /// The address cannot be listened on.
    pub async fn serve(
        self,
        figures: impl Fn() -> Figures + Send + Sync + 'static,
    ) -> Result<Option<Serving>, MetricsError> {
        let Some(address) = self.metrics else {
            return Ok(None);
        };
        let failed = |reason| MetricsError { address, reason };
        let listener = TcpListener::bind(address).await.map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        tracing::info!("metrics at http://{address}/metrics");
        let task = tokio::spawn(accept(listener, Arc::new(figures)));
        Ok(Some(Serving { address, task }))
    }
}

async fn accept<F>(listener: TcpListener, figures: Arc<F>)
where
    F: Fn() -> Figures + Send + Sync + 'static,
{
    let places = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let place = places.clone().acquire_owned().await;
        match listener.accept().await {
            Ok((stream, _)) => {
                let figures = figures.clone();
                tokio::spawn(async move {
                    // A client that asks badly or slowly gets no answer.
                    let _ = tokio::time::timeout(PATIENCE, serve(stream, &*figures)).await;
                    drop(place);
                });
            }
            // There may be too many open files. Wait until some are closed.
            Err(error) => {
                tracing::warn!("metrics: {error}");
                tokio::time::sleep(PATIENCE).await;
            }
        }
    }
}

async fn serve(stream: TcpStream, figures: &(impl Fn() -> Figures + Sync)) -> hyper::Result<()> {
    let service = service_fn(async |request: Request<Incoming>| {
        Ok::<_, Infallible>(answer(&request, figures))
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).keep_alive(false);
    http.header_read_timeout(ASKING_TIME);
    http.serve_connection(TokioIo::new(stream), service).await
}

fn answer(request: &Request<Incoming>, figures: impl Fn() -> Figures) -> Response<Full<Bytes>> {
    let plain = "text/plain; charset=utf-8";
    let (status, kind, text) = match (request.method(), request.uri().path()) {
        (&Method::GET, "/metrics") => {
            let text = figures().text();
            (StatusCode::OK, prometheus_text::CONTENT_TYPE, text)
        }
        (&Method::GET, "/health") => match figures().wrong_at(certificate::now()) {
            None => (StatusCode::OK, plain, "ok\n".into()),
            Some(wrong) => (StatusCode::SERVICE_UNAVAILABLE, plain, wrong + "\n"),
        },
        (&Method::GET, _) => (StatusCode::NOT_FOUND, plain, "/metrics or /health\n".into()),
        _ => (StatusCode::METHOD_NOT_ALLOWED, plain, "GET only\n".into()),
    };
    let mut response = Response::new(Full::from(text));
    *response.status_mut() = status;
    let kind = hyper::header::HeaderValue::from_static(kind);
    response.headers_mut().insert(CONTENT_TYPE, kind);
    response
}

type Labels = Vec<(&'static str, String)>;
type Counts = Family<Labels, Counter>;
type Sums = Family<Labels, Counter<f64, AtomicU64>>;
type Values = Family<Labels, Gauge>;

impl Figures {
    /// What is wrong at a time, certificates that do not hold then included.
    fn wrong_at(&self, now: i64) -> Option<String> {
        let past = self.certificates.iter().filter(|found| !found.holds(now));
        let past = past.filter_map(|found| found.notice(now));
        let wrong: Vec<_> = self.wrong.iter().cloned().chain(past).collect();
        (!wrong.is_empty()).then(|| wrong.join("; "))
    }

    /// The metrics in the text format of Prometheus, version 0.0.4.
    pub fn text(&self) -> String {
        let (up, runs, refuses, twice, in_hand) = (
            Values::default(),
            Values::default(),
            Values::default(),
            Values::default(),
            Values::default(),
        );
        let (poses, refused) = (Counts::default(), Counts::default());
        let (seconds, judged, probability) = (Sums::default(), Sums::default(), Sums::default());
        for robot in &self.robots {
            let Robot { name, status, .. } = robot;
            let labels = |others: Labels| [vec![("robot", name.clone())], others].concat();
            let own = labels(vec![]);
            up.get_or_create(&own).set(robot.online.into());
            twice.get_or_create(&own).set(robot.duplicate.into());
            in_hand.get_or_create(&own).set(status.in_hand.into());
            if let Some(policy) = &status.policy {
                let (version, sha256) = (policy.release(), Hex(&policy.sha256));
                let version = ("version", version.to_string());
                let labels = labels(vec![version, ("sha256", sha256.to_string())]);
                runs.get_or_create(&labels).set(1);
            }
            if let Some(not) = &status.not_taken {
                let version = ("version", not.policy.release().to_string());
                let labels = labels(vec![version, ("reason", not.reason.to_string())]);
                refuses.get_or_create(&labels).set(1);
            }
            for (verdict, count) in Verdict::ALL.iter().zip(status.verdicts) {
                let labels = labels(vec![("verdict", verdict.to_string())]);
                poses.get_or_create(&labels).inc_by(count.into());
            }
            refused.get_or_create(&own).inc_by(status.refused);
            let tally = &status.tally;
            let sum = tally.micros as f64 / 1e6;
            seconds.get_or_create(&own).inc_by(sum);
            judged.get_or_create(&own).inc_by(tally.judged.into());
            let sum = tally.probability_millionths as f64 / 1e6;
            probability.get_or_create(&own).inc_by(sum);
        }
        let expiry = Values::default();
        for certificate in &self.certificates {
            let file = certificate.path.display().to_string();
            let labels = vec![("file", file)];
            expiry.get_or_create(&labels).set(certificate.until);
        }
        let healthy: Gauge = Gauge::default();
        healthy.set(self.wrong_at(certificate::now()).is_none().into());

        let mut all = Registry::with_prefix("reagent");
        all.register("healthy", "Whether all is well here", healthy);
        all.register("robot_up", "Whether the robot is there", up);
        all.register(
            "robot_duplicate",
            "Whether two robots have this name",
            twice,
        );
        all.register("robot_policy", "The policy in use, by its labels", runs);
        all.register(
            "robot_policy_not_taken",
            "The policy refused last, and why",
            refuses,
        );
        all.register(
            "robot_requests_in_hand",
            "Requests running or waiting",
            in_hand,
        );
        all.register("robot_poses", "Poses by verdict", poses);
        all.register("robot_requests_refused", "Requests refused", refused);
        let help = "Computing time of the poses of the policy in use";
        all.register("robot_policy_compute_seconds", help, seconds);
        let help = "Poses of the policy in use whose probability is known";
        all.register("robot_policy_judged", help, judged);
        let help = "Sum of these probabilities";
        all.register("robot_policy_probability", help, probability);
        let help = "When a certificate of the session expires, seconds since 1970";
        all.register("certificate_expiry_timestamp_seconds", help, expiry);
        let mut text = String::new();
        prometheus_text::encode(&mut text, &all).expect("strings take everything");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use reagent_core::wire::{NotTaken, PolicyId, WhyNot};
    use std::io::Write;
    use std::net::TcpStream;
    use std::time::Instant;

    fn figures() -> Figures {
        let policy = PolicyId {
            epoch: 0,
            version: 7,
            sha256: [0xab; 32],
        };
        let mut status = Status {
            policy: Some(policy),
            not_taken: Some(NotTaken {
                policy: PolicyId {
                    version: 8,
                    ..policy
                },
                reason: WhyNot::SelfTest,
            }),
            refused: 2,
            in_hand: 3,
            ..Status::default()
        };
        status.verdicts[Verdict::Converged as usize] = 5;
        status.tally.micros = 1_500_000;
        Figures {
            robots: vec![Robot {
                name: "arm1".into(),
                status,
                online: true,
                duplicate: false,
            }],
            certificates: Vec::new(),
            wrong: Some("no policy".into()),
        }
    }

    #[test]
    fn every_robot_has_its_lines() {
        let text = figures().text();
        for line in [
            "reagent_healthy 0",
            "reagent_robot_up{robot=\"arm1\"} 1",
            "reagent_robot_requests_in_hand{robot=\"arm1\"} 3",
            "reagent_robot_poses_total{robot=\"arm1\",verdict=\"converged\"} 5",
            "reagent_robot_requests_refused_total{robot=\"arm1\"} 2",
            "reagent_robot_policy_compute_seconds_total{robot=\"arm1\"} 1.5",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
        let policy = format!(
            "robot=\"arm1\",version=\"7\",sha256=\"{}\"",
            "ab".repeat(32)
        );
        assert!(text.contains(&policy), "{text}");
        assert!(text.contains("version=\"8\",reason="), "{text}");
    }

    #[test]
    fn a_certificate_that_has_run_out_is_no_health() {
        let mut figures = figures();
        figures.certificates = vec![Certificate::for_test("arm1.pem", 10, 20)];
        let wrong = |figures: &Figures, now| figures.wrong_at(now).unwrap_or_default();
        assert_eq!(wrong(&figures, 15), "no policy");
        let both = "no policy; certificate arm1.pem has expired on ";
        assert!(
            wrong(&figures, 21).starts_with(both),
            "{}",
            wrong(&figures, 21)
        );
        figures.wrong = None;
        assert_eq!(wrong(&figures, 15), "");
        assert!(wrong(&figures, 21).starts_with("certificate arm1.pem has expired on "));
        assert!(wrong(&figures, 9).starts_with("certificate arm1.pem holds from "));
    }

    async fn ask(address: SocketAddr, request: &str) -> String {
        let request = request.to_owned();
        let asking = tokio::task::spawn_blocking(move || {
            let mut stream = TcpStream::connect(address)?;
            stream.write_all(request.as_bytes())?;
            std::io::read_to_string(stream)
        });
        asking.await.expect("it does not panic").expect("answered")
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn pages_are_served_also_while_others_say_nothing() {
        let args = MetricsArgs {
            metrics: Some(([127, 0, 0, 1], 0).into()),
        };
        let serving = args.serve(figures).await.expect("a free port");
        let address = serving.as_ref().expect("as asked").address;
        let silent = || TcpStream::connect(address).expect("it listens");
        let mut silent: Vec<_> = (1..CONNECTIONS).map(|_| silent()).collect();
        let get = |path: &str| format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n");
        let metrics = ask(address, &get("/metrics")).await;
        assert!(metrics.starts_with("HTTP/1.1 200"), "{metrics}");
        assert!(metrics.contains("version=0.0.4") && metrics.contains("reagent_robot_up"));
        let health = ask(address, &get("/health")).await;
        assert!(
            health.starts_with("HTTP/1.1 503") && health.ends_with("no policy\n"),
            "{health}"
        );
        assert!(ask(address, &get("/")).await.starts_with("HTTP/1.1 404"));
        let posted = ask(address, "POST /metrics HTTP/1.1\r\nHost: x\r\n\r\n").await;
        assert!(posted.starts_with("HTTP/1.1 405"), "{posted}");
        // While silent clients fill every place, the next client waits until they are dropped.
        silent.push(TcpStream::connect(address).expect("it listens"));
        let began = Instant::now();
        let metrics = ask(address, &get("/metrics")).await;
        assert!(metrics.starts_with("HTTP/1.1 200"), "{metrics}");
        assert!(began.elapsed() < PATIENCE);

        let taken = MetricsArgs {
            metrics: Some(address),
        };
        let error = taken.serve(figures).await.expect_err("the port is taken");
        assert!(error.to_string().contains(&address.to_string()), "{error}");
    }
}
