//! Writing `.usda`: OpenUSD 26.03 and later, one `ParticleField3DGaussianSplat` prim for each instance and one for the
//! background, as text.
//!
//! The layer: `/scene` turns the scene's up to +y. `/templates`, which is a class and not drawn, has a prim for each template
//! that is shown as it is; instances without offsets, Gaussians of their own and colour matrix are references to it. Every
//! other instance has its own arrays, in the template's frame. Transforms are those of instances, so an instance can be moved,
//! and each has its name as a semantic label (`semantics:labels:class`).
//!
//! Scales are linear and opacities from 0 to 1; SH coefficients are those of one Gaussian after the other, in the order of
//! 3DGS, and turn with the prim.

use std::io::Write;
use std::path::Path;

use glam::{DMat3, DVec3};

use crate::atomic_write;
use crate::error::{IoError, Place};
use crate::glb::up_to_y;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::instanced_scene::{Instance, InstancedScene, SAME_COLOR, SourceRange};
use instgs_vk::scene::{Gaussians, InstanceLabel};

/// Numbers of a line of text.
const NUMBERS_A_LINE: usize = 24;

/// Writes a scene as `.usda`; `up` is the world direction that becomes +y, of any length but zero.
///
/// # Errors
/// An inconsistent scene, a value that is not finite, or a file that cannot be written.
pub fn write_usda(path: &Path, scene: &InstancedScene, up: DVec3) -> Result<(), IoError> {
    let fail = |what: String| IoError::new(path, format!("cannot write: {what}"));
    scene.validate().map_err(|e| fail(e.reason).at(Place::Tensor(e.tensor)))?;
    let turn = up_to_y(up).ok_or_else(|| fail("the up direction has no length".into()))?;
    let local = InFrames::of(scene);
    if let Some(i) = (0..local.cloud.len()).find(|&i| !local.cloud.is_finite(i)) {
        return Err(fail(format!("Gaussian {i} has a value that is not finite")));
    }
    let mut log_scales = local.cloud.log_scales.as_flattened().iter().chain(scene.templates.log_scales.as_flattened());
    if log_scales.any(|scale| !scale.exp().is_finite()) {
        return Err(fail("a Gaussian is larger than a number can say".into()));
    }
    atomic_write(path, |out| {
        writeln!(out, "#usda 1.0\n(\n    defaultPrim = \"scene\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n")?;
        write_templates(out, scene)?;
        writeln!(out, "def Xform \"scene\"\n{{")?;
        write_transform(out, turn, DVec3::ZERO)?;
        for (k, label) in scene.instance_labels().iter().enumerate() {
            write_instance(out, scene, (k, label), &local)?;
        }
        if !scene.background.is_empty() {
            writeln!(out, "    def ParticleField3DGaussianSplat \"background\"\n    {{")?;
            write_cloud(out, &scene.background, 0..scene.background.len())?;
            writeln!(out, "    }}")?;
        }
        writeln!(out, "}}")
    })
}

/// Every instance's Gaussians in its own frame, offsets and colours included.
struct InFrames {
    cloud: Gaussians,
    /// First Gaussian of each instance.
    firsts: Vec<usize>,
}

impl InFrames {
    fn of(scene: &InstancedScene) -> Self {
        let here = |instance: &Instance| Instance { world_from_template: Similarity::IDENTITY, ..instance.clone() };
        let instances = scene.instances.iter().map(here).collect();
        let cloud = InstancedScene { instances, ..scene.clone() }.flatten();
        let mut firsts = vec![0];
        for (k, instance) in scene.instances.iter().enumerate() {
            let count = scene.template_ranges[instance.template as usize].count + scene.own_range(k).count;
            firsts.push(firsts[k] + count as usize);
        }
        Self { cloud, firsts }
    }
}

/// True if an instance looks as its template does.
fn is_plain(scene: &InstancedScene, k: usize, instance: &Instance) -> bool {
    instance.first_offset.is_none()
        && scene.own_range(k).count == 0
        && scene.color_matrix(k).is_none_or(|matrix| *matrix == SAME_COLOR)
}

fn write_templates(out: &mut dyn Write, scene: &InstancedScene) -> std::io::Result<()> {
    let plain = |template: usize| {
        let mut instances = scene.instances.iter().enumerate();
        instances.any(|(k, instance)| instance.template as usize == template && is_plain(scene, k, instance))
    };
    writeln!(out, "class \"templates\"\n{{")?;
    for (template, &SourceRange { first, count }) in scene.template_ranges.iter().enumerate() {
        if plain(template) {
            writeln!(out, "    def ParticleField3DGaussianSplat \"template_{template}\"\n    {{")?;
            write_cloud(out, &scene.templates, first as usize..(first + count) as usize)?;
            writeln!(out, "    }}")?;
        }
    }
    writeln!(out, "}}\n")
}

