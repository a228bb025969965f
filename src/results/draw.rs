//! Figures drawn with `plotters`, to SVG and PNG.
//!
//! | file | what it does |
//! |---|---|
//! | `draw` | the layout: panels in a grid, title, caption |
//! | `panel` | a panel as a chart of `plotters`, with its layers, notes, colour bar and legend |
//! | `extent` | ends of axes, from the data |
//! | `ticks` | axes for `plotters`, with their ticks |
//! | `shape`, `text` | lines, markers and texts in pixels |
//! | `raster`, `png_file` | pixels with few colours; pixels as a PNG file |
//!
//! `plotters` draws axes, grids, labels, dashes, intervals and colours. This module adds ticks (see
//! `ticks`), more markers than its three, lines that end at the frame, where it would bend them,
//! and legends beside the frame, as those of `plotters` hide data.

pub mod extent;
pub mod panel;
pub mod png_file;
pub mod raster;
pub mod shape;
pub mod text;
pub mod ticks;

use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::results::FileResult;
use crate::results::draw::panel::{ABOVE, BELOW, BOLD, PanelFrame};
use crate::results::draw::png_file::png_file;
use crate::results::draw::shape::{Area, Drawn, PIXELS, PixelPoint, pixels};
use crate::results::figure::Figure;
use crate::results::figure::palette::{INK, PAPER};
use plotters::prelude::*;
use std::path::{Path, PathBuf};

/// Sizes of texts in points.
const TITLE: f64 = 14.0;
const CAPTION: f64 = 10.5;
/// Height of a line of the title in points.
const TITLE_LINE: f64 = 20.0;
/// The largest number of lines into which a line of the title is broken.
const TITLE_LINES: usize = 2;
/// Margin around the figure in points.
const MARGIN: f64 = 12.0;
/// Height of a line of the caption in points.
const LINE: f64 = 15.0;

impl Figure {
    /// The figure as an SVG document.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`], if it cannot be drawn.
    pub fn svg(&self) -> Result<String> {
        svg(self).map_err(|e| failure(Path::new(&self.title), &e))
    }

    /// Writes `directory/name.svg` and `directory/name.png`, and returns both paths.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`].
    pub fn write(&self, directory: &Path, name: &str) -> Result<[PathBuf; 2]> {
        let [svg, png] = ["svg", "png"].map(|end| directory.join(format!("{name}.{end}")));
        disk::write_text(&svg, &self.svg()?)?;
        let bytes = png_bytes(self).map_err(|e| failure(&png, &e))?;
        disk::write(&png, &bytes)?;
        Ok([svg, png])
    }
}

/// The document.
fn svg(figure: &Figure) -> FileResult<String> {
    let layout = FigureLayout::new(figure);
    let mut text = String::new();
    let [width, height] = layout.pixels();
    layout.draw(&SVGBackend::with_string(&mut text, (width, height)).into_drawing_area())?;
    // The figure is drawn at twice its size, so that half points are whole pixels. `plotters`
    // writes a wrong media type for pictures.
    let from = format!("width=\"{width}\" height=\"{height}\"");
    let to = format!("width=\"{}\" height=\"{}\"", width / 2, height / 2);
    Ok(text.replacen(&from, &to, 1).replace("data:png;base64", "data:image/png;base64"))
}

/// The figure as a PNG file.
fn png_bytes(figure: &Figure) -> FileResult<Vec<u8>> {
    let layout = FigureLayout::new(figure);
    let [width, height] = layout.pixels();
    let mut pixels = vec![0; 3 * width as usize * height as usize];
    layout.draw(&BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area())?;
    png_file([width, height], &pixels, |encoder| encoder.set_color(png::ColorType::Rgb))
}

/// The layout of a figure, in points.
pub(crate) struct FigureLayout<'a> {
    figure: &'a Figure,
    frames: Vec<PanelFrame<'a>>,
    title: Vec<String>,
    caption: Vec<String>,
    /// Width of each column.
    columns: Vec<f64>,
    /// Room left of the frames, by column.
    left: Vec<f64>,
    size: PixelPoint,
    top: f64,
}

impl<'a> FigureLayout<'a> {
    fn new(figure: &'a Figure) -> Self {
        let frames: Vec<PanelFrame> =
            (figure.panels.iter()).map(|panel| PanelFrame::new(panel, figure.frame)).collect();
        let count = figure.columns.max(1).min(frames.len().max(1));
        let rows = frames.len().div_ceil(count).max(1);
        let widest = |of: fn(&PanelFrame<'_>) -> f64| -> Vec<f64> {
            let column = |c| frames.iter().skip(c).step_by(count);
            (0..count).map(|c| column(c).map(of).fold(0.0, f64::max)).collect()
        };
        let left = widest(|frame| frame.room_left());
        let columns: Vec<f64> = (left.iter().zip(widest(|frame| frame.room_right())))
            .map(|(left, right)| left + figure.frame[0] + right)
            .collect();
        let across = columns.iter().sum::<f64>();
        let width = across + 2.0 * MARGIN;
        let title = text::fitted(&figure.title, TITLE, across / BOLD, TITLE_LINES);
        let caption = text::wrapped(&figure.caption, CAPTION, across);
        let top = match title.len() {
            0 => MARGIN,
            lines => MARGIN + 2.0 + TITLE_LINE * lines as f64,
        };
        let below = if caption.is_empty() { 0.0 } else { 8.0 + LINE * caption.len() as f64 };
        let height = top + rows as f64 * (ABOVE + figure.frame[1] + BELOW) + below + MARGIN;
        let size = [width.ceil(), height.ceil()];
        Self { figure, frames, title, caption, columns, left, size, top }
    }

