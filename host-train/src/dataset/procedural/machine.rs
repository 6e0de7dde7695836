//! Machine parts.

use super::sketch::Sketch;
use crate::dataset::solids::{along_x, along_z, at, circle, rectangle};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The local x-z plane of an extrusion stood upright: its z becomes y.
fn upright(x: f32, y: f32, z: f32) -> Affine3A {
    at(x, y, z) * Affine3A::from_rotation_x(-FRAC_PI_2)
}

pub(super) fn bracket(s: &mut Sketch) {
    let (a, b, wide, thick) = (
        s.uniform(0.5, 1.2),
        s.uniform(0.4, 1.0),
        s.uniform(0.25, 0.8),
        s.uniform(0.04, 0.12),
    );
    let plate = |s: &mut Sketch, place: Affine3A, long: f32| {
        let outline = rectangle(wide, long);
        let mut holes = Vec::new();
        let count = s.whole(0, 3);
        for i in 0..count {
            let along = long * ((i as f32 + 0.7) / (count as f32 + 0.4) - 0.5);
            holes.push(circle(
                Vec2::new(s.uniform(-0.15, 0.15) * wide, along),
                wide * s.uniform(0.06, 0.14),
                14,
            ));
        }
        s.mesh.add_extruded(place, &outline, &holes, thick);
    };
    plate(s, at(0.0, 0.0, a / 2.0), a);
    // The second plate stands at one end (an L) or somewhere between (a T).
    let foot = if s.chance(0.6) {
        0.0
    } else {
        s.uniform(0.2, 0.5) * a
    };
    plate(s, upright(0.0, b / 2.0, foot), b);
    let ribs = s.whole(0, 2);
    for _ in 0..ribs {
        let (x, reach) = (s.uniform(-0.45, 0.45) * wide, s.uniform(0.3, 0.8));
        let rib = [
            Vec2::ZERO,
            Vec2::new((a - foot) * reach, 0.0),
            Vec2::new(0.0, b * reach),
        ];
        // Profile axes (z of the part, y of the part): stand it up, then turn x to z about y.
        let place = at(x, 0.0, foot)
            * Affine3A::from_rotation_y(-FRAC_PI_2)
            * Affine3A::from_rotation_x(-FRAC_PI_2);
        s.mesh.add_extruded(place, &rib, &[], thick * 0.7);
    }
    if s.chance(0.5) {
        let (x, z) = (s.uniform(-0.3, 0.3) * wide, s.uniform(0.5, 0.9) * a);
        let tall = s.uniform(0.1, 0.35);
        s.mesh
            .add_tube(at(x, tall / 2.0, z), wide * 0.18, wide * 0.1, tall);
    }
}

pub(super) fn flange(s: &mut Sketch) {
    let (bolts, bore, thick) = (s.whole(3, 8), s.uniform(0.15, 0.35), s.uniform(0.06, 0.2));
    let mut holes: Vec<Vec<Vec2>> = circle(Vec2::ZERO, 0.55, bolts)
        .into_iter()
        .map(|c| circle(c, 0.06, 10))
        .collect();
    if s.chance(0.5) {
        holes.pop();
    }
    holes.push(circle(Vec2::ZERO, bore, 24));
    let outline = match s.whole(0, 2) {
        0 => circle(Vec2::ZERO, 0.7, 32),
        1 => rectangle(s.uniform(1.3, 1.5), s.uniform(1.3, 1.5)),
        _ => circle(Vec2::ZERO, 0.78, s.whole(5, 8)),
    };
    s.mesh
        .add_extruded(at(0.0, 0.0, 0.0), &outline, &holes, thick);
    let neck = s.uniform(0.2, 0.9);
    let wall = s.uniform(0.04, 0.1);
    s.mesh
        .add_tube(at(0.0, neck / 2.0, 0.0), bore + wall, bore, neck);
    if s.chance(0.75) {
        // A branch or a foot on one side breaks the rotational symmetry.
        let (y, long, angle) = (
            s.uniform(0.4, 0.9) * neck,
            s.uniform(0.4, 0.8),
            s.uniform(0.0, TAU),
        );
        let place = Affine3A::from_rotation_y(angle) * along_x(long / 2.0 + bore, y, 0.0);
        s.mesh.add_tube(place, 0.12, 0.08, long);
    } else {
        s.block([0.3, -thick, -0.2], [0.9, thick, 0.2]);
    }
}

