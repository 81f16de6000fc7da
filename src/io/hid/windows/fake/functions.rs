//! The functions of the simulated Windows, with the signatures of the real ones.

use std::cell::Cell;
use std::ffi::c_void;
use std::ptr;
use std::slice;
use std::time::Duration;

use super::super::api::{
    Api, Bool, CR_SUCCESS, Capabilities, DeviceData, DeviceList, Guid, HIDP_SUCCESS, Handle, INTERFACE_DETAIL_SIZE,
    INVALID_HANDLE, InterfaceData, InterfaceDetail, OVERLAPPED, Overlapped, PRESENT_INTERFACES, Preparsed,
    READ_AND_WRITE, SHARED,
};
use super::super::codes::{NOTHING_YET, PENDING};
use super::{FakeWindows, HERE, Pending};

/// Error codes of Windows: `ERROR_FILE_NOT_FOUND`, `ERROR_NO_MORE_ITEMS`, `ERROR_INVALID_PARAMETER`, `ERROR_NOT_FOUND`.
const NO_FILE: u32 = 2;
const NO_MORE: u32 = 259;
const INVALID: u32 = 87;
const NOT_FOUND: u32 = 1168;
/// `CR_NO_SUCH_DEVNODE`: no device node has this number.
const NO_NODE: u32 = 13;
/// In the simulation a parent node has the number of its child node plus this value.
const GENERATION: u32 = 100;
/// A wait with this limit or a longer one has no limit in the simulation. So a test hangs, and shows the fault, if the
/// code under test does not interrupt such a wait.
const LONG_MS: u32 = 1000;
const CLASS: &str = "#{4d1e55b2-f16f-11cf-88cb-001111000030}";

thread_local! {
    static LAST_ERROR: Cell<u32> = const { Cell::new(0) };
}

pub(super) const FAKE: Api = Api {
    create_file,
    close_handle,
    read_file,
    write_file,
    cancel,
    create_port,
    next_completion,
    post_completion,
    create_event,
    set_event,
    wait_any,
    transfer_result,
    last_error,
    hid_class,
    preparsed,
    free_preparsed,
    capabilities,
    set_input_buffers,
    product_text,
    serial_text,
    list,
    free_list,
    interface,
    detail,
    parent,
    device_id,
};

/// The simulated Windows that has created a handle. A handle is the address of its [`FakeWindows`]. In the handle of an
/// event, the lowest bits show which of the backend's two events it is ([`FIRST`], [`SECOND`]).
fn world(handle: *mut c_void) -> &'static FakeWindows {
    // SAFETY: all handles here are made of the address of a `FakeWindows`, which is never freed.
    unsafe { &*handle.map_addr(|address| address & !LOWEST).cast::<FakeWindows>() }
}

/// The lowest bits of the address of a `FakeWindows`, which are 0 because of its alignment.
const LOWEST: usize = align_of::<FakeWindows>() - 1;
// The lowest bits of a handle that stands for one of the backend's two events.
const FIRST: usize = 2;
const SECOND: usize = 4;

/// The index of the event that this handle stands for, 0 or 1, in the backend's two events.
pub(super) fn event(handle: Handle) -> usize {
    match handle.addr() & LOWEST & !1 {
        FIRST => 0,
        SECOND => 1,
        other => panic!("{other} is no event"),
    }
}

fn here() -> &'static FakeWindows {
    HERE.get().expect("a test calls FakeWindows::candidates")
}

fn handle(world: &'static FakeWindows) -> Handle {
    world.with(|inside| inside.leaked += 1);
    ptr::from_ref(world).cast_mut().cast()
}

fn give_back(handle: *mut c_void) {
    world(handle).with(|inside| inside.leaked -= 1);
}

/// The return value of a Windows function that ends with this error code: true for 0; otherwise false, with the code as
/// the last error.
fn answer(code: u32) -> Bool {
    if code == 0 {
        return 1;
    }
    LAST_ERROR.set(code);
    0
}

unsafe extern "system" fn create_file(
    path: *const u16,
    access: u32,
    share: u32,
    _security: *const c_void,
    _how: u32,
    flags: u32,
    _template: Handle,
) -> Handle {
    let units = (0..).map_while(|at| {
        // SAFETY: the path ends with a zero.
        Some(unsafe { *path.add(at) }).filter(|unit| *unit != 0)
    });
    let path = String::from_utf16(&units.collect::<Vec<_>>()).expect("it was made of text");
    let moves = flags == OVERLAPPED;
    assert_eq!((access, share), (if moves { READ_AND_WRITE } else { 0 }, SHARED));
    let world = here();
    let refused = world.with(|inside| {
        inside.opened.push(path.clone());
        let listed = inside.devices.iter().any(|device| path == format!(r"\\?\{}{CLASS}", device.name));
        assert!(listed, "{path} is none of the list");
        inside.gone.map(|_| NO_FILE).or(inside.refused.filter(|_| moves))
    });
    if let Some(code) = refused {
        answer(code);
        return INVALID_HANDLE;
    }
    handle(world)
}

