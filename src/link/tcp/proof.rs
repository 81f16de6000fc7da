//! The shared secret, and how each end shows the other that it knows it.
//!
//! Both ends take keying material out of their TLS session (RFC 5705, RFC 8446 7.5) and sign it with the secret
//! (HMAC-SHA256), the client first. In the middle of two sessions there are two different materials: what one end signs is
//! worth nothing to the other.

use std::collections::HashSet;
use std::fmt;
use std::path::{Path, PathBuf};

use ring::hmac;

use crate::files;
use crate::link::{LinkError, config};

/// The variable that holds the secret.
pub const SECRET: &str = "ECMSK_TCP_SECRET";
/// Bytes of a proof.
pub const PROOF_LEN: usize = 32;
/// Keying material of a session.
pub(crate) type Material = [u8; 32];
/// The label of that material, one of the project's own.
pub(crate) const LABEL: &[u8] = b"EXPORTER-ecmsk-tcp";
/// \[OURS] The shortest secret, bytes: whoever talks to one end can try secrets out at home, so it has to be one that
/// nobody can guess, made by a machine.
const SHORTEST: usize = 32;
/// \[OURS] The longest secret, bytes, and the longest file that one is read from: more is another file.
const LONGEST: usize = 4096;
/// \[OURS] How many different bytes a secret has at least. `000...0` and the like are what people write who try the thing
/// out, and what others try first; 32 random hexadecimal digits have fewer once in some 25 million times.
const DIFFERENT_BYTES_MIN: usize = 8;
const MAKE_ONE: &str = "make one: (umask 077; head -c 32 /dev/urandom | base64 > FILE)";

/// Which end proves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Client,
    Server,
}

/// What both ends know.
#[derive(Clone)]
pub struct Secret(hmac::Key);

impl Secret {
    /// The secret in a file, without the white space around it. It is a regular file that nobody but its owner may read, and
    /// its owner is this user or root.
    ///
    /// # Errors
    /// [`LinkError::Io`]: it cannot be read or is no regular file, it is another user's, others may read it, it is too short,
    /// too long or no secret.
    pub fn load(path: &Path) -> Result<Self, LinkError> {
        let failed = |message: String| LinkError::Io { what: format!("read the secret {}", path.display()), message };
        let file = files::read_small(path, LONGEST as u64).map_err(|error| failed(format!("{error}; {MAKE_ONE}")))?;
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt as _;
            let user = rustix::process::geteuid().as_raw();
            check_owner(file.metadata.uid(), user, path).map_err(failed)?;
            let mode = file.metadata.mode() & 0o777;
            if mode & 0o077 != 0 {
                return Err(failed(format!("others may read it (mode {mode:o}); chmod 600 {}", path.display())));
            }
        }
        Self::new(&file.bytes).map_err(failed)
    }

    /// The secret of a file, else that of the variable [`SECRET`]; `None` if there is neither.
    ///
    /// # Errors
    /// As [`Secret::load`].
    pub fn find(path: Option<&Path>) -> Result<Option<Self>, LinkError> {
        if let Some(path) = path {
            return Self::load(path).map(Some);
        }
        let Some(text) = config::variable(SECRET).filter(|text| !text.is_empty()) else { return Ok(None) };
        let failed = |message| LinkError::Io { what: format!("use the secret of {SECRET}"), message };
        Self::new(text.as_encoded_bytes()).map(Some).map_err(failed)
    }

    fn new(text: &[u8]) -> Result<Self, String> {
        let text = text.trim_ascii();
        if text.len() < SHORTEST {
            return Err(format!("it has {} bytes, it needs {SHORTEST}; {MAKE_ONE}", text.len()));
        }
        if text.len() > LONGEST {
            return Err(format!("it has {} bytes, at most {LONGEST} are read; {MAKE_ONE}", text.len()));
        }
        let different = text.iter().collect::<HashSet<_>>().len();
        if different < DIFFERENT_BYTES_MIN {
            return Err(format!("it can be guessed: it has only {different} different characters; {MAKE_ONE}"));
        }
        Ok(Self(hmac::Key::new(hmac::HMAC_SHA256, text)))
    }

    /// What `side` sends in a session of that material.
    pub(crate) fn prove(&self, side: Side, material: &Material) -> [u8; PROOF_LEN] {
        let tag = hmac::sign(&self.0, &signed(side, material));
        std::array::from_fn(|i| tag.as_ref()[i])
    }

    /// Whether that came from a `side` that knows the secret, in time that does not depend on where it is wrong.
    pub(crate) fn is_proof(&self, side: Side, material: &Material, proof: &[u8; PROOF_LEN]) -> bool {
        hmac::verify(&self.0, &signed(side, material), proof).is_ok()
    }
}

