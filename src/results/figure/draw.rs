//! From a figure to pixels and paths: where things stand.

use crate::results::figure::canvas::{Anchor, Canvas, Drawn, PIXELS, Place, text_width, wrapped};
use crate::results::figure::palette::{Colour, FAINT, GRID, INK, Style, diverging, sequential};
use crate::results::figure::ticks::{Tick, ticks};
use crate::results::figure::{Axis, Figure, Layer, Map, Panel, Scale};
use plotters::prelude::*;
use std::path::Path;

/// Sizes of texts in points.
const TITLE: f64 = 14.0;
const HEADING: f64 = 11.5;
const LABEL: f64 = 10.5;
const SMALL: f64 = 9.5;
/// Bold letters are wider by this factor.
const BOLD: f64 = 1.12;
/// Around all.
const MARGIN: f64 = 12.0;
/// Between a frame and the next panel's.
const ABOVE: f64 = 26.0;
const BELOW: f64 = 44.0;
/// A line of text.
const LINE: f64 = 15.0;
/// A legend's sample, and what is beside it.
const SAMPLE: f64 = 26.0;
/// Values that differ by less, relative to the largest, are one.
const ROUND_OFF: f64 = 1e-12;
/// Of a heat map's bar.
const BAR: f64 = 12.0;

/// The document.
pub fn svg(figure: &Figure) -> Result<String, String> {
    let sheet = Sheet::new(figure);
    let mut text = String::new();
    let [width, height] = sheet.pixels();
    {
        let root = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
        sheet.draw(&Canvas::new(&root)?)?;
        root.present().map_err(|e| e.to_string())?;
    }
    // Drawn at twice its size, for half points; and pictures by their right name.
    let from = format!("width=\"{width}\" height=\"{height}\"");
    let to = format!("width=\"{}\" height=\"{}\"", width / 2, height / 2);
    Ok(text
        .replacen(&from, &to, 1)
        .replace("data:png;base64", "data:image/png;base64"))
}

/// The picture in a file.
pub fn png(figure: &Figure, path: &Path) -> Drawn {
    let sheet = Sheet::new(figure);
    let [width, height] = sheet.pixels();
    let root = BitMapBackend::new(path, (width, height)).into_drawing_area();
    sheet.draw(&Canvas::new(&root)?)?;
    root.present().map_err(|e| e.to_string())
}

/// Where everything of a figure stands.
struct Sheet<'a> {
    figure: &'a Figure,
    caption: Vec<String>,
    /// Room left of the frames, by column.
    left: Vec<f64>,
    /// Room right of the frames, by column.
    right: Vec<f64>,
    size: Place,
    top: f64,
}

impl<'a> Sheet<'a> {
    fn new(figure: &'a Figure) -> Self {
        let columns = figure.columns.max(1).min(figure.panels.len().max(1));
        let rows = figure.panels.len().div_ceil(columns).max(1);
        let most = |of: &dyn Fn(&Panel) -> f64| -> Vec<f64> {
            (0..columns)
                .map(|c| {
                    let panels = figure.panels.iter().skip(c).step_by(columns);
                    panels.map(of).fold(0.0, f64::max)
                })
                .collect()
        };
        let left = most(&|panel| room_left(panel, figure.frame));
        let right = most(&room_right);
        let inner: f64 = left.iter().chain(&right).sum::<f64>() + columns as f64 * figure.frame[0];
        let width =
            (inner + 2.0 * MARGIN).max(text_width(&figure.title, TITLE) * 1.1 + 2.0 * MARGIN);
        let caption = wrapped(&figure.caption, LABEL, width - 2.0 * MARGIN);
        let top = if figure.title.is_empty() {
            MARGIN
        } else {
            MARGIN + 22.0
        };
        let below = if caption.is_empty() {
            0.0
        } else {
            8.0 + LINE * caption.len() as f64
        };
        let height = top + rows as f64 * (ABOVE + figure.frame[1] + BELOW) + below + MARGIN;
        Self {
            figure,
            caption,
            left,
            right,
            size: [width.ceil(), height.ceil()],
            top,
        }
    }

    fn pixels(&self) -> [u32; 2] {
        self.size.map(|length| (length * PIXELS) as u32)
    }

