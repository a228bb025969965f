//! Pictures of a finished run, from its files alone.
//!
//! | picture | what it shows | where |
//! |---|---|---|
//! | `phase_space` | fields on the planes (x_a, v_a), beside the exact ones | `phase_space` |
//! | `moments`; `density`, `velocity` | in one dimension as lines, in more as maps | `moments` |
//! | `history` | mass, energy and, in one dimension, density at the output times | `history` |
//! | `profile` | `g(p)`, where it is read, and how it differs from `e^{−p}` where that matters | `profile` |
//! | `modes` | weights and applications by wavenumber | `profile` |
//! | `plateau`, `readout` | readings at other `p`; what a quantum computer would tell | `profile`, `readout` |
//! | `time` | seconds by step | `history` |
//!
//! What a run has none of (a classical one of profiles) has no picture. What its files lack is left out, and said. A second run on the
//! same grid can be drawn beside the first.

pub mod history;
pub mod moments;
pub mod phase_space;
pub mod profile;
pub mod readout;
pub mod stored;

use crate::base::error::{Error, Result};
use crate::problem::potential::Potential;
use crate::results::figure::{Axis, Figure, Layer, Map, Panel};
use crate::results::pictures::stored::{Plane, Read, Stored};
use std::path::{Path, PathBuf};

/// A figure and the name of its files.
pub struct Picture {
    /// Name, without an ending.
    pub name: String,
    /// What is drawn.
    pub figure: Figure,
}

/// The pictures of a run.
pub struct Album {
    /// In the order in which they are to be looked at.
    pub pictures: Vec<Picture>,
    /// Names of those that could not be drawn, and why.
    pub left_out: Vec<(String, String)>,
}

/// Where planes cut the axes that they do not run along: cell by axis in storage order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cut(pub Vec<usize>);

impl Cut {
    /// Through the middle cells (cell N/2, counted from 0), as `fields.xdmf` does.
    pub fn middle(run: &Stored) -> Self {
        Self(
            (0..2 * run.dimension())
                .map(|a| run.axis(a).cells / 2)
                .collect(),
        )
    }

    /// As `text` says, `x=0.1,vy=0`; through the middle along axes that it does not name.
    ///
    /// # Errors
    /// [`Error::Input`] where it names no axis of the run, or a place outside of the box.
    pub fn parse(run: &Stored, text: &str) -> Result<Self> {
        let wrong = |why: String| Error::Input(format!("--slice {text}: {why}"));
        let names = run.names();
        if run.dimension() == 1 {
            let why = "in one dimension all of phase space is shown".to_owned();
            return Err(wrong(why));
        }
        let mut cut = Self::middle(run);
        let mut named = Vec::new();
        for part in text.split(',') {
            let (name, place) = (part.split_once('='))
                .ok_or_else(|| wrong(format!("\"{part}\" is not NAME=POSITION, as x=0.1")))?;
            let a = (names.iter().position(|n| *n == name.trim())).ok_or_else(|| {
                wrong(format!(
                    "\"{}\" is no axis; {} are",
                    name.trim(),
                    names.join(", ")
                ))
            })?;
            if named.contains(&a) {
                return Err(wrong(format!("{} is given twice", names[a])));
            }
            named.push(a);
            let axis = run.axis(a);
            let place: f64 = place
                .trim()
                .parse()
                .map_err(|_| wrong(format!("\"{}\" is not a number", place.trim())))?;
            if !(axis.lower..=axis.upper).contains(&place) {
                let (lower, upper) = (axis.lower, axis.upper);
                let name = names[a];
                return Err(wrong(format!("{name} goes from {lower} to {upper}")));
            }
            let cell = ((place - axis.lower) / axis.width()).floor() as usize;
            cut.0[a] = cell.min(axis.cells - 1);
        }
        Ok(cut)
    }