unsafe extern "system" fn close_handle(handle: Handle) -> Bool {
    give_back(handle);
    1
}

unsafe extern "system" fn read_file(
    handle: Handle,
    buffer: *mut u8,
    length: u32,
    _moved: *mut u32,
    overlapped: *mut Overlapped,
) -> Bool {
    answer(world(handle).with(|inside| match inside.gone {
        Some(code) => code,
        None if length != 513 => 1784,
        None => {
            inside.pending.push(Pending { overlapped, buffer, to_host: true });
            inside.deliver();
            PENDING
        }
    }))
}

unsafe extern "system" fn write_file(
    handle: Handle,
    buffer: *const u8,
    length: u32,
    _moved: *mut u32,
    overlapped: *mut Overlapped,
) -> Bool {
    // SAFETY: the caller's buffer has that many bytes.
    let report = unsafe { slice::from_raw_parts(buffer, length as usize) }.to_vec();
    let world = world(handle);
    let mut inside = world.inside.lock();
    while inside.held {
        world.changed.wait(&mut inside);
    }
    let code = inside.write(overlapped, buffer.cast_mut(), report);
    world.changed.notify_all();
    answer(code)
}

unsafe extern "system" fn cancel(handle: Handle, overlapped: *mut Overlapped) -> Bool {
    let found = world(handle).with(|inside| inside.cancel(overlapped));
    answer(if found { 0 } else { NOT_FOUND })
}

unsafe extern "system" fn create_port(file: Handle, port: Handle, _key: usize, threads: u32) -> Handle {
    assert!(port.is_null() && threads == 1, "a port of its own, for one thread");
    handle(world(file))
}

unsafe extern "system" fn next_completion(
    port: Handle,
    moved: *mut u32,
    _key: *mut usize,
    overlapped: *mut *mut Overlapped,
    limit_ms: u32,
) -> Bool {
    let world = world(port);
    let mut inside = world.inside.lock();
    // A wait of [`LONG_MS`] or more does not time out, so that the test hangs if the wait is not interrupted.
    while inside.ended.is_empty() && !inside.woken {
        if limit_ms < LONG_MS {
            world.changed.wait_for(&mut inside, Duration::from_millis(limit_ms.into()));
            break;
        }
        world.changed.wait(&mut inside);
    }
    let (which, code, bytes) = match inside.ended.pop_front() {
        Some(ended) => ended,
        None if std::mem::take(&mut inside.woken) => (ptr::null_mut(), 0, 0),
        None => (ptr::null_mut(), NOTHING_YET, 0),
    };
    world.changed.notify_all();
    // SAFETY: the caller passes valid pointers for the results.
    unsafe { (*overlapped, *moved) = (which, bytes as u32) };
    answer(code)
}

unsafe extern "system" fn post_completion(port: Handle, _moved: u32, _key: usize, _what: *mut Overlapped) -> Bool {
    world(port).with(|inside| inside.woken = true);
    1
}

unsafe extern "system" fn create_event(security: *const c_void, manual: Bool, set: Bool, name: *const u16) -> Handle {
    assert!(security.is_null() && name.is_null() && (manual, set) == (0, 0), "one that a wait takes away");
    let world = here();
    let is_second = world.with(|inside| {
        inside.has_event = !inside.has_event;
        !inside.has_event
    });
    handle(world).map_addr(|address| address | if is_second { SECOND } else { FIRST })
}

unsafe extern "system" fn set_event(handle: Handle) -> Bool {
    world(handle).with(|inside| inside.set[event(handle)] = true);
    1
}

unsafe extern "system" fn wait_any(count: u32, handles: *const Handle, all: Bool, limit_ms: u32) -> u32 {
    assert_eq!(all, 0, "any of them");
    // SAFETY: the caller passes that many handles.
    let handles = unsafe { slice::from_raw_parts(handles, count as usize) };
    let world = world(handles[0]);
    let mut inside = world.inside.lock();
    loop {
        if let Some(first) = handles.iter().position(|handle| inside.set[event(*handle)]) {
            inside.set[event(handles[first])] = false;
            return first as u32;
        }
        if limit_ms < LONG_MS {
            if world.changed.wait_for(&mut inside, Duration::from_millis(limit_ms.into())).timed_out() {
                return NOTHING_YET;
            }
        } else {
            world.changed.wait(&mut inside);
        }
    }
}

unsafe extern "system" fn transfer_result(
    _handle: Handle,
    overlapped: *mut Overlapped,
    moved: *mut u32,
    wait: Bool,
) -> Bool {
    assert_eq!(wait, 0, "it has ended");
    // SAFETY: the caller passes a valid transfer and a valid pointer for the result.
    let code = unsafe {
        *moved = (*overlapped).internal_high as u32;
        (*overlapped).internal as u32
    };
    answer(code)
}

unsafe extern "system" fn last_error() -> u32 {
    LAST_ERROR.get()
}

unsafe extern "system" fn hid_class(class: *mut Guid) {
    // SAFETY: the caller passes a valid pointer for the result.
    unsafe { *class = Guid { data1: 0x4D1E_55B2, ..Guid::default() } };
}

