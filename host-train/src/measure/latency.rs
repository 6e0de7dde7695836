//! How fast this machine registers: times of whole registrations by number format, cloud size and threads.

use crate::dataset::pairs::PairSet;
use crate::dataset::procedural;
use crate::policy::{ExportError, WeightFile};
use crate::protocol::{self, Protocol};
use crate::register::batch::{self, Job};
use reagent_core::budget::SCRATCH_BYTES;
use reagent_core::dims::STEPS;
use reagent_core::kernels::{Arithmetic, Isa, Tile};
use reagent_core::net::Scratch;
use reagent_core::{Frame, Policy, Pose, Registrar, Registration};
use serde::Serialize;
use std::time::Instant;

/// Pairs that the ranges of the 8-bit network are calibrated on.
pub(crate) const CALIBRATION: usize = 32;

/// Speed of one configuration.
#[derive(Clone, Debug, Serialize)]
pub struct Latency {
    /// `f32` or `int8`.
    pub format: &'static str,
    /// Points of each cloud.
    pub points: usize,
    /// Registrations in progress at a time, each on one thread.
    pub threads: usize,
    /// Median time of one registration of ten steps, target embedding included, milliseconds.
    pub ms_median: f64,
    /// Shortest time of one registration, milliseconds.
    pub ms_best: f64,
    /// Least processor time of one registration, milliseconds: comparable even if the machine has other work to do.
    pub cpu_ms_best: f64,
    /// Registrations a second by [`batch::register`], all threads together.
    pub per_second: f64,
    /// Share of the measured arithmetic peak that the fastest registration reached; `None` where no peak is known. In f32
    /// the peak is that of fused multiply-adds, although the last embedding layer runs on AMX tiles if there are any.
    pub share_of_peak: Option<f64>,
    /// Mean number of points embedded in a registration, the target's included, divided by the points of a cloud:
    /// 11 if each of ten steps looks at all points.
    pub clouds_embedded: f64,
}

/// What was measured, and on what.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The processor's name as the system gives it, if it does.
    pub processor: Option<String>,
    /// Instruction set.
    pub kernels: &'static str,
    /// Peak rate of one core on registers, billions of multiply-adds a second: f32, bytes.
    pub peak_gmac_per_s: [f64; 2],
    /// Size of the weights, bytes: f32, int8.
    pub weight_bytes: [usize; 2],
    /// Working memory of one registration beside its clouds, bytes.
    pub scratch_bytes: usize,
    /// State that a registration keeps from step to step, bytes.
    pub registration_bytes: usize,
    /// The last layer's second copy, packed for fast machines in f32, bytes.
    pub packed_bytes: usize,
    /// One row a configuration.
    pub rows: Vec<Latency>,
}

/// Measures a policy in f32 and in 8 bits on the given kernels, with `count` registrations of each configuration.
///
/// # Errors
/// [`ExportError`] for a file in 8-bit integers.
pub fn measure(
    isa: Isa,
    file: &WeightFile,
    threads: &[usize],
    points: &[usize],
    count: usize,
    seed: u64,
) -> Result<Report, ExportError> {
    let parameters = file.parameters(seed)?;
    let models = procedural::models(seed, CALIBRATION);
    let pairs = protocol::draw(&models, Protocol::M40Models, CALIBRATION, seed);
    let integers = WeightFile::from_parameters_int8(&parameters, &pairs)?;
    let integers = integers.run_like(&file.policy());
    let peaks = [Arithmetic::F32, Arithmetic::Bytes].map(|a| peak(isa, a));
    let mut rows = Vec::new();
    for &points in points {
        let pairs = resized(&pairs, points);
        for &threads in threads {
            let formats = [("f32", file, peaks[0]), ("int8", &integers, peaks[1])];
            for (format, file, peak) in formats {
                rows.push(run(
                    isa,
                    format,
                    file.policy(),
                    &pairs,
                    threads,
                    count,
                    peak,
                ));
            }
        }
    }
    Ok(Report {
        processor: processor(),
        kernels: isa.name(),
        peak_gmac_per_s: peaks.map(|p| p / 1e9),
        weight_bytes: [file.bytes().len(), integers.bytes().len()],
        scratch_bytes: SCRATCH_BYTES,
        registration_bytes: size_of::<Registration<'_>>(),
        packed_bytes: file.policy().packed_tiles().unwrap_or(0) * size_of::<Tile>(),
        rows,
    })
}

