//! Checks whether a program finds a NEXTWUSBLib.dll of its own width (32 or 64 bits).

use ecmsk::machine::findings::Finding;

use super::contents::{Contents, Entry, LIBRARY, Library, stem, whose};
use crate::image::{Image, Managed};

/// The name of the check of programs in the output of `doctor`.
pub const CHECK: &str = "program";
/// A text that every program that uses the library contains, because the name of the library begins with it. The next
/// constant is the beginning of the names of the .NET assemblies.
const LIBRARY_STEM: &str = "NEXTWUSB";
const ASSEMBLY: &str = "NEXTWUSB_dotNET";

/// The finding about a program: which library it loads, or why it finds no library.
pub fn finding(program: &Entry, there: &Contents) -> Finding {
    let finding = match &program.image {
        Ok(image) => of_image(program, image, there),
        Err(why) => Finding::wrong(CHECK, why.clone(), "copy it anew from where it came from"),
    };
    finding.of(&program.name)
}

fn of_image(program: &Entry, image: &Image, there: &Contents) -> Finding {
    let kind = kind(image);
    // The code of a program for .NET 5 and later is in a DLL with the same name.
    let parts = there.others.iter().filter(|(name, _)| *name == stem(&program.name));
    let parts: Vec<&Image> =
        std::iter::once(image).chain(parts.filter_map(|(_, part)| part.image.as_ref().ok())).collect();
    let names = |name: &str| parts.iter().any(|part| part.names(name));
    if !names(LIBRARY_STEM) {
        return Finding::fine(CHECK, format!("{kind}; does not name {LIBRARY}, so it does not use it"));
    }
    let Some(folder) = image.width.folder() else {
        let next = format!("take a program for x86 or x64: there is no {LIBRARY} for others");
        return Finding::wrong(CHECK, format!("{kind}: not for this library's processors"), next);
    };
    let ours = there.assemblies.iter().any(|assembly| assembly.image.as_ref().is_ok_and(Image::is_ours));
    let takes = |library: &&Library| library.image.as_ref().is_ok_and(|library| library.width == image.width);
    let beside = there.libraries.iter().find(|library| library.folder.is_none());
    // The assemblies of this project also search the sub-folder for the width, and skip a library that does not fit.
    let elsewhere = there.libraries.iter().find(|library| library.folder == Some(folder));
    let elsewhere = elsewhere.filter(|_| ours && names(ASSEMBLY));
    if let Some(library) = beside.filter(takes).or(elsewhere.filter(takes)) {
        let whose = library.image.as_ref().map(whose).unwrap_or_default();
        return Finding::fine(CHECK, format!("{kind}; takes {} ({whose})", library.name));
    }
    let in_folder = there.libraries.iter().find(|library| library.folder == Some(folder)).filter(takes);
    let of_package = if in_folder.is_some() { "" } else { " of this project's package" };
    let source = format!("{folder}\\{LIBRARY}{of_package}");
    match beside.map(|library| &library.image) {
        Some(Ok(other)) => Finding::wrong(
            CHECK,
            format!(
                "{kind}, and the {LIBRARY} beside it is {} ({}): Windows does not load it (error 193, in .NET a \
                 BadImageFormatException)",
                other.width,
                whose(other)
            ),
            format!("put {source} in its place"),
        ),
        Some(Err(_)) => Finding::wrong(
            CHECK,
            format!("{kind}, and the {LIBRARY} beside it is broken"),
            format!("put {source} in its place"),
        ),
        None => Finding::wrong(
            CHECK,
            format!("{kind}, and there is no {LIBRARY} for it"),
            format!("copy {source} beside it"),
        ),
    }
}

fn kind(image: &Image) -> String {
    match image.managed {
        None => image.width.to_string(),
        Some(Managed::Fixed) => format!("{}, for .NET", image.width),
        Some(Managed::Any) => "for .NET and any CPU, 64-bit on a 64-bit Windows".to_owned(),
        Some(Managed::Prefers32) => "for .NET and any CPU, 32-bit preferred".to_owned(),
    }
}
