//! The certificate of a page that other machines reach: a PEM file with the certificate and its key. If there is no such
//! file, it is made. So a browser that was told once to accept the certificate asks no more.

use std::io::Write as _;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

use rcgen::{CertificateParams, DnType, ExtendedKeyUsagePurpose, KeyPair, KeyUsagePurpose};
use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::version::TLS13;
use rustls::{Error, ServerConfig};
use sha2::{Digest, Sha256};

use crate::serve::http_stream::Tls;

/// The largest file that is read as a certificate. A chain with its key has less than 20 KB. \[OURS]
const FILE_MAX: u64 = 1 << 20;
/// An address of no machine (RFC 5737). The system's route to it shows by which of its addresses others reach this machine;
/// nothing is sent there.
const ELSEWHERE: (&str, u16) = ("192.0.2.1", 9);

/// Why there is no certificate to use.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// The file cannot be read.
    #[error("cannot read the certificate {}: {source}; choose another file with --cert", .file.display())]
    Read {
        /// The path of the file.
        file: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// Everybody may read the private key.
    #[cfg(unix)]
    #[error(
        "everybody may read the private key in {0}, and so pretend to be this page; chmod 600 {0}", .file.display()
    )]
    Open {
        /// The path of the file.
        file: PathBuf,
    },
    /// The file contains no usable certificate with its key.
    #[error(
        "{} is no certificate for the page: {why}; --cert needs a PEM file with a certificate and its private key, or the name of a \
         file that is not there, which is then made",
        .file.display()
    )]
    Content {
        /// The path of the file.
        file: PathBuf,
        /// The reason, in words for the user.
        why: String,
    },
    /// No certificate can be made.
    #[error("cannot make the certificate {}: {why}; choose another file with --cert", .file.display())]
    Make {
        /// The path of the file.
        file: PathBuf,
        /// The reason, in words for the user.
        why: String,
    },
}

/// A certificate with its key, ready for use.
pub struct Certificate {
    /// The server's TLS configuration with this certificate.
    pub tls: Tls,
    /// The SHA-256 fingerprint as browsers show it, in hexadecimal digits.
    pub fingerprint: String,
    /// Whether the file was made now.
    pub is_new: bool,
}

impl Certificate {
    /// Reads the file. If it is not there, makes one for a server that listens on `listen`.
    ///
    /// # Errors
    /// [`CertificateError`] if the file cannot be read or made, or has no certificate with its key.
    pub fn load_or_make(file: &Path, listen: SocketAddr) -> Result<Self, CertificateError> {
        let failed = |source| CertificateError::Read { file: file.to_owned(), source };
        match fs::metadata(file) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => match make(file, listen) {
                Ok(()) => Ok(Self { is_new: true, ..Self::load(file)? }),
                // Another server has made it meanwhile.
                Err(_) if file.is_file() => Self::load(file),
                Err(why) => Err(CertificateError::Make { file: file.to_owned(), why }),
            },
            Err(error) => Err(failed(error)),
            Ok(metadata) if !metadata.is_file() || metadata.len() > FILE_MAX => {
                Err(failed(io::Error::other("it is no regular file of at most 1 MB")))
            }
            #[cfg(unix)]
            Ok(metadata) if std::os::unix::fs::PermissionsExt::mode(&metadata.permissions()) & 0o007 != 0 => {
                Err(CertificateError::Open { file: file.to_owned() })
            }
            Ok(_) => Self::load(file),
        }
    }

    fn load(file: &Path) -> Result<Self, CertificateError> {
        let text = fs::read(file).map_err(|source| CertificateError::Read { file: file.to_owned(), source })?;
        let wrong = |why: String| CertificateError::Content { file: file.to_owned(), why };
        let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_slice_iter(&text)
            .collect::<Result<_, pem::Error>>()
            .map_err(|error| wrong(error.to_string()))?;
        let Some(first) = chain.first() else { return Err(wrong("it has no certificate".to_owned())) };
        let digits: Vec<String> = Sha256::digest(first).iter().map(|byte| format!("{byte:02X}")).collect();
        let fingerprint = digits.join(":");
        let key = PrivateKeyDer::from_pem_slice(&text).map_err(|error| {
            wrong(match error {
                pem::Error::NoItemsFound => "it has no private key, or one with a passphrase".to_owned(),
                _ => "its private key cannot be read: it is cut, or has a passphrase".to_owned(),
            })
        })?;
        let config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_protocol_versions(&[&TLS13])
            .and_then(|config| config.with_no_client_auth().with_single_cert(chain, key))
            .map_err(|error| {
                wrong(match error {
                    Error::InconsistentKeys(_) => "the key is not that of its first certificate, which has to be that of the page",
                    Error::General(_) => "its private key is of a kind that is not supported; RSA from 2048 bits on, EC P-256 and P-384, and Ed25519 are",
                    _ => return wrong(error.to_string()),
                }.to_owned())
            })?;
        Ok(Self { tls: Arc::new(config), fingerprint, is_new: false })
    }
}

/// Makes a certificate that is signed by its own key. On Unix nobody but the owner of the file may read it.
fn make(file: &Path, listen: SocketAddr) -> Result<(), String> {
    let mut names = vec!["localhost".to_owned()];
    names.extend(reached_at(listen).map(|address| address.to_string()));
    if let Some(host) = host_name() {
        let short = host.split('.').next().unwrap_or(&host).to_owned();
        names.extend([format!("{short}.local"), short]);
        names.extend(Some(host).filter(|host| host.contains('.')));
    }
    let mut wanted = CertificateParams::new(names).map_err(|error| error.to_string())?;
    wanted.distinguished_name.push(DnType::CommonName, "ecmsk serve web");
    wanted.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    wanted.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    let key = KeyPair::generate().map_err(|error| error.to_string())?;
    let certificate = wanted.self_signed(&key).map_err(|error| error.to_string())?;
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // A temporary file is readable by its owner alone. It does not replace a file that another process has made meanwhile.
    let mut beside = tempfile::NamedTempFile::new_in(folder).map_err(|error| error.to_string())?;
    beside
        .write_all((certificate.pem() + &key.serialize_pem()).as_bytes())
        .and_then(|()| beside.as_file().sync_all())
        .map_err(|error| error.to_string())?;
    beside.persist_noclobber(file).map(drop).map_err(|error| error.error.to_string())
}

