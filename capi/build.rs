//! Names the library for the dynamic linker and checks `exports.txt` against the functions there are.
//!
//! rustc hands the linker a version script of its own, made from the `#[no_mangle]` functions, and GNU ld takes no
//! second one. So on Linux the list cannot steer the linker: it is compiled into a table of functions here (a listed
//! function that does not exist is an error of the build), and a test compares it with the symbol table of the library
//! (an exported symbol that is not listed fails there). For a DLL the list is the module definition: names without
//! decoration, and ordinals in its order.

use std::process::Command;
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
                println!("cargo:rustc-cdylib-link-arg={}", version_resource(out)?);
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

/// What Windows shows of the file under Details, as an object for the linker.
fn version_resource(out: &Path) -> Result<String, Box<dyn Error>> {
    let number = |part: &str| env::var(format!("CARGO_PKG_VERSION_{part}"));
    let numbers = format!("{},{},{},0", number("MAJOR")?, number("MINOR")?, number("PATCH")?);
    let version = env::var("CARGO_PKG_VERSION")?;
    let description = env::var("CARGO_PKG_DESCRIPTION")?;
    let resource = format!(
        r#"1 VERSIONINFO
FILEVERSION {numbers}
PRODUCTVERSION {numbers}
FILEOS 0x40004
FILETYPE 2
BEGIN
  BLOCK "StringFileInfo"
  BEGIN
    BLOCK "040904B0"
    BEGIN
      VALUE "CompanyName", "ecmsk"
      VALUE "FileDescription", "{description}"
      VALUE "FileVersion", "{version}"
      VALUE "InternalName", "NEXTWUSBLib"
      VALUE "LegalCopyright", "MIT OR Apache-2.0"
      VALUE "OriginalFilename", "{DLL}"
      VALUE "ProductName", "ecmsk"
      VALUE "ProductVersion", "{version}"
    END
  END
  BLOCK "VarFileInfo"
  BEGIN
    VALUE "Translation", 0x0409, 0x04B0
  END
END
"#
    );
    let (source, object) = (out.join("version.rc"), out.join("version.o"));
    fs::write(&source, resource)?;
    let machine = match env::var("CARGO_CFG_TARGET_ARCH")?.as_str() {
        "x86" => "i686".to_owned(),
        other => other.to_owned(),
    };
    let windres = format!("{machine}-w64-mingw32-windres");
    let status = Command::new(&windres).arg(&source).arg(&object).status();
    let status = status.map_err(|error| format!("cannot start {windres} ({error}); it is part of MinGW's binutils"))?;
    if !status.success() {
        return Err(format!("{windres} {} failed ({status})", source.display()).into());
    }
    Ok(object.display().to_string())
}
