//! The type of lists of children in a crate file.
//!
//! `openusd` 0.6 writes them as arrays of tokens (`token[]`, type 11). Pixar's library reads them only as vectors of tokens (type
//! 41), which have the same bytes, and finds no prim in such a file. So the types are exchanged in the file's table of fields.

use std::io::Cursor;

use openusd::usdc::CrateFile;

/// Names in a crate file of the fields that list children.
pub(super) const LISTS: [&str; 2] = ["primChildren", "properties"];
/// Where the file says at which byte its list of sections starts.
const SECTIONS_AT: usize = 16;
/// Bytes of a section's entry in that list, and of its name; the first byte of the section and its length follow the name.
const ENTRY: usize = 32;
const ENTRY_NAME: usize = 16;
/// A value is described by 64 bits: the highest says whether it is an array, bits 48 to 55 are its type.
const ARRAY_BIT: u64 = 1 << 63;
const TYPE_MASK: u64 = 0xff << 48;
const TOKEN_ARRAY: u64 = ARRAY_BIT | 11 << 48;
const TOKEN_VECTOR: u64 = 41 << 48;

/// Gives the lists of children of a file that `openusd` has written the type that they must have. The table of fields is
/// written again behind everything else, and the file's list of sections then points there.
///
/// # Errors
/// In words, what of the file is not as it should be.
pub(super) fn as_token_vectors(mut file: Vec<u8>) -> Result<Vec<u8>, String> {
    let read = CrateFile::open(Cursor::new(&file)).map_err(|e| e.to_string())?;
    let values = read.fields.iter().flat_map(|field| {
        let value = field.value_rep.0;
        let is_list = LISTS.contains(&read.tokens[field.token_index].as_str());
        let is_array = value & (ARRAY_BIT | TYPE_MASK) == TOKEN_ARRAY;
        let value = if is_list && is_array { value & !(ARRAY_BIT | TYPE_MASK) | TOKEN_VECTOR } else { value };
        value.to_le_bytes()
    });
    let values = lz4_flex::compress(&values.collect::<Vec<u8>>());

    // The table is the number of fields, their compressed names, and the compressed descriptions of their values.
    let number = read.sections.iter().position(|section| section.name() == "FIELDS").ok_or("there are no fields")?;
    let start = read.sections[number].start as usize;
    let names_end = start + 2 * size_of::<u64>() + word(&file, start + size_of::<u64>())?;
    let mut table = file.get(start..names_end).ok_or("the table of fields is cut off")?.to_vec();
    // Before a compressed block stand its length and the number of further blocks, none.
    table.extend((values.len() as u64 + 1).to_le_bytes());
    table.push(0);
    table.extend(values);

    let entry = word(&file, SECTIONS_AT)? + size_of::<u64>() + number * ENTRY + ENTRY_NAME;
    let place = [file.len() as u64, table.len() as u64].map(u64::to_le_bytes);
    let entry = file.get_mut(entry..entry + place.as_flattened().len()).ok_or("the list of sections is cut off")?;
    entry.copy_from_slice(place.as_flattened());
    file.extend(table);
    Ok(file)
}

fn word(file: &[u8], at: usize) -> Result<usize, String> {
    let word = file.get(at..).and_then(|rest| rest.first_chunk()).ok_or("the file is cut off")?;
    Ok(u64::from_le_bytes(*word) as usize)
}
