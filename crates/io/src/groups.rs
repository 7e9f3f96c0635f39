//! `groups.json`: repeated objects and their poses; an extension of the `scene_graph.json` of the paper's public code.
//!
//! A list of `{"template_id", "name"?, "score"?, "instances": [{"instance_id", "transform", "world_from_template"}]}`.
//! Matrices are 4x4, row major. `transform` maps the instance to the template; `world_from_template` is its inverse and
//! takes precedence. Both are written. Unknown keys are ignored.

use std::collections::BTreeSet;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera_file::parse_json;
use crate::error::{IoError, Place};
use crate::{atomic_write, read_bytes};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::posed_group::{PosedGroup, PosedInstance};

/// The largest id that a 16-bit mask can hold; 0 is no object.
pub(super) const MAX_INSTANCE_ID: u32 = u16::MAX as u32;
/// How far the fourth row may be from 0 0 0 1: matrices that were inverted or multiplied in f32 are within 1e-6.
const AFFINE_TOLERANCE: f64 = 1e-5;

type Matrix = [[f64; 4]; 4];

#[derive(Deserialize)]
struct GroupFields {
    template_id: u32,
    name: Option<String>,
    score: Option<f64>,
    instances: Vec<serde_json::Value>,
}

#[derive(Deserialize)]
struct InstanceFields {
    instance_id: u32,
    transform: Option<Matrix>,
    world_from_template: Option<Matrix>,
}

#[derive(Serialize)]
struct InstanceOut {
    instance_id: u32,
    transform: Matrix,
    world_from_template: Matrix,
}

/// Reads a file of groups.
///
/// # Errors
/// An id that is not 1..=65535 or used twice, a template that two groups use, a group without instances, a score
/// outside 0..=1, or a matrix that is not a similarity. The error names the group and the instance.
pub fn read_groups(path: &Path) -> Result<Vec<PosedGroup>, IoError> {
    parse_groups(&read_bytes(path)?, path)
}

/// Parses the bytes of a file of groups; `path` is only used in messages.
pub fn parse_groups(bytes: &[u8], path: &Path) -> Result<Vec<PosedGroup>, IoError> {
    let serde_json::Value::Array(values) = parse_json(bytes, path)? else {
        return Err(IoError::new(path, "is not a list of groups").advise("`instgs-vk register` writes such files"));
    };
    let mut groups = Vec::with_capacity(values.len());
    for (g, value) in values.into_iter().enumerate() {
        let name = value.get("name").and_then(|n| n.as_str()).map(str::to_owned);
        let place = group_place(g, name.as_deref());
        let fields: GroupFields = serde_json::from_value(value)
            .map_err(|e| IoError::new(path, e.to_string()).at(Place::Field(place.clone())))?;
        let mut instances = Vec::with_capacity(fields.instances.len());
        for (i, value) in fields.instances.into_iter().enumerate() {
            let instance = parse_instance(value)
                .map_err(|what| IoError::new(path, what).at(Place::Field(format!("{place}, instance {i}"))))?;
            instances.push(instance);
        }
        let (template_id, score) = (fields.template_id, fields.score);
        groups.push(PosedGroup { template_id, name: fields.name, score, instances });
    }
    check(&groups, path)?;
    Ok(groups)
}

/// Writes groups, one instance per line. Checks the same as [`read_groups`], so that the file can be read; values are
/// preserved to the bit.
pub fn write_groups(path: &Path, groups: &[PosedGroup]) -> Result<(), IoError> {
    check(groups, path)?;
    let text = groups_text(groups).map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    atomic_write(path, |out| out.write_all(text.as_bytes()))
}

fn groups_text(groups: &[PosedGroup]) -> serde_json::Result<String> {
    let mut blocks = Vec::with_capacity(groups.len());
    for group in groups {
        let mut head = format!(" {{\"template_id\": {}", group.template_id);
        if let Some(name) = &group.name {
            head += &format!(", \"name\": {}", serde_json::to_string(name)?);
        }
        if let Some(score) = group.score {
            head += &format!(", \"score\": {}", serde_json::to_string(&score)?);
        }
        let mut lines = Vec::with_capacity(group.instances.len());
        for instance in &group.instances {
            let world_from_template = affine_of(&instance.world_from_template);
            lines.push(serde_json::to_string(&InstanceOut {
                instance_id: instance.id,
                transform: matrix_of(world_from_template.inverse()),
                world_from_template: matrix_of(world_from_template),
            })?);
        }
        blocks.push(format!("{head}, \"instances\": [\n  {}\n ]}}", lines.join(",\n  ")));
    }
    Ok(if blocks.is_empty() { "[]\n".into() } else { format!("[\n{}\n]\n", blocks.join(",\n")) })
}

