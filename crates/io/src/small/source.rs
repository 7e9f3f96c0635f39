//! What `--pack small` codes: the clouds and the offsets of a scene as tables of fields, in the order of the file.

use super::field::{Follows, Memory};
use super::opponent::to_opponent;
use super::sensitivity::Sensitivity;
use instgs_vk::math::axes::AxisOrder;
use instgs_vk::math::covariance::normalised_quat;
use instgs_vk::math::morton::morton_order;
use instgs_vk::math::smallest_three::normal_scale;
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
/// by at most 1.2 of 255 levels; a position by 1/32 of its Gaussian's size.
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
    pub(super) opponent: bool,
}

/// Columns of a field with one step per class.
#[derive(Clone)]
pub(super) struct FieldPart {
    pub(super) columns: usize,
    pub(super) follows: Follows,
    /// See [`Sensitivity`], by row; empty if unknown.
    pub(super) sensitivity: Vec<f32>,
    /// Limit of its steps.
    pub(super) most: f32,
    pub(super) fixed: FixedStep,
    pub(super) memory: Memory,
}

impl FieldPart {
    /// For values that neighbours in the table are alike in.
    fn like_neighbours(self) -> Self {
        Self { memory: Memory::Best, ..self }
    }
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
    let mut first = Rows::default();
    let mut cloud = |group, cloud: &Gaussians, order: Option<Vec<u32>>, axes: Option<&[AxisOrder]>| {
        let order = order.unwrap_or_else(|| (0..cloud.len() as u32).collect());
        let table = cloud_table(group, cloud, &order, axes, &first.sensitivity(sensitivity, cloud, &order));
        first.advance(cloud);
        table
    };
    let [of_templates, of_own, of_background] = [&scene.templates, &scene.own, &scene.background].map(axis_orders);
    let of_templates = of_templates.filter(|_| records_are_single(scene));
    let mut out = vec![cloud("template", &scene.templates, None, of_templates.as_deref())];
    out.push(cloud("own", &scene.own, own_order(scene).filter(|_| reorder), of_own.as_deref()));
    let order = reorder.then(|| morton_order(&scene.background.means));
    out.push(cloud("background", &scene.background, order, of_background.as_deref()));
    out.push(offsets_table(scene, sensitivity, of_templates.as_deref()));
    out
}

/// The order of the axes of each Gaussian in which sizes fall and quaternions have a positive w, the largest; `None` if a
/// rotation has no length or is not finite: then all stay as they are.
fn axis_orders(cloud: &Gaussians) -> Option<Vec<AxisOrder>> {
    let of = |(quat, sizes): (&[f32; 4], &[f32; 3])| {
        normal_scale(quat)?;
        Some(AxisOrder::sorted(*sizes, *quat))
    };
    cloud.quats.iter().zip(&cloud.log_scales).map(of).collect()
}

/// True if each offset record belongs to one Gaussian of a template at most, or offsets have no shape: then they can follow
/// when the template's axes change.
fn records_are_single(scene: &InstancedScene) -> bool {
    let offsets = &scene.offsets;
    offsets.quats.is_empty() && offsets.log_scales.is_empty()
        || !sources_of_records(&scene.offset_runs(), offsets.len()).1
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
    Field { name, shape: shape.to_vec(), values, can_be_coded, parts, centred: false, opponent: false }
}

/// A field of colours, `rgb` by coefficient; `bands` are parts for one of the three numbers of its coefficients.
fn colours(name: &'static str, shape: &[usize], rgb: &[f32], bands: Vec<FieldPart>) -> Field {
    let counts: Vec<usize> = bands.iter().map(|band| band.columns).collect();
    let parts = bands.into_iter().flat_map(|band| std::iter::repeat_n(band, 3)).collect();
    let coded = field(name, shape, to_opponent(rgb, &counts), parts);
    match coded.can_be_coded {
        true => Field { opponent: true, ..coded },
        false => Field { values: rgb.to_vec(), ..coded },
    }
}

