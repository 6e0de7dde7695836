//! Simulated robots on Zenoh: a node that fetches the fleet's policy and answers refine requests with
//! `reagent_core`, and the client that asks.
//!
//! A policy flows `session -> node -> updates (whether to take it) -> policy (signature) -> fetch (chunks) -> store (flash) ->
//! policy (hash, parse, self-test) -> service`. A request flows `client -> node (queue) -> service -> client`. If the node has a board, `bridge`
//! replaces `service`, and policies and requests go on over the board's line.
#![doc = "\n"]
#![doc = include_str!("../README.md")]

#[cfg(feature = "demo")]
#[macro_use(println)]
extern crate reagent_link;

mod bridge;
pub mod client;
mod config;
#[cfg(feature = "demo")]
pub mod demo;
mod fetch;
pub mod flash;
#[cfg(feature = "demo")]
pub mod fleet;
mod frames;
mod identity;
mod later;
pub mod node;
pub mod policy;
mod presence;
mod queue;
#[cfg(feature = "demo")]
pub mod refine;
#[cfg(feature = "demo")]
pub mod ros;
mod service;
mod store;
mod updates;
pub mod view;

pub use reagent_link::{board, session};
