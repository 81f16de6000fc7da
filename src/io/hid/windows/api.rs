//! The functions of Windows that this crate uses. They are imported at load time, as in the vendor's library, because
//! loading `setupapi.dll` at run time takes longer than opening a board. All of them exist since Windows Vista.
//!
//! Names and layouts are those of `fileapi.h`, `ioapiset.h`, `minwinbase.h`, `hidsdi.h`, `hidpi.h`, `setupapi.h`,
//! `cfgmgr32.h`.

use std::ffi::c_void;

pub type Bool = i32;
pub type Handle = *mut c_void;

/// `INVALID_HANDLE_VALUE`: the handle of a file that could not be opened.
pub const INVALID_HANDLE: Handle = -1_isize as Handle;
/// `GENERIC_READ | GENERIC_WRITE`: access for reading and writing.
pub const READ_AND_WRITE: u32 = 0xC000_0000;
/// `FILE_SHARE_READ | FILE_SHARE_WRITE`: other programs may open the device too.
pub const SHARED: u32 = 3;
/// `OPEN_EXISTING`: opens a device, and creates nothing.
pub const OPEN_EXISTING: u32 = 3;
/// `FILE_FLAG_OVERLAPPED`: for asynchronous reads and writes.
pub const OVERLAPPED: u32 = 0x4000_0000;
/// `DIGCF_PRESENT | DIGCF_DEVICEINTERFACE`: lists the interfaces of connected devices.
pub const PRESENT_INTERFACES: u32 = 0x12;
/// `HIDP_STATUS_SUCCESS`: the status of a successful call of `hid.dll`.
pub const HIDP_SUCCESS: i32 = 0x0011_0000;
/// `CR_SUCCESS`: the result of a successful call of `cfgmgr32.dll`.
pub const CR_SUCCESS: u32 = 0;

/// The C layout of `GUID`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct Guid {
    pub data1: u32,
    pub data2: u16,
    pub data3: u16,
    pub data4: [u8; 8],
}

/// The C layout of `OVERLAPPED`.
#[repr(C)]
pub struct Overlapped {
    pub internal: usize,
    pub internal_high: usize,
    pub offset: u32,
    pub offset_high: u32,
    pub event: Handle,
}

/// The C layout of `SP_DEVICE_INTERFACE_DATA`. `setupapi.h` packs it on x86, which makes no difference.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct InterfaceData {
    pub size: u32,
    pub class: Guid,
    pub flags: u32,
    pub reserved: usize,
}

/// The C layout of `SP_DEVINFO_DATA`. `setupapi.h` packs it on x86, which makes no difference.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct DeviceData {
    pub size: u32,
    pub class: Guid,
    pub node: u32,
    pub reserved: usize,
}

/// The C layout of `SP_DEVICE_INTERFACE_DETAIL_DATA_W`, with room for a long path.
#[repr(C)]
pub struct InterfaceDetail {
    pub size: u32,
    pub path: [u16; PATH_LEN_MAX],
}

/// The size of the buffer for a device path with its terminating zero, in UTF-16 units. Paths of HID devices have about
/// 100 characters.
pub const PATH_LEN_MAX: usize = 1024;
/// The value of [`InterfaceDetail::size`]: the size of the C structure, which has room for one character of the path
/// and is packed on x86.
pub const INTERFACE_DETAIL_SIZE: u32 = if cfg!(target_pointer_width = "64") { 8 } else { 6 };

/// The C layout of `HIDP_CAPS`.
#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct Capabilities {
    pub usage: u16,
    pub usage_page: u16,
    pub input_len: u16,
    pub output_len: u16,
    pub rest: [u16; 28],
}

/// `PHIDP_PREPARSED_DATA`, an opaque pointer.
pub type Preparsed = *mut c_void;
/// `HDEVINFO`, an opaque handle.
pub type DeviceList = *mut c_void;

