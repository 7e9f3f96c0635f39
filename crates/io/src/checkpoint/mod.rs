//! Checkpoints: named tensors and strings in one safetensors file, with a checksum over every byte.
//!
//! `RUN/checkpoints/step_0000500.safetensors` holds the state after 500 steps. The same state gives the same bytes.
//! Metadata in addition to the caller's: `format`, `step`, and `checksum`, the CRC-32 (hexadecimal) of the whole file
//! with eight zeros in place of the checksum itself.

use std::collections::BTreeMap;
use std::path::Path;

use flate2::Crc;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::safetensors_header::{Entry, header};
use super::{IoError, Place, atomic_write, read_bytes};

mod folder;

pub use folder::{KEEP, Newest, file_name, is_any_in, latest, prune, save};

const FORMAT: &str = "instgs-checkpoint/1";
/// Metadata keys that are written by this module.
const RESERVED: [&str; 3] = ["format", "step", "checksum"];
/// The text before the checksum's digits. It occurs once, since JSON escapes quotes within strings.
const CHECKSUM_KEY: &[u8] = b"\"checksum\":\"";
/// Placeholder for the checksum while it is computed.
const NO_CHECKSUM: &str = "00000000";
/// Number of values converted to bytes at a time: a checkpoint may have gigabytes, and is not copied as a whole.
const VALUES_AT_ONCE: usize = 1 << 16;

/// The state of a run after `step` steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Checkpoint {
    /// Number of finished steps.
    pub step: u64,
    /// The state's arrays by name.
    pub tensors: BTreeMap<String, Tensor>,
    /// Strings by name; `format`, `step` and `checksum` are reserved.
    pub metadata: BTreeMap<String, String>,
}

/// A named array of a checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Dimensions, slowest first; their product is the number of values.
    pub shape: Vec<usize>,
    /// The values, row major.
    pub values: Values,
}

/// The values of a tensor.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// 32-bit floats; preserved bit by bit.
    F32(Vec<f32>),
    /// Unsigned 32-bit integers.
    U32(Vec<u32>),
    /// Unsigned 64-bit integers.
    U64(Vec<u64>),
}

/// An element type of tensors.
pub trait Element: Sized {
    /// Unwraps the values; `None` if they have another type.
    fn take(values: Values) -> Option<Vec<Self>>;
    /// Wraps values for a tensor.
    fn give(values: Vec<Self>) -> Values;
    /// Name of the type in safetensors.
    const NAME: &'static str;
}

macro_rules! element {
    ($rust:ty, $variant:ident) => {
        impl Element for $rust {
            fn take(values: Values) -> Option<Vec<Self>> {
                if let Values::$variant(values) = values { Some(values) } else { None }
            }
            fn give(values: Vec<Self>) -> Values {
                Values::$variant(values)
            }
            const NAME: &'static str = stringify!($variant);
        }
    };
}
element!(f32, F32);
element!(u32, U32);
element!(u64, U64);

impl Values {
    /// Number of values of the tensor.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::U64(v) => v.len(),
        }
    }

    /// True if there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn dtype(&self) -> (&'static str, usize) {
        match self {
            Self::F32(_) => ("F32", 4),
            Self::U32(_) => ("U32", 4),
            Self::U64(_) => ("U64", 8),
        }
    }

    /// Passes the values as little-endian bytes to `take`, in pieces.
    fn for_bytes<E>(&self, mut take: impl FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
        let mut buffer = Vec::with_capacity(8 * VALUES_AT_ONCE);
        macro_rules! pieces {
            ($values:expr) => {
                $values.chunks(VALUES_AT_ONCE).try_for_each(|piece| {
                    buffer.clear();
                    piece.iter().for_each(|v| buffer.extend_from_slice(&v.to_le_bytes()));
                    take(&buffer)
                })
            };
        }
        match self {
            Self::F32(values) => pieces!(values),
            Self::U32(values) => pieces!(values),
            Self::U64(values) => pieces!(values),
        }
    }
}

