//! Triangulation of a simple polygon with holes by ear clipping.

use glam::Vec2;

/// Divides a simple polygon with holes into triangles: `(corners, triangles)`, the triangles indexing the corners.
/// Holes must lie inside and not touch. O(n²) or worse, so for outlines of some hundred corners.
pub fn triangulate(outline: &[Vec2], holes: &[Vec<Vec2>]) -> (Vec<Vec2>, Vec<[u32; 3]>) {
    let mut corners = outline.to_vec();
    let mut ring: Vec<usize> = (0..outline.len()).collect();
    if signed_area(outline) < 0.0 {
        ring.reverse();
    }
    let mut pending: Vec<Vec<usize>> = Vec::new();
    for hole in holes {
        let first = corners.len();
        corners.extend_from_slice(hole);
        let mut indices: Vec<usize> = (first..corners.len()).collect();
        if signed_area(hole) > 0.0 {
            indices.reverse();
        }
        pending.push(indices);
    }
    while let Some(hole) = pending.pop() {
        bridge(&corners, &mut ring, &hole, &pending);
    }
    let triangles = clip_ears(&corners, ring);
    (corners, triangles)
}

/// Joins a clockwise hole to the ring by the shortest connection that crosses nothing.
fn bridge(corners: &[Vec2], ring: &mut Vec<usize>, hole: &[usize], others: &[Vec<usize>]) {
    let mut candidates: Vec<(f32, usize, usize)> = Vec::new();
    for (r, &from) in ring.iter().enumerate() {
        for (h, &to) in hole.iter().enumerate() {
            candidates.push((corners[from].distance_squared(corners[to]), r, h));
        }
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rings = || {
        std::iter::once(ring.as_slice())
            .chain([hole])
            .chain(others.iter().map(Vec::as_slice))
    };
    let crosses_nothing = |&&(_, r, h): &&(f32, usize, usize)| {
        let (from, to) = (corners[ring[r]], corners[hole[h]]);
        let (before, after) = (
            corners[ring[(r + ring.len() - 1) % ring.len()]],
            corners[ring[(r + 1) % ring.len()]],
        );
        in_cone(before, from, after, to)
            && rings().all(|ring| {
                let edges = ring.iter().zip(ring.iter().cycle().skip(1));
                edges
                    .into_iter()
                    .all(|(&a, &b)| !cross(from, to, corners[a], corners[b]))
            })
    };
    let Some(&(_, r, h)) = candidates.iter().find(crosses_nothing) else {
        return;
    };
    let around = hole[h..].iter().chain(&hole[..=h]).copied();
    let joined: Vec<usize> = ring[..=r]
        .iter()
        .copied()
        .chain(around)
        .chain(ring[r..].iter().copied())
        .collect();
    *ring = joined;
}

fn clip_ears(corners: &[Vec2], mut ring: Vec<usize>) -> Vec<[u32; 3]> {
    let mut triangles = Vec::with_capacity(ring.len());
    let mut start = 0;
    while ring.len() >= 3 {
        let n = ring.len();
        let corner = |i: usize| [ring[(i + n - 1) % n], ring[i % n], ring[(i + 1) % n]];
        let is_ear = |i: &usize| {
            let [a, b, c] = corner(*i).map(|index| corners[index]);
            turn(a, b, c) > 0.0
                && ring.iter().all(|&other| {
                    let p = corners[other];
                    p == a || p == b || p == c || !inside(p, a, b, c)
                })
        };
        // Starts where the last ear was cut: fans from one corner make needles.
        let ear = (start..start + n).map(|i| i % n).find(is_ear);
        // Without an ear the rest is degenerate: it has no area, or the polygon was not simple.
        let flat = || {
            (0..n).find(|&i| {
                let [a, b, c] = corner(i).map(|index| corners[index]);
                turn(a, b, c) == 0.0
            })
        };
        let Some(i) = ear.or_else(flat) else { break };
        triangles.push(corner(i).map(|index| index as u32));
        ring.remove(i);
        start = i;
    }
    triangles
}

/// Area of a ring; negative if it runs clockwise.
pub(super) fn signed_area(ring: &[Vec2]) -> f32 {
    let edges = ring.iter().zip(ring.iter().cycle().skip(1));
    edges.map(|(a, b)| a.perp_dot(*b)).sum::<f32>() / 2.0
}

/// Positive if the path a, b, c turns left.
fn turn(a: Vec2, b: Vec2, c: Vec2) -> f32 {
    (b - a).perp_dot(c - a)
}

fn inside(p: Vec2, a: Vec2, b: Vec2, c: Vec2) -> bool {
    turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
}

/// Whether `to` lies in the polygon's interior angle at `at`.
fn in_cone(before: Vec2, at: Vec2, after: Vec2, to: Vec2) -> bool {
    let (left, right) = (turn(before, at, to) > 0.0, turn(at, after, to) > 0.0);
    if turn(before, at, after) >= 0.0 {
        left && right
    } else {
        left || right
    }
}

/// Whether two segments cross inside both.
pub(super) fn cross(a: Vec2, b: Vec2, c: Vec2, d: Vec2) -> bool {
    turn(a, b, c) * turn(a, b, d) < 0.0 && turn(c, d, a) * turn(c, d, b) < 0.0
}

#[cfg(test)]
mod tests {
    use super::super::solids::{circle, rectangle};
    use super::*;

    fn area(outline: &[Vec2], holes: &[Vec<Vec2>]) -> f32 {
        let (corners, triangles) = triangulate(outline, holes);
        let parts = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            turn(a, b, c) / 2.0
        });
        parts
            .inspect(|&part| assert!(part >= 0.0, "a triangle is turned over"))
            .sum()
    }

    fn check(outline: &[Vec2], holes: &[Vec<Vec2>]) {
        let exact =
            signed_area(outline).abs() - holes.iter().map(|h| signed_area(h).abs()).sum::<f32>();
        let found = area(outline, holes);
        assert!(
            (found / exact - 1.0).abs() < 1e-4,
            "{found} against {exact}"
        );
    }

    #[test]
    fn triangles_cover_the_polygon_and_not_its_holes() {
        check(&rectangle(2.0, 1.0), &[]);
        let l = [(0., 0.), (3., 0.), (3., 1.), (1., 1.), (1., 4.), (0., 4.)].map(Vec2::from);
        check(
            &l,
            &[
                circle(Vec2::new(0.5, 0.5), 0.3, 12),
                circle(Vec2::new(0.5, 3.0), 0.3, 12),
            ],
        );
        let mut reversed = l;
        reversed.reverse();
        check(
            &reversed,
            &[rectangle(0.2, 0.2)
                .iter()
                .map(|p| *p + Vec2::new(2.0, 0.5))
                .collect()],
        );
    }

    #[test]
    fn flanges_of_every_bolt_count() {
        for bolts in 0..12 {
            let mut holes: Vec<_> = circle(Vec2::ZERO, 0.7, bolts)
                .into_iter()
                .map(|c| circle(c, 0.1, 10))
                .collect();
            holes.push(circle(Vec2::ZERO, 0.4, 28));
            check(&circle(Vec2::ZERO, 1.0, 28), &holes);
        }
    }

    #[test]
    fn stars_are_not_convex() {
        let star: Vec<Vec2> = circle(Vec2::ZERO, 1.0, 40)
            .into_iter()
            .enumerate()
            .map(|(i, p)| p * if i % 2 == 0 { 1.0 } else { 0.6 })
            .collect();
        check(&star, &[circle(Vec2::ZERO, 0.3, 28)]);
    }
}
