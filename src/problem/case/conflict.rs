//! Conflicts between settings that studies vary: a case file with them is refused, and a chart
//! leaves them out.

use crate::problem::case::Case;
use crate::problem::case::scheme::Limiter;
use crate::problem::case::solver::Method;
use crate::problem::case::warp::Embedding;

/// A setting that contradicts another, and how to mend it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// The key of the setting.
    pub key: String,
    /// The reason why it is refused.
    pub reason: String,
    /// What to do, from a punctuation mark on; empty if the reason says so.
    pub remedy: String,
}

impl Conflict {
    fn new(key: impl Into<String>, reason: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { key: key.into(), reason: reason.into(), remedy: remedy.into() }
    }
}

impl Case {
    /// The first conflict between scheme, method, propagator, inflow and data; `None` if a case
    /// file may have these choices.
    pub fn conflict(&self) -> Option<Conflict> {
        let conflict = self.conflict_of_scheme().or_else(|| self.conflict_of_level_sets());
        conflict.or_else(|| self.conflict_of_propagator())
    }

    /// The conflict of the scheme's ends or its limiter with the inflow or the elements.
    fn conflict_of_scheme(&self) -> Option<Conflict> {
        if self.is_closed() && self.is_measure_valued() {
            return Some(Conflict::new(
                "scheme.ends",
                "level sets of measure-valued data enter through the ends",
                ": choose \"open\"",
            ));
        }
        if self.is_closed() && self.enters() {
            return Some(Conflict::new(
                "scheme.ends",
                "nothing enters through closed ends",
                ": leave inflow.value out, or choose \"open\"",
            ));
        }
        let key = "scheme.limiter";
        match self.scheme.limiter {
            Limiter::None => None,
            _ if self.is_galerkin() => Some(Conflict::new(
                key,
                "only the upwind scheme of degree 0 without partial reflection has limited slopes",
                format!(
                    "; leave it out, or leave out {}, scheme.flux and potential.reflection",
                    self.degree_keys(self.space.degree())
                ),
            )),
            _ if self.varies() => Some(Conflict::new(
                key,
                format!(
                    "slopes take the inflow at time 0; with t in {} only \"none\"",
                    self.inflow_key()
                ),
                "",
            )),
            _ => None,
        }
    }

    /// The conflict of measure-valued data with partial reflection, or with a velocity axis of
    /// degree 0 beside elements.
    fn conflict_of_level_sets(&self) -> Option<Conflict> {
        if !self.is_galerkin() || !self.is_measure_valued() {
            return None;
        }
        if let Some(i) = self.first_reflection() {
            return Some(Conflict::new(
                format!("potential.{i}.reflection"),
                "initial.velocity gives level sets, which cannot represent the two velocities \
                 behind a partial reflection",
                "; give initial.f",
            ));
        }
        if self.space.whole_degree() == 0 {
            let reason = "initial.velocity with a flux other than upwind takes elements of a \
                          degree of 1 or more";
            return Some(Conflict::new(
                "scheme.flux",
                reason,
                format!("; leave it out, or give {} above 0", self.degree_keys(0)),
            ));
        }
        let a = self.space.v.iter().position(|v| v.nodes.degree == 0)?;
        let reason = "initial.velocity with elements takes the zeros of polynomials in the \
                      velocity; a degree of 1 or more expected";
        Some(Conflict::new(format!("axis.{a}.v.degree"), reason, ""))
    }

    /// The conflict of the propagator of a mode with the inflow.
    fn conflict_of_propagator(&self) -> Option<Conflict> {
        if self.method == Method::Classical {
            return None;
        }
        let key = "solver.propagator.method";
        let propagator = self.propagator.method;
        if self.varies() && !propagator.takes_varying_inflow() {
            let inflow = self.inflow_key();
            let reason = format!(
                "with t in {inflow} the generator depends on time, which only \"chebyshev\" \
                 supports"
            );
            return Some(Conflict::new(key, reason, ""));
        }
        let is_scalar = self.warp.inflow == Embedding::Scalar && self.enters();
        (is_scalar && !propagator.takes_scalar_inflow()).then(|| {
            Conflict::new(
                key,
                "solver.warp.inflow = \"scalar\" couples one unknown to all rows, which only \
                 \"chebyshev\" supports",
                "; choose that, or solver.warp.inflow = \"boundary\" or \"full\"",
            )
        })
    }

    /// The number of the first region that reflects part of the particles.
    pub(super) fn first_reflection(&self) -> Option<usize> {
        self.potential.iter().position(|region| region.reflection.is_some())
    }
}