    /// Where it lies along the axes other than `plane`, in words.
    fn place(&self, run: &Stored, plane: [usize; 2], axes: std::ops::Range<usize>) -> String {
        let others = axes.filter(|a| !plane.contains(a));
        let at = |a: usize| {
            let centre = run.axis(a).centre(self.0[a] as i64);
            format!("{} = {}", run.names()[a], short(centre))
        };
        others.map(at).collect::<Vec<_>>().join(", ")
    }
}

/// A run, the one beside it, and what they are called.
pub struct Runs<'a> {
    run: &'a Stored,
    beside: Option<&'a Stored>,
    names: [String; 2],
}

impl<'a> Runs<'a> {
    fn new(run: &'a Stored, beside: Option<&'a Stored>) -> Self {
        let method = |run: &Stored| match run.plan["method"].as_str() {
            Some("schrodingerized") => "Schrödingerized".to_owned(),
            Some(other) => other.to_owned(),
            None => "computed".to_owned(),
        };
        let mut names = [method(run), beside.map_or(String::new(), method)];
        if let Some(beside) = beside
            && names[0] == names[1]
        {
            let folder = |run: &Stored| {
                let name = run.directory.file_name().unwrap_or_default();
                name.to_string_lossy().into_owned()
            };
            names = [folder(run), folder(beside)];
        }
        Self { run, beside, names }
    }

    /// The run, then the one beside it, each with what it is called.
    fn each(&self) -> impl Iterator<Item = (&'a Stored, &str)> {
        let both = [Some(self.run), self.beside];
        (both.into_iter().zip(&self.names)).filter_map(|(run, name)| Some((run?, name.as_str())))
    }
}

/// Draws all pictures there are of `run`, with `beside` beside it: phase space through each of `cuts`, moments through the first.
///
/// # Errors
/// [`Error::Input`] where the two runs are not on the same grid.
pub fn draw(run: &Stored, beside: Option<&Stored>, cuts: &[Cut]) -> Result<Album> {
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
    let middle = Cut::middle(run);
    let cuts = if cuts.is_empty() {
        std::slice::from_ref(&middle)
    } else {
        cuts
    };
    let mut album = Album {
        pictures: Vec::new(),
        left_out: Vec::new(),
    };
    for (k, cut) in cuts.iter().enumerate() {
        let name = match k {
            0 => "phase_space".to_owned(),
            k => format!("phase_space_{}", k + 1),
        };
        album.add(
            &name,
            crate::results::pictures::phase_space::draw(&runs, cut).map(Some),
        );
    }
    if run.dimension() == 1 {
        album.add(
            "moments",
            crate::results::pictures::moments::lines(&runs).map(Some),
        );
    } else {
        album.add(
            "density",
            crate::results::pictures::moments::density(&runs, &cuts[0]).map(Some),
        );
        album.add(
            "velocity",
            crate::results::pictures::moments::velocity(&runs, &cuts[0]).map(Some),
        );
    }
    album.add("history", crate::results::pictures::history::draw(&runs));
    album.add("profile", crate::results::pictures::profile::draw(run));
    album.add("modes", crate::results::pictures::profile::modes(run));
    album.add("plateau", crate::results::pictures::profile::plateau(run));
    album.add("readout", crate::results::pictures::readout::draw(run));
    album.add(
        "time",
        crate::results::pictures::history::time(run).map(Some),
    );
    Ok(album)
}

impl Album {
    fn add(&mut self, name: &str, drawn: Read<Option<Figure>>) {
        match drawn {
            Ok(Some(figure)) => self.pictures.push(Picture {
                name: name.to_owned(),
                figure,
            }),
            Ok(None) => {}
            Err(why) => self.left_out.push((name.to_owned(), why)),
        }
    }