impl Checkpoint {
    /// Adds a tensor; the product of `shape` must be the number of values, or writing fails.
    pub fn put<T: Element>(&mut self, name: &str, shape: &[usize], values: Vec<T>) {
        self.tensors.insert(name.into(), Tensor { shape: shape.into(), values: T::give(values) });
    }

    /// Removes and returns a tensor of shape `[rows, inner...]` with any number of rows; `path` is only used in
    /// messages.
    ///
    /// # Errors
    /// There is no tensor of that name, or it has another type or shape.
    pub fn take<T: Element>(&mut self, name: &str, inner: &[usize], path: &Path) -> Result<Vec<T>, IoError> {
        let error = |what: String| IoError::new(path, what).at(Place::Tensor(name.into()));
        let tensor = self.tensors.remove(name).ok_or_else(|| error("is missing".into()))?;
        if tensor.shape.len() != inner.len() + 1 || tensor.shape[1..] != *inner {
            let want: Vec<String> = std::iter::once("N".into()).chain(inner.iter().map(usize::to_string)).collect();
            return Err(error(format!("has the shape {:?}, not [{}]", tensor.shape, want.join(", "))));
        }
        let (found, _) = tensor.values.dtype();
        T::take(tensor.values).ok_or_else(|| error(format!("has the type {found}, not {}", T::NAME)))
    }

    /// Writes the file atomically: on failure the old file remains.
    ///
    /// # Errors
    /// A shape does not match its values, metadata has a reserved name, or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), IoError> {
        let mut head = self.header(path)?;
        let mut crc = Crc::new();
        crc.update(&head);
        let order = self.order();
        for (_, tensor) in &order {
            let infallible: Result<(), std::convert::Infallible> = tensor.values.for_bytes(|bytes| {
                crc.update(bytes);
                Ok(())
            });
            let Ok(()) = infallible;
        }
        if let Some(digits) = checksum_digits(&head).and_then(|range| head.get_mut(range)) {
            digits.copy_from_slice(format!("{:08x}", crc.sum()).as_bytes());
        }
        atomic_write(path, |out| {
            out.write_all(&head)?;
            order.iter().try_for_each(|(_, tensor)| tensor.values.for_bytes(|bytes| out.write_all(bytes)))
        })
    }

    /// Reads a file and verifies its checksum.
    ///
    /// # Errors
    /// The file cannot be read, is truncated or damaged, or is not a checkpoint of this version.
    pub fn read(path: &Path) -> Result<Self, IoError> {
        parse(&read_bytes(path)?, path)
    }

    /// The tensors with the widest type first, so that all are aligned, then by name.
    fn order(&self) -> Vec<(&String, &Tensor)> {
        let mut order: Vec<_> = self.tensors.iter().collect();
        order.sort_by_key(|(_, tensor)| std::cmp::Reverse(tensor.values.dtype().1));
        order
    }

    /// Length field and header, with [`NO_CHECKSUM`] for the checksum.
    fn header(&self, path: &Path) -> Result<Vec<u8>, IoError> {
        let mut metadata = self.metadata.clone();
        for (name, value) in RESERVED.iter().zip([FORMAT, &self.step.to_string(), NO_CHECKSUM]) {
            if metadata.insert((*name).into(), value.into()).is_some() {
                let error = IoError::new(path, "cannot write: the name is reserved by the format");
                return Err(error.at(Place::Field(format!("metadata {name}"))));
            }
        }
        let order = self.order();
        for (name, Tensor { shape, values }) in &order {
            let count = shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
            if count != Some(values.len()) {
                let what = format!("cannot write: {} values do not have the shape {shape:?}", values.len());
                return Err(IoError::new(path, what).at(Place::Tensor((*name).clone())));
            }
        }
        let entries = order.iter().map(|(name, tensor)| {
            let (dtype, size) = tensor.values.dtype();
            Entry { name, dtype, shape: &tensor.shape, bytes: size * tensor.values.len() }
        });
        header(&metadata, entries).map_err(|e| IoError::new(path, format!("cannot write: {e}")))
    }
}

/// Advice about a checkpoint that is of no use.
pub const OF_NO_USE: &str = "remove it, and the run computes anew what it held";

