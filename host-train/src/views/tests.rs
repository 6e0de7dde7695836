use super::*;

fn views() -> Views {
    Views::procedural(5, 0..12)
}

fn seen(views: &Views, index: usize, stream_of: u64) -> Sample {
    let rng = &mut stream(9, Purpose::Augment, stream_of);
    let sample = views.sample(index, rng, 512, true);
    sample.expect("something is seen")
}

#[test]
fn a_view_depends_on_its_mesh_and_stream_only() {
    let views = views();
    assert_eq!(seen(&views, 3, 1), seen(&views, 3, 1));
    assert_ne!(seen(&views, 3, 1), seen(&views, 3, 2));
    assert_ne!(seen(&views, 3, 1), seen(&views, 4, 1));
}

/// After registration most points of a source lie on one side of the whole model; the others belong to other things.
#[test]
fn sources_are_of_the_target_where_they_belong() {
    let views = views();
    let (mut near, mut moved, mut count) = (0, 0, 0);
    for index in 0..12 {
        let Sample {
            source,
            target,
            target_from_source,
        } = seen(&views, index, index as u64);
        assert_eq!([source.len(), target.len()], [512; 2]);
        let distance = |p: Vec3| {
            let squared = target
                .iter()
                .map(|q| p.distance_squared(Vec3::from_array(*q)));
            squared.fold(f32::MAX, f32::min).sqrt()
        };
        for &p in &source {
            let p = Vec3::from_array(p);
            near += usize::from(distance(target_from_source.apply(p)) < 0.12);
            moved += usize::from(distance(p) < 0.12);
            count += 1;
        }
        let farthest = target.iter().map(|p| Vec3::from_array(*p).length());
        assert!((farthest.fold(0.0, f32::max) - 1.0).abs() < 1e-5);
    }
    assert!(near * 10 > count * 8, "{near} of {count}");
    assert!(moved < near, "{moved} before, {near} after");
}

#[test]
fn masks_reach_over_the_object_and_hold_stray_points() {
    let views = views();
    let far = |sample: Sample| {
        let lengths = sample.source.iter().map(|p| Vec3::from_array(*p).length());
        lengths.filter(|&length| length > 1.9).count()
    };
    let total: usize = (0..40)
        .map(|i| far(seen(&views, i % 12, 100 + i as u64)))
        .sum();
    assert!(
        total > 40 && total < 40 * 512 / 5,
        "{total} of {}",
        40 * 512
    );
}

#[test]
fn a_mesh_without_a_surface_is_refused() {
    let rng = &mut stream(1, Purpose::Surface, 0);
    assert!(Object::new(Mesh::default(), 0, rng).is_none());
    let flat = Mesh {
        vertices: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0],
        faces: vec![[0, 1, 2]],
    };
    assert!(Object::new(flat, 0, rng).is_none());
}

/// A file for trainers elsewhere holds the views that training draws.
#[test]
fn views_are_written_as_they_are_drawn() {
    let views = views();
    let bytes = views.npy(5, 64, true, 9).expect("something is seen");
    let numbers = 5 * (2 * 64 + 4) * 3;
    let (header, array) = bytes.split_at(bytes.len() - 4 * numbers);
    let header = String::from_utf8_lossy(header);
    assert!(header.contains("'<f4'") && header.contains("(5, 132, 3)"));
    let values: Vec<f32> = array
        .as_chunks::<4>()
        .0
        .iter()
        .map(|&x| f32::from_le_bytes(x))
        .collect();
    for (k, view) in values.chunks_exact(132 * 3).enumerate() {
        let (points, _) = view.as_chunks::<3>();
        let drawn = (0..12).find(|&index| {
            let rng = &mut stream(9, Purpose::Augment, k as u64);
            let sample = views.sample(index, rng, 64, true);
            sample.expect("something is seen").source == points[..64]
        });
        let rng = &mut stream(9, Purpose::Augment, k as u64);
        let sample = views.sample(drawn.expect("a mesh of the set"), rng, 64, true);
        let Sample {
            target,
            target_from_source,
            ..
        } = sample.expect("something is seen");
        assert_eq!(points[64..128], target);
        let [x, y, z, translation] = [128, 129, 130, 131].map(|i| Vec3::from_array(points[i]));
        assert_eq!(Mat3::from_cols(x, y, z), target_from_source.rotation);
        assert_eq!(translation, target_from_source.translation);
    }
}

/// Against a sparse target, a pose that fits as well as the true one would seem to err by the spacing of its points.
#[test]
fn what_poses_are_measured_by_is_the_whole_surface() {
    let views = views();
    let mut set = PairSet::default();
    views.draw(3, 64, 5, &mut set);
    let raw = set.raw.expect("of each pair");
    for ((surface, target), object) in raw.iter().zip(&set.target).zip(views.objects()) {
        assert_eq!(surface.len(), object.surface().len());
        let is_of_it = |p: &Point| {
            let p = Vec3::from_array(*p);
            surface.iter().any(|&q| p.distance(q.into()) < 1e-5)
        };
        assert!(target.iter().all(is_of_it));
    }
}
