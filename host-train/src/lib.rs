//! The workstation side of ReAgent: data, training, evaluation, export and publishing.
//!
//! Data flows one way: `dataset` reads clouds, `learn` computes what a policy learns from them, `policy` keeps it in files,
//! `register` and `measure` run it, `train` is the loop over all of these, `report` draws what came of it, and `publish` hands
//! it to the fleet.
//!
//! Modules stand in layers, and import from layers before theirs only (`tests/tests/layers.rs`):
//!
//! - layer: files, pose64, random, threads, words
//! - layer: dataset
//! - layer: augment, learn, neighbours
//! - layer: baselines, diameter, policy, protocol
//! - layer: bop, register
//! - layer: views
//! - layer: measure
//! - layer: report, train
//! - layer: publish
//! - layer: cli
#![doc = "\n"]
#![doc = include_str!("../README.md")]

#[cfg_attr(not(target_family = "wasm"), macro_use)]
extern crate reagent_link;

// A browser reads clouds and registers them; everything else takes files and threads.
#[cfg(not(target_family = "wasm"))]
pub mod augment;
pub mod baselines;
#[cfg(not(target_family = "wasm"))]
pub mod bop;
#[cfg(not(target_family = "wasm"))]
pub mod cli;
pub mod dataset;
pub mod diameter;
pub mod files;
#[cfg(not(target_family = "wasm"))]
pub mod learn;
pub mod measure;
pub mod neighbours;
#[cfg(not(target_family = "wasm"))]
pub mod policy;
pub mod pose64;
#[cfg(not(target_family = "wasm"))]
pub mod protocol;
#[cfg(feature = "publish")]
pub mod publish;
pub mod random;
pub mod register;
#[cfg(not(target_family = "wasm"))]
pub mod report;
pub mod threads;
#[cfg(not(target_family = "wasm"))]
pub mod train;
#[cfg(not(target_family = "wasm"))]
pub mod views;
pub mod words;
