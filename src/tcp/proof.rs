//! The shared secret, and the proof by which each end shows the other one that it knows the secret.
//!
//! Both ends derive keying material from their TLS session (RFC 5705, RFC 8446 7.5) and sign it with the secret
//! (HMAC-SHA256), the client first. An attacker between the two ends would have a TLS session with each of them. The
//! two sessions have different keying material, so the proof of one end is not valid for the other.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::{fmt, mem};

use ring::hmac;

use crate::address::config;
use crate::files;
use crate::link::LinkError;

/// The environment variable with the text of the secret that server and clients share, used if no file with the secret is
/// given.
pub const SECRET: &str = "ECMSK_TCP_SECRET";
/// The length of a proof in bytes.
pub const PROOF_LEN: usize = 32;
/// Keying material of a TLS session, which only its two ends can derive. A proof signs it, so that the proof is valid in this
/// session only.
pub(crate) type Material = [u8; 32];
/// The label for deriving the keying material from a TLS session (RFC 5705).
pub(crate) const LABEL: &[u8] = b"EXPORTER-ecmsk-tcp";
/// Comes before the label in [`Secret::derived`], so that no derived key is a proof.
const DERIVED: &[u8] = b"derived: ";
/// \[OURS] The shortest secret in bytes. An attacker who connects to one end gets a proof, an HMAC with the secret as its key,
/// and can then try any number of secrets on its own computer until one gives the same HMAC. So a secret has to be too long to
/// guess, and random instead of chosen by a person.
const SECRET_BYTES_MIN: usize = 32;
/// \[OURS] The longest secret in bytes, and the largest file that is read as one.
const SECRET_BYTES_MAX: usize = 4096;
/// \[OURS] The minimum number of different bytes in a secret. People who try out the server write `000...0` or the like, and
/// attackers try that first. Of secrets of 32 random hexadecimal digits, about one in 25 million has fewer different bytes.
const DIFFERENT_BYTES_MIN: usize = 8;
const HOW_TO_MAKE_ONE: &str = "make one: (umask 077; head -c 32 /dev/urandom | base64 > FILE)";

/// The end of the connection that makes a proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    Client,
    Server,
}

/// The shared secret of a server and its clients.
#[derive(Clone)]
pub struct Secret(hmac::Key);

impl Secret {
    /// Reads the secret from a file; white space around it is ignored. The file has to be a regular file that belongs
    /// to this user or to root and that nobody but its owner can read.
    ///
    /// # Errors
    /// [`LinkError::Io`] if the file cannot be read, is not a regular file, belongs to another user or can be read by
    /// others, or if the secret is too short, too long or easy to guess.
    pub fn load(path: &Path) -> Result<Self, LinkError> {
        let failed = |message: String| LinkError::Io { what: format!("read the secret {}", path.display()), message };
        let mut file = files::read_small(path, SECRET_BYTES_MAX as u64)
            .map_err(|error| failed(format!("{error}; {HOW_TO_MAKE_ONE}")))?;
        let text = Wiped(mem::take(&mut file.bytes));
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
        Self::new(&text.0).map_err(failed)
    }

    /// The secret in the file `path`, or else in the variable [`SECRET`]; `None` if neither is given.
    ///
    /// # Errors
    /// Those of [`Secret::load`].
    pub fn find(path: Option<&Path>) -> Result<Option<Self>, LinkError> {
        if let Some(path) = path {
            return Self::load(path).map(Some);
        }
        let Some(text) = config::variable(SECRET).filter(|text| !text.is_empty()) else { return Ok(None) };
        let failed = |message| LinkError::Io { what: format!("use the secret of {SECRET}"), message };
        let text = Wiped(text.into_encoded_bytes());
        Self::new(&text.0).map(Some).map_err(failed)
    }

    fn new(text: &[u8]) -> Result<Self, String> {
        let text = text.trim_ascii();
        if text.len() < SECRET_BYTES_MIN {
            return Err(format!("it has {} bytes, it needs {SECRET_BYTES_MIN}; {HOW_TO_MAKE_ONE}", text.len()));
        }
        if text.len() > SECRET_BYTES_MAX {
            return Err(format!("it has {} bytes, at most {SECRET_BYTES_MAX} are read; {HOW_TO_MAKE_ONE}", text.len()));
        }
        let different = text.iter().collect::<HashSet<_>>().len();
        if different < DIFFERENT_BYTES_MIN {
            return Err(format!("it can be guessed: it has only {different} different characters; {HOW_TO_MAKE_ONE}"));
        }
        Ok(Self(hmac::Key::new(hmac::HMAC_SHA256, text)))
    }

    /// A key that only who knows the secret can make, for another purpose than proofs. Different labels give keys of which
    /// none tells anything about another one, or about the secret.
    #[must_use]
    pub fn derived(&self, label: &str) -> [u8; 32] {
        let tag = hmac::sign(&self.0, &[DERIVED, label.as_bytes()].concat());
        std::array::from_fn(|i| tag.as_ref()[i])
    }

