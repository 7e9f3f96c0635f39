//! Tests of masks of all kinds, as views get them.

use super::*;
use crate::Split;
use instgs_vk::scene::Camera;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// A view of `width` pixels in one row.
fn view(name: &str, width: u32) -> View {
    let view_from_world = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let (cx, cy) = (0.5 * f64::from(width), 0.5);
    let camera = Camera { name: name.into(), width, height: 1, fx: 1.0, fy: 1.0, cx, cy, view_from_world };
    View { camera, image_path: PathBuf::new(), split: Split::Train, distortion: None, mask_path: None }
}

fn mask() -> Mask {
    Mask { width: 3, height: 2, ids: vec![0, 1, 65535, 256, 0, 1] }
}

#[test]
fn resizing_takes_the_pixel_at_the_centre() {
    let double = mask().resized(6, 4);
    assert_eq!(double.ids[..6], [0, 0, 1, 1, 65535, 65535]);
    assert_eq!((double.ids.len(), double.ids[12], double.ids[23]), (24, 256, 1));
    assert_eq!(double.resized(3, 2), mask());
    // Centres of one pixel over three (1.5), and of two over three (0.75 and 2.25).
    assert_eq!(mask().resized(1, 1).ids, [0]);
    assert_eq!(mask().resized(2, 1).ids, [256, 1]);
    assert_eq!(mask().resized(0, 5).ids, [0u16; 0]);
    assert_eq!(Mask::default().resized(2, 1).ids, [0, 0]);
}

#[test]
fn ids_are_counted_without_zero() {
    assert_eq!(mask().ids_present(), BTreeMap::from([(1, 2), (256, 1), (65535, 1)]));
}

#[test]
fn views_find_their_masks() -> Outcome {
    let folder = tempfile::tempdir()?;
    let root = folder.path().join("masks");
    assert_eq!(MaskFolder::default_for(folder.path()), None);
    std::fs::create_dir_all(root.join("left"))?;
    std::fs::create_dir_all(root.join("right"))?;
    assert_eq!(MaskFolder::default_for(folder.path()), Some(root.clone()));
    assert!(MaskFolder::open(&root, &[]).is_err_and(|e| e.to_string().contains("has no masks")));
    let of = |id: u16| Mask { width: 1, height: 1, ids: vec![id] };
    for (id, name) in [(1, "a.b.PNG"), (2, "left/1.png"), (3, "right/1.png"), (4, "right/2.png")] {
        write_mask(&root.join(name), &of(id))?;
    }
    std::fs::write(root.join("notes.txt"), "not a mask")?;
    let views: Vec<View> = ["a.b", "left_1", "right_1", "right_2"].map(|name| view(name, 1)).into();
    let masks = MaskFolder::open(&root, &views)?;
    assert!(masks.categories.is_empty());
    for (id, name) in [(1, "a.b"), (2, "left_1"), (3, "right_1"), (4, "2"), (4, "right_2")] {
        assert_eq!(masks.of_view(&view(name, 1))?, Some(of(id)), "{name}");
    }
    assert_eq!(masks.of_view(&view("a", 1))?, None);
    let has = |name| masks.has_view(&view(name, 1));
    assert!(has("left_1")? && has("2")? && !has("a")?);
    // As COLMAP names masks: after the whole name of the photo.
    write_mask(&root.join("left/7.jpg.png"), &of(5))?;
    let photo = View { image_path: "images/left/7.jpg".into(), ..view("left_7", 1) };
    assert_eq!(MaskFolder::open(&root, &views)?.of_view(&photo)?, Some(of(5)));
    let alone = View { image_path: "images/left/7.jpg".into(), ..view("7", 1) };
    assert_eq!(MaskFolder::open(&root, &views)?.of_view(&alone)?, Some(of(5)));
    // A photo outside of folders has the name that a block gives the same photo of a folder.
    write_mask(&root.join("7.png"), &of(6))?;
    let outside = View { image_path: "images/7.jpg".into(), ..view("7", 1) };
    for (photo, id) in [(&alone, 5), (&outside, 6)] {
        assert_eq!(MaskFolder::open(&root, &views)?.of_view(photo)?, Some(of(id)));
    }
    std::fs::remove_file(root.join("7.png"))?;
    assert!(masks.of_view(&view("1", 1)).is_err_and(|e| e.to_string().contains("view 1")));
    let text = masks.of_view(&view("2", 3)).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("2.png") && text.contains("1x1") && text.contains("3x1"), "{text}");
    std::fs::write(root.join("a.b.png"), "")?;
    // If names differ in more than case, they are two files for one view.
    if std::fs::read_dir(&root)?.count() == 5 {
        assert!(MaskFolder::open(&root, &[]).is_err_and(|e| e.to_string().contains("same view")));
    }
    assert!(MaskFolder::open(&root.join("none"), &views).is_err());
    Ok(())
}

