//! Writes meshes of Gaussians and their accessors into the binary chunk.

use std::collections::BTreeMap;

use glam::{DVec3, DVec4};

use crate::glb::document::{Accessor, BufferView, Document, Mesh, SPLATS};
use instgs_vk::math::covariance::normalised_quat;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::{Instance, InstancedScene, SourceRange};

/// What the Gaussians of a mesh belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// A template, by index.
    Template(u32),
    /// What instances have of their own, by range.
    Own(SourceRange),
    /// The Gaussians of no instance, in the world frame.
    Background,
}

/// The Gaussians of one mesh: a template with one run of offsets or none, an instance's own, or the background.
#[derive(Clone, Copy)]
struct Part<'a> {
    kind: Kind,
    cloud: &'a Gaussians,
    range: SourceRange,
    first_offset: Option<u32>,
}

/// Identifies an accessor: semantic, owner, and the run of offsets if its values include them.
type AccessorKey = (String, Kind, Option<u32>);

/// Builds the document and the binary chunk mesh by mesh.
pub(super) struct MeshWriter<'a> {
    scene: &'a InstancedScene,
    pub(super) document: Document,
    pub(super) binary: Vec<u8>,
    accessor_of: BTreeMap<AccessorKey, usize>,
    /// Instances with the same template and the same offsets share a mesh, and so do those with the same own Gaussians.
    mesh_of: BTreeMap<(Kind, Option<u32>), usize>,
}

impl<'a> MeshWriter<'a> {
    /// A writer for a valid scene whose binary chunk will have the given length.
    pub(super) fn new(scene: &'a InstancedScene, binary_bytes: usize) -> Self {
        Self {
            scene,
            document: Document::default(),
            binary: Vec::with_capacity(binary_bytes),
            accessor_of: BTreeMap::new(),
            mesh_of: BTreeMap::new(),
        }
    }

    /// The mesh of an instance, `None` if its template is empty.
    ///
    /// # Errors
    /// Names the value that is not finite.
    pub(super) fn instance_mesh(&mut self, instance: &Instance, name: &str) -> Result<Option<usize>, String> {
        let scene = self.scene;
        self.mesh(
            name,
            Part {
                kind: Kind::Template(instance.template),
                cloud: &scene.templates,
                range: scene.template_ranges[instance.template as usize],
                first_offset: instance.first_offset,
            },
        )
    }

    /// The mesh of an instance's own Gaussians, `None` if it has none.
    pub(super) fn own_mesh(&mut self, range: SourceRange, name: &str) -> Result<Option<usize>, String> {
        self.mesh(name, Part { kind: Kind::Own(range), cloud: &self.scene.own, range, first_offset: None })
    }

    /// The mesh of the background, `None` if it is empty.
    pub(super) fn background_mesh(&mut self) -> Result<Option<usize>, String> {
        let cloud = &self.scene.background;
        let range = SourceRange { first: 0, count: cloud.len() as u32 };
        self.mesh("background", Part { kind: Kind::Background, cloud, range, first_offset: None })
    }

    fn mesh(&mut self, name: &str, part: Part<'a>) -> Result<Option<usize>, String> {
        let key = (part.kind, part.first_offset);
        if part.range.count == 0 {
            return Ok(None);
        }
        if let Some(&mesh) = self.mesh_of.get(&key) {
            return Ok(Some(mesh));
        }
        let mut attributes = BTreeMap::new();
        self.offset_attributes(part, &mut attributes)?;
        self.shape_attributes(part, &mut attributes)?;
        self.sh_rest_attributes(part, &mut attributes)?;
        let template = if let Kind::Template(template) = part.kind { Some(template) } else { None };
        self.document.meshes.push(Mesh::splats(name.to_owned(), attributes, template));
        let mesh = self.document.meshes.len() - 1;
        self.mesh_of.insert(key, mesh);
        Ok(Some(mesh))
    }

    /// Adds position, opacity and base colour, which every run of offsets changes.
    fn offset_attributes(&mut self, part: Part<'a>, out: &mut BTreeMap<String, usize>) -> Result<(), String> {
        let (cloud, offsets, run) = (part.cloud, &self.scene.offsets, part.first_offset);
        let mean =
            |i: usize, o: Option<usize>| widened(cloud.means[i]) + o.map_or(DVec3::ZERO, |o| widened(offsets.means[o]));
        let sh_dc = |i: usize, o: Option<usize>| {
            widened(cloud.sh_of(i)[0]) + o.map_or(DVec3::ZERO, |o| widened(offsets.sh_dc[o]))
        };
        let opacity = |i: usize, o: Option<usize>| {
            let d_logit = o.map_or(0.0, |o| f64::from(offsets.opacity_logits[o]));
            [1.0 / (1.0 + (-f64::from(cloud.opacity_logits[i]) - d_logit).exp())]
        };
        self.attribute("POSITION", part, run, |i, o| mean(i, o).to_array(), out)?;
        self.attribute(&splat("OPACITY"), part, run, opacity, out)?;
        self.attribute(&splat("SH_DEGREE_0_COEF_0"), part, run, |i, o| sh_dc(i, o).to_array(), out)
    }

