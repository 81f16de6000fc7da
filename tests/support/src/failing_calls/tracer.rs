//! Tracing a program and its threads by ptrace(2), on x86-64.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;
use std::{fs, mem, ptr, thread};

use libc::{c_int, c_void, pid_t};

use super::table::{self, Of};
use super::{Blow, Call, Dealt, Struck, Watched, Whose};
use crate::Ended;

/// A stop at a system call, as `PTRACE_O_TRACESYSGOOD` marks it.
const AT_CALL: c_int = libc::SIGTRAP | 0x80;
const OPTIONS: c_int = libc::PTRACE_O_TRACESYSGOOD
    | libc::PTRACE_O_TRACECLONE
    | libc::PTRACE_O_TRACEFORK
    | libc::PTRACE_O_TRACEVFORK
    | libc::PTRACE_O_TRACEEXEC
    | libc::PTRACE_O_EXITKILL;

/// Runs a program to its end, with that failure if there is one. If it takes longer than `limit` it is killed, with all
/// processes that it has started.
///
/// # Panics
/// It cannot be started or traced.
#[allow(clippy::zombie_processes, reason = "the tracer waits for it")]
pub fn run(
    command: &mut Command,
    whose: Whose,
    blow: Option<Blow>,
    limit: Duration,
    watched: Option<&Watched>,
) -> Struck {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
    // SAFETY: ptrace is a plain system call, which may be called between fork and exec.
    unsafe {
        command.pre_exec(|| match libc::ptrace(libc::PTRACE_TRACEME, 0, ptr::null_mut::<c_void>(), 0) {
            -1 => Err(io::Error::last_os_error()),
            _ => Ok(()),
        });
    }
    let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let root = pid_t::try_from(child.id()).expect("a process id");
    if let Some(watched) = watched {
        *watched.id.lock().expect("no panic") = Some(root);
    }
    let (mut stdout, mut stderr) = (child.stdout.take().expect("piped"), child.stderr.take().expect("piped"));
    let hung = OnceLock::new();
    let noted = &hung;
    let (done, is_done) = mpsc::channel::<()>();
    let mut struck = thread::scope(|scope| {
        scope.spawn(move || {
            if is_done.recv_timeout(limit) == Err(RecvTimeoutError::Timeout) {
                noted.get_or_init(|| threads(root));
                kill_group(root);
            }
        });
        let said = scope.spawn(move || drain(&mut stdout, watched));
        let complained = scope.spawn(move || drain(&mut stderr, None));
        let mut tracer = Tracer { root, whose, blow, tasks: BTreeMap::new(), calls: Vec::new(), dealt: None };
        let status = tracer.run();
        let ended =
            Ended { status, stdout: said.join().expect("no panic"), stderr: complained.join().expect("no panic") };
        drop(done);
        Struck { ended, calls: tracer.calls, dealt: tracer.dealt, hung: None }
    });
    struck.hung = hung.into_inner();
    struck
}

/// What the threads of a process are doing: name, state, and the number of the system call with its arguments.
fn threads(process: pid_t) -> String {
    let tasks = fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let file = |folder: &Path, name: &str| fs::read_to_string(folder.join(name)).unwrap_or_default().trim().to_owned();
    let thread = |folder: PathBuf| {
        let status = file(&folder, "status");
        let state = status.lines().find(|line| line.starts_with("State:")).unwrap_or_default();
        format!("{}: {state}, call {}", file(&folder, "comm"), file(&folder, "syscall"))
    };
    tasks.map(|entry| thread(entry.path())).collect::<Vec<_>>().join("\n")
}

fn kill_group(leader: pid_t) {
    // SAFETY: no memory is passed. The group has the program and what it has started; if there is none left nothing happens.
    unsafe { libc::kill(-leader, libc::SIGKILL) };
}

fn drain(from: &mut impl Read, watched: Option<&Watched>) -> String {
    let mut all = String::new();
    let mut bytes = [0; 4096];
    loop {
        let len = match from.read(&mut bytes) {
            Ok(0) => return all,
            Ok(len) => len,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => panic!("a pipe of the program: {error}"),
        };
        let text = String::from_utf8_lossy(&bytes[..len]);
        all.push_str(&text);
        if let Some(watched) = watched {
            watched.stdout.lock().expect("no panic").push_str(&text);
        }
    }
}

/// A thread of a traced process.
struct Task {
    /// The thread's process.
    process: pid_t,
    /// How many programs were started on the way to this one: 0 is the first one.
    generation: u32,
    /// The change to make at the end of its present call.
    at_end: Option<AtEnd>,
}

