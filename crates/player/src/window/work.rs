//! Work that takes long, beside the picture: files are written on a thread, frames into files one per picture. Both show their
//! progress and can be cancelled.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::time::Duration;

use glam::{DQuat, DVec3};

use super::leaving::is_same_file;
use super::{Live, WindowJob};
use crate::actions::Take;
use crate::error::PlayerError;
use crate::recording::{PATH_FPS, Recording};
use crate::texts;
use instgs_console::opened::OpenedScene;
use instgs_io::page::cameras_beside;
use instgs_io::{
    ExportFormat, ExportedScene, IoError, Pack, PageOptions, atomic_write, export_scene, locked_temporary,
    packing_lost, page_text, save_scene,
};
use instgs_vk::scene::{Camera, InstancedScene};
use tempfile::NamedTempFile;

/// How often it is looked whether ffmpeg has ended.
const LOOK_AT_FFMPEG: Duration = Duration::from_millis(50);

/// Notes for the user about a file that a thread has written, or why it could not.
type Written = Result<Vec<String>, String>;

/// What runs beside the picture; there is one at a time.
pub(super) struct Work {
    name: String,
    cancelled: Arc<AtomicBool>,
    kind: Kind,
}

enum Kind {
    /// A thread writes a file.
    Write { done: Receiver<Written>, to: PathBuf, saved_revision: Option<u64> },
    /// A thread reads a scene.
    Read { done: Receiver<Result<OpenedScene, IoError>>, path: PathBuf, of: Opened },
    /// Frames that are drawn one after another.
    Draw(Drawing),
}

/// Which scene is read.
#[derive(Clone, Copy)]
enum Opened {
    /// The one that the window was opened for.
    First,
    /// Another one, in place of a scene without unsaved changes.
    InPlace,
    /// Another one, in place of a scene with unsaved changes: the user was asked about them.
    InPlaceOfUnsaved,
}

struct Drawing {
    cameras: Vec<Camera>,
    next: usize,
    /// Where frames go, each under its camera's name; a single picture has a file of its own.
    folder: PathBuf,
    single: Option<PathBuf>,
}

impl Live {
    /// Name and progress of the work, for the overlay.
    pub(super) fn work_shown(&self) -> Option<(String, Option<f32>)> {
        let work = self.work.as_ref()?;
        let progress = match &work.kind {
            Kind::Write { .. } | Kind::Read { .. } => None,
            Kind::Draw(drawing) => Some(drawing.next as f32 / drawing.cameras.len().max(1) as f32),
        };
        Some((work.name.clone(), progress))
    }

