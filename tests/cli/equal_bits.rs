//! Results have the same bits on every number of ranks and every process mesh.

use crate::support::{
    at_most, check_all, datasets, differences, directory, distance, parsed, refused, require, run,
};
use std::collections::BTreeSet;

/// The values of `--ranks-x`: every way to split `ranks` into blocks along `axes` space axes and
/// mode groups.
fn meshes(axes: usize, ranks: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..axes {
        all = (all.iter())
            .flat_map(|mesh: &Vec<usize>| {
                (1..=ranks)
                    .map(move |parts| mesh.iter().copied().chain([parts]).collect::<Vec<_>>())
            })
            .filter(|mesh| ranks.is_multiple_of(mesh.iter().product()))
            .collect();
    }
    all
}

#[test]
fn every_mesh_is_listed() {
    assert_eq!(meshes(1, 4), [[1], [2], [4]]);
    assert_eq!(meshes(2, 3), [[1, 1], [1, 3], [3, 1]]);
    assert_eq!(meshes(3, 4).len(), 10);
}

/// A run that is repeated on the meshes.
struct Scene<'a> {
    name: &'static str,
    settings: &'a [&'static str],
    axes: usize,
    datasets: &'static [&'static str],
}

const LINE: &[&str] = &[
    "/axis/component", "/axis/vx", "/axis/x", "/case", "/density", "/exact", "/f", "/momentum",
    "/plan", "/velocity", "/xdmf/plane_x/exact", "/xdmf/plane_x/f",
];

const PLANE: &[&str] = &[
    "/axis/component", "/axis/vx", "/axis/vy", "/axis/x", "/axis/y", "/case", "/density", "/exact",
    "/f", "/momentum", "/plan", "/velocity", "/xdmf/plane_x/f", "/xdmf/plane_y/exact",
    "/xdmf/space/density", "/xdmf/space/velocity",
];

const SPACE: &[&str] = &[
    "/axis/component", "/axis/vx", "/axis/vy", "/axis/vz", "/axis/x", "/axis/y", "/axis/z",
    "/case", "/density", "/exact", "/f", "/momentum", "/plan", "/velocity", "/xdmf/plane_z/f",
    "/xdmf/space/density", "/xdmf/space/momentum",
];

const MEASURE_LINE: &[&str] = &[
    "/axis/component", "/axis/point", "/axis/vx", "/axis/x", "/density", "/density_exact",
    "/momentum", "/multivalued/branch", "/multivalued/density", "/multivalued/v", "/multivalued/x",
    "/phi", "/psi", "/velocity", "/velocity_exact", "/xdmf/plane_x/phi", "/xdmf/plane_x/psi_x",
];

const MEASURE_PLANE: &[&str] = &[
    "/axis/vy", "/axis/y", "/density", "/density_exact", "/momentum", "/phi", "/psi", "/velocity",
    "/velocity_exact",
];

