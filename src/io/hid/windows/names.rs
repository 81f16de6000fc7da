//! Windows' names of devices. They contain the vendor and product id and often the serial number, so that no device has
//! to be opened to read these values.

/// The parts of the path of a HID device, such as
/// `\\?\hid#vid_16c0&pid_05df&mi_00#7&1a2b3c4d&0&0000#{4d1e55b2-f16f-11cf-88cb-001111000030}`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceName {
    pub vendor: u16,
    pub product: u16,
    /// The device's instance, with `-` for characters that have a meaning in a URI: `7-1a2b3c4d-0-0000`. Windows
    /// derives it from the port or from the device's serial number, so that it stays the same when the device is
    /// plugged in again.
    pub instance: String,
}

/// Parses a device path; `None` if it is not the path of a HID device on USB.
pub fn of_path(path: &str) -> Option<DeviceName> {
    let path = path.to_ascii_lowercase();
    let mut parts = path.split('#');
    let (_hid, device, instance) = (parts.next()?, parts.next()?, parts.next()?);
    let id = |name: &str| {
        let value = device.split('&').find_map(|part| part.strip_prefix(name))?;
        u16::from_str_radix(value, 16).ok()
    };
    let (vendor, product) = (id("vid_")?, id("pid_")?);
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    let instance = instance.chars().map(|c| if plain(c) { c } else { '-' }).collect();
    Some(DeviceName { vendor, product, instance })
}

/// The serial number in the name of a USB device's instance, such as `USB\VID_16C0&PID_05DF\0001`. For a device without
/// a serial number Windows creates a name that contains `&`; the names of a device's interfaces (`&MI_00`) contain no
/// serial number.
pub fn serial_of(instance: &str) -> Option<&str> {
    let mut parts = instance.split('\\');
    let (bus, device, name) = (parts.next()?, parts.next()?, parts.next()?);
    let is_device = bus.eq_ignore_ascii_case("USB") && !device.to_ascii_uppercase().contains("&MI_");
    (is_device && !name.is_empty() && !name.contains('&')).then_some(name)
}

/// Decodes a text of Windows up to its terminating zero; `None` if it is empty.
pub fn text(wide: &[u16]) -> Option<String> {
    let end = wide.iter().position(|unit| *unit == 0).unwrap_or(wide.len());
    let text = String::from_utf16_lossy(&wide[..end]).trim().to_owned();
    (!text.is_empty()).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLASS: &str = "{4d1e55b2-f16f-11cf-88cb-001111000030}";

    /// WIN-40 A device path contains the ids and the instance of the device.
    #[test]
    fn a_path_says_ids_and_place() {
        let board = |instance: &str| DeviceName { vendor: 0x16C0, product: 0x05DF, instance: instance.to_owned() };
        let named = |middle: &str| of_path(&format!(r"\\?\{middle}#{CLASS}"));
        assert_eq!(named("hid#vid_16c0&pid_05df#7&1a2b3c4d&0&0000"), Some(board("7-1a2b3c4d-0-0000")));
        assert_eq!(named("HID#VID_16C0&PID_05DF&MI_00#256&0001&0&0"), Some(board("256-0001-0-0")), "Wine's");
        for other in ["hid#elan0001&col01#5&1&0&0000", "hid#vid_zz&pid_05df#1", "hid", "acpi#pnp0303#4&0"] {
            assert_eq!(named(other).filter(|named| named.product == 0x05DF), None, "{other}");
        }
        assert_eq!(of_path(""), None);
    }

    /// WIN-40 The last part of a device name is a serial number unless Windows has generated it.
    #[test]
    fn a_serial_number_is_what_windows_has_not_made_up() {
        assert_eq!(serial_of(r"USB\VID_16C0&PID_05DF\0001"), Some("0001"));
        assert_eq!(serial_of(r"USB\VID_16C0&PID_05DF\5&2F1E&0&3"), None);
        assert_eq!(serial_of(r"USB\VID_16C0&PID_05DF&MI_00\0001"), None);
        assert_eq!(serial_of(r"HID\VID_16C0&PID_05DF\0001"), None);
        assert_eq!(serial_of(""), None);
    }

    #[test]
    fn a_text_ends_at_its_zero() {
        let wide: Vec<u16> = "ECM-SK \0rest".encode_utf16().collect();
        assert_eq!(text(&wide).as_deref(), Some("ECM-SK"));
        assert_eq!((text(&[]), text(&[0, 65])), (None, None));
    }
}
