//! Orders kernel modules so that each comes after those that it depends on.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::Error;

/// The paths of the kernel modules with these names and of all that they depend on, in an order in which they can be loaded.
pub fn in_order(folder: &Path, wanted: &[&str]) -> Result<Vec<PathBuf>, Error> {
    let mut all = BTreeMap::new();
    collect(folder, &mut all)?;
    let mut order = Vec::new();
    for name in wanted {
        add(name, &all, &mut order)?;
    }
    Ok(order)
}

/// Collects all kernel modules below `folder` by name. `-` and `_` are the same in names.
fn collect(folder: &Path, all: &mut BTreeMap<String, PathBuf>) -> Result<(), Error> {
    for path in super::packages::list(folder)? {
        if path.is_dir() {
            collect(&path, all)?;
        } else if path.extension().is_some_and(|end| end == "ko")
            && let Some(name) = path.file_stem()
        {
            all.insert(normal(&name.to_string_lossy()), path);
        }
    }
    Ok(())
}

fn normal(name: &str) -> String {
    name.replace('-', "_")
}

fn add(name: &str, all: &BTreeMap<String, PathBuf>, order: &mut Vec<PathBuf>) -> Result<(), Error> {
    let path = all.get(&normal(name)).ok_or_else(|| Error::NoModule { name: name.to_owned() })?;
    if order.contains(path) {
        return Ok(());
    }
    let bytes = fs::read(path).map_err(Error::file("read", path))?;
    // This recursion ends, because kernel modules have no circular dependencies.
    for needed in depends(&bytes) {
        add(&needed, all, order)?;
    }
    order.push(path.clone());
    Ok(())
}

/// The names of the modules that a module depends on: the list `depends=a,b` between two 0 bytes of its file.
fn depends(module: &[u8]) -> Vec<String> {
    let said = module.split(|byte| *byte == 0).find_map(|text| text.strip_prefix(b"depends="));
    let names = String::from_utf8_lossy(said.unwrap_or_default()).into_owned();
    names.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_comes_after_those_it_needs_and_once() {
        let folder = tempfile::tempdir().unwrap();
        let write = |path: &str, depends: &str| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, format!("\x7FELF\0license=GPL\0depends={depends}\0rest")).unwrap();
        };
        write("usb/core.ko", "");
        write("usb/vhci-hcd.ko", "core,usbip_core");
        write("usbip-core.ko", "core");
        write("hid.ko", "core");
        write("notes.txt", "");
        let names = |wanted: &[&str]| {
            in_order(folder.path(), wanted).map(|order| {
                order.iter().map(|path| path.file_stem().unwrap().display().to_string()).collect::<Vec<_>>()
            })
        };
        assert_eq!(names(&["vhci-hcd", "hid"]).unwrap(), ["core", "usbip-core", "vhci-hcd", "hid"]);
        assert!(names(&["spi"]).unwrap_err().to_string().contains("spi"));
    }
}
