//! Pictures of a finished run, from its files alone.
//!
//! | picture | what it shows | where |
//! |---|---|---|
//! | `phase_space` | fields on the planes (x_a, v_a), beside the exact ones | `phase_space` |
//! | `movie` | phase space and density at all times (`phasewarp movie`) | `film` |
//! | `moments`; `density`, `velocity` | in one dimension as lines, in more as maps | `moments` |
//! | `history` | mass, energy and, in one dimension, density at the output times | `history` |
//! | `profile` | `g(p)`, where it is read, and its error against `e^{−p}` there | `profile` |
//! | `modes` | weights and applications by wavenumber | `profile` |
//! | `plateau`, `readout` | readings at other `p`; quantum measurements | `profile`, `readout` |
//! | `time` | seconds by step | `history` |
//!
//! A picture that does not apply to a run, such as the profile of a classical run, is not drawn. If
//! the files lack the data of a picture, it is left out with a message. A second run on the same
//! grid can be drawn beside the first.
//!
//! Functions that read a run or draw it fail with a sentence that names the data that the files
//! lack ([`FileResult`]).

pub mod cut;
pub mod film;
pub mod history;
pub mod jumps;
pub mod maps;
mod mesh;
pub mod moments;
pub mod phase_space;
pub mod profile;
pub mod readout;
pub mod runs;
pub mod stored;

use crate::base::error::{Error, Result};
use crate::results::FileResult;
use crate::results::figure::Figure;
use crate::results::pictures::cut::Cut;
use crate::results::pictures::runs::Runs;
use crate::results::pictures::stored::StoredRun;
use std::path::{Path, PathBuf};

/// The folder of pictures in the directory of a run.
pub const FOLDER: &str = "plots";
/// Name of movies; a number may follow.
pub const MOVIE: &str = "movie";
/// Endings of pictures and movies.
const ENDINGS: [&str; 4] = [".svg", ".png", ".gif", ".webm"];
/// Names of pictures; a number may follow.
const NAMES: [&str; 11] = [
    MOVIE, "phase_space", "moments", "density", "velocity", "history", "profile", "modes",
    "plateau", "readout", "time",
];

/// The files of pictures and movies in `directory/plots`, relative to `directory`.
pub fn files(directory: &Path) -> Vec<PathBuf> {
    let is_ours = |name: &str| {
        let stem = ENDINGS.iter().find_map(|ending| name.strip_suffix(ending));
        stem.is_some_and(|stem| {
            let numbered = stem.rsplit_once('_').filter(|(_, n)| n.parse::<u32>().is_ok());
            NAMES.contains(&numbered.map_or(stem, |(name, _)| name))
        })
    };
    let entries = std::fs::read_dir(directory.join(FOLDER)).into_iter().flatten();
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    names.filter(|name| is_ours(name)).map(|name| Path::new(FOLDER).join(name)).collect()
}

/// The name of the `k`-th picture or movie called `name`, from 1.
pub fn numbered(name: &str, k: usize) -> String {
    if k == 1 { name.to_owned() } else { format!("{name}_{k}") }
}

/// A figure and the name of its files.
pub struct Picture {
    /// Name of the files, without an ending.
    pub name: String,
    /// The figure.
    pub figure: Figure,
}

/// The pictures of a run.
pub struct Album {
    /// The pictures in the order in which they are shown.
    pub pictures: Vec<Picture>,
    /// Names of pictures that could not be drawn, and why.
    pub left_out: Vec<(String, String)>,
}

/// Draws all pictures of `run`, next to those of `beside`: phase space through each of `cuts`,
/// moments through the first.
///
/// # Errors
/// [`Error::Input`] if the two runs are not on the same grid.
pub fn draw(run: &StoredRun, beside: Option<&StoredRun>, cuts: &[Cut]) -> Result<Album> {
    if let Some(other) = beside
        && other.space != run.space
    {
        return Err(Error::Input(format!(
            "--beside {}: it is on another grid than {}; the same axes and cells are needed",
            other.directory.display(),
            run.directory.display()
        )));
    }
    let runs = Runs::new(run, beside);
    let densest = Cut::densest(run, &[run.end()]);
    let cuts = if cuts.is_empty() { std::slice::from_ref(&densest) } else { cuts };
    let mut album = Album { pictures: Vec::new(), left_out: Vec::new() };
    for (k, cut) in (1..).zip(cuts) {
        album.add(&numbered("phase_space", k), phase_space::draw(&runs, cut).map(Some));
    }
    if run.dimension() == 1 {
        album.add("moments", moments::lines(&runs).map(Some));
    } else {
        album.add("density", moments::density(&runs, &cuts[0]).map(Some));
        album.add("velocity", moments::velocity(&runs, &cuts[0]).map(Some));
    }
    album.add("history", history::draw(&runs));
    album.add("profile", profile::draw(run));
    album.add("modes", profile::modes(run));
    album.add("plateau", profile::plateau(run));
    album.add("readout", readout::draw(run));
    album.add("time", history::time(run).map(Some));
    Ok(album)
}

impl Album {
    fn add(&mut self, name: &str, drawn: FileResult<Option<Figure>>) {
        debug_assert!(NAMES.iter().any(|known| name.starts_with(known)), "{name}");
        match drawn {
            Ok(Some(figure)) => self.pictures.push(Picture { name: name.to_owned(), figure }),
            Ok(None) => {}
            Err(why) => self.left_out.push((name.to_owned(), why)),
        }
    }

    /// The names of the files that [`write`](Self::write) writes.
    pub fn file_names(&self) -> Vec<String> {
        let names = self.pictures.iter().map(|picture| &picture.name);
        names.flat_map(|name| ["svg", "png"].map(|end| format!("{name}.{end}"))).collect()
    }

    /// Writes every picture as SVG and PNG into `directory`; returns the paths.
    ///
    /// # Errors
    /// [`Error::Directory`], [`Error::Output`].
    pub fn write(&self, directory: &Path) -> Result<Vec<PathBuf>> {
        crate::base::disk::make(directory)?;
        let mut written = Vec::new();
        for picture in &self.pictures {
            written.extend(picture.figure.write(directory, &picture.name)?);
        }
        Ok(written)
    }
}
