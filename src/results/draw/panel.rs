//! A panel as a chart of `plotters`.

use crate::results::draw::extent::{ends, map_range};
use crate::results::draw::shape::{
    Area, Drawn, PIXELS, PixelCells, PixelPoint, clipped, interval, line, marker, picture, pixels,
    put, rectangle,
};
use crate::results::draw::text;
use crate::results::draw::ticks::Ruler;
use crate::results::figure::palette::{FAINT, GRID, INK, Style, diverging, sequential};
use crate::results::figure::{Layer, Map, Panel, PlotAxis};
use plotters::coord::cartesian::Cartesian2d;
use plotters::prelude::*;

/// Room above a frame for its title, in points.
pub const ABOVE: f64 = 26.0;
/// Room below a frame for its axis, in points.
pub const BELOW: f64 = 44.0;
/// Gap below the labels of the axis, in points.
const GAP: f64 = 8.0;

/// Sizes of texts in points.
const HEADING: f64 = 11.5;
const LABEL: f64 = 10.5;
const SMALL: f64 = 9.5;
/// Width of bold letters relative to others.
pub const BOLD: f64 = 1.12;
/// Distance between entries of a legend, in points.
const LINE: f64 = 15.0;
/// Length of a legend's sample, in points.
const SAMPLE: f64 = 26.0;
/// Width of a colour bar, in points.
const BAR: f64 = 12.0;
/// Width of a colour bar with its gap and numbers, in points.
const BAR_ROOM: f64 = BAR + 62.0;
/// Length of ticks, outwards, in points.
const TICK: f64 = 3.5;
/// Colour of grid lines without a label.
const LIGHT: RGBColor = RGBColor(240, 240, 240);
/// Colour of a band.
const BAND: RGBColor = RGBColor(238, 238, 238);

/// A panel with its axes, ready to be drawn.
pub struct PanelFrame<'a> {
    panel: &'a Panel,
    /// Width and height in points.
    size: [f64; 2],
    x: Ruler,
    y: Ruler,
}

/// An entry of the legend.
struct LegendEntry<'a> {
    label: &'a str,
    style: &'a Style,
    /// Whether a line joins the points.
    joined: bool,
}

/// The entry of a layer, if it has one.
fn entry(layer: &Layer) -> Option<LegendEntry<'_>> {
    let (label, style, joined) = match layer {
        Layer::Line { label, style, .. } => (label, style, true),
        Layer::Points { label, style, .. } | Layer::Intervals { label, style, .. } => {
            (label, style, false)
        }
        _ => return None,
    };
    (!label.is_empty()).then_some(LegendEntry { label, style, joined })
}

impl<'a> PanelFrame<'a> {
    /// The panel in a frame of `size` points.
    pub fn new(panel: &'a Panel, size: [f64; 2]) -> Self {
        let [x, y] = ends(panel);
        Self {
            panel,
            size,
            x: Ruler::new(&panel.x, x, size[0]),
            y: Ruler::new(&panel.y, y, size[1]),
        }
    }

    /// Room left of the frame in points.
    pub fn room_left(&self) -> f64 {
        let labels = self.y.labels().map(|label| text::width(label, SMALL));
        let described = if self.panel.y.label.is_empty() { 4.0 } else { 20.0 };
        labels.fold(0.0, f64::max) + described + 10.0
    }

    /// Room right of the frame in points.
    pub fn room_right(&self) -> f64 {
        let entries = self.panel.layers.iter().filter_map(entry);
        let legend = entries
            .map(|entry| text::width(entry.label, SMALL))
            .reduce(f64::max)
            .map_or(14.0, |widest| widest + SAMPLE + 36.0);
        let bar = self.maps().next().map_or(0.0, |_| BAR_ROOM);
        legend + bar
    }