    fn draw<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>) -> Drawn {
        let figure = self.figure;
        let upright = |anchor| (anchor, false, false);
        if !figure.title.is_empty() {
            let at = [MARGIN, MARGIN + 8.0];
            canvas.text(&figure.title, at, (TITLE, INK), (Anchor::Left, false, true))?;
        }
        for (k, panel) in figure.panels.iter().enumerate() {
            let (row, column) = (k / self.left.len(), k % self.left.len());
            let before: f64 = (0..column)
                .map(|c| self.left[c] + figure.frame[0] + self.right[c])
                .sum();
            let x = MARGIN + before + self.left[column];
            let y = self.top + row as f64 * (ABOVE + figure.frame[1] + BELOW) + ABOVE;
            let frame = Frame::new(panel, [[x, y], [x + figure.frame[0], y + figure.frame[1]]]);
            frame.draw(canvas)?;
        }
        let first = self.size[1] - MARGIN - LINE * (self.caption.len() as f64 - 0.5);
        for (k, line) in self.caption.iter().enumerate() {
            let at = [MARGIN, first + LINE * k as f64];
            canvas.text(line, at, (LABEL, INK), upright(Anchor::Left))?;
        }
        Ok(())
    }
}

/// About a label for so many points.
fn wanted(length: f64) -> usize {
    (length / 62.0).round().max(2.0) as usize
}

/// Ticks of an axis without names on so many points; at whole numbers where it has only such.
fn numbered(axis: &Axis, ends: [f64; 2], length: f64) -> Vec<Tick> {
    if !axis.whole || axis.scale == Scale::Log {
        return ticks(ends, axis.scale, wanted(length));
    }
    let most = (ends[1] - ends[0]).clamp(1.0, 100.0) as usize;
    let mut all = ticks(ends, axis.scale, wanted(length).min(most));
    all.retain(|t| t.at.fract() == 0.0);
    all
}

/// The colours of a map.
fn colours(map: &Map) -> fn(f64) -> Colour {
    if map.differences {
        diverging
    } else {
        sequential
    }
}

fn room_left(panel: &Panel, frame: [f64; 2]) -> f64 {
    let ends = ends(panel);
    let named = panel.y.names.iter().map(|name| text_width(name, SMALL));
    let numbers = numbered(&panel.y, ends[1], frame[1]);
    let numbers = numbers.iter().filter_map(|t| t.label.as_deref());
    let widest = if panel.y.names.is_empty() {
        numbers.map(|l| text_width(l, SMALL)).fold(0.0, f64::max)
    } else {
        named.fold(0.0, f64::max)
    };
    let label = if panel.y.label.is_empty() { 4.0 } else { 20.0 };
    widest + label + 10.0
}

fn room_right(panel: &Panel) -> f64 {
    let legend = legend(panel)
        .map(|(label, _)| text_width(label, SMALL))
        .reduce(f64::max)
        .map_or(14.0, |widest| widest + SAMPLE + 20.0);
    let bar = panel.layers.iter().any(|l| matches!(l, Layer::Map(_)));
    legend + if bar { BAR + 62.0 } else { 0.0 }
}

/// What the legend names, and how it looks.
fn legend(panel: &Panel) -> impl Iterator<Item = (&str, (Style, bool))> {
    panel.layers.iter().filter_map(|layer| {
        let (label, style, joined) = match layer {
            Layer::Line { label, style, .. } => (label, style, true),
            Layer::Points { label, style, .. } | Layer::Intervals { label, style, .. } => {
                (label, style, false)
            }
            _ => return None,
        };
        (!label.is_empty()).then_some((label.as_str(), (*style, joined)))
    })
}

