//! The workstation side of ReAgent: data, training, evaluation, export and publishing.
//!
//! Data flows one way: `dataset` reads clouds, `learn` trains a policy on them, `policy` makes it a file,
//! `measure` and `register` run it, `report` draws what came of it, and `publish` hands it to the fleet.
#![doc = "\n"]
#![doc = include_str!("../README.md")]

#[cfg_attr(not(target_family = "wasm"), macro_use)]
extern crate reagent_link;

// A browser reads clouds and registers them; everything else takes files and threads.
#[cfg(not(target_family = "wasm"))]
pub mod augment;
#[cfg(not(target_family = "wasm"))]
pub mod bop;
#[cfg(not(target_family = "wasm"))]
pub mod cli;
pub mod dataset;
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
#[cfg(not(target_family = "wasm"))]
pub mod views;
pub mod words;