    /// Writes a copy of the present scene on a thread. A `.instgs` becomes the scene's own file. Unless the user has agreed that a
    /// file which is there already is replaced (`may_replace`), asks first if that is not the scene's own.
    pub(super) fn write_beside(&mut self, to: &Path, may_replace: bool) {
        if !self.session.has_scene {
            return self.hud.message = Some(texts::nothing_to_save(&self.session.path));
        }
        if self.session.viewer.is_in_pages() {
            return self.hud.message = Some(texts::IN_PAGES.into());
        }
        // Saving again waits for the file that is being saved. Other work is not thrown away for it.
        self.wait_for_saving();
        if let Some(work) = &self.work {
            return self.hud.message = Some(texts::still_running(&work.name));
        }
        let saves = to.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("instgs"));
        let format = match ExportFormat::of(to, None) {
            Ok(format) => format,
            Err(error) => return self.hud.message = Some(error.to_string()),
        };
        let may_replace = may_replace || is_same_file(to, &self.session.path);
        if self.asks_to_replace(to, may_replace) {
            // The panel with the path stays until the question is answered.
            self.hud.panels.save_as = true;
            return;
        }
        let [_, _, up] = self.camera.navigator.level_axes();
        let (from, up_of_user) = (self.session.path.clone(), self.session.up);
        let revision = self.session.viewer.editor_mut().revision();
        let scene = self.session.viewer.scene().clone();
        let (sender, done) = channel();
        let cancelled = Arc::new(AtomicBool::new(false));
        let to_path = to.to_path_buf();
        let job = Writing { scene, from, to: to_path, format, saves, up, up_of_user, cancelled: cancelled.clone() };
        std::thread::spawn(move || drop(sender.send(job.run())));
        let name = if saves { texts::saving(to) } else { texts::exporting(to) };
        let kind = Kind::Write { done, to: to.to_path_buf(), saved_revision: saves.then_some(revision) };
        self.work = Some(Work { name, cancelled, kind });
    }

    /// Reads a scene on a thread, in place of other work; it is shown once it is read.
    pub(super) fn read_beside(&mut self, path: &Path) {
        let of = if self.is_unsaved() { Opened::InPlaceOfUnsaved } else { Opened::InPlace };
        self.cancel_work();
        self.read(path, of);
    }

    /// Reads the scene that the window was opened for, as [`Live::read_beside`] does.
    pub(super) fn read_first(&mut self, path: &Path) {
        self.read(path, Opened::First);
    }

    fn read(&mut self, path: &Path, of: Opened) {
        let (sender, done) = channel();
        let (name, of_thread) = (texts::opening(path), path.to_path_buf());
        let memory = self.session.memory;
        std::thread::spawn(move || drop(sender.send(OpenedScene::open(&of_thread, memory))));
        let kind = Kind::Read { done, path: path.to_path_buf(), of };
        self.work = Some(Work { name, cancelled: Arc::default(), kind });
    }

    /// True while a scene is read.
    pub(super) fn is_reading(&self) -> bool {
        matches!(&self.work, Some(Work { kind: Kind::Read { .. }, .. }))
    }

    /// True while the scene is read that the window was opened for.
    pub(super) fn is_reading_first(&self) -> bool {
        matches!(&self.work, Some(Work { kind: Kind::Read { of: Opened::First, .. }, .. }))
    }

    /// Shows the scene that was read, if it is there; true if so.
    fn note_read(&mut self, job: &WindowJob) -> Result<bool, PlayerError> {
        let Some(Work { kind: Kind::Read { done, path, of }, .. }) = &self.work else { return Ok(false) };
        if self.playback.holds_file {
            return Ok(false);
        }
        let (path, of) = (path.clone(), *of);
        let loaded = match done.try_recv() {
            Ok(loaded) => loaded,
            Err(TryRecvError::Empty) => return Ok(false),
            Err(TryRecvError::Disconnected) => Err(IoError::new(&path, texts::READER_BROKE)),
        };
        self.work = None;
        match of {
            Opened::First => self.take_first(loaded, job)?,
            Opened::InPlace if loaded.is_ok() && self.is_unsaved() => {
                self.hud.message = Some(texts::changed_meanwhile(&path));
            }
            Opened::InPlace | Opened::InPlaceOfUnsaved => self.take_file(&path, loaded, job)?,
        }
        Ok(true)
    }

    /// Cancels the work: a file that is being written never appears, frames that were drawn stay.
    pub(super) fn cancel_work(&mut self) {
        let Some(work) = self.work.take() else { return };
        work.cancelled.store(true, Ordering::Relaxed);
        self.hud.message = Some(texts::was_cancelled(&work.name));
    }

    /// Waits until the scene's own file is written, if it is being written.
    pub(super) fn wait_for_saving(&mut self) {
        while matches!(&self.work, Some(Work { kind: Kind::Write { saved_revision: Some(_), .. }, .. })) {
            self.note_written(Duration::from_secs(1));
        }
    }

    /// Waits until a file is written; other work goes on.
    pub(super) fn wait_for_writing(&mut self) {
        while matches!(&self.work, Some(Work { kind: Kind::Write { .. }, .. })) {
            self.note_written(Duration::from_secs(1));
        }
    }

    /// Takes the result of a thread if it comes within a time.
    fn note_written(&mut self, within: Duration) {
        let Some(Work { kind: Kind::Write { done, to, saved_revision }, .. }) = &self.work else { return };
        let result = match done.recv_timeout(within) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => return,
            Err(RecvTimeoutError::Disconnected) => Err(texts::WRITER_BROKE.into()),
        };
        let (to, saved) = (to.clone(), *saved_revision);
        self.work = None;
        self.hud.message = Some(match (result, saved) {
            (Err(reason), _) => reason,
            (Ok(notes), None) => texts::with_notes(texts::exported(&to), &notes),
            (Ok(mut notes), Some(revision)) => {
                self.session.viewer.editor_mut().saved_at(revision);
                notes.extend(self.take_kept_cameras(&to));
                let text = texts::with_notes(texts::saved(&to), &notes);
                self.recent.note(&to);
                self.session.path = to;
                text
            }
        });
    }

    /// Begins to draw frames into files beside the scene.
    pub(super) fn draw_frames(&mut self, take: Take, size_px: [u32; 2], frames: u32) {
        let navigator = &self.camera.navigator;
        let now = navigator.camera(size_px);
        let cameras = match take {
            Take::Still => vec![now],
            Take::Turntable => turntable(&now, navigator.target(), navigator.level_axes()[2], frames),
            Take::AlongKept => along(&self.camera.kept.list, size_px, frames),
        };
        let single = (take == Take::Still).then(|| self.session.free_name("png"));
        let folder = self.session.free_name("frames");
        if let (None, Err(error)) = (&single, std::fs::create_dir_all(&folder)) {
            return self.hud.message = Some(format!("{}: {error}", folder.display()));
        }
        let name = texts::frames_of(cameras.len(), size_px);
        let kind = Kind::Draw(Drawing { cameras, next: 0, folder, single });
        self.work = Some(Work { name, cancelled: Arc::default(), kind });
    }

    /// Goes on with the work; true if the next picture should follow at once.
    pub(super) fn go_on_working(&mut self, job: &WindowJob) -> Result<bool, PlayerError> {
        self.note_written(Duration::ZERO);
        if self.note_read(job)? {
            return Ok(true);
        }
        let Some(Work { kind: Kind::Draw(drawing), .. }) = &mut self.work else { return Ok(false) };
        if let Some(camera) = drawing.cameras.get(drawing.next).cloned() {
            let path =
                drawing.single.clone().unwrap_or_else(|| drawing.folder.join(format!("{:05}.png", drawing.next)));
            let drawn = self.session.viewer.draw_complete(&camera).and_then(|()| self.session.viewer.screenshot(&path));
            match drawn {
                Err(error) if error.is_lost() => return Err(error),
                Err(error) => {
                    // Too large for the device, or for the disk.
                    self.work = None;
                    self.hud.message = Some(error.to_string());
                }
                // Only now: a frame during which the device was lost is drawn again, so that no number is missing.
                Ok(()) => {
                    if let Some(Work { kind: Kind::Draw(drawing), .. }) = &mut self.work {
                        drawing.next += 1;
                    }
                }
            }
            return Ok(true);
        }
        let (single, folder, count) = (drawing.single.clone(), drawing.folder.clone(), drawing.cameras.len());
        self.work = None;
        match single {
            Some(path) => self.hud.message = Some(texts::saved(&path)),
            None => self.encode(&folder, count),
        }
        Ok(true)
    }

    /// Makes a video of frames on a thread, where ffmpeg is on the machine.
    fn encode(&mut self, folder: &Path, count: usize) {
        let known = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if !known.is_ok_and(|status| status.success()) {
            let text = texts::no_ffmpeg(count, folder);
            return self.hud.message = Some(text);
        }
        let (sender, done) = channel();
        let cancelled = Arc::new(AtomicBool::new(false));
        let (folder, to, stop) = (folder.to_path_buf(), folder.with_extension("mp4"), cancelled.clone());
        let name = texts::making(&to);
        let kind = Kind::Write { done, to: to.clone(), saved_revision: None };
        std::thread::spawn(move || drop(sender.send(video(&folder, &to, &stop))));
        self.work = Some(Work { name, cancelled, kind });
    }
}

