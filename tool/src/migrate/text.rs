//! The result of `ecmsk migrate` as text.

use std::fmt::Write as _;

use ecmsk::fieldbus::xf::XfBusOptions;
use ecmsk::migrate::{
    Ahead, HostTiming, IDLE_NS, INT0_IDLE_NS, Item, Migration, Needs, Packets, Place, Plan, Refused, Row, SeenBy,
    Start, Verdict,
};
use ecmsk::recording::Clock;
use ecmsk::sk::FIFO_ENTRIES;
use ecmsk::xf::DataSize;

use super::Report;
use crate::output::counted;

/// The document with the table of differences between the board and an ECM-XF.
const PAGE: &str = "docs/MIGRATION.md";

/// The result of `ecmsk migrate` as text.
pub fn of(report: &Report) -> String {
    // Writing to a String does not fail, so its results are ignored.
    let mut text = String::new();
    head(&mut text, report);
    items(&mut text, report);
    rows(&mut text, report);
    if let Some(plan) = &report.found.plan {
        start(&mut text, report, plan);
        host(&mut text, report, &plan.ahead);
        chip(&mut text, &plan.needs);
        links(&mut text, report, plan);
    } else {
        text.push_str(
            "\nno slave is declared (SET_AXIS) that comes to SafeOP: what a chip needs for it is not known\n",
        );
    }
    if let Some(plot) = report.plot {
        let _ = writeln!(text, "\npicture: {}", plot.display());
    }
    text
}

fn head(text: &mut String, report: &Report) {
    let found = report.found;
    let link = report.link.as_ref().map_or_else(|| "a capture".to_owned(), |link| format!("recorded on {link}"));
    let Migration { commands, polls, reports, .. } = *found;
    let (file, at) = (report.file.display(), seconds(found.last_ns));
    let _ = writeln!(text, "{file}: {link}, {commands} commands, {polls} polls, {reports} reports, {at}");
    if report.is_behind_chip {
        let _ =
            writeln!(text, "recorded with the slaves behind a chip already: what differs is told as against a board");
    }
    let whole = if report.lacks.is_some() || found.op.is_none() { ", as far as the recording goes" } else { "" };
    let _ = writeln!(
        text,
        "{}{whole}",
        match report.runs() {
            "yes" => "runs on an ECM-XF as it is",
            "differs" => "runs on an ECM-XF, with differences",
            _ => "does not run on an ECM-XF as it is",
        }
    );
}

fn items(text: &mut String, report: &Report) {
    let names: Vec<String> = report.found.items.iter().map(|item| item.count.subject.to_string()).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max("what it uses".len());
    let _ = writeln!(text, "\n{:width$}  {:>7}  {:>10}  {:>7}  runs", "what it uses", "times", "first at", "frame");
    for (name, Item { count, verdict }) in names.iter().zip(&report.found.items) {
        let Place { frame, at_ns } = count.first;
        let (times, at, runs) = (count.times, seconds(at_ns), verdict.word());
        let _ = write!(text, "{name:width$}  {times:>7}  {at:>10}  {frame:>7}  {runs}");
        if let Some(row) = verdict.row() {
            let _ = write!(text, " ({row})");
        }
        if let Some(first) = count.first_exposed.filter(|first| *first != count.first && *verdict != Verdict::Yes) {
            let _ = write!(text, ", {} of them, first at {} ({})", count.exposed, seconds(first.at_ns), first.frame);
        }
        text.push('\n');
    }
}

fn rows(text: &mut String, report: &Report) {
    let rows = report.found.rows();
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(text, "\nwhat differs ({PAGE} has the figures, the reasons and the tests)");
    for row in &rows {
        let _ = writeln!(text, "{:8} {}", row.id(), row.meaning());
    }
    let mut said = Vec::new();
    for verdict in report.found.verdicts() {
        if let Verdict::No { row, reason, next } = verdict
            && !said.contains(&(row, reason))
        {
            let _ = writeln!(text, "no: {reason}\n    do: {next}");
            said.push((row, reason));
        }
    }
}

