//! Vessels, vehicles, figures and rocks.

use super::sketch::Sketch;
use crate::dataset::solids::{along_x, along_z, at, between};
use glam::{Affine3A, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

pub(super) fn mug(s: &mut Sketch) {
    let (low, high, tall, wall) = (
        s.uniform(0.25, 0.5),
        s.uniform(0.3, 0.5),
        s.uniform(0.4, 1.1),
        s.uniform(0.02, 0.06),
    );
    let profile = [
        (0.0, 0.0),
        (low, 0.0),
        (high, tall),
        (high - wall, tall),
        (low - wall, wall),
        (0.0, wall),
    ];
    s.mesh
        .add_revolved(at(0.0, 0.0, 0.0), &profile.map(Vec2::from), TAU);
    // The handle: an upright arc on the side.
    let (ring, tube) = (tall * s.uniform(0.2, 0.36), s.uniform(0.025, 0.06));
    let height = s.uniform(0.4, 0.6) * tall;
    let place = at(low.min(high) * 0.95, height, 0.0)
        * Affine3A::from_rotation_x(FRAC_PI_2)
        * Affine3A::from_rotation_y(FRAC_PI_2)
        * Affine3A::from_scale(Vec3::new(1.0, 1.0, s.uniform(0.7, 1.3)));
    s.mesh.add_torus(place, ring, tube, PI);
    if s.chance(0.4) {
        // A spout makes it a jug.
        let from = Vec3::new(-low * 0.9, tall * 0.4, 0.0);
        let to = Vec3::new(-high * s.uniform(1.5, 2.0), tall * s.uniform(0.8, 1.1), 0.0);
        s.mesh.add_cone(between(from, to), 0.09, 0.05, 1.0);
    }
}

pub(super) fn bottle(s: &mut Sketch) {
    let (body, shoulder, neck) = (
        s.uniform(0.4, 0.9),
        s.uniform(0.1, 0.4),
        s.uniform(0.1, 0.4),
    );
    let (wide, waist, thin) = (
        s.uniform(0.18, 0.4),
        s.uniform(0.8, 1.1),
        s.uniform(0.05, 0.12),
    );
    let y = body + shoulder;
    let profile = [
        (0.0, 0.0),
        (wide, 0.0),
        (wide * waist, body * 0.5),
        (wide, body),
        (wide * 0.7, body + shoulder * 0.6),
        (thin, y),
        (thin, y + neck),
        (thin * 1.3, y + neck),
        (thin * 1.3, y + neck + 0.06),
        (0.0, y + neck + 0.06),
    ];
    let flat = at(0.0, 0.0, 0.0) * Affine3A::from_scale(Vec3::new(1.0, 1.0, s.uniform(0.5, 1.0)));
    s.mesh.add_revolved(flat, &profile.map(Vec2::from), TAU);
    match s.whole(0, 3) {
        0 => {
            // A spray head.
            let reach = s.uniform(0.15, 0.4);
            s.block([-0.08, y + neck, -0.06], [reach, y + neck + 0.14, 0.06]);
            s.mesh.add_box(
                between(
                    Vec3::new(reach * 0.5, y + neck, 0.0),
                    Vec3::new(reach * 0.8, y, 0.0),
                ),
                Vec3::new(0.03, 1.0, 0.05),
            );
        }
        1 => {
            let place = at(wide * 0.9, body * 0.6, 0.0)
                * Affine3A::from_rotation_x(FRAC_PI_2)
                * Affine3A::from_rotation_y(FRAC_PI_2);
            s.mesh.add_torus(place, body * 0.3, 0.035, PI);
        }
        2 => {
            let (from, to) = (
                Vec3::new(0.0, body * 0.6, 0.0),
                Vec3::new(wide + s.uniform(0.2, 0.4), body + s.uniform(0.1, 0.4), 0.0),
            );
            s.mesh.add_cone(between(from, to), 0.1, 0.04, 1.0);
        }
        _ => s.block(
            [wide * 0.6, body * 0.2, -wide * 0.3],
            [wide * 1.25, body * 0.8, wide * 0.4],
        ),
    }
}

pub(super) fn slotted_box(s: &mut Sketch) {
    let (w, d, h, wall) = (
        s.uniform(0.5, 1.2),
        s.uniform(0.4, 1.0),
        s.uniform(0.25, 0.8),
        s.uniform(0.02, 0.06),
    );
    let (x, z) = (w / 2.0, d / 2.0);
    s.block([-x, 0.0, -z], [x, wall, z]);
    s.block([-x, 0.0, -z], [wall - x, h, z]);
    s.block([x - wall, 0.0, -z], [x, h, z]);
    s.block([-x, 0.0, -z], [x, h, wall - z]);
    let low_front = s.uniform(0.4, 1.0) * h;
    s.block([-x, 0.0, z - wall], [x, low_front, z]);
    let slots = s.whole(0, 3);
    for i in 0..slots {
        let at_x = w * ((i + 1) as f32 / (slots + 1) as f32 - 0.5);
        let (tall, until) = (s.uniform(0.5, 1.0) * h, s.uniform(-0.2, 1.0) * z);
        s.block([at_x, 0.0, -z], [at_x + wall, tall, until]);
    }
    if s.chance(0.7) {
        // The lid, open at an angle about the rear edge.
        let angle = s.uniform(0.0, 2.2);
        let hinge = at(0.0, h, -z) * Affine3A::from_rotation_x(-angle);
        s.mesh
            .add_box(hinge * at(0.0, 0.0, z), Vec3::new(w, wall, d));
    }
    let (side, radius) = (s.sign(), s.uniform(0.05, 0.12));
    let place =
        along_x(side * x, h * 0.6, s.uniform(-0.5, 0.5) * z) * Affine3A::from_rotation_x(FRAC_PI_2);
    s.mesh.add_torus(place, radius, 0.02, TAU);
}

pub(super) fn airplane(s: &mut Sketch) {
    let (long, radius) = (s.uniform(1.2, 2.0), s.uniform(0.08, 0.18));
    let nose = s.uniform(0.1, 0.4);
    let profile = [
        (0.0, 0.0),
        (radius * 0.6, nose * 0.3),
        (radius, nose),
        (radius, long * 0.65),
        (radius * 0.3, long),
        (0.0, long),
    ];
    s.mesh
        .add_revolved(along_x(0.0, 0.0, 0.0), &profile.map(Vec2::from), TAU);
    let wing = |s: &mut Sketch, root: Vec3, chord: f32, span: f32, sweep: f32, rise: f32| {
        let tip = chord * s.uniform(0.3, 0.9);
        for side in [-1.0, 1.0] {
            let outline = [
                (0.0, 0.0),
                (chord, 0.0),
                (sweep + tip, side * span),
                (sweep, side * span),
            ]
            .map(Vec2::from);
            let place = Affine3A::from_translation(root) * Affine3A::from_rotation_x(-side * rise);
            s.mesh.add_extruded(place, &outline, &[], 0.03);
        }
    };
    let (span, sweep, rise) = (
        s.uniform(0.5, 1.2),
        s.uniform(0.0, 0.5),
        s.uniform(-0.1, 0.25),
    );
    let (x, y) = (s.uniform(0.25, 0.4) * long, s.uniform(-0.9, 0.9) * radius);
    let chord = s.uniform(0.2, 0.45);
    wing(s, Vec3::new(x, y, 0.0), chord, span, sweep, rise);
    let (tail, back) = (s.uniform(0.15, 0.25), s.uniform(0.05, 0.2));
    wing(
        s,
        Vec3::new(long * 0.88, 0.0, 0.0),
        tail,
        span * 0.35,
        back,
        0.0,
    );
    let fin = [
        (0.0, 0.0),
        (tail, 0.0),
        (tail + back, s.uniform(0.2, 0.45)),
        (back + tail * 0.4, 0.3),
    ]
    .map(Vec2::from);
    let upright = at(long * 0.85, 0.0, 0.0) * Affine3A::from_rotation_x(-FRAC_PI_2);
    s.mesh.add_extruded(upright, &fin, &[], 0.03);
    let engines = s.whole(0, 2);
    for i in 0..engines {
        let out = span * (0.3 + 0.3 * i as f32);
        for side in [-1.0, 1.0] {
            s.mesh
                .add_tube(along_x(x + 0.1, y - 0.08, side * out), 0.06, 0.045, 0.25);
        }
    }
    if engines == 0 {
        s.mesh.add_box(
            at(-0.02, 0.0, 0.0) * Affine3A::from_rotation_x(0.6),
            Vec3::new(0.02, radius * 5.0, 0.06),
        );
    }
}

pub(super) fn car(s: &mut Sketch) {
    let (long, wide, high) = (
        s.uniform(1.2, 1.8),
        s.uniform(0.5, 0.7),
        s.uniform(0.2, 0.35),
    );
    let wheel = s.uniform(0.12, 0.2);
    s.block(
        [-long / 2.0, wheel, -wide / 2.0],
        [long / 2.0, wheel + high, wide / 2.0],
    );
    // Cabin outline seen from the side: bonnet, windscreen, roof, rear.
    let (front, rear, roof) = (
        s.uniform(-0.35, 0.1) * long,
        s.uniform(0.25, 0.5) * long,
        s.uniform(0.15, 0.5),
    );
    let slope = s.uniform(0.05, 0.25);
    let top = wheel + high;
    let cabin = [
        (front, top),
        (rear, top),
        (rear - slope * s.uniform(0.0, 1.0), top + roof),
        (front + slope, top + roof),
    ];
    let upright = Affine3A::from_rotation_x(-FRAC_PI_2);
    s.mesh
        .add_extruded(upright, &cabin.map(Vec2::from), &[], wide * 0.9);
    let (ahead, behind) = (-long * s.uniform(0.28, 0.36), long * s.uniform(0.25, 0.36));
    let axles = if s.chance(0.25) {
        vec![ahead, behind, behind - 2.2 * wheel]
    } else {
        vec![ahead, behind]
    };
    for x in axles {
        for side in [-1.0, 1.0] {
            s.mesh
                .add_cylinder(along_z(x, wheel, side * wide * 0.48), wheel, 0.12);
        }
    }
    match s.whole(0, 2) {
        0 => {
            let bed = s.uniform(0.1, 0.4);
            s.block(
                [rear, top, -wide / 2.0],
                [long / 2.0 + 0.02, top + bed, wide / 2.0],
            );
        }
        1 => {
            let tall = s.uniform(0.1, 0.25);
            s.block(
                [long / 2.0 - 0.12, top + tall, -wide / 2.0],
                [long / 2.0, top + tall + 0.03, wide / 2.0],
            );
            s.block(
                [long / 2.0 - 0.08, top, -0.03],
                [long / 2.0 - 0.04, top + tall, 0.03],
            );
        }
        _ => {
            let (z, reach) = (s.uniform(-0.4, 0.4) * wide, s.uniform(0.2, 0.6));
            s.mesh.add_cylinder(
                between(
                    Vec3::new(0.0, top + roof, z),
                    Vec3::new(-reach, top + roof + 0.2, z),
                ),
                0.04,
                1.0,
            );
        }
    }
}

pub(super) fn figure(s: &mut Sketch) {
    let (hip, torso, wide) = (
        s.uniform(0.5, 0.9),
        s.uniform(0.4, 0.7),
        s.uniform(0.18, 0.3),
    );
    let shoulder = hip + torso;
    let thick = s.uniform(0.6, 1.0);
    let place = at(0.0, hip + torso / 2.0, 0.0) * Affine3A::from_scale(Vec3::new(1.0, 1.0, thick));
    let waist = wide * s.uniform(0.6, 0.9);
    s.mesh.add_cone(place, waist, wide, torso);
    let head = s.uniform(0.12, 0.22);
    let nod = s.uniform(-0.08, 0.12);
    s.mesh.add_sphere(at(0.0, shoulder + head * 1.1, nod), head);
    s.mesh.add_cone(
        along_z(0.0, shoulder + head, nod + head),
        head * 0.3,
        0.02,
        head * 0.6,
    );
    let limb = s.uniform(0.05, 0.09);
    for side in [-1.0, 1.0] {
        let bend = |s: &mut Sketch, from: Vec3, length: f32, lift: f32| {
            let (forward, out) = (s.uniform(-0.9, 0.9), s.uniform(0.0, 0.9) * side * lift);
            let middle = from + length / 2.0 * Vec3::new(out, -1.0, forward * lift).normalize();
            let end = middle
                + length / 2.0
                    * Vec3::new(out * 0.5, -1.0 + lift * s.uniform(0.0, 1.6), forward).normalize();
            s.mesh
                .add_cone(between(from, middle), limb, limb * 1.1, 1.0);
            s.mesh.add_cone(between(middle, end), limb * 0.7, limb, 1.0);
            end
        };
        let arm = s.uniform(0.45, 0.7);
        let hand = bend(
            s,
            Vec3::new(side * wide * 1.1, shoulder - limb, 0.0),
            arm,
            1.0,
        );
        s.mesh
            .add_sphere(Affine3A::from_translation(hand), limb * 1.2);
        let foot = bend(s, Vec3::new(side * wide * 0.5, hip, 0.0), hip, 0.3);
        s.mesh.add_box(
            Affine3A::from_translation(foot + Vec3::new(0.0, 0.0, limb)),
            Vec3::new(limb * 2.0, limb, limb * 5.0),
        );
    }
    if s.chance(0.4) {
        s.block(
            [-wide * 0.8, hip + torso * 0.2, -wide * 1.6],
            [wide * 0.8, shoulder, -wide * thick * 0.8],
        );
    }
}

pub(super) fn rock(s: &mut Sketch) {
    let stones = s.whole(1, 3);
    for _ in 0..stones {
        let first = s.mesh.vertices.len();
        s.mesh.add_sphere(at(0.0, 0.0, 0.0), 1.0);
        // A sum of plane waves over the sphere, then unequal axes.
        let waves: Vec<(Vec3, f32, f32)> = (0..7)
            .map(|_| {
                let direction = Vec3::new(
                    s.uniform(-1.0, 1.0),
                    s.uniform(-1.0, 1.0),
                    s.uniform(-1.0, 1.0),
                );
                (
                    direction * s.uniform(1.0, 4.0),
                    s.uniform(0.0, TAU),
                    s.uniform(0.03, 0.14),
                )
            })
            .collect();
        let axes = Vec3::new(
            s.uniform(0.3, 1.0),
            s.uniform(0.3, 0.9),
            s.uniform(0.3, 1.0),
        );
        let shift = Vec3::new(
            s.uniform(-0.8, 0.8),
            s.uniform(-0.2, 0.3),
            s.uniform(-0.8, 0.8),
        ) * (stones - 1).min(1) as f32;
        for vertex in &mut s.mesh.vertices[first..] {
            let bumps: f32 = waves
                .iter()
                .map(|(k, phase, size)| size * Vec2::from_angle(k.dot(*vertex) + phase).y)
                .sum();
            *vertex = *vertex * (1.0 + bumps) * axes + shift;
        }
    }
}
