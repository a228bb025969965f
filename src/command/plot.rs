//! `phasewarp plot` and `phasewarp report`: a finished run as pictures, and as a page.

use crate::base::disk;
use crate::base::error::{Error, Result};
use crate::command::cli::PlotArgs;
use crate::command::describe::describe;
use crate::command::printing::{print, print_unwrapped};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::problem::exported::{self, ExportKind, ExportOwner};
use crate::results::dataset::RESULT;
use crate::results::pictures::cut::Cut;
use crate::results::pictures::stored::StoredRun;
use crate::results::pictures::{self, Album};
use crate::results::report::times::Times;
use crate::results::report::{self, Report, missing};
use crate::results::table_file::with_tables_known;
use crate::results::untrusted;
use crate::run::planning::read_and_reduced;
use std::path::{Path, PathBuf};

/// Largest number of space cells for which a report describes the case, as `V` is evaluated on all.
const MOST_POINTS: usize = 10_000_000;

/// The files that were written, and the pictures that were left out.
#[derive(Default)]
pub(super) struct WrittenFiles {
    pub files: Vec<PathBuf>,
    /// Names of the pictures that were left out, and why.
    pub left_out: Vec<(String, String)>,
}

impl WrittenFiles {
    /// Prints the names of the files and what was left out.
    pub fn print(&self, world: &World) {
        for (name, why) in &self.left_out {
            print(world, &format!("{name}: left out: {why}"));
        }
        for file in &self.files {
            print_unwrapped(world, &file.display().to_string());
        }
    }
}

/// The directory of the pictures and movies of a run.
pub(super) struct PictureDirectory {
    pub directory: PathBuf,
    /// The directory of the run.
    of_run: PathBuf,
    /// The case that owns the pictures; `None` for pictures among the results of the run.
    owner: Option<ExportOwner>,
}

impl PictureDirectory {
    /// The directory `output`, by default that of pictures among the results of the run.
    pub fn new(run: &StoredRun, output: Option<&Path>) -> Self {
        let of_run = run.directory.clone();
        let own = of_run.join(pictures::FOLDER);
        let foreign = output.filter(|path| !is_same(path, &own) && !is_same(path, &of_run));
        let owner = foreign.map(|_| {
            let settings = run.case.as_ref().map(|case| case.settings.clone());
            // A case that this program cannot read is identified by its text.
            let by_text = |_| [("case".to_owned(), run.text.clone())].into();
            ExportOwner { export: ExportKind::Pictures, settings: settings.unwrap_or_else(by_text) }
        });
        Self { directory: output.map_or(own, Path::to_owned), of_run, owner }
    }

    /// Refuses to replace files of another case, and those of `names` that phasewarp did not write,
    /// and to write among the results of another run.
    ///
    /// # Errors
    /// [`Error::Directory`].
    pub fn refuse_to_replace(&self, names: &[String]) -> Result<()> {
        refuse_among_other_results(&self.of_run, &self.directory)?;
        (self.owner.as_ref())
            .map_or(Ok(()), |owner| owner.refuse_to_replace(&self.directory, names))
    }

    /// Writes down beside the files which case owns them.
    ///
    /// # Errors
    /// [`Error::Output`].
    pub fn claim(&self) -> Result<()> {
        self.owner.as_ref().map_or(Ok(()), |owner| exported::write(&self.directory, owner))
    }
}

/// Whether both paths name the same directory, which need not exist if its parent does.
fn is_same(one: &Path, other: &Path) -> bool {
    let resolved = |path: &Path| {
        let path = std::path::absolute(path).ok()?;
        let above = || Some(std::fs::canonicalize(path.parent()?).ok()?.join(path.file_name()?));
        std::fs::canonicalize(&path).ok().or_else(above)
    };
    resolved(one).is_some_and(|one| resolved(other).is_some_and(|other| one == other))
}

/// Refuses to write into `directory`, or into its folder of pictures, where it holds the results of
/// another run than that in `of_run`.
///
/// # Errors
/// [`Error::Directory`].
fn refuse_among_other_results(of_run: &Path, directory: &Path) -> Result<()> {
    let above = directory.file_name().filter(|name| *name == pictures::FOLDER);
    let results = above.and_then(|_| directory.parent()).unwrap_or(directory);
    if !results.join(RESULT).exists() || is_same(results, of_run) {
        return Ok(());
    }
    let reason = format!(
        "it holds the {RESULT} of another run; --force writes there anyway, -o gives another \
         directory"
    );
    Err(disk::directory_error(results, reason))
}

