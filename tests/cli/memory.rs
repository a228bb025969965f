//! The planned memory compared with the measured peak.

use crate::support::{SLOPES, Summary, check_all, near, plan, run};
use phasewarp::plan::memory::program_file_bytes;

/// A case, its size, other settings, the number of ranks, and the relative error that a plan may
/// have.
type Row<'a> = (&'a str, &'a [&'a str], &'a [&'a str], usize, f64);

/// The planned bytes of a run on so many ranks, relative to its peak, which was measured in the
/// same run: 0.05 if they are 5 % more. Below 100 MiB relative to these, as the memory of MPI and
/// HDF5 varies. Pages of files, which the kernel may drop at any time, are counted as planned. The
/// second value says it in words.
pub fn planned_above_peak(summary: &Summary, ranks: usize) -> Result<(f64, String), String> {
    let anonymous = summary.number("memory_anonymous_bytes_per_rank")?;
    let peak = anonymous + program_file_bytes(ranks) as f64;
    let planned = summary.number("memory_planned_bytes_per_rank")?;
    let more = (planned - peak) / peak.max(f64::from(100 << 20));
    let [planned, peak, anonymous] = [planned, peak, anonymous].map(|b| b / f64::from(1 << 20));
    let words = format!(
        "planned {planned:.1} MiB, peak {peak:.1}, {anonymous:.1} of it allocated: {:.2} %",
        100.0 * more
    );
    Ok((more, words))
}