unsafe extern "system" fn preparsed(handle: Handle, preparsed: *mut Preparsed) -> u8 {
    if !world(handle).with(|inside| {
        inside.leaked += isize::from(inside.gone.is_none());
        inside.gone.is_none()
    }) {
        return 0;
    }
    // SAFETY: the caller passes a valid pointer for the result.
    unsafe { *preparsed = handle };
    1
}

unsafe extern "system" fn free_preparsed(preparsed: Preparsed) -> u8 {
    give_back(preparsed);
    1
}

unsafe extern "system" fn capabilities(preparsed: Preparsed, capabilities: *mut Capabilities) -> i32 {
    let [input_len, output_len] = world(preparsed).with(|inside| {
        let path = inside.opened.last().expect("it was opened");
        inside.devices.iter().find(|device| path.contains(device.name)).expect("one of the list").reports
    });
    // SAFETY: the caller passes a valid pointer for the result.
    unsafe { *capabilities = Capabilities { input_len, output_len, ..Capabilities::default() } };
    HIDP_SUCCESS
}

unsafe extern "system" fn set_input_buffers(handle: Handle, count: u32) -> u8 {
    world(handle).with(|inside| inside.keeps = Some(count));
    1
}

fn asked(handle: Handle, said: &str, text: *mut c_void, bytes: u32) -> u8 {
    world(handle).with(|inside| inside.asked += 1);
    let units: Vec<u16> = said.encode_utf16().chain([0]).collect();
    assert!(units.len() * 2 <= bytes as usize);
    // SAFETY: the caller's buffer has room for that many bytes.
    unsafe { text.cast::<u16>().copy_from_nonoverlapping(units.as_ptr(), units.len()) };
    1
}

unsafe extern "system" fn product_text(handle: Handle, text: *mut c_void, bytes: u32) -> u8 {
    asked(handle, "ECM-SK", text, bytes)
}

unsafe extern "system" fn serial_text(handle: Handle, text: *mut c_void, bytes: u32) -> u8 {
    asked(handle, "told", text, bytes)
}

unsafe extern "system" fn list(class: *const Guid, _names: *const u16, _window: Handle, flags: u32) -> DeviceList {
    // SAFETY: the caller passes valid pointers.
    assert_eq!((unsafe { (*class).data1 }, flags), (0x4D1E_55B2, PRESENT_INTERFACES), "HID devices that are there");
    handle(here())
}

unsafe extern "system" fn free_list(list: DeviceList) -> Bool {
    give_back(list);
    1
}

unsafe extern "system" fn interface(
    list: DeviceList,
    _device: *const c_void,
    _class: *const Guid,
    number: u32,
    data: *mut InterfaceData,
) -> Bool {
    let count = world(list).with(|inside| inside.devices.len());
    // SAFETY: the caller passes a valid structure, whose size is checked below.
    let data = unsafe { &mut *data };
    assert_eq!(data.size as usize, size_of::<InterfaceData>());
    data.reserved = number as usize;
    answer(if (number as usize) < count { 0 } else { NO_MORE })
}

unsafe extern "system" fn detail(
    list: DeviceList,
    interface: *const InterfaceData,
    detail: *mut InterfaceDetail,
    bytes: u32,
    _needed: *mut u32,
    device: *mut DeviceData,
) -> Bool {
    // SAFETY: the caller passes valid pointers.
    let (number, detail, device) = unsafe { ((*interface).reserved, &mut *detail, &mut *device) };
    if detail.size != INTERFACE_DETAIL_SIZE || device.size as usize != size_of::<DeviceData>() {
        return answer(INVALID);
    }
    let path = world(list).with(|inside| format!(r"\\?\{}{CLASS}", inside.devices[number].name));
    let units: Vec<u16> = path.encode_utf16().collect();
    assert!(bytes as usize >= 4 + 2 * units.len() + 2);
    detail.path[..units.len()].copy_from_slice(&units);
    detail.path[units.len()] = 0;
    device.node = number as u32;
    1
}

unsafe extern "system" fn parent(parent: *mut u32, node: u32, _flags: u32) -> u32 {
    let generation = (node / GENERATION) as usize;
    let there = here().with(|inside| inside.devices[(node % GENERATION) as usize].parents.len() > generation);
    if !there {
        return NO_NODE;
    }
    // SAFETY: the caller passes a valid pointer for the result.
    unsafe { *parent = node + GENERATION };
    CR_SUCCESS
}

unsafe extern "system" fn device_id(node: u32, id: *mut u16, units: u32, _flags: u32) -> u32 {
    let (number, generation) = ((node % GENERATION) as usize, (node / GENERATION) as usize);
    let name = here().with(|inside| inside.devices[number].parents[generation - 1]);
    let name: Vec<u16> = name.encode_utf16().chain([0]).collect();
    assert!(name.len() <= units as usize);
    // SAFETY: the caller's buffer has room for that many units.
    unsafe { id.copy_from_nonoverlapping(name.as_ptr(), name.len()) };
    CR_SUCCESS
}
