//! Figures as pixels with few colours, for movies and pages.

use crate::base::disk::failure;
use crate::base::error::Result;
use crate::results::FileResult;
use crate::results::draw::FigureLayout;
use crate::results::draw::panel::colours;
use crate::results::draw::png_file::png_file;
use crate::results::draw::shape::PIXELS;
use crate::results::figure::palette::{PAPER, Style};
use crate::results::figure::{Figure, Layer};
use plotters::prelude::*;
use std::collections::HashMap;
use std::path::Path;

/// Number of shades of grey.
const GREYS: usize = 32;
/// Number of shades of all maps together.
const SHADES: usize = 168;
/// Number of shades between a line's colour and paper.
const BLENDS: usize = 7;
/// Largest number of colours of lines, so that a byte numbers all colours and one more.
const LINES: usize = 7;

/// Red, green and blue.
pub type Colour = [u8; 3];

/// A figure as pixels, one per point, row by row.
pub struct Raster {
    /// Number of pixels along both axes; both are even.
    pub size: [usize; 2],
    /// Colours of the pixels.
    pub pixels: Vec<Colour>,
}

impl Figure {
    /// The figure as pixels.
    ///
    /// # Errors
    /// [`crate::base::error::Error::Output`], if it cannot be drawn.
    pub fn raster(&self) -> Result<Raster> {
        raster(self).map_err(|e| failure(Path::new(&self.title), &e))
    }
}

/// Draws at twice the size, as for all figures, and averages.
fn raster(figure: &Figure) -> FileResult<Raster> {
    const _: () = assert!(PIXELS == 2.0);
    let layout = FigureLayout::new(figure);
    let size = layout.size.map(|length| (length as usize).next_multiple_of(2));
    let [width, height] = size;
    let mut bytes = vec![0; 3 * 4 * width * height];
    let fine = (2 * width as u32, 2 * height as u32);
    layout.draw(&BitMapBackend::with_buffer(&mut bytes, fine).into_drawing_area())?;
    // A row of pixels is two fine rows, and a pixel two fine pixels of each.
    let fine_row = 3 * 2 * width;
    let mut pixels = Vec::with_capacity(width * height);
    for rows in bytes.chunks_exact(2 * fine_row) {
        let (upper, lower) = rows.split_at(fine_row);
        let pairs = upper.chunks_exact(6).zip(lower.chunks_exact(6));
        pixels.extend(pairs.map(|(upper, lower)| -> Colour {
            std::array::from_fn(|c| {
                let four = [upper[c], upper[c + 3], lower[c], lower[c + 3]].map(u16::from);
                ((four.iter().sum::<u16>() + 2) / 4) as u8
            })
        }));
    }
    Ok(Raster { size, pixels })
}

/// A palette of at most 255 colours that several similar figures share.
pub struct Palette {
    colours: Vec<Colour>,
    /// Number of the nearest colour, for colours that were looked up.
    nearest: HashMap<Colour, u8>,
}

/// The colour of a value between 0 and 1.
type Shades = fn(f64) -> RGBColor;

impl Palette {
    /// The palette of a figure: greys, the shades of its maps, and the colours of its lines on
    /// paper.
    pub fn of(figure: &Figure) -> Self {
        let mut lines: Vec<RGBColor> = Vec::new();
        let mut maps: [Option<Shades>; 2] = [None; 2];
        for layer in figure.panels.iter().flat_map(|panel| &panel.layers) {
            match layer {
                Layer::Map(map) => maps[usize::from(map.differences)] = Some(colours(map)),
                Layer::Line { style: Style { colour, .. }, .. }
                | Layer::Points { style: Style { colour, .. }, .. }
                    if !lines.contains(colour) && lines.len() < LINES =>
                {
                    lines.push(*colour);
                }
                _ => {}
            }
        }
        let maps: Vec<_> = maps.into_iter().flatten().collect();
        let part = |k: usize, of: usize| k as f64 / (of - 1).max(1) as f64;
        let mut all: Vec<Colour> =
            (0..GREYS).map(|k| [(255.0 * part(k, GREYS)) as u8; 3]).collect();
        for shade in &maps {
            let count = SHADES / maps.len();
            all.extend((0..count).map(|k| channels(shade(part(k, count)))));
        }
        for line in lines {
            let [line, paper] = [line, PAPER].map(channels);
            let blend = |t: f64| -> Colour {
                let mixed = |c: usize| t * f64::from(line[c]) + (1.0 - t) * f64::from(paper[c]);
                std::array::from_fn(|c| mixed(c).round() as u8)
            };
            all.extend((1..=BLENDS).map(|k| blend(k as f64 / BLENDS as f64)));
        }
        Self { colours: all, nearest: HashMap::new() }
    }