/// Parses the bytes of a checkpoint; `path` is only used in messages.
///
/// # Errors
/// The same as [`Checkpoint::read`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<Checkpoint, IoError> {
    let damaged = |what: &str| IoError::new(path, format!("is damaged: {what}")).advise(OF_NO_USE);
    let malformed = |e| IoError::new(path, format!("is not a whole checkpoint: {e}")).advise(OF_NO_USE);
    let (length, header) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
    let tensors = SafeTensors::deserialize(bytes).map_err(malformed)?;
    let mut metadata: BTreeMap<String, String> =
        header.metadata().iter().flatten().map(|(k, v)| (k.clone(), v.clone())).collect();
    match metadata.remove("format").as_deref() {
        Some(FORMAT) => {}
        Some(other) if other.starts_with("instgs-checkpoint/") => {
            let error = IoError::new(path, format!("has the format {other}, not {FORMAT}"));
            return Err(error.advise("continue it with the version of instgs-vk that wrote it"));
        }
        _ => return Err(IoError::new(path, "is not a checkpoint of instgs-vk").advise("move it out of the run folder")),
    }
    let (head, data) = bytes.split_at_checked(8 + length).ok_or_else(|| damaged("it is too short"))?;
    let mut head = head.to_vec();
    let stated = metadata.remove("checksum").unwrap_or_default();
    let digits = checksum_digits(&head).and_then(|range| head.get_mut(range));
    digits.ok_or_else(|| damaged("it has no checksum"))?.copy_from_slice(NO_CHECKSUM.as_bytes());
    let mut crc = Crc::new();
    crc.update(&head);
    crc.update(data);
    if stated != format!("{:08x}", crc.sum()) {
        return Err(damaged("its content does not match its checksum"));
    }
    let step = metadata.remove("step").and_then(|s| s.parse().ok()).ok_or_else(|| damaged("it has no step"))?;
    let tensors = tensors.iter().map(|(name, view)| Ok((name.to_owned(), tensor(name, &view, path)?)));
    Ok(Checkpoint { step, tensors: tensors.collect::<Result<_, IoError>>()?, metadata })
}

fn tensor(name: &str, view: &TensorView<'_>, path: &Path) -> Result<Tensor, IoError> {
    let data = view.data();
    let words = || data.as_chunks::<4>().0.iter();
    let values = match view.dtype() {
        Dtype::F32 => Values::F32(words().map(|&b| f32::from_le_bytes(b)).collect()),
        Dtype::U32 => Values::U32(words().map(|&b| u32::from_le_bytes(b)).collect()),
        Dtype::U64 => Values::U64(data.as_chunks::<8>().0.iter().map(|&b| u64::from_le_bytes(b)).collect()),
        other => {
            let what = format!("has the type {other:?}, which checkpoints do not have");
            return Err(IoError::new(path, what).at(Place::Tensor(name.into())));
        }
    };
    Ok(Tensor { shape: view.shape().to_vec(), values })
}