fn group_place(index: usize, name: Option<&str>) -> String {
    format!("group {index}{}", name.map(|n| format!(" ({n})")).unwrap_or_default())
}

/// Parses one instance; the error completes a message that already names group and instance.
fn parse_instance(value: serde_json::Value) -> Result<PosedInstance, String> {
    let fields: InstanceFields = serde_json::from_value(value).map_err(|e| e.to_string())?;
    let id = fields.instance_id;
    let named = |key: &str, e: String| format!("(id {id}) {key} {e}");
    let world_from_template = match (fields.world_from_template, fields.transform) {
        (Some(matrix), _) => similarity(&matrix).map_err(|e| named("world_from_template", e))?,
        (None, Some(matrix)) => {
            // Checked before the inversion, so that the message is about the file's values.
            similarity(&matrix).map_err(|e| named("transform", e))?;
            let inverse = matrix_of(affine(&matrix).inverse());
            similarity(&inverse).map_err(|e| named("inverse of transform", e))?
        }
        (None, None) => return Err(named("has", "neither world_from_template nor transform".into())),
    };
    Ok(PosedInstance { id, world_from_template })
}

fn similarity(matrix: &Matrix) -> Result<Similarity, String> {
    let is_affine_row =
        |row: [f64; 4]| row.iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() <= AFFINE_TOLERANCE);
    if !is_affine_row(matrix[3]) {
        let hint = if is_affine_row([0, 1, 2, 3].map(|i| matrix[i][3])) { "; is the matrix transposed?" } else { "" };
        return Err(format!("has the fourth row {:?}, not 0 0 0 1{hint}", matrix[3]));
    }
    Similarity::from_rows([0, 1, 2].map(|i: usize| matrix[i].map(|v| v as f32))).map_err(|e| e.to_string())
}

fn affine(matrix: &Matrix) -> DAffine3 {
    let column = |j: usize| DVec3::new(matrix[0][j], matrix[1][j], matrix[2][j]);
    DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3))
}

fn affine_of(similarity: &Similarity) -> DAffine3 {
    DAffine3::from_mat3_translation(similarity.linear(), similarity.translation())
}

