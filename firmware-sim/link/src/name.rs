//! Names of fleets and robots as command lines take them.

use reagent_core::Error;
use reagent_core::wire::keys;

/// Refuses what is no name of a fleet or robot.
///
/// # Errors
/// What a name looks like.
pub fn name(text: &str) -> Result<String, Error> {
    keys::manifest(text).map(|_| text.into())
}
