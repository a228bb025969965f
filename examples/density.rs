//! Solves a case as a library and prints the density: `mpirun -np 2 cargo run --release --example
//! density -- CASE`.

use phasewarp::{Case, World, plan, solve};
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1);
    let path = PathBuf::from(path.unwrap_or_else(|| "cases/example1.toml".to_owned()));
    let world = World::start().ok_or("MPI was started before")?;
    let case = Case::load(&path, &["solver.tolerance=1e-3".to_owned()])?;
    let first = world.group().rank() == 0;
    if first {
        println!("{}", case.title);
    }
    let planned = plan(&world, &case)?;
    let solution = solve(&world, &case)?;
    if first {
        let applications = planned.warp.as_ref().map_or(0, |warp| warp.applications);
        println!("applications: {applications} planned, {} done", solution.summary.matvecs);
        println!("error estimate: {:?}", solution.summary.error_estimate);
    }
    // Each rank has its share of the space cells.
    let axis = &solution.case.space.x[0];
    for (cell, density) in solution.share[0].clone().zip(&solution.results.moments.density) {
        println!("x = {:8.4}  density = {density:.6}", axis.centre(cell as i64));
    }
    Ok(())
}
