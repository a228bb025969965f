//! The frames of a movie: phase space and density at all times at which a run has fields.
//!
//! All frames share ends of axes and colours, so they are read twice. They have the same size, and
//! their titles differ only in the time.

use crate::base::text::short;
use crate::problem::case::ExactTimes;
use crate::problem::grid::MAX_DIMENSION;
use crate::results::FileResult;
use crate::results::figure::palette::Style;
use crate::results::figure::{Figure, Layer, Panel, PlotAxis};
use crate::results::pictures::cut::Cut;
use crate::results::pictures::jumps::{borders, jumps, note_on_ends};
use crate::results::pictures::maps::{FRAME, ValueSpread, bordered, columns, map, undershoots};
use crate::results::pictures::moments::planes;
use crate::results::pictures::phase_space::{concentrated, surface};
use crate::results::pictures::stored::{Plane, StoredRun, StoredTime};

/// The frames of a run.
pub struct Film<'a> {
    run: &'a StoredRun,
    cut: Cut,
    times: Vec<StoredTime>,
    /// The reason why there is no exact density, if the case names an exact solution.
    pub without_exact: Option<String>,
    scales: FrameRanges,
    /// Faces along each axis of space at which `V` jumps, the same in all frames.
    faces: Vec<Vec<f64>>,
    /// Borders at which `V` jumps in each plane of two space axes, as pieces of lines.
    borders: Vec<Vec<[f64; 2]>>,
}

/// The ranges of values of all frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct FrameRanges {
    /// Ranges of the fields by plane of phase space. Fields may be far smaller on one plane than on
    /// another.
    fields: [ValueSpread; MAX_DIMENSION],
    density: ValueSpread,
}

impl<'a> Film<'a> {
    /// The film of `run` at `times`, through `cut`.
    pub fn new(run: &'a StoredRun, cut: &Cut, times: Vec<StoredTime>) -> FileResult<Self> {
        // Older versions wrote no exact density, or none before the end.
        let early = run.has("history").then_some("history/density_exact");
        let lacking = ["density_exact"].into_iter().chain(early).find(|name| !run.has(name));
        let case = run.case.as_ref().ok().filter(|case| case.exact.is_some());
        let without_exact = lacking.zip(case).map(|(name, case)| {
            let remedy = match case.exact_times {
                ExactTimes::All => "run the case again",
                ExactTimes::End => "run the case with exact.moments = \"all\"",
            };
            format!("there is no /{name} in result.h5; {remedy}")
        });
        let n = run.dimension();
        let mut film = Self {
            run,
            cut: cut.clone(),
            times,
            without_exact,
            scales: FrameRanges::default(),
            faces: (0..n).map(|a| jumps(run, a, &cut.cells)).collect(),
            borders: planes(n).into_iter().map(|plane| borders(run, plane, &cut.cells)).collect(),
        };
        let mut scales = FrameRanges::default();
        for k in 0..film.count() {
            scales.include(&film.frame(k)?, n);
        }
        film.scales = scales;
        Ok(film)
    }

    /// The number of frames.
    pub fn count(&self) -> usize {
        self.times.len()
    }

    /// The time of a frame.
    pub fn time(&self, k: usize) -> f64 {
        self.times[k].time
    }

    /// Whether the file has the exact density at all times.
    fn has_exact(&self) -> bool {
        self.run.has("density_exact") && self.without_exact.is_none()
    }

    /// A frame: fields on the planes of phase space first, then the density.
    pub fn frame(&self, k: usize) -> FileResult<Figure> {
        let (run, n, at) = (self.run, self.run.dimension(), self.times[k]);
        let mut panels = Vec::new();
        let mut caption = "Axes and colours are the same at all times.".to_owned();
        if self.faces.iter().any(|faces| !faces.is_empty()) {
            caption += " Lines in grey: where V jumps.";
        }
        for (a, faces) in self.faces.iter().enumerate() {
            panels.push(self.field(at, a)?.verticals(faces));
            caption += &note_on_ends(run, a, faces);
        }
        caption += self.cut.sentence(run);
        let maps = self.scales.fields[..n].iter().chain((n > 1).then_some(&self.scales.density));
        caption += &undershoots(maps.filter_map(ValueSpread::undershoot).reduce(f64::min));
        match n {
            1 => panels.push(self.density_line(at)?),
            _ => panels.extend(self.density_maps(at)?),
        }
        let columns = columns(panels.len());
        let title = format!("{}\nt = {}", run.title(), short(at.time));
        Ok(Figure::new(title, panels).columns(columns).frame(FRAME[0], FRAME[1]).caption(caption))
    }

