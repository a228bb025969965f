//! `phasewarp plot` and `phasewarp report`: a finished run as pictures, and as a page.

use crate::base::disk::failure;
use crate::base::error::{Error, Result};
use crate::base::log::say;
use crate::command::cli::DrawnArgs;
use crate::command::understood::understood;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::results::pictures;
use crate::results::pictures::Album;
use crate::results::pictures::cut::Cut;
use crate::results::pictures::stored::Stored;
use crate::results::report::{Report, missing};
use crate::run::planning::with_start;
use crate::scheme::reduce::reduced;
use std::path::PathBuf;

/// Space with more cells than this is not looked at again for what a report says of the case.
const MOST_POINTS: usize = 10_000_000;

/// What was written.
pub struct Drawn {
    files: Vec<PathBuf>,
    left_out: Vec<(String, String)>,
}

impl Drawn {
    /// Says it, on standard output.
    pub fn tell(&self) {
        for (name, why) in &self.left_out {
            say(&format!("{name}: left out: {why}"));
        }
        for file in &self.files {
            say(&file.display().to_string());
        }
    }
}

/// Draws a run; the first rank reads and writes. Collective.
///
/// # Errors
/// As [`Stored::open`], [`Cut::parse`], [`pictures::draw`] and [`Album::write`], the same on all ranks.
pub fn plot(world: &World, args: &DrawnArgs) -> Result<Drawn> {
    alone(world, || {
        let (_, album) = album(args)?;
        let directory = args.output.clone();
        let directory = directory.unwrap_or_else(|| args.directory.join("plots"));
        let files = album.write(&directory)?;
        Ok(Drawn { files, left_out: album.left_out })
    })
}

/// Writes a report; the first rank reads and writes. Collective.
///
/// # Errors
/// As [`plot()`]; [`Error::Input`] where there is no `summary.json`.
pub fn report(world: &World, args: &DrawnArgs) -> Result<Drawn> {
    let group = world.group();
    let opened = group.agree(match group.rank() {
        0 => album(args).map(Some),
        _ => Ok(None),
    })?;
    let said = said(world, opened.as_ref().map(|(run, _)| run));
    alone(world, || {
        let Some((run, album)) = opened else {
            return Ok(nothing());
        };
        let summary = run.summary.as_ref().map_err(|why| {
            let what = "a directory that `phasewarp run` wrote is expected";
            Error::Input(format!("{why}; {what}"))
        })?;
        let missing = missing(summary);
        let page = Report {
            run: &run,
            summary,
            album: &album,
            understood: said.as_deref().map_err(String::as_str),
        };
        let page = page.html()?;
        let directory = args.output.as_ref().unwrap_or(&args.directory);
        crate::base::disk::make(directory)?;
        let path = directory.join("report.html");
        std::fs::write(&path, page).map_err(|e| failure(&path, &e))?;
        let mut left_out = album.left_out;
        left_out.extend(missing);
        if let Err(why) = said {
            left_out.push(("what was understood".to_owned(), why));
        }
        Ok(Drawn { files: vec![path], left_out })
    })
}

/// What `phasewarp check` says of the case of a run, which the first rank has: without what the run left out too. Why nothing is said, otherwise. Collective.
fn said(world: &World, run: Option<&Stored>) -> std::result::Result<String, String> {
    let group = world.group();
    // Name, text and overrides; or why they are not understood.
    let told = run.map(|run| match &run.case {
        Ok(case) if case.space.space_cells() > MOST_POINTS => {
            Err(format!("more than {MOST_POINTS} cells of space"))
        }
        Ok(case) => Ok((&case.name, &run.text, &run.overrides)),
        Err(why) => Err(why.clone()),
    });
    let told = told.and_then(|told| serde_json::to_string(&told).ok());
    let told = group.broadcast_text(&told.unwrap_or_default());
    type BatchStatistics = std::result::Result<(String, String, Vec<String>), String>;
    let told: BatchStatistics = serde_json::from_str(&told).map_err(|e| e.to_string())?;
    let (name, text, overrides) = told?;
    let found = || -> Result<String> {
        let case = Case::parse(&name, &text, &overrides)?;
        let case = reduced(&group, &*with_start(&group, &case)?)?;
        Ok(understood(&case, &Bounds::new(&case)?))
    };
    found().map_err(|e| e.to_string())
}

/// Of ranks that write nothing.
fn nothing() -> Drawn {
    Drawn { files: Vec::new(), left_out: Vec::new() }
}

/// What the first rank does; the others learn how it went. Collective.
fn alone(world: &World, work: impl FnOnce() -> Result<Drawn>) -> Result<Drawn> {
    let group = world.group();
    group.agree(if group.rank() == 0 { work() } else { Ok(nothing()) })
}

/// The run and its pictures.
fn album(args: &DrawnArgs) -> Result<(Stored, Album)> {
    let run = Stored::open(&args.directory)?;
    let beside = (args.beside.as_deref()).map(Stored::open).transpose()?;
    let cuts = args.slices.iter().map(|text| Cut::parse(&run, text));
    let cuts: Vec<Cut> = cuts.collect::<Result<_>>()?;
    let album = pictures::draw(&run, beside.as_ref(), &cuts)?;
    Ok((run, album))
}