/// A file that a thread writes.
struct Writing {
    scene: InstancedScene,
    /// The file that the scene is from; in a run folder, the training cameras are beside it.
    from: PathBuf,
    to: PathBuf,
    format: ExportFormat,
    saves: bool,
    /// The scene's up axis in the window.
    up: DVec3,
    /// The same if the user gave it: it counts more than that of a run's cameras.
    up_of_user: Option<DVec3>,
    cancelled: Arc<AtomicBool>,
}

impl Writing {
    /// Writes the file, unless the user cancels meanwhile.
    fn run(self) -> Written {
        // Before the file is replaced: it may be the one that is written.
        let lost = if self.saves { packing_lost(&self.from) } else { None };
        let (exported, of_page) = match self.format {
            ExportFormat::Page(pack) => (ExportedScene::default(), self.write_page(pack)?),
            _ => (self.write_part()?, Vec::new()),
        };
        // The message names the file already.
        let name = format!("{}: ", self.to.display());
        let notes = exported.notes(&self.to, &self.scene, self.format);
        let nameless = notes.into_iter().map(|note| note.strip_prefix(&name).map(str::to_owned).unwrap_or(note));
        Ok(lost.into_iter().chain(of_page).chain(nameless).collect())
    }

    /// Writes a page, which has the name of its file within, and returns notes about it. It begins at the first training camera
    /// if the scene lies in the folder of its run, as `instgs-vk export` has it.
    fn write_page(&self, pack: Pack) -> Written {
        let (cameras, notes) = match cameras_beside(&self.from) {
            Ok(cameras) => (cameras, Vec::new()),
            Err(error) => (Vec::new(), vec![texts::page_without_cameras(&error)]),
        };
        let usual = PageOptions::of_views(&self.scene, pack, &cameras);
        let of_cameras = if cameras.is_empty() { self.up } else { usual.up };
        let options = PageOptions { up: self.up_of_user.unwrap_or(of_cameras), ..usual };
        let title = self.to.file_stem().unwrap_or_default().to_string_lossy();
        let page = page_text(&title, &self.scene, &options, &self.to).map_err(|error| error.to_string())?;
        let write = || atomic_write(&self.to, |out| out.write_all(page.as_bytes())).map_err(|error| error.to_string());
        unless_cancelled(&self.cancelled, write)?;
        Ok(notes)
    }

