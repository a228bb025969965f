//! The case as sweeps take it: without what only output is made of, and on fewer cells.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Interface, Limiter, Method};
use crate::problem::potential::overlooked;
use crate::solve::prepared::Prepared;
use crate::solve::spectrum;
use crate::study::trial::ranks;

/// Most Lanczos steps.
const LANCZOS: usize = 4000;

/// The case without what is written, compared and measured besides.
pub fn plain(case: &Case) -> Case {
    Case {
        plateau: None,
        times: Vec::new(),
        warped_field: false,
        readout: None,
        verify: false,
        exact: None,
        limiter: Limiter::None,
        method: Method::Schrodingerized,
        ..case.clone()
    }
}

/// What is said where a panel was measured on fewer cells than the case has.
pub fn note(case: &Case, used: &Case) -> Vec<String> {
    let (shape, coarse) = (case.space.shape(), used.space.shape());
    let text = |shape: &[usize]| {
        let cells: Vec<String> = shape.iter().map(usize::to_string).collect();
        cells.join(" x ")
    };
    let mut notes = Vec::new();
    if shape != coarse {
        notes.push(format!(
            "measured on {} cells instead of {}",
            text(&coarse),
            text(&shape)
        ));
    }
    let found = overlooked(used);
    if found.edges.len() + found.empty.len() > overlooked(case).edges.len() {
        notes.push("the edges of V lie on other faces there".to_owned());
    }
    notes
}

/// `case` with `factor` times its potential.
pub fn with_potential_times(case: &Case, factor: f64) -> Case {
    let mut case = case.clone();
    for region in &mut case.potential {
        region.value = region.value.times(factor);
    }
    case
}

/// `case` with an interface, and weights if so.
pub fn with_interface(case: &Case, interface: Interface, weights: bool) -> Case {
    let mut case = case.clone();
    case.interface = interface;
    case.warp.weights = weights;
    case
}

/// `case` assembled on the ranks there are. Collective.
///
/// # Errors
/// As [`Prepared::new`].
pub fn assembled(world: &World, case: &Case) -> Result<Prepared> {
    Prepared::new(world, case, &ranks(world))
}

/// `λ⁺` of an assembled case. Collective.
///
/// # Errors
/// As [`spectrum::of`].
pub fn growth(found: &mut Prepared) -> Result<f64> {
    let space = &found.communicator.space;
    let (extremes, _) = spectrum::of(&mut found.system, space, LANCZOS)?;
    Ok(extremes.highest.value)
}

/// What a search for a border came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Located {
    /// The last number that is still right.
    At(f64),
    /// The first that was tried is not.
    Below(f64),
    /// The last that was tried is.
    Beyond(f64),
    /// The budget ended before it was known.
    Unknown,
}

impl Located {
    /// Where it is, if it was found.
    pub fn at(self) -> Option<f64> {
        match self {
            Self::At(x) => Some(x),
            _ => None,
        }
    }
}

impl std::fmt::Display for Located {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::At(x) => write!(out, "{x:.3}"),
            Self::Below(x) => write!(out, "something below {x}"),
            Self::Beyond(x) => write!(out, "something beyond {x}"),
            Self::Unknown => out.write_str("(not located within the budget)"),
        }
    }
}

/// The last number between `low` and `high` of which `found` still says yes, by so many halvings. Of `over`, which is asked before each, and of
/// `found` the answers are the same on all ranks. Collective.
pub fn border(
    (mut low, mut high): (f64, f64),
    halvings: usize,
    over: impl Fn() -> bool,
    mut found: impl FnMut(f64) -> bool,
) -> Located {
    if over() {
        return Located::Unknown;
    }
    if !found(low) {
        return Located::Below(low);
    }
    if found(high) {
        return Located::Beyond(high);
    }
    for _ in 0..halvings {
        if over() {
            return Located::Unknown;
        }
        let middle = 0.5 * (low + high);
        if found(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Located::At(0.5 * (low + high))
}