fn matrix_of(affine: DAffine3) -> Matrix {
    let (a, t) = (affine.matrix3, affine.translation);
    let row = |i: usize| [a.row(i).x, a.row(i).y, a.row(i).z, t[i]];
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// Checks the rules for groups in a file or in memory; the error names the group and the instance.
fn check(groups: &[PosedGroup], path: &Path) -> Result<(), IoError> {
    let (mut templates, mut ids) = (BTreeSet::new(), BTreeSet::new());
    for (g, group) in groups.iter().enumerate() {
        let place = group_place(g, group.name.as_deref());
        let fail = |what: String| Err(IoError::new(path, what).at(Place::Field(place.clone())));
        if !templates.insert(group.template_id) {
            return fail(format!("an earlier group has the same template_id {}", group.template_id));
        }
        if let Some(score) = group.score.filter(|s| !(0.0..=1.0).contains(s)) {
            return fail(format!("has the score {score}, which is not from 0 to 1"));
        }
        if group.instances.is_empty() {
            return fail("has no instances".into());
        }
        for (i, instance) in group.instances.iter().enumerate() {
            let id = instance.id;
            if !(1..=MAX_INSTANCE_ID).contains(&id) {
                return fail(format!("instance {i} has the id {id}: ids are those of masks, 1 to {MAX_INSTANCE_ID}"));
            }
            if !ids.insert(id) {
                return fail(format!("instance {i} has the id {id} of an earlier instance"));
            }
            if let Err(e) = Similarity::from_rows(instance.world_from_template.rows()) {
                return fail(format!("instance {i} (id {id}) world_from_template {e}"));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(angle: f64, scale: f64, x: f64) -> Similarity {
        Similarity::from_parts(DMat3::from_rotation_z(angle), scale, DVec3::new(x, -2.0 * x, 0.1))
    }

    fn sample() -> Vec<PosedGroup> {
        let instance =
            |id: u32| PosedInstance { id, world_from_template: pose(0.3 * f64::from(id), 1.5, f64::from(id)) };
        vec![
            PosedGroup {
                template_id: 0,
                name: Some("a \"chair\"".into()),
                score: Some(0.1 + 0.2),
                instances: vec![instance(7), instance(1), instance(65535)],
            },
            PosedGroup { template_id: 4, name: None, score: None, instances: vec![instance(2)] },
        ]
    }

    #[test]
    fn what_is_written_is_read_to_the_bit() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("groups.json");
        for groups in [sample(), Vec::new()] {
            write_groups(&path, &groups)?;
            assert_eq!(read_groups(&path)?, groups);
        }
        Ok(())
    }

    #[test]
    fn transform_is_the_inverse_and_world_from_template_wins() -> Result<(), Box<dyn std::error::Error>> {
        let path = Path::new("scene_graph.json");
        let text = groups_text(&sample())?;
        let only_transform: serde_json::Value = serde_json::from_str(&text)?;
        let mut other = only_transform.clone();
        let strip = |value: &mut serde_json::Value, key: &str| {
            for group in value.as_array_mut().into_iter().flatten() {
                for instance in group["instances"].as_array_mut().into_iter().flatten() {
                    instance[key] = serde_json::Value::Null;
                }
            }
        };
        let mut only_transform = only_transform;
        strip(&mut only_transform, "world_from_template");
        let back = parse_groups(&serde_json::to_vec(&only_transform)?, path)?;
        for (a, b) in back.iter().zip(sample()).flat_map(|(a, b)| a.instances.clone().into_iter().zip(b.instances)) {
            // Measured: 65535 becomes 65534.996, one unit in the last place of f32.
            let p = DVec3::new(0.3, -0.7, 2.0);
            let (a, b) = (a.world_from_template.transform_point(p), b.world_from_template.transform_point(p));
            assert!((a - b).length() <= 1e-6 * b.length(), "{a} {b}");
        }
        strip(&mut other, "transform");
        assert_eq!(parse_groups(&serde_json::to_vec(&other)?, path)?, sample());
        other[0]["instances"][0]["transform"] =
            serde_json::json!([[1, 2, 3, 4], [0, 0, 0, 0], [0, 0, 0, 0], [9, 9, 9, 9]]);
        assert_eq!(parse_groups(&serde_json::to_vec(&other)?, path)?, sample());
        Ok(())
    }

    /// The error for a list of one group with the given instances.
    fn error_of(instances: &str) -> String {
        let text = format!("[{{\"template_id\": 3, \"name\": \"vase\", \"extra\": 1, \"instances\": [{instances}]}}]");
        parse_groups(text.as_bytes(), Path::new("g.json")).err().map(|e| e.to_string()).unwrap_or_default()
    }

    #[test]
    fn errors_name_group_and_instance() {
        const ONE: &str = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
        let instance = |id: &str, matrix: &str| format!("{{\"instance_id\": {id}, \"transform\": {matrix}}}");
        assert_eq!(error_of(&instance("9", ONE)), "");
        for (instances, want) in [
            (String::new(), "group 0 (vase): has no instances"),
            (instance("0", ONE), "instance 0 has the id 0"),
            (instance("65536", ONE), "has the id 65536"),
            (instance("-1", ONE), "group 0 (vase), instance 0: invalid value"),
            (format!("{0},{0}", instance("5", ONE)), "instance 1 has the id 5 of an earlier"),
            ("{\"instance_id\": 5}".into(), "(id 5) has neither"),
            (instance("5", "[[1,0,0,0],[0,1,0,0],[0,0,1,0]]"), "invalid length 3"),
            (instance("5", "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[1,2,3,1]]"), "transposed?"),
            (instance("5", "[[1,0,0,9],[0,1,0,0],[0,0,1,0],[1,2,3,1]]"), "not 0 0 0 1"),
            (instance("5", "[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]"), "transform has determinant"),
            (instance("5", "[[1,0,0,0],[0,2,0,0],[0,0,1,0],[0,0,0,1]]"), "uniform scale"),
            (instance("5", "[[1e39,0,0,0],[0,1e39,0,0],[0,0,1e39,0],[0,0,0,1]]"), "not finite"),
            (instance("5", "[[1e-30,0,0,1e30],[0,1e-30,0,0],[0,0,1e-30,0],[0,0,0,1]]"), "inverse of transform"),
        ] {
            let text = error_of(&instances);
            assert!(text.contains("group 0 (vase)") && text.contains(want), "{text} lacks {want}");
        }
        let of =
            |text: &str| parse_groups(text.as_bytes(), Path::new("g")).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(of("{}").contains("not a list") && of("[\n{").contains("line 2"));
        assert!(of("[3]").contains("group 0") && of("[{\"template_id\": 1}]").contains("instances"));
    }

    #[test]
    fn what_cannot_be_read_is_not_written() {
        let folder = tempfile::tempdir().map(|f| f.path().join("groups.json")).unwrap_or_default();
        let mut twice = sample();
        twice[1].template_id = 0;
        let mut score = sample();
        score[0].score = Some(f64::NAN);
        let mut flat = sample();
        flat[1].instances[0].world_from_template = pose(0.0, 0.0, 1.0);
        for (groups, want) in
            [(twice, "same template_id 0"), (score, "score NaN"), (flat, "(id 2) world_from_template")]
        {
            let text = write_groups(&folder, &groups).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains(want), "{text}");
        }
        assert!(!folder.exists());
    }
}
