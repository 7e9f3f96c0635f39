//! The scene of the meshes of a `.glb`.
//!
//! Meshes that share the accessors of rotation and scale, and whose nodes are similarities, are instances of one template:
//! the first of them. Where they have other positions, opacities or SH, the differences become offsets. All other Gaussians
//! are background: meshes that are placed once, and those that their node stretches.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DMat4, DVec3};

use super::read_values::{Attributes, Values};
use crate::error::{IoError, Place};
use crate::host_memory::{available_bytes, check_reading, gaussian_bytes};
use instgs_vk::math::covariance::{covariance, quat_from_rotation};
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::math::sh::{ShRotation, widened};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::{MAX_SH_DEGREE, sh_coefficients};
use instgs_vk::scene::{Gaussians, Instance, InstancedScene, Offsets, SourceRange};

/// A mesh of Gaussians as a node places it.
pub(super) struct Part {
    pub(super) scene_from_part: DMat4,
    pub(super) attributes: Attributes,
}

/// What all instances of a template share: the accessors of rotation and scale, and the number of SH coefficients.
type Shape = (usize, usize, usize);

fn shape(attributes: &Attributes) -> Shape {
    (attributes.rotation, attributes.scale, attributes.sh_rest.len())
}

/// The transform of a part.
#[derive(Clone, Copy)]
enum Placement {
    /// A rotation, a uniform scale and a translation.
    Similar(Similarity),
    /// Any other of positive determinant.
    Affine(DMat4),
    /// Flat, mirrored or not finite.
    Lost,
}

impl Placement {
    fn of(matrix: DMat4) -> Self {
        let row = |k: usize| matrix.row(k).to_array().map(|v| v as f32);
        let determinant = DMat3::from_mat4(matrix).determinant();
        match Similarity::from_rows([row(0), row(1), row(2)]) {
            Ok(similarity) => Self::Similar(similarity),
            Err(_) if determinant > 0.0 && matrix.is_finite() => Self::Affine(matrix),
            Err(_) => Self::Lost,
        }
    }
}

/// The template of a shape.
struct Template {
    index: u32,
    cloud: Gaussians,
    /// By the accessors of an instance, the first record of its offsets.
    runs: BTreeMap<Attributes, Option<u32>>,
}

/// The scene of the parts.
///
/// # Errors
/// Accessors do not fit the file, or claim more Gaussians than it has bytes.
pub(super) fn scene_of(
    parts: &[Part],
    values: &Values<'_>,
    notes: &mut Vec<String>,
) -> Result<InstancedScene, IoError> {
    check_count(parts, values)?;
    let scales_are_logs = values.has_negative_scale(parts.iter().map(|part| &part.attributes))?;
    if scales_are_logs {
        notes.push("has negative scales: all are read as logarithms, as in drafts of the extension".into());
    }
    let values = &Values { scales_are_logs, ..*values };
    let placements: Vec<Placement> = parts.iter().map(|part| Placement::of(part.scene_from_part)).collect();
    let lost = placements.iter().filter(|placement| matches!(placement, Placement::Lost)).count();
    if lost > 0 {
        notes.push(format!("has {lost} meshes of Gaussians that their nodes flatten or mirror, which are left out"));
    }
    let mut users: BTreeMap<Shape, Vec<&Attributes>> = BTreeMap::new();
    for (part, placement) in parts.iter().zip(&placements) {
        if matches!(placement, Placement::Similar(_)) {
            users.entry(shape(&part.attributes)).or_default().push(&part.attributes);
        }
    }
    users.retain(|_, users| users.len() > 1);
    // SH coefficients above 0 up to the last one in which an instance differs from its template.
    let differ = |users: &Vec<&Attributes>| {
        let of_user = |user: &&Attributes| user.sh_rest.iter().zip(&users[0].sh_rest).rposition(|(a, b)| a != b);
        users.iter().filter_map(of_user).max().map_or(0, |last| last + 1)
    };
    let mut builder = Builder {
        values,
        sh_degree: users.values().flatten().map(|user| user.sh_degree()).max().unwrap_or(0),
        rest_offsets: whole_bands(users.values().map(differ).max().unwrap_or(0)),
        templates: BTreeMap::new(),
        scene: InstancedScene::default(),
    };
    builder.scene.templates.sh_degree = builder.sh_degree;
    let mut background = Vec::new();
    check_memory(parts, &users, builder.rest_offsets, values)?;
    check_copies(parts, &placements, values)?;
    for (part, placement) in parts.iter().zip(placements) {
        match placement {
            Placement::Similar(similarity) if users.contains_key(&shape(&part.attributes)) => {
                builder.push_instance(&part.attributes, similarity)?;
            }
            Placement::Similar(similarity) => background.push(values.cloud(&part.attributes)?.placed(similarity)),
            Placement::Affine(matrix) => background.push(stretched(&values.cloud(&part.attributes)?, matrix)),
            Placement::Lost => {}
        }
    }
    let mut scene = builder.scene;
    scene.background.sh_degree = background.iter().map(|cloud| cloud.sh_degree).max().unwrap_or(0);
    background.iter().for_each(|cloud| scene.background.append(cloud));
    scene.validate().map_err(|e| IoError::new(values.path, e.reason).at(Place::Tensor(e.tensor)))?;
    Ok(scene)
}