/// A change at the end of a call.
#[derive(Clone, Copy)]
enum AtEnd {
    /// The result becomes that error.
    Fail(i32),
    /// The original first argument is restored in its register.
    Restore(u64),
}

struct Tracer {
    root: pid_t,
    whose: Whose,
    blow: Option<Blow>,
    tasks: BTreeMap<pid_t, Task>,
    calls: Vec<Call>,
    dealt: Option<Dealt>,
}

impl Tracer {
    fn run(&mut self) -> ExitStatus {
        let mut ended = None;
        loop {
            let mut status = 0;
            // SAFETY: `status` is written to. Only children of this thread, and what they have started, are waited for.
            let task = unsafe { libc::waitpid(-1, &raw mut status, libc::__WALL | libc::__WNOTHREAD) };
            if task == -1 {
                let error = io::Error::last_os_error();
                match error.raw_os_error() {
                    Some(libc::EINTR) => continue,
                    Some(libc::ECHILD) => return ended.expect("the program has ended"),
                    _ => panic!("waitpid: {error}"),
                }
            }
            if libc::WIFSTOPPED(status) {
                self.stopped(task, status);
            } else {
                self.tasks.remove(&task);
                if task == self.root {
                    ended = Some(ExitStatus::from_raw(status));
                }
            }
        }
    }

    fn stopped(&mut self, id: pid_t, status: c_int) {
        let (signal, event) = (libc::WSTOPSIG(status), status >> 16);
        let is_new = !self.tasks.contains_key(&id);
        if is_new {
            let process = field_of_status(id, "Tgid:").unwrap_or(id);
            let relative = if process == id { field_of_status(id, "PPid:") } else { Some(process) };
            let before = relative.and_then(|process| self.tasks.values().find(|task| task.process == process));
            let generation = before.map_or(0, |task| task.generation);
            self.tasks.insert(id, Task { process, generation, at_end: None });
            if id == self.root {
                // SAFETY: the task is stopped; options are a number.
                unsafe { libc::ptrace(libc::PTRACE_SETOPTIONS, id, ptr::null_mut::<c_void>(), OPTIONS) };
                return self.go_on(id, 0);
            }
        }
        match (signal, event) {
            (AT_CALL, _) => {
                self.at_call(id);
                self.go_on(id, 0);
            }
            (_, libc::PTRACE_EVENT_EXEC) => {
                let task = self.tasks.get_mut(&id).expect("it is known");
                task.generation += 1;
                let is_of_interest = self.whose == Whose::ItsPrograms && task.generation == 1;
                if is_of_interest {
                    self.go_on(id, 0);
                } else {
                    // SAFETY: the task is stopped.
                    unsafe { libc::ptrace(libc::PTRACE_DETACH, id, ptr::null_mut::<c_void>(), 0) };
                    self.tasks.remove(&id);
                }
            }
            (libc::SIGTRAP, 1..) => self.go_on(id, 0),
            // A traced thread or process begins with this signal; nothing else sends it.
            (libc::SIGSTOP, _) => self.go_on(id, 0),
            (signal, _) => self.go_on(id, signal),
        }
    }

    /// Continues a task. It may have ended by now: an error has no effect.
    fn go_on(&self, id: pid_t, signal: c_int) {
        // After the failure each task still has to finish its present call.
        let owes = self.tasks.get(&id).is_some_and(|task| task.at_end.is_some());
        let request = if self.dealt.is_none() || owes { libc::PTRACE_SYSCALL } else { libc::PTRACE_CONT };
        // SAFETY: the task is stopped; the signal is a number.
        unsafe { libc::ptrace(request, id, ptr::null_mut::<c_void>(), libc::c_long::from(signal)) };
    }