    fn maps(&self) -> impl Iterator<Item = &'a Map> {
        self.panel.layers.iter().filter_map(|layer| match layer {
            Layer::Map(map) => Some(map),
            _ => None,
        })
    }

    /// Draws the panel with title, axes and legend. `area` includes the room left of the frame.
    pub fn draw<DB: DrawingBackend>(&self, area: &Area<DB>) -> Drawn {
        let left = self.room_left();
        self.heading(area, left)?;
        let framed = (pixels(left + self.size[0]), pixels(ABOVE + self.size[1] + BELOW));
        let chart = area.clone().shrink((0, 0), framed);
        let chart = ChartBuilder::on(&chart)
            .margin_top(pixels(ABOVE))
            .margin_bottom(pixels(GAP))
            .x_label_area_size(pixels(BELOW - GAP))
            .y_label_area_size(pixels(left))
            .build_cartesian_2d(self.x.clone(), self.y.clone());
        let mut chart = chart.map_err(|e| e.to_string())?;
        self.mesh(&mut chart)?;
        let plot = PlotArea::new(self, chart.plotting_area().strip_coord_spec());
        plot.draw()?;
        let mut beside = left + self.size[0] + 8.0;
        for map in self.maps() {
            let corner = (pixels(beside + 2.0), 0);
            colour_bar(map, &area.clone().shrink(corner, (pixels(BAR_ROOM), framed.1)))?;
            beside += BAR_ROOM;
        }
        self.legend(area, beside)
    }

    /// Draws the title; a long one is broken into two lines of smaller letters.
    fn heading<DB: DrawingBackend>(&self, area: &Area<DB>, left: f64) -> Drawn {
        let title = &self.panel.title;
        let lines = if text::width(title, HEADING) * BOLD <= self.size[0] {
            vec![title.clone()]
        } else {
            text::wrapped(title, SMALL, self.size[0] / BOLD)
        };
        let (size, above) = match lines.len() {
            ..=1 => (HEADING, vec![12.0]),
            _ => (SMALL, vec![23.0, 10.0]),
        };
        for (line, above) in lines.iter().zip(above) {
            let at = [left, ABOVE - above].map(|c| c * PIXELS);
            text::draw(area, line, at, &text::bold(size, INK))?;
        }
        Ok(())
    }

    /// Draws grid, axes, ticks and their labels.
    fn mesh<DB: DrawingBackend>(
        &self,
        chart: &mut ChartContext<'_, DB, Cartesian2d<Ruler, Ruler>>,
    ) -> Drawn {
        let mut mesh = chart.configure_mesh();
        mesh.bold_line_style(GRID)
            .light_line_style(LIGHT)
            .axis_style(INK.stroke_width(2))
            .label_style(text::style(SMALL, INK))
            .axis_desc_style(text::style(LABEL, INK))
            .set_all_tick_mark_size(pixels(TICK));
        if !self.panel.x.label.is_empty() {
            mesh.x_desc(&*self.panel.x.label);
        }
        if !self.panel.y.label.is_empty() {
            mesh.y_desc(&*self.panel.y.label);
        }
        mesh.draw().map_err(|e| e.to_string())
    }

    /// Draws the names of the series, from `left` points on.
    fn legend<DB: DrawingBackend>(&self, area: &Area<DB>, left: f64) -> Drawn {
        let entries = self.panel.layers.iter().filter_map(entry);
        for (k, entry) in entries.enumerate() {
            let y = ABOVE + 8.0 + LINE * k as f64;
            let at = |x: f64| [(left + x) * PIXELS, y * PIXELS];
            if entry.joined {
                line(area, &[at(0.0), at(SAMPLE)], entry.style)?;
            }
            marker(area, at(0.5 * SAMPLE), entry.style)?;
            text::draw(area, entry.label, at(SAMPLE + 5.0), &text::style(SMALL, INK))?;
        }
        Ok(())
    }
}

/// The colours of a map.
pub(crate) fn colours(map: &Map) -> fn(f64) -> RGBColor {
    if map.differences { diverging } else { sequential }
}