/// Compares a scene's results with those on one rank: on every mesh of 3 ranks, on the meshes of 4
/// ranks that split two axes or an axis and the modes, and on 7 ranks with the mesh that the
/// program chooses.
fn same_bits_everywhere(scene: &Scene<'_>) {
    let job = || run(scene.name).set(scene.settings);
    let place = directory();
    job().solve(place.path()).unwrap();
    let reference = datasets(place.path()).unwrap();
    for name in scene.datasets {
        assert!(reference.contains_key(*name), "no {name} in result.h5: {}", job().command());
    }

    let mut rows: Vec<(usize, Option<Vec<usize>>)> = Vec::new();
    let space = parsed(scene.name, scene.settings).unwrap().space;
    let whole =
        |m: &Vec<usize>| (m.iter().enumerate()).all(|(a, m)| *m == 1 || !space.is_periodic(a));
    for ranks in [3, 4] {
        let blocks = |m: &Vec<usize>| m.iter().filter(|&&parts| parts > 1).count();
        // Meshes of 4 ranks that split one axis only are like those of 3 ranks.
        let new = |m: &Vec<usize>| ranks == 3 || m.contains(&2) || blocks(m) > 1;
        let meshes = meshes(scene.axes, ranks).into_iter();
        rows.extend(meshes.filter(whole).filter(new).map(|m| (ranks, Some(m))));
    }
    rows.push((7, None));
    check_all(&rows, |(ranks, mesh)| {
        let place = directory();
        let mut job = job().on(*ranks);
        if let Some(mesh) = mesh {
            let list: Vec<String> = mesh.iter().map(usize::to_string).collect();
            job = job.with(["--ranks-x", &list.join(",")]);
        }
        let summary = job.solve(place.path())?;
        // The run had this mesh.
        let found = (&summary.value["ranks"], &summary.value["space_blocks"]);
        summary.require(*found.0 == serde_json::json!(ranks), || format!("ranks: {}", found.0))?;
        if let Some(mesh) = mesh {
            let groups = ranks / mesh.iter().product::<usize>();
            let as_asked = *found.1 == serde_json::json!(mesh)
                && summary.value["mode_groups"] == serde_json::json!(groups);
            summary.require(as_asked, || format!("space_blocks: {}", found.1))?;
        }
        let differ = differences(&datasets(place.path())?, &reference);
        summary.require(differ.is_empty(), || {
            format!("other bits than on one rank in {}", differ.join(", "))
        })
    });

    // Bits of a field with few values would show nothing.
    let field = if scene.datasets.contains(&"/phi") { "/psi" } else { "/f" };
    let values: BTreeSet<u64> = reference[field].numbers().iter().map(|f| f.to_bits()).collect();
    assert!(values.len() > 50, "{field} has {} values: {}", values.len(), job().command());
}

/// Control of the comparison: a time that is changed by a billionth changes the bits of the field,
/// but not those of the axes.
#[test]
fn a_slightly_changed_time_changes_the_bits() {
    let rows = [("inflow_barrier.toml", "/f"), ("example2.toml", "/psi")];
    check_all(&rows, |(name, field)| {
        let results = |end: f64| {
            let place = directory();
            let end = format!("time.end={end}");
            run(name).set(&["axis.0.x.cells=37", "axis.0.v.cells=29", &end]).solve(place.path())?;
            datasets(place.path())
        };
        let differ = differences(&results(0.7)?, &results(0.7 * (1.0 + 1e-9))?);
        if differ.iter().any(|d| d == field) && !differ.iter().any(|d| d == "/axis/x") {
            Ok(())
        } else {
            Err(format!("{name}: a changed time.end changes {differ:?}"))
        }
    });
}

#[test]
fn same_bits_with_inflow() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &["axis.0.x.cells=37", "axis.0.v.cells=29", "time.end=0.7"],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_samples_and_a_plateau() {
    same_bits_everywhere(&Scene {
        name: "example1.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=17",
            "time.end=0.7",
            "solver.tolerance=1e-4",
            "solver.warp.profile=smooth",
            "solver.warp.coefficients=sampled",
            "solver.warp.recovery_method=least-squares",
            "output.plateau.points=3",
        ],
        axes: 1,
        datasets: &["/f", "/plateau/distance", "/plateau/norm", "/plateau/p"],
    });
}

#[test]
fn same_bits_with_a_formula_for_alpha() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=17",
            "time.end=0.7",
            "solver.tolerance=1e-4",
            "solver.warp.profile=exponential",
            "solver.warp.alpha=-1 + 0.05*p^2 if p > -8 else -p/8",
            "output.field_times=[0.3]",
        ],
        axes: 1,
        datasets: &["/f", "/plan", "/history/f"],
    });
}

