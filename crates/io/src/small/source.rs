//! What `--pack small` codes: the clouds and the offsets of a scene as tables of fields, in the order of the file.

use super::field::{Centre, Follows, Memory};
use super::opponent::to_opponent;
use super::sensitivity::Sensitivity;
use super::shapes::{LOG_COVARIANCES, OffsetShapes, cloud_shapes};
use instgs_vk::math::morton::morton_order;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::offset_runs::sources_of_records;
use instgs_vk::scene::parameters::Parameter;

/// Largest steps: beyond them a change is no longer small, and what sensitivity says of it is wrong. 0.8 of the logarithm of
/// a variance is 0.4 of that of a size.
const MOST_LOG_COVARIANCE: f32 = 0.8;
const MOST_LOGIT: f32 = 1.0;
const MOST_SH: f32 = 0.3;
/// Steps without sensitivity: a size changes by at most 6 % (six coordinates move it, each by up to 2.5 %), an opacity by at most 1/80, the base colour (0.282 times SH)
/// by at most 1.2 of 255 levels; a position by 1/32 of its Gaussian's size.
const FIXED_LOG_COVARIANCE: f32 = 0.1;
const FIXED_LOGIT: f32 = 0.1;
const FIXED_SH: f32 = 0.02;
const FIXED_MEAN_PER_SIZE: f64 = 1.0 / 16.0;
/// An axis counts as at least this part of the longest one when a position's step is sought: what is thinner is a sheet or a
/// thread, of which the picture shows the breadth. Without it a flat Gaussian (a log scale of -87) has steps that nobody can see.
const THINNEST: f64 = 1e-3;
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
    pub(super) centre: Centre<'static>,
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

/// The order of a file's rows, as indices of the scene's; `None` = as they are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Orders {
    /// The order of instances' own Gaussians.
    pub(super) own: Option<Vec<u32>>,
    /// The order of the background.
    pub(super) background: Option<Vec<u32>>,
}

impl Orders {
    /// Along Morton curves, but for clouds that unknown tensors may be parallel to.
    pub(super) fn of(scene: &InstancedScene) -> Self {
        let reorder = scene.foreign_tensors.is_empty();
        Self {
            own: own_order(scene).filter(|_| reorder),
            background: reorder.then(|| morton_order(&scene.background.means)),
        }
    }
}

/// The tables of a scene that its file holds, with rows in these orders.
pub(super) fn tables(scene: &InstancedScene, orders: &Orders, sensitivity: Option<&Sensitivity>) -> Vec<Table> {
    let mut first = Rows::default();
    let mut cloud = |group, cloud: &Gaussians, order: Option<&Vec<u32>>, shapes: Option<&[[f32; 6]]>| {
        let order = order.cloned().unwrap_or_else(|| (0..cloud.len() as u32).collect());
        let table = cloud_table(group, cloud, &order, shapes, &first.sensitivity(sensitivity, cloud, &order));
        first.advance(cloud);
        table
    };
    let [of_templates, of_own, of_background] = [&scene.templates, &scene.own, &scene.background].map(cloud_shapes);
    let of_offsets = OffsetShapes::of(scene, of_templates.as_deref());
    // Offsets that stay as they are belong to the sizes and rotations that the templates have.
    let of_templates = of_templates.filter(|_| of_offsets != OffsetShapes::AsTheyAre);
    let mut out = vec![cloud("template", &scene.templates, None, of_templates.as_deref())];
    out.push(cloud("own", &scene.own, orders.own.as_ref(), of_own.as_deref()));
    out.push(cloud("background", &scene.background, orders.background.as_ref(), of_background.as_deref()));
    out.push(offsets_table(scene, sensitivity, of_offsets));
    out
}

/// How many rows of each parameter precede a cloud.
#[derive(Default)]
struct Rows {
    sources: usize,
    bands: [usize; 4],
}

const BANDS: [Parameter; 4] = [Parameter::Sh0, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3];

/// The sensitivity of a cloud's rows in the order of its table; empty where unknown.
struct CloudSensitivity {
    means: Vec<f32>,
    opacity_logits: Vec<f32>,
    /// By SH band.
    bands: [Vec<f32>; 4],
    shapes: Vec<[f32; 6]>,
}

