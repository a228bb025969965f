//! A run as a movie: a GIF, whose frames share one palette, and a WebM if `ffmpeg` is installed.

use crate::base::disk::{self, failure};
use crate::base::error::Result;
use crate::results::FileResult;
use crate::results::draw::raster::{Palette, Raster};
use crate::results::pictures::film::Film;
use gif::{DisposalMethod, Encoder, Frame, Repeat};
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

/// The largest number of frames of a movie: at a few tens of KiB each, some tens of MiB.
pub const MOST_FRAMES: usize = 500;

/// A GIF gives times in hundredths of a second.
const HUNDREDTHS: u16 = 100;
/// The colour number of a pixel that does not change.
const SAME: u8 = 255;
/// The largest number of bytes of the messages of `ffmpeg` that are read.
const MOST_ERROR_TEXT: u64 = 400;

/// The files of a movie.
#[derive(Default)]
pub struct Movie {
    /// Paths of the files.
    pub files: Vec<PathBuf>,
    /// The name of a file that is missing, and why.
    pub left_out: Option<(String, String)>,
}

/// Writes `directory/name.gif` and, if `ffmpeg` is on the PATH, `directory/name.webm`, with `fps`
/// frames per second. Only one rank calls it.
///
/// # Errors
/// [`crate::base::error::Error::Output`].
pub fn write(film: &Film<'_>, directory: &Path, name: &str, fps: u16) -> Result<Movie> {
    disk::make(directory)?;
    let [gif, webm] = ["gif", "webm"].map(|ending| directory.join(format!("{name}.{ending}")));
    // A WebM of an older movie must not stay beside a newer GIF.
    disk::clear(&webm).map_err(|e| failure(&webm, &e))?;
    let figure = |k: usize| film.frame(k).map_err(|why| failure(&gif, &why));
    let first = figure(0)?;
    let mut palette = Palette::of(&first);
    let mut frame = first.raster()?;
    let mut video = Video::start(&webm, frame.size, fps);
    let mut wrong = None;
    disk::write_with(&gif, |file| {
        let mut movie = Gif::start(file, &palette, frame.size, fps)?;
        for k in 0..film.count() {
            if k > 0 {
                frame = figure(k).and_then(|figure| figure.raster()).map_err(|error| {
                    let io_error = io::Error::other(error.to_string());
                    wrong = Some(error);
                    io_error
                })?;
            }
            movie.add(palette.numbers(&frame), k + 1 == film.count())?;
            if let Ok(video) = &mut video {
                video.add(&frame);
            }
        }
        movie.finish()
    })
    .map_err(|error| wrong.take().unwrap_or(error))?;
    let mut movie = Movie { files: vec![gif], left_out: None };
    match video.and_then(Video::finish) {
        Ok(()) => movie.files.push(webm),
        Err(why) => movie.left_out = Some((format!("{name}.webm"), why)),
    }
    Ok(movie)
}

/// A GIF while it is written.
struct Gif<'a> {
    encoder: Encoder<BufWriter<&'a mut File>>,
    size: [u16; 2],
    delay: u16,
    before: Vec<u8>,
}

impl<'a> Gif<'a> {
    fn start(
        file: &'a mut File,
        palette: &Palette,
        size: [usize; 2],
        fps: u16,
    ) -> io::Result<Self> {
        let size = size.map(|length| length as u16);
        let file = BufWriter::new(file);
        let encoder = Encoder::new(file, size[0], size[1], &palette.bytes());
        let mut encoder = encoder.map_err(io::Error::other)?;
        encoder.set_repeat(Repeat::Infinite).map_err(io::Error::other)?;
        let delay = (f64::from(HUNDREDTHS) / f64::from(fps)).round() as u16;
        Ok(Self { encoder, size, delay, before: Vec::new() })
    }

