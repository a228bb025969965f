//! A stability map as a table, as CSV, as JSON and as a figure.

use crate::base::error::Result;
use crate::base::text::choice_text;
use crate::problem::exported::ExportOwner;
use crate::results::figure::palette::Style;
use crate::results::figure::{self, Figure, PlotAxis};
use crate::study::files::write_study;
use crate::study::grids::shape_text;
use crate::study::stability::panel::{
    AxisScale, Border, Curve, CurvePoint, Stability, StabilityPanel,
};
use std::fmt::{self, Write as _};
use std::path::Path;

/// Largest width of a name in the table, in columns.
const WIDEST_NAME: usize = 53;

/// Six digits; a dash where there is no number.
fn number(x: Option<f64>) -> String {
    match x {
        None => "-".to_owned(),
        Some(x) if x == 0.0 || (1e-3..1e5).contains(&x.abs()) => format!("{x:.5}"),
        Some(x) => format!("{x:.4e}"),
    }
}

/// The word for a value by theory: the value itself, or only a bound on it.
fn kind(bound: bool) -> &'static str {
    if bound { "bound" } else { "theory" }
}

impl Stability {
    /// `64 x 48 cells`, `26 x 26 elements of degree 4`.
    fn grid_text(&self, shape: &[usize]) -> String {
        match self.degree {
            0 => format!("{} cells", shape_text(shape)),
            degree => format!("{} elements of degree {degree}", shape_text(shape)),
        }
    }

    /// One line a point: panel, series, x, measured, theory, and whether the latter is the value
    /// (`theory`) or a `bound`. A missing number is an empty field.
    pub fn csv(&self) -> String {
        let mut text = "panel,series,x,measured,theory,kind\n".to_owned();
        let field = |x: f64| {
            if x.is_finite() { format!("{x:e}") } else { String::new() }
        };
        for StabilityPanel { spec, findings } in &self.panels {
            for curve in &findings.curves {
                for p in &curve.points {
                    let numbers = [p.x, p.measured, p.theory].map(field).join(",");
                    let (name, kind) = (choice_text(&spec.name), kind(curve.bound));
                    let _ = writeln!(text, "{name},\"{}\",{numbers},{kind}", curve.name);
                }
            }
        }
        text
    }

    /// Writes `stability.csv`, `stability.json` and the figures of the case `owner` into
    /// `directory`.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path, owner: &ExportOwner) -> Result<()> {
        write_study(directory, owner, self, &self.csv(), &self.figure())
    }

    /// The figure of the report: a frame for each panel, with markers for measured values and
    /// dashes for theory.
    pub fn figure(&self) -> Figure {
        let panels: Vec<figure::Panel> = self.panels.iter().map(drawn).collect();
        let columns = if panels.len() > 4 { 3 } else { panels.len().clamp(1, 2) };
        let caption = format!(
            "{}: where methods fail. Markers: measured; grey dashes: theory, or bounds by theory. \
             {}",
            self.title,
            self.left_out
                .iter()
                .map(|l| format!("Left out: {} ({}).", choice_text(&l.name), l.reason))
                .collect::<Vec<_>>()
                .join(" ")
        );
        Figure::new("Stability map", panels)
            .columns(columns)
            .frame(360.0, 260.0)
            .caption(caption.trim())
    }
}

/// The borders and the verdicts.
impl fmt::Display for Stability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}: {}, T = {}", self.title, self.grid_text(&self.shape), self.time)?;
        let names =
            self.panels.iter().flat_map(|p| &p.findings.borders).map(|b| b.name.chars().count());
        let width = names.max().unwrap_or(0).min(WIDEST_NAME);
        writeln!(
            f,
            "\n  {:<width$} {:>12} {:>12} {:>6} {:>9}",
            "border", "measured", "by theory", "", "ratio"
        )?;
        for StabilityPanel { spec, findings } in &self.panels {
            let grid = self.grid_text(&findings.shape);
            writeln!(f, "{} ({}, {grid})", choice_text(&spec.name), spec.title)?;
            findings.borders.iter().try_for_each(|border| border.write(f, width))?;
            writeln!(f, "    {}", findings.verdict)?;
            findings.notes.iter().try_for_each(|note| writeln!(f, "    ({note})"))?;
        }
        for left_out in &self.left_out {
            writeln!(f, "{} left out: {}", choice_text(&left_out.name), left_out.reason)?;
        }
        writeln!(f, "{:.1} s", self.seconds)
    }
}

