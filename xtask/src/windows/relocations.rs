//! Disables wrong base relocations of a DLL.
//!
//! binutils' `ld` (2.40) writes a base relocation for each offset of a thread-local variable (SECREL32), although offsets do
//! not depend on the base. If Windows loads the DLL at another base, which it may always do, it changes the offset, and the
//! program accesses wrong memory. An offset is small and an address is inside the image, so the two can be told apart.

use object::pe::{IMAGE_DIRECTORY_ENTRY_BASERELOC, IMAGE_REL_BASED_ABSOLUTE, IMAGE_REL_BASED_HIGHLOW};
use object::read::pe::{ImageNtHeaders, ImageOptionalHeader as _, PeFile, PeFile32, PeFile64};
use object::{FileKind, LittleEndian, Object as _, ReadRef};

/// Disables the wrong relocations of a DLL in memory, by giving them a type that Windows ignores; returns their number.
///
/// # Errors
/// The file is no valid DLL; the error says why.
pub fn mend(dll: &mut [u8]) -> Result<usize, String> {
    let wrong = match FileKind::parse(&*dll) {
        Ok(FileKind::Pe32) => wrong(&PeFile32::parse(&*dll).map_err(|error| error.to_string())?),
        Ok(FileKind::Pe64) => wrong(&PeFile64::parse(&*dll).map_err(|error| error.to_string())?),
        _ => Err("it is no DLL".to_owned()),
    }?;
    for &entry in &wrong {
        // The upper four bits of a relocation entry are its type. Windows ignores the type "absolute".
        dll[entry + 1] = dll[entry + 1] & 0x0F | (IMAGE_REL_BASED_ABSOLUTE.0 as u8) << 4;
    }
    Ok(wrong.len())
}

/// The file offsets of the wrong relocation entries: 32-bit entries that refer to a place with a value that is no address
/// inside the image.
fn wrong<P: ImageNtHeaders>(file: &PeFile<'_, P>) -> Result<Vec<usize>, String> {
    let (data, sections) = (file.data(), file.section_table());
    let text = |error: object::Error| error.to_string();
    let directory = file.data_directory(IMAGE_DIRECTORY_ENTRY_BASERELOC).ok_or("it has no base relocations")?;
    let table = directory.virtual_address.get(LittleEndian);
    let (mut place, _) = sections.pe_file_range_at(table).ok_or("its relocations are in no section")?;
    let base = file.relative_address_base();
    let image = base..base + u64::from(file.nt_headers().optional_header().size_of_image());
    let mut blocks = file.data_directories().relocation_blocks(data, &sections).map_err(text)?.ok_or("none")?;
    let mut wrong = Vec::new();
    while let Some(block) = blocks.next().map_err(text)? {
        // A block has the relocations of one page of memory (4 KiB). It begins with two 32-bit words: the address of the
        // page, and the length of the block in bytes.
        place += 8;
        for entry in (place..place + block.size() - 8).step_by(2) {
            let word = u16::from_le_bytes(bytes(data, entry)?);
            if word >> 12 != IMAGE_REL_BASED_HIGHLOW.0 {
                continue;
            }
            let moved = block.virtual_address() + u32::from(word & 0x0FFF);
            let (at, _) = sections.pe_file_range_at(moved).ok_or("it relocates what is in no section")?;
            if !image.contains(&u32::from_le_bytes(bytes(data, at)?).into()) {
                wrong.push(entry as usize);
            }
        }
        place += block.size() - 8;
    }
    Ok(wrong)
}

fn bytes<'data, const N: usize>(data: impl ReadRef<'data>, at: u32) -> Result<[u8; N], &'static str> {
    let bytes = data.read_bytes_at(at.into(), N as u64).map_err(|()| "it is cut off")?;
    Ok(bytes.try_into().expect("as many as were asked for"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_dll_is_refused() {
        assert!(mend(&mut []).is_err());
        assert!(mend(&mut b"MZ and no more".to_vec()).is_err());
    }
}
