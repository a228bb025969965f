//! Results have the same bits on every number of ranks and every process mesh.

use crate::support::{
    RankMesh, at_most, check_all, datasets, differences, directory, distance, refused, require, run,
};
use std::collections::BTreeSet;

/// Blocks of an axis, one of them with two neighbours.
const BLOCKS: &[RankMesh] = &[(3, "3")];
/// Blocks of an axis, each of them with two groups of modes.
const GROUPS: &[RankMesh] = &[(4, "2")];
/// Meshes of an axis; groups of unequal numbers of modes. `tests/parallel/bits.rs` has more.
const LINE_MESHES: &[RankMesh] = &[(3, "1"), (3, "3"), (4, "2"), (7, "1")];
/// Meshes of two axes.
const PLANE_MESHES: &[RankMesh] = &[(3, "1,3"), (3, "3,1"), (4, "1,2"), (4, "2,1"), (4, "2,2")];
/// Meshes of three axes.
const SPACE_MESHES: &[RankMesh] = &[(3, "1,1,3"), (4, "1,2,1"), (4, "2,1,2")];

/// A run until 0.7 that is repeated on the meshes, and datasets that it must have.
struct Scene {
    name: &'static str,
    meshes: &'static [RankMesh],
    datasets: &'static [&'static str],
    settings: &'static [&'static str],
}

