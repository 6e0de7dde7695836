use super::matching::{Match, Matching};
use super::*;
use crate::cells::bounds;
use crate::kernels::{Bits, RUN, RUNS, has};
use crate::polish::tests::{Numbers, part, pose};

fn surface(points: &[[f32; 3]]) -> Box<Surface> {
    let mut surface = Box::new(Surface::EMPTY);
    let mut keys = Keys::ZERO;
    surface.fill(Isa::best(), points, Bulk::ALL, Vec3::ZERO, 1.0, &mut keys);
    surface
}

#[test]
fn each_point_has_one_place_whatever_the_order_they_come_in() {
    let points = part(700, 1);
    let mut shuffled: Vec<_> = points.iter().chain(&points[..90]).copied().collect();
    let mut numbers = Numbers(2);
    for i in (1..shuffled.len()).rev() {
        let j = (0.5 * (numbers.next() + 1.0) * i as f32) as usize;
        shuffled.swap(i, j.min(i));
    }
    let (one, other) = (surface(&points), surface(&shuffled));
    assert_eq!(one.points().len(), 700);
    assert_eq!(one.points(), other.points());
    let size = |run: &[[f32; 3]]| {
        let [low, high] = bounds(run, |&p| Vec3::from_array(p));
        (high - low).max_element()
    };
    let runs = one.points().chunks(RUN).map(size);
    assert!(
        runs.sum::<f32>() / 88.0 < 0.35,
        "points of a run lie together"
    );
}

#[test]
fn neighbourhoods_are_wider_where_they_are_all_noise_and_not_where_they_are_bent() {
    let is_wide = |points: &[[f32; 3]]| {
        let (surface, mut keys) = (surface(points), Keys::ZERO);
        surface.radius > surface.neighbourhood(&mut keys)
    };
    let mut numbers = Numbers(6);
    let part = part(1024, 5);
    // Uniform noise of this half-width; its standard deviation is .58 of that.
    for (noise, wide) in [(0.0, false), (0.02, false), (0.1, true)] {
        let mut noisy = part.clone();
        for x in noisy.as_flattened_mut() {
            *x += noise * numbers.next();
        }
        assert_eq!(is_wide(&noisy), wide, "{noise}");
    }
    let mut on_tube = || {
        let [x, y, z] = numbers.point();
        let share = 0.08 / x.hypot(y);
        [share * x, share * y, z]
    };
    let tube: Vec<_> = (0..200).map(|_| on_tube()).collect();
    assert!(!is_wide(&tube));
}

/// Some runs and blocks as a whole, of the others every third point.
const HIDDEN: Bits = {
    let mut hidden = [0b0100_1001; RUNS];
    let mut run = 0;
    while run < RUNS {
        if run % 3 == 0 || run / 4 % 4 == 1 {
            hidden[run] = u8::MAX;
        }
        run += 1;
    }
    hidden
};

#[test]
fn every_kernel_gives_the_same_bits() {
    let clouds = [(part(300, 3), part(500, 4)), (part(9, 3), part(40, 4))];
    let poses = [
        pose([0.3, 0.2, -0.4], [0.5, 0.1, 0.3]),
        pose([0.1, 0.0, -0.1], [0.1, 0.0, 0.0]),
    ];
    for (source, target) in &clouds {
        let found = |isa: Isa| {
            let (mut surfaces, mut keys) = ([(); 2].map(|()| Box::new(Surface::EMPTY)), Keys::ZERO);
            for (surface, points) in surfaces.iter_mut().zip([source, target]) {
                surface.fill(isa, points, Bulk::ALL, Vec3::ZERO, 1.0, &mut keys);
            }
            let mut bits: Vec<u32> = Vec::new();
            for surface in &surfaces {
                let normals = surface.normals.as_flattened();
                bits.extend(normals.iter().map(|x| x.to_bits()));
            }
            let surfaces = surfaces.each_ref().map(|surface| &**surface);
            let mut matching = Matching::EMPTY;
            for pose in poses {
                for (every, limit, hidden) in [
                    (2, 0.04, None),
                    (1, f32::INFINITY, None),
                    (3, 0.01, Some(&HIDDEN)),
                    (1, 1e-4, None),
                    (1, f32::INFINITY, Some(&HIDDEN)),
                ] {
                    let median = matching.largest_median(isa, surfaces, pose, every);
                    matching.find(isa, surfaces, hidden, pose, every, limit);
                    bits.push(median.to_bits());
                    let places = matching.matches().map(|found| found.to);
                    bits.extend(places.map(|to| to.map_or(u32::MAX, |to| to as u32)));
                    bits.push(matching.median_squared().to_bits());
                }
            }
            bits
        };
        let expected = found(Isa::PORTABLE);
        for isa in Isa::all() {
            assert_eq!(found(isa), expected, "{}", isa.name());
        }
    }
}