pub(super) fn gear(s: &mut Sketch) {
    let (teeth, depth, thick) = (s.whole(8, 18), s.uniform(0.08, 0.2), s.uniform(0.1, 0.4));
    let outline: Vec<Vec2> = (0..4 * teeth)
        .map(|i| {
            let angle = TAU * (i as f32 + if i % 2 == 0 { 0.25 } else { 0.0 }) / (4 * teeth) as f32;
            let radius = if i % 4 < 2 { 1.0 } else { 1.0 - depth };
            radius * Vec2::from_angle(angle)
        })
        .collect();
    let bore = s.uniform(0.1, 0.25);
    let mut holes = vec![circle(Vec2::ZERO, bore, 20)];
    let windows = s.whole(0, 4);
    let missing = s.whole(0, windows.max(1));
    let (radius, place) = (s.uniform(0.08, 0.14), s.uniform(0.48, 0.55));
    for (i, centre) in circle(Vec2::ZERO, place, windows).into_iter().enumerate() {
        if i != missing {
            holes.push(circle(centre, radius, 12));
        }
    }
    s.mesh
        .add_extruded(at(0.0, 0.0, 0.0), &outline, &holes, thick);
    let hub = s.uniform(0.1, 0.6);
    let wall = s.uniform(0.05, 0.15);
    s.mesh
        .add_tube(at(0.0, (thick + hub) / 2.0, 0.0), bore + wall, bore, hub);
    if s.chance(0.7) {
        let (angle, reach, long) = (
            s.uniform(0.0, TAU),
            s.uniform(0.4, 0.8),
            s.uniform(0.2, 0.7),
        );
        let pin = reach * Vec2::from_angle(angle);
        s.mesh
            .add_cylinder(at(pin.x, (thick + long) / 2.0, pin.y), 0.09, long);
    }
}

pub(super) fn pipe_elbow(s: &mut Sketch) {
    let (ring, tube, turn) = (
        s.uniform(0.4, 0.8),
        s.uniform(0.1, 0.25),
        s.uniform(0.25, 0.75) * PI,
    );
    s.mesh.add_torus(at(0.0, 0.0, 0.0), ring, tube, turn);
    // Straight ends: one at (ring, 0) leaving along -z, one at the other end of the arc.
    let (first, second) = (s.uniform(0.1, 0.6), s.uniform(0.1, 0.9));
    s.mesh
        .add_tube(along_z(ring, 0.0, -first / 2.0), tube, tube * 0.85, first);
    let end = Affine3A::from_rotation_y(-turn);
    s.mesh.add_tube(
        end * along_z(ring, 0.0, second / 2.0),
        tube,
        tube * 0.85,
        second,
    );
    let (lip, thick) = (tube * s.uniform(1.3, 1.8), s.uniform(0.03, 0.08));
    s.mesh
        .add_tube(along_z(ring, 0.0, -first), lip, tube * 0.85, thick);
    if s.chance(0.6) {
        s.mesh
            .add_tube(end * along_z(ring, 0.0, second), lip, tube * 0.85, thick);
    }
    if s.chance(0.5) {
        let (middle, long) = (
            Affine3A::from_rotation_y(-turn * s.uniform(0.2, 0.8)),
            s.uniform(0.2, 0.6),
        );
        s.mesh.add_tube(
            middle * at(ring, long / 2.0, 0.0),
            tube * 0.6,
            tube * 0.5,
            long,
        );
    }
}

