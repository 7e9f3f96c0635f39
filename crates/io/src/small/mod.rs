//! `--pack small`: a scene in the fewest bytes at which its pictures stay what they are.
//!
//! Each tensor `NAME` of a cloud or of offsets becomes the U8 tensor `NAME.coded` (`field.rs`): its values are rounded to
//! steps and entropy coded (`entropy.rs`). Two classes per row, one for its shape and one for its colour, say how often the
//! steps are doubled or halved; they are the columns of `GROUP.precision.coded`.
//!
//! With a [`Sensitivity`], which says how much a change of each parameter changes the pictures of the training views, steps
//! are those at which every parameter adds the same error, and that error is such that the pictures stay as close as asked
//! for (`steps.rs`). Without one, positions follow the sizes of Gaussians and the other steps are fixed.
//!
//! Colours are coded as brightness and two differences (`opponent.rs`).
//!
//! Sizes and rotations are coded together, as the logarithms of covariances (`shapes.rs`).
//!
//! Positions, shapes, opacities and base colours are predicted from the Gaussian before (`field.rs`), in Morton order where the
//! order is free: the background's, and that of the own Gaussians of an instance.

mod entropy;
mod field;
mod opponent;
mod plan;
mod sensitivity;
mod shapes;
mod source;
mod steps;

pub use plan::SmallPlan;
pub use sensitivity::{Sensitivity, SmallOptions};
pub use shapes::LOG_COVARIANCES;
pub(crate) use shapes::{offset_shapes_from, shapes_from};

use crate::plausible::{most_gaussians, most_offsets};
use crate::scene_pack::floats;
use crate::step_columns::TableError;
use field::{Centre, Classes, Follows, Memory, Part, Plan};
use instgs_vk::math::smallest_three::whole_quat;
use instgs_vk::scene::instanced_scene::{ForeignTensor, InstancedScene};
use source::{Orders, Table};

/// Suffix of the name of a coded tensor.
pub const CODED: &str = ".coded";
/// Name of the tensor of a group's classes of precision, without the group and [`CODED`].
pub(crate) const PRECISION: &str = "precision";

/// True if so many rows of positions are plausible in a coded tensor of `bytes`, which is one of a cloud or of the group "offset".
pub(crate) fn is_plausible(group: &str, rows: usize, bytes: usize) -> bool {
    let most = if group == "offset" { most_offsets } else { most_gaussians };
    rows as u64 <= most(bytes as u64)
}

/// The number of rows of a coded tensor, and of values per row.
///
/// # Errors
/// There is no header, or it is impossible.
pub fn coded_shape(coded: &[u8]) -> Result<(usize, usize), TableError> {
    field::Header::of(coded).map(|header| (header.rows, header.width))
}

/// The parts of a coded tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct CodedStreams {
    /// Number of rows.
    pub rows: usize,
    /// Number of values per row.
    pub width: usize,
    /// Bytes of the header: steps, centres, and frequencies of tokens.
    pub header_bytes: usize,
    /// Bytes of the entropy-coded tokens.
    pub token_bytes: usize,
    /// Bytes of the lower bits, which are stored as they are.
    pub low_bytes: usize,
}

/// The parts of a coded tensor; `None` if it is damaged.
pub fn coded_streams(coded: &[u8]) -> Option<CodedStreams> {
    let header = field::Header::of(coded).ok()?;
    let [token_bytes, low_bytes] = header.stream_bytes(coded)?;
    let header_bytes = coded.len() - token_bytes - low_bytes;
    Some(CodedStreams { rows: header.rows, width: header.width, header_bytes, token_bytes, low_bytes })
}

/// The tensors of a scene's clouds and offsets by name, with steps that are the same for all scenes.
pub(crate) fn coded_tensors(scene: &InstancedScene) -> Vec<(String, ForeignTensor)> {
    let tables = source::tables(scene, &Orders::of(scene), None);
    coded_tables(&tables, &steps::plan(&tables, None))
}

