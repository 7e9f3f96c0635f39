//! Cameras and views.

/// A camera file.
pub const CAMERAS: &str = r#"[{"name":"a","width":8,"height":8,"fx":9.0,"fy":9.0,"cx":4.0,"cy":4.0,
    "view_from_world":[[1.0,0.0,0.0,0.0],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,0.0],[0.0,0.0,0.0,1.0]]}]"#;

/// A `transforms.json` of one view.
pub const TRANSFORMS: &str = r#"{"w":8,"h":8,"fl_x":9.0,"k1":0.0,"frames":[{"file_path":"a.jpg",
    "transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;

/// A `transforms.json` of two views with a lens, a mask, intrinsics of their own, and a point cloud.
pub const TRANSFORMS_OF_MANY_KEYS: &str = r#"{"camera_model":"OPENCV","camera_angle_x":0.8,"applied_scale":0.5,
    "applied_transform":[[1,0,0,0],[0,0,1,0],[0,-1,0,0]],"ply_file_path":"points3d.ply","train_filenames":["a.png"],"frames":[
    {"file_path":"./a.png","mask_path":"m/a.png","w":8,"h":8,"fl_x":9.5,"fl_y":9,"cx":4,"cy":4,"k1":0.1,"k2":-0.01,"p1":0.001,"p2":0,
    "transform_matrix":[[0,-1,0,0.5],[1,0,0,-2],[0,0,1,3],[0,0,0,1]]},
    {"file_path":"b","w":8,"h":8,"fl_x":9.5,"transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;

/// COLMAP's `cameras.txt`.
pub const COLMAP_CAMERAS: &str = "1 PINHOLE 20 10 9 9 10 5\n";

/// COLMAP's `images.txt`.
pub const COLMAP_IMAGES: &str = "1 1 0 0 0 1 2 3 1 a.jpg\n1 2 -1\n2 1 0 0 0 1 2 3 1 b.jpg\n\n";

/// COLMAP's `cameras.bin` and `images.bin`.
pub fn colmap_bin() -> (Vec<u8>, Vec<u8>) {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    [1u32, 1].iter().for_each(|v| cameras.extend_from_slice(&v.to_le_bytes()));
    [20u64, 10].iter().for_each(|v| cameras.extend_from_slice(&v.to_le_bytes()));
    [9.0f64, 9.0, 10.0, 5.0].iter().for_each(|v| cameras.extend_from_slice(&v.to_le_bytes()));
    let mut images = 1u64.to_le_bytes().to_vec();
    images.extend_from_slice(&1u32.to_le_bytes());
    [1.0f64, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0].iter().for_each(|v| images.extend_from_slice(&v.to_le_bytes()));
    images.extend_from_slice(&1u32.to_le_bytes());
    images.extend_from_slice(b"a.jpg\0");
    images.extend_from_slice(&1u64.to_le_bytes());
    images.extend_from_slice(&[0; 24]);
    (cameras, images)
}

/// Groups of instances, with both kinds of transforms.
pub const GROUPS: &str = r#"[{"template_id":0,"name":"a","score":0.5,"instances":[{"instance_id":3,
    "transform":[[0,-2,0,1],[2,0,0,0],[0,0,2,5],[0,0,0,1]]},{"instance_id":4,
    "world_from_template":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}]"#;

/// Boxes in the world and in a photo.
pub const BOXES: &str = r#"{"objects": [{"id": 1, "category": "car", "center": [0, 0, 1], "size": [2, 4, 1.5], "rotation": [1, 0, 0, 0]}],
    "views": {"view_000": [{"box_px": [10, 20, 110.5, 80], "category": "car", "score": 0.8, "id": 1}]}}"#;