fn cloud_table(
    group: &'static str,
    cloud: &Gaussians,
    order: &[u32],
    axes: Option<&[AxisOrder]>,
    sensitivity: &[Vec<f32>; 8],
) -> Table {
    let rows = || order.iter().map(|&i| i as usize);
    let part = |columns: usize, follows: Follows, of: usize, most: f32, fixed: FixedStep| {
        let sensitivity = sensitivity[of].clone();
        FieldPart { columns, follows, sensitivity, most, fixed, memory: Memory::NONE }
    };
    let means = rows().flat_map(|i| cloud.means[i]).collect();
    let means =
        field("means", &[3], means, vec![part(3, Follows::Shape, 0, f32::MAX, FixedStep::OfSize).like_neighbours()]);
    let sizes = rows().map(|i| axes.map_or(cloud.log_scales[i], |axes| axes[i].sizes(cloud.log_scales[i])));
    let sizes: Vec<[f32; 3]> = sizes.collect();
    // Of a unit quaternion whose w is the largest, the other three say all; the index of the largest is 0.
    let coded = |(axes, i): (&[AxisOrder], usize)| {
        let [_, x, y, z] = axes[i].quat(normalised_quat(cloud.quats[i].map(f64::from)));
        [0.0, x as f32, y as f32, z as f32]
    };
    let quats = rows().flat_map(|i| axes.map_or(cloud.quats[i], |axes| coded((axes, i)))).collect();
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
            memory: Memory::NONE,
        },
        FieldPart { sensitivity: of_unit, ..part(3, Follows::Shape, 1, MOST_QUAT, FixedStep::Same(FIXED_QUAT)) },
    ];
    let quats = field("quats", &[4], quats, quat_parts);
    let quats = Field { can_be_coded: quats.can_be_coded && axes.is_some(), ..quats };
    // Each size alone, as they are in order.
    let of_axis = part(1, Follows::Shape, 2, MOST_LOG_SCALE, FixedStep::Same(FIXED_LOG_SCALE)).like_neighbours();
    let log_scales = field("log_scales", &[3], sizes.as_flattened().to_vec(), vec![of_axis; 3]);
    let logits = rows().map(|i| cloud.opacity_logits[i]).collect();
    let logits = field(
        "opacity_logits",
        &[],
        logits,
        vec![part(1, Follows::Colour, 3, MOST_LOGIT, FixedStep::Same(FIXED_LOGIT)).like_neighbours()],
    );
    let c = cloud.sh_coefficients();
    let sh: Vec<f32> = rows().flat_map(|i| cloud.sh[i * c..][..c].as_flattened()).copied().collect();
    let band = |l: usize| part(2 * l + 1, Follows::Colour, 4 + l, MOST_SH, FixedStep::Same(FIXED_SH));
    let bands = (0..=cloud.sh_degree as usize).map(|l| if l == 0 { band(l).like_neighbours() } else { band(l) });
    let sh = colours("sh", &[c, 3], &sh, bands.collect());
    Table {
        group,
        rows: cloud.len(),
        fields: vec![means, quats, Field { centred: true, ..log_scales }, Field { centred: true, ..logits }, sh],
        fixed_mean_steps: rows().map(|i| FIXED_MEAN_PER_SIZE * size(&cloud.log_scales[i])).collect(),
    }
}

/// An offset of a quaternion for a template that is normalised and has its axes in another order, and what it was multiplied by.
/// All multiples of the sum of the two are the same rotation. The multiple is taken that has the template's w: then the w of the
/// offset is 0 and costs no bits.
fn offset_of_quat(template: [f32; 4], offset: [f32; 4], order: &AxisOrder) -> ([f32; 4], f64) {
    /// Sums whose w is a smaller part of them keep their length, as the others would become too long.
    const LEAST_W: f64 = 0.25;
    let scale = normal_scale(&template).unwrap_or(1.0).abs();
    let [template, offset] = [template, offset].map(|quat| order.quat(quat.map(|v| scale * f64::from(v))));
    let sum: [f64; 4] = std::array::from_fn(|i| template[i] + offset[i]);
    let length = sum.iter().map(|v| v * v).sum::<f64>().sqrt();
    // False for what is not finite, too.
    let has_w = sum[0].abs() > LEAST_W * length;
    if !has_w {
        return (offset.map(|v| v as f32), scale);
    }
    let stretch = template[0] / sum[0];
    let [x, y, z] = [1, 2, 3].map(|i| (sum[i] * stretch - template[i]) as f32);
    ([0.0, x, y, z], scale * stretch)
}