    fn at_call(&mut self, id: pid_t) {
        let Some(info) = info(id) else { return };
        if info.op == libc::PTRACE_SYSCALL_INFO_EXIT {
            if let Some(at_end) = self.tasks.get_mut(&id).and_then(|task| task.at_end.take()) {
                change_registers(id, |registers| match at_end {
                    AtEnd::Fail(errno) => registers.rax = i64::from(-errno).cast_unsigned(),
                    AtEnd::Restore(argument) => registers.rdi = argument,
                });
            }
            return;
        }
        if info.op != libc::PTRACE_SYSCALL_INFO_ENTRY || self.dealt.is_some() {
            return;
        }
        // SAFETY: at the entry of a call this is the member that is set.
        let entry = unsafe { info.u.entry };
        let Some(task) = self.tasks.get_mut(&id) else { return };
        let counts = match self.whose {
            Whose::Program => task.generation == 0,
            Whose::ItsPrograms => task.generation == 1,
        };
        let number = entry.nr.cast_signed();
        let argument = entry.args[0];
        let of = if table::is_of_descriptor(number) { kind_of(task.process, argument) } else { Of::Nothing };
        let Some((name, errors)) = table::errors(number, entry.args, of).filter(|_| counts) else { return };
        let call = Call { name, of, errors };
        self.calls.push(call);
        let Some(blow) = self.blow.filter(|blow| self.calls.len() > blow.call) else { return };
        let errno = errors.get(blow.error).copied();
        let is_loading = is_loader(task.process, info.instruction_pointer);
        self.dealt = Some(Dealt { call, argument, errno, is_loading });
        match errno {
            None => {
                // SAFETY: no memory is passed; the process is traced, so it has not been waited for.
                unsafe { libc::kill(task.process, libc::SIGKILL) };
            }
            Some(_) if table::fails_by_doing_nothing(number) => {
                task.at_end = Some(AtEnd::Restore(argument));
                change_registers(id, |registers| registers.rdi = 0);
            }
            Some(errno) => {
                task.at_end = Some(AtEnd::Fail(errno));
                if !table::is_done_all_the_same(number, errno) {
                    // No call has this number: the system does nothing.
                    change_registers(id, |registers| registers.orig_rax = u64::MAX);
                }
            }
        }
    }
}

fn info(id: pid_t) -> Option<libc::ptrace_syscall_info> {
    // SAFETY: all bits zero are a value of this structure of numbers.
    let mut info: libc::ptrace_syscall_info = unsafe { mem::zeroed() };
    let size = mem::size_of_val(&info);
    // SAFETY: the system writes at most `size` bytes to `info`.
    let got = unsafe { libc::ptrace(libc::PTRACE_GET_SYSCALL_INFO, id, size, &raw mut info) };
    (got > 0).then_some(info)
}

fn change_registers(id: pid_t, change: impl FnOnce(&mut libc::user_regs_struct)) {
    // SAFETY: all bits zero are a value of this structure of numbers.
    let mut registers: libc::user_regs_struct = unsafe { mem::zeroed() };
    // SAFETY: the system writes to and reads from `registers`, which has the size that it has for it.
    unsafe {
        if libc::ptrace(libc::PTRACE_GETREGS, id, ptr::null_mut::<c_void>(), &raw mut registers) == 0 {
            change(&mut registers);
            libc::ptrace(libc::PTRACE_SETREGS, id, ptr::null_mut::<c_void>(), &raw mut registers);
        }
    }
}

/// Whether the code at that address belongs to the dynamic loader.
fn is_loader(process: pid_t, address: u64) -> bool {
    let maps = fs::read_to_string(format!("/proc/{process}/maps")).unwrap_or_default();
    let has = |range: &str| {
        let (from, to) = range.split_once('-')?;
        let [from, to] = [from, to].map(|number| u64::from_str_radix(number, 16).ok());
        Some((from?..to?).contains(&address))
    };
    let of_address = maps.lines().find(|line| line.split(' ').next().and_then(has) == Some(true));
    of_address.is_some_and(|line| line.contains("/ld-linux"))
}

fn kind_of(process: pid_t, descriptor: u64) -> Of {
    let link = fs::read_link(format!("/proc/{process}/fd/{}", descriptor as u32)).unwrap_or_default();
    let link = link.to_string_lossy();
    match &*link {
        socket if socket.starts_with("socket:") => {
            let number = socket.trim_start_matches("socket:[").trim_end_matches(']');
            let local = fs::read_to_string(format!("/proc/{process}/net/unix")).unwrap_or_default();
            let is_local = local.lines().any(|line| line.split_whitespace().nth(6) == Some(number));
            if is_local { Of::LocalSocket } else { Of::Socket }
        }
        pipe if pipe.starts_with("pipe:") => Of::Pipe,
        event if event.starts_with("anon_inode:") => Of::Event,
        path if fs::metadata(path).is_ok_and(|there| there.is_dir()) => Of::Folder,
        _ => Of::File,
    }
}

/// A number in `/proc/ID/status`.
fn field_of_status(id: pid_t, name: &str) -> Option<pid_t> {
    let status = fs::read_to_string(format!("/proc/{id}/status")).ok()?;
    status.lines().find_map(|line| line.strip_prefix(name)?.trim().parse().ok())
}