/// The planned memory is at least the measured peak, and at most 5 % more.
#[test]
fn runs_take_the_planned_memory() {
    const CLOSE: f64 = 0.05;
    let grid =
        ["axis.0.x.cells=512", "axis.0.v.cells=512", "time.end=0.01", "solver.tolerance=0.01"];
    let large = ["axis.0.x.cells=1024", "axis.0.v.cells=1024", "time.end=0.005"];
    let plane = [
        "axis.0.x.cells=30", "axis.1.x.cells=30", "axis.0.v.cells=18", "axis.1.v.cells=16",
        "time.end=0.01", "solver.tolerance=0.01",
    ];
    let slopes = [SLOPES[0], SLOPES[1], "scheme.limiter=minmod"];
    let elements =
        ["axis.0.x.cells=170", "axis.0.v.cells=170", "time.end=0.005", "scheme.degree=2"];
    let quick = ["solver.tolerance=0.01", "scheme.flux=1"];
    let element_plane = [
        "axis.0.x.cells=15", "axis.1.x.cells=15", "axis.0.v.cells=8", "axis.1.v.cells=8",
        "time.end=0.005", "solver.tolerance=0.01", "scheme.degree=1",
    ];
    // While these are assembled, they take more than in the run.
    let high_degree = ["axis.0.x.cells=60", "axis.0.v.cells=16", "scheme.degree=8"];
    let high_degree_plane = [
        "axis.0.x.cells=2", "axis.1.x.cells=2", "axis.0.v.cells=2", "axis.1.v.cells=2",
        "scheme.degree=8",
    ];
    let strip = ["axis.0.x.cells=166", "axis.0.v.cells=422", "scheme.degree=1", "time.end=0.003"];
    let entering =
        ["potential=[{value='0.2*sin(3*x)'}]", "inflow.value='initial'", "solver.tolerance=0.01"];
    let bowl = "potential=[{value='0.1*(x^2+y^2)'}]";
    let well = ["potential=[{value='0.5*x^2'}]", "solver.tolerance=0.01", "time.end=0.01"];
    let slope = ["potential=[{value='0.3*x'}]", "solver.tolerance=0.01", "time.end=0.01"];
    let space = [
        "axis.0.x.cells=8", "axis.1.x.cells=8", "axis.2.x.cells=8", "axis.0.v.cells=8",
        "axis.1.v.cells=8", "axis.2.v.cells=8", "time.end=0.005", "solver.tolerance=0.01",
    ];
    let element_space = [
        "axis.0.x.cells=3", "axis.1.x.cells=3", "axis.2.x.cells=3", "axis.0.v.cells=4",
        "axis.1.v.cells=4", "axis.2.v.cells=4", "scheme.degree=1", "time.end=0.002",
    ];
    // The shape of V within elements is found on the way.
    let many_of_space = [
        "axis.0.x.cells=400", "axis.1.x.cells=400", "axis.0.v.cells=2", "axis.1.v.cells=2",
        "time.end=0.001", "solver.reduce=false",
    ];
    let sloping = ["potential=[{value='0.1*x'}]", "solver.method=classical", "exact={}"];
    // The exact density is not to take long.
    let pulse = [
        "inflow.value='exp(-20*(t - 0.2)^2)'",
        "solver.warp.inflow=full",
        "solver.tolerance=0.01",
        "exact={}",
    ];
    let tiny = ["axis.0.x.cells=64", "axis.0.v.cells=64"];
    let end = "exact.moments=end";
    let kept =
        ["axis.0.x.cells=340", "axis.0.v.cells=340", "time.end=0.005", "output.warped_field=true"];
    let rows: &[Row<'_>] = &[
        ("example1.toml", &grid, &[], 1, CLOSE),
        ("example1.toml", &grid, &["scheme.interface=conservative"], 2, CLOSE),
        ("example1.toml", &grid, &["output.fields_every=0.004"], 1, CLOSE),
        ("example1.toml", &grid, &["output.plateau={points=9}"], 1, CLOSE),
        ("example1.toml", &kept, &["solver.tolerance=0.01"], 1, CLOSE),
        ("example1.toml", &grid, &["solver.verify=true"], 1, CLOSE),
        ("example1.toml", &kept, &["output.fields_every=0.003", "solver.tolerance=0.01"], 2, CLOSE),
        ("inflow_barrier.toml", &grid, &[], 1, CLOSE),
        ("lens2d.toml", &plane, &[], 1, CLOSE),
        ("inflow_barrier.toml", &grid, &["solver.warp.inflow=full"], 1, CLOSE),
        ("slope_jump.toml", &grid, &[], 2, CLOSE),
        ("barrier2d.toml", &plane, &[], 1, CLOSE),
        ("slope_jump.toml", &grid, &["solver.propagator.method=krylov"], 1, CLOSE),
        ("example3.toml", &plane, &[], 2, CLOSE),
        ("step3d.toml", &space, &["solver.reduce=false"], 1, CLOSE),
        ("step3d.toml", &element_space, &pulse, 1, CLOSE),
        ("example1.toml", &elements, &quick, 1, CLOSE),
        ("inflow_barrier.toml", &elements, &quick, 1, CLOSE),
        ("example1.toml", &high_degree, &well, 1, CLOSE),
        ("barrier2d.toml", &high_degree_plane, &slope, 2, CLOSE),
        ("barrier2d.toml", &element_plane, &[], 1, CLOSE),
        ("barrier2d.toml", &element_plane, &[bowl, "inflow.value='initial'"], 2, CLOSE),
        ("example1.toml", &strip, &entering, 2, CLOSE),
        ("barrier2d.toml", &element_plane, &["axis.1.v.degree=3", "axis.1.v.cells=4"], 2, CLOSE),
        ("example1.toml", &grid, &["output.moments_every=0.0001"], 1, CLOSE),
        // The numbers of a time are few here, and what describes them is most of a file.
        ("example1.toml", &tiny, &["output.moments_every=0.001", "exact={}"], 1, CLOSE),
        ("step3d.toml", &[], &["output.moments_every=0.0005", end], 1, CLOSE),
        ("example1.toml", &large, &["solver.method=classical"], 1, CLOSE),
        ("example1.toml", &large, &SLOPES, 1, CLOSE),
        ("slope_jump.toml", &large, &slopes, 1, CLOSE),
        ("barrier2d.toml", &many_of_space, &sloping, 1, CLOSE),
        ("example2.toml", &grid, &[], 1, CLOSE),
        ("slope_jump.toml", &elements, &quick, 2, CLOSE),
        ("example1.toml", &elements, &["solver.method=classical"], 1, CLOSE),
    ];
    take_as_planned(rows);
}

