//! Point cloud registration in about ten discrete, interpretable steps (ReAgent), for hosts and firmware:
//! no_std, no alloc, every size known at compile time.
//!
//! The pipeline, in the order of the modules it passes through:
//!
//! 1. [`weights`] checks a policy file once and views it in place; [`Policy::parse`].
//! 2. [`Registrar::start`] checks two clouds and embeds the target, once.
//! 3. Each [`Registrar::step`] sees the source under the accumulated [`Pose`] ([`view::View`]) and embeds it
//!    ([`float`] or [`quant`], on the machine's [`kernels`]). Both heads decide on an [`Action`]
//!    ([`decision`], [`steps`]), and the registration accumulates it ([`Pose::accumulate`]).
//! 4. [`Registration::target_from_source`] is the pose, in the clouds' own units; [`Verdict`] says how
//!    the steps ended.
//! 5. [`polish`] refines the pose, if wanted, with a few robust steps of closest points. [`verify`] compares the result
//!    with other poses, and [`verdict`] says how probably it is right. Polishing and verification share a workspace.
//! 6. [`pipeline`] is all of that for one pair of clouds; [`track`] follows an object through a stream of clouds.
//!
//! Modules stand in layers and import only from the layers before their own (`tests/tests/layers.rs`):
//!
//! - layer: numbers, error, dims, rotation, select
//! - layer: cells, shape, grid, critical, layer, pose, loss, outliers
//! - layer: cloud, steps, view, kernels
//! - layer: solve
//! - layer: covariance
//! - layer: decision, order, frame, chamfer, float, quant, surface, search, start
//! - layer: cut, freespace, nearest, pairs
//! - layer: focus, sight
//! - layer: weights
//! - layer: net, pretrained, model
//! - layer: facing
//! - layer: polish
//! - layer: mirror
//! - layer: verify
//! - layer: evidence
//! - layer: verdict
//! - layer: register
//! - layer: golden, pipeline
//! - layer: wire, budget, track
//!
//! [`wire`] defines the frames that robots and hosts exchange.
#![cfg_attr(feature = "pretrained", doc = "\n", doc = include_str!("../README.md"))]
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

pub mod budget;
mod cells;
pub mod chamfer;
pub mod cloud;
pub mod covariance;
mod critical;
pub mod cut;
pub mod decision;
pub mod dims;
pub mod error;
pub mod evidence;
mod facing;
pub mod float;
pub mod focus;
pub mod frame;
mod freespace;
pub mod golden;
pub mod grid;
pub mod kernels;
pub mod layer;
mod loss;
mod mirror;
pub mod model;
mod nearest;
pub mod net;
pub mod numbers;
pub mod order;
pub mod outliers;
mod pairs;
pub mod pipeline;
pub mod polish;
pub mod pose;
#[cfg(any(
    feature = "pretrained",
    feature = "pretrained-int8",
    feature = "pretrained-compact",
    feature = "pretrained-views",
    feature = "pretrained-views-compact"
))]
mod pretrained;
pub mod quant;
pub mod register;
mod rotation;
mod search;
mod select;
pub mod shape;
pub mod sight;
mod solve;
pub mod start;
pub mod steps;
mod surface;
pub mod track;
pub mod verdict;
pub mod verify;
pub mod view;
pub mod weights;
pub mod wire;

pub use cloud::Cloud;
pub use decision::Decision;
pub use error::Error;
pub use frame::Frame;
pub use grid::Grid;
pub use pose::Pose;
pub use register::{Registrar, Registration};
pub use shape::Shape;
pub use steps::Action;
pub use verdict::Verdict;
pub use weights::Policy;