    /// Writes every picture as SVG and PNG into `directory`; gives the paths.
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

/// Four digits, without zeros that say nothing.
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if (1e-3..1e5).contains(&value.abs()) {
        let digits = 3 - value.abs().log10().floor().max(-4.0) as i32;
        let text = format!("{value:.*}", digits.max(0) as usize);
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    } else {
        let text = format!("{value:.3e}");
        match text.split_once('e') {
            Some((digits, exponent)) if digits.contains('.') => {
                let digits = digits.trim_end_matches('0').trim_end_matches('.');
                format!("{digits}e{exponent}")
            }
            _ => text,
        }
    }
}

/// A panel with a plane of a run over its axes number `axes`.
fn map(
    run: &Stored,
    axes: [usize; 2],
    title: String,
    plane: Plane,
    range: Option<[f64; 2]>,
) -> Panel {
    let names = run.names();
    let ends = axes.map(|a| [run.axis(a).lower, run.axis(a).upper]);
    Panel::new(
        title,
        Axis::linear(names[axes[0]]),
        Axis::linear(names[axes[1]]),
    )
    .map(Map {
        x: ends[0],
        y: ends[1],
        shape: plane.shape,
        values: plane.values,
        range,
        differences: false,
        label: String::new(),
    })
}

/// The same with a difference of values as large as `scale`: zero is in the middle, and round-off looks like zero.
fn apart(run: &Stored, axes: [usize; 2], title: String, plane: Plane, scale: f64) -> Panel {
    let most = largest([&plane]).max(ROUND_OFF * scale);
    let range = (most > 0.0).then_some([-most, most]);
    let mut panel = map(run, axes, title, plane, range);
    for layer in &mut panel.layers {
        if let Layer::Map(map) = layer {
            map.differences = true;
        }
    }
    panel
}

/// Largest finite value, without signs.
fn largest<'a>(planes: impl IntoIterator<Item = &'a Plane>) -> f64 {
    let all = planes.into_iter().flat_map(|p| &p.values);
    all.filter(|v| v.is_finite())
        .fold(0.0, |most, v| v.abs().max(most))
}

/// Part of what a quantity may be that is round-off.
const ROUND_OFF: f64 = 1e-12;

/// The difference of two planes, `a − b`.
fn difference(a: &Plane, b: &Plane) -> Plane {
    Plane {
        shape: a.shape,
        values: a.values.iter().zip(&b.values).map(|(a, b)| a - b).collect(),
    }
}

/// Smallest and largest finite value of all; wider where they differ by round-off of `scale` or a tolerance only, so that what is constant looks so.
fn range<'a>(planes: impl IntoIterator<Item = &'a Plane>, scale: f64) -> Option<[f64; 2]> {
    /// Part of the values that must differ to be told apart.
    const SEEN: f64 = 1e-3;
    let all = planes.into_iter().flat_map(|p| &p.values);
    let finite = all.filter(|v| v.is_finite());
    let [lower, upper] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, u], &v| {
        [l.min(v), u.max(v)]
    });
    if lower > upper {
        return None;
    }
    let least = (SEEN * lower.abs().max(upper.abs())).max(ROUND_OFF * scale);
    if upper - lower < least {
        let middle = 0.5 * (lower + upper);
        return Some([middle - least, middle + least]);
    }
    (lower < upper).then_some([lower, upper])
}

/// Faces at which `V` jumps along space axis `a`, on the line through the cut; none where the case is not understood. The closing face of a periodic
/// axis is there twice, at both ends.
fn jumps(run: &Stored, a: usize, cut: &Cut) -> Vec<f64> {
    let Ok(case) = &run.case else {
        return Vec::new();
    };
    let n = run.dimension();
    let mut ranges: Vec<_> = (0..n).map(|b| cut.0[b]..cut.0[b] + 1).collect();
    ranges[a] = 0..run.axis(a).cells;
    let Ok(potential) = Potential::new(case, &ranges) else {
        return Vec::new();
    };
    let mut cell = cut.0[..n].to_vec();
    let jump = |i: usize| {
        cell[a] = i;
        potential.jump_below(&cell, a) != 0.0
    };
    let places = ranges[a].clone();
    // Below the first cell there is a jump only where the axis closes.
    let mut found: Vec<usize> = places
        .filter({
            let mut jump = jump;
            move |&i| jump(i)
        })
        .collect();
    if found.first() == Some(&0) {
        found.push(run.axis(a).cells);
    }
    found
        .into_iter()
        .map(|i| run.axis(a).face(i as i64))
        .collect()
}