/// The processor's name, from Linux.
fn processor() -> Option<String> {
    let all = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = all.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// Peak rate of this core on registers, multiply-adds a second: the best of several short runs.
fn peak(isa: Isa, arithmetic: Arithmetic) -> f64 {
    const ROUNDS: u64 = 20_000;
    let runs = (0..20).map(|_| {
        let clock = Instant::now();
        isa.multiply_adds(arithmetic, ROUNDS) as f64 / clock.elapsed().as_secs_f64()
    });
    runs.fold(0.0, f64::max)
}

/// The same clouds with another number of points; points repeat where there are too few.
fn resized(pairs: &PairSet, points: usize) -> PairSet {
    let mut pairs = pairs.clone();
    for cloud in pairs.source.iter_mut().chain(&mut pairs.target) {
        *cloud = cloud.iter().copied().cycle().take(points).collect();
    }
    pairs
}

fn run(
    isa: Isa,
    format: &'static str,
    policy: Policy<'_>,
    pairs: &PairSet,
    threads: usize,
    count: usize,
    peak: f64,
) -> Latency {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let one = |scratch: &mut Scratch, i: usize| {
        let i = i % pairs.source.len();
        let clock = (Instant::now(), processor_seconds());
        let mut registrar = Registrar::with_isa(isa, policy, scratch);
        let (source, target) = (&pairs.source[i], &pairs.target[i]);
        let started = registrar.start(source, target, Frame::IDENTITY, Pose::IDENTITY);
        let mut registration = started.expect("drawn clouds are sound");
        let mut points = target.len();
        for _ in 0..STEPS {
            points += registration.points_ahead(&policy);
            registrar.step(&mut registration).expect("started above");
        }
        std::hint::black_box(registration.outcome());
        let processor = processor_seconds() - clock.1;
        (clock.0.elapsed().as_secs_f64(), processor, points)
    };
    let jobs: Vec<Job<'_>> = (0..count)
        .map(|i| i % pairs.source.len())
        .map(|i| Job {
            source: &pairs.source[i],
            target: &pairs.target[i],
            frame: Frame::IDENTITY,
            initial: Pose::IDENTITY,
        })
        .collect();
    let all = || {
        let times = batch::for_each(count, Scratch::new, one);
        let clock = Instant::now();
        std::hint::black_box(batch::register(isa, policy, &jobs, STEPS));
        (times, clock.elapsed().as_secs_f64())
    };
    let (measured, seconds) = match pool {
        Ok(pool) => pool.install(all),
        Err(_) => all(),
    };
    let points = pairs.source.first().map_or(0, Vec::len);
    let shape = policy.shape;
    // Each way computes the first layers' halves for both clouds.
    let way = shape.macs_half() + shape.macs_step();
    let ways: usize = (0..STEPS).map(|step| policy.decision.ways(step)).sum();
    let shares = measured.iter().map(|(seconds, _, points)| {
        let macs = points * shape.macs_per_point() + ways * way;
        macs as f64 / seconds / peak
    });
    let share = shares.fold(0.0, f64::max);
    let embedded: usize = measured.iter().map(|(.., points)| points).sum();
    let embedded = embedded as f64 / measured.len() as f64;
    let (mut times, processor): (Vec<f64>, Vec<f64>) =
        measured.into_iter().map(|(all, own, _)| (all, own)).unzip();
    times.sort_by(f64::total_cmp);
    Latency {
        format,
        points,
        threads,
        ms_median: 1e3 * times[times.len() / 2],
        ms_best: 1e3 * times[0],
        cpu_ms_best: 1e3 * processor.into_iter().fold(f64::INFINITY, f64::min),
        per_second: times.len() as f64 / seconds,
        share_of_peak: (peak > 0.0).then_some(share),
        clouds_embedded: embedded / points as f64,
    }
}

/// Processor seconds of this thread; zero on systems that are not asked.
fn processor_seconds() -> f64 {
    #[cfg(unix)]
    {
        use rustix::time::{ClockId, clock_gettime};
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }
    #[cfg(not(unix))]
    0.0
}
