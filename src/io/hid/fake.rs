//! libusb with a device of which a test has every end: what it sends, takes, refuses, and when it is pulled.

use std::cell::Cell;
use std::collections::VecDeque;
use std::ffi::{c_int, c_uchar, c_void};
use std::ptr;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Condvar, Mutex, MutexGuard};

use super::bus::Bus;
use super::libusb::{
    Api, ConfigurationDescriptor, DeviceDescriptor, EndpointDescriptor, HIGH_SPEED, INTERRUPT, InterfaceDescriptor,
    InterfaceSettings, RawContext, RawDevice, RawHandle, RawTransfer, UsbError, status,
};
use super::{Found, REPORT_LEN, find};

pub const VENDOR: u16 = 0x16C0;
pub const PRODUCT: u16 = 0x05DF;

const NO_DEVICE: c_int = -4;
const NOT_FOUND: c_int = -5;

/// What the device does with a report that it is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    /// It takes it.
    All,
    /// It does not take it; when the host takes it back so many bytes have moved.
    None { moved: usize },
    /// Its endpoint stalls until the halt is cleared.
    Nothing,
}

struct Ending {
    transfer: *mut RawTransfer,
    status: c_int,
    moved: usize,
    bytes: Vec<u8>,
}

// SAFETY: the pointers are those of transfers, which any thread may use.
unsafe impl Send for Inside {}

struct Inside {
    /// Transfers that libusb has, oldest first.
    pending: Vec<*mut RawTransfer>,
    endings: VecDeque<Ending>,
    to_send: VecDeque<(c_int, Vec<u8>)>,
    takes: Takes,
    taken: Vec<[u8; REPORT_LEN]>,
    halted: bool,
    halts_cleared: Vec<u8>,
    interrupted: bool,
    gone: bool,
    /// Calls so far, and that at which the device is pulled.
    calls: usize,
    pulled_at: usize,
    /// What a call answers instead.
    answers: Vec<(&'static str, c_int)>,
    /// Contexts, devices, handles, claims, transfers that were made and not given back.
    left: [isize; 5],
    /// Transfers that a hand over was asked for after the first; see [`World::at_next_hand_over`].
    hook: Option<Box<dyn FnOnce() + Send>>,
    cancels: usize,
}

/// The bus and its one device.
pub struct World {
    inside: Mutex<Inside>,
    changed: Condvar,
}

thread_local! {
    static NEXT: Cell<Option<&'static World>> = const { Cell::new(None) };
}

impl World {
    /// A world, which lives as long as the test program.
    pub fn new() -> &'static Self {
        Box::leak(Box::new(Self {
            inside: Mutex::new(Inside {
                pending: Vec::new(),
                endings: VecDeque::new(),
                to_send: VecDeque::new(),
                takes: Takes::All,
                taken: Vec::new(),
                halted: false,
                halts_cleared: Vec::new(),
                interrupted: false,
                gone: false,
                calls: 0,
                pulled_at: usize::MAX,
                answers: Vec::new(),
                left: [0; 5],
                hook: None,
                cancels: 0,
            }),
            changed: Condvar::new(),
        }))
    }

    /// The bus, as the pipe sees it.
    pub fn bus(&'static self) -> Result<Arc<Bus>, UsbError> {
        NEXT.set(Some(self));
        Bus::over(&FAKE)
    }

    /// The device.
    #[track_caller]
    pub fn found(&'static self) -> Found {
        let bus = self.bus().expect("it opens");
        find(&bus, VENDOR, PRODUCT).expect("it lists").pop().expect("it is there")
    }

    fn with<T>(&self, work: impl FnOnce(&mut Inside) -> T) -> T {
        let done = work(&mut self.inside.lock());
        self.changed.notify_all();
        done
    }

    /// The device sends that, or a transfer ends with that status.
    pub fn send(&self, status: c_int, bytes: &[u8]) {
        self.with(|inside| {
            inside.to_send.push_back((status, bytes.to_vec()));
            inside.deliver();
        });
    }

    pub fn set_takes(&self, takes: Takes) {
        self.with(|inside| inside.takes = takes);
    }

    /// The cable is pulled.
    pub fn pull(&self) {
        self.with(Inside::pull);
    }

    /// The cable is pulled in that call of libusb, counted from 1.
    pub fn pull_at(&self, call: usize) {
        self.with(|inside| inside.pulled_at = call);
    }

    /// Calls of that name answer so.
    pub fn answer(&self, name: &'static str, code: c_int) {
        self.with(|inside| inside.answers.push((name, code)));
    }

