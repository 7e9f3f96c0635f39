//! Work that takes long, beside the picture: files are written on a thread, frames into files one per picture. Both show their
//! progress and can be cancelled.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError, channel};
use std::time::Duration;

use glam::{DMat3, DQuat, DVec3};

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
    packing_lost, page_text, replaced_file, save_scene,
};
use instgs_vk::scene::camera::rigid_rows;
use instgs_vk::scene::{Boxes, Camera, InstancedScene};
use tempfile::NamedTempFile;

/// How often it is looked whether ffmpeg has ended.
const LOOK_AT_FFMPEG: Duration = Duration::from_millis(50);
/// How long a closing window waits for cancelled work to remove its temporary file; ffmpeg ends within that time.
const LET_STOP: Duration = Duration::from_millis(500);

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
enum Opened {
    /// The one that the window was opened for.
    First,
    /// Another one, in place of what there was then: the user has agreed to lose what of it is not saved.
    InPlace(Agreed),
}

/// The unsaved work that the user has agreed to lose with a scene, as it was then: what has changed since is not meant.
struct Agreed {
    /// Revision of the scene in the editor.
    revision: u64,
    boxes: Boxes,
    /// True while a camera path is recorded.
    records: bool,
}

struct Drawing {
    cameras: Vec<Camera>,
    next: usize,
    /// Where frames go, each under its camera's name; a single picture has a file of its own.
    folder: PathBuf,
    single: Option<PathBuf>,
    /// The file of the video that ffmpeg makes of the frames.
    video: PathBuf,
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
        if self.wait_for_saving().is_err() {
            // The notice says why, and is to be read.
            return;
        }
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
        let agreed = Agreed {
            revision: self.session.viewer.editor_mut().revision(),
            boxes: self.input.boxing.boxes_of_file(),
            records: self.camera.recording.is_some(),
        };
        self.cancel_work();
        self.read(path, Opened::InPlace(agreed));
    }

    /// True if nothing but what the user has agreed to lose is lost with the present scene.
    fn is_as_agreed(&self, agreed: &Agreed) -> bool {
        let is_same = self.session.viewer.editor().is_at(agreed.revision)
            && self.input.boxing.boxes_of_file() == agreed.boxes
            && (agreed.records || self.camera.recording.is_none());
        is_same || !self.is_unsaved()
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
        let Some(Work { kind: Kind::Read { done, path, .. }, .. }) = &self.work else { return Ok(false) };
        if self.playback.holds_file {
            return Ok(false);
        }
        let loaded = match done.try_recv() {
            Ok(loaded) => loaded,
            Err(TryRecvError::Empty) => return Ok(false),
            Err(TryRecvError::Disconnected) => Err(IoError::new(path, texts::READER_BROKE)),
        };
        let Some(Work { kind: Kind::Read { path, of, .. }, .. }) = self.work.take() else { return Ok(false) };
        match of {
            Opened::First => self.take_first(loaded, job)?,
            Opened::InPlace(agreed) if loaded.is_ok() && !self.is_as_agreed(&agreed) => {
                self.hud.message = Some(texts::changed_meanwhile(&path));
            }
            Opened::InPlace(_) => self.take_file(&path, loaded, job)?,
        }
        Ok(true)
    }

    /// Name of the work that leaving the scene stops. What is only read is not lost.
    pub(super) fn work_to_stop(&self) -> Option<String> {
        let work = self.work.as_ref().filter(|work| !matches!(work.kind, Kind::Read { .. }))?;
        Some(work.name.clone())
    }

    /// Cancels the work: a file that is being written never appears, frames that were drawn stay.
    pub(super) fn cancel_work(&mut self) {
        if let Some(work) = self.take_cancelled() {
            self.hud.message = Some(texts::was_cancelled(&work.name));
        }
    }

    /// Cancels the work since the window closes.
    pub(super) fn stop_work(&mut self) {
        if let Some(Work { kind: Kind::Write { done, .. }, .. }) = self.take_cancelled() {
            drop(done.recv_timeout(LET_STOP));
        }
    }

    fn take_cancelled(&mut self) -> Option<Work> {
        let work = self.work.take()?;
        work.cancelled.store(true, Ordering::Relaxed);
        Some(work)
    }

    /// Waits until the scene's own file is written, if it is being written.
    ///
    /// # Errors
    /// Why it could not be written, which is displayed, too.
    pub(super) fn wait_for_saving(&mut self) -> Result<(), PlayerError> {
        self.wait_while(|work| matches!(work.kind, Kind::Write { saved_revision: Some(_), .. }))
    }

    /// Waits until a file is written; other work goes on.
    ///
    /// # Errors
    /// Those of [`Live::wait_for_saving`].
    pub(super) fn wait_for_writing(&mut self) -> Result<(), PlayerError> {
        self.wait_while(|work| matches!(work.kind, Kind::Write { .. }))
    }

    fn wait_while(&mut self, waits: impl Fn(&Work) -> bool) -> Result<(), PlayerError> {
        let mut written = Ok(());
        while self.work.as_ref().is_some_and(&waits) {
            written = self.note_written(Duration::from_secs(1));
        }
        written
    }

    /// Takes the result of a thread if it comes within a time.
    ///
    /// # Errors
    /// Those of [`Live::wait_for_saving`].
    fn note_written(&mut self, within: Duration) -> Result<(), PlayerError> {
        let Some(Work { kind: Kind::Write { done, to, saved_revision }, .. }) = &self.work else { return Ok(()) };
        let result = match done.recv_timeout(within) {
            Ok(result) => result,
            Err(RecvTimeoutError::Timeout) => return Ok(()),
            Err(RecvTimeoutError::Disconnected) => Err(texts::WRITER_BROKE.into()),
        };
        let (to, saved) = (to.clone(), *saved_revision);
        self.work = None;
        let text = match (result, saved) {
            (Err(reason), _) => {
                self.hud.message = Some(reason.clone());
                return Err(PlayerError::Unwritten(reason));
            }
            (Ok(notes), None) => texts::with_notes(texts::exported(&to), &notes),
            (Ok(mut notes), Some(revision)) => {
                self.session.viewer.editor_mut().saved_at(revision);
                notes.extend(self.take_kept_cameras(&to));
                self.recent.note(&to);
                self.take_path(&to);
                self.session.file_bytes = std::fs::metadata(&to).map_or(self.session.file_bytes, |file| file.len());
                texts::with_notes(texts::saved(&to), &notes)
            }
        };
        self.hud.message = Some(text);
        Ok(())
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
        let [folder, video] = self.session.free_names(["frames", "mp4"]);
        if let (None, Err(error)) = (&single, std::fs::create_dir_all(&folder)) {
            return self.hud.message = Some(format!("{}: {error}", folder.display()));
        }
        let name = texts::frames_of(cameras.len(), size_px);
        let kind = Kind::Draw(Drawing { cameras, next: 0, folder, single, video });
        self.work = Some(Work { name, cancelled: Arc::default(), kind });
    }

    /// Goes on with the work; true if the next picture should follow at once.
    pub(super) fn go_on_working(&mut self, job: &WindowJob) -> Result<bool, PlayerError> {
        // What went wrong is displayed.
        drop(self.note_written(Duration::ZERO));
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
        let Some(Work { kind: Kind::Draw(Drawing { cameras, folder, single, video, .. }), .. }) = self.work.take()
        else {
            return Ok(false);
        };
        match single {
            Some(path) => self.hud.message = Some(texts::saved(&path)),
            None => self.encode(folder, video, cameras.len()),
        }
        Ok(true)
    }

    /// Makes a video of frames on a thread, where ffmpeg is on the machine.
    fn encode(&mut self, folder: PathBuf, to: PathBuf, count: usize) {
        let known = Command::new("ffmpeg").arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
        if !known.is_ok_and(|status| status.success()) {
            return self.hud.message = Some(texts::no_ffmpeg(count, &folder));
        }
        let (sender, done) = channel();
        let cancelled = Arc::new(AtomicBool::new(false));
        let stop = cancelled.clone();
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
            // A folder's files are each written under a temporary name.
            ExportFormat::SogFolder => {
                let write = || export_scene(&self.to, &self.scene, self.format, self.up).map_err(|e| e.to_string());
                (unless_cancelled(&self.cancelled, write)?, Vec::new())
            }
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
        // A link stays, and the file that it leads to is replaced.
        let to = replaced_file(&self.to).map_err(|error| error.to_string())?;
        // Those that write put another file in its place, so that it is not kept open and locked.
        let part = part_of(&to, &self.to)?.into_temp_path();
        let done = if self.saves {
            save_scene(&part, &self.scene).map(|()| ExportedScene::default())
        } else {
            export_scene(&part, &self.scene, self.format, self.up)
        };
        // Its errors name the temporary file.
        let named = |text: String| text.replace(&part.display().to_string(), &self.to.display().to_string());
        let exported = done.map_err(|error| named(error.to_string()))?;
        let rename = || part.persist(&to).map_err(|error| cannot_write(&self.to, &error.error));
        unless_cancelled(&self.cancelled, rename)?;
        Ok(exported)
    }
}

