//! Figures as data, which [`crate::results::draw`] draws to SVG and PNG.
//!
//! A [`Figure`] is panels in a grid, with a caption below; a [`Panel`] is axes and the layers
//! between them. Series differ in marker and dash as well as in colour, and heat maps grow lighter
//! with the value: all can be read in grey and by the colour-blind ([`palette`]).
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

/// How values become lengths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// In proportion.
    Linear,
    /// As their logarithms; values that have none are left out.
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
    /// Names at 0, 1, … instead of numbers.
    pub names: Vec<String>,
    /// Whether its values are whole numbers.
    pub whole: bool,
}

impl PlotAxis {
    /// In proportion.
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

    /// With names at 0, 1, … .
    pub fn named(label: impl Into<String>, names: Vec<String>) -> Self {
        Self { range: Some([-0.6, names.len() as f64 - 0.4]), names, ..Self::linear(label) }
    }

    /// The same axis with ticks at whole numbers only.
    pub fn whole(mut self) -> Self {
        self.whole = true;
        self
    }

    /// From `lower` to `upper`.
    pub fn within(mut self, lower: f64, upper: f64) -> Self {
        self.range = Some([lower, upper]);
        self
    }
}

/// Values on a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Ends of the grid along the horizontal axis.
    pub x: [f64; 2],
    /// The same along the vertical one.
    pub y: [f64; 2],
    /// Cells along both.
    pub shape: [usize; 2],
    /// A value for each cell, the vertical axis fastest.
    pub values: Vec<f64>,
    /// Values at the ends of the colours; by default those of the data.
    pub range: Option<[f64; 2]>,
    /// Whether they are differences, with zero in the middle of the range: other colours, and white
    /// for zero.
    pub differences: bool,
    /// What the values are.
    pub label: String,
}

/// What is drawn between the axes; the first lies lowest.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// Points joined by lines, in order; one that is not finite breaks the line.
    Line {
        /// In the legend; none where empty.
        label: String,
        /// How it looks.
        style: Style,
        /// Points.
        points: Vec<[f64; 2]>,
    },
    /// Points alone.
    Points {
        /// In the legend; none where empty.
        label: String,
        /// How they look.
        style: Style,
        /// Points.
        points: Vec<[f64; 2]>,
    },
    /// Points and how far they may be off, up and down.
    Intervals {
        /// In the legend; none where empty.
        label: String,
        /// How they look.
        style: Style,
        /// Points, and the ends of the interval of their vertical value.
        points: Vec<([f64; 2], [f64; 2])>,
    },
    /// Bars from zero along the horizontal axis, one at each 0, 1, … of the vertical one.
    Bars {
        /// How they look.
        style: Style,
        /// From where to where, and what stands at the end.
        bars: Vec<([f64; 2], String)>,
    },
    /// A heat map.
    Map(Map),
    /// A line across at a place of the horizontal axis.
    Vertical {
        /// What stands at it.
        label: String,
        /// Where.
        at: f64,
    },
    /// A line across at a place of the vertical axis.
    Horizontal {
        /// What stands at it.
        label: String,
        /// Where.
        at: f64,
    },
    /// A ground between two places of the horizontal axis.
    Band {
        /// What stands in it.
        label: String,
        /// From where to where.
        from: [f64; 2],
    },
}

/// Axes and what is drawn between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// The horizontal axis.
    pub x: PlotAxis,
    /// The vertical one.
    pub y: PlotAxis,
    /// From below to above.
    pub layers: Vec<Layer>,
}

impl Panel {
    /// Axes without anything between them.
    pub fn new(title: impl Into<String>, x: PlotAxis, y: PlotAxis) -> Self {
        Self { title: title.into(), x, y, layers: Vec::new() }
    }

    /// With one layer more.
    pub fn with(mut self, layer: Layer) -> Self {
        self.layers.push(layer);
        self
    }

    /// With a line.
    pub fn line(self, label: impl Into<String>, style: Style, points: Vec<[f64; 2]>) -> Self {
        self.with(Layer::Line { label: label.into(), style, points })
    }

    /// With points that nothing joins.
    pub fn points(self, label: impl Into<String>, style: Style, points: Vec<[f64; 2]>) -> Self {
        self.with(Layer::Points { label: label.into(), style, points })
    }

    /// With a heat map.
    pub fn map(self, map: Map) -> Self {
        self.with(Layer::Map(map))
    }

    /// With a line across at `at` of the horizontal axis.
    pub fn vertical(self, label: impl Into<String>, at: f64) -> Self {
        let label = label.into();
        self.with(Layer::Vertical { label, at })
    }

    /// With lines across at each of these places of the horizontal axis, without labels.
    pub fn verticals(self, places: &[f64]) -> Self {
        places.iter().fold(self, |panel, at| panel.vertical("", *at))
    }

    /// With a line across at `at` of the vertical axis.
    pub fn horizontal(self, label: impl Into<String>, at: f64) -> Self {
        let label = label.into();
        self.with(Layer::Horizontal { label, at })
    }
}

/// Panels in a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Above all.
    pub title: String,
    /// From the left, from above.
    pub panels: Vec<Panel>,
    /// Panels side by side.
    pub columns: usize,
    /// Below all; lines are broken where they must be, and at every `\n`.
    pub caption: String,
    /// Width and height of a panel's frame in points.
    pub frame: [f64; 2],
}

impl Figure {
    /// Panels two side by side, without a caption.
    pub fn new(title: impl Into<String>, panels: Vec<Panel>) -> Self {
        Self {
            title: title.into(),
            columns: panels.len().clamp(1, 2),
            panels,
            caption: String::new(),
            frame: [400.0, 280.0],
        }
    }

    /// With `columns` panels side by side.
    pub fn columns(mut self, columns: usize) -> Self {
        self.columns = columns.max(1);
        self
    }

    /// With text below.
    pub fn caption(mut self, caption: impl Into<String>) -> Self {
        self.caption = caption.into();
        self
    }

    /// With frames of `width` by `height` points.
    pub fn frame(mut self, width: f64, height: f64) -> Self {
        self.frame = [width, height];
        self
    }
}
