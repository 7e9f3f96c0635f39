//! `instgs-vk masks`: makes masks of repeated objects from words or boxes, and a page to review them.

mod boxes;
mod prompt;
mod unfinished;

use std::path::{Path, PathBuf};

use clap::Args;

use self::boxes::BoxArgs;
use self::prompt::PromptArgs;
use self::unfinished::is_unfinished;
use instgs_console::args::create_folder;
use instgs_console::device::DeviceArgs;
use instgs_console::{CliError, Printer};
use instgs_detect::BOXES;
use instgs_io::dataset::{MissingPhotos, leave_out_missing};
use instgs_io::masks::CATEGORIES;
use instgs_io::{IoError, MaskFolder, RunFolder, View, read_views};
use instgs_report::stage_pictures::review;

/// Makes masks of a data set's photos, or a page to review existing masks.
///
/// DIR gets a page, review.html, that shows every view with its masks: look at it before training.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk masks --data park --prompt \"car. bench.\" --models models --out park_masks\n  \
    instgs-vk masks --data park --boxes boxes.json --scene runs/park/point_cloud.ply --out park_masks\n  \
    instgs-vk masks --data cars --masks cars/masks --out cars_review")]
pub(super) struct MasksArgs {
    /// Dataset folder with the photos
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    prompt: PromptArgs,
    #[command(flatten)]
    boxes: BoxArgs,
    /// Folder for the masks and the page; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Leave out views without a photo, however many they are; up to half of them always are
    #[arg(long)]
    skip_missing: bool,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// The source of the masks; exactly one flag is given.
#[derive(Args)]
#[group(required = true, multiple = false)]
struct SourceArgs {
    /// What to detect in the photos, for instance "car. office chair."; needs --models
    #[arg(long, value_name = "TEXT")]
    prompt: Option<String>,
    /// Boxes around objects, in the world or in photos (boxes.json); needs --scene
    #[arg(long, value_name = "JSON")]
    boxes: Option<PathBuf>,
    /// Existing masks, as for train: only the page is made
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
}

/// The report on existing masks, printed with `--json`.
#[derive(serde::Serialize)]
struct PageReport {
    /// Number of views of the data set.
    views: usize,
    /// Path of the page that shows them.
    page: PathBuf,
}

pub(super) fn run(args: &MasksArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let views = views(args, printer)?;
    let source = &args.source;
    if let Some(masks) = &source.masks {
        let masks = MaskFolder::open(masks, &views)?;
        masks.notes.iter().for_each(|note| printer.warning(note));
        create_folder(&args.out)?;
        let page = write_page(&args.out, &views, &masks, printer)?;
        if args.json {
            return printer.json(&PageReport { views: views.len(), page });
        }
    } else if let Some(text) = &source.prompt {
        check_folder(&args.out, &views, &[CATEGORIES, BOXES])?;
        let report = prompt::make(&views, text, &args.prompt, &args.out, printer)?;
        write_page(&args.out, &views, &MaskFolder::open(&args.out, &views)?, printer)?;
        if args.json {
            return printer.json(&report);
        }
        prompt::print(&report, printer);
    } else if let Some(path) = &source.boxes {
        check_folder(&args.out, &views, &[CATEGORIES])?;
        let report = boxes::make(&views, path, &args.boxes, &args.out, device_args, printer)?;
        write_page(&args.out, &views, &MaskFolder::open(&args.out, &views)?, printer)?;
        if args.json {
            return printer.json(&report);
        }
        boxes::print(&report, printer);
    }
    Ok(())
}

/// The views of the data set that have photos, as for training.
fn views(args: &MasksArgs, printer: &Printer) -> Result<Vec<View>, CliError> {
    let mut dataset = read_views(&args.data)?;
    let may_be_missing = if args.skip_missing { MissingPhotos::Skip } else { MissingPhotos::Few };
    dataset.notes.extend(leave_out_missing(&mut dataset.views, may_be_missing)?);
    dataset.notes.iter().for_each(|note| printer.warning(note));
    Ok(dataset.views)
}

/// Refuses a folder that has masks, or files that would be replaced: the ids of two sets of masks would be mixed up.
fn check_folder(out: &Path, views: &[View], written: &[&str]) -> Result<(), IoError> {
    if is_unfinished(out) {
        if first_file(out, is_png).is_none() {
            // The command was stopped before the first of them.
            return Ok(());
        }
        let error = IoError::new(out, "holds masks that are not complete: the command that made them was stopped");
        return Err(error.advise("delete the folder and give the command again, or choose another folder"));
    }
    let is_written = |path: &Path| is_png(path) || written.iter().any(|name| path.ends_with(name));
    let found = first_file(out, is_written).map(|path| format!(" ({})", path.display()));
    // Masks of other kinds, which are in folders or JSON.
    if found.is_some() || (out.is_dir() && MaskFolder::open(out, views).is_ok()) {
        let error = IoError::new(out, format!("holds masks already{}", found.unwrap_or_default()));
        return Err(error.advise("choose another folder"));
    }
    Ok(())
}

/// The first file of a folder that fulfils a condition, by name; none if the folder is missing.
fn first_file(folder: &Path, is_one: impl Fn(&Path) -> bool) -> Option<PathBuf> {
    let files = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    files.filter(|path| is_one(path)).min()
}

fn is_png(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
}

fn write_page(out: &Path, views: &[View], masks: &MaskFolder, printer: &Printer) -> Result<PathBuf, CliError> {
    let page = RunFolder::new(out).review();
    review(&page, views, masks, None)?;
    printer.line(format_args!("every view with its masks: {}", page.display()));
    Ok(page)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use instgs_console::USAGE;

    type Test = Result<(), Box<dyn std::error::Error>>;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: MasksArgs,
    }

