//! The runs of a picture: one, or two side by side.

use crate::results::pictures::stored::StoredRun;

/// A run and the one with which it is compared, with their names.
pub struct Runs<'a> {
    /// The run.
    pub run: &'a StoredRun,
    /// The second run, if any.
    pub beside: Option<&'a StoredRun>,
    /// The names of both runs.
    pub names: [String; 2],
}

impl<'a> Runs<'a> {
    /// A run and the one with which it is compared, named after their methods or, if these are the
    /// same, after their directories.
    pub fn new(run: &'a StoredRun, beside: Option<&'a StoredRun>) -> Self {
        let method = |run: &StoredRun| match run.plan["method"].as_str() {
            Some("schrodingerized") => "Schrödingerized".to_owned(),
            Some(other) => other.to_owned(),
            None => "computed".to_owned(),
        };
        let mut names = [method(run), beside.map_or(String::new(), method)];
        if let Some(beside) = beside
            && names[0] == names[1]
        {
            let folder = |run: &StoredRun| {
                let name = run.directory.file_name().unwrap_or_default();
                name.to_string_lossy().into_owned()
            };
            names = [folder(run), folder(beside)];
        }
        Self { run, beside, names }
    }

    /// The run, then the second one, each with its name.
    pub fn each(&self) -> impl Iterator<Item = (&'a StoredRun, &str)> {
        let both = [Some(self.run), self.beside];
        (both.into_iter().zip(&self.names)).filter_map(|(run, name)| Some((run?, name.as_str())))
    }
}
