//! Judges whether this machine can act as a board at its USB device port.

use super::{Finding, Machine};
use crate::machine::Access;
use crate::machine::gadget::{DeviceController, FunctionFs, GadgetFolder, GadgetOnController};

impl Machine {
    /// The checks of what `ecmsk serve gadget` needs: a device controller that is free, configfs with gadgets,
    /// FunctionFS, and permissions.
    pub fn gadget_findings(&self) -> Vec<Finding> {
        let controllers = self.device_controllers();
        let mut all = vec![controller(&controllers)];
        for one in &controllers {
            all.extend([speed(one), holder(one)]);
        }
        all.extend(folder(self.gadget_folder()));
        all.push(function(self.function_fs()));
        all
    }
}

fn controller(controllers: &[DeviceController]) -> Finding {
    const CHECK: &str = "gadget-controller";
    let names: Vec<&str> = controllers.iter().map(|one| one.name.as_str()).collect();
    match names[..] {
        [] => Finding::wrong(
            CHECK,
            "no USB port of this machine can be a device",
            "on a Raspberry Pi write dtoverlay=dwc2,dr_mode=peripheral into /boot/firmware/config.txt and start it again; for a \
             trial without a cable sudo modprobe dummy_hcd",
        )
        .blocking(),
        [name] => Finding::fine(CHECK, name),
        _ => Finding::advice(CHECK, names.join(", "), format!("name one: ecmsk serve gadget --udc {}", names[0])),
    }
}

fn speed(controller: &DeviceController) -> Finding {
    const CHECK: &str = "gadget-speed";
    let finding = match controller.maximum_speed.as_deref() {
        None => Finding::fine(CHECK, "not known"),
        Some(slow @ ("low-speed" | "full-speed")) => {
            Finding::wrong(CHECK, format!("{slow}: the board needs high speed"), "take another port or machine")
        }
        Some(fast) => Finding::fine(CHECK, fast),
    };
    finding.of(&controller.name)
}

fn holder(controller: &DeviceController) -> Finding {
    const CHECK: &str = "gadget-holder";
    let state = controller.state.as_deref().unwrap_or("its state is not known");
    let finding = match &controller.gadget {
        None => Finding::fine(CHECK, "free"),
        Some(GadgetOnController::Ours) => Finding::fine(CHECK, format!("ecmsk serve gadget has it: {state}")),
        Some(GadgetOnController::Other(name)) => Finding::wrong(
            CHECK,
            format!("another gadget has it ({name}): {state}"),
            "end what made it: often the module g_ether (sudo modprobe -r g_ether), or a service",
        )
        .blocking(),
    };
    finding.of(&controller.name)
}

fn folder(folder: GadgetFolder) -> Vec<Finding> {
    const CHECK: &str = "gadget-configfs";
    const RIGHTS: &str = "gadget-permission";
    match folder {
        GadgetFolder::NotMounted => {
            let next = "sudo modprobe libcomposite; sudo mount -t configfs none /sys/kernel/config";
            vec![Finding::wrong(CHECK, "configfs is not mounted", next).blocking()]
        }
        GadgetFolder::NoModule => {
            let next = "sudo modprobe libcomposite; at each start: echo libcomposite | sudo tee /etc/modules-load.d/ecmsk.conf";
            vec![Finding::wrong(CHECK, "the module libcomposite is not loaded", next).blocking()]
        }
        GadgetFolder::There(access) => {
            let rights = match access {
                Access::Granted => Finding::fine(RIGHTS, "this user may make a gadget"),
                _ => Finding::advice(RIGHTS, "root alone may make a gadget", "start ecmsk serve gadget with sudo"),
            };
            vec![Finding::fine(CHECK, "there"), rights]
        }
    }
}

fn function(function: FunctionFs) -> Finding {
    const CHECK: &str = "gadget-functionfs";
    match function {
        FunctionFs::Loaded => Finding::fine(CHECK, "loaded"),
        FunctionFs::Module => Finding::fine(CHECK, "the kernel loads it when it is needed"),
        FunctionFs::Missing => Finding::wrong(
            CHECK,
            "this kernel has no FunctionFS",
            "sudo modprobe usb_f_fs; if there is no such module take another kernel (CONFIG_USB_CONFIGFS_F_FS)",
        )
        .blocking(),
    }
}
