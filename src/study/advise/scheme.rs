//! Semi-discrete schemes that advice compares.

use crate::base::text::word;
use crate::problem::case::{Case, Integrator, Interface, Limiter, Method};
use crate::study::grids::on_grid;
use crate::study::treatment::Treatment;

/// A semi-discrete scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Scheme {
    /// Interface rows.
    pub interface: Interface,
    /// Slopes.
    pub limiter: Limiter,
}

impl Scheme {
    /// That of `case`. Schrödingerization has no slopes.
    pub fn of(case: &Case) -> Self {
        let limiter = match case.method {
            Method::Classical => case.limiter,
            Method::Schrodingerized => Limiter::None,
        };
        Self { interface: case.interface, limiter }
    }

    /// The schemes that are tried for `case`: its own interface first, others where `V` jumps, then
    /// slopes where the inflow does not depend on time.
    pub fn candidates(case: &Case, jumps: bool) -> Vec<Self> {
        let own = case.interface;
        let others = Interface::ALL.into_iter().filter(|&other| jumps && other != own);
        let without = |interface| Self { interface, limiter: Limiter::None };
        let mut schemes: Vec<Self> = [own].into_iter().chain(others).map(without).collect();
        if !case.varies() {
            let slopes = [Limiter::Minmod, Limiter::VanLeer];
            schemes.extend(slopes.map(|limiter| Self { interface: own, limiter }));
        }
        schemes
    }

    /// `case` on `shape` cells by this scheme, without Schrödingerization.
    pub fn classical(self, case: &Case, shape: &[usize]) -> Case {
        Case {
            method: Method::Classical,
            limiter: self.limiter,
            integrator: match self.limiter {
                Limiter::None => Integrator::Exponential,
                _ => Integrator::SspRk3,
            },
            ..self.schrodingerized(case, shape)
        }
    }

    /// `case` on `shape` cells by this scheme's interface.
    pub fn schrodingerized(self, case: &Case, shape: &[usize]) -> Case {
        Case { interface: self.interface, ..on_grid(case, shape) }
    }

    /// The scheme by `method` in words; the interface where `V` jumps.
    pub fn name(self, method: Method, jumps: bool) -> String {
        let mut name = match (method, self.limiter) {
            (Method::Schrodingerized, _) => "Schrödingerized",
            (Method::Classical, Limiter::None) => "classical, exponential",
            (Method::Classical, Limiter::Minmod) => "classical, SSP-RK3 with minmod slopes",
            (Method::Classical, Limiter::VanLeer) => "classical, SSP-RK3 with van Leer slopes",
        }
        .to_owned();
        if jumps {
            name += &format!(", {} interface", word(&self.interface));
            let unweighted = Treatment { interface: self.interface, weights: false };
            if method == Method::Schrodingerized && unweighted.may_grow() {
                name += " and weights";
            }
        }
        name
    }
}