#[test]
fn same_bits_at_output_times() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=23",
            "axis.0.v.cells=17",
            "time.end=0.7",
            "solver.tolerance=1e-4",
            "output.moments_every=0.2",
            "output.field_times=[0.3, 0.4]",
            "output.chunks=[5, 6]",
        ],
        axes: 1,
        datasets: &[
            "/f", "/history/f", "/history/density", "/history/density_exact",
            "/history/velocity_exact", "/history/mass", "/axis/time",
        ],
    });
}

/// Moments at times within a series, of cells and of elements with inflow.
#[test]
fn same_bits_of_moments_within_a_series() {
    const EARLY: &[&str] = &["/f", "/history/density", "/history/momentum", "/history/mass"];
    same_bits_everywhere(&Scene {
        name: "example1.toml",
        settings: &[
            "axis.0.x.cells=33", "axis.0.v.cells=24", "time.end=0.7", "solver.tolerance=1e-5",
            "output.moments_every=0.04",
        ],
        axes: 1,
        datasets: EARLY,
    });
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "scheme.degree=2", "axis.0.x.cells=9", "axis.0.v.cells=6", "time.end=0.7",
            "solver.tolerance=1e-5", "output.moments_every=0.04",
        ],
        axes: 1,
        datasets: EARLY,
    });
}

#[test]
fn same_bits_with_a_common_auxiliary_unknown() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=35", "axis.0.v.cells=27", "time.end=0.7", "solver.warp.inflow=scalar",
        ],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_inflow_that_varies() {
    same_bits_everywhere(&Scene {
        name: "pulsed_inflow.toml",
        settings: &[
            "axis.0.x.cells=33", "axis.0.v.cells=23", "time.end=0.7", "solver.tolerance=1e-4",
            "solver.warp.inflow=full",
        ],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_shifted_weights() {
    same_bits_everywhere(&Scene {
        name: "well.toml",
        settings: &["axis.0.x.cells=39", "axis.0.v.cells=31", "time.end=0.7"],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_with_slopes_and_conservative_interface() {
    same_bits_everywhere(&Scene {
        name: "slope_jump.toml",
        settings: &[
            "axis.0.x.cells=41",
            "axis.0.v.cells=27",
            "time.end=0.7",
            "scheme.interface=conservative",
            "solver.tolerance=1e-9",
        ],
        axes: 1,
        datasets: LINE,
    });
}

#[test]
fn same_bits_in_the_plane() {
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &["axis.0.x.cells=13", "axis.1.x.cells=7", "time.end=0.7"],
        axes: 2,
        datasets: PLANE,
    });
}

#[test]
fn same_bits_around_periodic_axes() {
    same_bits_everywhere(&Scene {
        name: "periodic2d.toml",
        settings: &["axis.0.x.cells=13", "axis.1.x.cells=5", "time.end=0.7"],
        axes: 2,
        datasets: PLANE,
    });
    same_bits_everywhere(&Scene {
        name: "periodic2d.toml",
        settings: &[
            "axis.0.x.boundary=periodic",
            "axis.1.x={lower=-0.5,upper=0.5,cells=6}",
            "time.end=0.7",
            "solver.method=classical",
            "solver.classical.integrator=ssp-rk3",
            "scheme.limiter=van-leer",
        ],
        axes: 2,
        datasets: PLANE,
    });
}

#[test]
fn same_bits_in_space() {
    same_bits_everywhere(&Scene {
        name: "step3d.toml",
        settings: &["axis.0.v.cells=7", "time.end=0.7", "inflow.value=initial"],
        axes: 3,
        datasets: SPACE,
    });
}

#[test]
fn same_bits_with_measure_valued_data() {
    same_bits_everywhere(&Scene {
        name: "example2.toml",
        settings: &["axis.0.x.cells=38", "axis.0.v.cells=27", "time.end=0.7"],
        axes: 1,
        datasets: MEASURE_LINE,
    });
    same_bits_everywhere(&Scene {
        name: "example3.toml",
        settings: &[
            "axis.0.x.cells=4", "axis.0.v.cells=5", "time.end=0.7", "solver.tolerance=1e-3",
            "output.delta_width=gradient",
        ],
        axes: 2,
        datasets: MEASURE_PLANE,
    });
}

#[test]
fn same_bits_with_the_classical_method() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=37", "axis.0.v.cells=29", "time.end=0.7", "solver.method=classical",
        ],
        axes: 1,
        datasets: LINE,
    });
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &[
            "axis.0.x.cells=13",
            "axis.1.x.cells=7",
            "time.end=0.7",
            "solver.method=classical",
            "solver.classical.integrator=ssp-rk3",
        ],
        axes: 2,
        datasets: PLANE,
    });
}