    /// Adds scale and rotation: the template's, unless the scene has offsets of them.
    fn shape_attributes(&mut self, part: Part<'a>, out: &mut BTreeMap<String, usize>) -> Result<(), String> {
        let (cloud, offsets) = (part.cloud, &self.scene.offsets);
        let scale = |i: usize, o: Option<usize>| {
            let d_log_scale = o.map_or(DVec3::ZERO, |o| widened(offsets.log_scales[o]));
            (widened(cloud.log_scales[i]) + d_log_scale).to_array().map(f64::exp)
        };
        let rotation = |i: usize, o: Option<usize>| {
            let wide = |q: [f32; 4]| DVec4::from_array(q.map(f64::from));
            let sum = wide(cloud.quats[i]) + o.map_or(DVec4::ZERO, |o| wide(offsets.quats[o]));
            let [w, x, y, z] = normalised_quat(sum.to_array());
            [x, y, z, w]
        };
        let own_scales = part.first_offset.filter(|_| !offsets.log_scales.is_empty());
        self.attribute(&splat("SCALE"), part, own_scales, scale, out)?;
        let own_quats = part.first_offset.filter(|_| !offsets.quats.is_empty());
        self.attribute(&splat("ROTATION"), part, own_quats, rotation, out)
    }

    /// Adds SH of degree 1 and more: the template's, but for coefficients that the scene has offsets of.
    fn sh_rest_attributes(&mut self, part: Part<'a>, out: &mut BTreeMap<String, usize>) -> Result<(), String> {
        let (cloud, offsets) = (part.cloud, &self.scene.offsets);
        let mut rest = 0;
        for degree in 1..=cloud.sh_degree {
            for coefficient in 0..=2 * degree {
                let value = |i: usize, o: Option<usize>| {
                    let d_sh = o.map_or(DVec3::ZERO, |o| widened(offsets.rest_of(o)[rest]));
                    (widened(cloud.sh_of(i)[1 + rest]) + d_sh).to_array()
                };
                let own = part.first_offset.filter(|_| rest < offsets.rest_coefficients());
                self.attribute(&splat(&format!("SH_DEGREE_{degree}_COEF_{coefficient}")), part, own, value, out)?;
                rest += 1;
            }
        }
        Ok(())
    }

    /// Adds the accessor with `value(Gaussian, offset record)` of every Gaussian, written unless it exists.
    /// `first_offset` is the part's if the values include offsets; otherwise other parts share the accessor.
    fn attribute<const N: usize>(
        &mut self,
        semantic: &str,
        part: Part<'a>,
        first_offset: Option<u32>,
        value: impl Fn(usize, Option<usize>) -> [f64; N],
        out: &mut BTreeMap<String, usize>,
    ) -> Result<(), String> {
        let key = (semantic.to_owned(), part.kind, first_offset);
        let accessor = match self.accessor_of.get(&key) {
            Some(&accessor) => accessor,
            None => {
                let values = (0..part.range.count as usize).map(|local| {
                    value(part.range.first as usize + local, first_offset.map(|first| first as usize + local))
                });
                let accessor = self.accessor(values, semantic)?;
                self.accessor_of.insert(key, accessor);
                accessor
            }
        };
        out.insert(semantic.to_owned(), accessor);
        Ok(())
    }

    /// Appends values as f32 to the binary chunk; glTF requires the bounds of positions.
    fn accessor<const N: usize>(
        &mut self,
        values: impl Iterator<Item = [f64; N]>,
        semantic: &str,
    ) -> Result<usize, String> {
        let begin = self.binary.len();
        let mut count = 0;
        let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for element in values {
            for (axis, value) in element.into_iter().enumerate() {
                let value = value as f32;
                if !value.is_finite() {
                    return Err(format!("{semantic} of Gaussian {count} is not finite"));
                }
                if let (Some(min), Some(max)) = (min.get_mut(axis), max.get_mut(axis)) {
                    (*min, *max) = (min.min(value), max.max(value));
                }
                self.binary.extend_from_slice(&value.to_le_bytes());
            }
            count += 1;
        }
        let document = &mut self.document;
        document.buffer_views.push(BufferView::attribute(begin, self.binary.len() - begin));
        let bounds = (semantic == "POSITION").then_some([min, max]);
        document.accessors.push(Accessor::floats::<N>(document.buffer_views.len() - 1, count, bounds));
        Ok(document.accessors.len() - 1)
    }
}

/// Full name of an attribute of the extension.
fn splat(name: &str) -> String {
    format!("{SPLATS}:{name}")
}