/// Position of the checksum's digits in the header.
fn checksum_digits(head: &[u8]) -> Option<std::ops::Range<usize>> {
    let start = head.windows(CHECKSUM_KEY.len()).position(|w| w == CHECKSUM_KEY)? + CHECKSUM_KEY.len();
    (start + NO_CHECKSUM.len() <= head.len()).then_some(start..start + NO_CHECKSUM.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    type Test = Result<(), Box<dyn std::error::Error>>;

    pub(super) fn sample(step: u64) -> Checkpoint {
        let mut checkpoint = Checkpoint { step, ..Checkpoint::default() };
        let odd = f32::from_bits(0x7FC0_1234);
        checkpoint.put("adam.means", &[2, 3], vec![1.0f32, -0.0, f32::MIN_POSITIVE / 2.0, f32::INFINITY, 3.5, odd]);
        checkpoint.put("counts", &[3, 1], vec![0u32, 7, u32::MAX]);
        checkpoint.put("z.random", &[1], vec![u64::MAX - step]);
        checkpoint.put("empty", &[0, 4], Vec::<f32>::new());
        let config = "steps = 5\n\"checksum\":\"00000000\" \\ ä";
        checkpoint.metadata = [("config".to_owned(), config.to_owned()), ("a".into(), String::new())].into();
        checkpoint
    }

    fn bytes_of(checkpoint: &Checkpoint) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x");
        checkpoint.write(&path)?;
        Ok(std::fs::read(path)?)
    }

    fn bits(checkpoint: &Checkpoint) -> Vec<u32> {
        match &checkpoint.tensors["adam.means"].values {
            Values::F32(values) => values.iter().map(|v| v.to_bits()).collect(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_written_is_read_bit_by_bit_and_bytes_repeat() -> Test {
        let (checkpoint, path) = (sample(500), Path::new("x"));
        let bytes = bytes_of(&checkpoint)?;
        let mut back = parse(&bytes, path)?;
        assert_eq!(bits(&back), bits(&checkpoint));
        assert_eq!(bytes_of(&back)?, bytes);
        assert_eq!((back.step, &back.metadata), (500, &checkpoint.metadata));
        assert_eq!(back.take::<u32>("counts", &[1], path)?, [0, 7, u32::MAX]);
        assert_eq!(back.take::<u64>("z.random", &[], path)?, [u64::MAX - 500]);
        assert!(back.take::<f32>("empty", &[4], path)?.is_empty());
        // A file of more than one piece, which the safetensors crate reads in the same way.
        let mut large = Checkpoint::default();
        let values: Vec<u32> = (0..2 * VALUES_AT_ONCE as u32 + 5).collect();
        large.put("x", &[values.len()], values.clone());
        let bytes = bytes_of(&large)?;
        let foreign = SafeTensors::deserialize(&bytes)?;
        assert_eq!(foreign.tensor("x")?.data().len(), 4 * values.len());
        assert_eq!(parse(&bytes, path)?.take::<u32>("x", &[], path)?, values);
        Ok(())
    }

    #[test]
    fn a_file_cut_anywhere_is_refused() -> Test {
        let bytes = bytes_of(&sample(3))?;
        for length in 0..bytes.len() {
            assert!(parse(&bytes[..length], Path::new("x")).is_err(), "cut at {length}");
        }
        assert!(parse(&[&bytes[..], &[0; 8]].concat(), Path::new("x")).is_err());
        Ok(())
    }

    #[test]
    fn every_flipped_bit_is_noticed() -> Test {
        let mut bytes = bytes_of(&sample(3))?;
        for i in 0..bytes.len() {
            for bit in 0..8 {
                bytes[i] ^= 1 << bit;
                assert!(parse(&bytes, Path::new("x")).is_err(), "byte {i} bit {bit}");
                bytes[i] ^= 1 << bit;
            }
        }
        parse(&bytes, Path::new("x"))?;
        Ok(())
    }

    #[test]
    fn errors_name_the_tensor_or_the_reason() -> Test {
        let path = Path::new("x");
        let mut checkpoint = sample(1);
        let text = |e: Option<IoError>| e.map(|e| e.to_string()).unwrap_or_default();
        assert_eq!(text(checkpoint.take::<f32>("no", &[], path).err()), "x: tensor no: is missing");
        let shape = text(checkpoint.take::<f32>("adam.means", &[4], path).err());
        assert_eq!(shape, "x: tensor adam.means: has the shape [2, 3], not [N, 4]");
        let dtype = text(checkpoint.take::<f32>("counts", &[1], path).err());
        assert_eq!(dtype, "x: tensor counts: has the type U32, not F32");
        checkpoint.put("bad", &[2, 2], vec![1u32]);
        assert!(text(checkpoint.write(path).err()).contains("tensor bad: cannot write: 1 values"));
        let reserved = Checkpoint { metadata: [("step".into(), "9".into())].into(), ..Checkpoint::default() };
        assert!(text(reserved.write(path).err()).contains("metadata step"));
        let scene = crate::scene_write::scene_file_bytes(&Default::default(), path)?;
        assert_eq!(
            text(parse(&scene, path).err()),
            "x: is not a checkpoint of instgs-vk; move it out of the run folder"
        );
        Ok(())
    }
}
