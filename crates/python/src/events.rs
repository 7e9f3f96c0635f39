//! What happens in a run, as JSON objects: the lines of `events.jsonl`, and the stages between the phases in the same form.

use instgs_objects::pipeline::{Message, Phase};
use instgs_train::TrainMessage;
use serde_json::{Value, json};

/// What the thread that trains tells the one that called.
pub(crate) enum Told {
    /// An event, for the user's callback.
    Event(Value),
    /// A remark for the user.
    Warning(String),
}

/// The message as the user gets it; `None` for what says nothing new.
pub(crate) fn told(message: &Message<'_>) -> Option<Told> {
    let event = match message {
        Message::Warning(text) | Message::Training { message: TrainMessage::Warning(text), .. } => {
            return Some(Told::Warning((*text).into()));
        }
        Message::Training { phase, message } => of_training(message).map(|mut event| {
            event["phase"] = phase_name(*phase).into();
            event
        })?,
        Message::PhaseStarted(phase) => json!({"event": "phase_started", "phase": phase_name(*phase)}),
        Message::StageStarted(stage) => json!({"event": "stage_started", "stage": stage.name()}),
        Message::StageFinished(time) => {
            json!({"event": "stage_finished", "stage": time.name, "seconds": time.seconds})
        }
        Message::Labelling(at) => json!({"event": "labelling", "done": at.done, "total": at.total}),
        Message::ViewMasked { name, views, .. } => json!({"event": "view_masked", "view": name, "views": views}),
        Message::Prepared(prepared) => json!({"event": "prepared", "groups": prepared.groups}),
        Message::Reused { folder, .. } => json!({"event": "reused", "folder": folder.path()}),
        Message::NamesFound(_) | Message::Trained { .. } => return None,
    };
    Some(Told::Event(event))
}

/// An event of a training; `None` for a warning, and for what JSON cannot hold.
fn of_training(message: &TrainMessage<'_>) -> Option<Value> {
    match message {
        TrainMessage::Event(event) => serde_json::to_value(event).ok(),
        TrainMessage::Rewound { step } => Some(json!({"event": "rewound", "step": step})),
        TrainMessage::TestView(view) => {
            Some(json!({"event": "test_view", "view": view.name, "psnr": view.metrics.psnr, "ssim": view.metrics.ssim}))
        }
        TrainMessage::Warning(_) => None,
    }
}

fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::PlainCloud => "plain_cloud",
        Phase::Objects => "objects",
        Phase::Joint => "joint",
    }
}
