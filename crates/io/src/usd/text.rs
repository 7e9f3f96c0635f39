//! The prims as text.

use std::io::{Result, Write};

use glam::DMat4;

use super::layer::{
    LABEL, LABEL_SCHEMA, Layer, Prim, Rows, SCENE, SH, SH_DEGREE, SPLATS, TEMPLATES, TRANSFORM, TRANSFORM_ORDER,
    rows_of,
};

/// Numbers of a line of text.
const NUMBERS_A_LINE: usize = 24;

pub(super) fn write(out: &mut dyn Write, layer: &Layer<'_>) -> Result<()> {
    writeln!(out, "#usda 1.0\n(\n    defaultPrim = \"{SCENE}\"\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n")?;
    writeln!(out, "class \"{TEMPLATES}\"\n{{")?;
    layer.templates.iter().try_for_each(|prim| write_prim(out, prim))?;
    writeln!(out, "}}\n\ndef Xform \"{SCENE}\"\n{{")?;
    write_transform(out, &layer.transform)?;
    layer.prims.iter().try_for_each(|prim| write_prim(out, prim))?;
    writeln!(out, "}}")
}

fn write_prim(out: &mut dyn Write, prim: &Prim<'_>) -> Result<()> {
    writeln!(out, "    def {SPLATS} \"{}\" (", prim.name)?;
    if let Some(template) = &prim.template {
        writeln!(out, "        prepend references = </{TEMPLATES}/{template}>")?;
    }
    if prim.label.is_some() {
        writeln!(out, "        prepend apiSchemas = [\"{LABEL_SCHEMA}\"]")?;
    }
    writeln!(out, "    )\n    {{")?;
    if let Some(label) = &prim.label {
        writeln!(out, "        token[] {LABEL} = [\"{}\"]", quoted(label))?;
    }
    if let Some(transform) = &prim.transform {
        write_transform(out, transform)?;
    }
    if let Some(cloud) = &prim.cloud {
        write_cloud(out, cloud)?;
    }
    writeln!(out, "    }}")
}

/// A text within quotes.
pub(super) fn quoted(text: &str) -> String {
    text.chars().flat_map(|c| matches!(c, '"' | '\\').then_some('\\').into_iter().chain([c])).collect()
}

fn write_transform(out: &mut dyn Write, transform: &DMat4) -> Result<()> {
    let rows = rows_of(transform).map(|[x, y, z, w]| format!("({x}, {y}, {z}, {w})"));
    writeln!(out, "        matrix4d {TRANSFORM} = ({})", rows.join(", "))?;
    writeln!(out, "        uniform token[] {TRANSFORM_ORDER} = [\"{TRANSFORM}\"]")
}

fn write_cloud(out: &mut dyn Write, cloud: &Rows<'_>) -> Result<()> {
    write_rows(out, "point3f[] positions", cloud.positions())?;
    write_rows(out, "quatf[] orientations", &cloud.orientations())?;
    write_rows(out, "float3[] scales", &cloud.scales())?;
    let opacities: Vec<[f32; 1]> = cloud.opacities().into_iter().map(|opacity| [opacity]).collect();
    write_rows(out, "float[] opacities", &opacities)?;
    writeln!(out, "        uniform int {SH_DEGREE} = {}", cloud.sh_degree())?;
    write_rows(out, &format!("float3[] {SH}"), cloud.sh())
}

/// An array of numbers or of tuples.
fn write_rows<const N: usize>(out: &mut dyn Write, name: &str, rows: &[[f32; N]]) -> Result<()> {
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