    fn pixels(&self) -> [u32; 2] {
        self.size.map(|length| (length * PIXELS) as u32)
    }

    /// Draws the whole figure.
    fn draw<DB: DrawingBackend>(&self, root: &Area<DB>) -> Drawn {
        root.fill(&PAPER).map_err(|e| e.to_string())?;
        let write = |line: &str, at: PixelPoint, style| {
            text::draw(root, line, at.map(|c| c * PIXELS), &style)
        };
        for (k, line) in self.title.iter().enumerate() {
            let at = [MARGIN, MARGIN + 8.0 + TITLE_LINE * k as f64];
            write(line, at, text::bold(TITLE, INK))?;
        }
        let height = ABOVE + self.figure.frame[1] + BELOW;
        for (k, frame) in self.frames.iter().enumerate() {
            let (row, column) = (k / self.columns.len(), k % self.columns.len());
            let x = MARGIN + self.columns[..column].iter().sum::<f64>() + self.left[column]
                - frame.room_left();
            let y = self.top + row as f64 * height;
            let size = (pixels(self.columns[column]), pixels(height));
            frame.draw(&root.clone().shrink((pixels(x), pixels(y)), size))?;
        }
        let first = self.size[1] - MARGIN - LINE * (self.caption.len() as f64 - 0.5);
        for (k, line) in self.caption.iter().enumerate() {
            let at = [MARGIN, first + LINE * k as f64];
            write(line, at, text::style(CAPTION, INK))?;
        }
        root.present().map_err(|e| e.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::figure::palette::Style;
    use crate::results::figure::{Layer, Map, Panel, PlotAxis};

    fn example() -> Figure {
        let map = Map {
            x: [-1.0, 1.0],
            y: [0.0, 2.0],
            shape: [3, 5],
            values: (0..15).map(f64::from).collect(),
            range: None,
            differences: false,
            label: "f".into(),
        };
        let lines =
            Panel::new("errors & <costs>", PlotAxis::log("applications"), PlotAxis::log("error"))
                .line("a", Style::of(0), vec![[1e2, 1e-2], [1e3, 1e-5], [-1.0, 3.0]])
                .points("b", Style::of(1).hollow(), vec![[2e2, 1e-3], [f64::NAN, 1.0]])
                .vertical("here", 300.0)
                .horizontal("there", 1e-4);
        let bars = Panel::new(
            "",
            PlotAxis::linear("s"),
            PlotAxis::named("", vec!["one".into(), "two".into()]),
        )
        .with(Layer::Bars {
            style: Style::of(2),
            bars: vec![([0.0, 1.0], "1 s".into()), ([1.0, 3.0], String::new())],
        });
        let empty = Panel::new("nothing", PlotAxis::log("x"), PlotAxis::linear("y")).line(
            "none",
            Style::theory(),
            Vec::new(),
        );
        let phase = Panel::new("f", PlotAxis::linear("x"), PlotAxis::linear("v")).map(map);
        Figure::new("All kinds", vec![lines, bars, empty, phase])
            .caption("A sentence that is long enough to be broken somewhere. ".repeat(6))
    }

    #[test]
    fn every_kind_of_layer_is_drawn() {
        let svg = example().svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for text in [
            "errors &amp; &lt;costs&gt;", "applications", "10⁻⁴", "here", "there",
            "data:image/png", "two",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        let (open, close) = (svg.matches("<text").count(), svg.matches("</text>").count());
        assert_eq!(open, close);
        assert_eq!(svg, example().svg().unwrap());
    }

    /// A label goes down its line until it covers no data.
    #[test]
    fn labels_cover_no_data() {
        let height = |data: f64| -> f64 {
            let points = (0..40).map(|k| [f64::from(k), data]).collect();
            let axis = PlotAxis::linear("y").within(0.0, 1.0);
            let panel = Panel::new("", PlotAxis::linear("x"), axis)
                .line("", Style::of(0), points)
                .vertical("here", 10.0);
            let svg = Figure::new("", vec![panel]).svg().unwrap();
            let text = svg.split("<text").find(|text| text.contains("here")).unwrap();
            let y = text.split("y=\"").nth(1).and_then(|y| y.split('"').next());
            y.and_then(|y| y.parse().ok()).unwrap()
        };
        let free = height(0.5);
        let covered = height(0.97);
        assert!(covered > free + 10.0, "{covered} {free}");
    }

    #[test]
    fn a_png_has_the_size_of_the_sheet_and_is_not_blank() {
        let directory = tempfile::tempdir().unwrap();
        let [svg, png] = example().write(directory.path(), "all").unwrap();
        assert!(svg.exists());
        let bytes = std::fs::read(png).unwrap();
        assert_eq!(&bytes[1..4], b"PNG");
        let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
        let size = FigureLayout::new(&example()).pixels();
        assert_eq!([number(16), number(20)], size);
        assert!(bytes.len() > 20_000);
    }
}
