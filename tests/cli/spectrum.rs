//! `phasewarp spectrum`: the extreme eigenvalues of the symmetric part, on refined grids, with
//! inflow, and within their bounds.

use crate::support::{
    Finished, Job, at_most, case, cases, check_all, near, of_case, require, shrunk,
};

/// The number after `key` in the output of `phasewarp spectrum` for the matrix `label`.
fn spectrum_number(finished: &Finished, label: &str, key: &str) -> Result<f64, String> {
    let mut lines = finished.output.lines().skip_while(|line| !line.starts_with(label));
    let line = lines.find(|line| line.starts_with("  measured"));
    let mut words = line.unwrap_or_default().split_whitespace();
    words.find(|w| *w == key);
    let number = words.next().and_then(|w| w.parse().ok());
    number.ok_or_else(|| finished.report(&format!("no \"{label} … {key} <number>\"")))
}

#[test]
fn spectrum_of_example_1() {
    // Cells, interface, λ⁻ and λ⁺ without weights, and ranks.
    let rows = [
        (128, "hat", 126.9287, 2.0707, 1),
        (64, "hat", 62.8672, 2.7878, 3),
        (64, "conservative", 62.8651, 0.0, 1),
    ];
    check_all(&rows, |&(cells, interface, lowest, highest, ranks)| {
        let finished = of_case("spectrum", "example1.toml")
            .set(&[
                &format!("axis.0.x.cells={cells}"),
                &format!("axis.0.v.cells={cells}"),
                &format!("scheme.interface={interface}"),
            ])
            .on(ranks)
            .succeed()?;
        let found = |label, key, expected, by| {
            let value = spectrum_number(&finished, label, key)?;
            near(&format!("{label}: {key}"), value, expected, by).map_err(|e| finished.report(&e))
        };
        found("no weights", "lambda-", lowest, 1e-3)?;
        if interface == "conservative" {
            let highest = spectrum_number(&finished, "no weights", "lambda+")?;
            return at_most("lambda+", highest, 1e-6).map_err(|e| finished.report(&e));
        }
        found("no weights", "lambda-", lowest, 1e-4)?;
        found("no weights", "lambda+", highest, 1e-4)?;
        found("dissipative weights", "lambda-", lowest, 1e-2)?;
        let highest = spectrum_number(&finished, "dissipative weights", "lambda+")?;
        at_most("lambda+ with weights", highest, 1e-6).map_err(|e| finished.report(&e))
    });
}