/// \[OURS] A secret file is this user's or root's: whoever else owns it knows what is in it.
#[cfg(unix)]
fn check_owner(owner: u32, user: u32, path: &Path) -> Result<(), String> {
    if owner == user || owner == 0 {
        return Ok(());
    }
    Err(format!(
        "it belongs to user {owner}, who knows what is in it, and this is user {user}; make it yours: chown {user} {}",
        path.display()
    ))
}

/// Each side signs something else: none can send back what it got.
fn signed(side: Side, material: &Material) -> Vec<u8> {
    let side: &[u8] = match side {
        Side::Client => b"ecmsk tcp client ",
        Side::Server => b"ecmsk tcp server ",
    };
    [side, material].concat()
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret")
    }
}

/// Where a client's secret is, for messages.
pub(crate) fn how_to_give(path: Option<&PathBuf>) -> String {
    match path {
        Some(path) => format!("secret_file={}", path.display()),
        None => format!("the variable {SECRET}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A secret of 32 bytes, of the letters from `first` on.
    fn letters(first: u8) -> String {
        (0..32).map(|i| char::from(first + i % 10)).collect()
    }

    /// TCP-16 A proof is good for its side, its session and its secret alone, and short secrets are refused.
    #[test]
    fn a_proof_is_good_for_one_side_of_one_session() {
        let secret = |text: &str| Secret::new(text.as_bytes()).unwrap();
        let (ours, other) = (secret(&letters(b'a')), secret(&letters(b'b')));
        let proof = ours.prove(Side::Client, &[1; 32]);
        assert!(ours.is_proof(Side::Client, &[1; 32], &proof));
        assert!(!ours.is_proof(Side::Server, &[1; 32], &proof));
        assert!(!ours.is_proof(Side::Client, &[2; 32], &proof));
        assert!(!other.is_proof(Side::Client, &[1; 32], &proof));
        assert!(!ours.is_proof(Side::Client, &[1; 32], &[0; 32]));
        assert_eq!(secret(&format!(" {}\n", letters(b'a'))).prove(Side::Client, &[1; 32]), proof);
        let short = Secret::new(&letters(b'a').as_bytes()[..31]).unwrap_err();
        assert!(short.contains("31") && short.contains("32"), "{short}");
    }

    /// TCP-16 Secrets that can be guessed are refused, and what is far too long; what a machine makes is taken.
    #[test]
    fn what_can_be_guessed_is_no_secret() {
        for guessed in ["0".repeat(32), "0".repeat(64), "01".repeat(32), "abcdefg".repeat(10)] {
            let error = Secret::new(guessed.as_bytes()).unwrap_err();
            assert!(error.contains("can be guessed") && error.contains("make one"), "{guessed}: {error}");
        }
        let long = Secret::new(letters(b'a').repeat(129).as_bytes()).unwrap_err();
        assert!(long.contains("4128 bytes") && long.contains("4096"), "{long}");
        for made in ["0f3a9c5571e2b84d6677aa01d9e4c3b2", "q83vEjRWeJASNFZ4kBI0VniQEjRWeJASNFZ4kBI0VnA="] {
            assert!(Secret::new(made.as_bytes()).is_ok(), "{made}");
        }
    }

    /// TCP-16 The file is this user's or root's.
    #[cfg(unix)]
    #[test]
    fn another_users_file_is_refused() {
        let path = Path::new("secret");
        assert_eq!(check_owner(1000, 1000, path), Ok(()));
        assert_eq!(check_owner(0, 1000, path), Ok(()));
        for user in [0, 1001] {
            let error = check_owner(1000, user, path).unwrap_err();
            assert!(
                error.contains("belongs to user 1000") && error.contains(&format!("chown {user} secret")),
                "{error}"
            );
        }
    }
}
