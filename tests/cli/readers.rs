//! `tests/readers.py` reads results with h5py, xarray, meshio and VTK's XDMF reader.
//!
//! Without a Python with these packages, the test is skipped with a message; with
//! `PHASEWARP_READERS=required`, which `.ci/run` sets after the installation, it fails.
//! `make readers` installs them.

use crate::support::{check_all, directory, of_case, python, skipped, text_of};
use std::path::Path;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/readers.py");

/// The output of the script, or its error messages if it fails.
fn read(python: &Path, arguments: &[&str]) -> Result<String, String> {
    python::run(python, SCRIPT, arguments)
}

#[test]
fn results_open_in_other_programs() {
    let Some(python) = python::with_packages("readers", SCRIPT) else {
        let why = "no Python with h5py, h5netcdf, xarray, meshio and vtk; `make readers` installs \
                   them";
        return skipped("PHASEWARP_READERS", "tests/cli/readers.rs", why);
    };
    const ODD: &[&str] = &["axis.0.x.cells=23", "axis.0.v.cells=17"];
    const LINE: &str = "exact={ f = \"1 + x + 10*v\" }";
    const PLANE: &str = "exact={ f = \"1 + x + 10*y + 100*vx + 1000*vy\" }";
    const SPACE: &str = "exact={ f = \"1 + x + 10*y + 100*z + 1e3*vx + 1e4*vy + 1e5*vz\" }";
    const EARLY: &[&str] =
        &["output.moments_every=0.3", "output.field_times=[0.1, 0.6]", "output.warped_field=true"];
    const FILM: &[&str] = &["output.fields_every=0.04", "output.moment_times=[0.05]"];
    const PACKED: &[&str] = &["output.compression=4"];
    const CHUNKS: &[&str] = &["output.chunks=[5,3,4,6]"];
    let rows: &[(&str, usize, &[&[&str]])] = &[
        ("example1.toml", 2, &[ODD, &[LINE]]),
        ("example1.toml", 3, &[ODD, &[LINE], PACKED, EARLY]),
        ("barrier2d.toml", 3, &[&[PLANE]]),
        ("barrier2d.toml", 3, &[&[PLANE, "time.end=0.1"], FILM]),
        ("barrier2d.toml", 4, &[&[PLANE], PACKED, CHUNKS]),
        ("step3d.toml", 4, &[&[SPACE]]),
        ("example2.toml", 2, &[ODD]),
        (
            "example3.toml",
            2,
            &[&["axis.0.x.cells=8", "axis.1.x.cells=6", "axis.0.v.cells=7", "axis.1.v.cells=5"]],
        ),
    ];
    check_all(rows, |(name, ranks, settings)| {
        let place = directory();
        let job = of_case("run", name).set(&settings.concat()).on(*ranks);
        let summary = job.solve(place.path())?;
        let path = place.path().display().to_string();
        let printed = read(&python, &[&path]);
        let fails = |why: String| format!("{why}\n  command: {}", summary.command);
        let printed = printed.map_err(fails)?;
        // 0.1, 0.3, 0.6, 0.9 and the end; 0, 0.04, 0.05, 0.08 and the end.
        let expected = match () {
            () if settings.contains(&EARLY) => "VTK (5 times), history, 3 warped",
            () if settings.contains(&FILM) => "VTK (5 times), history",
            () => "VTK (1 times)",
        };
        let early = printed.trim_end().ends_with(expected);
        summary.require(printed.starts_with(&path) && early, || {
            format!("the script printed: {printed}")
        })?;
        // Controls: the script finds a wrong field and a displaced field.
        if *name != "barrier2d.toml" || settings.contains(&FILM) {
            return Ok(());
        }
        let xdmf = place.path().join("fields.xdmf");
        let text = text_of(&xdmf)?;
        for (old, new) in [("density</", "velocity</"), ("ORIGIN_DXDYDZ\">\n", "")] {
            let (before, after) = text.split_once(old).ok_or("no such text in fields.xdmf")?;
            let after = match new {
                // The first number of the origin.
                "" => format!("{old}{}", after.replacen("\"XML\">-", "\"XML\">-1", 1)),
                _ => format!("{new}{after}"),
            };
            std::fs::write(&xdmf, format!("{before}{after}")).map_err(|e| e.to_string())?;
            summary.require(read(&python, &[&path]).is_err(), || format!("not found: {old}"))?;
        }
        std::fs::write(&xdmf, text).map_err(|e| e.to_string())?;
        read(&python, &[&path]).map_err(|why| format!("the original file: {why}"))?;
        for (file, old, new) in [
            ("space.xdmf", "/density<", "/potential<"),
            ("plane_y.xdmf", "/exact<", "/f<"),
            ("plane_x.xdmf", "Time Value=\"", "Time Value=\"1"),
        ] {
            let file = place.path().join(file);
            let text = text_of(&file)?;
            summary.require(text.contains(old), || format!("no {old} in {text}"))?;
            std::fs::write(&file, text.replacen(old, new, 1)).map_err(|e| e.to_string())?;
            let noticed = read(&python, &[&path]).is_err();
            summary.require(noticed, || format!("not found: {old} replaced by {new}"))?;
            std::fs::write(&file, text).map_err(|e| e.to_string())?;
        }
        Ok(())
    });
}
