//! Names of fleets and robots on command lines.

use reagent_core::Error;
use reagent_core::wire::keys;

/// Refuses text that is no name of a fleet or robot.
///
/// # Errors
/// What a name must look like.
pub fn name(text: &str) -> Result<String, Error> {
    keys::manifest(text).map(|_| text.into())
}
