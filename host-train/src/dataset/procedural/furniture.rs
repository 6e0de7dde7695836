//! Furniture and buildings.

use super::sketch::Sketch;
use crate::dataset::solids::{along_x, along_z, at, between, circle};
use glam::{Affine3A, Vec2, Vec3};

pub(super) fn table(s: &mut Sketch) {
    let (w, d, h, top) = (
        s.uniform(0.8, 1.6),
        s.uniform(0.5, 1.0),
        s.uniform(0.4, 0.9),
        s.uniform(0.03, 0.08),
    );
    if s.chance(0.25) {
        s.mesh.add_cylinder(
            at(0.0, h, 0.0) * Affine3A::from_scale(Vec3::new(w, 1.0, d)),
            0.5,
            top,
        );
    } else {
        s.block([-w / 2.0, h - top, -d / 2.0], [w / 2.0, h, d / 2.0]);
    }
    let leg = s.uniform(0.03, 0.07);
    let (x, z) = (
        w / 2.0 - s.uniform(0.05, 0.2),
        d / 2.0 - s.uniform(0.05, 0.15),
    );
    let splay = s.uniform(-0.02, 0.1);
    for (a, b) in [(-x, -z), (-x, z), (x, -z), (x, z)] {
        let foot = Vec3::new(a + splay * a.signum(), 0.0, b + splay * b.signum());
        let place = between(foot, Vec3::new(a, h, b));
        s.mesh.add_box(place, Vec3::new(leg, 1.0, leg));
    }
    if s.chance(0.6) {
        // Drawers under one end.
        let (side, width, depth) = (s.sign(), s.uniform(0.2, 0.45) * w, s.uniform(0.15, 0.7) * h);
        let inner = side * (w / 2.0 - width);
        let (from, to) = (inner.min(side * w / 2.0), inner.max(side * w / 2.0));
        s.block([from, h - depth, -d * 0.45], [to, h - top, d * 0.4]);
    }
    if s.chance(0.4) {
        let y = s.uniform(0.15, 0.5) * h;
        s.block([-x, y, -z - leg / 2.0], [x, y + leg, -z + leg / 2.0]);
    }
}

pub(super) fn chair(s: &mut Sketch) {
    let (w, d, h) = (
        s.uniform(0.4, 0.6),
        s.uniform(0.4, 0.6),
        s.uniform(0.35, 0.55),
    );
    let thick = s.uniform(0.03, 0.1);
    s.block([-w / 2.0, h - thick, -d / 2.0], [w / 2.0, h, d / 2.0]);
    let (back, lean, leg) = (
        s.uniform(0.3, 0.7),
        s.uniform(0.0, 0.15),
        s.uniform(0.03, 0.06),
    );
    let (x, z) = (w / 2.0 - leg / 2.0, d / 2.0 - leg / 2.0);
    for (a, b) in [(-x, -z), (-x, z), (x, -z), (x, z)] {
        s.block(
            [a - leg / 2.0, 0.0, b - leg / 2.0],
            [a + leg / 2.0, h - thick, b + leg / 2.0],
        );
    }
    let back_place = |x: f32| between(Vec3::new(x, h, -z), Vec3::new(x, h + back, -z - lean));
    if s.chance(0.5) {
        s.mesh.add_box(back_place(0.0), Vec3::new(w, 1.0, thick));
    } else {
        let slats = s.whole(2, 5);
        for i in 0..slats {
            let x = w * ((i as f32 + 0.5) / slats as f32 - 0.5);
            s.mesh
                .add_box(back_place(x), Vec3::new(w * 0.6 / slats as f32, 1.0, leg));
        }
        s.block(
            [-w / 2.0, h + back * 0.9, -z - lean - leg],
            [w / 2.0, h + back, -z - lean * 0.8 + leg],
        );
    }
    let arms = s.whole(0, 2);
    for side in [-1.0, 1.0].into_iter().take(arms) {
        let (x, y) = (side * w / 2.0, h + s.uniform(0.15, 0.25));
        s.block([x - leg, y, -z], [x + leg, y + leg, z]);
        s.block([x - leg / 2.0, h, z - leg], [x + leg / 2.0, y, z]);
    }
}

