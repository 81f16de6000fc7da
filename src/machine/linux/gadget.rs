//! What the machine needs to be the board at a USB device port: a device controller, configfs with gadgets, FunctionFS.

use super::{Access, Machine};

/// Where the kernel lists the device controllers.
const CONTROLLERS: &str = "/sys/class/udc";
/// Where configfs is mounted.
const CONFIGFS: &str = "/sys/kernel/config";
/// The folder of configfs with all gadgets.
const GADGETS: &str = "/sys/kernel/config/usb_gadget";
/// The prefix of the gadgets of this project; the name of the controller follows.
const OURS: &str = "ecmsk-";

/// A USB device controller (UDC): a USB port by which the machine can be a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceController {
    /// The name of the controller, such as `fe980000.usb`, by which the option `--udc` of `ecmsk serve gadget` selects
    /// it.
    pub name: String,
    /// The highest speed, as the kernel names it, such as `high-speed`; `None` if it is not known.
    pub maximum_speed: Option<String>,
    /// The state of the controller as a USB device, such as `not attached` or `configured`; `None` if it is not known.
    pub state: Option<String>,
    /// The gadget that uses the controller; `None` if the controller is free.
    pub gadget: Option<GadgetOnController>,
}

/// Who has made the gadget that uses a device controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GadgetOnController {
    /// The gadget was made by `ecmsk serve gadget`.
    Ours,
    /// Another program or a kernel module has made the gadget. The text is the name of the gadget in configfs, or that
    /// of the module, such as `g_ether`.
    Other(String),
}

/// Whether gadgets can be made in the kernel's folder for them, `/sys/kernel/config/usb_gadget`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GadgetFolder {
    /// The folder exists. The field says whether this user may make gadgets in it.
    There(Access),
    /// The folder does not exist: configfs is mounted, but the module libcomposite is not loaded.
    NoModule,
    /// The folder does not exist, because configfs is not mounted.
    NotMounted,
}

/// Whether the kernel has FunctionFS, by which a program implements the functions of a gadget.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FunctionFs {
    /// FunctionFS is built into the kernel, or its module is loaded.
    Loaded,
    /// FunctionFS is a module that is not loaded. The kernel loads it when a gadget needs it.
    Module,
    /// This kernel has no FunctionFS.
    Missing,
}

impl Machine {
    /// All USB device controllers of the machine.
    pub fn device_controllers(&self) -> Vec<DeviceController> {
        let controller = |name: String| {
            let says = |file: &str| self.attribute(&format!("{CONTROLLERS}/{name}/{file}"));
            let known = |text: &String| text != "UNKNOWN";
            DeviceController {
                maximum_speed: says("maximum_speed").filter(known),
                state: says("state"),
                gadget: self.gadget_on(&name),
                name,
            }
        };
        self.names(CONTROLLERS).into_iter().map(controller).collect()
    }

    fn gadget_on(&self, controller: &str) -> Option<GadgetOnController> {
        let has = |gadget: &String| self.attribute(&format!("{GADGETS}/{gadget}/UDC")).as_deref() == Some(controller);
        let gadget = self.names(GADGETS).into_iter().find(has);
        // A module that is itself a gadget, such as g_ether, is in no folder of configfs.
        let gadget = gadget.or_else(|| self.attribute(&format!("{CONTROLLERS}/{controller}/function")))?;
        let is_ours = gadget.strip_prefix(OURS) == Some(controller);
        Some(if is_ours { GadgetOnController::Ours } else { GadgetOnController::Other(gadget) })
    }

    /// Whether configfs has the folder for gadgets, and whether this user may make gadgets in it.
    pub fn gadget_folder(&self) -> GadgetFolder {
        match self.access(GADGETS) {
            Access::Missing if self.is_mounted(CONFIGFS) => GadgetFolder::NoModule,
            Access::Missing => GadgetFolder::NotMounted,
            access => GadgetFolder::There(access),
        }
    }

    fn is_mounted(&self, folder: &str) -> bool {
        let mounts = self.text("/proc/self/mounts").unwrap_or_default();
        mounts.lines().any(|line| line.split(' ').nth(1) == Some(folder))
    }

    /// Whether the kernel has FunctionFS.
    pub fn function_fs(&self) -> FunctionFs {
        // The loaded module usb_f_fs has a folder in /sys/module, but registers its file system only when a gadget
        // first uses it. FunctionFS that is built into the kernel has no such folder, so the list of file systems is
        // searched too.
        let systems = self.text("/proc/filesystems").unwrap_or_default();
        if self.has("/sys/module/usb_f_fs")
            || systems.lines().any(|line| line.split_whitespace().last() == Some("functionfs"))
        {
            return FunctionFs::Loaded;
        }
        let list = self.kernel().map(|release| format!("/lib/modules/{release}/modules.order"));
        let modules = list.and_then(|list| self.text(&list)).unwrap_or_default();
        let is_there = modules.lines().any(|path| path.contains("/usb_f_fs.ko"));
        if is_there { FunctionFs::Module } else { FunctionFs::Missing }
    }
}
