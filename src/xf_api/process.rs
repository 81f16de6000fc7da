//! Typed process data, and the cycle of a program.

use std::marker::PhantomData;
use std::time::Duration;

use super::layout::{self, FieldType, Layout, SlaveLayout};
use super::{Xf, XfError};
use crate::ethercat::Ns;
use crate::ethercat::coe::ObjectAddress;
use crate::link::chip_link::ChipLink;
use crate::xf::host::{Budget, HostError, ProcessOutcome, ProcessRequest};

/// How many RxPDOs a program stays ahead of the chip, by default. \[OURS] With a cycle of 1 ms a program may be late by
/// 20 ms.
const AHEAD: u8 = 20;
/// How many TxPDOs may wait in the TxFIFO. If there are more, as many as fit into a packet are read at once, so that
/// the inputs are not outdated. \[OURS] The level that the driver knows lags two exchanges behind.
const TX_BACKLOG: u8 = 3;
/// How many times per cycle the driver polls the chip's FIFO levels. \[OURS]
const POLLS_A_CYCLE: Ns = 2;
/// How long the RxFIFO's level may stay unchanged before the chip counts as taking nothing out of it. \[OURS]
const STALL_LIMIT: Duration = Duration::from_secs(2);

/// A handle of an output object in the process data, whose value has the type `T`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output<T> {
    at: usize,
    kind: PhantomData<T>,
}

/// A handle of an input object in the process data, whose value has the type `T`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Input<T> {
    at: usize,
    kind: PhantomData<T>,
}

/// The process data of all slaves: the outputs of the next cycle, and the newest inputs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessData {
    layout: Layout,
    outputs: Vec<u8>,
    inputs: Vec<u8>,
    /// The maximum number of RxPDOs to keep in the chip's FIFO, 1 or more; 20 by default. With a higher value the
    /// program may be late for longer, but its outputs reach the slaves later.
    pub ahead: u8,
}

impl<T> Output<T> {
    /// Offset of the object in bytes from the beginning of the RxPDO.
    pub const fn offset(&self) -> usize {
        self.at
    }
}

impl<T> Input<T> {
    /// Offset of the object in bytes from the beginning of the TxPDO.
    pub const fn offset(&self) -> usize {
        self.at
    }
}

impl ProcessData {
    /// The positions of the objects in the process data.
    pub const fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Returns the handle of an object that a slave maps among its outputs. The type must have the object's size.
    ///
    /// # Errors
    /// [`XfError::NoSuchSlave`] if the network has no slave with this number, [`XfError::NotMapped`] if the slave does
    /// not map the object among its outputs, [`XfError::FieldSize`] if the object has another size than the type or
    /// does not begin at a whole byte.
    pub fn output<T: FieldType>(&self, slave: u8, object: ObjectAddress) -> Result<Output<T>, XfError> {
        let at = find::<T>(&self.layout.outputs, slave, object, "outputs")?;
        Ok(Output { at, kind: PhantomData })
    }

    /// Returns the handle of an object that a slave maps among its inputs. The type must have the object's size.
    ///
    /// # Errors
    /// As with [`Self::output`].
    pub fn input<T: FieldType>(&self, slave: u8, object: ObjectAddress) -> Result<Input<T>, XfError> {
        let at = find::<T>(&self.layout.inputs, slave, object, "inputs")?;
        Ok(Input { at, kind: PhantomData })
    }

    /// Sets an output for the next cycle.
    ///
    /// # Panics
    /// If the handle comes from other, longer process data and is out of range here.
    pub fn set<T: FieldType>(&mut self, output: Output<T>, value: T) {
        value.put_le(&mut self.outputs[output.at..output.at + T::BYTES]);
    }

    /// The value of an output that the next cycle sends.
    ///
    /// # Panics
    /// As with [`Self::set`].
    pub fn get_output<T: FieldType>(&self, output: Output<T>) -> T {
        read(&self.outputs, output.at)
    }

    /// The newest value of an input.
    ///
    /// # Panics
    /// If the handle comes from other, longer process data and is out of range here.
    pub fn get<T: FieldType>(&self, input: Input<T>) -> T {
        read(&self.inputs, input.at)
    }

