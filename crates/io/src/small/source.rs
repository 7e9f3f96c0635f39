//! What `--pack small` codes: the clouds and the offsets of a scene as tables of fields, in the order of the file.

use super::field::Follows;
use super::sensitivity::Sensitivity;
use instgs_vk::math::morton::morton_order;
use instgs_vk::math::smallest_three::{normal_scale, smallest_three};
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::offset_runs::sources_of_records;
use instgs_vk::scene::parameters::Parameter;

/// Largest steps: beyond them a change is no longer small, and what sensitivity says of it is wrong.
const MOST_LOG_SCALE: f32 = 0.4;
const MOST_LOGIT: f32 = 1.0;
const MOST_QUAT: f32 = 0.25;
const MOST_SH: f32 = 0.3;
/// Steps without sensitivity: a size changes by at most 2.5 %, an opacity by at most 1/80, the base colour (0.282 times SH)
/// by at most 0.7 of 255 levels; a position by 1/32 of its Gaussian's size.
const FIXED_LOG_SCALE: f32 = 0.05;
const FIXED_LOGIT: f32 = 0.1;
const FIXED_QUAT: f32 = std::f32::consts::FRAC_1_SQRT_2 / 127.0;
const FIXED_SH: f32 = 0.02;
const FIXED_MEAN_PER_SIZE: f64 = 1.0 / 16.0;
/// Offsets are spread over more values than what they change, and many: their steps are twice those.
const OFFSETS: f32 = 2.0;

/// A cloud, or the offsets: rows with several fields.
pub(super) struct Table {
    /// The first part of its tensors' names.
    pub(super) group: &'static str,
    pub(super) rows: usize,
    pub(super) fields: Vec<Field>,
    /// Step of each row's position without sensitivity, in the unit of positions.
    pub(super) fixed_mean_steps: Vec<f64>,
}

/// A tensor of a table.
pub(super) struct Field {
    pub(super) name: &'static str,
    /// Shape of a row in the tensor.
    pub(super) shape: Vec<usize>,
    /// The values, row by row: as they are coded, or as they are if they cannot be.
    pub(super) values: Vec<f32>,
    pub(super) can_be_coded: bool,
    pub(super) parts: Vec<FieldPart>,
    pub(super) centred: bool,
    pub(super) delta: bool,
}

/// Columns of a field with one step per class.
pub(super) struct FieldPart {
    pub(super) columns: usize,
    pub(super) follows: Follows,
    /// See [`Sensitivity`], by row; empty if unknown.
    pub(super) sensitivity: Vec<f32>,
    /// Limit of its steps.
    pub(super) most: f32,
    pub(super) fixed: FixedStep,
}

/// The step of a part without sensitivity.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum FixedStep {
    /// The same for all rows.
    Same(f32),
    /// That of the row in [`Table::fixed_mean_steps`]: the part is a position.
    OfSize,
}

impl Field {
    /// True if its values are positions, or offsets of them.
    pub(super) fn is_position(&self) -> bool {
        self.parts.iter().any(|part| part.fixed == FixedStep::OfSize)
    }
}

/// The tables of a scene that its file holds.
pub(super) fn tables(scene: &InstancedScene, sensitivity: Option<&Sensitivity>) -> Vec<Table> {
    // Unknown tensors may be parallel to the clouds, whose order must then not change.
    let reorder = scene.foreign_tensors.is_empty();
    let scales = quat_scales(scene);
    let mut first = Rows::default();
    let mut cloud = |group, cloud: &Gaussians, order: Option<Vec<u32>>, quats_free: bool| {
        let order = order.unwrap_or_else(|| (0..cloud.len() as u32).collect());
        let table = cloud_table(group, cloud, &order, quats_free, &first.sensitivity(sensitivity, cloud, &order));
        first.advance(cloud);
        table
    };
    let mut out = vec![cloud("template", &scene.templates, None, scales.is_some())];
    out.push(cloud("own", &scene.own, own_order(scene).filter(|_| reorder), true));
    out.push(cloud("background", &scene.background, reorder.then(|| morton_order(&scene.background.means)), true));
    out.push(offsets_table(scene, sensitivity, scales.as_deref()));
    out
}

/// How many rows of each parameter precede a cloud.
#[derive(Default)]
struct Rows {
    sources: usize,
    bands: [usize; 4],
}

const BANDS: [Parameter; 4] = [Parameter::Sh0, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3];
const SOURCES: [Parameter; 4] = [Parameter::Means, Parameter::Quats, Parameter::LogScales, Parameter::OpacityLogits];