/// λ± of example 1 on refined grids have the known values and small residuals. Too few steps are
/// reported as not converged.
#[test]
fn spectrum_by_refinement() {
    // λ⁺ and λ⁻ at 32², 64², 128².
    type Row = (&'static str, bool, [f64; 3], [f64; 3]);
    let rows: [Row; 3] = [
        ("hat", false, [0.080298, 2.787772, 2.070673], [30.7491, 62.8672, 126.9287]),
        ("hat", true, [-0.002264, -0.000584, -0.000148], [30.7491, 62.8660, 126.9283]),
        ("conservative", false, [-0.002264, -0.000584, -0.000148], [30.7492, 62.8651, 126.9279]),
    ];
    check_all(&["hat", "conservative"], |interface| {
        let job = Job::new(["spectrum", &case("example1.toml"), "--refine", "1,2,4", "--json"]);
        let finished = job
            .set(&["axis.0.x.cells=32", "axis.0.v.cells=32"])
            .set(&[&format!("scheme.interface={interface}")])
            .succeed()?;
        let value = finished.json()?;
        for (_, weighted, highest, lowest) in rows.iter().filter(|r| r.0 == *interface) {
            for (k, refinement) in [1, 2, 4].into_iter().enumerate() {
                let found = value
                    .as_array()
                    .into_iter()
                    .flatten()
                    .find(|v| v["refinement"] == refinement && v["weighted"] == *weighted);
                let found = found.ok_or_else(|| finished.report("a row is missing"))?;
                let at = format!("{interface}, weights {weighted}, x {refinement}");
                let number = |path: &str| {
                    let value = found.pointer(path).and_then(serde_json::Value::as_f64);
                    value.ok_or_else(|| finished.report(&format!("{at}: no {path}")))
                };
                for (end, expected, by) in
                    [("highest", highest[k], 2e-6), ("lowest", -lowest[k], 1e-4)]
                {
                    let value = number(&format!("/lanczos/{end}/value"))?;
                    near(&format!("{at}: {end}"), value, expected, by)?;
                    let residual = number(&format!("/lanczos/{end}/residual"))?;
                    at_most(&format!("{at}: residual"), residual, 2e-4)?;
                    let converged = found["lanczos"][end]["converged"] == true;
                    require(converged, &finished, || format!("{at}: {end} has not converged"))?;
                }
                // The eigenvalues are within their bounds.
                let (low, high) = (number("/gershgorin/0")?, number("/gershgorin/1")?);
                at_most("lowest below Gershgorin", low, number("/lanczos/lowest/value")?)?;
                at_most("highest above Gershgorin", number("/lanczos/highest/value")?, high)?;
                at_most(
                    "highest above the certificate",
                    number("/lanczos/highest/value")?,
                    number("/certificate")?,
                )?;
                at_most("sqrt(pi)", number("/sqrt_pi/1")?, number("/sqrt_pi/0")?)?;
                require((number("/sqrt_pi/0")? > 1.0) == *weighted, &finished, || {
                    format!("{at}: sqrt(pi)")
                })?;
            }
        }
        Ok(())
    });
    let job = Job::new(["spectrum", &case("example1.toml"), "--steps", "20"]);
    let finished = job.succeed().unwrap();
    assert!(finished.output.contains("not converged"), "{}", finished.report("20 steps"));
}

/// The ends of the spectrum of every case are within their bounds.
#[test]
fn spectrum_of_every_case() {
    let rows: Vec<(usize, String)> = cases().into_iter().enumerate().collect();
    check_all(&rows, |(k, name)| {
        let job = Job::new(["spectrum", &case(name), "--json"]);
        let ranks = if k % 10 == 0 { 2 } else { 1 };
        let job = job.set(shrunk(name)).set(&["axis.0.x.cells=12"]).on(ranks);
        let finished = job.succeed()?;
        let value = finished.json()?;
        let rows = value.as_array().filter(|rows| !rows.is_empty());
        for row in rows.ok_or_else(|| finished.report("no rows"))? {
            let number = |path: &str| {
                row.pointer(path).and_then(serde_json::Value::as_f64).unwrap_or(f64::NAN)
            };
            let (low, high) = (number("/lanczos/lowest/value"), number("/lanczos/highest/value"));
            // If the generator is skew, S is round-off.
            let slack = 1e-12 * low.abs().max(1.0);
            let inside = low < 0.0
                && low < high
                && number("/gershgorin/0") <= low + slack
                && high <= number("/gershgorin/1") + slack
                && high <= number("/growth").max(0.0) + slack
                && -low <= number("/decay") + slack;
            require(inside, &finished, || format!("outside its bounds: {row}"))?;
        }
        Ok(())
    });
}

/// λ⁺ of the enlarged system compared with that of `A` alone: the δ of the paper adds nothing. δ =
/// 1 gives a quarter of the largest rate, if the inflow is 1.
#[test]
fn spectrum_with_inflow() {
    let set = |delta: &'static str| {
        of_case("spectrum", "example1.toml")
            .set(&["axis.0.x.cells=64", "axis.0.v.cells=64"])
            .set(&["inflow.value=1", "solver.warp.inflow=full", delta])
            .succeed()
    };
    let number = |finished: &Finished, label: &str, key: &str| {
        spectrum_number(finished, label, key).unwrap_or_else(|e| panic!("{e}"))
    };
    let largest = set("solver.warp.delta=max").unwrap();
    let alone = number(&largest, "no weights, A alone", "lambda+");
    let enlarged = number(&largest, "no weights, with inflow", "lambda+");
    assert!((alone - 2.7878).abs() < 1e-4 && (enlarged - alone).abs() < 1e-5);
    let one = set("solver.warp.delta=1").unwrap();
    let enlarged = number(&one, "no weights, with inflow", "lambda+");
    // The end of a chain with diagonal −d and neighbours d/2, coupled by d/2 to an auxiliary
    // unknown, has λ = d/4.
    let fastest = (1.5 - 1.5 / 64.0) / (3.0 / 64.0);
    assert!((enlarged - fastest / 4.0).abs() < 1e-4, "{enlarged}");
}

/// `spectrum` refuses a grid whose matrix does not fit into memory, also for a later refinement,
/// before it computes the first grid.
#[test]
fn spectrum_of_a_grid_that_does_not_fit_into_memory_is_refused() {
    let large = &["axis.0.x.cells=40000", "axis.0.v.cells=40000"];
    let more: &[(&str, &str, &[&str], usize)] = &[
        ("example1.toml", "1,64", &["axis.0.x.cells=2000"], 2),
        ("step_slope3d.toml", "1,64", &[], 1),
        ("barrier2d.toml", "20", &[], 1),
        ("example1.toml", "1", large, 1),
    ];
    check_all(more, |(name, refine, settings, ranks)| {
        let job = Job::new(["spectrum", &case(name), "--refine", refine]);
        let job = job.set(settings).on(*ranks).capped();
        job.is_refused(&["memory", "cells"])
    });
}