impl Border {
    /// The border as a line of the table, with its name in `width` columns.
    fn write(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        let ratio = self.ratio.map_or("-".to_owned(), |r| format!("{r:.3}"));
        let kind = if self.theory.is_some() { kind(self.bound) } else { "" };
        let (measured, theory) = (number(self.measured), number(self.theory));
        // A longer name is on a line of its own.
        let name = if self.name.chars().count() > width {
            format!("{}\n  {:width$}", self.name, "")
        } else {
            format!("{:<width$}", self.name)
        };
        writeln!(f, "  {name} {measured:>12} {theory:>12} {kind:>6} {ratio:>9}")
    }
}

/// An axis of a panel.
fn axis(scale: &AxisScale) -> PlotAxis {
    if scale.logarithmic { PlotAxis::log(scale.label) } else { PlotAxis::linear(scale.label) }
}

/// A panel of the figure.
fn drawn(panel: &StabilityPanel) -> figure::Panel {
    let spec = panel.spec;
    let line = |curve: &Curve, of: fn(&CurvePoint) -> f64| -> Vec<[f64; 2]> {
        curve.points.iter().map(|p| [p.x, of(p)]).collect()
    };
    let mut out = figure::Panel::new(spec.title, axis(&spec.x), axis(&spec.y));
    let seen = |curve: &Curve| {
        let drawn = |y: f64| y.is_finite() && (!spec.y.logarithmic || y > 0.0);
        curve.points.iter().any(|point| drawn(point.measured))
    };
    for (k, curve) in panel.findings.curves.iter().enumerate().filter(|(_, curve)| seen(curve)) {
        out = out.line(&*curve.name, Style::of(k), line(curve, |p| p.measured));
    }
    // Theory is drawn last, as the markers would hide it.
    let mut labels = [kind(false), kind(true)];
    let mut before: Vec<Vec<[f64; 2]>> = Vec::new();
    for curve in &panel.findings.curves {
        let theory = line(curve, |p| p.theory);
        if theory.iter().any(|p| p[1].is_finite()) && !before.contains(&theory) {
            let label = std::mem::take(&mut labels[usize::from(curve.bound)]);
            out = out.line(label, Style::theory(), theory.clone());
            before.push(theory);
        }
    }
    for border in &panel.findings.borders {
        if let (Some(label), Some(at)) = (&border.line, border.theory) {
            out = out.vertical(&**label, at);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::stability::panel::{PanelContents, PanelName, PanelSpec, nothing_tried};

    /// A curve without a measured value is not in the legend.
    #[test]
    fn curves_without_points_are_not_in_the_legend() {
        let curve = |name: &str, measured: f64| {
            Curve::new(name, vec![CurvePoint { x: 1.0, measured, theory: f64::NAN }])
        };
        static SPEC: PanelSpec = PanelSpec {
            name: PanelName::Step,
            title: "steps",
            cheap: false,
            x: AxisScale::log("step"),
            y: AxisScale::log("error"),
            measure: |_| Err(nothing_tried()),
        };
        let panel = StabilityPanel {
            spec: &SPEC,
            findings: PanelContents {
                shape: vec![4, 4],
                curves: vec![curve("seen", 0.5), curve("missing", f64::NAN), curve("zero", 0.0)],
                borders: Vec::new(),
                verdict: String::new(),
                notes: Vec::new(),
            },
        };
        let labels: Vec<String> = (drawn(&panel).layers.into_iter())
            .filter_map(|layer| match layer {
                figure::Layer::Line { label, .. } => Some(label),
                _ => None,
            })
            .collect();
        assert_eq!(labels, ["seen"]);
    }
}
