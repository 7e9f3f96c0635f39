//! What happens in a run, as JSON objects: the lines of `events.jsonl`, and the stages between the phases in the same form.

use instgs_objects::pipeline::{Message, Phase};
use instgs_train::TrainMessage;
use instgs_train::events::Event;
use serde::Serialize;
use serde_json::json;

/// What the thread that trains tells the one that called.
pub(crate) enum Told {
    /// An event, for the user's callback: its JSON.
    Event(String),
    /// A remark for the user.
    Warning(String),
}

/// An event of a training with its phase. Never a `serde_json::Value`, which widens f32 to other digits than those of the log.
#[derive(Serialize)]
struct OfPhase<'a> {
    #[serde(flatten)]
    event: &'a Event,
    phase: &'static str,
}

/// The message as the user gets it; `None` for what says nothing new, and for what JSON cannot hold.
pub(crate) fn told(message: &Message<'_>) -> Option<Told> {
    let event = match message {
        Message::Warning(text) => return Some(Told::Warning((*text).into())),
        Message::Training { phase, message } => return of_training(phase_name(*phase), message),
        Message::PhaseStarted(phase) => json!({"event": "phase_started", "phase": phase_name(*phase)}),
        Message::StageStarted(stage) => json!({"event": "stage_started", "stage": stage.name()}),
        Message::StageFinished(time) => {
            json!({"event": "stage_finished", "stage": time.name, "seconds": time.seconds})
        }
        Message::Labelling(at) => json!({"event": "labelling", "done": at.done, "total": at.total}),
        Message::ViewMasked { name, views, .. } => json!({"event": "view_masked", "view": name, "views": views}),
        Message::Prepared(prepared) => json!({"event": "prepared", "groups": prepared.groups}),
        Message::Reused { folder, .. } => json!({"event": "reused", "folder": folder.path()}),
        Message::NamesFound(found) => return found.views_without_note().map(Told::Warning),
        Message::Trained { .. } => return None,
    };
    Some(Told::Event(event.to_string()))
}

fn of_training(phase: &'static str, message: &TrainMessage<'_>) -> Option<Told> {
    let event = match message {
        TrainMessage::Warning(text) | TrainMessage::Note(text) => return Some(Told::Warning((*text).into())),
        TrainMessage::Event(event) => serde_json::to_string(&OfPhase { event, phase }).ok()?,
        TrainMessage::PhotoRead { done, total } => {
            json!({"event": "photo_read", "done": done, "total": total, "phase": phase}).to_string()
        }
        TrainMessage::Rewound { step } => json!({"event": "rewound", "step": step, "phase": phase}).to_string(),
        TrainMessage::TestView(view) => {
            let (psnr, ssim) = (view.metrics.psnr, view.metrics.ssim);
            json!({"event": "test_view", "view": view.name, "psnr": psnr, "ssim": ssim, "phase": phase}).to_string()
        }
    };
    Some(Told::Event(event))
}

fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::PlainCloud => "plain_cloud",
        Phase::Objects => "objects",
        Phase::Joint => "joint",
    }
}