    /// Writes any other file, under a temporary name first.
    fn write_part(&self) -> Result<ExportedScene, String> {
        // Those that write put another file in its place, so that it is not kept open and locked.
        let part = part_of(&self.to)?.into_temp_path();
        let done = if self.saves {
            save_scene(&part, &self.scene).map(|()| ExportedScene::default())
        } else {
            export_scene(&part, &self.scene, self.format, self.up)
        };
        // Its errors name the temporary file.
        let named = |text: String| text.replace(&part.display().to_string(), &self.to.display().to_string());
        let exported = done.map_err(|error| named(error.to_string()))?;
        let rename = || part.persist(&self.to).map_err(|error| cannot_write(&self.to, &error.error));
        unless_cancelled(&self.cancelled, rename)?;
        Ok(exported)
    }
}

/// An empty temporary file beside another and with its ending, which is removed unless it gets the other's name. It is locked while
/// it is open, so that no process takes it for one that a killed player has left.
fn part_of(to: &Path) -> Result<NamedTempFile, String> {
    let ending = format!(".{}", to.extension().unwrap_or_default().to_string_lossy());
    locked_temporary(to, &ending).map_err(|error| error.to_string())
}

fn cannot_write(to: &Path, error: &std::io::Error) -> String {
    IoError::os(to, texts::CANNOT_WRITE, error).to_string()
}