/// Checks that each run takes the planned memory.
fn take_as_planned(rows: &[Row<'_>]) {
    check_all(rows, |(name, size, settings, ranks, allowed)| {
        let job = run(name).set(size).set(settings).on(*ranks).with_plugins();
        let summary = job.summary()?;
        let (more, words) = planned_above_peak(&summary, *ranks)?;
        let shown: Vec<String> = settings.iter().map(|s| s.chars().take(60).collect()).collect();
        println!("{name} {size:?} {shown:?} on {ranks}: {words}");
        // The peak varies by a hundredth from run to run.
        summary.require(-0.01 <= more && more <= *allowed, || words)
    });
}

/// Each mode takes memory in the tables of the plan, and in its text.
#[test]
fn many_modes_take_the_planned_memory() {
    const CLOSE: f64 = 0.05;
    const MANY: &str = "solver.warp.points=524288";
    const FEWER: &str = "solver.warp.points=262144";
    let tiny = ["axis.0.x.cells=4", "axis.0.v.cells=4", "exact={}", "time.end=1e-5"];
    let modes = |points: &'static str| {
        ["solver.warp.profile=exponential", "solver.warp.interval=[-12,20]", points]
    };
    take_as_planned(&[
        ("example1.toml", &tiny, &modes(MANY), 1, CLOSE),
        ("example1.toml", &tiny, &modes(FEWER), 2, CLOSE),
    ]);
}

/// Chunks of a dataset take memory while they are written, when the arrays of the solve are gone.
#[test]
fn chunks_take_the_planned_memory() {
    const CLOSE: f64 = 0.05;
    let [ones, twos, fours, eights] =
        [1, 2, 4, 8].map(|side| format!("output.chunks=[{side},{side}]"));
    let quick = ["output.xdmf=false", "solver.tolerance=0.01", "time.end=0.003"];
    let sized =
        |cells: usize| ["axis.0.x.cells", "axis.0.v.cells"].map(|axis| format!("{axis}={cells}"));
    let plane = [
        "axis.0.x.cells=30", "axis.1.x.cells=30", "axis.0.v.cells=18", "axis.1.v.cells=16",
        "output.chunks=[2,2,2,2]",
    ];
    let compressed = "output.compression=4";
    let times = "output.fields_every=0.001";
    // Cells along both axes, chunks, other settings, and ranks.
    let rows: [(usize, &str, &[&str], usize); 12] = [
        (128, &ones, &[], 1),
        (128, &ones, &[], 4),
        (128, &ones, &[compressed], 1),
        (128, &ones, &[compressed], 2),
        (256, &twos, &[], 1),
        (256, &twos, &[compressed], 4),
        (512, &fours, &[], 1),
        (512, &fours, &[], 2),
        (512, &fours, &[compressed], 2),
        (512, &eights, &[], 2),
        (512, &eights, &[compressed], 1),
        (64, &ones, &[times], 2),
    ];
    let grids = rows.map(|row| sized(row.0));
    let settings = rows.map(|row| [&[row.1], row.2, &quick].concat());
    let grids = grids.each_ref().map(|grid| grid.each_ref().map(String::as_str));
    let mut rows: Vec<Row<'_>> = (rows.iter().zip(&grids).zip(&settings))
        .map(|((row, grid), settings)| ("example1.toml", &grid[..], &settings[..], row.3, CLOSE))
        .collect();
    let in_the_plane = [&plane[..], &quick].concat();
    rows.extend([1, 2].map(|ranks| ("barrier2d.toml", &[][..], &in_the_plane[..], ranks, CLOSE)));
    take_as_planned(&rows);
}