/// Draws the colour bar of a map: a chart of its own, as high as that of the map.
fn colour_bar<DB: DrawingBackend>(map: &Map, area: &Area<DB>) -> Drawn {
    let height = area.dim_in_pixel().1 as i32 - pixels(ABOVE + BELOW);
    let values = Ruler::new(&PlotAxis::linear(""), map_range(map), f64::from(height) / PIXELS);
    let mut chart = ChartBuilder::on(area)
        .margin_top(pixels(ABOVE))
        .margin_bottom(pixels(BELOW))
        .right_y_label_area_size(pixels(BAR_ROOM - BAR))
        .build_cartesian_2d(0.0..1.0, values)
        .map_err(|e| e.to_string())?;
    let bar = chart.plotting_area().strip_coord_spec();
    let (width, height) = bar.dim_in_pixel();
    let shade = colours(map);
    let cells =
        PixelCells { columns: vec![0; width as usize], rows: (0..height as usize).collect() };
    picture(&bar, [0.0; 2], &cells, |_, row| shade(1.0 - (row as f64 + 0.5) / f64::from(height)))?;
    chart
        .configure_mesh()
        .disable_mesh()
        .disable_x_axis()
        .axis_style(INK.stroke_width(2))
        .label_style(text::style(SMALL, INK))
        .set_all_tick_mark_size(pixels(TICK))
        .draw()
        .map_err(|e| e.to_string())?;
    let at = [0.0, (ABOVE - 10.0) * PIXELS];
    text::draw(area, &map.label, at, &text::style(SMALL, FAINT))
}

/// Whether two rectangles share more than an edge.
fn overlap(a: &[PixelPoint; 2], b: &[PixelPoint; 2]) -> bool {
    (0..2).all(|c| a[0][c] < b[1][c] && b[0][c] < a[1][c])
}

/// The inside of a frame.
struct PlotArea<'a, DB: DrawingBackend> {
    frame: &'a PanelFrame<'a>,
    area: Area<DB>,
    /// The lower right pixel.
    end: PixelPoint,
}

impl<'a, DB: DrawingBackend> PlotArea<'a, DB> {
    fn new(frame: &'a PanelFrame<'a>, area: Area<DB>) -> Self {
        let (width, height) = area.dim_in_pixel();
        let end = [width, height].map(|length| f64::from(length) - 1.0);
        Self { frame, area, end }
    }

    /// Draws the layers: first bands, at last notes.
    fn draw(&self) -> Drawn {
        let layers = &self.frame.panel.layers;
        let is_band = |layer: &&Layer| matches!(layer, Layer::Band { .. });
        let (bands, others): (Vec<_>, Vec<_>) = layers.iter().partition(is_band);
        bands.into_iter().chain(others).try_for_each(|layer| self.layer(layer))?;
        self.notes()?;
        // The axes are the other two sides of the frame.
        let [right, bottom] = self.end.map(|c| c as i32);
        let sides = vec![(0, 0), (right, 0), (right, bottom)];
        put(&self.area, &PathElement::new(sides, INK.stroke_width(2)))
    }

    fn x(&self, value: f64) -> f64 {
        self.frame.x.fraction(value) * self.end[0]
    }

    fn y(&self, value: f64) -> f64 {
        (1.0 - self.frame.y.fraction(value)) * self.end[1]
    }

    fn place(&self, point: [f64; 2]) -> PixelPoint {
        [self.x(point[0]), self.y(point[1])]
    }

    /// Whether a place is in the frame, up to the width of a line.
    fn holds(&self, place: PixelPoint) -> bool {
        (0..2).all(|c| (-1.0..=self.end[c] + 1.0).contains(&place[c]))
    }

