//! Poses between which the policy's points do not decide, and no start: all points that the files hold do.

use crate::baselines::{IcpSettings, IcpTarget};
use crate::register::dense::InRadii;
use crate::register::dense::Planes;
use crate::register::prepared::Prepared;
use crate::register::thin::thin;
use crate::register::{Memory, Registered};
use reagent_core::evidence::Evidence;
use reagent_core::pipeline::{self, Answer, Mode, Refinement, Task};
use reagent_core::polish::Refiner;
use reagent_core::start::Start;
use reagent_core::verify::{Ranked, Undetermined};
use reagent_core::{Error, Frame, Pose};

/// How much less probable (a logarithm) than the pose returned a pose is at most that is looked at again, and how many are.
const NEARLY_AS_PROBABLE: f32 = 1.0;
const MOST: usize = 5;
/// Points of the source that decide.
const POINTS: usize = 5000;
/// Distance from which on a point lies off the surface, target radii.
const OFF: f64 = 0.05;
/// How much less loss a pose must have, as a mean over the points, to be returned instead. Chosen on rendered views of parts that
/// are nearly symmetric.
const BETTER: f64 = 0.005;
/// Steps of ICP to planes before poses are compared.
const STEPS: usize = 5;

/// If other poses fit nearly as well as the one found, returns the one under which all points of the source lie nearest to the
/// target's mesh. A start would settle what a sensor's own errors might not.
///
/// # Errors
/// Clouds that the core refuses.
pub(super) fn decided_by_all_points(
    memory: &mut Memory,
    [source, target]: [&Prepared<'_>; 2],
    task: &Task<'_>,
    found: Registered,
) -> Result<Registered, Error> {
    let Some(refinement) = found.answer.refinement else {
        return Ok(found);
    };
    if task.start != Start::Anywhere || !target.has_faces() {
        return Ok(found);
    }
    let mut ranked = refinement.ranked.into_iter().flatten();
    let Some(best) = ranked.next().filter(|_| refinement.hypotheses.is_some()) else {
        return Ok(found);
    };
    let rivals = ranked.take_while(|rival| rival.energy < best.energy + NEARLY_AS_PROBABLE);
    let rivals: Vec<Ranked> = rivals.take(MOST).collect();
    if rivals.is_empty() {
        return Ok(found);
    }
    let frame = InRadii(Frame::of(target.points())?);
    let points = frame.points(&thin(&source.all, POINTS));
    let loss = |pose: Pose| -> Result<f64, Error> {
        let eye = task.view_point.map(|eye| pose.apply(eye));
        let Planes {
            points: on,
            normals,
        } = target.all_seen_from(eye)?;
        let on = frame.points(&on);
        let surface = IcpTarget::with_normals(&on, &normals)?;
        let settings = IcpSettings {
            max_correspondence: OFF,
            max_iterations: STEPS,
            ..IcpSettings::PLANE
        };
        let near = surface.register(&points, frame.inward(pose), &settings)?;
        Ok(surface.loss(&points, near.target_from_source, OFF))
    };
    let mut least = loss(found.answer.target_from_source)? - BETTER;
    let mut winner = None;
    for rival in rivals {
        let loss = loss(rival.target_from_source)?;
        if loss < least {
            (least, winner) = (loss, Some(rival));
        }
    }
    let Some(winner) = winner else {
        return Ok(found);
    };
    let clouds = [source.points(), target.points()];
    let answer = given_out(memory, clouds, task, &refinement, winner)?;
    Ok(match answer {
        Some(refinement) => Registered {
            answer: Answer::refined(refinement, found.answer.policy)?,
            trace: found.trace,
        },
        None => found,
    })
}

/// What is said of another of the poses that were compared, once it is to be returned.
fn given_out(
    memory: &mut Memory,
    clouds: [&[[f32; 3]]; 2],
    task: &Task<'_>,
    before: &Refinement,
    winner: Ranked,
) -> Result<Option<Refinement>, Error> {
    let alone = Task {
        mode: Mode::Polish,
        ..*task
    };
    let go_on = || Ok::<(), Error>(());
    let workspace = &mut memory.workspace;
    let pose = winner.target_from_source;
    let Some(refined) = pipeline::refine(workspace, clouds, pose, &alone, go_on)? else {
        return Ok(None);
    };
    let refiner = Refiner::new(clouds[0], clouds[1], workspace)?;
    let given_before = before.refined.target_from_source;
    let others = before.undetermined.poses.map(|other| match other {
        Some(other) if refiner.is_same(other, pose) => Some(given_before),
        other => other,
    });
    let mut ranked = before.ranked;
    if let Some(place) = ranked.iter().position(|ranked| *ranked == Some(winner)) {
        ranked.swap(0, place);
    }
    Ok(Some(Refinement {
        polished: before.polished,
        hypotheses: before.hypotheses,
        undetermined: Undetermined {
            slide: before.undetermined.slide,
            fold: before.undetermined.fold,
            poses: others,
            ..refined.undetermined
        },
        evidence: Evidence {
            verified: true,
            support: before.evidence.support,
            lead: before.evidence.lead,
            mirror_score: before.evidence.mirror_score,
            ..refined.evidence
        },
        ranked,
        ..refined
    }))
}

#[cfg(test)]
mod tests {
    use crate::dataset::Point;
    use crate::dataset::cloud_file::CloudFile;
    use crate::dataset::mesh::Mesh;
    use crate::dataset::winding::tests::block;
    use crate::policy::WeightFile;
    use crate::random::{Purpose, stream};
    use crate::register::Memory;
    use crate::register::Start;
    use crate::register::dense::Dense;
    use crate::register::prepared::Prepared;
    use crate::register::request::Request;
    use glam::Vec3;
    use std::path::Path;

    /// A block with a low boss beside its middle: of a thousand points hardly any tells which way around it lies.
    fn bossed() -> Mesh {
        let mut mesh = block(Vec3::ZERO, Vec3::new(2.0, 1.2, 0.4));
        let boss = block(Vec3::new(0.7, 0.3, 0.2), Vec3::new(0.16, 0.16, 0.06));
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(boss.vertices);
        let faces = boss.faces.iter().map(|face| face.map(|v| v + first));
        mesh.faces.extend(faces);
        mesh
    }

    #[test]
    fn what_few_points_leave_open_all_points_decide() {
        let mesh = bossed();
        let name = Path::new("cloud");
        let vertices: Vec<Point> = mesh.vertices.iter().map(|v| v.to_array()).collect();
        let file = CloudFile {
            faces: Some(mesh.faces.clone()),
            ..CloudFile::of(&vertices)
        };
        let target = Prepared::of_file(&file, name, None, 1).expect("a mesh");
        let policy = WeightFile::pretrained();
        let memory = &mut Box::new(Memory::new());
        let mut right = |dense| {
            let mut right = 0;
            for seed in 0..8 {
                let seen = mesh.sample(8000, &mut stream(seed, Purpose::Surface, 0));
                // Only the upper side, from above.
                let seen: Vec<Point> = seen.into_iter().filter(|p| p[2] > 0.19).collect();
                let turned: Vec<Point> = seen.iter().map(|&[x, y, z]| [-x, -y, z]).collect();
                let source = Prepared::of_points(&turned, name, None).expect("a cloud");
                let request = Request {
                    start: Start::None,
                    view_point: Some([0.0, 0.0, 5.0]),
                    dense,
                    ..Request::default()
                };
                let done = request.register(policy.policy(), memory, &source, &target);
                let pose = done.expect("two clouds").near();
                let is_right = pose.rotation.x_axis.x < -0.9 && pose.rotation.z_axis.z > 0.9;
                right += usize::from(is_right);
            }
            right
        };
        let [few, all] = [Dense::Never, Dense::Auto].map(&mut right);
        assert!(all == 8 && few < 8, "{few} {all}");
    }
}