fn offsets_table(scene: &InstancedScene, sensitivity: Option<&Sensitivity>, axes: Option<&[AxisOrder]>) -> Table {
    let offsets = &scene.offsets;
    let rows = offsets.len();
    let of = |parameter: Parameter| {
        let all = sensitivity.map_or(&[][..], |all| &all.rows[parameter]);
        // Rows of SH above 0 are coefficients: a record has several.
        let each = all.len() / rows.max(1);
        if each == 0 { Vec::new() } else { all.chunks(each).map(|c| c.iter().sum::<f32>() / each as f32).collect() }
    };
    let part = |columns: usize, follows: Follows, parameter: Parameter, most: f32, fixed: FixedStep| {
        vec![FieldPart { columns, follows, sensitivity: of(parameter), most, fixed, memory: Memory::NONE }]
    };
    let means = offsets.means.as_flattened().to_vec();
    let means =
        field("means", &[3], means, part(3, Follows::Shape, Parameter::OffsetMeans, f32::MAX, FixedStep::OfSize));
    let sh_dc = colours(
        "sh_dc",
        &[3],
        offsets.sh_dc.as_flattened(),
        part(1, Follows::Colour, Parameter::OffsetShDc, MOST_SH, FixedStep::Same(OFFSETS * FIXED_SH)),
    );
    let logits =
        part(1, Follows::Colour, Parameter::OffsetOpacityLogits, MOST_LOGIT, FixedStep::Same(OFFSETS * FIXED_LOGIT));
    let logits = field("opacity_logits", &[], offsets.opacity_logits.clone(), logits);
    let mut fields = vec![means, sh_dc, logits];
    if !offsets.sh_rest.is_empty() {
        let rest = offsets.sh_rest.len() / rows;
        let parts = part(rest, Follows::Colour, Parameter::OffsetShRest, MOST_SH, FixedStep::Same(OFFSETS * FIXED_SH));
        fields.push(colours("sh_rest", &[rest, 3], offsets.sh_rest.as_flattened(), parts));
    }
    let (template_rows, _) = sources_of_records(&scene.offset_runs(), rows);
    let order_of = |record: usize| Some((template_rows[record]? as usize, axes?)).map(|(row, axes)| (row, &axes[row]));
    if !offsets.log_scales.is_empty() {
        let of_axis = part(
            1,
            Follows::Shape,
            Parameter::OffsetLogScales,
            MOST_LOG_SCALE,
            FixedStep::Same(OFFSETS * FIXED_LOG_SCALE),
        );
        let sizes = offsets.log_scales.iter().enumerate();
        let sizes = sizes.flat_map(|(record, &sizes)| order_of(record).map_or(sizes, |(_, order)| order.sizes(sizes)));
        fields.push(field("log_scales", &[3], sizes.collect(), vec![of_axis; 3].concat()));
    }
    if !offsets.quats.is_empty() {
        let quats = offsets.quats.iter().enumerate().map(|(record, &quat)| match order_of(record) {
            Some((row, order)) => offset_of_quat(scene.templates.quats[row], quat, order),
            None => (quat, 1.0),
        });
        let (quats, scales): (Vec<[f32; 4]>, Vec<f64>) = quats.unzip();
        let mut xyz = part(3, Follows::Shape, Parameter::OffsetQuats, MOST_QUAT, FixedStep::Same(OFFSETS * FIXED_QUAT));
        let of_scaled = |s: f32, scale: f64| (f64::from(s) / scale.powi(2)).min(f64::from(f32::MAX)) as f32;
        xyz[0].sensitivity.iter_mut().zip(&scales).for_each(|(s, &scale)| *s = of_scaled(*s, scale));
        let w = FieldPart { columns: 1, ..xyz[0].clone() };
        fields.push(field("quats", &[4], quats.as_flattened().to_vec(), vec![w, xyz.remove(0)]));
    }
    let step = |row: &Option<u32>| {
        let size = row.map_or(0.0, |row| size(&scene.templates.log_scales[row as usize]));
        f64::from(OFFSETS) * FIXED_MEAN_PER_SIZE * size
    };
    Table { group: "offset", rows, fields, fixed_mean_steps: template_rows.iter().map(step).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// 0 if two quaternions are multiples of each other, up to 1.
    fn apart(a: [f64; 4], b: [f64; 4]) -> f64 {
        let [a, b] = [a, b].map(instgs_vk::math::covariance::normalised_quat);
        let dot: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        (1.0 - dot.abs()).max(0.0)
    }

    #[test]
    fn offsets_of_rotations_lose_w_and_no_rotation() {
        let mut rng = Rng::new(4);
        let mut without_w = 0;
        for _ in 0..500 {
            let quat: [f32; 4] = std::array::from_fn(|_| (3.0 * rng.normal()) as f32);
            let offset: [f32; 4] = std::array::from_fn(|_| rng.normal() as f32);
            let sizes: [f32; 3] = std::array::from_fn(|_| rng.normal() as f32);
            let order = AxisOrder::sorted(sizes, quat);
            let (coded, scale) = offset_of_quat(quat, offset, &order);
            let template = order.quat(quat.map(f64::from));
            let length = template.iter().map(|v| v * v).sum::<f64>().sqrt();
            let sum: [f64; 4] = std::array::from_fn(|i| template[i] / length + f64::from(coded[i]));
            let want: [f32; 4] = std::array::from_fn(|i| quat[i] + offset[i]);
            assert!(apart(sum, order.quat(want.map(f64::from))) < 1e-6);
            // The scale is that of the sum.
            let of_sum = sum.iter().map(|v| v * v).sum::<f64>().sqrt();
            let of_want = want.iter().map(|v| f64::from(v * v)).sum::<f64>().sqrt();
            assert!((of_sum / of_want / scale.abs() - 1.0).abs() < 1e-4, "{of_sum} {of_want} {scale}");
            without_w += usize::from(coded[0] == 0.0);
        }
        assert!((400..500).contains(&without_w), "{without_w}: nearly all, but not those that turn half way round");
    }
}