    fn markers<'b>(&self, points: impl Iterator<Item = &'b [f64; 2]>, style: &Style) -> Drawn {
        points
            .map(|point| self.place(*point))
            .filter(|place| self.holds(*place))
            .try_for_each(|place| marker(&self.area, place, style))
    }

    fn line(&self, points: &[[f64; 2]], style: &Style) -> Drawn {
        let places: Vec<PixelPoint> = points.iter().map(|p| self.place(*p)).collect();
        clipped(&places, [[0.0; 2], self.end])
            .iter()
            .try_for_each(|piece| line(&self.area, piece, style))
    }

    fn layer(&self, layer: &Layer) -> Drawn {
        let [right, bottom] = self.end;
        let across = |ends: [PixelPoint; 2]| {
            let seen = self.holds(ends[0]);
            let style = Style::theory().dashed(2);
            if seen { line(&self.area, &ends, &style) } else { Ok(()) }
        };
        match layer {
            Layer::Line { style, points, .. } => {
                self.line(points, style)?;
                self.markers(points.iter(), style)
            }
            Layer::Points { style, points, .. } => self.markers(points.iter(), style),
            Layer::Intervals { style, points, .. } => {
                for (point, ends) in points {
                    let (place, ends) = (self.place(*point), ends.map(|y| self.y(y)));
                    if ends.iter().all(|y| y.is_finite()) && self.holds([place[0], 0.0]) {
                        let ends = ends.map(|y| y.clamp(0.0, bottom));
                        interval(&self.area, place, ends, style)?;
                    }
                }
                self.markers(points.iter().map(|(point, _)| point), style)
            }
            Layer::Bars { style, bars } => {
                (bars.iter().enumerate()).try_for_each(|(k, (bar, _))| {
                    rectangle(&self.area, self.bar(k, *bar), style.colour)
                })
            }
            Layer::Map(map) => self.map(map),
            Layer::Vertical { at, .. } => {
                let x = self.x(*at);
                across([[x, 0.0], [x, bottom]])
            }
            Layer::Horizontal { at, .. } => {
                let y = self.y(*at);
                across([[0.0, y], [right, y]])
            }
            Layer::Band { from, .. } => match self.band(*from) {
                [a, b] if b > a => rectangle(&self.area, [[a, 0.0], [b, bottom]], BAND),
                _ => Ok(()),
            },
        }
    }

    /// The ends of a band within the frame.
    fn band(&self, from: [f64; 2]) -> [f64; 2] {
        from.map(|x| self.x(x).clamp(0.0, self.end[0]))
    }

    /// The corners of bar `k`, within the frame and at least one pixel wide.
    fn bar(&self, k: usize, ends: [f64; 2]) -> [PixelPoint; 2] {
        // NaN is drawn at the left end.
        let [from, to] = ends.map(|x| self.x(x).max(0.0).min(self.end[0]));
        let [high, low] = [0.36, -0.36].map(|half| self.y(k as f64 + half));
        [[from, high], [to.max(from + 1.0), low]]
    }

    /// Whether lines, points and intervals keep the width of a marker away from a rectangle.
    fn is_free(&self, ground: [PixelPoint; 2]) -> bool {
        const MARKER: f64 = 2.0 * PIXELS;
        let ground = [ground[0].map(|c| c - MARKER), ground[1].map(|c| c + MARKER)];
        let inside =
            |place: &PixelPoint| (0..2).all(|c| (ground[0][c]..=ground[1][c]).contains(&place[c]));
        self.frame.panel.layers.iter().all(|layer| match layer {
            Layer::Line { points, .. } => {
                let places: Vec<PixelPoint> = points.iter().map(|p| self.place(*p)).collect();
                clipped(&places, ground).is_empty()
            }
            Layer::Points { points, .. } => !points.iter().any(|p| inside(&self.place(*p))),
            Layer::Intervals { points, .. } => points.iter().all(|(point, ends)| {
                let places = ends.map(|y| self.place([point[0], y]));
                clipped(&places, ground).is_empty()
            }),
            _ => true,
        })
    }

    /// The labels of a layer, each with the places where it may be drawn, the best first. `rows`
    /// are the heights of labels one below the other.
    fn labels<'l>(&self, layer: &'l Layer, rows: &[f64]) -> Vec<(&'l str, Vec<PixelPoint>)> {
        let [right, bottom] = self.end;
        let points = |length: f64| length * PIXELS;
        match layer {
            Layer::Vertical { label, at } => {
                let x = self.x(*at);
                vec![(label, rows.iter().map(|y| [x, *y]).collect())]
            }
            Layer::Horizontal { label, at } => {
                let y = self.y(*at);
                let mut sides = [y - points(8.0), y + points(8.0)];
                if y <= points(14.0) {
                    sides.reverse();
                }
                let along = (0..8).map(|part| right * f64::from(part) / 8.0);
                vec![(label, along.flat_map(|x| sides.map(|y| [x, y])).collect())]
            }
            Layer::Band { label, from } => {
                let [a, b] = self.band(*from);
                let label = if b > a { label } else { "" };
                let lowest = std::iter::once(bottom - points(9.0));
                vec![(label, lowest.chain(rows.iter().rev().copied()).map(|y| [a, y]).collect())]
            }
            Layer::Bars { bars, .. } => {
                let label = |(k, (bar, label)): (usize, &'l ([f64; 2], String))| {
                    let [high, low] = self.bar(k, *bar);
                    (label.as_str(), vec![[low[0], 0.5 * (high[1] + low[1])]])
                };
                bars.iter().enumerate().map(label).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Draws labels of lines, bands and bars, where they cover no data if there is such a place.
    /// Those of vertical lines are one below the other.
    fn notes(&self) -> Drawn {
        let [right, bottom] = self.end;
        let rows: Vec<f64> = (0..)
            .map(|k| (9.0 + 13.0 * f64::from(k)) * PIXELS)
            .take_while(|y| *y <= bottom - 9.0 * PIXELS)
            .collect();
        let mut taken: Vec<[PixelPoint; 2]> = Vec::new();
        let layers = self.frame.panel.layers.iter();
        for (label, places) in layers.flat_map(|layer| self.labels(layer, &rows)) {
            let grounds = places.iter().filter(|place| self.holds(**place));
            let grounds: Vec<(&PixelPoint, [PixelPoint; 2])> =
                grounds.map(|place| (place, text::ground(label, *place, right))).collect();
            // The first place where it covers no data and no other label.
            let free = |(_, ground): &&(&PixelPoint, [PixelPoint; 2])| {
                !taken.iter().any(|other| overlap(ground, other)) && self.is_free(*ground)
            };
            let found = grounds.iter().find(free).or(grounds.first());
            if let Some((place, ground)) = found.filter(|_| !label.is_empty()) {
                text::note(&self.area, label, **place, right)?;
                taken.push(*ground);
            }
        }
        Ok(())
    }

    /// Draws the cells of a map as one picture, cut off at the frame.
    fn map(&self, map: &Map) -> Drawn {
        let [a, b] = [[map.x[0], map.y[1]], [map.x[1], map.y[0]]].map(|p| self.place(p));
        let [lower, upper] = map_range(map);
        let corner = [0, 1].map(|c| a[c].max(0.0));
        let end = [0, 1].map(|c| b[c].min(self.end[c]));
        let size = [0, 1].map(|c| (end[c] - corner[c]).round().max(0.0) as usize);
        if size.contains(&0) || map.values.len() != map.shape[0] * map.shape[1] {
            return Ok(());
        }
        // The cells that contain the centres of the pixels.
        let along = |c: usize| -> Vec<usize> {
            let cell = |k: usize| {
                let place = (corner[c] + k as f64 + 0.5 - a[c]) / (b[c] - a[c]);
                ((place * map.shape[c] as f64) as usize).min(map.shape[c] - 1)
            };
            (0..size[c]).map(cell).collect()
        };
        let shade = colours(map);
        picture(&self.area, corner, &PixelCells { columns: along(0), rows: along(1) }, |i, row| {
            let j = map.shape[1] - 1 - row;
            shade((map.values[i * map.shape[1] + j] - lower) / (upper - lower))
        })
    }
}