pub(super) fn stepped_shaft(s: &mut Sketch) {
    let steps = s.whole(3, 6);
    let mut profile = vec![Vec2::ZERO];
    let mut x = 0.0;
    let mut widest = (0.0f32, 0.0);
    for _ in 0..steps {
        let (radius, long) = (s.uniform(0.06, 0.3), s.uniform(0.1, 0.5));
        profile.extend([Vec2::new(radius, x), Vec2::new(radius, x + long)]);
        if radius > widest.0 {
            widest = (radius, x + long / 2.0);
        }
        x += long;
    }
    profile.push(Vec2::new(0.0, x));
    s.mesh.add_revolved(along_x(0.0, 0.0, 0.0), &profile, TAU);
    // A key, a crank arm with its pin, or both, because bare shafts are symmetric.
    let (radius, at_x) = widest;
    let crank = s.chance(0.7);
    if crank {
        let (reach, thick, pin) = (
            s.uniform(0.25, 0.6),
            s.uniform(0.06, 0.12),
            s.uniform(0.1, 0.4),
        );
        let wide = s.uniform(0.08, 0.16);
        s.block([0.0, 0.0, -wide / 2.0], [thick, reach, wide / 2.0]);
        s.mesh.add_cylinder(
            along_x(-pin / 2.0, reach - wide / 2.0, 0.0),
            wide * 0.4,
            pin,
        );
    }
    if !crank || s.chance(0.5) {
        let (key, long) = (s.uniform(0.04, 0.1), s.uniform(0.1, 0.3));
        s.block(
            [at_x - long, radius * 0.8, -key],
            [at_x + long, radius + key, key],
        );
    }
}

pub(super) fn extrusion(s: &mut Sketch) {
    let (w, h, long, wall) = (
        s.uniform(0.3, 0.8),
        s.uniform(0.3, 0.8),
        s.uniform(0.6, 1.6),
        s.uniform(0.04, 0.1),
    );
    let (x, y) = (w / 2.0, h / 2.0);
    let place = at(0.0, 0.0, 0.0);
    match s.whole(0, 3) {
        0 => s.mesh.add_extruded(
            place,
            &rectangle(w, h),
            &[rectangle(w - 2.0 * wall, h - 2.0 * wall)],
            long,
        ),
        1 => {
            let (short, tall) = (s.uniform(0.3, 1.0) * x, y);
            let u = [
                (-x, -y),
                (short, -y),
                (short, wall - y),
                (wall - x, wall - y),
                (wall - x, tall - wall),
                (x, tall - wall),
                (x, tall),
                (-x, tall),
            ];
            s.mesh.add_extruded(place, &u.map(Vec2::from), &[], long);
        }
        2 => {
            let (web, top) = (s.uniform(-0.3, 0.3) * w, s.uniform(0.4, 1.0) * x);
            let (l, r) = (web - wall / 2.0, web + wall / 2.0);
            let i = [
                (-x, -y),
                (x, -y),
                (x, wall - y),
                (r, wall - y),
                (r, y - wall),
                (top, y - wall),
                (top, y),
                (-top, y),
                (-top, y - wall),
                (l, y - wall),
                (l, wall - y),
                (-x, wall - y),
            ];
            // The narrower flange must still hold the web.
            let fits = r < top && l > -top;
            let outline = if fits {
                i.map(Vec2::from).to_vec()
            } else {
                rectangle(w, wall * 2.0)
            };
            s.mesh.add_extruded(place, &outline, &[], long);
        }
        _ => {
            let cell = |c: f32| {
                rectangle(w / 2.0 - 1.5 * wall, h - 2.0 * wall)
                    .into_iter()
                    .map(move |p| p + Vec2::new(c * (w / 4.0 - wall / 4.0), 0.0))
                    .collect()
            };
            s.mesh
                .add_extruded(place, &rectangle(w, h), &[cell(-1.0), cell(1.0)], long);
        }
    }
    // Things bolted on.
    let mounts = s.whole(1, 3);
    for _ in 0..mounts {
        let (lift, out) = (s.uniform(-0.45, 0.45) * long, s.uniform(0.05, 0.25));
        let side = s.sign();
        let (tall, deep) = (s.uniform(0.05, 0.2), s.uniform(0.2, 0.5) * h);
        let (from, to) = if side > 0.0 {
            (x, x + out)
        } else {
            (-x - out, -x)
        };
        let front = if s.chance(0.5) { deep } else { 0.2 * deep };
        s.block([from, lift - tall, -deep], [to, lift + tall, front]);
    }
}

