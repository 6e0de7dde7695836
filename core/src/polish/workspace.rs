//! Working memory of a refiner.

use super::sample::Sample;
use crate::error::Error;
use crate::facing::Facing;
use crate::freespace::DepthGrid;
use crate::kernels::Isa;
use crate::loss::Losses;
use crate::model::Model;
use crate::surface::Surface;
use crate::surface::matching::Matching;

/// Working memory of a [`super::Refiner`], [`crate::budget::WORKSPACE_BYTES`]; the caller owns it.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// Kernels of the refiners that work in it; `None` for the fastest.
    isa: Option<Isa>,
    /// The last target that the caller had not prepared.
    pub(super) model: Model,
    pub(super) work: Work,
}

/// The working memory without a target: what changes with each source and pose.
#[derive(Clone, Debug)]
pub(super) struct Work {
    pub(super) source: Surface,
    pub(super) sample: Sample,
    /// Matches of the source's points, and of the target's.
    pub(super) of_source: Matching,
    pub(super) of_target: Matching,
    pub(super) losses: Losses,
    pub(super) seen: DepthGrid,
    pub(super) facing: Facing,
}

impl Workspace {
    /// Empty working memory.
    pub const fn new() -> Self {
        Workspace {
            isa: None,
            model: Model::new(),
            work: Work {
                source: Surface::EMPTY,
                sample: Sample::EMPTY,
                of_source: Matching::EMPTY,
                of_target: Matching::EMPTY,
                losses: Losses::EMPTY,
                seen: DepthGrid::EMPTY,
                facing: Facing::UNKNOWN,
            },
        }
    }

    /// Empty working memory for given kernels.
    pub const fn with_isa(isa: Isa) -> Self {
        let mut workspace = Workspace::new();
        workspace.isa = Some(isa);
        workspace
    }

    /// Prepares a target for any number of registrations. The workspace keeps the last target prepared by itself: this serves
    /// several targets in use at a time.
    ///
    /// # Errors
    /// As [`crate::frame::check_cloud`] and [`crate::Frame::of`]; the model then has no target.
    pub fn prepare(&mut self, target: &[[f32; 3]], model: &mut Model) -> Result<(), Error> {
        model.prepare(self.isa(), target, &mut self.work.of_target.keys)
    }

    pub(super) fn isa(&self) -> Isa {
        self.isa.unwrap_or_else(Isa::best)
    }
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}