#[test]
fn same_bits_with_slopes_of_both_kinds() {
    same_bits_everywhere(&Scene {
        name: "slope_jump.toml",
        settings: &[
            "axis.0.x.cells=37",
            "axis.0.v.cells=29",
            "time.end=0.7",
            "inflow.value='1 + x*v'",
            "solver.method=classical",
            "solver.classical.integrator=ssp-rk3",
            "scheme.limiter=van-leer",
        ],
        axes: 1,
        datasets: LINE,
    });
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &[
            "axis.0.x.cells=13",
            "axis.1.x.cells=7",
            "time.end=0.7",
            "potential.0.value='0.2 + 0.1*x - 0.1*y'",
            "solver.method=classical",
            "solver.classical.integrator=forward-euler",
            "scheme.limiter=minmod",
        ],
        axes: 2,
        datasets: PLANE,
    });
}

/// With a central flux, `K` alone couples elements across faces, also across those between ranks,
/// one of which has a jump of `V`.
#[test]
fn same_bits_of_elements_with_a_central_flux() {
    let flux = "scheme.flux=0";
    same_bits_everywhere(&Scene {
        name: "step_up.toml",
        settings: &[
            "axis.0.x.cells=12", "axis.0.v.cells=6", "scheme.degree=3", flux, "time.end=0.4",
            "solver.tolerance=1e-3",
        ],
        axes: 1,
        datasets: &["/f", "/density"],
    });
    same_bits_everywhere(&Scene {
        name: "barrier2d.toml",
        settings: &[
            "axis.0.x.cells=6", "axis.1.x.cells=5", "axis.0.v.cells=4", "axis.1.v.cells=2",
            "scheme.degree=1", flux, "time.end=0.3", "solver.tolerance=1e-2", "exact={}",
        ],
        axes: 2,
        datasets: &["/f", "/density"],
    });
}

/// Elements whose degrees differ from axis to axis, also with degree 0, and partial reflection.
#[test]
fn same_bits_of_elements() {
    same_bits_everywhere(&Scene {
        name: "inflow_barrier.toml",
        settings: &[
            "axis.0.x.cells=11",
            "axis.0.v={lower=-1.2,upper=1.2,cells=6,degree=3}",
            "scheme.degree=2",
            "time.end=0.7",
            "solver.tolerance=1e-4",
        ],
        axes: 1,
        datasets: LINE,
    });
    same_bits_everywhere(&Scene {
        name: "partial_reflection.toml",
        settings: &["axis.0.x.cells=22", "axis.0.v.cells=14", "scheme.degree=0", "time.end=0.7"],
        axes: 1,
        datasets: LINE,
    });
    let degree_0_along_vy = ["axis.1.v={lower=-1.5,upper=1.5,cells=4,degree=0}"];
    same_bits_everywhere(&Scene {
        name: "quadrant2d.toml",
        settings: &[&ELEMENTS_IN_A_PLANE[..], &degree_0_along_vy].concat(),
        axes: 2,
        datasets: PLANE,
    });
}

/// `quadrant2d` by elements of two degrees, but for the second velocity axis.
const ELEMENTS_IN_A_PLANE: [&str; 6] = [
    "axis.0.x.cells=5",
    "axis.1.x={lower=-1.0,upper=1.0,cells=4,degree=2}",
    "axis.0.v.cells=2",
    "scheme.degree=1",
    "time.end=0.7",
    "solver.tolerance=1e-3",
];

