//! Which board is meant: `--link`, else the one that the library would find.

use ecmsk::link::LinkError;
use ecmsk::link::config::{ConfigError, Environment, Source, VARIABLE, find};
use ecmsk::link::uri::LinkUri;

/// The board that is meant.
pub struct Chosen {
    /// The link to it.
    pub uri: LinkUri,
    /// Where a name was looked for, if nobody gave one.
    looked: Option<String>,
}

/// Why it cannot be told which board is meant.
#[derive(Debug, thiserror::Error)]
pub enum ChoiceError {
    /// The link's file is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// What is named is no link.
    #[error(transparent)]
    Link(#[from] LinkError),
}

/// Nobody has named a board, and the default does not open.
#[derive(Debug, thiserror::Error)]
#[error(
    "no link was given: no --link, {VARIABLE} is not set, there is no {looked}; and the default does not open: {error}; to \
     run without a board use `--link 'sim:?slaves=drive*2'`, see `ecmsk link help`"
)]
pub struct Unnamed {
    looked: String,
    // Boxed: errors of all verbs have its size.
    error: Box<LinkError>,
}

impl Chosen {
    /// `link`: the option.
    ///
    /// # Errors
    /// What is wrong with `ECMSK_LINK` or `ecmsk.toml`.
    pub fn find(link: Option<&LinkUri>) -> Result<Self, ChoiceError> {
        if let Some(uri) = link {
            return Ok(Self { uri: uri.clone(), looked: None });
        }
        let environment = Environment::from_process(None);
        let configured = find(&environment)?;
        let uri = LinkUri::parse(&configured.link).map_err(LinkError::from)?;
        let files = || environment.files().iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ");
        Ok(Self { uri, looked: (configured.source == Source::Default).then(files) })
    }

    /// Why it did not open; `None`: somebody named it, and `error` says all.
    pub fn unnamed(&self, error: &LinkError) -> Option<Unnamed> {
        self.looked.clone().map(|looked| Unnamed { looked, error: Box::new(error.clone()) })
    }
}