/// Lets a complete file appear under its name, unless the user has cancelled.
fn unless_cancelled(cancelled: &AtomicBool, appear: impl FnOnce() -> Result<(), String>) -> Result<(), String> {
    if cancelled.load(Ordering::Relaxed) { Err(texts::CANCELLED.into()) } else { appear() }
}

/// Runs ffmpeg on numbered frames.
fn video(folder: &Path, to: &Path, cancelled: &AtomicBool) -> Written {
    let part = part_of(to)?;
    // There a lock keeps ffmpeg from writing, too.
    #[cfg(windows)]
    let _ = part.as_file().unlock();
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-y", "-loglevel", "error", "-framerate", &PATH_FPS.to_string(), "-i"]).arg(folder.join("%05d.png"));
    // Players want even sides and this format.
    ffmpeg.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]).arg(part.path());
    let failed = |error: std::io::Error| format!("ffmpeg: {error}");
    let ffmpeg = ffmpeg.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut ffmpeg = ffmpeg.spawn().map_err(failed)?;
    while ffmpeg.try_wait().map_err(failed)?.is_none() {
        if cancelled.load(Ordering::Relaxed) {
            ffmpeg.kill().and_then(|()| ffmpeg.wait()).map_err(failed)?;
            return Err(texts::CANCELLED.into());
        }
        std::thread::sleep(LOOK_AT_FFMPEG);
    }
    let output = ffmpeg.wait_with_output().map_err(failed)?;
    if !output.status.success() {
        let reason = String::from_utf8_lossy(&output.stderr);
        return Err(format!("ffmpeg: {}", reason.lines().last().unwrap_or("failed")));
    }
    // The file is locked until it has its name.
    let rename = || part.persist(to).map(drop).map_err(|error| cannot_write(to, &error.error));
    unless_cancelled(cancelled, rename)?;
    Ok(Vec::new())
}

/// Cameras on a circle about the up axis through the target, starting with one.
fn turntable(first: &Camera, target: DVec3, up: DVec3, frames: u32) -> Vec<Camera> {
    let fov_y = 2.0 * (0.5 * f64::from(first.height) / first.fy).atan();
    let from = first.position_world() - target;
    let camera = |k: u32| {
        let turn = DQuat::from_axis_angle(up, std::f64::consts::TAU * f64::from(k) / f64::from(frames));
        Camera::look_at(&format!("{k:05}"), target + turn * from, target, up, fov_y, (first.width, first.height))
    };
    (0..frames).map(camera).collect()
}

