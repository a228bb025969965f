//! Figures as data, which [`crate::results::draw`] draws to SVG and PNG.
//!
//! A [`Figure`] has panels in a grid and a caption below. A [`Panel`] has axes and layers that are
//! drawn between them. Series differ in marker and dash as well as in colour, and heat maps grow
//! lighter with the value, so that all can be read in grey and by the colour-blind ([`palette`]).
//!
//! ```
//! use phasewarp::results::figure::palette::Style;
//! use phasewarp::results::figure::{Figure, Panel, PlotAxis};
//! let panel = Panel::new("", PlotAxis::log("applications"), PlotAxis::log("relative error"))
//!     .line("gaussian", Style::of(0), vec![[1e3, 1e-3], [1e4, 1e-9]])
//!     .horizontal("tolerance", 1e-6);
//! let figure = Figure::new("Accuracy against cost", vec![panel]);
//! assert!(figure.svg().unwrap().contains("gaussian"));
//! ```

pub mod palette;

use crate::results::figure::palette::Style;

/// The map from values to lengths on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Lengths are proportional to values.
    Linear,
    /// Lengths are proportional to logarithms of values. Values without a logarithm are left out.
    Log,
}

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct PlotAxis {
    /// Label of the axis.
    pub label: String,
    /// Scale of the axis.
    pub scale: Scale,
    /// Ends of the axis, lower first; by default those of the data.
    pub range: Option<[f64; 2]>,
    /// Labels of the ticks at 0, 1, … instead of numbers.
    pub names: Vec<String>,
    /// Whether its values are whole numbers.
    pub whole: bool,
}

impl PlotAxis {
    /// A linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            scale: Scale::Linear,
            range: None,
            names: Vec::new(),
            whole: false,
        }
    }

    /// A logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::linear(label) }
    }

    /// An axis with names at 0, 1, … .
    pub fn named(label: impl Into<String>, names: Vec<String>) -> Self {
        Self { range: Some([-0.6, names.len() as f64 - 0.4]), names, ..Self::linear(label) }
    }

    /// This axis with ticks at whole numbers only.
    pub fn whole(self) -> Self {
        Self { whole: true, ..self }
    }

    /// This axis from `lower` to `upper`.
    pub fn within(self, lower: f64, upper: f64) -> Self {
        Self { range: Some([lower, upper]), ..self }
    }
}

/// Values on a grid, drawn as a heat map.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Ends of the grid along the horizontal axis.
    pub x: [f64; 2],
    /// Ends of the grid along the vertical axis.
    pub y: [f64; 2],
    /// Number of cells along both axes.
    pub shape: [usize; 2],
    /// A value for each cell, the vertical axis fastest.
    pub values: Vec<f64>,
    /// Values at the ends of the colours; by default those of the data.
    pub range: Option<[f64; 2]>,
    /// Whether the values are differences. Zero is in the middle of the range then, and white.
    pub differences: bool,
    /// Label of the colour bar.
    pub label: String,
}

/// A layer that is drawn between the axes.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// Points joined by lines in their order; a point that is not finite breaks the line.
    Line {
        /// Label in the legend; not shown if empty.
        label: String,
        /// Style of line and markers.
        style: Style,
        /// Points.
        points: Vec<[f64; 2]>,
    },
    /// Points that are not joined.
    Points {
        /// Label in the legend; not shown if empty.
        label: String,
        /// Colour and markers.
        style: Style,
        /// Points.
        points: Vec<[f64; 2]>,
    },
    /// Points with an error interval of their vertical value.
    Intervals {
        /// Label in the legend; not shown if empty.
        label: String,
        /// Colour and markers.
        style: Style,
        /// Points, and the ends of the interval of their vertical value.
        points: Vec<([f64; 2], [f64; 2])>,
    },
    /// Horizontal bars, at 0, 1, … of the vertical axis.
    Bars {
        /// Colour and markers.
        style: Style,
        /// Both ends of each bar, and the label at its end.
        bars: Vec<([f64; 2], String)>,
    },
    /// A heat map.
    Map(Map),
    /// A vertical line across the panel.
    Vertical {
        /// Label at the line.
        label: String,
        /// Position of the line on the horizontal axis.
        at: f64,
    },
    /// A horizontal line across the panel.
    Horizontal {
        /// Label at the line.
        label: String,
        /// Position of the line on the vertical axis.
        at: f64,
    },
    /// A shaded band from the bottom to the top of the panel.
    Band {
        /// Label in the band.
        label: String,
        /// The two ends of the band on the horizontal axis.
        from: [f64; 2],
    },
}

/// Axes, and the layers that are drawn between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Title above the panel.
    pub title: String,
    /// The horizontal axis.
    pub x: PlotAxis,
    /// The vertical axis.
    pub y: PlotAxis,
    /// The layers; each is drawn over those before it.
    pub layers: Vec<Layer>,
}

impl Panel {
    /// A panel without layers.
    pub fn new(title: impl Into<String>, x: PlotAxis, y: PlotAxis) -> Self {
        Self { title: title.into(), x, y, layers: Vec::new() }
    }

    /// The panel with one more layer.
    pub fn with(mut self, layer: Layer) -> Self {
        self.layers.push(layer);
        self
    }

    /// The panel with a line.
    pub fn line(self, label: impl Into<String>, style: Style, points: Vec<[f64; 2]>) -> Self {
        self.with(Layer::Line { label: label.into(), style, points })
    }

    /// The panel with points that are not joined.
    pub fn points(self, label: impl Into<String>, style: Style, points: Vec<[f64; 2]>) -> Self {
        self.with(Layer::Points { label: label.into(), style, points })
    }

    /// The panel with a heat map.
    pub fn map(self, map: Map) -> Self {
        self.with(Layer::Map(map))
    }

    /// The panel with a vertical line at `at` on the horizontal axis.
    pub fn vertical(self, label: impl Into<String>, at: f64) -> Self {
        self.with(Layer::Vertical { label: label.into(), at })
    }

    /// The panel with vertical lines at these positions, without labels.
    pub fn verticals(self, places: &[f64]) -> Self {
        places.iter().fold(self, |panel, at| panel.vertical("", *at))
    }

    /// The panel with a horizontal line at `at` on the vertical axis.
    pub fn horizontal(self, label: impl Into<String>, at: f64) -> Self {
        self.with(Layer::Horizontal { label: label.into(), at })
    }
}

/// Panels in a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Title above all panels.
    pub title: String,
    /// The panels, row by row from the left.
    pub panels: Vec<Panel>,
    /// Number of panels in a row.
    pub columns: usize,
    /// Text below all panels; lines are wrapped, and broken at every `\n`.
    pub caption: String,
    /// Width and height of a panel's frame in points.
    pub frame: [f64; 2],
}

impl Figure {
    /// A figure with up to two panels in a row, without a caption.
    pub fn new(title: impl Into<String>, panels: Vec<Panel>) -> Self {
        Self {
            title: title.into(),
            columns: panels.len().clamp(1, 2),
            panels,
            caption: String::new(),
            frame: [400.0, 280.0],
        }
    }

    /// The figure with `columns` panels in a row.
    pub fn columns(self, columns: usize) -> Self {
        Self { columns: columns.max(1), ..self }
    }

    /// The figure with a caption.
    pub fn caption(self, caption: impl Into<String>) -> Self {
        Self { caption: caption.into(), ..self }
    }

    /// The figure with frames of `width` by `height` points.
    pub fn frame(self, width: f64, height: f64) -> Self {
        Self { frame: [width, height], ..self }
    }
}
