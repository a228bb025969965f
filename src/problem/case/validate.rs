//! Refuses settings of a case that contradict each other.

use crate::base::error::Result;
use crate::problem::case::Case;
use crate::problem::case::conflict::Conflict;
use crate::problem::case::exact::Exact;
use crate::problem::case::file::CaseFile;
use crate::problem::case::scheme::Limiter;
use crate::problem::case::solver::{Integrator, Method};
use crate::problem::case::warp::{Coefficients, Delta, Embedding, ProfileChoice, Shift};

impl Case {
    /// Refuses settings that contradict each other, and sets those that follow from others.
    pub(super) fn validate(&mut self, file: &CaseFile<'_>) -> Result<()> {
        if self.method == Method::Classical {
            // The classical method has no embedding of the inflow.
            (self.warp.inflow, self.warp.delta) = (Embedding::Boundary, Delta::Planned);
        }
        self.warp.check_embedding(file, &self.fields)?;
        self.check_limiter(file)?;
        if self.is_galerkin() {
            self.check_galerkin(file)?;
        }
        if self.varies() {
            self.check_output_of_varying_inflow(file)?;
        }
        if let Some(Conflict { key, reason, remedy }) = self.conflict() {
            return file.refuse(&key, reason + &remedy);
        }
        if self.output.positive {
            self.check_positive(file)?;
        }
        if self.warped_start.is_some() {
            self.check_warped_start(file)?;
        }
        if !self.reduce.modes && self.method == Method::Schrodingerized {
            self.check_every_mode(file)?;
        }
        if self.output.warped_field && self.method == Method::Classical {
            return file.refuse(
                "output.warped_field",
                "solver.method = \"classical\" has no modes; leave it out, or choose \
                 \"schrodingerized\"",
            );
        }
        Ok(())
    }

    /// Refuses a limiter, which is not linear, if the method needs `A` as a matrix.
    fn check_limiter(&self, file: &CaseFile<'_>) -> Result<()> {
        if self.scheme.limiter == Limiter::None {
            return Ok(());
        }
        let key = "scheme.limiter";
        let wanted = "solver.method = \"classical\" with solver.classical.integrator = \
                      \"ssp-rk3\" or \"forward-euler\" takes one";
        let conflict = if self.method == Method::Schrodingerized {
            "solver.method = \"schrodingerized\" evolves a linear system, and slopes are not linear"
        } else if self.classical.integrator == Integrator::Exponential {
            "solver.classical.integrator = \"exponential\" solves a linear system, and slopes are \
             not linear"
        } else if self.verify {
            return file.refuse(
                key,
                "solver.verify = true measures the distance to exp(A T) f0, but a limiter makes \
                 the system nonlinear; set one of them to its default",
            );
        } else {
            return Ok(());
        };
        file.refuse(key, format!("{conflict}; {wanted}, or leave limiter = \"none\""))
    }

    /// Refuses settings that elements, of any degree, or partial reflection do not support.
    fn check_galerkin(&self, file: &CaseFile<'_>) -> Result<()> {
        if let (Some(i), Some(Exact::Characteristics)) = (self.first_reflection(), &self.exact) {
            return file.refuse(
                &format!("potential.{i}.reflection"),
                "a particle that is reflected in part has no single characteristic; give exact.f, \
                 or no [exact]",
            );
        }
        let key = "output.delta_width";
        if self.is_measure_valued() && file.has(key) {
            return file.refuse(
                key,
                "is the width of the discrete delta function of degree 0; elements have none, \
                 leave it out",
            );
        }
        Ok(())
    }

    /// Refuses `output.positive` if no field can be scaled, and if more than the field at the end
    /// is asked for.
    fn check_positive(&self, file: &CaseFile<'_>) -> Result<()> {
        let conflict = if self.space.degree() == 0 {
            let keys = self.degree_keys(0);
            return file.refuse(
                "output.positive",
                format!(
                    "a cell of degree 0 has one value, its average, which is kept: there is \
                     nothing to scale; leave it out, or choose {keys} above 0"
                ),
            );
        } else if self.shown_times().next().is_some() {
            "limits the field at the end only; leave it or the output times out"
        } else if self.readout.is_some() {
            "limits what is written, not the state that [readout] measures; leave one of them out"
        } else {
            return Ok(());
        };
        file.refuse("output.positive", conflict)
    }

    /// Refuses results before the end, which an inflow that depends on time does not support.
    fn check_output_of_varying_inflow(&self, file: &CaseFile<'_>) -> Result<()> {
        let timed = [
            "output.moments_every", "output.moment_times", "output.field_times",
            "output.fields_every",
        ];
        let Some(key) = timed.into_iter().find(|key| file.has(key)) else { return Ok(()) };
        let message = "results are written at time.end only; leave it out";
        file.refuse(key, format!("with t in {} {message}", self.inflow_key()))
    }

    /// Refuses settings that contradict `initial.warped`.
    fn check_warped_start(&self, file: &CaseFile<'_>) -> Result<()> {
        let refuse = |why: &str| file.refuse("initial.warped", why);
        if self.method == Method::Classical {
            return refuse("solver.method = \"classical\" has no p; choose \"schrodingerized\"");
        }
        if self.enters() {
            let inflow = self.inflow_key();
            return refuse(&format!(
                "nothing may enter, as the file has no auxiliary unknowns: leave {inflow} out, or \
                 set it to 0"
            ));
        }
        if self.traces_exact() {
            return refuse(
                "exact.kind = \"characteristics\" needs initial.f; leave it out, or give exact.f",
            );
        }
        if self.verify {
            return file
                .refuse("solver.verify", "needs initial.f; with initial.warped leave it out");
        }
        let warp = &self.warp;
        let given = [
            ("profile", warp.profile != ProfileChoice::Planned),
            ("coefficients", warp.coefficients != Coefficients::Analytic),
            ("interval", warp.interval.is_some()),
            ("points", warp.points.is_some()),
            ("shift", warp.shift != Shift::Given(0.0)),
        ];
        match given.into_iter().find(|(_, given)| *given) {
            Some((key, _)) => file.refuse(
                &format!("solver.warp.{key}"),
                "with initial.warped the file gives w at every p; leave it out",
            ),
            None => Ok(()),
        }
    }

    /// Refuses modes of both signs where only `l ≥ 0` are supported. If they follow from
    /// `solver.reduce = false`, `l ≥ 0` are used.
    fn check_every_mode(&mut self, file: &CaseFile<'_>) -> Result<()> {
        let why = if self.output.warped_field || self.warped_start.is_some() {
            "the warped field is kept by its modes l >= 0"
        } else if self.propagator.method.order() > 0 {
            "crank-nicolson and backward-euler take modes l >= 0 only"
        } else {
            return Ok(());
        };
        let key = "solver.reduce.modes";
        if file.has(key) {
            return file.refuse(key, format!("{why}; leave it out, or set it to true"));
        }
        self.reduce.modes = true;
        Ok(())
    }
}
