//! The Python package `reagent`: what `host-train register` does, on arrays.

mod arguments;
mod array;
mod cloud;
mod clouds;
mod depth;
mod error;
mod evaluate;
mod functions;
mod json;
mod mesh;
mod options;
mod policy;
mod registrar;
mod registration;
mod step;
mod tracker;
mod undetermined;

use pyo3::pymodule;

/// Registers an observed point cloud to a model in about ten discrete, interpretable steps, and says how likely the pose is
/// right.
///
/// >>> import numpy, reagent
/// >>> rng = numpy.random.default_rng(1)
/// >>> target = rng.normal(size=(1000, 3)) * [3, 2, 1]
/// >>> turn = numpy.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
/// >>> found = reagent.register(target @ turn + [0.1, 0, 0], target)
/// >>> found.converged and found.probability > 0.9
/// True
/// >>> numpy.allclose(found.target_from_source[:3, :3], turn, atol=1e-4)
/// True
#[pymodule(name = "reagent")]
mod module {
    #[pymodule_export]
    use crate::depth::points_of_depth;
    #[pymodule_export]
    use crate::error::{CloudError, Error, PolicyError};
    #[pymodule_export]
    use crate::evaluate::evaluate;
    #[pymodule_export]
    use crate::functions::{refine, register, register_batch, register_depth, verify};
    #[pymodule_export]
    use crate::mesh::Mesh;
    #[pymodule_export]
    use crate::policy::Policy;
    #[pymodule_export]
    use crate::registrar::Registrar;
    #[pymodule_export]
    use crate::registration::{Other, Registration};
    #[pymodule_export]
    use crate::step::Step;
    #[pymodule_export]
    use crate::tracker::Tracker;
    #[pymodule_export]
    use crate::undetermined::{Axis, Fold, Slide, Undetermined};
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