/// The tensors of tables by name. Fields that cannot be coded (values that are not finite, rotations of zero length, empty ones, or
/// too far apart) stay floats.
fn coded_tables(tables: &[Table], steps: &[steps::TableSteps]) -> Vec<(String, ForeignTensor)> {
    let mut out = Vec::new();
    for (table, plan) in tables.iter().zip(steps) {
        // Only few scenes have own Gaussians; the other tensors are there even if empty.
        if table.rows > 0 || table.group != "own" {
            put_table(&mut out, table, plan);
        }
    }
    out
}

fn put_table(out: &mut Vec<(String, ForeignTensor)>, table: &Table, plan: &steps::TableSteps) {
    let group = table.group;
    let coded = |bytes: Vec<u8>| ForeignTensor { dtype: "U8".into(), shape: vec![bytes.len()], bytes };
    let mut any = false;
    for (f, field) in table.fields.iter().enumerate() {
        let name = format!("{group}.{}", field.name);
        let how = plan.of_field(f, field);
        let bytes = field.can_be_coded.then(|| field::encode(&field.values, table.rows, &how)).flatten();
        match bytes.filter(|bytes| !field.is_position() || is_plausible(group, table.rows, bytes.len())) {
            Some(bytes) => {
                any = true;
                out.push((name + CODED, coded(bytes)));
            }
            // Only positions can be too far apart: what is coded in another form, colours and logarithms of covariances, has
            // steps that reach.
            None => out.push((name, floats(&[&[table.rows], &field.shape[..]].concat(), &field.values))),
        }
    }
    if any {
        let classes: Vec<f32> =
            plan.classes.shape.iter().zip(&plan.classes.colour).flat_map(|(&s, &c)| [s, c].map(f32::from)).collect();
        // The classes of neighbours are alike in some scenes, and in others not.
        let of = |memory: Memory| {
            let part = Part { columns: 1, step: 1.0, most: 1.0, follows: Follows::Nothing, memory };
            let classes_of_rows = Classes::default();
            let how = Plan { parts: &[part; 2], classes: &classes_of_rows, centre: Centre::Whole, opponent: false };
            field::encode(&classes, table.rows, &how)
        };
        let bytes = [Memory::NONE, Memory::ALL].into_iter().filter_map(of).min_by_key(Vec::len);
        out.extend(bytes.map(|bytes| (format!("{group}.{PRECISION}{CODED}"), coded(bytes))));
    }
}

/// The classes of precision of a group's rows, from the bytes of its tensor.
///
/// # Errors
/// The bytes are not a whole table of classes.
pub(crate) fn decoded_classes(coded: &[u8]) -> Result<RowClasses, TableError> {
    let (_, width) = coded_shape(coded)?;
    let values = field::decode(coded, &Classes::default())?;
    let class = |value: f32| {
        Some(value as u8).filter(|&class| f32::from(class) == value && usize::from(class) < entropy::CONTEXTS)
    };
    let classes: Option<Vec<u8>> = values.iter().map(|&value| class(value)).collect();
    let classes = classes.filter(|_| width == 2).ok_or(TableError::Classes)?;
    let column = |c: usize| classes.iter().skip(c).step_by(2).copied().collect();
    Ok(RowClasses(Classes { shape: column(0), colour: column(1) }))
}

/// The classes of precision of a group's rows.
#[derive(Default)]
pub(crate) struct RowClasses(Classes);

/// The values of a coded field, row by row; if `is_quats`, four for each rotation as formats 3 and 4 code it.
///
/// # Errors
/// The bytes are not a whole field of rows with these classes, or a rotation is invalid.
pub(crate) fn decoded_values(coded: &[u8], classes: &RowClasses, is_quats: bool) -> Result<Vec<f32>, TableError> {
    let values = field::decode(coded, &classes.0)?;
    if !is_quats {
        return Ok(values);
    }
    let whole = |&[index, a, b, c]: &[f32; 4]| {
        (0..4).find(|&i| i as f32 == index).and_then(|index| whole_quat(index, [a, b, c]))
    };
    let quats: Option<Vec<[f32; 4]>> = values.as_chunks::<4>().0.iter().map(whole).collect();
    quats.map(|quats| quats.as_flattened().to_vec()).ok_or(TableError::Rotation)
}
