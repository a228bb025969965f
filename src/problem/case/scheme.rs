//! `[scheme]`: interface law, numerical fluxes and slope limiter.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::case::potential::Region;
use crate::problem::grid::PhaseSpace;
use serde::{Deserialize, Serialize};

/// Default of `scheme.flux` for a degree above 0; for degree 0 it is 1. It has half of the
/// dissipation of the upwind flux and hardly more error (docs/high-order.md).
pub const DEFAULT_FLUX: f64 = 0.5;

/// The interface law: how the Hamiltonian-preserving flux at a jump of `V` combines values on the
/// side from which particles come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interface {
    /// Linear interpolation at the source velocity (the paper's).
    #[default]
    Hat,
    /// Overlap of energy intervals, which conserves row sums and flux-weighted column sums.
    Conservative,
}

impl Interface {
    /// All laws.
    pub const ALL: [Self; 2] = [Self::Hat, Self::Conservative];
}

/// The numerical flux at the ends of the box, in space and in velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EndFlux {
    /// Upwind: outflow is lost, data outside the box enter.
    #[default]
    Open,
    /// The flux between elements, with zero outside. With the central flux nothing is lost: waves
    /// that reach an end return as waves that the grid does not resolve.
    Closed,
}

/// Slope limiter of the classical method (paper, the remark after section 4.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Limiter {
    /// No limiter: the scheme of first order.
    #[default]
    None,
    /// `ψ(θ) = max(0, min(1, θ))`.
    Minmod,
    /// `ψ(θ) = (|θ| + θ)/(1 + |θ|)`.
    VanLeer,
}

/// `[scheme]`: the settings of the scheme in phase space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SchemeSettings {
    /// `scheme.interface`: the law of transmission and reflection at a jump of `V`.
    pub interface: Interface,
    /// Whether the case file gives `scheme.interface`.
    pub names_interface: bool,
    /// `scheme.flux`: `α` of the numerical flux between elements, 1 upwind, 0 central.
    pub flux: f64,
    /// `scheme.ends`: the numerical flux at the ends of the box.
    pub ends: EndFlux,
    /// `scheme.limiter`: the slope limiter of the classical method.
    pub limiter: Limiter,
}

/// `[scheme]` as it is written.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub struct SchemeTable {
    interface: Option<Interface>,
    limiter: Limiter,
    /// `degree`: the default for every axis.
    pub degree: i64,
    flux: Option<f64>,
    ends: EndFlux,
}

impl SchemeTable {
    /// The settings of the scheme on the grid `space`, with `V` in the regions `potential`.
    pub fn check(
        &self,
        file: &CaseFile<'_>,
        space: &PhaseSpace,
        potential: &[Region],
    ) -> Result<SchemeSettings> {
        let flux = self.flux(file, space.degree())?;
        let reflects = potential.iter().any(|region| region.reflection.is_some());
        Ok(SchemeSettings {
            interface: self.law(space.degree() > 0 || reflects || flux < 1.0),
            names_interface: self.interface.is_some(),
            flux,
            ends: self.ends,
            limiter: self.limiter,
        })
    }

    /// The interface law of the upwind scheme of degree 0. A scheme that couples traces by energy
    /// has no such law. It conserves what the law `conservative` does, so it is reported by that
    /// name.
    fn law(&self, couples_by_energy: bool) -> Interface {
        if couples_by_energy { Interface::Conservative } else { self.interface.unwrap_or_default() }
    }

    /// The parameter `α` of the numerical flux between elements, from 0 (central) to 1 (upwind).
    fn flux(&self, file: &CaseFile<'_>, degree: usize) -> Result<f64> {
        match self.flux {
            Some(flux) => file.between("scheme.flux", flux, [0.0, 1.0]),
            None if degree == 0 => Ok(1.0),
            None => Ok(DEFAULT_FLUX),
        }
    }
}
