//! `phasewarp init`: writes a case file to start from.

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::base::text::quoted;
use crate::command::cli::InitArgs;
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::problem::grid::SPACE_NAMES;

/// Grid of the written case, coarse enough for a run of seconds.
struct StarterGrid {
    degree: usize,
    /// Elements along x and vx; `V` jumps along x.
    first: [usize; 2],
    /// Elements along each other space axis and its velocity axis.
    others: [usize; 2],
}

/// The grids in one, two and three dimensions.
const STARTER_GRIDS: [StarterGrid; 3] = [
    StarterGrid { degree: 2, first: [60, 48], others: [0, 0] },
    StarterGrid { degree: 2, first: [14, 10], others: [5, 4] },
    StarterGrid { degree: 1, first: [8, 6], others: [3, 2] },
];

/// Writes a case file, on the first rank. Collective.
///
/// # Errors
/// [`Error::Input`] if the file exists and `--force` is not given; [`Error::Output`].
pub fn execute(world: &World, args: &InitArgs) -> Result<()> {
    world.group().on_first_rank(|| {
        if !args.force && disk::is_taken(&args.file) {
            let file = args.file.display();
            return Err(Error::Input(format!("{file} exists; --force replaces it")));
        }
        disk::write(&args.file, text(usize::from(args.dimension)).as_bytes())
    })?;
    let file = args.file.display();
    let word = quoted(&file.to_string());
    let next = format!("  phasewarp check {word}\n  phasewarp run {word}");
    print(world, &format!("{file} is written. Change it, then:\n{next}"));
    Ok(())
}

/// A case in `n` dimensions: a beam meets a step up, which reflects its slow part.
pub fn text(n: usize) -> String {
    let StarterGrid { degree, first, others } = STARTER_GRIDS[n - 1];
    let mut text = format!(
        "# A case of phasewarp: a cloud of particles meets a potential step, in {n} dimension{}.\n\
         # docs/usage.md lists all keys; `phasewarp schema` lists them for an editor.\n\
         title = \"A cloud at a step\"\n\n",
        if n == 1 { "" } else { "s" }
    );
    (0..n).for_each(|a| text += &axis_text(a, if a == 0 { first } else { others }));
    let velocity = if n == 1 { "v" } else { "vx" };
    let mut square = format!("((x + 0.5)/0.2)^2 + (({velocity} - 0.7)/0.15)^2");
    for a in 1..n {
        let (x, v) = (SPACE_NAMES[a], ["vx", "vy", "vz"][a]);
        square += &format!(" + ({x}/0.4)^2 + ({v}/0.3)^2");
    }
    text + &format!(
        "[[potential]]                # V: the first region whose condition holds gives its value\n\
         where = \"x < 0\"\n\
         value = \"0\"\n\
         [[potential]]                # the last region has no condition\n\
         value = \"0.2\"                # particles with {velocity}^2 < 0.4 are reflected\n\n\
         [initial]                    # f at t = 0\n\
         f = \"exp(-({square})/2)\"\n\n\
         [inflow]                     # f of particles that enter through the ends of the box\n\
         value = \"0\"\n\n\
         [time]\n\
         end = 1.0\n\n\
         [scheme]\n\
         degree = {degree}                   # of the elements; 0: finite volumes, first order\n\
         interface = \"conservative\"   # of degree 0 only: keeps the mass where V jumps\n\n\
         [solver]\n\
         method = \"schrodingerized\"   # or \"classical\"\n\
         tolerance = 1e-2             # relative l2 distance to the semi-discrete solution\n\n\
         [exact]                      # what the result is compared with\n\
         kind = \"characteristics\"     # particles are traced back; or f = \"formula\" with t\n\n\
         [output]\n\
         moments_every = 0.25         # density and momentum also at these times\n"
    )
}

/// The table of axis `a` with these numbers of elements in space and in velocity. Only the first
/// axis, along which `V` jumps, has ends.
fn axis_text(a: usize, [cells, velocities]: [usize; 2]) -> String {
    let x = SPACE_NAMES[a];
    match a {
        0 => format!(
            "[[axis]]                     # one table for each space dimension: x, y, z\n\
             # space: V may jump only at faces of cells, here at x = 0\n\
             x = {{ lower = -1, upper = 1, cells = {cells} }}\n\
             # velocity: wide enough for particles that the step slows down or reflects\n\
             v = {{ lower = -1.2, upper = 1.2, cells = {velocities} }}\n\n"
        ),
        _ => format!(
            "[[axis]]                     # {x}: particles that leave at one end enter at the \
             other\n\
             x = {{ lower = -1, upper = 1, cells = {cells}, boundary = \"periodic\" }}\n\
             v = {{ lower = -1.2, upper = 1.2, cells = {velocities} }}\n\n"
        ),
    }
}
