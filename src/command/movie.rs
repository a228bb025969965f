//! `phasewarp movie`: a finished run at all times at which it stored fields.

use crate::base::disk::failure;
use crate::base::error::{Error, Result};
use crate::base::text::short;
use crate::command::cli::MovieArgs;
use crate::command::plot::{PictureDirectory, WrittenFiles, open};
use crate::parallel::communicator::World;
use crate::results::movie::{self, MOST_FRAMES};
use crate::results::pictures::cut::Cut;
use crate::results::pictures::film::Film;
use crate::results::pictures::stored::{StoredRun, StoredTime};
use crate::results::pictures::{MOVIE, numbered};

/// Writes the movies of a run; the first rank reads and writes. Collective.
///
/// # Errors
/// As `open`, [`Cut::parse`] and [`movie::write`], the same on all ranks;
/// [`Error::Input`] if there is only one time, or too many.
pub fn execute(world: &World, args: &MovieArgs) -> Result<()> {
    let written = world.group().on_first_rank(|| movies(args))?;
    written.print(world);
    Ok(())
}

/// Writes one movie per cut.
fn movies(args: &MovieArgs) -> Result<WrittenFiles> {
    let run = open(&args.places.directory)?;
    let times = times(args, &run)?;
    let cuts = args.slices.iter().map(|text| Cut::parse(&run, text));
    let mut cuts = cuts.collect::<Result<Vec<_>>>()?;
    if cuts.is_empty() {
        cuts.push(Cut::densest(&run, &times));
    }
    let names: Vec<String> = (1..=cuts.len()).map(|k| numbered(MOVIE, k)).collect();
    let place = PictureDirectory::new(&run, args.places.output.as_deref());
    if !args.force {
        let files =
            names.iter().flat_map(|name| ["gif", "webm"].map(|end| format!("{name}.{end}")));
        place.refuse_to_replace(&files.collect::<Vec<_>>())?;
    }
    let mut written = WrittenFiles::default();
    for (name, cut) in names.iter().zip(&cuts) {
        let film = Film::new(&run, cut, times.clone());
        let film = film.map_err(|why| failure(&args.places.directory, &why))?;
        if let Some(why) = &film.without_exact {
            written.left_out.push(("the exact density".to_owned(), why.clone()));
        }
        let movie = movie::write(&film, &place.directory, name, args.fps)?;
        written.files.extend(movie.files);
        written.left_out.extend(movie.left_out);
    }
    place.claim()?;
    Ok(written)
}

/// The times of the frames.
fn times(args: &MovieArgs, run: &StoredRun) -> Result<Vec<StoredTime>> {
    let place = args.places.directory.display();
    let all = run.snapshots().map_err(|why| failure(&args.places.directory, &why))?;
    if all.len() < 2 {
        let begin = run.case.as_ref().map_or(0.0, |case| case.start_time);
        return Err(Error::Input(format!(
            "{place}: it has fields at one time only, t = {}; a movie needs several: set \
             output.fields_every = {}, or output.field_times, and run the case again",
            short(run.time),
            short(advised_interval(begin, run.time))
        )));
    }
    let chosen = chosen(all.len(), args.every as usize);
    let chosen = chosen.map_err(|why| Error::Input(format!("{place}: {why}")))?;
    Ok(chosen.into_iter().map(|k| all[k]).collect())
}

/// The time between fields that gives a movie 20 of them, of a run from `begin` to `end`.
fn advised_interval(begin: f64, end: f64) -> f64 {
    (end - begin) / 20.0
}

/// Indices of every `every`-th of `count` times and of the last one.
///
/// # Errors
/// A sentence that says that these are too many.
fn chosen(count: usize, every: usize) -> std::result::Result<Vec<usize>, String> {
    let chosen: Vec<usize> = (0..count).filter(|k| k % every == 0 || k + 1 == count).collect();
    match chosen.len() {
        ..=MOST_FRAMES => Ok(chosen),
        frames => Err(format!(
            "with --every {every} there are {frames} frames, at most {MOST_FRAMES} are drawn; \
             --every {} takes fewer",
            count.div_ceil(MOST_FRAMES - 1)
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A continued run has its fields between its start and its end.
    #[test]
    fn advice_counts_from_the_start_of_the_run() {
        assert_eq!(advised_interval(0.0, 1.0), 0.05);
        assert_eq!(advised_interval(3.0, 4.0), 0.05);
    }

    #[test]
    fn frames_are_few_and_have_the_end() {
        assert_eq!(chosen(5, 1), Ok(vec![0, 1, 2, 3, 4]));
        assert_eq!(chosen(6, 2), Ok(vec![0, 2, 4, 5]));
        assert_eq!(chosen(3, 100), Ok(vec![0, 2]));
        for count in [MOST_FRAMES + 1, 1501, 10_001] {
            let why = chosen(count, 1).unwrap_err();
            let words = format!("there are {count} frames, at most {MOST_FRAMES} are drawn");
            assert!(why.contains(&words), "{why}");
            // The advice in the message works.
            let advised = why.rsplit("--every ").next().and_then(|n| n.split(' ').next());
            let every = advised.and_then(|n| n.parse().ok()).unwrap_or(1);
            assert!(chosen(count, every).is_ok(), "{why}");
        }
    }
}