macro_rules! functions {
    ($($library:literal: { $($field:ident = $name:ident ($($argument:ty),*) $(-> $result:ty)?;)* })*) => {
        /// The functions of Windows; in tests those of a simulated Windows.
        #[derive(Clone, Copy)]
        pub struct Api {
            $($(pub $field: unsafe extern "system" fn($($argument),*) $(-> $result)?,)*)*
        }

        #[cfg(windows)]
        mod imported {
            use super::*;

            $(#[link(name = $library)]
            unsafe extern "system" {
                $(pub fn $name($(_: $argument),*) $(-> $result)?;)*
            })*
        }

        #[cfg(windows)]
        impl Api {
            /// The functions of the real Windows, imported at load time.
            pub const WINDOWS: Self = Self { $($($field: imported::$name,)*)* };
        }
    };
}

functions! {
    "kernel32": {
        create_file = CreateFileW(*const u16, u32, u32, *const c_void, u32, u32, Handle) -> Handle;
        close_handle = CloseHandle(Handle) -> Bool;
        read_file = ReadFile(Handle, *mut u8, u32, *mut u32, *mut Overlapped) -> Bool;
        write_file = WriteFile(Handle, *const u8, u32, *mut u32, *mut Overlapped) -> Bool;
        cancel = CancelIoEx(Handle, *mut Overlapped) -> Bool;
        create_port = CreateIoCompletionPort(Handle, Handle, usize, u32) -> Handle;
        next_completion = GetQueuedCompletionStatus(Handle, *mut u32, *mut usize, *mut *mut Overlapped, u32) -> Bool;
        post_completion = PostQueuedCompletionStatus(Handle, u32, usize, *mut Overlapped) -> Bool;
        create_event = CreateEventW(*const c_void, Bool, Bool, *const u16) -> Handle;
        set_event = SetEvent(Handle) -> Bool;
        wait_any = WaitForMultipleObjects(u32, *const Handle, Bool, u32) -> u32;
        transfer_result = GetOverlappedResult(Handle, *mut Overlapped, *mut u32, Bool) -> Bool;
        last_error = GetLastError() -> u32;
    }
    "hid": {
        hid_class = HidD_GetHidGuid(*mut Guid);
        preparsed = HidD_GetPreparsedData(Handle, *mut Preparsed) -> u8;
        free_preparsed = HidD_FreePreparsedData(Preparsed) -> u8;
        capabilities = HidP_GetCaps(Preparsed, *mut Capabilities) -> i32;
        set_input_buffers = HidD_SetNumInputBuffers(Handle, u32) -> u8;
        product_text = HidD_GetProductString(Handle, *mut c_void, u32) -> u8;
        serial_text = HidD_GetSerialNumberString(Handle, *mut c_void, u32) -> u8;
    }
    "setupapi": {
        list = SetupDiGetClassDevsW(*const Guid, *const u16, Handle, u32) -> DeviceList;
        free_list = SetupDiDestroyDeviceInfoList(DeviceList) -> Bool;
        interface = SetupDiEnumDeviceInterfaces(DeviceList, *const c_void, *const Guid, u32, *mut InterfaceData) -> Bool;
        detail = SetupDiGetDeviceInterfaceDetailW(
            DeviceList, *const InterfaceData, *mut InterfaceDetail, u32, *mut u32, *mut DeviceData) -> Bool;
        parent = CM_Get_Parent(*mut u32, u32, u32) -> u32;
        device_id = CM_Get_Device_IDW(u32, *mut u16, u32, u32) -> u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sizes match those of MinGW's compilers (`sizeof` of the types in Windows' headers).
    #[test]
    fn layouts_are_those_of_the_headers() {
        let word = size_of::<usize>();
        assert_eq!(size_of::<Guid>(), 16);
        assert_eq!(size_of::<Capabilities>(), 64);
        assert_eq!(size_of::<Overlapped>(), if word == 8 { 32 } else { 20 });
        assert_eq!(size_of::<InterfaceData>(), if word == 8 { 32 } else { 28 });
        assert_eq!(size_of::<DeviceData>(), if word == 8 { 32 } else { 28 });
        assert_eq!(std::mem::offset_of!(InterfaceDetail, path), 4);
    }
}
