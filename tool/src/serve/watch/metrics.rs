//! The metrics of a server in the text format of Prometheus: names, units, help texts, and the values for a scrape.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use ecmsk::cia402::DriveState;
use ecmsk::engine::{Counters, LATENESS_BOUNDS_NS, Lateness, Reason};
use ecmsk::sk::{FIFO_ENTRIES, MasterState};
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, EncodeMetric, NoLabelSet, prometheus_text};
use prometheus_client::metrics::MetricType;
use prometheus_client::metrics::counter::ConstCounter;
use prometheus_client::metrics::gauge::ConstGauge;
use prometheus_client::registry::Registry;

use super::board::{CallCounts, Look};
use super::chip::ChipCounts;
use super::frames::{AxisShown, Shown, SlaveShown};

/// The `Content-Type` of the text without its charset, unlike [`prometheus_text::CONTENT_TYPE`], which includes the
/// charset.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4";

const AXIS_STATES: [DriveState; 8] = [
    DriveState::NotReadyToSwitchOn,
    DriveState::SwitchOnDisabled,
    DriveState::ReadyToSwitchOn,
    DriveState::SwitchedOn,
    DriveState::OperationEnabled,
    DriveState::QuickStopActive,
    DriveState::FaultReactionActive,
    DriveState::Fault,
];
const NETWORK_STATES: [MasterState; 4] = [MasterState::Init, MasterState::PreOp, MasterState::SafeOp, MasterState::Op];

/// The values for one scrape.
#[derive(Debug)]
pub struct Scrape {
    /// The verb of the server: `tcp`, `usbip` and so on.
    pub server: &'static str,
    /// The number of clients; `None` if the server does not count them.
    pub clients: Option<usize>,
    /// The boards, in the order of the command line.
    pub boards: Vec<Seen>,
    /// The counts of the chip, and whether it can be used; `None` if the server serves no chip.
    pub chip: Option<(ChipCounts, bool)>,
}

/// The values of one board for a scrape.
pub struct Seen {
    /// The number of the board on the command line, from 1.
    pub number: usize,
    /// The scheme of the board's link.
    pub scheme: &'static str,
    /// The result of the latest check of the board.
    pub look: Look,
    /// The values of the latest report.
    pub shown: Shown,
    /// The counts of the server's calls of the link.
    pub counts: CallCounts,
    /// The sizes of the board's recordings in bytes, by kind: `record` or `flight`.
    pub recorded: BTreeMap<&'static str, u64>,
}

impl fmt::Debug for Seen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Seen").field("number", &self.number).finish_non_exhaustive()
    }
}

impl Scrape {
    /// The text of the scrape, in Prometheus' text format.
    pub fn text(self) -> String {
        let (mut registry, mut text) = (Registry::default(), String::new());
        registry.register_collector(Box::new(self));
        // Writing to a String does not fail.
        let _ = prometheus_text::encode(&mut text, &registry);
        text
    }
}