/// Ends of both axes: as given, or of the data with a margin.
fn ends(panel: &Panel) -> [[f64; 2]; 2] {
    let mut found = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    let mut tight = [false; 2];
    let mut see = |axis: usize, value: f64| {
        let usable = [&panel.x, &panel.y][axis].scale == Scale::Linear || value > 0.0;
        if value.is_finite() && usable {
            found[axis] = [found[axis][0].min(value), found[axis][1].max(value)];
        }
    };
    for layer in &panel.layers {
        match layer {
            Layer::Line { points, .. } | Layer::Points { points, .. } => {
                points.iter().for_each(|p| {
                    see(0, p[0]);
                    see(1, p[1]);
                });
            }
            Layer::Intervals { points, .. } => points.iter().for_each(|(p, ends)| {
                see(0, p[0]);
                ends.iter().chain([&p[1]]).for_each(|y| see(1, *y));
            }),
            Layer::Bars { bars, .. } => bars
                .iter()
                .for_each(|(ends, _)| ends.iter().for_each(|x| see(0, *x))),
            Layer::Map(map) => {
                tight = [true; 2];
                map.x.iter().for_each(|x| see(0, *x));
                map.y.iter().for_each(|y| see(1, *y));
            }
            Layer::Vertical { at, .. } => see(0, *at),
            Layer::Horizontal { at, .. } => see(1, *at),
            Layer::Band { .. } => {}
        }
    }
    std::array::from_fn(|axis| {
        let given = [&panel.x, &panel.y][axis];
        if let Some(range) = given.range {
            return range;
        }
        let [lower, upper] = found[axis];
        match (lower <= upper, given.scale) {
            (false, Scale::Linear) => [0.0, 1.0],
            (false, Scale::Log) => [0.1, 10.0],
            (true, _) if tight[axis] && upper > lower => [lower, upper],
            (true, Scale::Log) => {
                let part = (upper / lower).powf(0.06).max(1.3);
                [lower / part, upper * part]
            }
            (true, Scale::Linear) => {
                let largest = upper.abs().max(lower.abs());
                let part = if upper - lower > ROUND_OFF * largest {
                    0.05 * (upper - lower)
                } else if largest > 0.0 {
                    0.5 * largest
                } else {
                    1.0
                };
                [lower - part, upper + part]
            }
        }
    })
}

/// A panel's frame.
struct Frame<'a> {
    panel: &'a Panel,
    /// Upper left and lower right corner.
    corners: [Place; 2],
    ends: [[f64; 2]; 2],
}

impl<'a> Frame<'a> {
    fn new(panel: &'a Panel, corners: [Place; 2]) -> Self {
        Self {
            panel,
            corners,
            ends: ends(panel),
        }
    }

    /// Part of the way along an axis; NaN where it has no place there.
    fn part(&self, axis: usize, value: f64) -> f64 {
        let [lower, upper] = self.ends[axis];
        match [&self.panel.x, &self.panel.y][axis].scale {
            Scale::Linear => (value - lower) / (upper - lower),
            Scale::Log if value > 0.0 => (value / lower).ln() / (upper / lower).ln(),
            Scale::Log => f64::NAN,
        }
    }

    fn place(&self, [x, y]: [f64; 2]) -> Place {
        let [[left, top], [right, bottom]] = self.corners;
        [
            left + self.part(0, x) * (right - left),
            bottom - self.part(1, y) * (bottom - top),
        ]
    }

    /// Whether a place is in the frame, but for the width of a line.
    fn holds(&self, [x, y]: Place) -> bool {
        let [[left, top], [right, bottom]] = self.corners;
        (left - 0.5..=right + 0.5).contains(&x) && (top - 0.5..=bottom + 0.5).contains(&y)
    }

