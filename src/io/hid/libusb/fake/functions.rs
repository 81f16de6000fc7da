//! The functions of the simulated libusb, with the signatures of the real ones.

use std::ffi::{c_int, c_uchar, c_uint, c_void};
use std::os::fd::AsRawFd as _;
use std::ptr;
use std::time::Duration;

use super::super::REPORT_LEN;
use super::super::api::{
    Api, ConfigurationDescriptor, DeviceDescriptor, EndpointDescriptor, HIGH_SPEED, INTERRUPT, INTERRUPTED,
    InterfaceDescriptor, InterfaceSettings, PollDescriptor, RawContext, RawDevice, RawHandle, RawTransfer, TIMEOUT,
    status,
};
use super::{Ending, FakeUsb, NEXT, NO_DEVICE, PRODUCT, ReportReaction, VENDOR, report_of, to_host};

const IO: c_int = -1;
const NOT_FOUND: c_int = -5;

/// A wait for events with this limit or a longer one has no limit in the simulation. So a test hangs, and shows the
/// fault, if the code under test does not interrupt such a wait.
const LONG: Duration = Duration::from_secs(1);

fn world<T>(pointer: *mut T) -> &'static FakeUsb {
    // SAFETY: all contexts, devices and handles here are the address of a `FakeUsb`, which is never freed.
    unsafe { &*pointer.cast::<FakeUsb>() }
}

fn code(done: Result<(), c_int>) -> c_int {
    done.err().unwrap_or(0)
}

pub(super) const FAKE: Api = Api {
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
    descriptors,
    free_descriptors,
    bulk_transfer: packet,
    interrupt_transfer: packet,
};

unsafe extern "C" fn init(context: *mut *mut RawContext) -> c_int {
    let world = NEXT.take().expect("a test calls FakeUsb::bus");
    code(world.enter("init").map(|_| ()).or_else(|code| if code == NO_DEVICE { Ok(()) } else { Err(code) }).map(|()| {
        world.count(0, 1);
        // SAFETY: the caller passes a valid pointer for the result.
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
    // libusb ends its device list with a null pointer, so this list does too.
    let entries: Box<[*mut RawDevice; 2]> =
        Box::new([if there == 1 { context.cast() } else { ptr::null_mut() }, ptr::null_mut()]);
    // SAFETY: the caller passes a valid pointer for the result.
    unsafe { *list = Box::into_raw(entries).cast() };
    there
}

unsafe extern "C" fn free_devices(list: *mut *mut RawDevice, _unref: c_int) {
    // SAFETY: the list comes from `devices`.
    drop(unsafe { Box::from_raw(list.cast::<[*mut RawDevice; 2]>()) });
}

unsafe extern "C" fn unref_device(device: *mut RawDevice) {
    world(device).count(1, -1);
}

unsafe extern "C" fn device_descriptor(_device: *mut RawDevice, descriptor: *mut DeviceDescriptor) -> c_int {
    // SAFETY: the caller passes a valid pointer for the result.
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
        // The leaked memory is small, and is freed when the test program ends.
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
            // An interface without alternate settings, as some configurations have, is also in the list.
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
        // SAFETY: the caller passes a valid pointer for the result.
        unsafe { *tree = Box::into_raw(Box::new(of_all)) };
    }))
}

unsafe extern "C" fn free_configuration(tree: *mut ConfigurationDescriptor) {
    // SAFETY: the tree comes from `configuration`.
    drop(unsafe { Box::from_raw(tree) });
}

unsafe extern "C" fn bus_number(_device: *mut RawDevice) -> u8 {
    9
}

unsafe extern "C" fn address(_device: *mut RawDevice) -> u8 {
    7
}