    /// The RxPDO of the next cycle, with the outputs of all slaves.
    pub fn outputs_mut(&mut self) -> &mut [u8] {
        &mut self.outputs
    }

    /// The newest TxPDO, with the inputs of all slaves.
    pub fn inputs(&self) -> &[u8] {
        &self.inputs
    }

    /// Keeps the newest of the TxPDOs that were read.
    fn keep(&mut self, pdos: &[u8]) {
        if let Some(newest) = pdos.rchunks_exact(self.inputs.len().max(1)).next() {
            self.inputs.copy_from_slice(newest);
        }
    }
}

fn read<T: FieldType>(image: &[u8], at: usize) -> T {
    match T::from_le(&image[at..at + T::BYTES]) {
        Some(value) => value,
        None => unreachable!("so many bytes are a value"),
    }
}

/// The offset of an object in the process image, in bytes.
fn find<T: FieldType>(
    slaves: &[SlaveLayout],
    slave: u8,
    object: ObjectAddress,
    direction: &'static str,
) -> Result<usize, XfError> {
    let found = slaves.len() as u8;
    let place = slaves.get(usize::from(slave)).ok_or(XfError::NoSuchSlave { slave, found })?;
    let Some(field) = place.fields.iter().find(|field| field.object == object) else {
        let mapped: Vec<String> = place.fields.iter().map(|field| field.object.to_string()).collect();
        let mapped = if mapped.is_empty() { "nothing".to_owned() } else { mapped.join(", ") };
        return Err(XfError::NotMapped { slave, object, direction, mapped });
    };
    if !field.at.is_multiple_of(8) || usize::from(field.bits) != 8 * T::BYTES {
        return Err(XfError::FieldSize { slave, object, bits: field.bits, at: field.at, wanted: 8 * T::BYTES });
    }
    Ok(place.at + field.at / 8)
}

impl<L: ChipLink> Xf<L> {
    /// Builds the process data from the slaves' mapping, with all outputs 0 and the current inputs, read directly and
    /// not from the FIFO. Called in SafeOP it shows the actual positions.
    ///
    /// This also chooses n, the size of the data segment, unless the link sets it (`use_n=`) or supports only one size.
    /// Large packets take long to transfer: if they do not fit into a cycle, the RxFIFO runs empty and every motion has
    /// gaps. If the size changes, the RxFIFO is off and empty afterwards.
    ///
    /// # Errors
    /// As with [`Self::layout`] and [`Self::read_inputs`]; [`XfError::Budget`], with the calculation, if the exchanges
    /// do not fit into the cycle.
    pub fn process_data(&mut self) -> Result<ProcessData, XfError> {
        let layout = self.layout()?;
        let (outputs, inputs) = (layout::total(&layout.outputs), layout::total(&layout.inputs));
        self.fit(outputs.max(inputs))?;
        let mut data = ProcessData { layout, outputs: vec![0; outputs], inputs: vec![0; inputs], ahead: AHEAD };
        self.read_inputs(&mut data)?;
        Ok(data)
    }

    /// Chooses the data segment size, unless it is fixed, and checks that `process_bytes` bytes of process data can be
    /// transferred within a network cycle.
    fn fit(&mut self, process_bytes: usize) -> Result<(), XfError> {
        let info = self.link.info();
        let Some(cycle_ns) = self.cycle_ns else { return Ok(()) };
        // Polling the FIFO levels this often is enough to write in step with the chip.
        self.host.set_poll_ns(cycle_ns / POLLS_A_CYCLE);
        let (Some(clock_hz), config) = (info.clock_hz, self.host.config()) else { return Ok(()) };
        // Without pipelined writes the driver waits for an answer before the next write, which takes a second exchange.
        let exchanges = if config.pipelined_writes { 1 } else { 2 };
        let budget = Budget { process_bytes, clock_hz, idle_ns: config.idle_ns, cycle_ns, exchanges };
        if config.wanted_size.is_some() || info.size.is_some() {
            return Ok(budget.check(self.host.size())?);
        }
        let size = budget.choose_size()?;
        if size != self.host.size() {
            self.host.resize(self.link.now(), size);
            self.start()?;
        }
        Ok(())
    }