/// An empty temporary file beside another, which is removed unless it gets the other's name. It has the ending of the name that
/// the user gave, a link perhaps: that says what is written. It is locked while it is open, so that no process takes it for one
/// that a killed player has left.
fn part_of(to: &Path, named: &Path) -> Result<NamedTempFile, String> {
    let ending = format!(".{}", named.extension().unwrap_or_default().to_string_lossy());
    locked_temporary(to, &ending).map_err(|error| error.to_string())
}

fn cannot_write(to: &Path, error: &std::io::Error) -> String {
    IoError::os(to, texts::CANNOT_WRITE, error).to_string()
}

/// Lets a complete file appear under its name, unless the user has cancelled.
fn unless_cancelled<T>(cancelled: &AtomicBool, appear: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    if cancelled.load(Ordering::Relaxed) { Err(texts::CANCELLED.into()) } else { appear() }
}

/// Runs ffmpeg on numbered frames.
fn video(folder: &Path, to: &Path, cancelled: &AtomicBool) -> Written {
    let part = part_of(to, to)?;
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
    // The file is locked until it has its name, which another program may have taken meanwhile.
    let rename = || part.persist_noclobber(to).map(drop).map_err(|error| cannot_write(to, &error.error));
    unless_cancelled(cancelled, rename)?;
    Ok(Vec::new())
}

/// The first camera turned about the up axis through the target, a full turn. It keeps its roll, and may look along the axis.
fn turntable(first: &Camera, target: DVec3, up: DVec3, frames: u32) -> Vec<Camera> {
    let from = first.position_world() - target;
    let camera = |k: u32| {
        let turn = DQuat::from_axis_angle(up, std::f64::consts::TAU * f64::from(k) / f64::from(frames));
        let rotation = first.rotation() * DMat3::from_quat(turn).transpose();
        let view_from_world = rigid_rows(rotation, -(rotation * (target + turn * from)));
        Camera { name: format!("{k:05}"), view_from_world, ..first.clone() }
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
mod tests;