/// What is kept of a thousand regions of `V` is planned, too.
#[test]
fn a_thousand_regions_take_the_planned_memory() {
    let regions = |value: fn(usize) -> String| {
        let region = |k: usize| {
            let end = -1.5 + 0.003 * (k + 1) as f64;
            format!("{{where='x < {end:.4}',value={}}}", value(k))
        };
        let all: Vec<String> = (0..999).map(region).collect();
        format!("potential=[{},{{value=0}}]", all.join(","))
    };
    let steps = regions(|k| format!("0.000{k:03}"));
    let slopes = regions(|k| format!("'0.000{k:03}*x'"));
    let size = ["axis.0.x.cells=2000", "axis.0.v.cells=16", "time.end=0.003"];
    // Limited slopes keep what is behind each face with a jump.
    let wide = ["axis.0.x.cells=2000", "axis.0.v.cells=400", "time.end=0.0005"];
    let limited = [&steps, "exact={f='0'}", SLOPES[0], SLOPES[1], "scheme.limiter=minmod"];
    let [steps, slopes] = [&steps, &slopes].map(|regions| [regions.as_str(), "exact={f='0'}"]);
    let rows: &[Row<'_>] = &[
        ("example1.toml", &size, &steps, 1, 0.05),
        ("example1.toml", &size, &steps, 2, 0.05),
        ("example1.toml", &size, &slopes, 1, 0.05),
        ("example1.toml", &size, &slopes, 2, 0.05),
        ("example1.toml", &wide, &limited, 1, 0.05),
        ("example1.toml", &wide, &limited, 2, 0.05),
    ];
    take_as_planned(rows);
}

/// So does that of the factors of implicit methods.
#[test]
fn factors_take_no_more_memory_than_planned() {
    const CLOSE: f64 = 0.05;
    let grid = |x: usize, v: usize| [format!("axis.0.x.cells={x}"), format!("axis.0.v.cells={v}")];
    let lines = [(160, 150), (300, 300), (400, 400), (1000, 60)].map(|(x, v)| grid(x, v));
    let [line, square, large, long] =
        lines.each_ref().map(|line| line.each_ref().map(String::as_str));
    let plane = ["axis.0.x.cells=16", "axis.1.x.cells=16"];
    let elements = ["axis.0.x.cells=20", "axis.0.v.cells=20", "scheme.degree=5"];
    let strip = ["axis.0.x.cells=10", "axis.0.v.cells=120", "scheme.degree=3"];
    let quadratic = ["axis.0.x.cells=60", "axis.0.v.cells=60", "scheme.degree=2"];
    let linear = ["axis.0.x.cells=160", "axis.0.v.cells=160", "scheme.degree=1"];
    let plane_elements = [
        "axis.0.x.cells=6", "axis.0.v.cells=4", "axis.1.x.cells=6", "axis.1.v.cells=4",
        "scheme.degree=2",
    ];
    let sides = ["axis.0.x.cells=10", "axis.1.x.cells=10"];
    let slopes = ["potential.0.value='0.2+0.1*x-0.1*y'", "potential.1.value='0.1*x+0.1*y'"];
    let sloped = [&["axis.0.x.cells=8"], &slopes[..]].concat();
    let sloped_plane = [&sides[..], &["axis.0.v.cells=10", "axis.1.v.cells=10"], &slopes].concat();
    let sloped_elements = [&plane_elements[..4], &["scheme.degree=1"], &slopes].concat();
    let entering = [&large[..], &["potential=[{value='0.2*sin(3*x)'}]"]].concat();
    let rows: &[(&str, &[&str], usize)] = &[
        ("example1.toml", &line, 1),
        ("example1.toml", &large, 1),
        ("example1.toml", &large, 2),
        ("example1.toml", &linear, 1),
        ("slope_jump.toml", &line, 1),
        ("slope_jump.toml", &line, 2),
        ("slope_jump.toml", &square, 1),
        ("slope_jump.toml", &large, 2),
        ("slope_jump.toml", &long, 1),
        ("slope_jump.toml", &elements, 1),
        ("slope_jump.toml", &strip, 1),
        ("slope_jump.toml", &quadratic, 1),
        ("inflow_barrier.toml", &large, 1),
        ("inflow_barrier.toml", &entering, 2),
        ("barrier2d.toml", &plane, 1),
        ("barrier2d.toml", &plane_elements, 1),
        ("barrier2d.toml", &plane_elements, 2),
        ("barrier2d.toml", &sloped, 2),
        ("barrier2d.toml", &sloped_plane, 1),
        ("barrier2d.toml", &sloped_elements, 2),
    ];
    let implicit = "solver.propagator={method='crank-nicolson',step=0.02}";
    check_all(rows, |(name, size, ranks)| {
        let job = run(name).set(size).set(&[implicit, "time.end=0.02", "solver.tolerance=0.1"]);
        let job = job.with_plugins();
        let job = if *ranks > 1 { job.with(["--ranks-x", "2"]) } else { job };
        let summary = job.on(*ranks).summary()?;
        let (more, words) = planned_above_peak(&summary, *ranks)?;
        println!("{name} {size:?} on {ranks}: {words}");
        summary.require((-0.01..=CLOSE).contains(&more), || words)
    });
}