#[test]
fn categories_name_ids() -> Outcome {
    let folder = tempfile::tempdir()?;
    write_mask(&folder.path().join("a.png"), &mask())?;
    let path = folder.path().join(CATEGORIES);
    let categories = BTreeMap::from([(1, "chair".to_owned()), (65535, "a \"vase\"".to_owned())]);
    write_categories(&path, &categories)?;
    assert_eq!(MaskFolder::open(folder.path(), &[])?.categories, categories);
    std::fs::write(&path, r#"{"0": "background", "7": "table"}"#)?;
    assert_eq!(read_categories(&path)?, BTreeMap::from([(7, "table".to_owned())]));
    for (text, want) in [
        ("[]", "not a JSON object"),
        (r#"{"65536": "x"}"#, "\"65536\": is not a mask id"),
        (r#"{"chair": "1"}"#, "\"chair\": is not a mask id"),
        (r#"{"1": 2}"#, "not a string"),
        (r#"{"1": "a", "01": "b"}"#, "twice"),
        ("{", "not valid JSON"),
    ] {
        std::fs::write(&path, text)?;
        let text = MaskFolder::open(folder.path(), &[]).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains(want), "{text} lacks {want}");
    }
    assert!(write_categories(&path, &BTreeMap::from([(0, "x".to_owned())])).is_err());
    Ok(())
}

/// Two photos of 6x4 pixels with a car, on which a small tree stands, and their ids.
const PHOTOS: [(&str, [u16; 24]); 2] = [
    ("a", [1, 1, 1, 0, 0, 0, 1, 2, 1, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
    ("b", [0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 2, 1, 0, 0, 0, 1, 1, 1]),
];

/// A view of 6x4 pixels.
fn photo(name: &str) -> View {
    let mut view = view(name, 6);
    view.camera.height = 4;
    View { image_path: format!("images/{name}.jpg").into(), ..view }
}

fn photos() -> Vec<View> {
    PHOTOS.map(|(name, _)| photo(name)).into()
}

fn error_of(path: &Path) -> String {
    MaskFolder::open(path, &photos()).err().map(|e| e.to_string()).unwrap_or_default()
}

/// Checks that masks of another kind are those that PNGs of these ids would be, and returns them.
fn is_the_same(path: &Path, ids: [u16; 3]) -> Result<MaskFolder, IoError> {
    let masks = MaskFolder::open(path, &photos())?;
    for (name, want) in PHOTOS {
        let view = photo(name);
        let want = want.map(|id| ids[usize::from(id)]).to_vec();
        assert!(masks.has_view(&view)?);
        assert_eq!(
            masks.of_view(&view)?,
            Some(Mask { width: 6, height: 4, ids: want }),
            "{name} of {}",
            path.display()
        );
    }
    assert_eq!(masks.of_view(&photo("c"))?, None);
    Ok(masks)
}

fn names(masks: &MaskFolder) -> Vec<(u32, &str)> {
    masks.categories.iter().map(|(id, name)| (*id, name.as_str())).collect()
}

/// A COCO file of the photos; the cars are polygons, the trees runs, in b before the car. `of` makes what else an annotation has
/// from its object.
fn coco(of: &dyn Fn(&str) -> String) -> String {
    let annotation = |id: u32, image: u32, object: &str, segmentation: &str| {
        let category = if object == "car" { 5 } else { 8 };
        let more = of(object);
        format!(r#"{{"id":{id},"image_id":{image},"category_id":{category},"segmentation":{segmentation}{more}}}"#)
    };
    let annotations = [
        annotation(1, 10, "car", "[[0,0,3,0,3,3,0,3]]"),
        annotation(2, 10, "tree", r#"{"size":[4,6],"counts":[5,1,18]}"#),
        annotation(3, 11, "tree", r#"{"size":[4,6],"counts":"b015"}"#),
        annotation(4, 11, "car", "[[3,1,6,1,6,4,3,4],[3,1,4,1,4,2,3,2]]"),
    ];
    format!(
        r#"{{"images":[{{"id":10,"file_name":"photos\\a.jpg","width":6,"height":4}},{{"id":11,"file_name":"photos/b.jpg"}}],
        "annotations":[{}],"categories":[{{"id":5,"name":"car"}},{{"id":8,"name":"tree"}}]}}"#,
        annotations.join(",")
    )
}

#[test]
fn coco_files_are_masks_of_ids() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("objects.json");
    let track = |object: &str| if object == "car" { 7 } else { 3 };
    let ways: [&dyn Fn(&str) -> String; 3] = [
        &|object| format!(r#","track_id":{}"#, track(object)),
        &|object| format!(r#","instance_id":"{}""#, track(object)),
        &|object| format!(r#","attributes":{{"occluded":false,"track_id":{}.0}}"#, track(object)),
    ];
    for of in ways {
        std::fs::write(&path, coco(of))?;
        for at in [path.as_path(), folder.path()] {
            let masks = is_the_same(at, [0, 7, 3])?;
            assert_eq!((names(&masks), masks.notes.len()), (vec![(3, "tree"), (7, "car")], 0));
        }
    }
    // Photos of two cameras, of which the file has one.
    let of_rig =
        |camera: &str| View { image_path: format!("images/{camera}/a.jpg").into(), ..photo(&format!("{camera}_a")) };
    std::fs::write(&path, coco(ways[0]).replace(r"photos\\a", "left/a").replace("photos/b", "left/b"))?;
    let masks = MaskFolder::open(&path, &[of_rig("left"), of_rig("right")])?;
    assert!(masks.of_view(&of_rig("left"))?.is_some() && masks.of_view(&of_rig("right"))?.is_none());
    // Without ids of objects, ids say only what kind they are, and a line says so.
    std::fs::write(&path, coco(&|_| String::new()))?;
    let masks = is_the_same(&path, [0, 1, 2])?;
    assert_eq!(names(&masks), [(1, "car"), (2, "tree")]);
    assert!(
        masks.notes.len() == 1 && masks.notes[0].contains("track_id") && masks.notes[0].len() < 300,
        "{:?}",
        masks.notes
    );
    // The file lies beside the photos, which are no masks; a PNG of another name may be one.
    std::fs::create_dir(folder.path().join("photos"))?;
    std::fs::write(&path, coco(&|_| String::new()).replace(".jpg", ".png"))?;
    std::fs::write(folder.path().join("photos/a.png"), "a photo")?;
    is_the_same(folder.path(), [0, 1, 2])?;
    std::fs::write(folder.path().join("photos/c.png"), "a mask?")?;
    assert!(error_of(folder.path()).contains("c.png beside it"), "{}", error_of(folder.path()));
    assert!(
        MaskFolder::open(&path, &photos())?.file_of(&photo("a")).is_err_and(|e| e.to_string().contains("one PNG per"))
    );
    Ok(())
}

#[test]
fn coco_files_that_cannot_be_used_say_where() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("objects.json");
    let plain = coco(&|_| String::new());
    for (from, to, want) in [
        (r#""image_id":11"#, r#""image_id":12"#, "annotation 3: images has no image 12"),
        (r#""category_id":8"#, r#""category_id":9"#, "annotation 2: categories has no category 9"),
        (r#""image_id":10,"#, "", "annotation 1 has no image_id"),
        ("[5,1,18]", "[5,1,17]", "annotation 2, segmentation: its runs have 23 pixels"),
        ("\"b015\"", "\"b0!5\"", "annotation 3"),
        ("[5,1,18]", "[5,-1,18]", "no whole number"),
        (r#"{"size":[4,6],"counts""#, r#"{"counts""#, "has no size"),
        ("[[0,0,3,0,3,3,0,3]]", "[[0,0,3,0,3,3,0]]", "has 7 numbers"),
        ("[[0,0,3,0,3,3,0,3]]", "[[0,0,3,0,3,1e9]]", "coordinate 1e9"),
        ("[[0,0,3,0,3,3,0,3]]", "\"none\"", "neither a list of polygons"),
        (r#""id":11,"#, r#""id":10,"#, "images[1]: has the id of an earlier"),
        ("b.jpg", "a.png", "is for the same view as"),
        (r#""id":4,"#, r#""id":4,"track_id":1,"#, "annotation 1: has no track_id"),
        ("}]}", "}],}", "is not valid JSON"),
    ] {
        assert!(plain.contains(from), "{from}");
        std::fs::write(&path, plain.replacen(from, to, 1))?;
        let text = error_of(&path);
        assert!(text.contains(want) && text.contains("objects.json"), "{text} lacks {want}");
    }
    std::fs::write(&path, plain.replace("\"segmentation\"", "\"mask\""))?;
    assert!(error_of(&path).contains("none of its annotations has a segmentation"));
    // Sizes that are claimed cost nothing, and are compared with the photo's.
    let claimed = plain.replace(r#""width":6,"height":4"#, r#""width":4000000000,"height":4000000000"#);
    std::fs::write(&path, claimed)?;
    let text =
        MaskFolder::open(&path, &photos())?.of_view(&photo("a")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("photo \"a.jpg\"") && text.contains("4000000000x4000000000"), "{text}");
    let claimed = plain.replace(r#""width":6,"height":4"#, r#""width":60000,"height":40000"#);
    std::fs::write(&path, claimed)?;
    let text =
        MaskFolder::open(&path, &photos())?.of_view(&photo("a")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("no photo has a side above 16384"), "a whole multiple of the photo's size: {text}");
    let runs = plain.replace("[4,6]", "[8,3]");
    std::fs::write(&path, runs)?;
    let masks = MaskFolder::open(&path, &photos())?;
    let text = masks.of_view(&photo("b")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("runs of 3x8 pixels"), "{text}");
    Ok(())
}

/// A file of labelme with shapes, each the JSON of its fields.
fn labelme(photo: &str, shapes: &[String]) -> String {
    format!(
        r#"{{"version":"5.5.0","flags":{{}},"shapes":[{}],"imagePath":"..\\images\\{photo}.png","imageData":null,
        "imageHeight":4,"imageWidth":6}}"#,
        shapes.join(",")
    )
}

/// The cars and trees of the photos, with `more` fields.
fn labelme_shapes(car: &str, tree: &str, more: &dyn Fn(&str) -> String) -> Result<[Vec<String>; 2], IoError> {
    use base64::Engine;
    let one = mask_bytes(&Mask { width: 1, height: 1, ids: vec![1] }, Path::new("m"))?;
    let one = base64::prelude::BASE64_STANDARD.encode(one);
    let shape = |label: &str, points: &str, kind: &str| {
        format!(r#"{{"label":"{label}","points":{points},"shape_type":"{kind}"{}}}"#, more(label))
    };
    let disk = shape(tree, "[[1.5,1.5],[1.5,2.0]]", "circle");
    let bits = shape(tree, "[[4,2],[4,2]]", "mask").replacen('{', &format!(r#"{{"mask":"{one}","#), 1);
    Ok([
        vec![shape(car, "[[0,0],[3,3]]", "rectangle"), disk, shape(car, "[[9,9]]", "point")],
        vec![bits, shape(car, "[[3,1],[6,1],[6,4],[3,4]]", "polygon")],
    ])
}

#[test]
fn labelmes_files_are_masks_of_ids() -> Outcome {
    let folder = tempfile::tempdir()?;
    let root = folder.path();
    let write = |[a, b]: &[Vec<String>; 2]| {
        std::fs::write(root.join("a.json"), labelme("a", a))?;
        std::fs::write(root.join("b.json"), labelme("b", b))
    };
    let group = |label: &str| format!(r#","group_id":{}"#, if label == "car" { 4 } else { 9 });
    for (car, tree, more) in [
        ("car_3", "tree_12", (&|_: &str| String::new()) as &dyn Fn(&str) -> String),
        ("car", "tree", &|_| r#","group_id":null"#.into()),
        ("car", "tree", &group),
    ] {
        write(&labelme_shapes(car, tree, more)?)?;
        let masks = is_the_same(root, [0, 1, 2])?;
        assert_eq!(names(&masks), [(1, "car"), (2, "tree")]);
        assert!(masks.notes.len() == 1 && masks.notes[0].contains("1 points and lines"), "{:?}", masks.notes);
    }
    // Of two cars in a photo that have no groups, nobody knows which is which in the next.
    let mut twice = labelme_shapes("car", "tree", &|_| String::new())?;
    let again = twice[0][0].replace("[[0,0],[3,3]]", "[[4,0],[5,1]]");
    twice[0].push(again);
    write(&twice)?;
    let masks = MaskFolder::open(root, &photos())?;
    let line = masks.notes.last().cloned().unwrap_or_default();
    assert!(line.contains("a.json: has 2 shapes \"car\"") && line.contains("group_id"), "{line}");
    assert_eq!(names(&masks), [(1, "car"), (2, "car"), (3, "tree")]);
    let ids = masks.of_view(&photo("a"))?.map(|mask| mask.ids_present()).unwrap_or_default();
    assert_eq!(ids, BTreeMap::from([(1, 8), (2, 1), (3, 1)]));
    // A photo beside its file is no mask, and another PNG may be one.
    std::fs::write(root.join("a.png"), "a photo")?;
    assert_eq!(error_of(root), "");
    std::fs::write(root.join("e.png"), "a mask?")?;
    assert!(error_of(root).contains("e.png beside it"), "{}", error_of(root));
    Ok(())
}

#[test]
fn labelmes_files_that_cannot_be_used_say_where() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.json");
    let [mut shapes, more] = labelme_shapes("car", "tree", &|_| String::new())?;
    shapes.extend(more);
    let plain = labelme("a", &shapes);
    for (from, to, want) in [
        ("rectangle", "cuboid", "shapes[0] (\"car\"): has the shape_type \"cuboid\""),
        (r#","points":[[0,0],[3,3]]"#, "", "missing field `points`"),
        ("[[0,0],[3,3]]", "[[0,0]]", "is a rectangle of 1 points"),
        ("[[4,2],[4,2]]", "[[-4,2],[4,2]]", "shapes[3] (\"tree\"): its mask begins at -4, 2"),
        (r#""mask":"#, r#""mask":"%","nothing":"#, "is not base64"),
        (r#""mask":"#, r#""mask":"AAAA","nothing":"#, "cannot decode the mask"),
        (r#""mask":"#, r#""nothing":"#, "without the field mask"),
        ("[[1.5,1.5],[1.5,2.0]]", "[[1.5,1.5],[1.5,1e300]]", "is in no picture"),
    ] {
        assert!(plain.contains(from), "{from}");
        std::fs::write(&path, plain.replacen(from, to, 1))?;
        for at in [path.as_path(), folder.path()] {
            let text = error_of(at);
            assert!(text.contains(want) && text.contains("a.json"), "{text} lacks {want}");
        }
    }
    std::fs::write(&path, "{\"version\": 1}")?;
    assert!(error_of(&path).contains("missing field `images`") && error_of(folder.path()).contains("has no masks"));
    Ok(())
}

/// Writes the black and white mask of each object; `name` makes the file's name from those of the photo and the object.
fn write_objects(root: &Path, scale: u32, name: &dyn Fn(&str, usize) -> String) -> Outcome {
    for (photo, ids) in PHOTOS {
        for object in [1, 2] {
            let path = root.join(name(photo, object));
            std::fs::create_dir_all(path.parent().unwrap_or(root))?;
            // The car's mask has the pixels that the tree covers.
            let is_in = |id: u16| if usize::from(id) == object || (object == 1 && id == 2) { 255 } else { 0 };
            let mask = Mask { width: 6, height: 4, ids: ids.map(is_in).to_vec() };
            write_mask(&path, &mask.resized(6 * scale, 4 * scale))?;
        }
    }
    Ok(())
}

/// The file of an object in a photo, the ids that the objects get, and their categories.
type Layout<'a> = (&'a dyn Fn(&str, usize) -> String, [u16; 3], &'a [(u32, &'a str)]);

#[test]
fn a_file_per_object_and_photo_is_a_mask_of_ids() -> Outcome {
    let kinds = ["", "car_4", "tree_9"];
    let layouts: [Layout<'_>; 6] = [
        (&|photo, object| format!("{photo}/{object}.png"), [0, 1, 2], &[]),
        (&|photo, object| format!("{photo}/{}.png", object - 1), [0, 1, 2], &[]),
        (&|photo, object| format!("{photo}.jpg/mask_{object}.png"), [0, 1, 2], &[]),
        (&|photo, object| format!("deep/{photo}/{}.png", kinds[object]), [0, 4, 9], &[(4, "car"), (9, "tree")]),
        (&|photo, object| format!("{}/{photo}.png", kinds[object]), [0, 4, 9], &[(4, "car"), (9, "tree")]),
        (&|photo, object| format!("{object}/{photo}.jpg.png"), [0, 1, 2], &[]),
    ];
    for (name, ids, categories) in layouts {
        for scale in [1, 2, 3] {
            let folder = tempfile::tempdir()?;
            write_objects(folder.path(), scale, name)?;
            let masks = is_the_same(folder.path(), ids)?;
            assert_eq!(names(&masks), categories);
            assert!(masks.any_file().is_some_and(Path::is_file));
        }
    }
    Ok(())
}

#[test]
fn what_may_be_masks_of_two_kinds_is_refused() -> Outcome {
    // Folders and files both have the names of photos.
    let folder = tempfile::tempdir()?;
    write_objects(folder.path(), 1, &|photo, object| format!("{}/{photo}.png", ["", "a", "b"][object]))?;
    assert!(error_of(folder.path()).contains("NAME/OBJECT.png or OBJECT/NAME.png"), "{}", error_of(folder.path()));
    // One mask of a photo beside the masks of its objects.
    let folder = tempfile::tempdir()?;
    write_objects(folder.path(), 1, &|photo, object| format!("{photo}/{object}.png"))?;
    write_mask(&folder.path().join("a.png"), &Mask { width: 6, height: 4, ids: vec![0; 24] })?;
    assert!(error_of(folder.path()).contains("a.png: may be a mask of the photo a"), "{}", error_of(folder.path()));
    // Masks of ids under the names of objects, as two programs leave them.
    let folder = tempfile::tempdir()?;
    for kind in ["ids", "other"] {
        std::fs::create_dir(folder.path().join(kind))?;
        write_mask(&folder.path().join(kind).join("a.png"), &Mask { width: 6, height: 4, ids: PHOTOS[0].1.to_vec() })?;
    }
    let masks = MaskFolder::open(folder.path(), &photos())?;
    let text = masks.of_view(&photo("a")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("a.png: has several ids") && text.contains("of masks of ids give the folder"), "{text}");
    // Masks of two sizes in one photo.
    write_mask(&folder.path().join("ids/a.png"), &Mask { width: 6, height: 4, ids: vec![1; 24] })?;
    write_mask(&folder.path().join("other/a.png"), &Mask { width: 12, height: 8, ids: vec![1; 96] })?;
    let text = masks.of_view(&photo("a")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("12x8 pixels"), "{text}");
    Ok(())
}

#[test]
fn larger_masks_of_ids_are_reduced_and_smaller_ones_refused() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.png");
    let mask = Mask { width: 6, height: 4, ids: PHOTOS[0].1.to_vec() };
    for (size, fits) in [((12, 8), true), ((18, 12), true), ((3, 2), false), ((12, 4), false), ((7, 4), false)] {
        write_mask(&path, &mask.resized(size.0, size.1))?;
        let read = MaskFolder::open(folder.path(), &photos())?.of_view(&photo("a"));
        match read {
            Ok(read) => assert!(fits && read.as_ref() == Some(&mask), "{size:?}"),
            Err(e) => assert!(!fits && e.to_string().contains("whole multiple"), "{e}"),
        }
    }
    Ok(())
}