fn write_instance(
    out: &mut dyn Write,
    scene: &InstancedScene,
    (k, label): (usize, &InstanceLabel),
    local: &InFrames,
) -> std::io::Result<()> {
    let kind = label.group.and_then(|group| scene.groups[group].name.clone());
    let instance = &scene.instances[k];
    let plain = is_plain(scene, k, instance);
    writeln!(out, "    def ParticleField3DGaussianSplat \"instance_{k}\" (")?;
    if plain {
        writeln!(out, "        prepend references = </templates/template_{}>", instance.template)?;
    }
    if kind.is_some() {
        writeln!(out, "        prepend apiSchemas = [\"SemanticsLabelsAPI:class\"]")?;
    }
    writeln!(out, "    )\n    {{")?;
    if let Some(kind) = kind {
        writeln!(out, "        token[] semantics:labels:class = [\"{}\"]", quoted(&kind))?;
    }
    write_transform(out, instance.world_from_template.linear(), instance.world_from_template.translation())?;
    if !plain {
        write_cloud(out, &local.cloud, local.firsts[k]..local.firsts[k + 1])?;
    }
    writeln!(out, "    }}")
}

/// A text within quotes.
fn quoted(text: &str) -> String {
    text.chars()
        .filter(|c| !c.is_control())
        .flat_map(|c| matches!(c, '"' | '\\').then_some('\\').into_iter().chain([c]))
        .collect()
}

/// USD multiplies rows by matrices: the columns of the linear part are rows here, and the translation is the last one.
fn write_transform(out: &mut dyn Write, linear: DMat3, translation: DVec3) -> std::io::Result<()> {
    let row = |v: DVec3, last: u8| format!("({}, {}, {}, {last})", v.x, v.y, v.z);
    let rows = [row(linear.x_axis, 0), row(linear.y_axis, 0), row(linear.z_axis, 0), row(translation, 1)];
    writeln!(out, "        matrix4d xformOp:transform = ({})", rows.join(", "))?;
    writeln!(out, "        uniform token[] xformOpOrder = [\"xformOp:transform\"]")
}

fn write_cloud(out: &mut dyn Write, cloud: &Gaussians, rows: std::ops::Range<usize>) -> std::io::Result<()> {
    let c = cloud.sh_coefficients();
    let sigmoid = |logit: f32| (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32;
    let unit = |q: &[f32; 4]| {
        let length = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        q.map(|v| (f64::from(v) / length) as f32)
    };
    let scales: Vec<[f32; 3]> = cloud.log_scales[rows.clone()].iter().map(|s| s.map(f32::exp)).collect();
    let quats: Vec<[f32; 4]> = cloud.quats[rows.clone()].iter().map(unit).collect();
    write_rows(out, "point3f[] positions", &cloud.means[rows.clone()])?;
    write_rows(out, "quatf[] orientations", &quats)?;
    write_rows(out, "float3[] scales", &scales)?;
    let opacities: Vec<[f32; 1]> = cloud.opacity_logits[rows.clone()].iter().map(|&logit| [sigmoid(logit)]).collect();
    write_rows(out, "float[] opacities", &opacities)?;
    writeln!(out, "        uniform int radiance:sphericalHarmonicsDegree = {}", cloud.sh_degree)?;
    write_rows(out, "float3[] radiance:sphericalHarmonicsCoefficients", &cloud.sh[rows.start * c..rows.end * c])
}

/// An array of numbers or of tuples.
fn write_rows<const N: usize>(out: &mut dyn Write, name: &str, rows: &[[f32; N]]) -> std::io::Result<()> {
    write!(out, "        {name} = [")?;
    for (i, row) in rows.iter().enumerate() {
        let between = match i {
            0 => "",
            _ if (i * N).is_multiple_of(NUMBERS_A_LINE) => ",\n            ",
            _ => ", ",
        };
        let numbers: Vec<String> = row.iter().map(f32::to_string).collect();
        match N {
            1 => write!(out, "{between}{}", numbers[0])?,
            _ => write!(out, "{between}({})", numbers.join(", "))?,
        }
    }
    writeln!(out, "]")
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::{sample_scene, with_own};

    fn text(scene: &InstancedScene) -> Result<String, IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::os(Path::new("."), "no folder", &e))?;
        let path = folder.path().join("a.usda");
        write_usda(&path, scene, DVec3::NEG_Y)?;
        String::from_utf8(crate::read_bytes(&path)?).map_err(|e| IoError::new(&path, e.to_string()))
    }

    #[test]
    fn instances_are_prims_and_plain_ones_references() -> Result<(), IoError> {
        for mut scene in [sample_scene(), with_own()] {
            let plain = (0..scene.instances.len()).filter(|&k| is_plain(&scene, k, &scene.instances[k])).count();
            let written = text(&scene)?;
            assert!(written.starts_with("#usda 1.0\n"));
            assert_eq!(written.matches("def ParticleField3DGaussianSplat \"instance_").count(), scene.instances.len());
            assert_eq!(written.matches("prepend references").count(), plain);
            assert_eq!(written.matches('{').count(), written.matches('}').count());
            assert_eq!(text(&scene)?, written);
            scene.background.means[0][1] = f32::NAN;
            assert!(text(&scene).is_err_and(|e| e.to_string().contains("not finite")));
        }
        assert_eq!(quoted("a \"b\"\\\u{1b}"), "a \\\"b\\\"\\\\");
        Ok(())
    }
}