pub(super) fn robot_link(s: &mut Sketch) {
    let (long, big, small) = (
        s.uniform(0.7, 1.6),
        s.uniform(0.15, 0.3),
        s.uniform(0.1, 0.2),
    );
    let (deep, shallow) = (s.uniform(0.2, 0.5), s.uniform(0.15, 0.4));
    s.mesh.add_cylinder(along_z(0.0, 0.0, 0.0), big, deep);
    let offset = s.uniform(-0.3, 0.3);
    let far = if s.chance(0.5) {
        along_z(long, offset, 0.0)
    } else {
        along_x(long, offset, 0.0)
    };
    s.mesh.add_cylinder(far, small, shallow);
    let beam = s.uniform(0.6, 0.95);
    let (ends, z) = (
        [
            Vec2::new(0.0, -big * beam),
            Vec2::new(long, offset - small * beam),
            Vec2::new(long, offset + small * beam),
            Vec2::new(0.0, big * beam),
        ],
        s.uniform(-0.1, 0.1),
    );
    let slot = s.chance(0.4).then(|| {
        let mid = (ends[0] + ends[1] + ends[2] + ends[3]) / 4.0;
        ends.map(|p| mid + 0.45 * (p - mid)).to_vec()
    });
    let holes: Vec<_> = slot.into_iter().collect();
    s.mesh
        .add_extruded(upright(0.0, 0.0, z), &ends, &holes, deep.min(shallow) * 0.6);
    let (motor, side) = (s.uniform(0.1, 0.4), s.sign());
    s.mesh.add_cylinder(
        along_z(0.0, 0.0, side * (deep + motor) / 2.0),
        big * 0.7,
        motor,
    );
    if s.chance(0.6) {
        let (x, tall) = (s.uniform(0.2, 0.7) * long, s.uniform(0.1, 0.3));
        s.block([x, 0.0, z - 0.08], [x + 0.2, big + tall, z + 0.08]);
    }
}

pub(super) fn wrench(s: &mut Sketch) {
    let (long, wide, thick) = (
        s.uniform(0.8, 1.6),
        s.uniform(0.08, 0.18),
        s.uniform(0.05, 0.12),
    );
    s.block(
        [0.0, -wide / 2.0, -thick / 2.0],
        [long, wide / 2.0, thick / 2.0],
    );
    // An open jaw: a disc's outline with a slot cut from one side, tilted.
    let (jaw, gap) = (wide * s.uniform(1.2, 1.9), wide * s.uniform(0.5, 0.8));
    let (depth, tilt) = (jaw * s.uniform(0.0, 0.4), s.uniform(-0.5, 0.5));
    let open = (gap / jaw).clamp(0.2, 0.8);
    let arc: Vec<Vec2> = (0..=20)
        .map(|i| jaw * Vec2::from_angle(open + (TAU - 2.0 * open) * i as f32 / 20.0))
        .collect();
    let outline: Vec<Vec2> = arc
        .into_iter()
        .chain([Vec2::new(-depth, -gap * 0.9), Vec2::new(-depth, gap * 0.9)])
        .collect();
    let place = upright(0.0, 0.0, 0.0) * Affine3A::from_rotation_y(PI + tilt);
    s.mesh.add_extruded(place, &outline, &[], thick * 1.4);
    match s.whole(0, 2) {
        0 => {
            let (outer, inner) = (wide * s.uniform(0.9, 1.3), wide * s.uniform(0.4, 0.7));
            s.mesh.add_extruded(
                upright(long, 0.0, 0.0),
                &circle(Vec2::ZERO, outer, 24),
                &[circle(Vec2::ZERO, inner, 6)],
                thick * 1.3,
            );
        }
        1 => {
            // A hammer's or a drill's head.
            let (head, tall) = (s.uniform(0.08, 0.16), s.uniform(0.3, 0.7));
            let up = s.uniform(-0.1, 0.2);
            let taper = s.uniform(0.4, 1.2);
            s.mesh.add_cone(at(long, up, 0.0), head, head * taper, tall);
        }
        _ => {
            let grip = s.uniform(0.3, 0.5) * long;
            let scale = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.7));
            let radius = wide * s.uniform(0.6, 0.9);
            s.mesh
                .add_cylinder(scale * along_x(long - grip / 2.0, 0.0, 0.0), radius, grip);
            s.mesh.add_box(
                at(long - grip, 0.0, 0.0),
                Vec3::new(0.05, wide * 2.0, thick * 2.0),
            );
        }
    }
}
