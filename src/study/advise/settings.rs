//! The settings and the command that lead from a case file to a set-up.

use crate::base::error::Result;
use crate::base::text::quoted;
use crate::problem::case::reader::key_of;
use crate::problem::case::{Case, Limiter, Method};
use crate::study::choices;
use crate::study::trial::final_fields_only;

/// Settings of a Schrödingerized run in which everything is planned.
const DEFAULTS: [&str; 6] = [
    "solver.method=schrodingerized",
    "scheme.limiter=none",
    "solver.verify=false",
    "solver.warp={}",
    "solver.propagator={}",
    "output.warped_field=false",
];

/// `case` by Schrödingerization with every choice planned, and no output but the final fields: the
/// base of all trials.
///
/// # Errors
/// As [`Case::parse`].
pub fn base_case(case: &Case) -> Result<Case> {
    let mut set = case.overrides.clone();
    set.extend(DEFAULTS.map(str::to_owned));
    let planned = Case::parse(&case.name, &case.text, &set)?.with_tables_of(case);
    Ok(Case { exact: None, ..final_fields_only(&planned) })
}

/// The `--set` options that turn `case` into `target`. `base` is [`base_case`] of `case`.
pub fn settings(case: &Case, base: &Case, target: &Case) -> Vec<String> {
    let mut set = choices::settings(case, target);
    let limited = case.output.positive && !target.output.positive;
    let resets = match target.method {
        Method::Classical => [
            ("solver.verify=false", case.verify && target.scheme.limiter != Limiter::None),
            ("output.warped_field=false", case.output.warped_field),
            ("output.positive=false", limited),
        ],
        Method::Schrodingerized => {
            // A classical case does not hold the values of its Schrödingerization tables.
            let hidden = case.method == Method::Classical
                && case.settings.keys().any(|key| key.starts_with("solver.warp"));
            [
                ("solver.warp={}", hidden || case.warp != base.warp),
                ("solver.propagator={}", case.propagator != base.propagator),
                ("output.positive=false", limited),
            ]
        }
    };
    set.extend(
        resets.into_iter().filter(|(_, differs)| *differs).map(|(reset, _)| reset.to_owned()),
    );
    set
}

/// `phasewarp run` with `settings`, to be pasted into a shell.
pub fn command(case: &Case, settings: &[String]) -> String {
    let replaced = |old: &&String| settings.iter().any(|new| key_of(new) == key_of(old));
    let kept = case.overrides.iter().filter(|old| !replaced(old));
    let mut text = format!("phasewarp run {}", quoted(&case.name));
    for set in kept.chain(settings) {
        text += &format!(" --set {}", quoted(set));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::case::{Integrator, Interface};
    use crate::study::advise::scheme::SchemeChoice;

    #[test]
    fn settings_lead_from_a_case_to_the_target() {
        let text = r#"
            axis = [
            { x = { lower = -1, upper = 1, cells = 20 }, v = { lower = -1, upper = 1, cells = 20 } }
            ]
            potential = [{ where = "x < 0", value = "0.1" }, { value = "0" }]
            initial.f = "exp(-20*(x^2 + v^2))"
            time.end = 0.5
            solver.tolerance = 1e-5
            solver.warp = { profile = "smooth", order = 4 }
            solver.propagator = { method = "crank-nicolson", step = 0.1 }
        "#;
        let read = |set: &[String]| Case::parse("case.toml", text, set);
        let case = read(&["axis.0.v.cells=24".to_owned()]).unwrap();
        let base = base_case(&case).unwrap();
        for interface in Interface::ALL {
            let scheme = SchemeChoice { interface, limiter: Limiter::None, degree: 0, flux: None };
            let mut target = scheme.schrodingerized(&base, &[40, 36]);
            target.tolerance = 3e-4;
            let set = settings(&case, &base, &target);
            let found = read(&set).unwrap();
            assert_eq!(found.space, target.space);
            assert_eq!((found.scheme.interface, found.tolerance), (interface, 3e-4));
            assert_eq!((&found.warp, &found.propagator), (&base.warp, &base.propagator));
            let command = command(&case, &set);
            assert!(command.contains("--set 'solver.warp={}'"), "{command}");
            assert!(!command.contains("cells=24"), "{command}");
        }
        let limiter = Limiter::VanLeer;
        let scheme = SchemeChoice { interface: Interface::Hat, limiter, degree: 0, flux: None };
        let found = read(&settings(&case, &base, &scheme.classical(&base, &[40, 36]))).unwrap();
        assert_eq!(
            (found.method, found.scheme.limiter, found.classical.integrator),
            (Method::Classical, Limiter::VanLeer, Integrator::SspRk3)
        );
    }
}
