//! The prims as a crate file, written by `openusd`.

use std::io::Cursor;

use glam::DMat4;
use openusd::gf::{Matrix4d, Quatf, Vec3f};
use openusd::sdf::{
    ChildrenKey, Data, FieldKey, Path, Reference, ReferenceListOp, SpecType, Specifier, TokenListOp, Value, Variability,
};
use openusd::tf::Token;
use openusd::usdc::CrateWriter;

use super::children::as_token_vectors;
use super::layer::{
    LABEL, LABEL_SCHEMA, Layer, Prim, Rows, SCENE, SH, SH_DEGREE, SPLATS, TEMPLATES, TRANSFORM, TRANSFORM_ORDER,
    rows_of,
};

/// Type, variability and value of an attribute.
struct Attribute {
    name: &'static str,
    kind: &'static str,
    variability: Variability,
    value: Value,
}

/// The bytes of the file.
///
/// # Errors
/// What `openusd` says, in words.
pub(super) fn bytes(layer: &Layer<'_>) -> Result<Vec<u8>, String> {
    let mut data = Data::new();
    let root = data.create_spec(Path::abs_root(), SpecType::PseudoRoot);
    root.add(FieldKey::DefaultPrim, Value::Token(SCENE.into()));
    root.add("metersPerUnit", Value::Double(1.0));
    root.add("upAxis", Value::Token("Y".into()));
    root.add(ChildrenKey::PrimChildren, tokens([TEMPLATES, SCENE]));

    let templates = path(&format!("/{TEMPLATES}"))?;
    let spec = data.create_spec(templates, SpecType::Prim);
    spec.add(FieldKey::Specifier, Value::Specifier(Specifier::Class));
    spec.add(ChildrenKey::PrimChildren, tokens(layer.templates.iter().map(|prim| prim.name.as_str())));
    layer.templates.iter().try_for_each(|prim| add_prim(&mut data, TEMPLATES, prim))?;

    let scene = path(&format!("/{SCENE}"))?;
    let spec = data.create_spec(scene.clone(), SpecType::Prim);
    spec.add(FieldKey::Specifier, Value::Specifier(Specifier::Def));
    spec.add(FieldKey::TypeName, Value::Token("Xform".into()));
    spec.add(ChildrenKey::PrimChildren, tokens(layer.prims.iter().map(|prim| prim.name.as_str())));
    add_attributes(&mut data, &scene, transform(&layer.transform).into())?;
    layer.prims.iter().try_for_each(|prim| add_prim(&mut data, SCENE, prim))?;

    let mut out = Cursor::new(Vec::new());
    CrateWriter::write(&data, &mut out).map_err(|e| e.to_string())?;
    as_token_vectors(out.into_inner())
}

fn path(text: &str) -> Result<Path, String> {
    Path::new(text).map_err(|e| e.to_string())
}

fn tokens<'a>(names: impl IntoIterator<Item = &'a str>) -> Value {
    Value::TokenVec(names.into_iter().map(Token::from).collect())
}

fn add_prim(data: &mut Data, parent: &str, prim: &Prim<'_>) -> Result<(), String> {
    let at = path(&format!("/{parent}/{}", prim.name))?;
    let spec = data.create_spec(at.clone(), SpecType::Prim);
    spec.add(FieldKey::Specifier, Value::Specifier(Specifier::Def));
    spec.add(FieldKey::TypeName, Value::Token(SPLATS.into()));
    if let Some(template) = &prim.template {
        let reference = Reference { prim_path: path(&format!("/{TEMPLATES}/{template}"))?, ..Reference::default() };
        spec.add(FieldKey::References, Value::ReferenceListOp(ReferenceListOp::prepended([reference])));
    }
    let mut attributes = Vec::new();
    if let Some(label) = &prim.label {
        spec.add(FieldKey::ApiSchemas, Value::TokenListOp(TokenListOp::prepended([Token::from(LABEL_SCHEMA)])));
        attributes.push(varying(LABEL, "token[]", tokens([label.as_str()])));
    }
    attributes.extend(prim.transform.iter().flat_map(transform));
    attributes.extend(prim.cloud.iter().flat_map(cloud));
    add_attributes(data, &at, attributes)
}

fn add_attributes(data: &mut Data, prim: &Path, attributes: Vec<Attribute>) -> Result<(), String> {
    if let Some(spec) = data.spec_mut(prim) {
        spec.add(ChildrenKey::PropertyChildren, tokens(attributes.iter().map(|attribute| attribute.name)));
    }
    for Attribute { name, kind, variability, value } in attributes {
        let spec = data.create_spec(prim.append_property(name).map_err(|e| e.to_string())?, SpecType::Attribute);
        spec.add(FieldKey::TypeName, Value::Token(kind.into()));
        if variability == Variability::Uniform {
            spec.add(FieldKey::Variability, Value::Variability(variability));
        }
        spec.add(FieldKey::Default, value);
    }
    Ok(())
}

fn varying(name: &'static str, kind: &'static str, value: Value) -> Attribute {
    Attribute { name, kind, variability: Variability::Varying, value }
}

fn uniform(name: &'static str, kind: &'static str, value: Value) -> Attribute {
    Attribute { name, kind, variability: Variability::Uniform, value }
}

fn transform(transform: &DMat4) -> [Attribute; 2] {
    let mut matrix = [0.0; 16];
    matrix.copy_from_slice(rows_of(transform).as_flattened());
    [
        varying(TRANSFORM, "matrix4d", Value::Matrix4d(Matrix4d(matrix))),
        uniform(TRANSFORM_ORDER, "token[]", tokens([TRANSFORM])),
    ]
}

fn cloud(rows: &Rows<'_>) -> [Attribute; 6] {
    let vectors = |rows: &[[f32; 3]]| Value::Vec3fVec(rows.iter().copied().map(Vec3f::from).collect());
    let quats = rows.orientations().into_iter().map(|[w, x, y, z]| Quatf { w, x, y, z }).collect();
    [
        varying("positions", "point3f[]", vectors(rows.positions())),
        varying("orientations", "quatf[]", Value::QuatfVec(quats)),
        varying("scales", "float3[]", vectors(&rows.scales())),
        varying("opacities", "float[]", Value::FloatVec(rows.opacities())),
        uniform(SH_DEGREE, "int", Value::Int(rows.sh_degree() as i32)),
        varying(SH, "float3[]", vectors(rows.sh())),
    ]
}