    fn draw<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>) -> Drawn {
        let [[left, top], [right, bottom]] = self.corners;
        // A long title goes on in a second, smaller line.
        let title = &self.panel.title;
        let lines = match text_width(title, HEADING) * BOLD <= right - left {
            true => vec![title.clone()],
            false => wrapped(title, SMALL, (right - left) / BOLD),
        };
        let size = if lines.len() > 1 { SMALL } else { HEADING };
        for (k, line) in lines.iter().take(2).enumerate() {
            let above = 12.0 + 11.0 * (lines.len().min(2) as f64 - 1.0 - k as f64) - 2.0 * k as f64;
            let at = [left, top - above];
            canvas.text(line, at, (size, INK), (Anchor::Left, false, true))?;
        }
        let tick = |axis: &Axis, ends, length: f64| -> Vec<Tick> {
            if axis.names.is_empty() {
                return numbered(axis, ends, length);
            }
            let named = axis.names.iter().enumerate();
            named
                .map(|(k, name)| Tick {
                    at: k as f64,
                    label: Some(name.clone()),
                })
                .collect()
        };
        let across = tick(&self.panel.x, self.ends[0], right - left);
        let up = tick(&self.panel.y, self.ends[1], bottom - top);
        for t in &across {
            let x = self.place([t.at, 1.0])[0];
            let shade = if t.label.is_some() { GRID } else { [240; 3] };
            canvas.line(&[[x, top], [x, bottom]], shade, 0.5)?;
        }
        for t in &up {
            let y = self.place([1.0, t.at])[1];
            let shade = if t.label.is_some() { GRID } else { [240; 3] };
            canvas.line(&[[left, y], [right, y]], shade, 0.5)?;
        }
        let mut bars = 0.0;
        // Grounds lie below all else, and notes above.
        let ground = |layer: &&Layer| matches!(layer, Layer::Band { .. });
        let (grounds, others): (Vec<_>, Vec<_>) = self.panel.layers.iter().partition(ground);
        for layer in grounds.into_iter().chain(others) {
            self.layer(canvas, layer)?;
            if let Layer::Map(map) = layer {
                self.bar(canvas, map)?;
                bars += BAR + 62.0;
            }
        }
        self.notes(canvas)?;
        let around = [
            [left, top],
            [right, top],
            [right, bottom],
            [left, bottom],
            [left, top],
        ];
        canvas.line(&around, INK, 0.9)?;
        let number = |anchor| (anchor, false, false);
        for t in &across {
            let x = self.place([t.at, 1.0])[0];
            canvas.line(&[[x, bottom], [x, bottom + 4.0]], INK, 0.9)?;
            let label = t.label.as_deref().unwrap_or_default();
            let at = [x, bottom + 12.0];
            canvas.text(label, at, (SMALL, INK), number(Anchor::Centre))?;
        }
        for t in &up {
            let y = self.place([1.0, t.at])[1];
            canvas.line(&[[left - 4.0, y], [left, y]], INK, 0.9)?;
            let label = t.label.as_deref().unwrap_or_default();
            let at = [left - 7.0, y];
            canvas.text(label, at, (SMALL, INK), number(Anchor::Right))?;
        }
        let below = [0.5 * (left + right), bottom + 28.0];
        canvas.text(
            &self.panel.x.label,
            below,
            (LABEL, INK),
            number(Anchor::Centre),
        )?;
        let beside = [
            left - room_left(self.panel, [right - left, bottom - top]) + 8.0,
            0.5 * (top + bottom),
        ];
        let upwards = (Anchor::Centre, true, false);
        canvas.text(&self.panel.y.label, beside, (LABEL, INK), upwards)?;
        for (k, (label, (style, joined))) in legend(self.panel).enumerate() {
            let (x, y) = (right + 8.0 + bars, top + 8.0 + LINE * k as f64);
            if joined {
                canvas.styled(&[[x, y], [x + SAMPLE, y]], &style)?;
            }
            canvas.marker([x + 0.5 * SAMPLE, y], &style)?;
            let at = [x + SAMPLE + 5.0, y];
            canvas.text(label, at, (SMALL, INK), number(Anchor::Left))?;
        }
        Ok(())
    }

    fn layer<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>, layer: &Layer) -> Drawn {
        let [[left, top], [right, bottom]] = self.corners;
        match layer {
            Layer::Line { style, points, .. } => {
                let places: Vec<Place> = points.iter().map(|p| self.place(*p)).collect();
                for piece in clipped(&places, self.corners) {
                    canvas.styled(&piece, style)?;
                }
                let inside = places.iter().filter(|p| self.holds(**p));
                inside.copied().try_for_each(|p| canvas.marker(p, style))
            }
            Layer::Points { style, points, .. } => {
                let places = points.iter().map(|p| self.place(*p));
                let mut inside = places.filter(|p| self.holds(*p));
                inside.try_for_each(|p| canvas.marker(p, style))
            }
            Layer::Intervals { style, points, .. } => points.iter().try_for_each(|(p, ends)| {
                let stroke = ends.map(|y| self.place([p[0], y]));
                for piece in clipped(&stroke, self.corners) {
                    canvas.line(&piece, style.colour, style.width)?;
                }
                match self.place(*p) {
                    at if self.holds(at) => canvas.marker(at, style),
                    _ => Ok(()),
                }
            }),
            Layer::Bars { style, bars } => (bars.iter().enumerate())
                .try_for_each(|(k, (bar, _))| canvas.rectangle(self.bar_of(k, *bar), style.colour)),
            Layer::Map(map) => self.map(canvas, map),
            Layer::Vertical { at, .. } => {
                let x = self.place([*at, 1.0])[0];
                if !(left..=right).contains(&x) {
                    return Ok(());
                }
                canvas.styled(&[[x, top], [x, bottom]], &Style::theory().dashed(2))
            }
            Layer::Horizontal { at, .. } => {
                let y = self.place([1.0, *at])[1];
                if !(top..=bottom).contains(&y) {
                    return Ok(());
                }
                canvas.styled(&[[left, y], [right, y]], &Style::theory().dashed(2))
            }
            Layer::Band { from, .. } => {
                let [a, b] = self.band(*from);
                if b <= a {
                    return Ok(());
                }
                canvas.rectangle([[a, top], [b, bottom]], [238, 238, 238])
            }
        }
    }

    /// The ends of a band within the frame.
    fn band(&self, from: [f64; 2]) -> [f64; 2] {
        let [[left, _], [right, _]] = self.corners;
        from.map(|x| self.place([x, 1.0])[0].clamp(left, right))
    }

    /// The corners of bar `k`, within the frame and not too thin to be seen.
    fn bar_of(&self, k: usize, [from, to]: [f64; 2]) -> [Place; 2] {
        let [[left, _], [right, _]] = self.corners;
        let x = |x: f64| {
            if x.is_nan() {
                left
            } else {
                x.clamp(left, right)
            }
        };
        let high = self.place([from, k as f64 + 0.36]);
        let low = self.place([to, k as f64 - 0.36]);
        let begin = x(high[0]);
        [[begin, high[1]], [x(low[0]).max(begin + 0.5), low[1]]]
    }

    /// What stands at lines, bands and bars. Labels of vertical lines stand one below the other.
    fn notes<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>) -> Drawn {
        let [[left, top], [right, bottom]] = self.corners;
        let mut row = 0;
        for layer in &self.panel.layers {
            match layer {
                Layer::Vertical { label, at } => {
                    let x = self.place([*at, 1.0])[0];
                    if (left..=right).contains(&x) && !label.is_empty() {
                        canvas.note(label, [x, top + 9.0 + 13.0 * f64::from(row)], right)?;
                        row += 1;
                    }
                }
                Layer::Horizontal { label, at } => {
                    let y = self.place([1.0, *at])[1];
                    if (top..=bottom).contains(&y) {
                        let above = if y > top + 14.0 { y - 8.0 } else { y + 8.0 };
                        canvas.note(label, [left, above], right)?;
                    }
                }
                Layer::Band { label, from } => {
                    let [a, b] = self.band(*from);
                    if b > a {
                        canvas.note(label, [a, bottom - 9.0], right)?;
                    }
                }
                Layer::Bars { bars, .. } => {
                    for (k, (bar, label)) in bars.iter().enumerate() {
                        let [high, low] = self.bar_of(k, *bar);
                        canvas.note(label, [low[0], 0.5 * (high[1] + low[1])], right)?;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The cells of a map as one picture.
    fn map<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>, map: &Map) -> Drawn {
        let [a, b] = [
            self.place([map.x[0], map.y[1]]),
            self.place([map.x[1], map.y[0]]),
        ];
        let [lower, upper] = map_range(map);
        // What sticks out of the frame is cut off.
        let [[left, top], [right, bottom]] = self.corners;
        let corner = [a[0].max(left), a[1].max(top)];
        let end = [b[0].min(right), b[1].min(bottom)];
        let size = [0, 1].map(|c| ((end[c] - corner[c]) * PIXELS).round().max(0.0) as u32);
        if size.contains(&0) || map.values.len() != map.shape[0] * map.shape[1] {
            return Ok(());
        }
        let shade = colours(map);
        let mut colours = Vec::with_capacity(3 * (size[0] * size[1]) as usize);
        for row in 0..size[1] {
            for column in 0..size[0] {
                let at = |c: usize, k: u32| {
                    let place = corner[c] + (f64::from(k) + 0.5) / PIXELS;
                    (place - a[c]) / (b[c] - a[c])
                };
                let cell = |c: usize, part: f64| {
                    ((part * map.shape[c] as f64) as usize).min(map.shape[c] - 1)
                };
                let (i, j) = (cell(0, at(0, column)), cell(1, 1.0 - at(1, row)));
                let value = map.values[i * map.shape[1] + j];
                colours.extend(shade((value - lower) / (upper - lower)));
            }
        }
        canvas.picture(corner, size, &colours)
    }

    /// What the colours stand for, beside the frame.
    fn bar<DB: DrawingBackend>(&self, canvas: &Canvas<'_, DB>, map: &Map) -> Drawn {
        let [[_, top], [right, bottom]] = self.corners;
        let x = right + 10.0;
        let [lower, upper] = map_range(map);
        let size = [BAR, bottom - top].map(|length| (length * PIXELS).round() as u32);
        let along = colours(map);
        let shade = |row: u32| along(1.0 - (f64::from(row) + 0.5) / f64::from(size[1]));
        let colours: Vec<u8> = (0..size[1])
            .flat_map(|row| std::iter::repeat_n(shade(row), size[0] as usize).flatten())
            .collect();
        canvas.picture([x, top], size, &colours)?;
        for t in ticks([lower, upper], Scale::Linear, wanted(bottom - top)) {
            let y = bottom - (bottom - top) * (t.at - lower) / (upper - lower);
            canvas.line(&[[x + BAR, y], [x + BAR + 3.0, y]], INK, 0.9)?;
            let label = t.label.as_deref().unwrap_or_default();
            let at = [x + BAR + 6.0, y];
            canvas.text(label, at, (SMALL, INK), (Anchor::Left, false, false))?;
        }
        let at = [x + 0.5 * BAR, top - 10.0];
        canvas.text(
            &map.label,
            at,
            (SMALL, FAINT),
            (Anchor::Centre, false, false),
        )
    }
}

/// Values at the ends of a map's colours; not the same, so that all of a constant map has a colour.
fn map_range(map: &Map) -> [f64; 2] {
    let finite = || map.values.iter().copied().filter(|v| v.is_finite());
    let found = [
        finite().fold(f64::INFINITY, f64::min),
        finite().fold(f64::NEG_INFINITY, f64::max),
    ];
    let [lower, upper] = map.range.unwrap_or(found);
    if upper > lower {
        [lower, upper]
    } else if lower.is_finite() {
        [
            lower - 0.5 * lower.abs().max(1.0),
            lower + 0.5 * lower.abs().max(1.0),
        ]
    } else {
        [0.0, 1.0]
    }
}

/// The pieces of a line that lie in a rectangle, by Liang and Barsky's parameters; broken where a place is not finite.
fn clipped(places: &[Place], [[left, top], [right, bottom]]: [Place; 2]) -> Vec<Vec<Place>> {
    let mut pieces: Vec<Vec<Place>> = Vec::new();
    let mut joined = false;
    for pair in places.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        if !a.iter().chain(&b).all(|x| x.is_finite()) {
            joined = false;
            continue;
        }
        let d = [b[0] - a[0], b[1] - a[1]];
        let (mut from, mut to) = (0.0f64, 1.0f64);
        for (c, lower, upper) in [(0, left, right), (1, top, bottom)] {
            if d[c] == 0.0 {
                if !(lower..=upper).contains(&a[c]) {
                    to = -1.0;
                }
                continue;
            }
            let ends = [(lower - a[c]) / d[c], (upper - a[c]) / d[c]];
            from = from.max(ends[0].min(ends[1]));
            to = to.min(ends[0].max(ends[1]));
        }
        if from > to {
            joined = false;
            continue;
        }
        let at = |t: f64| [a[0] + t * d[0], a[1] + t * d[1]];
        match pieces.last_mut().filter(|_| joined && from == 0.0) {
            Some(piece) => piece.push(at(to)),
            None => pieces.push(vec![at(from), at(to)]),
        }
        joined = to == 1.0;
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: [Place; 2] = [[0.0, 0.0], [10.0, 10.0]];

    #[test]
    fn lines_end_at_the_frame() {
        let through = clipped(&[[-5.0, 5.0], [15.0, 5.0]], BOX);
        assert_eq!(through, [[[0.0, 5.0], [10.0, 5.0]]]);
        assert!(clipped(&[[-5.0, -1.0], [15.0, -1.0]], BOX).is_empty());
        // Out and in again: two pieces; inside, one.
        let out = clipped(&[[5.0, 5.0], [5.0, 15.0], [7.0, 15.0], [7.0, 5.0]], BOX);
        assert_eq!(out, [[[5.0, 5.0], [5.0, 10.0]], [[7.0, 10.0], [7.0, 5.0]]]);
        assert_eq!(
            clipped(&[[1.0, 1.0], [2.0, 2.0], [3.0, 1.0]], BOX)[0].len(),
            3
        );
        let broken = clipped(
            &[
                [1.0, 1.0],
                [2.0, 2.0],
                [f64::NAN, 1.0],
                [3.0, 3.0],
                [4.0, 4.0],
            ],
            BOX,
        );
        assert_eq!(broken.len(), 2);
    }

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
        let lines = Panel::new(
            "errors & <costs>",
            Axis::log("applications"),
            Axis::log("error"),
        )
        .line(
            "a",
            Style::of(0),
            vec![[1e2, 1e-2], [1e3, 1e-5], [-1.0, 3.0]],
        )
        .points(
            "b",
            Style::of(1).hollow(),
            vec![[2e2, 1e-3], [f64::NAN, 1.0]],
        )
        .vertical("here", 300.0)
        .horizontal("there", 1e-4);
        let bars = Panel::new(
            "",
            Axis::linear("s"),
            Axis::named("", vec!["one".into(), "two".into()]),
        )
        .with(Layer::Bars {
            style: Style::of(2),
            bars: vec![([0.0, 1.0], "1 s".into()), ([1.0, 3.0], String::new())],
        });
        let empty = Panel::new("nothing", Axis::log("x"), Axis::linear("y")).line(
            "none",
            Style::theory(),
            Vec::new(),
        );
        let phase = Panel::new("f", Axis::linear("x"), Axis::linear("v")).map(map);
        Figure::new("All kinds", vec![lines, bars, empty, phase])
            .caption("A sentence that is long enough to be broken somewhere. ".repeat(6))
    }

    #[test]
    fn axes_of_whole_numbers_and_of_a_single_value() {
        let axis = Axis::linear("applications").whole();
        for ends in [[27.9, 29.1], [0.0, 3.0], [0.0, 250.0], [-1.0, 1.0]] {
            let all = numbered(&axis, ends, 280.0);
            assert!(!all.is_empty());
            for tick in all {
                let label = tick.label.unwrap_or_default();
                assert!(label.parse::<i64>().is_ok(), "{label}");
            }
        }
        for (values, expected) in [
            ([0.0, 0.0], [-1.0, 1.0]),
            ([2.0, 2.0], [1.0, 3.0]),
            ([2.0, 2.0 + 1e-15], [1.0, 3.0]),
        ] {
            let points = vec![[0.0, values[0]], [1.0, values[1]]];
            let panel = Panel::new("", Axis::linear("x"), Axis::linear("y"));
            let found = ends(&panel.line("", Style::of(0), points))[1];
            assert!((0..2).all(|k| (found[k] - expected[k]).abs() < 1e-12));
        }
    }

    #[test]
    fn every_kind_of_layer_is_drawn() {
        let svg = example().svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for text in [
            "errors &amp; &lt;costs&gt;",
            "applications",
            "10⁻⁴",
            "here",
            "there",
            "data:image/png",
            "two",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        let (open, close) = (svg.matches("<text").count(), svg.matches("</text>").count());
        assert_eq!(open, close);
        assert_eq!(svg, example().svg().unwrap());
    }

    #[test]
    fn a_png_has_the_size_of_the_sheet_and_is_not_blank() {
        let directory = tempfile::tempdir().unwrap();
        let [svg, png] = example().write(directory.path(), "all").unwrap();
        assert!(svg.exists());
        let bytes = std::fs::read(png).unwrap();
        assert_eq!(&bytes[1..4], b"PNG");
        let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
        let size = Sheet::new(&example()).pixels();
        assert_eq!([number(16), number(20)], size);
        assert!(bytes.len() > 20_000);
    }
}