    /// Does something while the next transfer is handed over.
    pub fn at_next_hand_over(&self, work: impl FnOnce() + Send + 'static) {
        self.with(|inside| inside.hook = Some(Box::new(work)));
    }

    /// Waits until the pipe has cancelled something, but not long.
    pub fn wait_for_a_cancel(&self, limit: Duration) {
        let mut inside = self.inside.lock();
        if inside.cancels == 0 {
            self.changed.wait_for(&mut inside, limit);
        }
    }

    /// Waits until so many transfers wait.
    #[track_caller]
    pub fn until_pending(&self, count: usize) {
        let mut inside = self.inside.lock();
        while inside.pending.len() != count {
            let late = self.changed.wait_for(&mut inside, Duration::from_secs(20)).timed_out();
            assert!(!late, "{} transfers wait, not {count}", inside.pending.len());
        }
    }

    pub fn calls(&self) -> usize {
        self.inside.lock().calls
    }

    pub fn taken(&self) -> Vec<[u8; REPORT_LEN]> {
        self.inside.lock().taken.clone()
    }

    pub fn halts_cleared(&self) -> Vec<u8> {
        self.inside.lock().halts_cleared.clone()
    }

    /// Contexts, devices, handles, claims and transfers that were not given back.
    pub fn left(&self) -> [isize; 5] {
        self.inside.lock().left
    }

    fn enter(&self, name: &str) -> Result<MutexGuard<'_, Inside>, c_int> {
        let mut inside = self.inside.lock();
        inside.calls += 1;
        if inside.calls == inside.pulled_at {
            inside.pull();
            self.changed.notify_all();
        }
        if let Some((_, code)) = inside.answers.iter().find(|(other, _)| *other == name) {
            return Err(*code);
        }
        if inside.gone { Err(NO_DEVICE) } else { Ok(inside) }
    }

    fn count(&self, what: usize, change: isize) {
        self.inside.lock().left[what] += change;
    }
}

impl Inside {
    fn pull(&mut self) {
        self.gone = true;
        for transfer in std::mem::take(&mut self.pending) {
            self.end(transfer, status::NO_DEVICE, 0, Vec::new());
        }
    }

    fn end(&mut self, transfer: *mut RawTransfer, status: c_int, moved: usize, bytes: Vec<u8>) {
        self.endings.push_back(Ending { transfer, status, moved, bytes });
    }

    fn deliver(&mut self) {
        while let Some(at) = self.pending.iter().position(|transfer| to_host(*transfer)) {
            let Some((status, bytes)) = self.to_send.pop_front() else { return };
            let transfer = self.pending.remove(at);
            self.end(transfer, status, bytes.len(), bytes);
        }
    }

    fn output(&mut self, transfer: *mut RawTransfer) {
        match self.takes {
            Takes::All if !self.halted => {
                self.taken.push(report_of(transfer));
                self.end(transfer, status::COMPLETED, REPORT_LEN, Vec::new());
            }
            Takes::None { .. } => self.pending.push(transfer),
            Takes::All | Takes::Nothing => {
                self.halted = true;
                self.end(transfer, status::STALL, 0, Vec::new());
            }
        }
    }
}

fn to_host(transfer: *mut RawTransfer) -> bool {
    // SAFETY: the pipe's transfers are there while libusb has them, here and below.
    unsafe { (*transfer).endpoint & 0x80 != 0 }
}

fn report_of(transfer: *mut RawTransfer) -> [u8; REPORT_LEN] {
    // SAFETY: as above; its buffer has that size.
    unsafe { *(*transfer).buffer.cast::<[u8; REPORT_LEN]>() }
}

fn world<T>(pointer: *mut T) -> &'static World {
    // SAFETY: contexts, devices and handles of this library are all the address of a world, which is never freed.
    unsafe { &*pointer.cast::<World>() }
}

fn code(done: Result<(), c_int>) -> c_int {
    done.err().unwrap_or(0)
}

const FAKE: Api = Api {
    init,
    exit,
    devices,
    free_devices,
    unref_device,
    device_descriptor,
    configuration,
    free_configuration,
    bus_number,
    address,
    ports,
    speed,
    open,
    close,
    detach_driver_by_itself,
    claim,
    release,
    clear_halt,
    new_transfer,
    free_transfer,
    submit,
    cancel,
    handle_events,
    interrupt,
};

