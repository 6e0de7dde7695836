//! Finds which of a surface's points face away from a sensor, in lanes.
//!
//! As in [`super::lanes`]: the same on every kernel.

#![allow(unsafe_code)]

use super::Isa;
use super::boxes::{Bits, RUN};
use super::lanes::{LANES, Lanes, Vectors};
use super::on_lanes::on_lanes;
use super::oriented::OrientedPoints;
use crate::dims::SURFACE_POINTS;

/// Which way a surface faces, by place. A side is hidden if the cosine between its outward normal and the direction to the sensor
/// is below `-away`.
#[derive(Clone, Copy, Debug)]
pub struct Sides<'a> {
    /// Whether the normal points outward; if also [`Self::inward`], nothing outside can see the point.
    pub outward: &'a Bits,
    /// Whether the opposite of the normal points outward.
    pub inward: &'a Bits,
    /// Cosine.
    pub away: f32,
}

/// Whether a place's bit is set.
#[inline(always)]
pub fn has(bits: &Bits, place: usize) -> bool {
    let byte = bits.get(place / RUN).copied().unwrap_or(0);
    byte >> (place % RUN) & 1 == 1
}

/// See [`Isa::hidden`].
#[inline(always)]
fn hide<L: Lanes>(of: OrientedPoints<'_>, sides: Sides<'_>, eye: [f32; 3], hidden: &mut Bits) {
    let (eye, away, zero) = (
        Vectors::<L>::all(eye),
        L::all(sides.away * sides.away),
        L::all(0.0),
    );
    let (outward, _) = sides.outward.as_chunks::<2>();
    let (inward, _) = sides.inward.as_chunks::<2>();
    let (hidden, _) = hidden.as_chunks_mut::<2>();
    for (k, ((outward, inward), hidden)) in outward.iter().zip(inward).zip(hidden).enumerate() {
        let [outward, inward] = [*outward, *inward].map(u16::from_le_bytes);
        let [mut from_normal, mut from_opposite] = [0u32; 2];
        if outward != inward {
            let mut places = [0; LANES];
            for (i, place) in places.iter_mut().enumerate() {
                *place = ((k * LANES + i) % SURFACE_POINTS) as u16;
            }
            for lane in (0..LANES).step_by(L::COUNT) {
                let [point, normal] = of.gather::<L>(&places, lane);
                let towards = eye - point;
                let along = normal.dot(towards);
                let is_steep = (away * towards.dot(towards)).below(along * along);
                from_normal |= (along.below(zero) & is_steep) << lane;
                from_opposite |= (zero.below(along) & is_steep) << lane;
            }
        }
        let of_both = outward & inward;
        let turned_away = outward & from_normal as u16 | inward & from_opposite as u16;
        *hidden = (of_both | turned_away).to_le_bytes();
    }
}

impl Isa {
    /// Sets a bit for each place whose surface faces away from a sensor at `eye`, or that nothing outside can see.
    pub fn hidden(
        self,
        of: OrientedPoints<'_>,
        sides: Sides<'_>,
        eye: [f32; 3],
        hidden: &mut Bits,
    ) {
        on_lanes!(
            self,
            hide(of: OrientedPoints<'_>, sides: Sides<'_>, eye: [f32; 3], hidden: &mut Bits)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::RUNS;
    use crate::kernels::oriented::tests::Cloud;
    use glam::Vec3;

    #[test]
    fn every_kernel_hides_what_faces_away() {
        let cloud = Cloud::drawn(3);
        let of = cloud.bare();
        let mut sides = [[0; RUNS]; 2];
        // Outward, inward, both and unknown in turns.
        let bytes = sides.as_flattened_mut().iter_mut().enumerate();
        bytes.for_each(|(i, byte)| *byte = if i < RUNS { 0b0011_0101 } else { 0b0101_0110 });
        let [outward, inward] = &sides;
        let away = 0.1;
        let eye = Vec3::new(0.5, -3.0, 1.0);
        for isa in Isa::all() {
            let mut hidden = [0xaa; RUNS];
            let sides = Sides {
                outward,
                inward,
                away,
            };
            isa.hidden(of, sides, eye.to_array(), &mut hidden);
            for place in 0..SURFACE_POINTS {
                let [point, normal] = [of.points, of.normals].map(|of| Vec3::from(of[place]));
                let cosine = normal.dot((eye - point).normalize());
                let expected = match (has(outward, place), has(inward, place)) {
                    (true, true) => true,
                    (true, false) => cosine < -away,
                    (false, true) => cosine > away,
                    (false, false) => false,
                };
                let is_close = (cosine.abs() - away).abs() < 1e-5;
                assert!(
                    has(&hidden, place) == expected || is_close,
                    "{} {place}",
                    isa.name()
                );
            }
        }
    }
}