/// Cameras at equal times from kept camera to kept camera.
fn along(kept: &[Camera], size_px: [u32; 2], frames: u32) -> Vec<Camera> {
    let seconds = f64::from(frames.max(2) - 1) / PATH_FPS;
    let step = seconds / (kept.len().max(2) - 1) as f64;
    let keys = kept.iter().enumerate().map(|(k, camera)| (k as f64 * step, camera.in_shape(size_px)));
    Recording::through(keys).cameras()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_io::write_cameras;
    use instgs_samples::sample_scene;
    use instgs_vk::scene::PixelFilter;

    #[test]
    fn a_turntable_closes_and_a_path_ends_where_it_should() {
        let first = Camera::look_at("a", DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z, 0.8, (160, 90));
        let circle = turntable(&first, DVec3::ZERO, DVec3::Z, 4);
        assert!(circle[0].position_world().distance(first.position_world()) < 1e-9 && circle[0].fy == first.fy);
        assert!(circle[2].position_world().distance(DVec3::new(-3.0, 0.0, 1.0)) < 1e-9);
        let path = along(&circle[..3], [64, 36], 11);
        assert_eq!((path.len(), path[0].width), (11, 64));
        assert!(path[10].position_world().distance(circle[2].position_world()) < 1e-6);
        assert!(path[5].position_world().distance(circle[1].position_world()) < 1e-6);
    }

    #[test]
    fn a_way_along_far_cameras_moves_at_every_step_and_squeezes_nothing() {
        let first = Camera::look_at("a", DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z, 0.8, (160, 90));
        let path = along(&turntable(&first, DVec3::ZERO, DVec3::Z, 4)[..3], [64, 64], 120);
        assert_eq!(path.len(), 120);
        for pair in path.windows(2) {
            let step = pair[0].position_world().distance(pair[1].position_world());
            assert!((0.04..0.08).contains(&step), "{}: {step}", pair[1].name);
        }
        assert!(path.iter().all(|camera| (camera.fx - camera.fy).abs() < 1e-9 && camera.width == 64));
    }

    /// The sample scene, for a file in a folder; the scene is from a file beside it.
    fn writing(folder: &Path, name: &str) -> Writing {
        let to = folder.join(name);
        Writing {
            scene: sample_scene(),
            from: folder.join("scene.instgs"),
            format: ExportFormat::of(&to, None).unwrap(),
            to,
            saves: false,
            up: DVec3::Z,
            up_of_user: None,
            cancelled: Arc::default(),
        }
    }

    #[test]
    fn what_is_cancelled_leaves_no_file() {
        for name in ["a.ply", "a.html"] {
            for (cancelled, files) in [(true, 0), (false, 1)] {
                let folder = tempfile::tempdir().unwrap();
                let job = writing(folder.path(), name);
                let to = job.to.clone();
                job.cancelled.store(cancelled, Ordering::Relaxed);
                assert_eq!(job.run().is_err(), cancelled, "{name}");
                assert_eq!((folder.path().read_dir().unwrap().count(), to.exists()), (files, !cancelled), "{name}");
            }
        }
    }

    #[test]
    fn a_page_has_its_files_name_and_the_first_training_camera() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cameras.json");
        let camera = |name: &str| Camera::look_at(name, DVec3::X, DVec3::ZERO, DVec3::NEG_Y, 0.8, (160, 90));
        write_cameras(&file, &[camera("first_view"), camera("second_view")]).unwrap();
        let page = |job: Writing| {
            let to = job.to.clone();
            (job.run().unwrap(), std::fs::read_to_string(to).unwrap())
        };
        let (notes, text) = page(writing(folder.path(), "room.html"));
        assert_eq!(notes, Vec::<String>::new());
        assert!(text.contains("<title>room</title>") && text.contains("first_view") && !text.contains("second_view"));
        std::fs::write(&file, "no cameras").unwrap();
        let (notes, text) = page(writing(folder.path(), "hall.html"));
        assert!(notes.len() == 1 && notes[0].contains("cameras.json"), "{notes:?}");
        assert!(text.contains("<title>hall</title>") && !text.contains("first_view"));
    }

    #[test]
    fn what_a_file_cannot_hold_is_told_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let mut job = writing(folder.path(), "a.glb");
        job.scene.pixel_filter = PixelFilter { antialias: true, dilation_px2: 0.1 };
        let done = texts::exported(&job.to);
        let notes = job.run().unwrap();
        assert!(notes.len() == 2 && notes[0].starts_with(".glb has no place"), "{notes:?}");
        let text = texts::with_notes(done.clone(), &notes);
        assert!(text.starts_with(&format!("{done}; .glb has no place")) && text.ends_with("(and 1 more)"), "{text}");
        assert_eq!(texts::with_notes(done.clone(), &notes[..1]), format!("{done}; {}", notes[0]));
        assert_eq!(texts::with_notes(done.clone(), &[]), done);
    }

    /// Files of this kind that nobody has locked are removed by whoever writes into the folder for the first time.
    #[cfg(unix)]
    #[test]
    fn a_video_that_is_being_made_is_not_taken_for_one_left_behind() {
        let folder = tempfile::tempdir().unwrap();
        let part = part_of(&folder.path().join("a.mp4")).unwrap();
        let same_file = std::fs::File::open(part.path()).unwrap();
        assert!(same_file.try_lock().is_err() && part.path().extension().is_some_and(|ending| ending == "mp4"));
    }
}
