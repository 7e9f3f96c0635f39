//! `instgs-vk find`: finds all objects that have the shape of one selected by a box.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use clap::Args;

use instgs_console::args::{SplitArg, create_folder, open_scene};
use instgs_console::table::Table;
use instgs_console::{CliError, Printer};
use instgs_io::{IoError, read_boxes, read_groups, write_boxes};
use instgs_objects::register::find::Against;
use instgs_objects::register::{FindInput, FindOptions, Found, FoundObject, find_alike};
use instgs_vk::scene::{Boxes, Camera, ObjectBox};

/// Finds the repetitions of one object in a trained plain cloud, without masks.
///
/// The object is selected by a 3D box that contains all of it and little else; the ground below it does not matter.
/// Objects of the same shape, rotated about the vertical, are found anywhere in the scene. The output has the selected
/// box and one for each repetition. If the box selects a part of a wall, for instance a window, parts of walls with the
/// same pattern of colours are found.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk find --scene runs/cars/point_cloud.ply --data cars --boxes one.json --out all.json\n  \
    instgs-vk find --scene orchard.ply --boxes one.json --out all.json --similarity --against orchard/groups.json\n\n\
    one.json: {\"objects\": [{\"id\": 1, \"category\": \"car\", \"center\": [0, 0, 1], \"size\": [2, 4, 1.5]}]}")]
pub(super) struct FindArgs {
    /// Scene to search; its instances are expanded
    #[arg(long, value_name = "PLY")]
    scene: PathBuf,
    /// File with the box of the selected object
    #[arg(long, value_name = "one.json")]
    boxes: PathBuf,
    /// Id of the selected object, needed if the file has several
    #[arg(long, value_name = "ID")]
    object: Option<u32>,
    /// Dataset folder, whose training views give the up axis, and the ground of flights that look straight down [default: the box's
    /// third axis]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// File of boxes to write
    #[arg(long, value_name = "all.json")]
    out: PathBuf,
    /// Allow repetitions of half to twice the size
    #[arg(long)]
    similarity: bool,
    /// File of the true groups, to count correct results
    #[arg(long, value_name = "groups.json")]
    against: Option<PathBuf>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// The report printed with `--json`.
#[derive(serde::Serialize)]
struct Report<'a> {
    scene: &'a Path,
    out: &'a Path,
    selected: u32,
    gaussians: usize,
    /// Whether the object is a part of a wall, found by its pattern of colours.
    in_wall: bool,
    objects: Vec<ObjectReport>,
    rejected: Vec<RejectedReport<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    against: Option<Against>,
    seconds: f64,
}

#[derive(serde::Serialize)]
struct ObjectReport {
    id: u32,
    inliers: f64,
    explained: f64,
    rmse: f64,
    score: f64,
    /// Distance from the selected object, scene units.
    distance: f64,
    /// Pose relative to the selected object, in the world: 3 rows of 4.
    world_from_selected: [[f32; 4]; 3],
}

#[derive(serde::Serialize)]
struct RejectedReport<'a> {
    center: [f64; 3],
    score: f64,
    reason: &'a str,
}

pub(super) fn run(args: &FindArgs, printer: &Printer) -> Result<(), CliError> {
    let begin = std::time::Instant::now();
    let boxes = read_boxes(&args.boxes)?;
    let selected = args.selected(&boxes)?;
    check_others_stay(args, &boxes)?;
    let groups = args.against.as_deref().map(read_groups).transpose()?;
    let cameras = args.cameras(printer)?;
    let cloud = open_scene(&args.scene, printer)?.scene.flatten();
    if let Some(folder) = args.out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        create_folder(folder)?;
    }
    let options = FindOptions::of_sizes(args.similarity);
    let input = FindInput { cloud: &cloud, cameras: &cameras, object: selected, up: None };
    let mut bar = None;
    let mut told = |at: instgs_objects::register::FindProgress| {
        let bar = bar.get_or_insert_with(|| printer.progress("find", at.total as u64));
        bar.advance_to(at.done as u64, "");
        ControlFlow::Continue(())
    };
    let found =
        find_alike(&input, &options, &mut told).map_err(|e| CliError::msg(format!("{}: {e}", args.boxes.display())))?;
    drop(bar);
    write_boxes(&args.out, &with_repetitions(selected, &found))?;
    let against = groups.as_deref().and_then(|groups| found.against(selected, groups));
    if found.objects.is_empty() {
        let like = if found.in_wall { "has colours" } else { "is shaped" };
        printer.warning(format_args!("nothing else {like} like object {}", selected.id));
    }
    if args.json {
        return printer.json(&args.report(selected, &found, against, begin.elapsed().as_secs_f64()));
    }
    printer.line(table(selected, &found.objects));
    if let Some(Against { right, found, all, precision, recall, .. }) = against {
        printer.line(format_args!(
            "precision {precision:.3} ({right} of {found} found), recall {recall:.3} ({right} of {all} true)"
        ));
    }
    printer.line(format_args!("{}: {} objects", args.out.display(), 1 + found.objects.len()));
    Ok(())
}

