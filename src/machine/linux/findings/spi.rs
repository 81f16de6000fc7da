//! Judges whether a board or an ECM-XF on SPI can work: the spidev device, exchanges that are long enough, GPIO lines.

use super::{Finding, Machine};
use crate::address::keys::Scheme;
use crate::address::uri::LinkUri;
use crate::machine::Access;
use crate::machine::gpio::GpioChip;
use crate::machine::spi::{Bufsiz, FRAME_LEN, PACKET_LEN, SpiDevice};

/// The file that users are advised to write spidev's parameter to.
const PARAMETERS: &str = "/etc/modprobe.d/ecmsk.conf";

impl Machine {
    pub(super) fn spi_findings(&self, wanted: Option<&LinkUri>) -> Vec<Finding> {
        let link = wanted.filter(|link| matches!(link.scheme(), Scheme::Spi | Scheme::XfSpi));
        let other_end = match link.map(LinkUri::scheme) {
            Some(Scheme::XfSpi) => OtherEnd::Chip,
            _ => OtherEnd::Board,
        };
        let wanted = link.is_some();
        let devices = self.spi_devices();
        let mut all = Vec::new();
        let file = link.map(|link| link.path().to_owned());
        match &file {
            Some(file) if !devices.iter().any(|device| device.file == *file) => {
                let there: Vec<&str> = devices.iter().map(|device| device.file.as_str()).collect();
                let but = if there.is_empty() { String::new() } else { format!(", but {}", there.join(", ")) };
                all.push(Finding::wrong("spi", format!("no {file}{but}"), enable(!there.is_empty())).of(file));
            }
            None if devices.is_empty() => all.push(Finding::fine("spi", "no SPI device for programs (spidev)")),
            _ => {}
        }
        // Only the device of the link has to be usable: nothing shows whether other devices are meant for a board.
        let matters = |device: &SpiDevice| file.as_ref() == Some(&device.file);
        all.extend(devices.iter().map(|device| spi_permission(device, matters(device))));
        if wanted || !devices.is_empty() {
            all.push(bufsiz(self.bufsiz(), other_end, wanted));
            all.extend(gpio(&self.gpio_chips(), other_end, wanted));
        }
        all
    }

    /// Why the SPI device cannot be opened, and what to do; `None` if it can.
    pub fn spi_obstacle(&self, device: &SpiDevice) -> Option<Finding> {
        let bufsiz = bufsiz(self.bufsiz(), OtherEnd::Board, true);
        [spi_permission(device, true), bufsiz].into_iter().find(|finding| finding.blocks)
    }
}

/// The device at the other end of the SPI cable.
#[derive(Clone, Copy)]
enum OtherEnd {
    Board,
    Chip,
}

fn spi_permission(device: &SpiDevice, matters: bool) -> Finding {
    const CHECK: &str = "spi-permission";
    let finding = match device.access {
        Access::Granted => Finding::fine(CHECK, "this user may open it"),
        Access::Denied => Finding::wrong_if(matters, CHECK, "this user may not open it", GROUPS).blocking(),
        Access::Missing => {
            let next = "start udev, or give this container the file";
            Finding::wrong_if(matters, CHECK, format!("there is no {}", device.file), next).blocking()
        }
    };
    finding.of(&device.file)
}

/// The next step for a user without permission for SPI and GPIO.
const GROUPS: &str = "sudo ecmsk doctor --write-udev-rule; then sudo usermod -aG spi,gpio $USER (a group that does not exist: \
                      sudo groupadd -r spi), and log in again";

fn enable(is_another: bool) -> &'static str {
    if is_another {
        "correct the link"
    } else {
        "switch SPI on: on a Raspberry Pi dtparam=spi=on in /boot/firmware/config.txt, else a device tree overlay; and \
         sudo modprobe spidev"
    }
}

fn bufsiz(bufsiz: Option<Bufsiz>, other_end: OtherEnd, wanted: bool) -> Finding {
    const CHECK: &str = "spi-bufsiz";
    let Some(Bufsiz { bytes, is_built_in }) = bufsiz else {
        return Finding::wrong_if(wanted, CHECK, "the module spidev is not loaded", "sudo modprobe spidev");
    };
    let (least, what) = match other_end {
        OtherEnd::Board => (FRAME_LEN, "a frame has"),
        OtherEnd::Chip => (PACKET_LEN, "a packet has up to"),
    };
    if bytes >= least {
        return Finding::fine(CHECK, format!("exchanges of up to {bytes} bytes")).figure("bufsiz_bytes", bytes);
    }
    let next = if is_built_in {
        "put spidev.bufsiz=4096 on the kernel's command line, and start the machine again".to_owned()
    } else {
        format!(
            "echo 'options spidev bufsiz=4096' | sudo tee {PARAMETERS} && sudo modprobe -r spidev && sudo modprobe spidev"
        )
    };
    let found = format!("exchanges of up to {bytes} bytes; {what} {least}");
    Finding::wrong(CHECK, found, next).blocking().figure("bufsiz_bytes", bytes)
}

fn gpio(chips: &[GpioChip], other_end: OtherEnd, wanted: bool) -> Vec<Finding> {
    if chips.is_empty() {
        let found = match other_end {
            OtherEnd::Board => "no GPIO chip: BUSY cannot be watched, cycles of less than 1 ms are not possible",
            OtherEnd::Chip => "no GPIO chip: INT0 cannot be watched, idle_us= is left behind each packet",
        };
        return vec![Finding::fine("gpio", found)];
    }
    let finding = |chip: &GpioChip| {
        let lines: Vec<String> = chip.named_lines.iter().map(|(line, name)| format!("{name} {line}")).collect();
        let lines = if lines.is_empty() { String::new() } else { format!("; lines {}", lines.join(", ")) };
        let finding = match chip.access {
            Access::Granted => Finding::fine("gpio", format!("this user may use it{lines}")),
            Access::Denied => Finding::wrong_if(wanted, "gpio", format!("this user may not use it{lines}"), GROUPS),
            Access::Missing => Finding::fine("gpio", format!("there is no /dev/{}{lines}", chip.name)),
        };
        finding.of(&chip.name)
    };
    chips.iter().map(finding).collect()
}