impl Rows {
    /// The sensitivity of a cloud's rows in `order`, for `SOURCES` and then the SH bands; empty where unknown.
    fn sensitivity(&self, all: Option<&Sensitivity>, cloud: &Gaussians, order: &[u32]) -> [Vec<f32>; 8] {
        let of = |parameter: Parameter, first: usize| {
            let rows = all.and_then(|all| all.rows[parameter].get(first..first + cloud.len()));
            rows.map_or(Vec::new(), |rows| order.iter().map(|&i| rows[i as usize]).collect())
        };
        std::array::from_fn(|i| match SOURCES.get(i) {
            Some(&parameter) => of(parameter, self.sources),
            None => of(BANDS[i - 4], self.bands[i - 4]),
        })
    }

    fn advance(&mut self, cloud: &Gaussians) {
        self.sources += cloud.len();
        for (band, rows) in self.bands.iter_mut().enumerate() {
            *rows += if band as u32 <= cloud.sh_degree { cloud.len() } else { 0 };
        }
    }
}

/// The own Gaussians of each instance along a Morton curve; `None` if instances share some.
fn own_order(scene: &InstancedScene) -> Option<Vec<u32>> {
    let mut ranges: Vec<_> = scene.own_ranges.iter().filter(|range| range.count > 0).collect();
    ranges.sort_unstable_by_key(|range| range.first);
    let mut out = Vec::with_capacity(scene.own.len());
    for range in ranges {
        if range.first as usize != out.len() {
            return None;
        }
        let rows = range.first as usize..(range.first + range.count) as usize;
        out.extend(morton_order(&scene.own.means[rows]).into_iter().map(|i| range.first + i));
    }
    (out.len() == scene.own.len()).then_some(out)
}

/// Size of a Gaussian: geometric mean of its standard deviations.
fn size(log_scales: &[f32; 3]) -> f64 {
    let size = (log_scales.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0).exp();
    if size.is_finite() { size } else { 0.0 }
}

fn field(name: &'static str, shape: &[usize], values: Vec<f32>, parts: Vec<FieldPart>) -> Field {
    let can_be_coded = !values.is_empty() && values.iter().all(|value| value.is_finite());
    Field { name, shape: shape.to_vec(), values, can_be_coded, parts, centred: false, delta: false }
}

fn cloud_table(
    group: &'static str,
    cloud: &Gaussians,
    order: &[u32],
    quats_free: bool,
    sensitivity: &[Vec<f32>; 8],
) -> Table {
    let rows = || order.iter().map(|&i| i as usize);
    let part = |columns: usize, follows: Follows, of: usize, most: f32, fixed: FixedStep| FieldPart {
        columns,
        follows,
        sensitivity: sensitivity[of].clone(),
        most,
        fixed,
    };
    let means = rows().flat_map(|i| cloud.means[i]).collect();
    let means = Field {
        delta: true,
        ..field("means", &[3], means, vec![part(3, Follows::Shape, 0, f32::MAX, FixedStep::OfSize)])
    };
    let parts: Option<Vec<(usize, [f32; 3])>> = rows().map(|i| smallest_three(&cloud.quats[i])).collect();
    let quats: Vec<f32> = rows().flat_map(|i| cloud.quats[i]).collect();
    // Sensitivity is that of the quaternion as it is; of the unit one it is its length squared times as much.
    let of_unit: Vec<f32> =
        (rows().zip(&sensitivity[1])).map(|(i, &s)| s * cloud.quats[i].iter().map(|v| v * v).sum::<f32>()).collect();
    let quat_parts = vec![
        FieldPart {
            columns: 1,
            follows: Follows::Nothing,
            sensitivity: Vec::new(),
            most: 1.0,
            fixed: FixedStep::Same(1.0),
        },
        FieldPart { sensitivity: of_unit, ..part(3, Follows::Shape, 1, MOST_QUAT, FixedStep::Same(FIXED_QUAT)) },
    ];
    let coded = parts
        .filter(|_| quats_free)
        .map(|parts| parts.iter().flat_map(|&(largest, [a, b, c])| [largest as f32, a, b, c]).collect::<Vec<f32>>());
    let quats = match coded {
        Some(values) => field("quats", &[4], values, quat_parts),
        None => Field { can_be_coded: false, ..field("quats", &[4], quats, quat_parts) },
    };
    let log_scales = rows().flat_map(|i| cloud.log_scales[i]).collect();
    let log_scales = field(
        "log_scales",
        &[3],
        log_scales,
        vec![part(3, Follows::Shape, 2, MOST_LOG_SCALE, FixedStep::Same(FIXED_LOG_SCALE))],
    );
    let logits = rows().map(|i| cloud.opacity_logits[i]).collect();
    let logits = field(
        "opacity_logits",
        &[],
        logits,
        vec![part(1, Follows::Colour, 3, MOST_LOGIT, FixedStep::Same(FIXED_LOGIT))],
    );
    let c = cloud.sh_coefficients();
    let sh = rows().flat_map(|i| cloud.sh[i * c..][..c].as_flattened()).copied().collect();
    let bands = (0..=cloud.sh_degree as usize)
        .map(|l| part(3 * (2 * l + 1), Follows::Colour, 4 + l, MOST_SH, FixedStep::Same(FIXED_SH)));
    let sh = field("sh", &[c, 3], sh, bands.collect());
    Table {
        group,
        rows: cloud.len(),
        fields: vec![means, quats, Field { centred: true, ..log_scales }, Field { centred: true, ..logits }, sh],
        fixed_mean_steps: rows().map(|i| FIXED_MEAN_PER_SIZE * size(&cloud.log_scales[i])).collect(),
    }
}