impl Rows {
    fn sensitivity(&self, all: Option<&Sensitivity>, cloud: &Gaussians, order: &[u32]) -> CloudSensitivity {
        let of = |parameter: Parameter, first: usize| {
            let rows = all.and_then(|all| all.rows[parameter].get(first..first + cloud.len()));
            rows.map_or(Vec::new(), |rows| order.iter().map(|&i| rows[i as usize]).collect())
        };
        let shapes = all.and_then(|all| all.source_shapes.get(self.sources..self.sources + cloud.len()));
        CloudSensitivity {
            means: of(Parameter::Means, self.sources),
            opacity_logits: of(Parameter::OpacityLogits, self.sources),
            bands: std::array::from_fn(|l| of(BANDS[l], self.bands[l])),
            shapes: shapes.map_or(Vec::new(), |rows| order.iter().map(|&i| rows[i as usize]).collect()),
        }
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

/// Size of a Gaussian, scene units: geometric mean of its standard deviations, none of which counts as less than [`THINNEST`] of
/// the largest.
fn size(log_scales: &[f32; 3]) -> f64 {
    let log_scales = log_scales.map(f64::from);
    let least = log_scales.into_iter().fold(f64::NEG_INFINITY, f64::max) + THINNEST.ln();
    // Not max, which would hide that a value is no number.
    let size = (log_scales.map(|v| if v < least { least } else { v }).iter().sum::<f64>() / 3.0).exp();
    if size.is_finite() { size } else { 0.0 }
}

fn field(name: &'static str, shape: &[usize], values: Vec<f32>, parts: Vec<FieldPart>) -> Field {
    let can_be_coded = !values.is_empty() && values.iter().all(|value| value.is_finite());
    Field { name, shape: shape.to_vec(), values, can_be_coded, parts, centre: Centre::Zero, opponent: false }
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

/// Values that stay floats.
fn as_they_are(name: &'static str, shape: &[usize], values: Vec<f32>) -> Field {
    let part = FieldPart {
        columns: shape.iter().product(),
        follows: Follows::Nothing,
        sensitivity: Vec::new(),
        most: f32::MAX,
        fixed: FixedStep::Same(1.0),
        memory: Memory::NONE,
    };
    Field { can_be_coded: false, ..field(name, shape, values, vec![part]) }
}

/// Coordinates of logarithms of covariances, each with steps of its own. `step` is that without sensitivity.
fn shapes_field(shapes: &[[f32; 6]], sensitivity: &[[f32; 6]], step: f32) -> Field {
    let part = |k: usize| FieldPart {
        columns: 1,
        follows: Follows::Shape,
        sensitivity: sensitivity.iter().map(|row| row[k]).collect(),
        most: MOST_LOG_COVARIANCE,
        fixed: FixedStep::Same(step),
        memory: Memory::NONE,
    };
    field(LOG_COVARIANCES, &[6], shapes.as_flattened().to_vec(), (0..6).map(part).collect())
}

fn cloud_table(
    group: &'static str,
    cloud: &Gaussians,
    order: &[u32],
    shapes: Option<&[[f32; 6]]>,
    sensitivity: &CloudSensitivity,
) -> Table {
    let rows = || order.iter().map(|&i| i as usize);
    let part = |columns: usize, follows: Follows, of: &[f32], most: f32, fixed: FixedStep| FieldPart {
        columns,
        follows,
        sensitivity: of.to_vec(),
        most,
        fixed,
        memory: Memory::NONE,
    };
    let means = rows().flat_map(|i| cloud.means[i]).collect();
    let of_means = part(3, Follows::Shape, &sensitivity.means, f32::MAX, FixedStep::OfSize).like_neighbours();
    let mut fields = vec![field("means", &[3], means, vec![of_means])];
    match shapes {
        Some(shapes) => {
            let shapes: Vec<[f32; 6]> = rows().map(|i| shapes[i]).collect();
            let coded = shapes_field(&shapes, &sensitivity.shapes, FIXED_LOG_COVARIANCE);
            let parts = coded.parts.into_iter().map(FieldPart::like_neighbours).collect();
            fields.push(Field { parts, centre: Centre::Middle, ..coded });
        }
        None => {
            fields.push(as_they_are("quats", &[4], rows().flat_map(|i| cloud.quats[i]).collect()));
            fields.push(as_they_are("log_scales", &[3], rows().flat_map(|i| cloud.log_scales[i]).collect()));
        }
    }
    let logits = rows().map(|i| cloud.opacity_logits[i]).collect();
    let of_logits = part(1, Follows::Colour, &sensitivity.opacity_logits, MOST_LOGIT, FixedStep::Same(FIXED_LOGIT));
    let logits = field("opacity_logits", &[], logits, vec![of_logits.like_neighbours()]);
    fields.push(Field { centre: Centre::Middle, ..logits });
    let c = cloud.sh_coefficients();
    let sh: Vec<f32> = rows().flat_map(|i| cloud.sh[i * c..][..c].as_flattened()).copied().collect();
    let band = |l: usize| part(2 * l + 1, Follows::Colour, &sensitivity.bands[l], MOST_SH, FixedStep::Same(FIXED_SH));
    let bands = (0..=cloud.sh_degree as usize).map(|l| if l == 0 { band(l).like_neighbours() } else { band(l) });
    fields.push(colours("sh", &[c, 3], &sh, bands.collect()));
    Table {
        group,
        rows: cloud.len(),
        fields,
        fixed_mean_steps: rows().map(|i| FIXED_MEAN_PER_SIZE * size(&cloud.log_scales[i])).collect(),
    }
}

fn offsets_table(scene: &InstancedScene, sensitivity: Option<&Sensitivity>, shapes: OffsetShapes) -> Table {
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
    match shapes {
        OffsetShapes::None => {}
        OffsetShapes::Coded(shapes) => {
            let of_records = sensitivity.map_or(&[][..], |all| &all.offset_shapes);
            fields.push(shapes_field(&shapes, of_records, OFFSETS * FIXED_LOG_COVARIANCE));
        }
        OffsetShapes::AsTheyAre => {
            let arrays =
                [("quats", 4, offsets.quats.as_flattened()), ("log_scales", 3, offsets.log_scales.as_flattened())];
            let there = arrays.into_iter().filter(|(_, _, values)| !values.is_empty());
            fields.extend(there.map(|(name, width, values)| as_they_are(name, &[width], values.to_vec())));
        }
    }
    let (template_rows, _) = sources_of_records(&scene.offset_runs(), rows);
    let step = |row: &Option<u32>| {
        let size = row.map_or(0.0, |row| size(&scene.templates.log_scales[row as usize]));
        f64::from(OFFSETS) * FIXED_MEAN_PER_SIZE * size
    };
    Table { group: "offset", rows, fields, fixed_mean_steps: template_rows.iter().map(step).collect() }
}