/// The address at which other machines reach a server that listens on `listen`; `None` if it listens on all addresses and
/// the system has no route to others.
pub fn reached_at(listen: SocketAddr) -> Option<IpAddr> {
    if !listen.ip().is_unspecified() {
        return Some(listen.ip());
    }
    let any = SocketAddr::from(([0, 0, 0, 0], 0));
    let routed = UdpSocket::bind(any).and_then(|socket| {
        socket.connect(ELSEWHERE)?;
        socket.local_addr()
    });
    routed.ok().map(|address| address.ip()).filter(|address| !address.is_unspecified())
}

/// The name or address by which other machines reach a server that listens on `listen`, as it stands in an address of a page.
pub fn host_of(listen: SocketAddr) -> String {
    match reached_at(listen) {
        Some(IpAddr::V6(address)) => format!("[{address}]"),
        Some(address) => address.to_string(),
        None => host_name().unwrap_or_else(|| "localhost".to_owned()),
    }
}

/// The name of this machine, if it can be a part of a certificate.
fn host_name() -> Option<String> {
    #[cfg(unix)]
    let name = rustix::system::uname().nodename().to_str().ok()?.to_owned();
    #[cfg(not(unix))]
    let name = std::env::var("COMPUTERNAME").ok()?;
    let is_name = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || "-.".contains(c));
    is_name(&name).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set_mode(file: &Path, mode: u32) {
        #[cfg(unix)]
        fs::set_permissions(file, std::os::unix::fs::PermissionsExt::from_mode(mode)).expect("it is ours");
        #[cfg(not(unix))]
        let _ = (file, mode);
    }

    /// A key that everybody may read is refused; a group may, as that of Debian's certificates.
    #[cfg(unix)]
    #[test]
    fn a_key_that_everybody_may_read_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("page.pem");
        Certificate::load_or_make(&file, LISTEN.into()).expect("it is made");
        set_mode(&file, 0o644);
        let error = Certificate::load_or_make(&file, LISTEN.into()).err().expect("it is open").to_string();
        assert!(error.contains("chmod 600"), "{error}");
        set_mode(&file, 0o640);
        assert!(Certificate::load_or_make(&file, LISTEN.into()).is_ok());
    }

    const LISTEN: ([u8; 4], u16) = ([192, 0, 2, 7], 4714);

    /// A certificate is made once, for its owner alone, and is the same at the next start.
    #[test]
    fn a_certificate_is_made_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("page.pem");
        let made = Certificate::load_or_make(&file, LISTEN.into()).expect("it is made");
        assert!(made.is_new);
        let again = Certificate::load_or_make(&file, LISTEN.into()).expect("it is read");
        assert!(!again.is_new);
        assert_eq!(again.fingerprint, made.fingerprint);
        assert_eq!(made.fingerprint.len(), 32 * 3 - 1);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            assert_eq!(fs::metadata(&file).expect("it is there").permissions().mode() & 0o777, 0o600);
        }
        let text = fs::read(&file).expect("a file");
        let der = CertificateDer::from_pem_slice(&text).expect("a certificate");
        // The address and the names are in the certificate, the address as its four bytes.
        for name in [&[192, 0, 2, 7][..], b"localhost", b"ecmsk serve web"] {
            assert!(der.windows(name.len()).any(|bytes| bytes == name), "{name:?}");
        }
    }

    /// A file that has no certificate, no key, or the key of another certificate is refused and stays as it is.
    #[test]
    fn a_file_of_another_kind_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let pem = |name: &str| {
            let file = folder.path().join(name);
            Certificate::load_or_make(&file, LISTEN.into()).expect("it is made");
            let text = fs::read_to_string(file).expect("text");
            let at = text.find("-----BEGIN PRIVATE").expect("a key");
            (text[..at].to_owned(), text[at..].to_owned())
        };
        let ((certificate, key), (_, other_key)) = (pem("a.pem"), pem("b.pem"));
        let file = folder.path().join("wrong.pem");
        for (text, why) in [
            (String::new(), "no certificate"),
            ("format = 1\n".to_owned(), "no certificate"),
            (key, "no certificate"),
            (certificate.clone(), "no private key"),
            (certificate.clone() + &other_key, "key"),
            (certificate.replace("MI", "M!"), "no certificate for the page"),
        ] {
            fs::write(&file, &text).expect("it is written");
            set_mode(&file, 0o600);
            let error = Certificate::load_or_make(&file, LISTEN.into()).err().expect("it is refused").to_string();
            assert!(error.contains(why) && error.contains("wrong.pem"), "{error}");
            assert_eq!(fs::read_to_string(&file).expect("it is there"), text);
        }
        let error = Certificate::load_or_make(folder.path(), LISTEN.into()).err().expect("a folder").to_string();
        assert!(error.contains("no regular file"), "{error}");
        let nowhere = folder.path().join("none/page.pem");
        let error = Certificate::load_or_make(&nowhere, LISTEN.into()).err().expect("no folder").to_string();
        assert!(error.contains("cannot make"), "{error}");
    }
}