    /// Adds a frame, in which pixels that do not change take hardly any room. The last frame stays
    /// for a second.
    fn add(&mut self, numbers: Vec<u8>, last: bool) -> io::Result<()> {
        let changed = |(k, number): (usize, &u8)| {
            if self.before.get(k) == Some(number) { SAME } else { *number }
        };
        let pixels: Vec<u8> = numbers.iter().enumerate().map(changed).collect();
        let frame = Frame {
            width: self.size[0],
            height: self.size[1],
            delay: if last { self.delay.max(HUNDREDTHS) } else { self.delay },
            dispose: DisposalMethod::Keep,
            transparent: Some(SAME),
            buffer: Cow::Owned(pixels),
            ..Frame::default()
        };
        self.before = numbers;
        self.encoder.write_frame(&frame).map_err(io::Error::other)
    }

    fn finish(self) -> io::Result<()> {
        self.encoder.into_inner().map_err(io::Error::other)?.flush()
    }
}

/// A WebM that `ffmpeg` writes from the pixels that it reads.
struct Video {
    child: Child,
    /// Reads the messages of `ffmpeg`.
    errors_of_ffmpeg: JoinHandle<String>,
    path: PathBuf,
    /// Whether `ffmpeg` still takes frames.
    accepts_frames: bool,
}

impl Video {
    /// Starts `ffmpeg`.
    ///
    /// # Errors
    /// A sentence that says why it cannot be started.
    fn start(path: &Path, size: [usize; 2], fps: u16) -> FileResult<Self> {
        let partial = disk::partial(path);
        disk::clear(&partial).map_err(|e| e.to_string())?;
        let mut command = Command::new("ffmpeg");
        command
            .args(["-nostdin", "-y", "-loglevel", "error", "-f", "rawvideo"])
            .args(["-pixel_format", "rgb24", "-video_size"])
            .arg(format!("{}x{}", size[0], size[1]))
            .args(["-framerate", &fps.to_string(), "-i", "pipe:0", "-c:v", "libvpx-vp9"])
            // Constant quality.
            .args(["-crf", "24", "-b:v", "0", "-pix_fmt", "yuv420p", "-f", "webm"])
            .arg(&partial);
        let child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = child.spawn().map_err(|e| match e.kind() {
            ErrorKind::NotFound => {
                "there is no ffmpeg on the PATH, which is needed to write it".to_owned()
            }
            _ => format!("ffmpeg: {e}"),
        })?;
        let errors = child.stderr.take();
        // Another thread reads the messages, so that ffmpeg never waits to write them.
        let errors_of_ffmpeg = std::thread::spawn(move || {
            let mut errors_of_ffmpeg = Vec::new();
            if let Some(errors) = errors {
                let _ = errors.take(MOST_ERROR_TEXT).read_to_end(&mut errors_of_ffmpeg);
            }
            String::from_utf8_lossy(&errors_of_ffmpeg).trim().to_owned()
        });
        Ok(Self { child, errors_of_ffmpeg, path: path.to_owned(), accepts_frames: true })
    }

    /// Adds a frame, unless `ffmpeg` has ended.
    fn add(&mut self, raster: &Raster) {
        if let Some(pixels) = self.child.stdin.as_mut().filter(|_| self.accepts_frames) {
            self.accepts_frames = pixels.write_all(&raster.pixels.concat()).is_ok();
        }
    }

    /// Waits for `ffmpeg` to end.
    ///
    /// # Errors
    /// The messages of `ffmpeg`.
    fn finish(mut self) -> FileResult<()> {
        drop(self.child.stdin.take());
        let ended = self.child.wait().map_err(|e| format!("ffmpeg: {e}"))?;
        let errors_of_ffmpeg = self.errors_of_ffmpeg.join().unwrap_or_default();
        let partial = disk::partial(&self.path);
        let renamed = if ended.success() && self.accepts_frames {
            std::fs::rename(&partial, &self.path).map_err(|e| e.to_string())
        } else {
            Err(if errors_of_ffmpeg.is_empty() { ended.to_string() } else { errors_of_ffmpeg })
        };
        renamed.map_err(|why| {
            let _ = disk::clear(&partial);
            format!("ffmpeg: {why}")
        })
    }
}