/// Checks that the Gaussians of all different meshes are fewer than the bytes of the file: each has at least a byte that is
/// its own, unless accessors overlap.
fn check_count(parts: &[Part], values: &Values<'_>) -> Result<(), IoError> {
    let mut count = 0usize;
    for attributes in meshes(parts) {
        count = count.saturating_add(values.count(attributes.position)?);
    }
    if count > values.binary.len() {
        let what = format!("claims {count} Gaussians in {} bytes, more than they can hold", values.binary.len());
        return Err(IoError::damaged(values.path, what));
    }
    Ok(())
}

/// The different meshes.
fn meshes(parts: &[Part]) -> BTreeSet<&Attributes> {
    parts.iter().map(|part| &part.attributes).collect()
}

/// Checks memory for all different meshes. Of those that become instances with offsets the first of each shape is the template.
fn check_memory(
    parts: &[Part],
    users: &BTreeMap<Shape, Vec<&Attributes>>,
    rest_offsets: usize,
    values: &Values<'_>,
) -> Result<(), IoError> {
    let record_bytes = 4 * (3 + 3 + 1 + 3 * rest_offsets as u64);
    let (mut need, mut templates) = (0u64, BTreeSet::new());
    for attributes in meshes(parts) {
        let is_instance = users.contains_key(&shape(attributes)) && !templates.insert(shape(attributes));
        // Clouds are there twice while they are joined.
        let each = if is_instance { record_bytes } else { 2 * gaussian_bytes(attributes.sh_degree()) };
        need = need.saturating_add((values.count(attributes.position)? as u64).saturating_mul(each));
    }
    check_reading(values.path, "takes", need, available_bytes())
}

/// Checks memory for meshes that cannot be instances, since their nodes stretch them: each is a copy.
fn check_copies(parts: &[Part], placements: &[Placement], values: &Values<'_>) -> Result<(), IoError> {
    let mut count = 0u64;
    for (part, _) in parts.iter().zip(placements).filter(|(_, placement)| matches!(placement, Placement::Affine(_))) {
        count = count.saturating_add(values.count(part.attributes.position)? as u64);
    }
    // The same again while clouds are joined.
    let need = count.saturating_mul(2 * gaussian_bytes(MAX_SH_DEGREE));
    let what = format!("has {count} Gaussians in stretched copies, which take");
    check_reading(values.path, &what, need, available_bytes())
}

/// Builds templates, instances and offsets.
struct Builder<'a> {
    values: &'a Values<'a>,
    /// SH degree of the templates.
    sh_degree: u32,
    /// SH coefficients above 0 in which instances differ from their templates, and the rest of their band.
    rest_offsets: usize,
    templates: BTreeMap<Shape, Template>,
    scene: InstancedScene,
}