pub(super) fn shelf(s: &mut Sketch) {
    let (w, d, h, board) = (
        s.uniform(0.5, 1.4),
        s.uniform(0.2, 0.5),
        s.uniform(0.6, 1.8),
        s.uniform(0.02, 0.05),
    );
    for x in [-w / 2.0, w / 2.0 - board] {
        s.block([x, 0.0, -d / 2.0], [x + board, h, d / 2.0]);
    }
    let boards = s.whole(2, 6);
    for i in 0..=boards {
        let y = (h - board) * i as f32 / boards as f32;
        s.block([-w / 2.0, y, -d / 2.0], [w / 2.0, y + board, d / 2.0]);
    }
    if s.chance(0.6) {
        s.block([-w / 2.0, 0.0, -d / 2.0], [w / 2.0, h, -d / 2.0 + board]);
    }
    let pitch = h / boards as f32;
    for i in 0..boards {
        // Things on the boards: doors, boxes, rows of books.
        if s.chance(0.6) {
            let (width, height) = (s.uniform(0.15, 0.6) * w, s.uniform(0.4, 0.95) * pitch);
            let x = s.uniform(-w / 2.0, w / 2.0 - width);
            let y = pitch * i as f32;
            s.block([x, y, -d * 0.4], [x + width, y + height, d * 0.45]);
        }
    }
}

pub(super) fn bed(s: &mut Sketch) {
    let (w, l, h) = (
        s.uniform(0.5, 1.0),
        s.uniform(1.0, 1.4),
        s.uniform(0.15, 0.35),
    );
    s.block([-w / 2.0, h * 0.4, -l / 2.0], [w / 2.0, h, l / 2.0]);
    let (head, foot, board) = (
        s.uniform(0.3, 0.7),
        s.uniform(0.0, 0.3),
        s.uniform(0.03, 0.08),
    );
    s.block(
        [-w / 2.0, 0.0, -l / 2.0 - board],
        [w / 2.0, h + head, -l / 2.0],
    );
    s.block(
        [-w / 2.0, 0.0, l / 2.0],
        [w / 2.0, h * 0.5 + foot, l / 2.0 + board],
    );
    let pillows = s.whole(1, 2);
    for i in 0..pillows {
        let x = w * ((i as f32 + 0.5) / pillows as f32 - 0.5);
        let place = at(x, h, -l * 0.36)
            * Affine3A::from_scale(Vec3::new(w * 0.4 / pillows as f32, 0.06, l * 0.1));
        s.mesh.add_sphere(place, 1.0);
    }
    if s.chance(0.7) {
        // A sofa's arm, or a bedside table, on one side.
        let (side, width, tall) = (s.sign(), s.uniform(0.1, 0.3), s.uniform(0.2, 0.6));
        let x = side * (w + width) / 2.0;
        let z = s.uniform(-l / 2.0, 0.0);
        s.block(
            [x - width / 2.0, 0.0, z],
            [x + width / 2.0, tall, z + l * 0.3],
        );
    }
}

pub(super) fn lamp(s: &mut Sketch) {
    let (h, foot) = (s.uniform(0.6, 1.5), s.uniform(0.15, 0.3));
    s.mesh.add_cone(at(0.0, 0.02, 0.0), foot, foot * 0.7, 0.04);
    let lean = s.uniform(-0.2, 0.4);
    let elbow = Vec3::new(lean, h * 0.6, 0.0);
    let reach = s.uniform(0.1, 0.7);
    let tip = Vec3::new(lean + reach, h, s.uniform(-0.2, 0.2));
    for (from, to) in [(Vec3::ZERO, elbow), (elbow, tip)] {
        s.mesh.add_cylinder(between(from, to), 0.025, 1.0);
    }
    let (low, high, shade) = (
        s.uniform(0.15, 0.35),
        s.uniform(0.06, 0.2),
        s.uniform(0.15, 0.35),
    );
    let place = Affine3A::from_translation(tip) * Affine3A::from_rotation_z(s.uniform(0.0, 1.0));
    let profile = [
        Vec2::new(low, -shade / 2.0),
        Vec2::new(high, shade / 2.0),
        Vec2::new(0.0, shade / 2.0),
    ];
    s.mesh.add_revolved(place, &profile, std::f32::consts::TAU);
    s.mesh.add_sphere(place, 0.06);
}