/// What normalising the template's quaternions multiplies them by, by offset record, so that offsets can follow; `None` if
/// they cannot, because a record belongs to several Gaussians, or if a quaternion has no length: then all stay as they are.
fn quat_scales(scene: &InstancedScene) -> Option<Vec<f32>> {
    if scene.offsets.quats.is_empty() {
        return Some(Vec::new());
    }
    let scales: Option<Vec<f64>> = scene.templates.quats.iter().map(normal_scale).collect();
    let (rows, several) = sources_of_records(&scene.offset_runs(), scene.offsets.len());
    let of = |scales: Vec<f64>| rows.iter().map(|row| row.map_or(1.0, |row| scales[row as usize] as f32)).collect();
    scales.filter(|_| !several).map(of)
}

fn offsets_table(scene: &InstancedScene, sensitivity: Option<&Sensitivity>, quat_scales: Option<&[f32]>) -> Table {
    let offsets = &scene.offsets;
    let rows = offsets.len();
    let of = |parameter: Parameter| {
        let all = sensitivity.map_or(&[][..], |all| &all.rows[parameter]);
        // Rows of SH above 0 are coefficients: a record has several.
        let each = all.len() / rows.max(1);
        if each == 0 { Vec::new() } else { all.chunks(each).map(|c| c.iter().sum::<f32>() / each as f32).collect() }
    };
    let part = |columns: usize, follows: Follows, parameter: Parameter, most: f32, fixed: FixedStep| {
        vec![FieldPart { columns, follows, sensitivity: of(parameter), most, fixed }]
    };
    let means = offsets.means.as_flattened().to_vec();
    let means =
        field("means", &[3], means, part(3, Follows::Shape, Parameter::OffsetMeans, f32::MAX, FixedStep::OfSize));
    let sh_dc = offsets.sh_dc.as_flattened().to_vec();
    let sh_dc = field(
        "sh_dc",
        &[3],
        sh_dc,
        part(3, Follows::Colour, Parameter::OffsetShDc, MOST_SH, FixedStep::Same(OFFSETS * FIXED_SH)),
    );
    let logits =
        part(1, Follows::Colour, Parameter::OffsetOpacityLogits, MOST_LOGIT, FixedStep::Same(OFFSETS * FIXED_LOGIT));
    let logits = field("opacity_logits", &[], offsets.opacity_logits.clone(), logits);
    let mut fields = vec![means, sh_dc, logits];
    if !offsets.sh_rest.is_empty() {
        let rest = offsets.sh_rest.len() / rows;
        let parts =
            part(3 * rest, Follows::Colour, Parameter::OffsetShRest, MOST_SH, FixedStep::Same(OFFSETS * FIXED_SH));
        fields.push(field("sh_rest", &[rest, 3], offsets.sh_rest.as_flattened().to_vec(), parts));
    }
    if !offsets.log_scales.is_empty() {
        let parts = part(
            3,
            Follows::Shape,
            Parameter::OffsetLogScales,
            MOST_LOG_SCALE,
            FixedStep::Same(OFFSETS * FIXED_LOG_SCALE),
        );
        fields.push(field("log_scales", &[3], offsets.log_scales.as_flattened().to_vec(), parts));
    }
    if !offsets.quats.is_empty() {
        let mut parts =
            part(4, Follows::Shape, Parameter::OffsetQuats, MOST_QUAT, FixedStep::Same(OFFSETS * FIXED_QUAT));
        let scale = |record: usize| quat_scales.map_or(1.0, |scales| scales[record]);
        parts[0].sensitivity.iter_mut().enumerate().for_each(|(r, s)| *s /= scale(r).powi(2));
        let quats = offsets.quats.iter().enumerate().flat_map(|(r, quat)| quat.map(|v| v * scale(r))).collect();
        fields.push(field("quats", &[4], quats, parts));
    }
    let (template_rows, _) = sources_of_records(&scene.offset_runs(), rows);
    let step = |row: &Option<u32>| {
        let size = row.map_or(0.0, |row| size(&scene.templates.log_scales[row as usize]));
        f64::from(OFFSETS) * FIXED_MEAN_PER_SIZE * size
    };
    Table { group: "offset", rows, fields, fixed_mean_steps: template_rows.iter().map(step).collect() }
}