fn start(text: &mut String, report: &Report, plan: &Plan) {
    let Start { recorded, chip_ns, timeout_ms } = plan.start;
    let _ = writeln!(text, "\nthe way to OP");
    let recorded = recorded.map_or_else(
        || "no SET_STATE that led there".to_owned(),
        |(ns, ended)| format!("{} until {}", seconds(ns), place(ended)),
    );
    line(text, if report.is_behind_chip { "recorded" } else { "board" }, &recorded);
    let (slaves, took) = (counted(plan.network.length(), "slave"), seconds(chip_ns));
    let fails = "a program that gives up after less than that fails";
    line(text, "chip", &format!("about {took} for {slaves}: {fails} ({})", Row::Start));
    if let Some(ms) = timeout_ms {
        line(text, "", &format!("SET_STATE itself gives up after 10 s, unless state_timeout_ms={ms} is in the link"));
    }
}

fn host(text: &mut String, report: &Report, ahead: &Ahead) {
    let timing = &report.found.timing;
    let _ = writeln!(text, "\nthe PC in OP");
    if report.found.op.is_none() {
        line(text, "stalls", "not known: the recording never reaches OP");
    } else {
        let sets = |per_cent| timing.levels.percentile(per_cent).unwrap_or(0);
        line(
            text,
            "FIFO",
            &format!("median {}, 99 % {}, most {} of {FIFO_ENTRIES} sets wait", sets(50), sets(99), sets(100)),
        );
        if timing.gaps > 0 {
            let (ns, ended) = timing.longest_gap.unwrap_or_default();
            let gaps = counted(timing.gaps, "gap");
            let repeated = counted(timing.repeated_cycles, "cycle");
            let what = format!("{repeated} in {gaps} of a motion, the longest {} until {}", ms(ns), place(ended));
            line(text, "repeated", &format!("{what}: the FIFO was empty with an axis on its way"));
        }
        match (report.clock, ahead.is_known) {
            (Clock::Virtual, _) => {
                line(text, "stalls", "not known: in virtual time no PC is late; record on its own PC and clock")
            }
            (Clock::Real, false) => line(text, "stalls", "not known: too few frames in OP"),
            (Clock::Real, true) => stalls(text, report, timing, ahead),
        }
    }
    let stall = counted(ahead.stall_cycles, "cycle");
    let no_more = if ahead.stall_cycles > ahead.value { ", and no more fit" } else { "" };
    let row = ahead.verdict.row().map_or_else(String::new, |row| format!(": {} ({row})", ahead.verdict.word()));
    let least = XfBusOptions::DEFAULT.ahead;
    line(text, &format!("ahead={}", ahead.value), &format!("for a stall of {stall}, {least} at least{no_more}{row}"));
    let bridged = counted(ahead.value, "cycle");
    let lie = counted(ahead.value + ahead.transport_sets, "set");
    line(
        text,
        "",
        &format!(
            "the process that runs the board's model may stand still for {bridged}: {lie} lie in the chip or on the way there"
        ),
    );
    line(
        text,
        "",
        &format!(
            "the {FIFO_ENTRIES} entries of the FIFO keep their meaning for the program; they lie in that process and bridge none of its stalls"
        ),
    );
}

fn stalls(text: &mut String, report: &Report, timing: &HostTiming, ahead: &Ahead) {
    let [median, most] = [50, 99].map(|per_cent| timing.pauses.percentile(per_cent).unwrap_or(0));
    let longest = timing.longest_pause.map(|(ns, ended)| format!(", the longest {} until {}", ms(ns), place(ended)));
    let longest = longest.unwrap_or_else(|| ", none while targets waited".to_owned());
    line(text, "writes", &format!("a burst each {} (median), 99 % {}{longest}", ms(median), ms(most)));
    if let (Some(ns), Some(ended)) = (timing.silences.longest_ns(), timing.silences.longest_at()) {
        let [median, most] = [50, 99].map(|per_cent| timing.silences.percentile(per_cent).unwrap_or(0));
        let longest = format!("the longest {} until {}", ms(ns), place(ended));
        line(
            text,
            "silence",
            &format!("median {}, 99 % {}, {longest}: no frame passed while sets waited", ms(median), ms(most)),
        );
    }
    match ahead.stall {
        None => line(text, "stalls", "none seen"),
        Some(stall) => {
            let (whole, usual) = (ms(stall.whole_ns), ms(stall.usual_ns));
            let by = match stall.seen_by {
                SeenBy::Silence => format!("no frame passed either way for {whole}, less the cycle of a report"),
                SeenBy::LateWrite => format!("a pause of writes of {whole} in a motion, less the usual one of {usual}"),
            };
            let cycles = counted(ahead.stall_cycles, "cycle");
            line(text, "stall", &format!("{} = {cycles} until {}: {by}", ms(stall.ns), place(stall.ended)));
            if stall.is_limited() {
                let sets = counted(stall.sets, "set");
                let stop = "for longer than these last the axes stop on a board, too";
                line(text, "", &format!("{sets} waited when it began, and no more cycles of it count: {stop}"));
            }
        }
    }
    let limits = match report.link {
        Some(_) => {
            "from the time stamps of the program's frames: a pause that the program makes itself counts, too, so that it may be less"
        }
        None => "from the time stamps of a capture, where the kernel takes reports for the program: it may be more",
    };
    line(text, "", limits);
}