    /// The proof that `side` knows the secret, valid for the TLS session with this keying material.
    pub(crate) fn prove(&self, side: Side, material: &Material) -> [u8; PROOF_LEN] {
        let tag = hmac::sign(&self.0, &signed_bytes(side, material));
        std::array::from_fn(|i| tag.as_ref()[i])
    }

    /// Whether `proof` was made by `side` with this secret. The time of the check does not depend on which byte is
    /// wrong.
    pub(crate) fn is_proof(&self, side: Side, material: &Material, proof: &[u8; PROOF_LEN]) -> bool {
        hmac::verify(&self.0, &signed_bytes(side, material), proof).is_ok()
    }
}

/// The text of a secret. It is overwritten when it is dropped, so that dumps of the process's memory do not contain it.
/// The HMAC key remains, from which the text cannot be recovered; and so does the environment variable, if the text
/// came from it.
struct Wiped(Vec<u8>);

impl Drop for Wiped {
    fn drop(&mut self) {
        self.0.fill(0);
        // Keeps the compiler from removing the overwrite, whose result is never read.
        std::hint::black_box(self.0.as_ptr());
    }
}

/// \[OURS] A secret file belongs to this user or to root, because its owner knows what is in it.
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

/// The bytes that `side` signs. The two sides sign different bytes, so that an attacker cannot answer an end with the proof
/// that this end has just sent.
fn signed_bytes(side: Side, material: &Material) -> Vec<u8> {
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

/// The way in which the user gives the secret (the key `secret_file=` or the environment variable), for error messages.
pub(crate) fn how_to_give(path: Option<&PathBuf>) -> String {
    match path {
        Some(path) => format!("secret_file={}", path.display()),
        None => format!("the variable {SECRET}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A secret of 32 bytes: ten letters from `first` on, repeated.
    fn letters(first: u8) -> String {
        (0..32).map(|i| char::from(first + i % 10)).collect()
    }

    /// A proof is valid for one side, one session and one secret only, and short secrets are refused.
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

    /// A derived key depends on secret and label, and is no proof.
    #[test]
    fn a_derived_key_is_no_proof() {
        let secret = |text: &str| Secret::new(text.as_bytes()).unwrap();
        let (ours, other) = (secret(&letters(b'a')), secret(&letters(b'b')));
        let key = ours.derived("page");
        assert_eq!(key, ours.derived("page"));
        assert!(![ours.derived("pages"), ours.derived(""), other.derived("page")].contains(&key));
        assert!(!ours.is_proof(Side::Client, &[1; 32], &key));
    }

    /// Secrets that can be guessed or are too long are refused; random ones are accepted.
    #[test]
    fn a_secret_that_can_be_guessed_is_refused() {
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

    /// The file must belong to this user or to root.
    #[cfg(unix)]
    #[test]
    fn a_secret_file_of_another_user_is_refused() {
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

    /// After use the text of a secret is nowhere in the process's memory, and so in no dump of it.
    #[cfg(target_os = "linux")]
    #[test]
    fn no_text_of_a_secret_stays_in_memory() {
        use std::fs;
        use std::io::{Read as _, Seek as _, SeekFrom};
        use std::os::unix::fs::PermissionsExt as _;

        const LEN: usize = 48;
        let salt = std::process::id() as usize;
        // The test searches this process's memory for the text. So the program must not contain it as a constant: each letter
        // is computed, and the process id makes the text different in each run.
        let letter = |i: usize| b"abcdefghijklmnopqrstuvwxyz0123456789"[(i * i * 7 + i * 13 + salt) % 36];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        let mut text = Wiped((0..LEN).map(letter).collect());
        fs::write(&path, &text.0).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        let places = |text: Option<&Wiped>| {
            let mut memory = fs::File::open("/proc/self/mem").unwrap();
            let mut found = 0;
            for line in fs::read_to_string("/proc/self/maps").unwrap().lines().filter(|line| line.contains(" rw")) {
                let (from, rest) = line.split_once('-').unwrap();
                let [from, to] = [from, rest.split_once(' ').unwrap().0].map(|at| u64::from_str_radix(at, 16).unwrap());
                let mut bytes = Wiped(vec![0; (to - from) as usize]);
                if memory.seek(SeekFrom::Start(from)).is_ok() && memory.read_exact(&mut bytes.0).is_ok() {
                    let is_it = |at: &[u8]| at.len() >= LEN / 2 && (0..LEN / 2).all(|i| at[i] == letter(i));
                    let mut rest = &bytes.0[..];
                    // SAFETY: `rest` has `rest.len()` bytes.
                    while let Some(at) = unsafe {
                        let first = libc::memchr(rest.as_ptr().cast(), letter(0).into(), rest.len());
                        (!first.is_null()).then(|| first.cast::<u8>().offset_from_unsigned(rest.as_ptr()))
                    } {
                        found += usize::from(is_it(&rest[at..]));
                        rest = &rest[at + 1..];
                    }
                }
            }
            let _ = text;
            found
        };
        assert!(places(Some(&text)) > 0, "it would be seen");
        text.0.fill(0);
        drop(text);
        let secret = Secret::load(&path).unwrap();
        assert_eq!(places(None), 0);
        secret.prove(Side::Client, &[1; 32]);
        assert_eq!(places(None), 0);
    }
}
