//! The limits of this process that matter for real time: real-time priority, locked memory, and the processors' frequency
//! governors.

use super::Machine;

// Numbers of the capabilities that override the limits (capabilities(7)).
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

/// A resource limit of this process (getrlimit(2), soft limit).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// A capability of the process overrides the limit.
    Capability,
    /// There is no limit.
    Unlimited,
    /// The value of the limit, in the unit of the limit: a priority, or bytes.
    Value(u64),
}

/// Limits of this process; `None` where the kernel does not report one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limits {
    /// RLIMIT_RTPRIO: the highest real-time priority.
    pub realtime_priority: Option<Limit>,
    /// RLIMIT_MEMLOCK: how many bytes may be locked in memory.
    pub locked_memory: Option<Limit>,
}

impl Machine {
    /// Reads the limits of this process for real-time priority and locked memory.
    pub fn limits(&self) -> Limits {
        let limits = self.text("/proc/self/limits").unwrap_or_default();
        let capabilities = self.capabilities();
        let limit = |name: &str, capability: u32| {
            if capabilities >> capability & 1 == 1 {
                return Some(Limit::Capability);
            }
            let soft = limits.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?;
            if soft == "unlimited" { Some(Limit::Unlimited) } else { soft.parse().ok().map(Limit::Value) }
        };
        Limits {
            realtime_priority: limit("Max realtime priority", CAP_SYS_NICE),
            locked_memory: limit("Max locked memory", CAP_IPC_LOCK),
        }
    }

    /// The effective capabilities of this process as a mask; 0 if the kernel does not report them.
    pub(super) fn capabilities(&self) -> u64 {
        let status = self.text("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
        mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
    }

    /// The frequency governors of the processors, each once; empty if the kernel has none.
    pub fn governors(&self) -> Vec<String> {
        const CPUS: &str = "/sys/devices/system/cpu";
        let names = self.names(CPUS);
        let governors =
            names.iter().filter_map(|cpu| self.attribute(&format!("{CPUS}/{cpu}/cpufreq/scaling_governor")));
        let mut governors: Vec<String> = governors.collect();
        governors.sort();
        governors.dedup();
        governors
    }

    /// The kernel's release, such as `6.1.0-18-amd64`.
    pub fn kernel(&self) -> Option<String> {
        self.attribute("/proc/sys/kernel/osrelease")
    }
}