fn chip(text: &mut String, needs: &Needs) {
    let _ = writeln!(text, "\nthe chip");
    let least = needs
        .least_size()
        .map_or_else(|| "no packet holds them".to_owned(), |size| format!("n={} at least", size.bytes()));
    let [manual, newer, usb] = [DataSize::MANUAL, DataSize::NEWER, DataSize::XFU].map(DataSize::bytes);
    line(
        text,
        "data",
        &format!(
            "{} bytes out and {} in: {least} (chips start with {manual} or {newer}, use_n= sets it; an ECM-XFU has {usb})",
            needs.output_bytes, needs.input_bytes,
        ),
    );
    for (name, packets, idle_ns) in
        [("INT0", &needs.with_int0, INT0_IDLE_NS), ("no INT0", &needs.without_int0, IDLE_NS)]
    {
        let held = match packets {
            Ok(packets) => held(packets, needs.cycle.us()),
            Err(refused) => not_held(refused),
        };
        line(text, name, &format!("{held} ({} us behind each packet)", idle_ns / 1000));
    }
    line(
        text,
        "FIFOs",
        &format!("{} entries in their memory: ahead= can be {} at most", needs.entries, needs.ahead_max),
    );
}

fn held(packets: &Packets, cycle_us: u32) -> String {
    let sets = counted(packets.sets, "set");
    let (n, least) = (packets.size.bytes(), clock(packets.least_clock_hz));
    let two = if packets.in_flight > 1 { ", two under way" } else { "" };
    format!("n={n} ({sets}{two}) holds {cycle_us} us; the least clock that does: {least}")
}

fn not_held(refused: &Refused) -> String {
    let next =
        refused.next_cycle.map_or_else(|| "no cycle holds".to_owned(), |cycle| format!("{} us hold", cycle.us()));
    format!("{}; {next}", refused.reason())
}

fn links(text: &mut String, report: &Report, plan: &Plan) {
    let (machine, model, file) = (&plan.links.machine, &plan.links.model, report.file.display());
    let _ = writeln!(text, "\necmsk.toml, with INT0 at the line that it is wired to");
    let _ = writeln!(text, "  link = \"{machine}\"");
    let _ = writeln!(text, "this recording played to the model of a chip");
    let _ = writeln!(text, "  ecmsk replay {file} --link '{model}'");
    let _ = writeln!(text, "the program itself on that model, and held against this recording");
    let _ = writeln!(text, "  ecmsk exec --link '{model}' --record model.pcapng -- PROGRAM");
    let _ = writeln!(text, "  ecmsk compare {file} model.pcapng --ignore-repeats");
    if plan.needs.with_int0.is_err() {
        let _ = writeln!(text, "  (not before the cycle holds: {})", Row::Cycle);
    }
}

fn line(text: &mut String, name: &str, what: &str) {
    let _ = writeln!(text, "{name:8} {what}");
}

fn place(place: Place) -> String {
    format!("{} ({})", seconds(place.at_ns), place.frame)
}

fn seconds(ns: i64) -> String {
    let (sign, us) = (if ns < 0 { "-" } else { "" }, (ns.unsigned_abs() + 500) / 1000);
    format!("{sign}{}.{:03} s", us / 1_000_000, us % 1_000_000 / 1000)
}

fn ms(ns: i64) -> String {
    let us = (ns.unsigned_abs() + 500) / 1000;
    format!("{}.{:02} ms", us / 1000, us % 1000 / 10)
}

fn clock(hz: u32) -> String {
    format!("{}.{:02} MHz", hz / 1_000_000, hz % 1_000_000 / 10_000)
}
