//! Prints what this program reads of a data set, as JSON: cameras with their lens distortion, and points. tools/check_colmap
//! compares it with what other programs read.
//!
//! cargo run -p instgs-io --example dataset_json -- DIR

#![allow(clippy::print_stdout, reason = "its output")]

use std::path::Path;

use instgs_io::{View, read_points, read_views};
use serde_json::{Value, json};

fn view(view: &View) -> Value {
    let distortion = view
        .distortion
        .map(|d| json!({ "k1": d.k1, "k2": d.k2, "k3": d.k3, "p1": d.p1, "p2": d.p2, "fisheye": d.fisheye }));
    json!({ "camera": view.camera, "photo": view.image_path, "distortion": distortion })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: dataset_json DIR")?;
    let dataset = read_views(Path::new(&folder))?;
    let points = read_points(Path::new(&folder))?
        .map(|read| json!({ "positions": read.points.positions, "colors": read.points.colors }));
    let views: Vec<Value> = dataset.views.iter().map(view).collect();
    println!("{}", json!({ "views": views, "points": points, "notes": dataset.notes }));
    Ok(())
}
