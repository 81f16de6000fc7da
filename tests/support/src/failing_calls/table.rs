//! Which errors each system call may give, by the kind of its descriptor. Calls that cannot fail, or only by a defect
//! of the caller, are not in the table.

use libc::{
    EACCES, EAGAIN, ECONNABORTED, ECONNREFUSED, ECONNRESET, EDQUOT, EINTR, EINVAL, EIO, EMFILE, ENETDOWN, ENETUNREACH,
    ENFILE, ENOBUFS, ENODEV, ENOENT, ENOLCK, ENOMEM, ENOPROTOOPT, ENOSPC, ENOSYS, ENXIO, EPERM, EPIPE, ETIMEDOUT,
};

/// The kind of a file descriptor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Of {
    /// The call takes no descriptor.
    Nothing,
    File,
    Folder,
    Pipe,
    Socket,
    /// A pair of sockets within a process, or between processes of this machine.
    LocalSocket,
    /// An eventfd, a timerfd, an epoll.
    Event,
}

const MEMORY: &[i32] = &[ENOMEM];
const DESCRIPTORS: &[i32] = &[EMFILE, ENFILE, ENOMEM];
const INTERRUPTED: &[i32] = &[EINTR];
const PATH: &[i32] = &[EACCES, EIO, ENOMEM, ENOENT];
const CHANGES_FOLDER: &[i32] = &[ENOSPC, EIO, EACCES, EPERM];

/// Names and numbers of the calls that may fail.
macro_rules! calls {
    ($($name:ident $errors:expr;)*) => {
        /// The name of a call and the errors that it may give for such a descriptor; `None`: the table has no such
        /// call.
        pub fn errors(number: i64, arguments: [u64; 6], of: Of) -> Option<(&'static str, &'static [i32])> {
            let found: (&'static str, fn([u64; 6], Of) -> &'static [i32]) = match number {
                $(libc::$name => (stringify!($name), $errors),)*
                _ => return None,
            };
            let (name, errors) = found;
            let errors = errors(arguments, of);
            (!errors.is_empty()).then(|| (name.trim_start_matches("SYS_"), errors))
        }
    };
}

calls! {
    SYS_open |_, _| &[EACCES, EMFILE, ENFILE, ENOMEM, EIO, EINTR];
    SYS_openat |_, _| &[EACCES, EMFILE, ENFILE, ENOMEM, EIO, EINTR];
    SYS_read |_, of| reads(of);
    SYS_pread64 |_, of| reads(of);
    SYS_readv |_, of| reads(of);
    SYS_recvfrom |_, of| reads(of);
    SYS_recvmsg |_, of| reads(of);
    SYS_write |arguments, of| writes(arguments, of);
    SYS_pwrite64 |arguments, of| writes(arguments, of);
    SYS_writev |arguments, of| writes(arguments, of);
    SYS_sendto |arguments, of| writes(arguments, of);
    SYS_sendmsg |arguments, of| writes(arguments, of);
    SYS_close |_, of| if of == Of::Folder { INTERRUPTED } else { &[EIO, EINTR] };
    SYS_lseek |_, _| &[EIO];
    SYS_ftruncate |_, _| &[EIO, EINTR];
    SYS_fsync |_, _| &[EIO, ENOSPC];
    SYS_fdatasync |_, _| &[EIO, ENOSPC];
    SYS_sync_file_range |_, _| &[EIO, ENOSPC, ENOSYS];
    SYS_fstat |_, _| &[EIO, ENOMEM];
    SYS_newfstatat |_, _| PATH;
    SYS_stat |_, _| PATH;
    SYS_lstat |_, _| PATH;
    SYS_statx |_, _| &[EACCES, EIO, ENOMEM, ENOENT, ENOSYS];
    SYS_access |_, _| PATH;
    SYS_readlink |_, _| PATH;
    SYS_getcwd |_, _| &[EACCES, ENOENT, ENOMEM];
    SYS_getdents64 |_, _| &[EIO];
    SYS_mkdir |_, _| CHANGES_FOLDER;
    SYS_rmdir |_, _| CHANGES_FOLDER;
    SYS_unlink |_, _| CHANGES_FOLDER;
    SYS_unlinkat |_, _| CHANGES_FOLDER;
    SYS_rename |_, _| CHANGES_FOLDER;
    SYS_symlink |_, _| CHANGES_FOLDER;
    SYS_flock |_, _| &[EINTR, ENOLCK, EAGAIN];
    SYS_fcntl |arguments, _| if duplicates(arguments) { &[EMFILE] } else { &[] };
    SYS_dup |_, _| &[EMFILE];
    SYS_ioctl |_, of| if of == Of::Socket { &[ENODEV, ENETDOWN, EPERM] } else { &[EIO, EINTR] };
    SYS_pipe2 |_, _| &[EMFILE, ENFILE];
    SYS_eventfd2 |_, _| DESCRIPTORS;
    SYS_timerfd_create |_, _| DESCRIPTORS;
    SYS_epoll_create1 |_, _| DESCRIPTORS;
    SYS_epoll_ctl |_, _| &[ENOMEM, ENOSPC];
    SYS_memfd_create |_, _| DESCRIPTORS;
    SYS_poll |_, _| &[EINTR, ENOMEM];
    SYS_ppoll |_, _| &[EINTR, ENOMEM];
    SYS_epoll_wait |_, _| INTERRUPTED;
    SYS_epoll_pwait |_, _| INTERRUPTED;
    SYS_select |_, _| &[EINTR, ENOMEM];
    SYS_socket |_, _| &[EMFILE, ENFILE, ENOBUFS, EACCES];
    SYS_socketpair |_, _| &[EMFILE, ENFILE, ENOMEM];
    SYS_connect |_, _| &[ECONNREFUSED, EINTR, ETIMEDOUT, ENETUNREACH];
    SYS_bind |_, _| &[EACCES, ENOMEM];
    SYS_listen |_, _| &[libc::EADDRINUSE];
    SYS_accept4 |_, _| &[EMFILE, ENFILE, ECONNABORTED, EINTR, EPERM, ENOMEM];
    SYS_setsockopt |_, _| &[ENOBUFS, ENOPROTOOPT, EPERM];
    SYS_getsockopt |_, _| &[ENOBUFS];
    SYS_getsockname |_, _| &[ENOBUFS];
    SYS_getpeername |_, _| &[ENOBUFS];
    SYS_shutdown |_, _| &[ENOBUFS];
    SYS_brk |_, _| MEMORY;
    SYS_mmap |_, _| MEMORY;
    SYS_mremap |_, _| MEMORY;
    SYS_munmap |_, _| MEMORY;
    SYS_mprotect |_, _| MEMORY;
    SYS_madvise |_, _| &[EAGAIN, ENOMEM];
    SYS_mlock |_, _| &[EPERM, ENOMEM];
    SYS_mlockall |_, _| &[EPERM, ENOMEM];
    SYS_clone |_, _| &[EAGAIN, ENOMEM];
    SYS_clone3 |_, _| &[EAGAIN, ENOMEM, ENOSYS];
    SYS_fork |_, _| &[EAGAIN, ENOMEM];
    SYS_vfork |_, _| &[EAGAIN, ENOMEM];
    SYS_execve |_, _| &[EACCES, EIO, ENOMEM];
    SYS_wait4 |_, _| INTERRUPTED;
    SYS_waitid |_, _| INTERRUPTED;
    SYS_pidfd_open |_, _| &[EMFILE, ENOMEM, ENOSYS];
    SYS_futex |arguments, _| if waits(arguments) { &[EINTR, EAGAIN] } else { &[] };
    SYS_clock_nanosleep |_, _| INTERRUPTED;
    SYS_nanosleep |_, _| INTERRUPTED;
    SYS_timerfd_settime |_, _| MEMORY;
    SYS_getrandom |_, _| &[EINTR, ENOSYS];
    SYS_sched_setscheduler |_, _| &[EPERM];
    SYS_sched_setattr |_, _| &[EPERM, ENOSYS];
    SYS_sched_setaffinity |_, _| &[EPERM];
    SYS_sched_getaffinity |_, _| &[EINVAL];
    SYS_prctl |_, _| &[EINVAL];
    SYS_prlimit64 |_, _| &[EPERM];
    SYS_sigaltstack |_, _| MEMORY;
}