unsafe extern "C" fn init(context: *mut *mut RawContext) -> c_int {
    let world = NEXT.take().expect("a test calls World::bus");
    code(world.enter("init").map(|_| ()).or_else(|code| if code == NO_DEVICE { Ok(()) } else { Err(code) }).map(|()| {
        world.count(0, 1);
        // SAFETY: the caller's place for it.
        unsafe { *context = ptr::from_ref(world).cast_mut().cast() };
    }))
}

unsafe extern "C" fn exit(context: *mut RawContext) {
    world(context).count(0, -1);
}

unsafe extern "C" fn devices(context: *mut RawContext, list: *mut *mut *mut RawDevice) -> isize {
    let world = world(context);
    let there = match world.enter("devices").map(drop) {
        Ok(()) => 1,
        Err(NO_DEVICE) => 0,
        Err(code) => return code as isize,
    };
    world.count(1, there);
    // A list ends with a null pointer.
    let entries: Box<[*mut RawDevice; 2]> =
        Box::new([if there == 1 { context.cast() } else { ptr::null_mut() }, ptr::null_mut()]);
    // SAFETY: the caller's place for it.
    unsafe { *list = Box::into_raw(entries).cast() };
    there
}

unsafe extern "C" fn free_devices(list: *mut *mut RawDevice, _unref: c_int) {
    // SAFETY: it comes from `devices`.
    drop(unsafe { Box::from_raw(list.cast::<[*mut RawDevice; 2]>()) });
}

unsafe extern "C" fn unref_device(device: *mut RawDevice) {
    world(device).count(1, -1);
}

unsafe extern "C" fn device_descriptor(_device: *mut RawDevice, descriptor: *mut DeviceDescriptor) -> c_int {
    // SAFETY: the caller's place for it.
    unsafe { *descriptor = DeviceDescriptor { vendor: VENDOR, product: PRODUCT, ..DeviceDescriptor::default() } };
    0
}

unsafe extern "C" fn configuration(device: *mut RawDevice, tree: *mut *mut ConfigurationDescriptor) -> c_int {
    code(world(device).enter("configuration").map(|_| {
        let endpoint = |address| EndpointDescriptor {
            length: 7,
            kind: 5,
            address,
            attributes: INTERRUPT,
            packet: 512,
            interval: 1,
            refresh: 0,
            synch: 0,
            extra: ptr::null(),
            extra_length: 0,
        };
        // Small, and freed with the test program.
        let endpoints: &[_] = Box::leak(Box::new([endpoint(0x81), endpoint(0x02)]));
        let setting = |alternate, endpoint_count| InterfaceDescriptor {
            length: 9,
            kind: 4,
            number: 0,
            alternate,
            endpoint_count,
            class: 3,
            subclass: 0,
            protocol: 0,
            text: 0,
            endpoints: if endpoint_count == 0 { ptr::null() } else { endpoints.as_ptr() },
            extra: ptr::null(),
            extra_length: 0,
        };
        let settings: &[_] = Box::leak(Box::new([setting(1, 0), setting(0, 2)]));
        let interfaces: &[_] = Box::leak(Box::new([
            // Descriptors may be empty.
            InterfaceSettings { settings: ptr::null(), count: -1 },
            InterfaceSettings { settings: settings.as_ptr(), count: 2 },
        ]));
        let of_all = ConfigurationDescriptor {
            length: 9,
            kind: 2,
            total: 41,
            interface_count: 2,
            value: 1,
            text: 0,
            attributes: 0x80,
            power: 250,
            interfaces: interfaces.as_ptr(),
            extra: ptr::null(),
            extra_length: 0,
        };
        // SAFETY: the caller's place for it.
        unsafe { *tree = Box::into_raw(Box::new(of_all)) };
    }))
}

unsafe extern "C" fn free_configuration(tree: *mut ConfigurationDescriptor) {
    // SAFETY: it comes from `configuration`.
    drop(unsafe { Box::from_raw(tree) });
}

unsafe extern "C" fn bus_number(_device: *mut RawDevice) -> u8 {
    9
}

unsafe extern "C" fn address(_device: *mut RawDevice) -> u8 {
    7
}

unsafe extern "C" fn ports(_device: *mut RawDevice, ports: *mut u8, _room: c_int) -> c_int {
    // SAFETY: the caller's place for it.
    unsafe { *ports = 2 };
    1
}

unsafe extern "C" fn speed(_device: *mut RawDevice) -> c_int {
    HIGH_SPEED
}

unsafe extern "C" fn open(device: *mut RawDevice, handle: *mut *mut RawHandle) -> c_int {
    let world = world(device);
    code(world.enter("open").map(drop).map(|()| {
        world.count(2, 1);
        // SAFETY: the caller's place for it.
        unsafe { *handle = device.cast() };
    }))
}

