//! The scene of the meshes of a `.glb`.
//!
//! Meshes whose nodes are similarities are instances of one template, the first of them, if this program wrote them from one
//! template, or if they share the accessors of rotation and scale. Where they have other values, the differences become
//! offsets. All other Gaussians are background: other meshes that are placed once, and those that their node stretches.

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
    /// The number of the template that this program wrote it from.
    pub(super) template: Option<u64>,
}

/// What all instances of a template share.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum TemplateKey {
    /// The number of the template, in a file of this program, and what another program may have changed since: how many
    /// Gaussians and SH coefficients above 0 there are.
    Tagged { template: u64, gaussians: usize, sh_rest: usize },
    /// The accessors of rotation and scale, and the number of SH coefficients above 0.
    SameShape { rotation: usize, scale: usize, sh_rest: usize },
}

impl TemplateKey {
    fn of(part: &Part, values: &Values<'_>) -> Result<Self, IoError> {
        let Attributes { position, rotation, scale, ref sh_rest, .. } = part.attributes;
        let sh_rest = sh_rest.len();
        Ok(match part.template {
            Some(template) => Self::Tagged { template, gaussians: values.count(position)?, sh_rest },
            None => Self::SameShape { rotation, scale, sh_rest },
        })
    }

    /// Whether so many meshes make a template: what was an instance stays one.
    fn is_template(&self, users: usize) -> bool {
        users > 1 || matches!(self, Self::Tagged { .. })
    }
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

/// A template, and which runs of offsets it has.
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
    let keys = parts.iter().map(|part| TemplateKey::of(part, values)).collect::<Result<Vec<_>, _>>()?;
    let meshes: Meshes<'_> = parts.iter().map(|part| &part.attributes).zip(&keys).collect();
    check_count(&meshes, values)?;
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
    let mut users: BTreeMap<&TemplateKey, Vec<&Attributes>> = BTreeMap::new();
    for ((part, key), placement) in parts.iter().zip(&keys).zip(&placements) {
        if matches!(placement, Placement::Similar(_)) {
            users.entry(key).or_default().push(&part.attributes);
        }
    }
    users.retain(|key, users| key.is_template(users.len()));
    // SH coefficients above 0 up to the last one in which an instance differs from its template.
    let differ = |users: &Vec<&Attributes>| {
        let of_user = |user: &&Attributes| user.sh_rest.iter().zip(&users[0].sh_rest).rposition(|(a, b)| a != b);
        users.iter().filter_map(of_user).max().map_or(0, |last| last + 1)
    };
    let shape_differs = |users: &Vec<&Attributes>| {
        users.iter().any(|user| (user.rotation, user.scale) != (users[0].rotation, users[0].scale))
    };
    let kinds = OffsetKinds {
        sh_rest: whole_bands(users.values().map(differ).max().unwrap_or(0)),
        shape: users.values().any(shape_differs),
    };
    let mut builder = Builder {
        values,
        sh_degree: users.values().flatten().map(|user| user.sh_degree()).max().unwrap_or(0),
        kinds,
        templates: BTreeMap::new(),
        scene: InstancedScene::default(),
    };
    builder.scene.templates.sh_degree = builder.sh_degree;
    let mut background = Vec::new();
    check_memory(&meshes, &users, kinds, values)?;
    check_copies(parts, &placements, values)?;
    for ((part, key), placement) in parts.iter().zip(&keys).zip(placements) {
        match placement {
            Placement::Similar(similarity) if users.contains_key(key) => {
                builder.push_instance(&part.attributes, key, similarity)?;
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

/// The different meshes; one that is an instance of two templates counts twice, since both get its Gaussians.
type Meshes<'a> = BTreeSet<(&'a Attributes, &'a TemplateKey)>;

/// Checks that the Gaussians of all different meshes are fewer than the bytes of the file: each has at least a byte that is
/// its own, unless accessors overlap.
fn check_count(meshes: &Meshes<'_>, values: &Values<'_>) -> Result<(), IoError> {
    let mut count = 0usize;
    for (attributes, _) in meshes {
        count = count.saturating_add(values.count(attributes.position)?);
    }
    if count > values.binary.len() {
        let what = format!("claims {count} Gaussians in {} bytes, more than they can hold", values.binary.len());
        return Err(IoError::damaged(values.path, what));
    }
    Ok(())
}

/// Checks memory for all different meshes. Of those that become instances with offsets the first of each template is the template.
fn check_memory(
    meshes: &Meshes<'_>,
    users: &BTreeMap<&TemplateKey, Vec<&Attributes>>,
    kinds: OffsetKinds,
    values: &Values<'_>,
) -> Result<(), IoError> {
    let (mut need, mut templates) = (0u64, BTreeSet::new());
    let record_bytes = kinds.record_bytes();
    for &(attributes, key) in meshes {
        let is_instance = users.contains_key(key) && !templates.insert(key);
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

/// What instances differ in from their templates, besides positions, base colours and opacities.
#[derive(Clone, Copy)]
struct OffsetKinds {
    /// SH coefficients above 0, in whole bands.
    sh_rest: usize,
    /// Whether log scales and quaternions differ.
    shape: bool,
}

impl OffsetKinds {
    /// Bytes of a record in memory.
    fn record_bytes(self) -> u64 {
        let of_shape = if self.shape { 3 + 4 } else { 0 };
        4 * (3 + 3 + 1 + of_shape + 3 * self.sh_rest as u64)
    }
}

/// Builds templates, instances and offsets.
struct Builder<'a> {
    values: &'a Values<'a>,
    /// SH degree of the templates.
    sh_degree: u32,
    kinds: OffsetKinds,
    templates: BTreeMap<TemplateKey, Template>,
    scene: InstancedScene,
}

impl Builder<'_> {
    /// Appends an instance, and its template if it is the first one of it.
    fn push_instance(
        &mut self,
        attributes: &Attributes,
        key: &TemplateKey,
        world_from_template: Similarity,
    ) -> Result<(), IoError> {
        let template = match self.templates.entry(key.clone()) {
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
                push_offsets(&mut self.scene.offsets, &template.cloud, &shown, self.kinds);
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

/// Appends the differences of an instance's cloud from its template's, which has as many Gaussians. Besides positions, base colours
/// and opacities they differ only in what `kinds` names.
fn push_offsets(offsets: &mut Offsets, template: &Gaussians, shown: &Gaussians, kinds: OffsetKinds) {
    let difference = |(a, b): (&[f32; 3], &[f32; 3])| (widened(*a) - widened(*b)).to_array().map(|v| v as f32);
    offsets.means.extend(shown.means.iter().zip(&template.means).map(difference));
    let logits = shown.opacity_logits.iter().zip(&template.opacity_logits);
    offsets.opacity_logits.extend(logits.map(|(&a, &b)| (f64::from(a) - f64::from(b)) as f32));
    for i in 0..template.len() {
        let mut sh = shown.sh_of(i).iter().zip(template.sh_of(i)).map(difference);
        offsets.sh_dc.extend(sh.next());
        offsets.sh_rest.extend(sh.take(kinds.sh_rest));
    }
    if kinds.shape {
        offsets.log_scales.extend(shown.log_scales.iter().zip(&template.log_scales).map(difference));
        offsets.quats.extend(shown.quats.iter().zip(&template.quats).map(quat_difference));
    }
}

/// The smaller of the two differences between rotations: q and -q are the same one.
fn quat_difference((shown, template): (&[f32; 4], &[f32; 4])) -> [f32; 4] {
    let dot: f64 = shown.iter().zip(template).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum();
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    std::array::from_fn(|k| (sign * f64::from(shown[k]) - f64::from(template[k])) as f32)
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