/// Of faces where `V` jumps along axis `a`: the sentence for those at the frame, which hides their lines.
fn closing(run: &Stored, a: usize, jumps: &[f64]) -> String {
    match jumps.contains(&run.axis(a).lower) {
        true => format!(" V jumps too where {} closes, at its ends.", run.names()[a]),
        false => String::new(),
    }
}

/// Borders in a plane of two space axes along which `V` jumps, as pieces of lines with NaN between.
fn borders(run: &Stored, plane: [usize; 2], cut: &Cut) -> Vec<[f64; 2]> {
    /// Beyond so many cells borders are a matter of seconds.
    const MOST: usize = 1 << 22;
    let lengths = plane.map(|a| run.axis(a).cells);
    let Ok(case) = &run.case else {
        return Vec::new();
    };
    if lengths[0] * lengths[1] > MOST {
        return Vec::new();
    }
    let n = run.dimension();
    let mut ranges: Vec<_> = (0..n).map(|b| cut.0[b]..cut.0[b] + 1).collect();
    for a in plane {
        ranges[a] = 0..run.axis(a).cells;
    }
    let Ok(potential) = Potential::new(case, &ranges) else {
        return Vec::new();
    };
    let mut points = Vec::new();
    let mut cell = cut.0[..n].to_vec();
    for i in 0..lengths[0] {
        for j in 0..lengths[1] {
            (cell[plane[0]], cell[plane[1]]) = (i, j);
            let corner = |di: usize, dj: usize| {
                let face = |a: usize, k: usize| run.axis(a).face(k as i64);
                [face(plane[0], i + di), face(plane[1], j + dj)]
            };
            // Below the first cell there is a jump only where the axis closes: at both ends.
            if potential.jump_below(&cell, plane[0]) != 0.0 {
                points.extend([corner(0, 0), corner(0, 1), [f64::NAN; 2]]);
                if i == 0 {
                    let end = lengths[0];
                    points.extend([corner(end, 0), corner(end, 1), [f64::NAN; 2]]);
                }
            }
            if potential.jump_below(&cell, plane[1]) != 0.0 {
                points.extend([corner(0, 0), corner(1, 0), [f64::NAN; 2]]);
                if j == 0 {
                    let end = lengths[1];
                    points.extend([corner(0, end), corner(1, end), [f64::NAN; 2]]);
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_off_is_no_structure() {
        let plane = |values: &[f64]| Plane {
            shape: [1, values.len()],
            values: values.to_vec(),
        };
        let noise = plane(&[5e-18, -5e-18, f64::NAN]);
        let [lower, upper] = range([&noise], 2.0).unwrap();
        assert!(lower < -1e-12 && upper > 1e-12);
        assert_eq!(range([&noise], 0.0), Some([-5e-18, 5e-18]));
        assert_eq!(range([&plane(&[0.0, 2.0])], 2.0), Some([0.0, 2.0]));
        assert_eq!(range([&plane(&[f64::NAN])], 2.0), None);
        assert_eq!(largest([&plane(&[1.0, -3.0, f64::NAN])]), 3.0);
    }

    #[test]
    fn short_numbers() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (1.0, "1"),
            (0.1, "0.1"),
            (-0.0125, "-0.0125"),
            (126.9287, "126.9"),
            (20.0, "20"),
            (1e-6, "1e-6"),
            (12345.0, "12345"),
            (3.25e-9, "3.25e-9"),
        ] {
            assert_eq!(short(value), text);
        }
    }
}
