//! Events in the life of a rig.

use serde::{Deserialize, Serialize};

use crate::video::choices::{MOST_EVENTS, SAME_EVENT_FRAMES};
use phasestereo_match::named;

named! {
    /// The subject of an event.
    #[derive(Serialize, Deserialize)]
    pub enum Subject {
        /// The cameras: those that rectified a raw pair, and whether both run.
        Cameras = "cameras",
        /// The rows of the pair.
        Rows = "rows",
        /// The range of disparities.
        Range = "range",
        /// Which image is the softer one.
        Blur = "blur",
        /// How much of the match is probably wrong.
        Health = "health",
    }
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Its subject.
    pub subject: Subject,
    /// The number of the frame, from 0.
    pub frame: u64,
    /// What happened, in a sentence.
    pub sentence: String,
}

/// The events of a rig, the oldest first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Events(Vec<Event>);

impl Events {
    /// All stored events.
    pub fn all(&self) -> &[Event] {
        &self.0
    }

    /// Stores another event.
    pub fn push(&mut self, subject: Subject, frame: u64, sentence: impl Into<String>) {
        if self.0.len() == MOST_EVENTS {
            self.0.remove(0);
        }
        self.0.push(Event { subject, frame, sentence: sentence.into() });
    }

    /// Stores another event, replacing the last one of this subject if that is recent.
    pub fn renew(&mut self, subject: Subject, frame: u64, sentence: impl Into<String>) {
        let is_near = |event: &Event| event.subject == subject && event.frame + SAME_EVENT_FRAMES >= frame;
        if let Some(last) = self.0.iter_mut().rev().find(|event| is_near(event)) {
            *last = Event { subject, frame, sentence: sentence.into() };
            return;
        }
        self.push(subject, frame, sentence);
    }
}

/// A state that changes only after several consecutive frames agree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Steady {
    /// The state.
    pub state: i64,
    /// The state it may change to.
    pub next: i64,
    /// Consecutive frames that agree on it.
    pub frames: u32,
}

impl Steady {
    /// An initial state.
    pub fn new(state: i64) -> Self {
        Self { state, next: state, frames: 0 }
    }

    /// Adds a frame's state. Returns the new state and its age in frames, if this many frames in a row agree.
    pub fn update(&mut self, said: i64, patience: u32) -> Option<u32> {
        if said != self.next {
            (self.next, self.frames) = (said, 0);
        }
        self.frames = self.frames.saturating_add(1);

        let has_changed = self.next != self.state && self.frames >= patience;
        has_changed.then(|| {
            self.state = self.next;
            self.frames - 1
        })
    }
}
