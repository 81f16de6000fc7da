//! The function (FunctionFS) of a gadget: the mount of its file system, endpoint 0, and the files of its two interrupt
//! endpoints.

use std::ffi::CStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use rustix::mount::{MountFlags, UnmountFlags, mount, unmount};

use super::transfers::Transfers;
use super::wire::{self, EVENT_LEN, Event};

/// The folder below which the file systems of USB functions (FunctionFS) are mounted.
pub const MOUNTS: &str = "/run/ecmsk";

/// The mount of the file system of a USB function (FunctionFS). It is removed when this value is dropped.
#[derive(Debug)]
struct Mount {
    folder: PathBuf,
}

impl Mount {
    /// Mounts the function `name` below `mounts`. An existing mount is removed first: it is the leftover of a process
    /// that has ended.
    fn new(mounts: &Path, name: &str) -> io::Result<Self> {
        let folder = mounts.join(name);
        release(&folder);
        fs::create_dir_all(&folder)?;
        mount(name, folder.as_path(), "functionfs", MountFlags::empty(), None::<&CStr>)?;
        Ok(Self { folder })
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        release(&self.folder);
    }
}

/// Removes a mount and its folder, if they are there.
fn release(folder: &Path) {
    while unmount(folder, UnmountFlags::DETACH).is_ok() {}
    // Without the mount the folder is empty. If it does not exist, nothing has to be done.
    let _ = fs::remove_dir(folder);
}

/// Endpoint 0 of a function. A request has to be answered before the next event is read: the kernel would take that
/// read as the answer to the request.
#[derive(Debug)]
pub struct ControlEndpoint(File);

impl ControlEndpoint {
    /// The next event. `None`: there is no event yet, or the kernel has reported that the host has cancelled the
    /// request that was answered last (EIDRM).
    ///
    /// # Errors
    /// Errors of the kernel: the function cannot be used any more.
    pub fn next_event(&self) -> io::Result<Option<Event>> {
        let mut bytes = [0; EVENT_LEN];
        match (&self.0).read(&mut bytes) {
            Ok(EVENT_LEN) => Ok(Some(Event::parse(&bytes))),
            Ok(_) => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock || error.kind() == io::ErrorKind::Interrupted => {
                Ok(None)
            }
            Err(error) if error.raw_os_error() == Some(libc::EIDRM) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Answers a request for data to the host with these bytes. If the host has cancelled the request, the kernel
    /// discards the answer.
    pub fn answer(&self, bytes: &[u8]) {
        let _ = (&self.0).write(bytes);
    }

    /// Reads the data of a request with data to the device into `bytes`, which also acknowledges the request. Returns
    /// the number of bytes; `None` if the host has cancelled the request.
    pub fn take(&self, bytes: &mut [u8]) -> Option<usize> {
        (&self.0).read(bytes).ok()
    }

    /// Acknowledges a request to the device that has no data, by a read of no bytes. Has no effect if the host has
    /// cancelled the request.
    pub fn acknowledge(&self) {
        let _ = (&self.0).read(&mut []);
    }

    /// Stalls a request. The kernel does so when a transfer in the opposite direction is started.
    pub fn stall(&self, to_host: bool) {
        // The result is ignored, because a transfer in the wrong direction always fails.
        let _ = if to_host { (&self.0).read(&mut []) } else { (&self.0).write(&[]) };
    }
}

impl AsFd for ControlEndpoint {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// A function with an interrupt endpoint in each direction. When this value is dropped its mount is removed.
#[derive(Debug)]
pub struct Function {
    _mount: Mount,
}

impl Function {
    /// Removes the mount `name` below `mounts`, if it exists. The caller makes sure, by a [`Claim`](super::Claim), that
    /// the process that has made it has ended.
    pub fn remove_leftover(mounts: &Path, name: &str) {
        release(&mounts.join(name));
    }

    /// Mounts the function `name` of a gadget that is not bound yet, and gives it its descriptors: an interface with an
    /// IN endpoint, followed by an OUT endpoint. Returns it with its endpoint 0 and its transfers.
    ///
    /// # Errors
    /// Errors of the kernel.
    pub fn open(mounts: &Path, name: &str, descriptors: &[u8]) -> io::Result<(Self, ControlEndpoint, Transfers)> {
        let mount = Mount::new(mounts, name)?;
        let control = open(&mount.folder.join("ep0"))?;
        for part in [wire::descriptors(descriptors), wire::strings()] {
            if (&control).write(&part)? != part.len() {
                return Err(io::ErrorKind::WriteZero.into());
            }
        }
        // The kernel numbers the files of the endpoints in the order of their descriptors: first the IN endpoint, then
        // the OUT endpoint.
        let [input, output] = ["ep1", "ep2"].map(|file| open(&mount.folder.join(file)).map(OwnedFd::from));
        let transfers = Transfers::new(input?, output?)?;
        Ok((Self { _mount: mount }, ControlEndpoint(control), transfers))
    }
}

/// Opens the file of an endpoint. While no host has selected the configuration, the endpoint is off: its transfers then
/// fail at once instead of waiting.
fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).custom_flags(libc::O_NONBLOCK).open(path)
}
