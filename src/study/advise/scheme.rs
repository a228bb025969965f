//! Semi-discrete schemes that advice compares.

use crate::base::text::choice_text;
use crate::problem::case::{Case, Integrator, Interface, Limiter, Method, SchemeSettings};
use crate::scheme::interface::law_of;
use crate::study::choices::{DEGREES, Flux};
use crate::study::grids::on_grid;
use crate::study::order::OrderRange;

/// A semi-discrete scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct SchemeChoice {
    /// Interface law, of degree 0.
    pub interface: Interface,
    /// Slope limiter, of degree 0.
    pub limiter: Limiter,
    /// Degree of the elements.
    pub degree: usize,
    /// Flux between elements, if it is not that of the case with elements of this degree.
    pub flux: Option<Flux>,
}

impl SchemeChoice {
    /// The scheme of `case`; Schrödingerization has no slopes.
    pub fn of(case: &Case) -> Self {
        let limiter = match case.method {
            Method::Classical => case.scheme.limiter,
            Method::Schrodingerized => Limiter::None,
        };
        Self { interface: case.scheme.interface, limiter, degree: case.space.degree(), flux: None }
    }

    /// The schemes that are tried for `case`: its own, and other degrees. With the upwind scheme of
    /// degree 0 also other interface laws, if `V` jumps, and slopes, if the inflow does not depend
    /// on time.
    pub fn candidates(case: &Case, jumps: bool) -> Vec<Self> {
        let own = Self { limiter: Limiter::None, ..Self::of(case) };
        let mut schemes = vec![own];
        let mut add = |scheme: Self| {
            if !schemes.contains(&scheme) {
                schemes.push(scheme);
            }
        };
        let elements = Self { interface: Interface::Conservative, ..own };
        DEGREES.skip(1).for_each(|degree| add(Self { degree, ..elements }));
        if !case.has_upwind_cells() {
            add(Self { degree: 0, ..elements });
            return schemes;
        }
        let laws = Interface::ALL.into_iter().filter(|&law| jumps || law == own.interface);
        laws.for_each(|interface| add(Self { interface, degree: 0, ..own }));
        if !case.varies() {
            let slopes = [Limiter::Minmod, Limiter::VanLeer];
            slopes.into_iter().for_each(|limiter| add(Self { limiter, degree: 0, ..own }));
        }
        schemes
    }

    /// The orders in the elements' width that its errors may show. The lowest is that of
    /// discontinuous data in L1, `(k + 1)/(k + 2)`. The highest is one more than that of smooth
    /// data, `k + 1`. Slopes count as degree 1.
    pub fn orders(self) -> OrderRange {
        let k = if self.limiter == Limiter::None { self.degree } else { 1 } as f64;
        let most = if self.limiter == Limiter::None { k + 2.0 } else { 2.0 };
        OrderRange { least: (k + 1.0) / (k + 2.0), most }
    }

    /// A classical run of this scheme on `shape` elements. `case` has elements of its degree.
    pub fn classical(self, case: &Case, shape: &[usize]) -> Case {
        let mut case = self.schrodingerized(case, shape);
        case.method = Method::Classical;
        case.scheme.limiter = self.limiter;
        case.classical.integrator = match self.limiter {
            Limiter::None => Integrator::Exponential,
            _ => Integrator::SspRk3,
        };
        case
    }

    /// `case`, which has elements of this scheme's degree, with its interface and flux on `shape`.
    pub fn schrodingerized(self, case: &Case, shape: &[usize]) -> Case {
        let flux = self.flux.map_or(case.scheme.flux, Flux::alpha);
        let scheme = SchemeSettings { interface: self.interface, flux, ..case.scheme };
        Case { scheme, ..on_grid(case, shape) }
    }

    /// This scheme with each flux but `own`. Degree 0 has no other flux.
    pub fn other_fluxes(self, own: f64) -> impl Iterator<Item = Self> + use<> {
        let elements = self.degree > 0;
        let fluxes = Flux::ALL.into_iter().filter(move |flux| elements && flux.alpha() != own);
        fluxes.map(move |flux| Self { flux: Some(flux), ..self })
    }

    /// Name of the scheme by `method`; with the interface law, if `V` jumps.
    pub fn name(self, method: Method, jumps: bool) -> String {
        if self.degree > 0 {
            let by =
                if method == Method::Schrodingerized { "Schrödingerized" } else { "classical" };
            let flux = self.flux.map_or(String::new(), |f| format!(", flux {}", f.alpha()));
            return format!("{by}, elements of degree {}{flux}", self.degree);
        }
        let mut name = match (method, self.limiter) {
            (Method::Schrodingerized, _) => "Schrödingerized",
            (Method::Classical, Limiter::None) => "classical, exponential",
            (Method::Classical, Limiter::Minmod) => "classical, SSP-RK3 with minmod slopes",
            (Method::Classical, Limiter::VanLeer) => "classical, SSP-RK3 with van Leer slopes",
        }
        .to_owned();
        if jumps {
            name += &format!(", {} interface", choice_text(&self.interface));
            if method == Method::Schrodingerized && law_of(self.interface).may_grow() {
                name += " and weights";
            }
        }
        name
    }
}