pub(super) fn stairs(s: &mut Sketch) {
    let (steps, w) = (s.whole(3, 9), s.uniform(0.3, 0.9));
    let (rise, run) = (s.uniform(0.08, 0.15), s.uniform(0.1, 0.2));
    let open = s.chance(0.4);
    for i in 0..steps {
        let (y, z) = (rise * i as f32, run * i as f32);
        let low = if open { y + rise * 0.7 } else { 0.0 };
        s.block([-w / 2.0, low, z], [w / 2.0, y + rise, z + run]);
    }
    let (top, length) = (rise * steps as f32, run * steps as f32);
    let sides = s.whole(1, 2);
    for side in [-1.0, 1.0].into_iter().take(sides) {
        let (x, rail) = (side * w / 2.0, s.uniform(0.3, 0.5));
        s.mesh.add_cylinder(
            between(Vec3::new(x, rail, 0.0), Vec3::new(x, top + rail, length)),
            0.02,
            1.0,
        );
        for i in 0..steps {
            let (y, z) = (rise * (i + 1) as f32, run * (i as f32 + 0.5));
            s.mesh.add_cylinder(
                between(Vec3::new(x, y, z), Vec3::new(x, y + rail, z)),
                0.012,
                1.0,
            );
        }
    }
    if s.chance(0.5) {
        let deep = s.uniform(0.2, 0.6);
        s.block([-w / 2.0, 0.0, length], [w / 2.0, top, length + deep]);
    }
}

pub(super) fn house(s: &mut Sketch) {
    let (w, d, h, roof) = (
        s.uniform(0.5, 1.1),
        s.uniform(0.5, 1.4),
        s.uniform(0.3, 1.2),
        s.uniform(0.15, 0.6),
    );
    s.block([-w / 2.0, 0.0, -d / 2.0], [w / 2.0, h, d / 2.0]);
    let over = s.uniform(0.0, 0.12);
    let ridge = s.uniform(-0.2, 0.2) * w;
    let gable = [
        Vec2::new(-w / 2.0 - over, 0.0),
        Vec2::new(w / 2.0 + over, 0.0),
        Vec2::new(ridge, roof),
    ];
    // The extrusion's plane is x-z and its axis y: turned so that the profile stands upright.
    let upright = at(0.0, h, 0.0) * Affine3A::from_rotation_x(-std::f32::consts::FRAC_PI_2);
    s.mesh.add_extruded(upright, &gable, &[], d + 2.0 * over);
    let (chimney, cx, cz) = (
        s.uniform(0.06, 0.12),
        s.uniform(-0.3, 0.3) * w,
        s.uniform(-0.4, 0.4) * d,
    );
    s.block(
        [cx - chimney, h, cz - chimney],
        [cx + chimney, h + roof * 1.2, cz + chimney],
    );
    if s.chance(0.6) {
        let (side, wide, deep, tall) = (
            s.sign(),
            s.uniform(0.2, 0.6),
            s.uniform(0.3, 0.7) * d,
            s.uniform(0.4, 0.9) * h,
        );
        let z = s.uniform(-d / 2.0, d / 2.0 - deep);
        let (from, to) = if side > 0.0 {
            (w / 2.0, w / 2.0 + wide)
        } else {
            (-w / 2.0 - wide, -w / 2.0)
        };
        s.block([from, 0.0, z], [to, tall, z + deep]);
    }
    if s.chance(0.3) {
        let radius = s.uniform(0.1, 0.25);
        let tall = h * s.uniform(1.0, 2.0);
        s.mesh
            .add_cylinder(at(w / 2.0, tall / 2.0, d / 2.0), radius, tall);
        s.mesh
            .add_cone(at(w / 2.0, tall + 0.15, d / 2.0), radius * 1.2, 0.0, 0.3);
    }
    let door = s.uniform(0.1, 0.25);
    let x = s.uniform(-w / 2.0, w / 2.0 - door);
    s.block([x, 0.0, d / 2.0], [x + door, h * 0.6, d / 2.0 + 0.05]);
    let window = circle(Vec2::ZERO, s.uniform(0.04, 0.1), 16);
    let z = s.uniform(-0.3, 0.3) * d;
    s.mesh
        .add_extruded(along_x(w / 2.0, h * 0.6, z), &window, &[], 0.06);
    let x = s.uniform(-0.3, 0.3) * w;
    s.mesh
        .add_extruded(along_z(x, h * 0.7, -d / 2.0), &window, &[], 0.06);
}
