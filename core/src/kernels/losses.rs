//! Losses of pairs of nearest points, with pairs in lanes.
//!
//! As in [`super::lanes`], the bits are the same on every kernel.

#![allow(unsafe_code)]

use super::Isa;
use super::lanes::{LANES, Lanes, Seen, Vectors};
use super::matching::{BEYOND, NearestQuery};
use super::on_lanes::on_lanes;
use super::oriented::OrientedPoints;
use crate::dims::SURFACE_POINTS;
use crate::loss::{GAP, POINT, SURFACE};

/// As [`crate::loss::of_surface`]: loss of a point `apart` from its nearest point on a surface, 0 on the surface, 1/2 at a
/// distance of `scale` radii, 1 far away.
#[inline(always)]
pub(super) fn of_surface<L: Lanes>(
    apart: Vectors<L>,
    normal: Vectors<L>,
    radius: f32,
    scale: f32,
) -> L {
    let across = normal.dot(apart);
    let along = (apart.dot(apart) - across * across).max(L::all(0.0)).sqrt();
    let beyond = (along - L::all(GAP * radius)).max(L::all(0.0));
    saturating(across * across + beyond * beyond, scale * radius)
}

/// `d² / (d² + c²)` (Geman and McClure).
#[inline(always)]
fn saturating<L: Lanes>(squared: L, half: f32) -> L {
    squared / (squared + L::all((half * half).max(1e-12)))
}

/// See [`Isa::losses`].
#[inline(always)]
fn losses<L: Lanes>(
    sought: &NearestQuery<'_>,
    other: OrientedPoints<'_>,
    radius: f32,
    point_share: f32,
    places: &[u16; SURFACE_POINTS],
    losses: &mut [u32; SURFACE_POINTS],
) {
    let seen = Seen::<L>::under(&sought.pose);
    let all = sought.count();
    for (first, losses) in (0..all).step_by(LANES).zip(losses.as_chunks_mut().0) {
        let losses: &mut [u32; LANES] = losses;
        let of = sought.places(first, LANES.min(all - first));
        let mut to = [0; LANES];
        for (to, &of) in to.iter_mut().zip(&of) {
            *to = places[usize::from(of) % SURFACE_POINTS];
        }
        let mut row = [0.0; LANES];
        for lane in (0..LANES).step_by(L::COUNT) {
            let p = seen.point(L::gather(sought.points.0, &of, lane));
            let [q, n] = other.gather(&to, lane);
            let apart = p - q;
            let surface = of_surface(apart, n, radius, SURFACE);
            let point = saturating(apart.dot(apart), POINT * radius);
            let loss = surface + L::all(point_share) * (point - surface);
            loss.store(&mut row, lane);
        }
        for ((loss, lost), to) in losses.iter_mut().zip(row).zip(to) {
            let lost = if to & BEYOND == 0 { lost } else { 1.0 };
            *loss = lost.to_bits();
        }
    }
}

impl Isa {
    /// Writes the bits of each sought point's loss, in order, on a surface with neighbourhoods of `radius`, from the matches in
    /// `places`; 1 beyond the limit. The same bits on every kernel.
    pub fn losses(
        self,
        sought: &NearestQuery<'_>,
        other: OrientedPoints<'_>,
        radius: f32,
        point_share: f32,
        places: &[u16; SURFACE_POINTS],
        lost: &mut [u32; SURFACE_POINTS],
    ) {
        on_lanes!(
            self,
            losses(
                sought: &NearestQuery<'_>,
                other: OrientedPoints<'_>,
                radius: f32,
                point_share: f32,
                places: &[u16; SURFACE_POINTS],
                lost: &mut [u32; SURFACE_POINTS],
            )
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::oriented::tests::Cloud;
    use crate::loss;
    use crate::polish::tests::pose;

    #[test]
    fn every_kernel_loses_what_each_match_does_and_all_of_a_point_without_one() {
        let (source, target) = (Cloud::drawn(7), Cloud::drawn(8));
        // Every third point has no match, but its place still names one.
        let mut places = [0; SURFACE_POINTS];
        for (of, place) in places.iter_mut().enumerate() {
            let beyond = if of % 3 == 0 { BEYOND } else { 0 };
            *place = (of * 7919 % SURFACE_POINTS) as u16 | beyond;
        }
        let pose = pose([0.3, -0.2, 0.9], [0.1, 0.2, -0.3]);
        let (radius, point_share) = (2.0, loss::POINT_SHARE);
        for (len, every) in [(1, 1), (37, 1), (200, 7), (SURFACE_POINTS, 2)] {
            let points = (source.bare().points, len);
            let sought = NearestQuery {
                points,
                every,
                pose,
            };
            let lost = |isa: Isa| -> Vec<f32> {
                let mut lost = [0; SURFACE_POINTS];
                let to = target.bare();
                isa.losses(&sought, to, radius, point_share, &places, &mut lost);
                let lost = lost.iter().take(len.div_ceil(every));
                lost.map(|&bits| f32::from_bits(bits)).collect()
            };
            let expected = lost(Isa::PORTABLE);
            for (of, &lost) in (0..len).step_by(every).zip(&expected) {
                let ((p, _), (q, n)) = (source.at(of as u16), target.at(places[of] & (BEYOND - 1)));
                let apart = pose.apply(p) - q;
                let surface = loss::of_surface(apart, n, radius, SURFACE);
                let squared = apart.length_squared();
                let half = POINT * radius;
                let point = squared / (squared + half * half);
                let loss = surface + point_share * (point - surface);
                let loss = if of % 3 == 0 { 1.0 } else { loss };
                assert!((lost - loss).abs() < 1e-5, "{of}: {lost} {loss}");
            }
            for isa in Isa::all() {
                assert_eq!(lost(isa), expected, "{}", isa.name());
            }
        }
    }
}