    /// The field on the plane (x_a, v_a): `f`. For measure-valued data it is `φ`, but in one
    /// dimension `φ δ(ψ)`, or the zeros of `ψ` of elements.
    fn field(&self, at: StoredTime, a: usize) -> FileResult<Panel> {
        let (run, n) = (self.run, self.run.dimension());
        let plane = [a, n + a];
        let place = self.cut.at(run, plane, 0..2 * n);
        let title = |name: &str| format!("{name}{place}");
        if !run.is_measure() {
            let field = run.field_plane(at, "f", plane, &self.cut.cells)?;
            return Ok(self.map(plane, title("f"), field, self.scales.fields[a]));
        }
        if n == 1 && run.space.degree() > 0 {
            let [x, v] = plane.map(|a| run.drawn_axis(a));
            return Ok(Panel::new("zeros of ψ", x, v).points("", Style::of(0), surface(run, at)?));
        }
        if n == 1 && run.case.is_ok() {
            let field = concentrated(run, at)?;
            return Ok(self.map(plane, title("φ δ(ψ)"), field, self.scales.fields[a]));
        }
        let field = run.field_plane(at, "phi", plane, &self.cut.cells)?;
        Ok(self.map(plane, title("φ"), field, self.scales.fields[a]))
    }

    fn map(&self, axes: [usize; 2], title: String, plane: Plane, values: ValueSpread) -> Panel {
        map(self.run, axes, title, plane, values.range(0.0))
    }

    /// The density over `x` in one dimension, with the exact one.
    fn density_line(&self, at: StoredTime) -> FileResult<Panel> {
        let mut axis = PlotAxis::linear("density");
        if let Some([lower, upper]) = self.scales.density.ends {
            let least = 1e-3 * lower.abs().max(upper.abs()).max(f64::MIN_POSITIVE);
            let margin = (0.05 * (upper - lower)).max(least);
            axis = axis.within(lower - margin, upper + margin);
        }
        let mut panel = Panel::new("density", self.run.drawn_axis(0), axis);
        let exact = self.has_exact();
        if exact {
            let points = self.run.line(&self.run.moment(at, "density_exact")?);
            panel = panel.line("exact", Style::of(2).plain(), points);
        }
        let points = self.run.line(&self.run.moment(at, "density")?);
        let label = if exact { "computed" } else { "" };
        Ok(panel.line(label, Style::of(0).plain(), points).verticals(&self.faces[0]))
    }

    /// The density on every plane of two space axes in more than one dimension, then the exact
    /// ones. In three dimensions each of them is a row, with the exact one below.
    fn density_maps(&self, at: StoredTime) -> FileResult<Vec<Panel>> {
        let run = self.run;
        let mut panels = Vec::new();
        let exact = self.has_exact().then_some(("exact density", "density_exact"));
        for (title, name) in [("density", "density")].into_iter().chain(exact) {
            for (plane, border) in planes(run.dimension()).into_iter().zip(&self.borders) {
                let cells = &self.cut.cells[..run.dimension()];
                let field = run.moment_plane(at, name, plane, cells)?;
                let place = self.cut.at(run, plane, 0..run.dimension());
                let title = format!("{title}{place}");
                let panel = self.map(plane, title, field, self.scales.density);
                panels.push(bordered(panel, border));
            }
        }
        Ok(panels)
    }
}

impl FrameRanges {
    /// Widens the ranges to include a frame whose first `fields` panels show fields.
    fn include(&mut self, frame: &Figure, fields: usize) {
        for (k, panel) in frame.panels.iter().enumerate() {
            let scale = if k < fields { &mut self.fields[k] } else { &mut self.density };
            let maps = panel.layers.iter().any(|layer| matches!(layer, Layer::Map(_)));
            for layer in &panel.layers {
                match layer {
                    Layer::Map(map) => scale.include(map.values.iter().copied()),
                    // Lines over maps are borders of regions.
                    Layer::Line { points, .. } if !maps => {
                        scale.include(points.iter().map(|point| point[1]));
                    }
                    _ => {}
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::figure::Map;

    #[test]
    fn scales_hold_all_frames_but_no_borders() {
        let map = |values: Vec<f64>| Map {
            x: [0.0, 1.0],
            y: [0.0, 1.0],
            shape: [1, values.len()],
            values,
            range: None,
            differences: false,
            label: String::new(),
        };
        let panel = || Panel::new("", PlotAxis::linear("x"), PlotAxis::linear("y"));
        let borders = vec![[0.0, 50.0], [0.0, -50.0]];
        let mut scales = FrameRanges::default();
        for (field, density) in [(3.0, 1.0), (-1.0, 7.0), (f64::NAN, 2.0)] {
            let density =
                panel().map(map(vec![density])).line("", Style::theory(), borders.clone());
            let panels = vec![panel().map(map(vec![field, 0.0])), density];
            scales.include(&Figure::new("", panels), 1);
        }
        assert_eq!(scales.fields.map(|field| field.ends), [Some([-1.0, 3.0]), None, None]);
        assert_eq!(scales.density.ends, Some([1.0, 7.0]));
    }
}
