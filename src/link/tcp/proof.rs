//! The shared secret, and how each end shows the other that it knows it.
//!
//! Both ends take keying material out of their TLS session (RFC 5705, RFC 8446 7.5) and sign it with the secret
//! (HMAC-SHA256), the client first. In the middle of two sessions there are two different materials: what one end signs is
//! worth nothing to the other.

use std::path::{Path, PathBuf};
use std::{env, fmt, fs};

use ring::hmac;

use crate::link::LinkError;

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
    /// The secret in a file, without the white space around it. Nobody but its owner may read the file.
    ///
    /// # Errors
    /// [`LinkError::Io`]: it cannot be read, others may read it, or it is too short.
    pub fn load(path: &Path) -> Result<Self, LinkError> {
        let failed = |message: String| LinkError::Io { what: format!("read the secret {}", path.display()), message };
        let text = fs::read(path).map_err(|error| failed(format!("{error}; {MAKE_ONE}")))?;
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            let mode = fs::metadata(path).map_err(|error| failed(error.to_string()))?.permissions().mode();
            if mode & 0o077 != 0 {
                let mode = mode & 0o777;
                return Err(failed(format!("others may read it (mode {mode:o}); chmod 600 {}", path.display())));
            }
        }
        Self::new(&text).map_err(failed)
    }

    /// The secret of a file, else that of the variable [`SECRET`]; `None` if there is neither.
    ///
    /// # Errors
    /// As [`Secret::load`].
    pub fn find(path: Option<&Path>) -> Result<Option<Self>, LinkError> {
        if let Some(path) = path {
            return Self::load(path).map(Some);
        }
        let Some(text) = env::var_os(SECRET).filter(|text| !text.is_empty()) else { return Ok(None) };
        let failed = |message| LinkError::Io { what: format!("use the secret of {SECRET}"), message };
        Self::new(text.as_encoded_bytes()).map(Some).map_err(failed)
    }

    fn new(text: &[u8]) -> Result<Self, String> {
        let text = text.trim_ascii();
        if text.len() < SHORTEST {
            return Err(format!("it has {} bytes, it needs {SHORTEST}; {MAKE_ONE}", text.len()));
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

    /// TCP-16 A proof is good for its side, its session and its secret alone, and short secrets are refused.
    #[test]
    fn a_proof_is_good_for_one_side_of_one_session() {
        let secret = |text: &str| Secret::new(text.as_bytes()).unwrap();
        let (ours, other) = (secret(&"a".repeat(32)), secret(&"b".repeat(32)));
        let proof = ours.prove(Side::Client, &[1; 32]);
        assert!(ours.is_proof(Side::Client, &[1; 32], &proof));
        assert!(!ours.is_proof(Side::Server, &[1; 32], &proof));
        assert!(!ours.is_proof(Side::Client, &[2; 32], &proof));
        assert!(!other.is_proof(Side::Client, &[1; 32], &proof));
        assert!(!ours.is_proof(Side::Client, &[1; 32], &[0; 32]));
        assert_eq!(secret(&format!(" {}\n", "a".repeat(32))).prove(Side::Client, &[1; 32]), proof);
        let short = Secret::new("a".repeat(31).as_bytes()).unwrap_err();
        assert!(short.contains("31") && short.contains("32"), "{short}");
    }
}
