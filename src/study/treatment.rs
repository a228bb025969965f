//! Treatments of the growth at a jump of `V`: an interface law, with or without weights.

use crate::base::text::choice_text;
use crate::problem::case::{Case, Interface};
use crate::scheme::interface::law_of;

/// An interface law, and whether the unknowns are weighted against the growth that it allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Treatment {
    /// The interface law.
    pub interface: Interface,
    /// Whether weights are dissipative.
    pub weights: bool,
}

impl Treatment {
    /// All treatments: each law without weights, then each law that allows growth with them.
    pub fn all() -> Vec<Self> {
        let of_law = |interface| [false, true].map(|weights| Self { interface, weights });
        let all = Interface::ALL.into_iter().flat_map(of_law);
        all.filter(|treatment| !treatment.weights || treatment.has_growing_law()).collect()
    }

    /// All treatments, as [`all`](Self::all), with those that prevent growth first.
    pub fn by_growth() -> Vec<Self> {
        let mut all = Self::all();
        all.sort_by_key(|treatment| treatment.may_grow());
        all
    }

    /// Whether its law allows growth, weighted or not.
    pub fn has_growing_law(self) -> bool {
        law_of(self.interface).may_grow()
    }

    /// Whether `λ⁺ > 0` is possible: neither the law nor weights prevent it.
    pub fn may_grow(self) -> bool {
        !self.weights && self.has_growing_law()
    }

    /// `case` with this treatment.
    pub fn of(self, case: &Case) -> Case {
        let mut case = case.clone();
        case.scheme.interface = self.interface;
        case.warp.weights = self.weights;
        case
    }

    /// The treatment in words.
    pub fn name(self) -> String {
        let law = choice_text(&self.interface);
        match (self.has_growing_law(), self.weights) {
            (false, _) => law,
            (true, true) => format!("{law}, dissipative weights"),
            (true, false) => format!("{law}, no weights"),
        }
    }
}
