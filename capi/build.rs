//! Names the library for the dynamic linker and checks `exports.txt` against the functions there are.
//!
//! rustc hands the linker a version script of its own, made from the `#[no_mangle]` functions, and GNU ld takes no
//! second one. So the list cannot steer the linker: it is compiled into a table of functions here (a listed function
//! that does not exist is an error of the build), and a test compares it with the symbol table of the library (an
//! exported symbol that is not listed fails there).

use std::{env, error::Error, fmt::Write as _, fs, path::Path};

/// Changes with the binary interface, and only then.
const SONAME: &str = "libNEXTWUSBLib.so.0";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=exports.txt");
    println!("cargo:rerun-if-changed=build.rs");
    exports_table()?;
    if env::var("CARGO_CFG_TARGET_OS")? == "linux" {
        println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
        // Threads of an open board run code of the library: it stays in memory even if a program unloads it.
        println!("cargo:rustc-cdylib-link-arg=-Wl,-z,nodelete");
    }
    Ok(())
}

fn exports_table() -> Result<(), Box<dyn Error>> {
    let list = fs::read_to_string("exports.txt")?;
    let names: Vec<&str> =
        list.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')).collect();
    let mut table = String::from("const _: &[*const ()] = &[\n");
    for name in names {
        writeln!(table, "    {name} as *const (),")?;
    }
    table.push_str("];\n");
    fs::write(Path::new(&env::var("OUT_DIR")?).join("exports.rs"), table)?;
    Ok(())
}