    /// Red, green and blue of every colour in turn.
    pub fn bytes(&self) -> Vec<u8> {
        self.colours.concat()
    }

    /// Numbers of the colours nearest to those of a picture.
    pub fn numbers(&mut self, raster: &Raster) -> Vec<u8> {
        let Self { colours, nearest } = self;
        let mut number = |pixel: &Colour| {
            *nearest.entry(*pixel).or_insert_with(|| {
                let found = (0..colours.len()).min_by_key(|&k| distance(&colours[k], pixel));
                found.unwrap_or(0) as u8
            })
        };
        // Neighbours mostly have the same colour.
        let runs = raster.pixels.chunk_by(|a, b| a == b);
        runs.flat_map(|run| std::iter::repeat_n(number(&run[0]), run.len())).collect()
    }

    /// A picture as PNG.
    ///
    /// # Errors
    /// A sentence that says why it cannot be written.
    pub fn png(&mut self, raster: &Raster) -> FileResult<Vec<u8>> {
        let numbers = self.numbers(raster);
        png_file(raster.size.map(|length| length as u32), &numbers, |encoder| {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(self.bytes());
            encoder.set_compression(png::Compression::Best);
        })
    }
}

fn channels(RGBColor(r, g, b): RGBColor) -> Colour {
    [r, g, b]
}

fn distance(a: &Colour, b: &Colour) -> u32 {
    a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::figure::{Map, Panel, PlotAxis};

    fn example(differences: bool) -> Figure {
        let map = Map {
            x: [0.0, 1.0],
            y: [0.0, 1.0],
            shape: [20, 1],
            values: (0..20).map(f64::from).collect(),
            range: None,
            differences,
            label: String::new(),
        };
        let other = Map { differences: true, ..map.clone() };
        let panel = || Panel::new("", PlotAxis::linear("x"), PlotAxis::linear("y"));
        let lines = (0..9).fold(panel(), |panel, k| {
            panel.line("", Style::of(k), vec![[0.0, k as f64], [1.0, 2.0]])
        });
        Figure::new("a\nb", vec![panel().map(map), panel().map(other), lines])
    }

    #[test]
    fn colours_are_few_and_near() {
        for differences in [false, true] {
            let figure = example(differences);
            let raster = figure.raster().unwrap();
            let mut palette = Palette::of(&figure);
            assert!(palette.colours.len() <= 255, "{}", palette.colours.len());
            let numbers = palette.numbers(&raster);
            assert_eq!(numbers.len(), raster.size[0] * raster.size[1]);
            assert!(raster.size.iter().all(|length| length % 2 == 0));
            // Colours are wrong only where text, lines and maps mix.
            let far = (numbers.iter().zip(&raster.pixels))
                .filter(|(k, pixel)| distance(&palette.colours[usize::from(**k)], pixel) > 300)
                .count();
            assert!(far < numbers.len() / 50, "{far} of {}", numbers.len());
            let png = palette.png(&raster).unwrap();
            let mut reader = png::Decoder::new(&png[..]).read_info().unwrap();
            let mut read = vec![0; reader.output_buffer_size()];
            reader.next_frame(&mut read).unwrap();
            assert_eq!(read, numbers);
        }
    }
}
