//! Names the library for the dynamic linker and checks `exports.txt` against the functions there are.
//!
//! rustc hands the linker a version script of its own, made from the `#[no_mangle]` functions, and GNU ld takes no
//! second one. So on Linux the list cannot steer the linker: it is compiled into a table of functions here (a listed
//! function that does not exist is an error of the build), and a test compares it with the symbol table of the library
//! (an exported symbol that is not listed fails there). For a DLL the list is the module definition: names without
//! decoration, and ordinals in its order.

use std::{env, error::Error, fmt::Write as _, fs, path::Path};

/// Changes with the binary interface, and only then.
const SONAME: &str = "libNEXTWUSBLib.so.0";
/// The DLL's name, which programs have in their import tables.
const DLL: &str = "NEXTWUSBLib.dll";
/// Bytes of a page, at which Windows maps the parts of a DLL.
const PAGE: u32 = 4096;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=exports.txt");
    println!("cargo:rerun-if-changed=build.rs");
    let list = fs::read_to_string("exports.txt")?;
    let names: Vec<&str> =
        list.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    let out = env::var("OUT_DIR")?;
    let out = Path::new(&out);
    fs::write(out.join("exports.rs"), exports_table(&names)?)?;
    match env::var("CARGO_CFG_TARGET_OS")?.as_str() {
        "linux" => {
            println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
            // Threads of an open board run code of the library: it stays in memory even if a program unloads it.
            println!("cargo:rustc-cdylib-link-arg=-Wl,-z,nodelete");
        }
        "windows" => {
            let definition = out.join("NEXTWUSBLib.def");
            fs::write(&definition, module_definition(&names)?)?;
            println!("cargo:rustc-cdylib-link-arg={}", definition.display());
            if env::var("CARGO_CFG_TARGET_ENV")? == "gnu" {
                // As in memory, so that the file can be mapped as it is. Otherwise Wine reads and copies all of it, which makes
                // loading it 20 times as long.
                println!("cargo:rustc-cdylib-link-arg=-Wl,--file-alignment,{PAGE}");
            }
        }
        _ => {}
    }
    Ok(())
}

fn exports_table(names: &[&str]) -> Result<String, Box<dyn Error>> {
    let mut table = String::from("const _: &[*const ()] = &[\n");
    for name in names {
        writeln!(table, "    {name} as *const (),")?;
    }
    table.push_str("];\n");
    Ok(table)
}

fn module_definition(names: &[&str]) -> Result<String, Box<dyn Error>> {
    let mut definition = format!("LIBRARY {DLL}\nEXPORTS\n");
    for (at, name) in names.iter().enumerate() {
        writeln!(definition, "    {name} @{}", at + 1)?;
    }
    Ok(definition)
}
