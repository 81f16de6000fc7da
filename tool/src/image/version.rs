//! Reads the texts of a version resource, which Windows shows under Properties, Details.
//!
//! Source: VS_VERSIONINFO, StringFileInfo, StringTable and String in the Windows documentation. All four structures
//! begin in the same way: total length, length of the value, its kind, and a name in UTF-16 that ends with 0. Then
//! follow the value and the inner structures, each aligned to four bytes.

/// The length of the head before the name, in bytes.
const HEAD: usize = 6;
/// \[OURS] The largest number of texts that are read; a resource has about ten.
const TEXTS_MAX: usize = 100;

/// A structure of the version resource, of any of the four kinds: its name, and the bytes after the name.
struct Part<'data> {
    name: String,
    /// The bytes after the name: the value and the inner structures.
    rest: &'data [u8],
}

/// The text with this name, such as `CompanyName`, in the first language that has it. `None` if there is none, or if
/// the resource is invalid.
pub fn text(resource: &[u8], name: &str) -> Option<String> {
    let (root, _) = part(resource)?;
    // The outermost structure has a value (VS_FIXEDFILEINFO), which is skipped to reach the inner structures.
    let fixed = usize::from(u16::from_le_bytes([*resource.get(2)?, *resource.get(3)?]));
    let tables = parts(root.rest.get(round(fixed)..)?).filter(|part| part.name == "StringFileInfo");
    let texts = tables.flat_map(|all| parts(all.rest)).flat_map(|language| parts(language.rest));
    let found = texts.take(TEXTS_MAX).find(|text| text.name == name)?;
    Some(utf16(found.rest))
}

fn parts(mut data: &[u8]) -> impl Iterator<Item = Part<'_>> {
    std::iter::from_fn(move || {
        let (found, length) = part(data)?;
        data = data.get(round(length)..).unwrap_or_default();
        Some(found)
    })
    .take(TEXTS_MAX)
}

/// Reads the structure at the beginning of `data`, and returns it with its length in bytes. `None` if it is invalid.
fn part(data: &[u8]) -> Option<(Part<'_>, usize)> {
    let length = usize::from(u16::from_le_bytes([*data.first()?, *data.get(1)?]));
    let whole = data.get(..length)?;
    let text = whole.get(HEAD..)?;
    let end = text.chunks_exact(2).position(|unit| unit == [0, 0])?;
    let name = utf16(text);
    let rest = whole.get(round(HEAD + 2 * (end + 1))..).unwrap_or_default();
    Some((Part { name, rest }, length))
}

const fn round(at: usize) -> usize {
    at.next_multiple_of(4)
}

/// The text up to the terminating 0.
fn utf16(data: &[u8]) -> String {
    let units = data.chunks_exact(2).map(|unit| u16::from_le_bytes([unit[0], unit[1]]));
    let units = units.take_while(|unit| *unit != 0);
    char::decode_utf16(units).map(|unit| unit.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}
