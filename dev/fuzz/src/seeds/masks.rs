//! Masks of objects, of this program and of others.

use instgs_io::{IoError, Mask, mask_png};

use crate::path;

/// A mask of 16 bits of grey.
pub fn mask_png() -> Result<Vec<u8>, IoError> {
    let mask = Mask { width: 5, height: 3, ids: (0..15).map(|i| i * 300 % 7).collect() };
    mask_png::mask_bytes(&mask, path())
}

/// A mask with a palette.
pub fn palette_png() -> Result<Vec<u8>, png::EncodingError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 6, 2);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Four);
    encoder.set_palette(vec![0, 0, 0, 200, 0, 0, 0, 200, 0]);
    encoder.set_trns(vec![0, 255]);
    encoder.write_header()?.write_image_data(&[0x01, 0x20, 0x12, 0x21, 0x00, 0x11])?;
    Ok(out)
}

/// A mask in colours.
pub fn color_png() -> Result<Vec<u8>, png::EncodingError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, 2, 2);
    encoder.set_color(png::ColorType::Rgba);
    encoder.write_header()?.write_image_data(&[9, 8, 7, 255, 0, 0, 0, 255, 9, 8, 7, 0, 1, 2, 3, 255])?;
    Ok(out)
}

/// A file of COCO with polygons, and runs as text and as numbers.
pub const COCO: &str = r#"{"images":[{"id":1,"file_name":"a/1.jpg","width":9,"height":6},{"id":"2","file_name":"a/2.jpg"}],
    "annotations":[{"id":7,"image_id":1,"category_id":3,"track_id":5,"segmentation":{"size":[6,9],"counts":"5150L20N000000020N400001OO"}},
    {"id":8,"image_id":1,"category_id":3,"attributes":{"track_id":6},"segmentation":[[1,1,5.5,1,5.5,4,1,4],[2,0,7,5,2,5]]},
    {"id":9,"image_id":"2","category_id":3,"track_id":5,"segmentation":{"size":[64,64],"counts":[70,900,3126]}}],
    "categories":[{"id":3,"name":"car"}]}"#;

/// A file of labelme with every kind of shape.
pub const LABELME: &str = r#"{"shapes":[{"label":"car_1","points":[[1,1],[5.5,1],[3,4]],"shape_type":"polygon","group_id":null},
    {"label":"car_2","points":[[0,0],[3,3]],"shape_type":"rectangle","group_id":4},
    {"label":"ball","points":[[4,4],[6,5]],"shape_type":"circle"},
    {"label":"tree","points":[[2,2],[6,4]],"shape_type":"mask","mask":
    "iVBORw0KGgoAAAANSUhEUgAAAAUAAAADAQAAAABzTfhVAAAADklEQVR4nGNIYPjAoAEABN4Bedmhh2wAAAAASUVORK5CYII="},
    {"label":"here","points":[[2,2]],"shape_type":"point"}],"imagePath":"a.jpg","imageWidth":9,"imageHeight":6}"#;

/// Names of objects.
pub const CATEGORIES: &str = "{\"0\": \"nothing\", \"1\": \"car\", \"65535\": \"a chair\"}";
