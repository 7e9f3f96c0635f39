//! The header of a safetensors file. It is assembled here because the safetensors crate keeps metadata in a hash map,
//! whose order changes from run to run: the same data must give the same bytes.

use std::collections::BTreeMap;

/// Length of the size field before the header; the header is padded to a multiple of it.
const LENGTH_BYTES: usize = 8;

/// Describes a tensor of the file, without its data.
pub(crate) struct Entry<'a> {
    pub(crate) name: &'a str,
    /// Element type in safetensors' notation, for instance "F32".
    pub(crate) dtype: &'a str,
    pub(crate) shape: &'a [usize],
    /// Length of the data in bytes.
    pub(crate) bytes: usize,
}

/// Size field and header, a multiple of 8 bytes; the tensors' data must follow in the order of `entries`.
pub(crate) fn header<'a>(
    metadata: &BTreeMap<String, String>,
    entries: impl Iterator<Item = Entry<'a>>,
) -> serde_json::Result<Vec<u8>> {
    let mut text = format!("{{\"__metadata__\":{}", serde_json::to_string(metadata)?);
    let mut end = 0;
    for Entry { name, dtype, shape, bytes } in entries {
        let begin = end;
        end += bytes;
        let name = serde_json::to_string(name)?;
        text += &format!(",{name}:{{\"dtype\":\"{dtype}\",\"shape\":{shape:?},\"data_offsets\":[{begin},{end}]}}");
    }
    text.push('}');
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(LENGTH_BYTES) - text.len()));
    let mut out = (text.len() as u64).to_le_bytes().to_vec();
    out.extend_from_slice(text.as_bytes());
    Ok(out)
}
