//! What the benches of the fused step share.

use phasewarp::matrix::lanes::{LANES, StepConstants};
use phasewarp::problem::case::Case;

/// A case of the repository, with settings.
pub fn load(case: &str, set: &[String]) -> Case {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cases").join(case);
    Case::load(&path, set).expect("a case of the repository")
}

/// Constants with which repeated steps neither grow nor vanish soon.
pub fn constants() -> StepConstants {
    StepConstants {
        scale: [1e-3; LANES],
        shift: [0.1; LANES],
        wavenumber: std::array::from_fn(|l| 0.1 * l as f64),
        coefficient: [1e-3; LANES],
    }
}
