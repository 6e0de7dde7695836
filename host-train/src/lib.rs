//! The workstation side of ReAgent: data, training, evaluation, export and publishing.
//!
//! Data flows one way: `dataset -> augment -> env <-> agent -> buffer -> loss -> optim` (the loop is in
//! `train`), then `export` makes the bytes that `publish` hands to the fleet.
#![doc = "\n"]
#![doc = include_str!("../README.md")]

#[macro_use]
extern crate reagent_link;

pub mod agent;
pub mod augment;
pub mod baselines;
pub mod batch;
pub mod bop;
pub mod buffer;
pub mod calibrate;
pub mod checkpoint;
pub mod cli;
pub mod dataset;
pub mod dense;
pub mod env;
pub mod eval;
pub mod expert;
pub mod export;
pub mod files;
pub mod heads;
pub mod image;
pub mod import;
pub mod latency;
pub mod loss;
pub mod manifest;
pub mod matmul;
pub mod mcu;
pub mod metrics;
pub mod neighbours;
pub mod nn;
pub mod optim;
pub mod pose64;
pub mod protocol;
#[cfg(feature = "publish")]
pub mod publish;
pub mod quantise;
pub mod random;
pub mod register;
pub mod replay;
pub mod report;
pub mod reward;
pub mod sweep;
pub mod thin;
pub mod trace;
pub mod train;
pub mod views;
