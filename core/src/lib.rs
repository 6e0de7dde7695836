//! Point cloud registration in about ten discrete, interpretable steps (ReAgent), for hosts and firmware:
//! no_std, no alloc, every size known at compile time.
//!
//! The pipeline, in the order of the modules it passes through:
//!
//! 1. [`weights`] checks a policy file once and views it in place; [`Policy::parse`].
//! 2. [`Registrar::start`] checks two clouds and embeds the target, once.
//! 3. Each [`Registrar::step`] sees the source under the accumulated [`Pose`] ([`net::View`]), embeds it
//!    ([`net`], on the [`kernels`] of the machine), has both heads decide on an
//!    [`Action`] ([`decision`], [`steps`]) and accumulates it ([`Pose::accumulate`]).
//! 4. [`Registration::target_from_source`] is the pose, in the clouds' own units; [`Verdict`] says how
//!    the steps ended.
//! 5. [`polish`], for who wants more: a few robust steps of closest points; [`verify`] compares the
//!    result with other poses, and [`verdict`] tells how probably it is right. Both have working memory of their own.
//!
//! [`wire`] holds the frames in which robots and hosts speak of all this.
//!
//! ```
//! use reagent_core::{Frame, Policy, Pose, Registrar, net::Scratch};
//!
//! # fn main() -> Result<(), reagent_core::Error> {
//! # #[cfg(feature = "pretrained")] {
//! // Two clouds of an L-shaped bracket in millimetres: as modelled, and observed 5 mm to the side.
//! let target: Vec<[f32; 3]> = (0..600)
//!     .map(|i| {
//!         let (u, v) = ((i % 30) as f32 * 2.0, (i / 30) as f32 * 2.0);
//!         if v < 20.0 { [u, v, 0.0] } else { [u, 0.0, v - 20.0] }
//!     })
//!     .collect();
//! let source: Vec<[f32; 3]> = target.iter().map(|&[x, y, z]| [x + 5.0, y, z]).collect();
//!
//! let policy = Policy::pretrained()?; // or Policy::parse(bytes) of a file in flash
//! let mut scratch = Scratch::new();
//! let mut registrar = Registrar::new(policy, &mut scratch);
//! let frame = Frame::of(&target)?; // the policy works in the target's normalised frame
//! let outcome = registrar.register(&source, &target, frame, Pose::IDENTITY, 10)?;
//! let [x, ..] = outcome.target_from_source.apply(source[0].into()).to_array();
//! assert!((x - target[0][0]).abs() < 5.0, "closer than before");
//! # }
//! # Ok(())
//! # }
//! ```
#![cfg_attr(not(test), no_std)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing
    )
)]

pub mod chamfer;
pub mod cloud;
mod critical;
pub mod decision;
pub mod dims;
pub mod error;
pub mod golden;
pub mod grid;
pub mod kernels;
pub mod net;
mod order;
pub mod polish;
pub mod pose;
#[cfg(any(
    feature = "pretrained",
    feature = "pretrained-int8",
    feature = "pretrained-compact"
))]
mod pretrained;
pub mod quant;
pub mod register;
pub mod shape;
mod solve;
pub mod steps;
mod surface;
mod turn;
pub mod verdict;
pub mod verify;
pub mod weights;
pub mod wire;

pub use cloud::Cloud;
pub use decision::Decision;
pub use error::Error;
pub use grid::Grid;
pub use pose::Pose;
pub use register::{Frame, Registrar, Registration};
pub use shape::Shape;
pub use steps::Action;
pub use verdict::Verdict;
pub use weights::Policy;