fn reads(of: Of) -> &'static [i32] {
    match of {
        Of::Socket => &[EINTR, ECONNRESET, ETIMEDOUT, ENOMEM],
        Of::Event | Of::LocalSocket => INTERRUPTED,
        Of::Pipe | Of::File | Of::Folder | Of::Nothing => &[EINTR, EIO, ENOMEM],
    }
}

fn writes([descriptor, ..]: [u64; 6], of: Of) -> &'static [i32] {
    match of {
        // A pipe in the test may be a file or a terminal elsewhere.
        _ if descriptor == 1 || descriptor == 2 => &[EPIPE, ENOSPC, EIO, EINTR],
        Of::Socket => &[EPIPE, ECONNRESET, EINTR, ENOBUFS, ENXIO],
        Of::LocalSocket => &[ENOBUFS],
        Of::Pipe => &[EPIPE, EINTR],
        Of::Event => INTERRUPTED,
        Of::File | Of::Folder | Of::Nothing => &[ENOSPC, EIO, EDQUOT, EINTR],
    }
}

fn duplicates([_, command, ..]: [u64; 6]) -> bool {
    [libc::F_DUPFD, libc::F_DUPFD_CLOEXEC].iter().any(|&duplicate| command == duplicate as u64)
}

/// Whether a futex call waits: only a wait is interrupted, or finds another value.
fn waits([_, operation, ..]: [u64; 6]) -> bool {
    let operation = operation as i32 & libc::FUTEX_CMD_MASK;
    operation == libc::FUTEX_WAIT || operation == libc::FUTEX_WAIT_BITSET
}

/// Whether the first argument is a file descriptor that decides about the errors.
pub const fn is_of_descriptor(number: i64) -> bool {
    matches!(
        number,
        libc::SYS_close
            | libc::SYS_read
            | libc::SYS_pread64
            | libc::SYS_readv
            | libc::SYS_recvfrom
            | libc::SYS_recvmsg
            | libc::SYS_write
            | libc::SYS_pwrite64
            | libc::SYS_writev
            | libc::SYS_sendto
            | libc::SYS_sendmsg
            | libc::SYS_ioctl
    )
}

/// Whether a call reports failure by its unchanged result: `brk` returns the present end of the memory.
pub const fn fails_by_doing_nothing(number: i64) -> bool {
    number == libc::SYS_brk
}

/// Whether the system carries out the call although it gives this error: a descriptor is closed, or a connection is
/// made after the caller was interrupted.
pub const fn is_done_all_the_same(number: i64, errno: i32) -> bool {
    number == libc::SYS_close || (number == libc::SYS_connect && errno == EINTR)
}
