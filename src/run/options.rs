//! The options of a run.

use crate::problem::case::Case;
use crate::results::chosen_setup::ChosenSetup;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Options of `phasewarp run`.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Blocks along each x-axis (`--ranks-x`).
    pub ranks_x: Option<Vec<usize>>,
    /// Whether to continue from a checkpoint (`--resume`).
    pub resume: bool,
    /// Whether results of this case that another process finishes meanwhile are kept; so with
    /// `resume`.
    pub keeps_finished: bool,
    /// Whether to replace whatever the directory holds (`--force`).
    pub force: bool,
    /// What was chosen for the accuracy of the case, to be stored beside the results.
    pub chosen: Option<ChosenSetup>,
    /// Time since the start of the program after which to stop with a checkpoint (`--walltime`).
    pub walltime: Option<Duration>,
    /// The flag that is set from outside when the run is to stop with a checkpoint.
    pub stop: Arc<AtomicBool>,
}

/// The result directory of a run, and its options.
#[derive(Clone, Copy)]
pub struct Output<'a> {
    /// The case as the user gave it.
    pub given: &'a Case,
    /// The result directory.
    pub directory: &'a Path,
    /// The options.
    pub options: &'a Options,
}