#[test]
fn matches_are_the_nearest_within_the_limit_and_none_beyond() {
    let (source, target) = (surface(&part(300, 3)), surface(&part(500, 4)));
    let mut matching = Matching::EMPTY;
    let far = pose([0.3, 0.2, -0.4], [0.5, 0.1, 0.3]);
    let near = pose([0.1, 0.0, -0.1], [0.1, 0.0, 0.0]);
    for (pose, every, limit, hidden) in [
        (far, 1, f32::INFINITY, None),
        (near, 3, 0.01, None),
        (near, 1, 0.04, None),
        (near, 1, f32::INFINITY, Some(&HIDDEN)),
        (near, 2, 0.04, Some(&HIDDEN)),
        (far, 1, f32::INFINITY, Some(&HIDDEN)),
        (far, 2, f32::INFINITY, None),
        (far, 1, 1e-4, None),
    ] {
        let surfaces = [&*source, &*target];
        let bound = matching.largest_median(Isa::best(), surfaces, pose, every);
        matching.find(Isa::best(), surfaces, hidden, pose, every, limit);
        let mut found: Vec<f32> = Vec::new();
        for Match { of, to } in matching.matches() {
            let p = pose.apply(source.at(of).0);
            let squared = |&q: &[f32; 3]| (p - Vec3::from_array(q)).length_squared();
            let points = target.points().iter().enumerate();
            let shown = points.filter(|&(place, _)| !hidden.is_some_and(|bits| has(bits, place)));
            let nearest = shown.map(|(_, q)| squared(q)).fold(f32::INFINITY, f32::min);
            match to {
                Some(to) => assert_eq!(squared(&target.points()[to]), nearest),
                None => assert!(nearest >= limit, "{nearest} {limit}"),
            }
            found.push(nearest.min(limit));
        }
        assert_eq!(found.len(), 300usize.div_ceil(every));
        let median = matching.median_squared();
        assert!(median <= bound || hidden.is_some(), "{median} {bound}");
        found.sort_unstable_by(f32::total_cmp);
        assert_eq!(median, found[found.len() / 2]);
    }
}

/// A sheet of 2 by 1: inside it neighbours lie on all sides, at an edge on one side only.
#[test]
fn a_surface_knows_where_it_ends() {
    let mut numbers = Numbers(7);
    let mut on_sheet = || [numbers.next(), 0.5 * numbers.next(), 0.0];
    let points: Vec<_> = (0..1024).map(|_| on_sheet()).collect();
    let mut sheet = surface(&points);
    let inward_of_edge = |sheet: &Surface, side: f32| {
        let places = (0..1024).filter(|&k| {
            let (p, _) = sheet.at(k);
            side * p.x > 0.97 && p.y.abs() < 0.3
        });
        let inward: Vec<Vec3> = places.map(|k| sheet.inward(k)).collect();
        inward.iter().sum::<Vec3>() / inward.len() as f32
    };
    for side in [1.0, -1.0] {
        let inward = inward_of_edge(&sheet, side);
        assert!(-side * inward.x > 0.15 && inward.y.abs() < 0.12, "{inward}");
    }
    let within = (0..1024).filter(|&k| sheet.at(k).0.abs().cmplt(Vec3::new(0.7, 0.3, 1.0)).all());
    let within: Vec<f32> = within.map(|k| sheet.inward(k).length()).collect();
    assert!(within.iter().sum::<f32>() / (within.len() as f32) < 0.15);
    let before: Vec<Vec3> = (0..1024).map(|k| sheet.inward(k)).collect();
    sheet.mirror();
    assert!((0..1024).all(|k| sheet.inward(k) == before[k] * Vec3::new(-1.0, 1.0, 1.0)));
}