    /// Reads the current inputs directly, bypassing the TxFIFO.
    ///
    /// # Errors
    /// [`XfError::ProcessData`] if the chip refuses the exchange or gives no answer; otherwise as with [`Xf::run`].
    pub fn read_inputs(&mut self, data: &mut ProcessData) -> Result<(), XfError> {
        if !data.inputs.is_empty() {
            self.exchange(data, ProcessRequest::DirectRead)?;
        }
        Ok(())
    }

    /// Runs one cycle of a program: waits until fewer than [`ProcessData::ahead`] RxPDOs are in the chip's FIFO, adds
    /// one, and reads inputs. The chip sends one RxPDO per EtherCAT cycle, which keeps the program in step with the
    /// network.
    ///
    /// # Errors
    /// [`XfError::RxFifoStalled`] if the chip takes nothing out of the RxFIFO for 2 s, [`XfError::ProcessData`] if the
    /// chip did not take the outputs, or may not have taken them; otherwise as with [`Xf::run`].
    pub fn cycle(&mut self, data: &mut ProcessData) -> Result<(), XfError> {
        self.wait_held(data.ahead.max(1) - 1)?;
        let outputs = std::mem::take(&mut data.outputs);
        let done = self.exchange(data, ProcessRequest::Exchange { count: 1, outputs: &outputs });
        data.outputs = outputs;
        done?;
        let waiting = self.header().tx_fifo;
        if waiting > TX_BACKLOG && !data.inputs.is_empty() {
            let most = (self.host.size().bytes() / data.inputs.len()).min(usize::from(u8::MAX)) as u8;
            self.exchange(data, ProcessRequest::Read { count: waiting.min(most) })?;
        }
        Ok(())
    }

    /// Waits until the chip has sent all RxPDOs that were written, and then reads the inputs.
    ///
    /// # Errors
    /// As with [`Self::cycle`].
    pub fn finish(&mut self, data: &mut ProcessData) -> Result<(), XfError> {
        self.wait_held(0)?;
        // The RxFIFO is empty when the last RxPDO is sent; only the inputs of the next cycle show its effect.
        self.pass(Duration::from_millis(10))?;
        self.read_inputs(data)
    }

    /// Waits until the RxFIFO holds at most `most` PDOs.
    fn wait_held(&mut self, most: u8) -> Result<(), XfError> {
        let (mut held, mut since) = (self.held(), self.link.now());
        while held > most {
            self.step(Ns::MAX)?;
            let (now_held, now) = (self.held(), self.link.now());
            if now_held < held {
                (held, since) = (now_held, now);
            } else if now - since > super::ns(STALL_LIMIT) {
                return Err(XfError::RxFifoStalled { held, waited: Duration::from_nanos(now - since) });
            }
        }
        Ok(())
    }

    /// An upper bound of the number of RxPDOs in the chip's FIFO.
    fn held(&self) -> u8 {
        self.host.rx_entries().saturating_sub(self.host.rx_free())
    }

    fn exchange(&mut self, data: &mut ProcessData, exchanged: ProcessRequest<'_>) -> Result<(), XfError> {
        if self.exchange_raw(exchanged)? {
            data.keep(self.host.inputs());
        }
        Ok(())
    }

    /// Exchanges process data; returns whether inputs were read.
    pub(super) fn exchange_raw(&mut self, exchanged: ProcessRequest<'_>) -> Result<bool, XfError> {
        self.moves |= !matches!(exchanged, ProcessRequest::Read { .. } | ProcessRequest::DirectRead);
        let sequence = loop {
            match self.host.process(exchanged) {
                // An earlier call that failed on the link has left process data in the driver. They are sent first.
                Err(HostError::ProcessBusy { .. }) => self.step(Ns::MAX)?,
                taken => break taken?,
            }
        };
        let outcome = loop {
            self.step(Ns::MAX)?;
            if let Some(report) = self.host.take_report().filter(|report| report.sequence == sequence) {
                break report.outcome;
            }
        };
        match outcome {
            ProcessOutcome::Done { read } => Ok(read),
            // The outputs are in the FIFO; only the inputs were lost, so the inputs of an earlier cycle are kept.
            ProcessOutcome::AnswerLost => Ok(false),
            outcome => Err(XfError::ProcessData { outcome }),
        }
    }
}
