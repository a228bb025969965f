//! The settings of a case that studies vary, and the profiles, fluxes and propagators that they
//! compare.
//!
//! To vary another setting, add a line to [`CHOICES`]: advice then prints it as a `--set` option,
//! and the cost model distinguishes matrices that differ by it.

use crate::base::text::choice_text;
use crate::problem::case::{
    Alpha, Case, DEFAULT_ALPHA, DEFAULT_BETA, DEFAULT_ORDER, Method, ProfileChoice,
    PropagatorMethod,
};
use crate::study::grids::degree_settings;
use std::ops::RangeInclusive;

/// A choice of a case.
pub struct Choice {
    /// The key that `--set` takes.
    pub key: &'static str,
    /// The value of a case, as `--set` takes it.
    pub value: fn(&Case) -> String,
    /// The method that uses the choice; `None` if both do.
    pub method: Option<Method>,
    /// Whether the rows of `A` depend on it.
    pub rows: bool,
}

/// The interface law of degree 0; empty for elements, whose traces are coupled by energy.
fn interface(case: &Case) -> String {
    if case.is_galerkin() { String::new() } else { choice_text(&case.scheme.interface) }
}

/// The flux between elements; the upwind scheme of degree 0 has none.
fn flux(case: &Case) -> String {
    case.flux_of_elements().map_or(String::new(), |flux| flux.to_string())
}

/// All choices but elements and degree.
#[rustfmt::skip]
pub const CHOICES: [Choice; 6] = [
    Choice { key: "solver.method", value: |c| choice_text(&c.method), method: None, rows: false },
    Choice { key: "scheme.interface", value: interface, method: None, rows: true },
    Choice { key: "scheme.flux", value: flux, method: None, rows: true },
    Choice { key: "scheme.limiter", value: |c| choice_text(&c.scheme.limiter),
           method: None, rows: false },
    Choice { key: "solver.classical.integrator", value: |c| choice_text(&c.classical.integrator),
           method: Some(Method::Classical), rows: false },
    Choice { key: "solver.tolerance", value: |c| format!("{:e}", c.tolerance),
           method: Some(Method::Schrodingerized), rows: false },
];

/// Profiles that are compared, with their names. Comparisons of other choices use the first one.
pub static PROFILES: [(&str, ProfileChoice); 6] = [
    ("designed", ProfileChoice::Designed),
    ("gaussian", ProfileChoice::Gaussian { sigma: None }),
    ("smooth", ProfileChoice::Smooth { order: DEFAULT_ORDER }),
    ("low-somma", ProfileChoice::LowSomma { c: None }),
    ("acl", ProfileChoice::Acl { beta: DEFAULT_BETA }),
    ("exponential", ProfileChoice::Exponential { alpha: Alpha::Constant(DEFAULT_ALPHA) }),
];

/// Degrees that are compared.
pub const DEGREES: RangeInclusive<usize> = 0..=4;

/// A flux between elements that is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Flux {
    /// Upwind: `α = 1`.
    Upwind,
    /// Half of the dissipation of the upwind flux: `α = ½`.
    Half,
    /// A quarter of the dissipation of the upwind flux: `α = ¼`.
    Quarter,
}

impl Flux {
    /// The fluxes that are tried.
    pub const ALL: [Self; 3] = [Self::Upwind, Self::Half, Self::Quarter];

    /// The value of `scheme.flux`.
    pub fn alpha(self) -> f64 {
        match self {
            Self::Upwind => 1.0,
            Self::Half => 0.5,
            Self::Quarter => 0.25,
        }
    }
}

/// Propagators that are compared and meet a tolerance by themselves.
pub const EXACT_PROPAGATORS: [PropagatorMethod; 2] =
    [PropagatorMethod::Chebyshev, PropagatorMethod::Krylov];

/// Propagators that are compared and whose error is that of their time step.
pub const IMPLICIT_PROPAGATORS: [PropagatorMethod; 2] =
    [PropagatorMethod::CrankNicolson, PropagatorMethod::BackwardEuler];

/// The choices that determine the rows of `A`, in addition to grid and potential.
pub fn row_choices(case: &Case) -> String {
    let rows = CHOICES.iter().filter(|choice| choice.rows).map(|choice| (choice.value)(case));
    let degrees = case.space.axes().map(|axis| axis.nodes.degree.to_string());
    rows.chain(degrees).collect::<Vec<_>>().join(" ")
}

/// The `--set` options that give `case` the grid and the choices of `target`.
pub fn settings(case: &Case, target: &Case) -> Vec<String> {
    let mut set = Vec::new();
    for axis in 0..case.space.dimension() {
        let [own, new] = [case, target].map(|case| [&case.space.x[axis], &case.space.v[axis]]);
        for (name, (own, new)) in ["x", "v"].into_iter().zip(own.into_iter().zip(new)) {
            if own.elements() != new.elements() {
                set.push(format!("axis.{axis}.{name}.cells={}", new.elements()));
            }
        }
    }
    let degrees = |case: &Case| case.space.axes().map(|a| a.nodes.degree).collect::<Vec<_>>();
    if degrees(case) != degrees(target) {
        set.extend(degree_settings(case, target.space.degree()));
    }
    for choice in CHOICES.iter().filter(|k| k.method.is_none_or(|method| method == target.method)) {
        let value = (choice.value)(target);
        if !value.is_empty() && value != (choice.value)(case) {
            set.push(format!("{}={value}", choice.key));
        }
    }
    set
}

/// The `items` in their order, each once.
pub fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for item in items {
        if !found.contains(&item) {
            found.push(item);
        }
    }
    found
}
