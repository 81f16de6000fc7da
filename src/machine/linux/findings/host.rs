//! Judges whether the machine can keep cycles: limits for real time, frequency governors.

use super::{Finding, Machine};
use crate::machine::limits::Limit;

/// \[OURS] The file that users are advised to write their limits to.
const LIMITS: &str = "/etc/security/limits.d/90-ecmsk.conf";

impl Machine {
    pub(super) fn host_findings(&self) -> Vec<Finding> {
        let limits = self.limits();
        vec![priority(limits.realtime_priority), memory(limits.locked_memory), governor(&self.governors())]
    }
}

fn limit_for_users(what: &str) -> String {
    format!("echo \"$USER - {what}\" | sudo tee -a {LIMITS}, then log in again")
}

fn priority(limit: Option<Limit>) -> Finding {
    const CHECK: &str = "realtime-priority";
    match limit {
        Some(Limit::Capability) => Finding::fine(CHECK, "allowed (CAP_SYS_NICE)"),
        Some(Limit::Unlimited) => Finding::fine(CHECK, "allowed without limit"),
        Some(Limit::Value(0)) => {
            let found = "not allowed: a busy machine makes cycles late";
            Finding::advice(CHECK, found, limit_for_users("rtprio 90")).figure("highest", 0)
        }
        Some(Limit::Value(highest)) => Finding::fine(CHECK, format!("allowed up to {highest}"))
            .figure("highest", i64::try_from(highest).unwrap_or(i64::MAX)),
        None => Finding::fine(CHECK, "not known: the kernel does not say"),
    }
}

fn memory(limit: Option<Limit>) -> Finding {
    const CHECK: &str = "locked-memory";
    match limit {
        Some(Limit::Capability) => Finding::fine(CHECK, "allowed (CAP_IPC_LOCK)"),
        Some(Limit::Unlimited) => Finding::fine(CHECK, "allowed without limit"),
        Some(Limit::Value(bytes)) => {
            let found = format!("{} KiB: the whole program does not fit, and lock_memory=on is refused", bytes / 1024);
            Finding::advice(CHECK, found, limit_for_users("memlock unlimited"))
                .figure("limit_bytes", i64::try_from(bytes).unwrap_or(i64::MAX))
        }
        None => Finding::fine(CHECK, "not known: the kernel does not say"),
    }
}

fn governor(governors: &[String]) -> Finding {
    const CHECK: &str = "governor";
    match governors {
        [] => Finding::fine(CHECK, "the machine shows none"),
        [one] if one == "performance" => Finding::fine(CHECK, "performance"),
        _ => Finding::advice(
            CHECK,
            format!("{}: processors that slow down wake up late", governors.join(", ")),
            "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        ),
    }
}