/// Draws a run; the first rank reads and writes. Collective.
///
/// # Errors
/// As [`untrusted::open`], [`Cut::parse`], [`pictures::draw`] and [`Album::write`], the same on all
/// ranks.
pub fn execute(world: &World, args: &PlotArgs) -> Result<()> {
    let written = world.group().on_first_rank(|| {
        let DrawnRun { run, album, .. } = album(args)?;
        let place = PictureDirectory::new(&run, args.places.output.as_deref());
        if !args.force {
            place.refuse_to_replace(&album.file_names())?;
        }
        let files = album.write(&place.directory)?;
        place.claim()?;
        Ok(WrittenFiles { files, left_out: album.left_out })
    })?;
    written.print(world);
    Ok(())
}

/// Writes a report; the first rank reads and writes. Collective.
///
/// # Errors
/// As [`execute`]; [`Error::Input`] where there is no `summary.json`; as
/// [`Report::refuse_to_replace`].
pub fn execute_report(world: &World, args: &PlotArgs) -> Result<()> {
    let group = world.group();
    let opened = group.on_first_rank(|| album(args).map(Some))?;
    let description = description(world, opened.as_ref().map(|drawn| &drawn.run));
    let written = group.on_first_rank(|| match opened {
        Some(drawn) => write_report(args, drawn, description),
        None => Ok(WrittenFiles::default()),
    })?;
    written.print(world);
    Ok(())
}

/// Writes the page. Only the first rank calls it.
fn write_report(
    args: &PlotArgs,
    drawn: DrawnRun,
    description: std::result::Result<String, String>,
) -> Result<WrittenFiles> {
    let DrawnRun { run, mut album, cut } = drawn;
    let summary = run.summary.as_ref().map_err(|why| {
        let what = "a directory that `phasewarp run` wrote is expected";
        Error::Input(format!("{why}; {what}"))
    })?;
    let missing = missing(summary);
    let times = Times::new(&run, cut).unwrap_or_else(|why| {
        album.left_out.push(("times".to_owned(), why));
        None
    });
    let page = Report {
        run: &run,
        summary,
        album: &album,
        times: times.as_ref(),
        description: description.as_deref().map_err(String::as_str),
    };
    let directory = args.places.output.as_ref().unwrap_or(&args.places.directory);
    if !args.force {
        refuse_among_other_results(&page.run.directory, directory)?;
        page.refuse_to_replace(directory)?;
    }
    let page = page.html()?;
    disk::make(directory)?;
    let path = directory.join(report::NAME);
    disk::write_text(&path, &page)?;
    let mut left_out = album.left_out;
    left_out.extend(missing);
    if let Err(why) = description {
        left_out.push(("the case as it was read".to_owned(), why));
    }
    Ok(WrittenFiles { files: vec![path], left_out })
}

/// What `phasewarp check` prints about the case of a run, or why that is unknown. Only the first
/// rank has `run`. Collective.
fn description(world: &World, run: Option<&StoredRun>) -> std::result::Result<String, String> {
    let group = world.group();
    let described = || -> Result<String> {
        let (name, text, overrides): (String, String, Vec<String>) = group.of_first_rank(|| {
            let run = run.ok_or_else(|| Error::input("no run is open"))?;
            let case = run.case.as_ref().map_err(Error::input)?;
            if case.space.space_cells() > MOST_POINTS {
                return Err(Error::Input(format!("more than {MOST_POINTS} cells of space")));
            }
            Ok((case.name.clone(), run.text.clone(), run.overrides.clone()))
        })?;
        let case = Case::parse(&name, &text, &overrides)?;
        let case = read_and_reduced(&group, &case)?;
        Ok(describe(&case, &Bounds::new(&case)?))
    };
    described().map_err(|e| e.to_string())
}

/// A run and its pictures.
struct DrawnRun {
    run: StoredRun,
    album: Album,
    /// The first cut that was requested, if any.
    cut: Option<Cut>,
}

/// The run in a directory, with the tables of its case as far as their files are still there.
///
/// # Errors
/// As [`untrusted::open`].
pub(super) fn open(directory: &Path) -> Result<StoredRun> {
    let mut run = untrusted::open(directory)?;
    run.case = run.case.map(|case| with_tables_known(case, &run.provenance));
    Ok(run)
}

/// Reads the run and draws its pictures.
fn album(args: &PlotArgs) -> Result<DrawnRun> {
    let run = open(&args.places.directory)?;
    let beside = (args.beside.as_deref()).map(open).transpose()?;
    let cuts = args.slices.iter().map(|text| Cut::parse(&run, text));
    let cuts: Vec<Cut> = cuts.collect::<Result<_>>()?;
    let album = pictures::draw(&run, beside.as_ref(), &cuts)?;
    Ok(DrawnRun { run, album, cut: cuts.into_iter().next() })
}