unsafe extern "C" fn ports(_device: *mut RawDevice, ports: *mut u8, _room: c_int) -> c_int {
    // SAFETY: the caller passes a valid pointer for the result.
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
        // SAFETY: the caller passes a valid pointer for the result.
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
    code(world(handle).enter("claim").map(|mut inside| inside.leaked[3] += 1))
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
    // SAFETY: the transfer comes from `new_transfer`.
    let transfer = unsafe { Box::from_raw(transfer) };
    let world = world(transfer.handle);
    let address = ptr::from_ref(&*transfer).cast_mut();
    let has_it = world.with(|inside| {
        inside.pending.contains(&address) || inside.endings.iter().any(|ending| ending.transfer == address)
    });
    assert!(!has_it, "a transfer is freed that libusb has");
}

unsafe extern "C" fn submit(transfer: *mut RawTransfer) -> c_int {
    // SAFETY: the caller passes a valid transfer.
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
        inside.ring();
    });
    world.changed.notify_all();
    code(done)
}

unsafe extern "C" fn cancel(transfer: *mut RawTransfer) -> c_int {
    // SAFETY: the caller passes a valid transfer.
    let world = world(unsafe { (*transfer).handle });
    world.with(|inside| {
        inside.cancels += 1;
        let Some(at) = inside.pending.iter().position(|other| *other == transfer) else { return NOT_FOUND };
        inside.pending.remove(at);
        let moved = match inside.reaction {
            ReportReaction::None { moved } if !to_host(transfer) => moved,
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
    // SAFETY: the caller passes a valid limit.
    let limit = unsafe { Duration::new((*limit).tv_sec as u64, (*limit).tv_usec as u32 * 1000) };
    let mut inside = world.inside.lock();
    inside.event_waits += 1;
    if inside.signals > 0 {
        inside.signals -= 1;
        inside.ring();
        return INTERRUPTED;
    }
    // A wait of [`LONG`] or more does not time out, so that the test hangs if the wait is not interrupted.
    while inside.endings.is_empty() && !inside.interrupted && inside.event_errors == 0 {
        if limit < LONG {
            world.changed.wait_for(&mut inside, limit);
            break;
        }
        world.changed.wait(&mut inside);
    }
    if inside.event_errors > 0 {
        inside.event_errors -= 1;
        inside.ring();
        return IO;
    }
    inside.interrupted = false;
    let endings = std::mem::take(&mut inside.endings);
    inside.ring();
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

unsafe extern "C" fn descriptors(context: *mut RawContext) -> *const *const PollDescriptor {
    let inside = world(context).inside.lock();
    let Some((read, _)) = &inside.bell else { return ptr::null() };
    let one = PollDescriptor { descriptor: read.as_raw_fd(), events: libc::POLLIN };
    // The leaked memory is small, and is freed when the test program ends.
    let list: &[*const PollDescriptor; 2] =
        Box::leak(Box::new([Box::into_raw(Box::new(one)).cast_const(), ptr::null()]));
    list.as_ptr()
}

unsafe extern "C" fn free_descriptors(_list: *const *const PollDescriptor) {}

unsafe extern "C" fn packet(
    handle: *mut RawHandle,
    endpoint: c_uchar,
    buffer: *mut c_uchar,
    length: c_int,
    moved: *mut c_int,
    limit_ms: c_uint,
) -> c_int {
    assert!(limit_ms > 0, "a transfer without a limit");
    let is_to_host = endpoint & 0x80 != 0;
    let done = world(handle).enter(if is_to_host { "receive" } else { "send" }).and_then(|mut inside| {
        let count = if is_to_host {
            let bytes = inside.packets.pop_front().filter(|bytes| !bytes.is_empty()).ok_or(TIMEOUT)?;
            let count = bytes.len().min(length as usize);
            // SAFETY: the caller's buffer has `length` bytes.
            unsafe { ptr::copy_nonoverlapping(bytes.as_ptr(), buffer, count) };
            count
        } else {
            // SAFETY: the caller's buffer has `length` bytes.
            let bytes = unsafe { std::slice::from_raw_parts(buffer, length as usize) };
            let answer = inside.answer_packet.as_mut().map(|answer| answer(bytes));
            inside.packets.extend(answer);
            bytes.len()
        };
        // SAFETY: the caller passes a valid pointer for the result.
        unsafe { *moved = count as c_int };
        Ok(())
    });
    code(done)
}