type Labels = Vec<(&'static str, String)>;

#[derive(Clone, Copy)]
enum Value {
    Count(u64),
    Gauge(f64),
}

/// Writes metric families of Prometheus.
struct Put<'e, 'b> {
    encoder: DescriptorEncoder<'e>,
    boards: &'b [Seen],
}

impl Put<'_, '_> {
    /// Writes a metric family. A family without values is left out.
    fn family(
        &mut self,
        name: &str,
        help: &str,
        kind: MetricType,
        values: impl IntoIterator<Item = (Labels, Value)>,
    ) -> fmt::Result {
        let mut values = values.into_iter().peekable();
        if values.peek().is_none() {
            return Ok(());
        }
        let mut family = self.encoder.encode_descriptor(name, help, None, kind)?;
        for (labels, value) in values {
            let one = family.encode_family(&labels)?;
            match value {
                Value::Count(count) => ConstCounter::new(count).encode(one)?,
                Value::Gauge(value) => ConstGauge::new(value).encode(one)?,
            }
        }
        Ok(())
    }

    /// Writes a counter with a value for each board that has one. The encoder adds `_total` to its name.
    fn counter(&mut self, name: &str, help: &str, of: impl Fn(&Seen) -> Option<u64>) -> fmt::Result {
        let boards = self.boards;
        let values = boards.iter().filter_map(|board| Some((board.labels(), Value::Count(of(board)?))));
        self.family(name, help, MetricType::Counter, values)
    }

    /// As [`Self::counter`], with one more label, whose name is `label`.
    fn counters(
        &mut self,
        name: &str,
        help: &str,
        label: &'static str,
        of: impl Fn(&Seen) -> Vec<(&'static str, u64)>,
    ) -> fmt::Result {
        let values = self.boards.iter().flat_map(|board| {
            of(board).into_iter().map(|(word, count)| (board.with(label, word.to_owned()), Value::Count(count)))
        });
        let values: Vec<_> = values.collect();
        self.family(name, help, MetricType::Counter, values)
    }

    /// Writes a gauge with a value for each board that has one.
    fn gauge(&mut self, name: &str, help: &str, of: impl Fn(&Seen) -> Option<f64>) -> fmt::Result {
        let boards = self.boards;
        let values = boards.iter().filter_map(|board| Some((board.labels(), Value::Gauge(of(board)?))));
        self.family(name, help, MetricType::Gauge, values)
    }

    /// Writes a metric with a value for each slave that has one.
    fn slaves(
        &mut self,
        name: &str,
        help: &str,
        kind: MetricType,
        of: impl Fn(&Seen, &SlaveShown) -> Option<Value>,
    ) -> fmt::Result {
        let values = self.boards.iter().filter(|board| board.is_shown()).flat_map(|board| {
            let value = |slave: &SlaveShown| Some((board.of_slave(slave), of(board, slave)?));
            board.shown.slaves.iter().filter_map(value).collect::<Vec<_>>()
        });
        let values: Vec<_> = values.collect();
        self.family(name, help, kind, values)
    }

    /// Writes a gauge with a value for each axis that has one.
    fn axes(&mut self, name: &str, help: &str, of: impl Fn(&AxisShown) -> Option<f64>) -> fmt::Result {
        self.slaves(name, help, MetricType::Gauge, |_, slave| Some(Value::Gauge(of(slave.axis.as_ref()?)?)))
    }
}

impl Seen {
    fn labels(&self) -> Labels {
        vec![("board", self.number.to_string())]
    }

    fn with(&self, label: &'static str, value: String) -> Labels {
        let mut labels = self.labels();
        labels.push((label, value));
        labels
    }

    fn of_slave(&self, slave: &SlaveShown) -> Labels {
        self.with("slave", slave.number.to_string())
    }

    /// The counters of the board itself; `None` if the link does not know them.
    fn counters(&self) -> Option<&Counters> {
        self.look.stats.as_ref()?.board.as_ref()
    }

    /// Whether the values of the board are shown: it must be open, since the values of a lost board would be outdated.
    fn is_shown(&self) -> bool {
        self.look.stats.is_some()
    }

    fn lateness(&self) -> Option<Lateness> {
        self.look.stats.as_ref()?.lateness
    }
}

impl Collector for Scrape {
    fn encode(&self, encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let mut put = Put { encoder, boards: &self.boards };
        self.server(&mut put)?;
        self.chip(&mut put)?;
        boards(&mut put)?;
        commands(&mut put)?;
        wire(&mut put)?;
        lateness(&mut put, &self.boards)?;
        slaves(&mut put)?;
        recordings(&mut put)
    }
}

impl Scrape {
    fn server(&self, put: &mut Put<'_, '_>) -> fmt::Result {
        let build = vec![("version", env!("CARGO_PKG_VERSION").to_owned()), ("server", self.server.to_owned())];
        put.family(
            "ecmsk_build_info",
            "The version of ecmsk, and which server it is.",
            MetricType::Gauge,
            [(build, Value::Gauge(1.0))],
        )?;
        let clients = self.clients.map(|count| (vec![("server", self.server.to_owned())], Value::Gauge(count as f64)));
        put.family("ecmsk_clients", "Clients that are connected now.", MetricType::Gauge, clients)
    }

    fn chip(&self, put: &mut Put<'_, '_>) -> fmt::Result {
        let Some((counts, is_up)) = &self.chip else { return Ok(()) };
        let labels = || vec![("server", self.server.to_owned())];
        let up = Value::Gauge(f64::from(u8::from(*is_up)));
        put.family("ecmsk_chip_up", "1 if the chip can be used; otherwise 0.", MetricType::Gauge, [(labels(), up)])?;
        for (name, help, count) in [
            ("ecmsk_chip_opened", "How often the chip was opened.", counts.opened),
            ("ecmsk_chip_exchanges", "Exchanges with the chip.", counts.exchanges),
            ("ecmsk_chip_bytes", "Bytes of these exchanges, in each direction.", counts.bytes),
            ("ecmsk_chip_errors", "Exchanges that failed.", counts.errors),
        ] {
            put.family(name, help, MetricType::Counter, [(labels(), Value::Count(count))])?;
        }
        Ok(())
    }
}

fn boards(put: &mut Put<'_, '_>) -> fmt::Result {
    put.gauge(
        "ecmsk_board_up",
        "1 if the board answers and has lost no slave, as /healthz says; otherwise 0.",
        |board| Some(f64::from(u8::from(board.look.trouble.is_none()))),
    )?;
    let info = put.boards.iter().map(|board| (board.with("scheme", board.scheme.to_owned()), Value::Gauge(1.0)));
    let info: Vec<_> = info.collect();
    put.family("ecmsk_board_info", "The scheme of the link to the board.", MetricType::Gauge, info)?;
    put.counter("ecmsk_board_opened", "How often the board was opened: at first, and after each loss.", |board| {
        Some(board.counts.opened)
    })?;
    put.counter("ecmsk_frames_written", "Command frames that the board has taken from the server.", |board| {
        Some(board.counts.written)
    })?;
    put.counter("ecmsk_frames_read", "Reports that the server has read from the board.", |board| {
        Some(board.counts.read)
    })?;
    put.counter("ecmsk_write_errors", "Writes to the board that failed, except by a timeout.", |board| {
        Some(board.counts.write_errors)
    })?;
    put.counter("ecmsk_read_errors", "Reads from the board that failed, except by a timeout.", |board| {
        Some(board.counts.read_errors)
    })?;
    put.counter("ecmsk_reports_dropped", "Reports that were not read in time and were dropped.", |board| {
        Some(board.look.stats.as_ref()?.reports_dropped)
    })?;
    let states = put.boards.iter().filter(|board| board.is_shown()).filter_map(|board| {
        let now = board.shown.board.as_ref()?.state.state();
        let one = |state: MasterState| {
            (board.with("state", state.to_string()), Value::Gauge(f64::from(u8::from(now == Some(state)))))
        };
        Some(NETWORK_STATES.map(one))
    });
    let states: Vec<_> = states.flatten().collect();
    put.family(
        "ecmsk_network_state",
        "1 for the AL state of the network, 0 for the others.",
        MetricType::Gauge,
        states,
    )?;
    put.gauge("ecmsk_network_failed", "1 if a change of state has failed or a slave is lost; otherwise 0.", |board| {
        let shown = board.shown.board.as_ref().filter(|_| board.is_shown())?;
        Some(f64::from(u8::from(shown.state.is_failed())))
    })?;
    put.gauge("ecmsk_slaves_lost", "Slaves that are lost, as far as the board in this process knows them.", |board| {
        Some(board.look.stats.as_ref()?.lost.len() as f64)
    })?;
    put.gauge("ecmsk_network_down", "1 if the board receives nothing from its network; otherwise 0.", |board| {
        Some(f64::from(u8::from(board.look.stats.as_ref()?.network_down)))
    })
}

fn commands(put: &mut Put<'_, '_>) -> fmt::Result {
    put.gauge("ecmsk_fifo_entries", "Entries in the FIFO of the board, which all axes share; only in OP.", |board| {
        let shown = board.shown.board.as_ref().filter(|_| board.is_shown())?;
        let in_op = shown.state.state() == Some(MasterState::Op);
        in_op.then(|| f64::from(FIFO_ENTRIES.saturating_sub(shown.fifo_free)))
    })?;
    put.counter("ecmsk_fifo_executed", "Entries of the FIFO that the board has executed.", |board| {
        Some(board.counters()?.executed)
    })?;
    put.counter("ecmsk_motion_gaps", "Gaps in a motion: the FIFO ran empty while an axis was moving.", |board| {
        Some(board.shown.gaps)
    })?;
    put.counters("ecmsk_commands_rejected", "Commands that the board has rejected, by reason.", "reason", |board| {
        let counted = board.counters().map(|counters| counters.rejected);
        counted.map_or(Vec::new(), |rejected| Reason::NAMES.into_iter().zip(rejected).collect())
    })?;
    put.counters(
        "ecmsk_commands_dropped",
        "Commands and command frames that had no effect, by reason.",
        "reason",
        |board| {
            let Some(counters) = board.counters() else {
                // A real board reports only these two counts.
                return vec![("fifo_full", board.shown.full), ("bad_crc", board.shown.bad_crc)];
            };
            vec![
                ("fifo_full", counters.full),
                ("bad_crc", counters.crc),
                ("incomplete", counters.incomplete),
                ("fifo_cleared", counters.cleared),
                ("homing", counters.ignored_homing),
                ("not_enabled", counters.discarded_before_enabled),
                ("slave_lost", counters.for_lost),
                ("while_booting", counters.while_booting),
            ]
        },
    )?;
    put.counter("ecmsk_sdo_aborted", "SDO transfers that a slave has aborted or not answered.", |board| {
        Some(board.counters()?.sdo_aborted)
    })
}

fn wire(put: &mut Put<'_, '_>) -> fmt::Result {
    put.counter("ecmsk_wire_answers_lost", "Cycles whose answers were lost on the wire.", |board| {
        Some(board.counters()?.answers_lost)
    })?;
    put.counter("ecmsk_wire_outputs_lost", "Sets of outputs that were not sent, or reached no slave.", |board| {
        Some(board.counters()?.outputs_lost)
    })?;
    put.counter("ecmsk_wire_ring_broken_cycles", "Cycles in OP in which the ring of cables was broken.", |board| {
        Some(board.counters()?.ring_broken)
    })?;
    put.counter("ecmsk_inputs_held", "Cycles in OP in which a slave kept its previous inputs.", |board| {
        Some(board.counters()?.inputs_held)
    })?;
    put.counter(
        "ecmsk_inputs_stale",
        "How often the inputs of a slave became too old, so that it counts as lost.",
        |board| Some(board.counters()?.inputs_stale),
    )
}

fn lateness(put: &mut Put<'_, '_>, boards: &[Seen]) -> fmt::Result {
    put.counter("ecmsk_cycles", "Cycles that the board in this process has run.", |board| {
        Some(board.lateness()?.cycles)
    })?;
    put.counter("ecmsk_cycles_left_out", "Cycles that were skipped because this machine was late.", |board| {
        Some(board.counters()?.cycles_left_out)
    })?;
    let late: Vec<(&Seen, Lateness)> = boards.iter().filter_map(|board| Some((board, board.lateness()?))).collect();
    if late.is_empty() {
        return Ok(());
    }
    let help = "How late the cycles of the board in this process began.";
    let mut family =
        put.encoder.encode_descriptor("ecmsk_cycle_lateness_seconds", help, None, MetricType::Histogram)?;
    for (board, lateness) in late {
        let bounds = LATENESS_BOUNDS_NS.iter().map(|ns| *ns as f64 / 1e9).chain([f64::INFINITY]);
        let buckets: Vec<(f64, u64)> = bounds.zip(lateness.within).collect();
        let (sum, count) = (lateness.sum_ns as f64 / 1e9, lateness.within.iter().sum());
        let labels = board.labels();
        family.encode_family(&labels)?.encode_histogram::<NoLabelSet>(sum, count, &buckets, None)?;
    }
    Ok(())
}

fn slaves(put: &mut Put<'_, '_>) -> fmt::Result {
    put.slaves("ecmsk_slave_lost", "1 if the slave is lost; otherwise 0.", MetricType::Gauge, |board, slave| {
        let stats = board.look.stats.as_ref()?;
        Some(Value::Gauge(f64::from(u8::from(stats.lost.contains(slave.number)))))
    })?;
    let states = put.boards.iter().filter(|board| board.is_shown()).flat_map(|board| {
        let of = board.shown.slaves.iter().filter_map(|slave| {
            let now = slave.axis?.drive.statusword.state();
            let one = |state: DriveState| {
                let mut labels = board.of_slave(slave);
                labels.push(("state", state.name().to_owned()));
                (labels, Value::Gauge(f64::from(u8::from(now == Some(state)))))
            };
            Some(AXIS_STATES.map(one))
        });
        of.flatten().collect::<Vec<_>>()
    });
    let states: Vec<_> = states.collect();
    put.family(
        "ecmsk_axis_state",
        "1 for the CiA 402 state of the axis, 0 for the others.",
        MetricType::Gauge,
        states,
    )?;
    put.axes("ecmsk_axis_position_counts", "The actual position of the axis.", |axis| {
        Some(f64::from(axis.drive.position))
    })?;
    put.axes("ecmsk_axis_following_error_counts", "The target in force minus the actual position.", |axis| {
        Some(axis.following_error? as f64)
    })?;
    put.axes("ecmsk_axis_torque_ratio", "The actual torque, as a part of the rated torque.", |axis| {
        Some(f64::from(axis.drive.torque) / 1000.0)
    })?;
    put.axes("ecmsk_axis_alarm_code", "The error code (0x603F) of the axis; 0: no alarm.", |axis| {
        Some(f64::from(axis.drive.error_code))
    })?;
    put.slaves(
        "ecmsk_axis_alarms",
        "Alarms of the axis since the server was started.",
        MetricType::Counter,
        |_, slave| slave.axis.is_some().then_some(Value::Count(slave.alarms)),
    )
}

fn recordings(put: &mut Put<'_, '_>) -> fmt::Result {
    let bytes = put.boards.iter().flat_map(|board| {
        board.recorded.iter().map(|(word, bytes)| (board.with("kind", (*word).to_owned()), Value::Gauge(*bytes as f64)))
    });
    let bytes: Vec<_> = bytes.collect();
    put.family("ecmsk_recording_bytes", "The bytes of the recording on its disk.", MetricType::Gauge, bytes)?;
    put.counter("ecmsk_recording_frames_lost", "Frames that are missing in the recording.", |board| {
        (!board.recorded.is_empty()).then_some(board.look.stats.as_ref()?.record_dropped)
    })
}

/// The size in bytes of a file, or of all files in a folder; `None` if the path does not exist. Files at most two
/// folder levels deep count, which is how deep a flight recorder writes.
pub fn bytes_of(path: &Path) -> Option<u64> {
    fn below(path: &Path, depth: u32) -> Option<u64> {
        let there = path.metadata().ok()?;
        if !there.is_dir() {
            return Some(there.len());
        }
        let entries = path.read_dir().ok().filter(|_| depth > 0)?;
        Some(entries.flatten().filter_map(|entry| below(&entry.path(), depth - 1)).sum())
    }
    below(path, 2)
}