impl Builder<'_> {
    /// Appends an instance, and its template if it is the first one of it.
    fn push_instance(&mut self, attributes: &Attributes, world_from_template: Similarity) -> Result<(), IoError> {
        let template = match self.templates.entry(shape(attributes)) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => {
                let mut cloud = self.values.cloud(attributes)?;
                cloud.set_sh_degree(self.sh_degree);
                place.insert(new_template(&mut self.scene, attributes, cloud))
            }
        };
        let first_offset = match template.runs.get(attributes) {
            Some(&first) => first,
            None => {
                let mut shown = self.values.cloud(attributes)?;
                shown.set_sh_degree(self.sh_degree);
                let first = Some(self.scene.offsets.len() as u32);
                push_offsets(&mut self.scene.offsets, &template.cloud, &shown, self.rest_offsets);
                template.runs.insert(attributes.clone(), first);
                first
            }
        };
        self.scene.instances.push(Instance { template: template.index, world_from_template, first_offset });
        Ok(())
    }
}

/// Appends a template, which is what its first instance shows.
fn new_template(scene: &mut InstancedScene, attributes: &Attributes, cloud: Gaussians) -> Template {
    let index = scene.template_ranges.len() as u32;
    scene.template_ranges.push(SourceRange { first: scene.templates.len() as u32, count: cloud.len() as u32 });
    scene.templates.append(&cloud);
    Template { index, cloud, runs: BTreeMap::from([(attributes.clone(), None)]) }
}

/// The number of SH coefficients above 0 up to the end of the band of the last of `count`.
fn whole_bands(count: usize) -> usize {
    (0..=MAX_SH_DEGREE).map(|degree| sh_coefficients(degree) - 1).find(|&rest| rest >= count).unwrap_or(count)
}

/// Appends the differences of an instance's cloud from its template's, which has as many Gaussians; of `rest` SH coefficients above
/// 0, since they agree in the others.
fn push_offsets(offsets: &mut Offsets, template: &Gaussians, shown: &Gaussians, rest: usize) {
    let difference = |(a, b): (&[f32; 3], &[f32; 3])| (widened(*a) - widened(*b)).to_array().map(|v| v as f32);
    offsets.means.extend(shown.means.iter().zip(&template.means).map(difference));
    let logits = shown.opacity_logits.iter().zip(&template.opacity_logits);
    offsets.opacity_logits.extend(logits.map(|(&a, &b)| (f64::from(a) - f64::from(b)) as f32));
    for i in 0..template.len() {
        let mut sh = shown.sh_of(i).iter().zip(template.sh_of(i)).map(difference);
        offsets.sh_dc.extend(sh.next());
        offsets.sh_rest.extend(sh.take(rest));
    }
}

/// A cloud that a matrix of positive determinant maps to other shapes: covariances exactly; SH turn with the matrix's
/// rotation, the nearest one.
fn stretched(cloud: &Gaussians, matrix: DMat4) -> Gaussians {
    let linear = DMat3::from_mat4(matrix);
    let sh_rotation = ShRotation::new(rotation_of(linear));
    let mut out = Gaussians::with_capacity(cloud.sh_degree, cloud.len());
    for i in 0..cloud.len() {
        let local = covariance(cloud.quats[i].map(f64::from), widened(cloud.log_scales[i]));
        let axes = symmetric_eigen((linear * local * linear.transpose()).to_cols_array_2d());
        let [x, y, z] = axes.map(|(_, axis)| DVec3::from_array(axis));
        let sign = DMat3::from_cols(x, y, z).determinant().signum();
        out.means.push(matrix.transform_point3(widened(cloud.means[i])).to_array().map(|v| v as f32));
        out.quats.push(quat_from_rotation(DMat3::from_cols(x * sign, y, z)).map(|v| v as f32));
        let least = f64::from(f32::MIN_POSITIVE);
        out.log_scales.push(axes.map(|(variance, _)| variance.max(0.0).sqrt().max(least).ln() as f32));
        out.opacity_logits.push(cloud.opacity_logits[i]);
        let sh: Vec<DVec3> = cloud.sh_of(i).iter().map(|&c| widened(c)).collect();
        out.sh.extend(sh_rotation.rotate(&sh).into_iter().map(|c| c.to_array().map(|v| v as f32)));
    }
    out
}

/// The rotation R of a matrix R S with symmetric S.
fn rotation_of(matrix: DMat3) -> DMat3 {
    let squared = symmetric_eigen((matrix.transpose() * matrix).to_cols_array_2d());
    let inverse = squared.into_iter().fold(DMat3::ZERO, |sum, (square, axis)| {
        let axis = DVec3::from_array(axis);
        sum + DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * (1.0 / square.sqrt())
    });
    matrix * inverse
}