unsafe extern "C" fn close(handle: *mut RawHandle) {
    world(handle).count(2, -1);
}

unsafe extern "C" fn detach_driver_by_itself(handle: *mut RawHandle, _enable: c_int) -> c_int {
    code(world(handle).enter("detach_driver_by_itself").map(drop))
}

unsafe extern "C" fn claim(handle: *mut RawHandle, _interface: c_int) -> c_int {
    code(world(handle).enter("claim").map(|mut inside| inside.left[3] += 1))
}

unsafe extern "C" fn release(handle: *mut RawHandle, _interface: c_int) -> c_int {
    world(handle).count(3, -1);
    code(world(handle).enter("release").map(drop))
}

unsafe extern "C" fn clear_halt(handle: *mut RawHandle, endpoint: c_uchar) -> c_int {
    code(world(handle).enter("clear_halt").map(|mut inside| {
        inside.halted = false;
        inside.halts_cleared.push(endpoint);
    }))
}

unsafe extern "C" fn new_transfer(_packets: c_int) -> *mut RawTransfer {
    extern "C" fn nobody(_transfer: *mut RawTransfer) {}
    Box::into_raw(Box::new(RawTransfer {
        handle: ptr::null_mut(),
        flags: 0,
        endpoint: 0,
        kind: 0,
        timeout: 0,
        status: 0,
        length: 0,
        moved: 0,
        callback: nobody,
        user_data: ptr::null_mut::<c_void>(),
        buffer: ptr::null_mut(),
        packets: 0,
    }))
}

unsafe extern "C" fn free_transfer(transfer: *mut RawTransfer) {
    // SAFETY: it comes from `new_transfer`.
    let transfer = unsafe { Box::from_raw(transfer) };
    let world = world(transfer.handle);
    let address = ptr::from_ref(&*transfer).cast_mut();
    let has_it = world.with(|inside| {
        inside.pending.contains(&address) || inside.endings.iter().any(|ending| ending.transfer == address)
    });
    assert!(!has_it, "a transfer is freed that libusb has");
}

unsafe extern "C" fn submit(transfer: *mut RawTransfer) -> c_int {
    // SAFETY: the caller's transfer.
    let world = world(unsafe { (*transfer).handle });
    let hook = world.with(|inside| inside.hook.take());
    if let Some(work) = hook {
        work();
    }
    let done = world.enter("submit").map(|mut inside| {
        if to_host(transfer) {
            inside.pending.push(transfer);
            inside.deliver();
        } else {
            inside.output(transfer);
        }
    });
    world.changed.notify_all();
    code(done)
}

unsafe extern "C" fn cancel(transfer: *mut RawTransfer) -> c_int {
    // SAFETY: the caller's transfer.
    let world = world(unsafe { (*transfer).handle });
    world.with(|inside| {
        inside.cancels += 1;
        let Some(at) = inside.pending.iter().position(|other| *other == transfer) else { return NOT_FOUND };
        inside.pending.remove(at);
        let moved = match inside.takes {
            Takes::None { moved } if !to_host(transfer) => moved,
            _ => 0,
        };
        if moved == REPORT_LEN {
            inside.taken.push(report_of(transfer));
        }
        inside.end(transfer, status::CANCELLED, moved, Vec::new());
        0
    })
}

unsafe extern "C" fn handle_events(context: *mut RawContext, limit: *mut libc::timeval, _done: *mut c_int) -> c_int {
    let world = world(context);
    // SAFETY: the caller's limit.
    let limit = unsafe { Duration::new((*limit).tv_sec as u64, (*limit).tv_usec as u32 * 1000) };
    let mut inside = world.inside.lock();
    if inside.endings.is_empty() && !inside.interrupted {
        world.changed.wait_for(&mut inside, limit);
    }
    inside.interrupted = false;
    let endings = std::mem::take(&mut inside.endings);
    drop(inside);
    for Ending { transfer, status, moved, bytes } in endings {
        // SAFETY: libusb has the transfer and its buffer, and gives both back by this call.
        unsafe {
            (*transfer).status = status;
            (*transfer).moved = moved as c_int;
            ptr::copy_nonoverlapping(bytes.as_ptr(), (*transfer).buffer, bytes.len().min(REPORT_LEN));
            ((*transfer).callback)(transfer);
        }
    }
    0
}

unsafe extern "C" fn interrupt(context: *mut RawContext) {
    world(context).with(|inside| inside.interrupted = true);
}