const fn scene(
    name: &'static str,
    meshes: &'static [RankMesh],
    datasets: &'static [&'static str],
    settings: &'static [&'static str],
) -> Scene {
    Scene { name, meshes, datasets, settings }
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

/// Compares the results of each scene with those on one rank.
fn same_bits(scenes: &[Scene]) {
    check_all(scenes, |scene| {
        let job = || run(scene.name).set(&["time.end=0.7"]).set(scene.settings);
        let place = directory();
        let alone = job().solve(place.path())?;
        let reference = datasets(place.path())?;
        for name in scene.datasets {
            alone.require(reference.contains_key(*name), || format!("no {name} in result.h5"))?;
        }
        // Bits of a field with few values would show nothing.
        let field = if scene.datasets.contains(&"/phi") { "/psi" } else { "/f" };
        let values = reference[field].numbers();
        let values: BTreeSet<u64> = values.iter().map(|f| f.to_bits()).collect();
        alone.require(values.len() > 50, || format!("{field} has {} values", values.len()))?;
        for &(ranks, blocks) in scene.meshes {
            let place = directory();
            let summary = job().on(ranks).with(["--ranks-x", blocks]).solve(place.path())?;
            // The run had this mesh.
            let list: Vec<usize> = blocks.split(',').filter_map(|n| n.parse().ok()).collect();
            let asked = [
                ("ranks", serde_json::json!(ranks)),
                ("mode_groups", serde_json::json!(ranks / list.iter().product::<usize>())),
                ("space_blocks", serde_json::json!(list)),
            ];
            for (key, asked) in asked {
                let found = &summary.value[key];
                summary.require(*found == asked, || format!("{key}: {found}"))?;
            }
            let differ = differences(&datasets(place.path())?, &reference);
            summary.require(differ.is_empty(), || {
                format!("other bits than on one rank in {}", differ.join(", "))
            })?;
        }
        Ok(())
    });
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
fn same_bits_on_a_line() {
    same_bits(&[
        scene(
            "inflow_barrier.toml",
            LINE_MESHES,
            LINE,
            &["axis.0.x.cells=37", "axis.0.v.cells=29"],
        ),
        // A common auxiliary unknown.
        scene(
            "inflow_barrier.toml",
            BLOCKS,
            LINE,
            &["axis.0.x.cells=35", "axis.0.v.cells=27", "solver.warp.inflow=scalar"],
        ),
        // Inflow that varies.
        scene(
            "pulsed_inflow.toml",
            GROUPS,
            LINE,
            &[
                "axis.0.x.cells=33", "axis.0.v.cells=23", "solver.tolerance=1e-4",
                "solver.warp.inflow=full",
            ],
        ),
        // Shifted weights.
        scene("well.toml", BLOCKS, LINE, &["axis.0.x.cells=39", "axis.0.v.cells=31"]),
        scene(
            "slope_jump.toml",
            GROUPS,
            LINE,
            &[
                "axis.0.x.cells=41",
                "axis.0.v.cells=27",
                "scheme.interface=conservative",
                "solver.tolerance=1e-9",
            ],
        ),
    ]);
}

#[test]
fn same_bits_of_readings_and_profiles() {
    same_bits(&[
        scene(
            "example1.toml",
            GROUPS,
            &["/f", "/plateau/distance", "/plateau/norm", "/plateau/p"],
            &[
                "axis.0.x.cells=23",
                "axis.0.v.cells=17",
                "solver.tolerance=1e-4",
                "solver.warp.profile=smooth",
                "solver.warp.coefficients=sampled",
                "solver.warp.recovery_method=least-squares",
                "output.plateau.points=3",
            ],
        ),
        scene(
            "inflow_barrier.toml",
            GROUPS,
            &["/f", "/plan", "/history/f"],
            &[
                "axis.0.x.cells=23",
                "axis.0.v.cells=17",
                "solver.tolerance=1e-4",
                "solver.warp.profile=exponential",
                "solver.warp.alpha=-1 + 0.05*p^2 if p > -8 else -p/8",
                "output.field_times=[0.3]",
            ],
        ),
    ]);
}

#[test]
fn same_bits_at_output_times() {
    const EARLY: &[&str] = &["/f", "/history/density", "/history/momentum", "/history/mass"];
    same_bits(&[
        scene(
            "inflow_barrier.toml",
            BLOCKS,
            &[
                "/f", "/history/f", "/history/density", "/history/density_exact",
                "/history/velocity_exact", "/history/mass", "/axis/time",
            ],
            &[
                "axis.0.x.cells=23",
                "axis.0.v.cells=17",
                "solver.tolerance=1e-4",
                "output.moments_every=0.2",
                "output.field_times=[0.3, 0.4]",
                "output.chunks=[5, 6]",
            ],
        ),
        // Moments at times within a series, of cells and of elements with inflow.
        scene(
            "example1.toml",
            GROUPS,
            EARLY,
            &[
                "axis.0.x.cells=33", "axis.0.v.cells=24", "solver.tolerance=1e-5",
                "output.moments_every=0.04",
            ],
        ),
        scene(
            "inflow_barrier.toml",
            BLOCKS,
            EARLY,
            &[
                "scheme.degree=2", "axis.0.x.cells=9", "axis.0.v.cells=6", "solver.tolerance=1e-5",
                "output.moments_every=0.04",
            ],
        ),
    ]);
}

#[test]
fn same_bits_in_the_plane_and_in_space() {
    same_bits(&[
        scene("barrier2d.toml", PLANE_MESHES, PLANE, &["axis.0.x.cells=13", "axis.1.x.cells=7"]),
        // Ranks do not split periodic axes.
        scene("periodic2d.toml", &[(4, "2,1")], PLANE, &["axis.0.x.cells=13", "axis.1.x.cells=5"]),
        scene("step3d.toml", SPACE_MESHES, SPACE, &["axis.0.v.cells=7", "inflow.value=initial"]),
    ]);
}

#[test]
fn same_bits_with_measure_valued_data() {
    same_bits(&[
        scene("example2.toml", GROUPS, MEASURE_LINE, &["axis.0.x.cells=38", "axis.0.v.cells=27"]),
        scene(
            "example3.toml",
            &[(3, "3,1"), (4, "1,2")],
            MEASURE_PLANE,
            &[
                "axis.0.x.cells=4", "axis.0.v.cells=5", "solver.tolerance=1e-3",
                "output.delta_width=gradient",
            ],
        ),
    ]);
}

/// The classical method, also with slopes of both kinds.
#[test]
fn same_bits_with_the_classical_method() {
    same_bits(&[
        scene(
            "inflow_barrier.toml",
            GROUPS,
            LINE,
            &["axis.0.x.cells=37", "axis.0.v.cells=29", "solver.method=classical"],
        ),
        scene(
            "slope_jump.toml",
            BLOCKS,
            LINE,
            &[
                "axis.0.x.cells=37",
                "axis.0.v.cells=29",
                "inflow.value='1 + x*v'",
                "solver.method=classical",
                "solver.classical.integrator=ssp-rk3",
                "scheme.limiter=van-leer",
            ],
        ),
        scene(
            "barrier2d.toml",
            &[(3, "1,3"), (4, "2,2")],
            PLANE,
            &[
                "axis.0.x.cells=13",
                "axis.1.x.cells=7",
                "potential.0.value='0.2 + 0.1*x - 0.1*y'",
                "solver.method=classical",
                "solver.classical.integrator=forward-euler",
                "scheme.limiter=minmod",
            ],
        ),
        scene(
            "periodic2d.toml",
            &[(3, "1,3")],
            PLANE,
            &[
                "axis.0.x.boundary=periodic",
                "axis.1.x={lower=-0.5,upper=0.5,cells=6}",
                "solver.method=classical",
                "solver.classical.integrator=ssp-rk3",
                "scheme.limiter=van-leer",
            ],
        ),
    ]);
}

/// Elements whose degrees differ from axis to axis, also with degree 0; partial reflection; forces
/// along one and along two velocity axes.
#[test]
fn same_bits_of_elements() {
    same_bits(&[
        scene(
            "inflow_barrier.toml",
            &[(3, "3"), (4, "2")],
            LINE,
            &[
                "axis.0.x.cells=11",
                "axis.0.v={lower=-1.2,upper=1.2,cells=6,degree=3}",
                "scheme.degree=2",
                "solver.tolerance=1e-4",
            ],
        ),
        scene(
            "partial_reflection.toml",
            BLOCKS,
            LINE,
            &["axis.0.x.cells=22", "axis.0.v.cells=14", "scheme.degree=0"],
        ),
        scene(
            "slope_jump.toml",
            GROUPS,
            LINE,
            &["scheme.degree=3", "axis.0.x.cells=10", "axis.0.v.cells=6", "solver.tolerance=1e-4"],
        ),
        scene(
            "quadrant2d.toml",
            &[(3, "3,1"), (4, "1,2")],
            PLANE,
            &[
                "axis.0.x.cells=5",
                "axis.1.x={lower=-1.0,upper=1.0,cells=4,degree=2}",
                "axis.0.v.cells=2",
                "scheme.degree=1",
                "solver.tolerance=1e-3",
                "axis.1.v={lower=-1.5,upper=1.5,cells=4,degree=0}",
            ],
        ),
        scene(
            "quadrant2d.toml",
            &[(4, "2,2")],
            PLANE,
            &[
                "axis.0.x.cells=5",
                "axis.1.x={lower=-1.0,upper=1.0,cells=4,degree=2}",
                "axis.0.v.cells=2",
                "scheme.degree=1",
                "solver.tolerance=1e-3",
                "axis.1.v={lower=-1.5,upper=1.5,cells=4,degree=2}",
                "potential.0.value=0.2 + 0.1*x - 0.05*y",
                "potential.1.value=0.1*x + 0.05*y",
            ],
        ),
    ]);
}

/// With a central flux, `K` alone couples elements across faces, also across those between ranks,
/// one of which has a jump of `V`.
#[test]
fn same_bits_of_elements_with_a_central_flux() {
    same_bits(&[
        scene(
            "step_up.toml",
            GROUPS,
            &["/f", "/density"],
            &[
                "axis.0.x.cells=12", "axis.0.v.cells=6", "scheme.degree=3", "scheme.flux=0",
                "time.end=0.4", "solver.tolerance=1e-3",
            ],
        ),
        scene(
            "barrier2d.toml",
            &[(3, "3,1"), (4, "1,4")],
            &["/f", "/density"],
            &[
                "axis.0.x.cells=6", "axis.1.x.cells=5", "axis.0.v.cells=4", "axis.1.v.cells=2",
                "scheme.degree=1", "scheme.flux=0", "time.end=0.3", "solver.tolerance=1e-2",
                "exact={}",
            ],
        ),
    ]);
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
            let job = job().environment("PHASEWARP_INSTRUCTION_SET", set).into(other.path());
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