/// Elements on which a force acts, along one and along two velocity axes.
#[test]
fn same_bits_of_elements_with_a_force() {
    same_bits_everywhere(&Scene {
        name: "slope_jump.toml",
        settings: &[
            "scheme.degree=3", "axis.0.x.cells=10", "axis.0.v.cells=6", "time.end=0.7",
            "solver.tolerance=1e-4",
        ],
        axes: 1,
        datasets: LINE,
    });
    let forces = [
        "axis.1.v={lower=-1.5,upper=1.5,cells=4,degree=2}",
        "potential.0.value=0.2 + 0.1*x - 0.05*y",
        "potential.1.value=0.1*x + 0.05*y",
    ];
    same_bits_everywhere(&Scene {
        name: "quadrant2d.toml",
        settings: &[&ELEMENTS_IN_A_PLANE[..], &forces].concat(),
        axes: 2,
        datasets: PLANE,
    });
}

/// Instruction sets that can be selected; a machine may lack some of them.
const SETS: [&str; 4] = ["avx512", "avx2", "neon", "generic"];

/// All instruction sets with fused multiply-adds give the same bits. The set without them differs
/// by round-off.
#[test]
fn same_bits_by_every_instruction_set_that_fuses() {
    /// A few rounding errors times the amplification by the recovery at a tolerance of 1e-6.
    const LARGEST: f64 = 5e-8;
    let rows: [(&str, &[&str]); 7] = [
        ("example1.toml", &["axis.0.x.cells=23", "axis.0.v.cells=17", "output.field_times=[0.3]"]),
        ("smooth-beams.toml", &["scheme.degree=3", "axis.0.x.cells=7", "axis.0.v.cells=6"]),
        ("slope_jump.toml", &["scheme.degree=1", "axis.0.x.cells=14", "axis.0.v.cells=10"]),
        ("slope_jump.toml", &["scheme.degree=4", "axis.0.x.cells=6", "axis.0.v.cells=4"]),
        ("pulsed_inflow.toml", &["axis.0.x.cells=20", "axis.0.v.cells=14"]),
        ("example2.toml", &["axis.0.x.cells=20", "axis.0.v.cells=16", "time.end=0.3"]),
        (
            "quadrant2d.toml",
            &[
                "scheme.degree=0", "axis.0.x.cells=7", "axis.0.v.cells=6", "axis.1.x.cells=5",
                "axis.1.v.cells=6",
            ],
        ),
    ];
    let tolerance = "solver.tolerance=1e-6";
    check_all(&rows, |(name, settings)| {
        let place = directory();
        let job = || run(name).set(settings).set(&[tolerance]);
        job().solve(place.path())?;
        let best = datasets(place.path())?;
        let mut solved = 0;
        for set in SETS {
            let other = directory();
            let job = job().on(2).environment("PHASEWARP_INSTRUCTION_SET", set).into(other.path());
            let finished = job.run()?;
            if finished.code == Some(2) {
                refused(&finished, &["PHASEWARP_INSTRUCTION_SET", set, "this processor has"])?;
                continue;
            }
            finished.ended(0, &[])?;
            solved += 1;
            let found = datasets(other.path())?;
            if set != "generic" {
                let differ = differences(&found, &best);
                require(differ.is_empty(), &finished, || format!("other bits in {differ:?}"))?;
            }
            for key in ["/f", "/phi", "/density"] {
                if let (Some(found), Some(best)) = (found.get(key), best.get(key)) {
                    let what = format!("{name}, {set}: relative distance of {key}");
                    at_most(&what, distance(&found.numbers(), &best.numbers()), LARGEST)?;
                }
            }
        }
        match solved {
            0 => Err(format!("{name}: this processor has none of the instruction sets")),
            _ => Ok(()),
        }
    });
}
