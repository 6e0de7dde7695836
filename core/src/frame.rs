//! The normalised frame of a registration.

use crate::cloud::{Cloud, LARGEST_COORDINATE};
use crate::error::Error;
use crate::pose::{Pose, mean};
use crate::view::View;
use glam::Vec3;

/// Smallest scale accepted: squares of smaller distances underflow.
const SMALLEST_SCALE: f32 = 1e-12;

/// The normalised frame in which the policy works: `x_n = (x - centre) / scale`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Point that becomes the origin.
    pub centre: Vec3,
    /// Length that becomes 1, in the cloud's units.
    pub scale: f32,
}

impl Frame {
    /// The frame of clouds that are normalised already.
    pub const IDENTITY: Frame = Frame {
        centre: Vec3::ZERO,
        scale: 1.0,
    };

    /// The target's frame: its mean at the origin, its farthest point at distance 1.
    ///
    /// # Errors
    /// As [`Cloud::check`]; [`Error::TooSmall`].
    pub fn of(target: &[[f32; 3]]) -> Result<Frame, Error> {
        Frame::of_cloud(Cloud::F32(target))
    }

    /// As [`Frame::of`], for a cloud in either format.
    ///
    /// # Errors
    /// As [`Frame::of`].
    pub fn of_cloud(target: Cloud<'_>) -> Result<Frame, Error> {
        target.check()?;
        Frame::of_points(target.points())
    }

    /// As [`Frame::of`], for points that were checked.
    ///
    /// # Errors
    /// [`Error::TooSmall`].
    pub(crate) fn of_points(
        points: impl Iterator<Item = [f32; 3]> + Clone,
    ) -> Result<Frame, Error> {
        let centre = mean(points.clone());
        let scale = points
            .map(|p| (Vec3::from_array(p) - centre).length())
            .fold(0.0, f32::max);
        if scale >= SMALLEST_SCALE {
            Ok(Frame { centre, scale })
        } else {
            Err(Error::TooSmall)
        }
    }

    /// Refuses a frame that no clouds can have.
    ///
    /// # Errors
    /// [`Error::BadFrame`].
    pub fn checked(self) -> Result<Frame, Error> {
        let near = |x: f32| x.abs() <= LARGEST_COORDINATE;
        let scales = SMALLEST_SCALE..=10.0 * LARGEST_COORDINATE;
        if self.centre.to_array().into_iter().all(near) && scales.contains(&self.scale) {
            Ok(self)
        } else {
            Err(Error::BadFrame)
        }
    }

    /// How a source under a plain pose, in the clouds' own units, appears in this frame.
    pub fn view(&self, target_from_source: &Pose) -> View {
        let scale = 1.0 / self.scale;
        View {
            origin: Vec3::ZERO,
            map: Pose {
                rotation: target_from_source.rotation * scale,
                translation: (target_from_source.translation - self.centre) * scale,
            },
        }
    }
}

/// Checks a cloud, as [`Cloud::check`].
///
/// # Errors
/// As [`Cloud::check`].
pub fn check_cloud(points: &[[f32; 3]]) -> Result<(), Error> {
    Cloud::F32(points).check()
}
