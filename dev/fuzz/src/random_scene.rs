//! Instanced scenes out of bytes: mostly consistent ones, with values and indices that no training gives.

use arbitrary::{Result, Unstructured};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, Offsets, SourceRange};

/// A scene; it may be inconsistent, and its values may have any bits.
pub(crate) fn scene(u: &mut Unstructured<'_>) -> Result<InstancedScene> {
    let degree = u.int_in_range(0..=3)?;
    let templates = cloud(u, degree, 8)?;
    let own =
        if u.ratio(1, 4)? { cloud(u, degree, 3)? } else { Gaussians { sh_degree: degree, ..Gaussians::default() } };
    let background = cloud(u, degree, 8)?;
    let template_ranges = many(u, 3, |u| range(u, templates.len()))?;
    let records = u.int_in_range(0..=16)?;
    let instances = many(u, 5, |u| instance(u, template_ranges.len(), records))?;
    let matrices = u.ratio(1, 4)?;
    let own_ranges = match own.means.is_empty() {
        true => Vec::new(),
        false => (0..instances.len()).map(|_| range(u, own.len())).collect::<Result<_>>()?,
    };
    let groups = many(u, 2, |u| {
        let name = if u.ratio(1, 2)? { Some(u.arbitrary::<String>()?.chars().take(8).collect()) } else { None };
        Ok(Group { template_id: u.int_in_range(0..=3)?, name, instance_ids: many(u, 3, |u| u.int_in_range(0..=9))? })
    })?;
    Ok(InstancedScene {
        color_from_template: rows::<12>(u, if matrices { instances.len() } else { 0 })?
            .into_iter()
            .map(|row| std::array::from_fn(|i| std::array::from_fn(|j| row[4 * i + j])))
            .collect(),
        offsets: offsets(u, records, degree)?,
        templates,
        template_ranges,
        instances,
        own,
        own_ranges,
        background,
        groups,
        ..InstancedScene::default()
    })
}

/// At most `most` things.
fn many<T>(
    u: &mut Unstructured<'_>,
    most: usize,
    mut one: impl FnMut(&mut Unstructured<'_>) -> Result<T>,
) -> Result<Vec<T>> {
    (0..u.int_in_range(0..=most)?).map(|_| one(u)).collect()
}

fn rows<const N: usize>(u: &mut Unstructured<'_>, count: usize) -> Result<Vec<[f32; N]>> {
    (0..count)
        .map(|_| {
            let mut row = [0.0; N];
            row.iter_mut().try_for_each(|value| float(u).map(|v| *value = v))?;
            Ok(row)
        })
        .collect()
}

/// A number as scenes have them, or, one in eight, any bits.
fn float(u: &mut Unstructured<'_>) -> Result<f32> {
    Ok(match u.ratio(1, 8)? {
        true => u.arbitrary()?,
        false => f32::from(u.arbitrary::<i8>()?) / 16.0,
    })
}

fn cloud(u: &mut Unstructured<'_>, sh_degree: u32, most: usize) -> Result<Gaussians> {
    let n = u.int_in_range(0..=most)?;
    Ok(Gaussians {
        sh_degree,
        means: rows(u, n)?,
        quats: rows(u, n)?,
        log_scales: rows(u, n)?,
        opacity_logits: rows::<1>(u, n)?.into_iter().flatten().collect(),
        sh: rows(u, n * sh_coefficients(sh_degree))?,
    })
}

fn offsets(u: &mut Unstructured<'_>, records: usize, of_template: u32) -> Result<Offsets> {
    let full = u.ratio(1, 3)?;
    let rest = sh_coefficients(u.int_in_range(0..=of_template)?) - 1;
    let extra = if full { records } else { 0 };
    Ok(Offsets {
        means: rows(u, records)?,
        sh_dc: rows(u, records)?,
        opacity_logits: rows::<1>(u, records)?.into_iter().flatten().collect(),
        sh_rest: rows(u, extra * rest)?,
        log_scales: rows(u, extra)?,
        quats: rows(u, extra)?,
    })
}

/// A range that is within `count`, or, one in sixteen, any.
fn range(u: &mut Unstructured<'_>, count: usize) -> Result<SourceRange> {
    if u.ratio(1, 16)? {
        return Ok(SourceRange { first: u.arbitrary()?, count: u.arbitrary()? });
    }
    let first = u.int_in_range(0..=count)?;
    Ok(SourceRange { first: first as u32, count: u.int_in_range(0..=count - first)? as u32 })
}

fn instance(u: &mut Unstructured<'_>, templates: usize, records: usize) -> Result<Instance> {
    let [a, x, y, z] = [float(u)?, float(u)?, float(u)?, float(u)?];
    let mut matrix = [[a, 0.0, 0.0, x], [0.0, a, 0.0, y], [0.0, 0.0, a, z]];
    if u.ratio(1, 2)? {
        (matrix[0], matrix[1]) = ([0.0, -a, 0.0, x], [a, 0.0, 0.0, y]);
    }
    let first_offset = u.ratio(1, 2)?.then(|| u.int_in_range(0..=records)).transpose()?;
    Ok(Instance {
        template: u.int_in_range(0..=templates.saturating_sub(1))? as u32,
        world_from_template: Similarity::from_rows(matrix).unwrap_or(Similarity::IDENTITY),
        first_offset: first_offset.map(|first| first as u32),
    })
}