/// Before the matrix is assembled, the factors are estimated from the grid. A plan does so where
/// many cells would be assembled for a long time.
#[test]
fn factors_are_estimated_before_the_matrix_is_there() {
    let implicit = "solver.propagator={method='crank-nicolson',step=0.001}";
    let sizes = [(400, 400), (3000, 60)]
        .map(|(x, v)| [format!("axis.0.x.cells={x}"), format!("axis.0.v.cells={v}")]);
    let [square, long] = sizes.each_ref().map(|size| size.each_ref().map(String::as_str));
    let rows = [("slope_jump.toml", square), ("slope_jump.toml", long), ("example1.toml", square)];
    check_all(&rows, |(name, size)| {
        let factors = |end: &str| {
            let whole = "solver.reduce=false";
            let job = plan(name, 1).set(size).set(&[implicit, "solver.tolerance=0.1", whole, end]);
            let value = job.with(["--json"]).succeed()?.json()?;
            let arrays = value["layout"]["arrays"].as_array().ok_or("no arrays")?;
            let found = arrays.iter().find(|array| array[0] == "factors");
            found.and_then(|array| array[1].as_f64()).ok_or(format!("no factors: {arrays:?}"))
        };
        let (taken, estimated) = (factors("time.end=0.001")?, factors("time.end=10")?);
        println!("{name} {size:?}: {estimated:e} estimated, {taken:e} taken");
        if taken == estimated {
            return Err(format!("{name} {size:?}: assembled in both plans"));
        }
        near("factors as estimated over those taken", estimated / taken, 1.0, 0.25)
    });
}

/// Memory does not grow with the number of modes.
#[test]
fn memory_does_not_grow_with_the_modes() {
    let peak = |tolerance: &str| {
        let summary = run("example1.toml")
            .set(&["axis.0.x.cells=256", "axis.0.v.cells=256", "time.end=0.05"])
            .set(&[&format!("solver.tolerance={tolerance}")])
            .summary()
            .unwrap();
        let anonymous = summary.number("memory_anonymous_bytes_per_rank").unwrap();
        (summary.number("modes").unwrap(), anonymous + program_file_bytes(1) as f64)
    };
    let ((few, low), (many, high)) = (peak("1e-2"), peak("1e-12"));
    assert!(many > 2.0 * few, "{few} and {many} modes");
    assert!(high < 1.05 * low, "{low} bytes for {few} modes, {high} bytes for {many}");
}