    fn parsed(words: &[&str]) -> Result<MasksArgs, clap::Error> {
        Ok(Line::try_parse_from([&["masks", "--data", "d", "--out", "o"], words].concat())?.args)
    }

    #[test]
    fn flags_of_one_source_are_refused_with_another() -> Test {
        let sources = [["--prompt", "car."], ["--boxes", "b.json"], ["--masks", "m"]];
        let flags: [(&str, &[&str]); 9] = [
            ("--prompt", &["--models", "m"]),
            ("--prompt", &["--box-threshold", "0.5"]),
            ("--prompt", &["--text-threshold", "0.5"]),
            ("--prompt", &["--overlap", "0.5"]),
            ("--prompt", &["--runtime", "x.so"]),
            ("--prompt", &["--provider", "cpu"]),
            ("--boxes", &["--scene", "s.ply"]),
            ("--boxes", &["--keep-support"]),
            ("--boxes", &["--width", "400"]),
        ];
        for source in sources {
            for (of, flag) in flags {
                let result = parsed(&[&source[..], flag].concat());
                if source[0] == of {
                    result?;
                    continue;
                }
                let error = result.err().ok_or_else(|| format!("{} with {flag:?} is taken", source[0]))?;
                assert_eq!(error.exit_code(), i32::from(USAGE), "{error}");
                assert!(error.to_string().contains(flag[0]), "{error}");
            }
        }
        for (_, flag) in flags {
            let error = parsed(flag).err().ok_or("no source is taken")?;
            assert_eq!(error.exit_code(), i32::from(USAGE), "{error}");
        }
        Ok(())
    }

    #[test]
    fn a_folder_with_pictures_or_half_made_masks_is_refused() -> Test {
        let folder = tempfile::tempdir()?;
        let out = folder.path();
        let text = |written: &[&str]| check_folder(out, &[], written).err().map(|e| e.to_string()).unwrap_or_default();
        assert_eq!(text(&[CATEGORIES, BOXES]), "");
        check_folder(&out.join("none"), &[], &[CATEGORIES])?;
        // A user's own boxes may lie where masks are made of them.
        std::fs::write(out.join(BOXES), "{}")?;
        assert_eq!(text(&[CATEGORIES]), "");
        assert!(text(&[CATEGORIES, BOXES]).contains("holds masks already"));
        // Masks that cannot be opened, since it is not clear which one counts.
        std::fs::write(out.join("a.PNG"), "no picture")?;
        std::fs::write(out.join("a.png"), "no picture")?;
        assert!(MaskFolder::open(out, &[]).is_err());
        assert!(text(&[CATEGORIES]).contains("holds masks already"), "{}", text(&[CATEGORIES]));
        unfinished::mark_unfinished(out)?;
        assert!(text(&[CATEGORIES]).contains("not complete") && text(&[CATEGORIES]).contains("delete the folder"));
        Ok(())
    }

    #[test]
    fn views_without_photos_are_left_out_as_for_training() -> Test {
        let folder = tempfile::tempdir()?;
        let data = folder.path();
        let pose = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";
        let frame = |i: u32| format!(r#"{{"file_path":"{i}.png","transform_matrix":{pose}}}"#);
        let frames: Vec<String> = (0..4).map(frame).collect();
        let text = format!(r#"{{"w":2,"h":2,"fl_x":1,"frames":[{}]}}"#, frames.join(","));
        std::fs::write(data.join("transforms.json"), text)?;
        let args = |more: &[&str]| {
            let text = data.display().to_string();
            let words = [&["masks", "--data", &text, "--out", "o", "--masks", "m"], more].concat();
            Line::try_parse_from(words).map(|line| line.args)
        };
        let count = |more: &[&str]| -> Result<usize, CliError> { Ok(views(&args(more)?, &Printer::new(false))?.len()) };
        std::fs::write(data.join("0.png"), "a photo")?;
        assert!(count(&[]).is_err_and(|error| error.to_string().contains("--skip-missing")));
        assert_eq!(count(&["--skip-missing"])?, 1);
        std::fs::write(data.join("1.png"), "a photo")?;
        assert_eq!(count(&[])?, 2);
        Ok(())
    }
}
