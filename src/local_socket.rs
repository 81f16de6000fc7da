//! A listening Unix socket that its owner alone may use, and that leaves no file behind.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use rustix::net::{AddressFamily, SocketAddrUnix, SocketType, bind, listen, socket};

/// How many connections the system may queue until they are accepted. \[OURS]
const BACKLOG: i32 = 16;

/// A listening Unix socket, non-blocking; its path is removed at the end.
#[derive(Debug)]
pub(crate) struct LocalSocket {
    listener: UnixListener,
    path: PathBuf,
    /// Device and inode of the socket's file. They show at the end whether the path still belongs to this socket, and
    /// not to a later one. `None`: they could not be read.
    file: Option<(u64, u64)>,
}

impl LocalSocket {
    /// Binds the path. A socket without a listening process is replaced, since a process that was killed leaves one
    /// behind. Any other file at the path is an error.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`]: there is a file that is no socket. [`io::ErrorKind::AddrInUse`]: a process
    /// listens there. Else the system's error, as for a path that is too long or a folder that takes no files.
    pub(crate) fn bind(path: &Path) -> io::Result<Self> {
        match fs::symlink_metadata(path) {
            Ok(there) if !there.file_type().is_socket() => {
                return Err(io::Error::new(io::ErrorKind::AlreadyExists, "there is a file, which stays as it is"));
            }
            Ok(_) => match UnixStream::connect(path) {
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => fs::remove_file(path)?,
                Ok(_) => return Err(io::Error::new(io::ErrorKind::AddrInUse, "somebody listens there")),
                Err(error) => return Err(error),
            },
            Err(_) => {}
        }
        let socket = socket(AddressFamily::UNIX, SocketType::STREAM, None)?;
        rustix::io::fcntl_setfd(&socket, rustix::io::FdFlags::CLOEXEC)?;
        bind(&socket, &SocketAddrUnix::new(path)?)?;
        // Before the call of `listen` nobody can connect, and after it only the owner can.
        fs::set_permissions(path, fs::Permissions::from_mode(0o600))?;
        listen(&socket, BACKLOG)?;
        let listener = UnixListener::from(socket);
        listener.set_nonblocking(true)?;
        let file = fs::symlink_metadata(path).ok().map(|file| (file.dev(), file.ino()));
        Ok(Self { listener, path: path.to_owned(), file })
    }

    /// The socket itself, to accept connections.
    pub(crate) const fn listener(&self) -> &UnixListener {
        &self.listener
    }

    /// The path of the socket.
    #[cfg_attr(not(feature = "serve"), allow(dead_code, reason = "a served chip shows its address"))]
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for LocalSocket {
    fn drop(&mut self) {
        let there = fs::symlink_metadata(&self.path).ok().map(|file| (file.dev(), file.ino()));
        if there.is_some() && there == self.file {
            // A file that cannot be removed does no harm: the next process finds that nobody listens there, and
            // replaces it.
            let _ = fs::remove_file(&self.path);
        }
    }
}