impl FindArgs {
    /// The box that selects the object.
    fn selected<'a>(&self, boxes: &'a Boxes) -> Result<&'a ObjectBox, CliError> {
        let fail = |what: String, advice: &str| Err(IoError::new(&self.boxes, what).advise(advice).into());
        match (self.object, boxes.objects.as_slice()) {
            (_, []) => fail("has no box in the world".into(), "give objects, each with id, center and size"),
            (None, [one]) => Ok(one),
            (None, all) => fail(format!("has {} objects", all.len()), "choose one with --object ID"),
            (Some(id), all) => match all.iter().find(|object| object.id == id) {
                Some(object) => Ok(object),
                None => {
                    let ids: Vec<String> = all.iter().map(|object| object.id.to_string()).collect();
                    fail(format!("has no object {id}"), &format!("it has {}", ids.join(", ")))
                }
            },
        }
    }

    /// Cameras of the data set's training views; empty without --data.
    fn cameras(&self, printer: &Printer) -> Result<Vec<Camera>, CliError> {
        let Some(data) = &self.data else { return Ok(Vec::new()) };
        Ok(SplitArg::Train.views(data, printer)?.into_iter().map(|view| view.camera).collect())
    }

    fn report<'a>(
        &'a self,
        selected: &ObjectBox,
        found: &'a Found,
        against: Option<Against>,
        seconds: f64,
    ) -> Report<'a> {
        let object = |o: &FoundObject| ObjectReport {
            id: o.object.id,
            inliers: o.inliers,
            explained: o.explained,
            rmse: o.rmse,
            score: o.score,
            distance: o.object.center.distance(selected.center),
            world_from_selected: o.world_from_selected.rows(),
        };
        let rejected = found.rejected.iter().map(|place| RejectedReport {
            center: place.center.to_array(),
            score: place.score,
            reason: &place.reason,
        });
        Report {
            scene: &self.scene,
            out: &self.out,
            selected: selected.id,
            gaussians: found.gaussians,
            in_wall: found.in_wall,
            objects: found.objects.iter().map(object).collect(),
            rejected: rejected.collect(),
            against,
            seconds,
        }
    }
}

/// Refuses to write over the file of boxes if it has others: only the selected one and its repetitions are written.
fn check_others_stay(args: &FindArgs, boxes: &Boxes) -> Result<(), CliError> {
    let others = boxes.objects.len().saturating_sub(1) + boxes.views.len();
    let replaced = args.out.canonicalize().ok();
    if others == 0 || replaced.is_none() || replaced != args.boxes.canonicalize().ok() {
        return Ok(());
    }
    let what = format!("has boxes besides the selected one ({others} objects and photos), which would be lost");
    Err(IoError::new(&args.out, what).advise("write to another file").into())
}

/// The selected box and the boxes of the repetitions.
fn with_repetitions(selected: &ObjectBox, found: &Found) -> Boxes {
    let mut objects = vec![selected.clone()];
    objects.extend(found.objects.iter().map(|o| o.object.clone()));
    objects.sort_by_key(|object| object.id);
    Boxes { objects, views: Default::default() }
}

/// One row for each repetition.
fn table(selected: &ObjectBox, objects: &[FoundObject]) -> Table {
    let mut table = Table::default();
    table.row(["id", "inliers", "RMSE", "distance", "score"].map(String::from));
    for o in objects {
        let distance = o.object.center.distance(selected.center);
        table.row([
            o.object.id.to_string(),
            format!("{:.3}", o.inliers),
            format!("{:.4}", o.rmse),
            format!("{distance:.2}"),
            format!("{:.3}", o.score),
        ]);
    }
    table
}
