//! The workstation side of ReAgent: data, training, evaluation, export and publishing.
//!
//! Data flows one way: `dataset` reads clouds, `learn` trains a policy on them, `policy` makes it a file,
//! `measure` and `register` run it, `report` draws what came of it, and `publish` hands it to the fleet.
#![doc = "\n"]
#![doc = include_str!("../README.md")]

#[macro_use]
extern crate reagent_link;

pub mod augment;
pub mod bop;
pub mod calibrate;
pub mod cli;
pub mod dataset;
pub mod files;
pub mod learn;
pub mod measure;
pub mod neighbours;
pub mod policy;
pub mod pose64;
pub mod protocol;
#[cfg(feature = "publish")]
pub mod publish;
pub mod random;
pub mod register;
pub mod report;
pub mod views;
