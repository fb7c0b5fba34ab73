//! The diagnostic buffer as a run itself sees it: the scan hands each entry over, the run reports the changes of the
//! operating state and knows at the end what led to STOP. No socket and no text lies in between.

use std::collections::VecDeque;

use ob1_broker::FeedEnd;
use ob1_cpu::{DIAG_ENTRIES, DiagEntry};
use ob1_model::{Event, StateChange};

use crate::access::protocol::Diagnostic;
use crate::view::StationView;

/// The run's end: takes the scan's entries, and reports changes of the state.
pub(super) struct Journal {
    entries: FeedEnd,
    /// Entries so far, oldest first.
    kept: VecDeque<DiagEntry>,
    /// The last change of the operating state.
    change: Option<DiagEntry>,
    /// The cycle monitoring led to STOP; the cause is reported when it is known.
    exceeded: Option<DiagEntry>,
}

impl Journal {
    /// A journal of what the scan hands over at this end.
    pub(super) fn new(entries: FeedEnd) -> Self {
        Self { entries, kept: VecDeque::with_capacity(DIAG_ENTRIES), change: None, exceeded: None }
    }

    /// Takes what has come, and reports each change of the operating state once.
    pub(super) fn take(&mut self, view: &StationView) {
        while let Some(entry) = self.entries.take() {
            if let Some(change) = entry.event.state_change() {
                tell(change, &entry, self.cause(&entry), view);
                self.change = Some(entry);
                if change == StateChange::Fault {
                    self.exceeded = self.cause(&entry).filter(|e| e.event == Event::CYCLE_TIME_EXCEEDED).copied();
                }
            }
            if self.kept.len() == DIAG_ENTRIES {
                self.kept.pop_front();
            }
            self.kept.push_back(entry);
        }
        if let Some(text) = self.exceeded.and_then(|entry| view.stood_in_the_way(&entry)) {
            tracing::error!("the cycle that led to STOP: {text}");
            self.exceeded = None;
        }
    }

    /// What led to this STOP: the entry before it, unless that is a change of state itself.
    fn cause(&self, stop: &DiagEntry) -> Option<&DiagEntry> {
        let before = self.kept.back().filter(|entry| entry.number + 1 == stop.number);
        before.filter(|entry| entry.event.state_change().is_none())
    }

    /// The number of the newest entry that has come.
    pub(super) fn newest(&self) -> u64 {
        self.kept.back().map_or(0, |entry| entry.number)
    }

    /// The fault that led to STOP, if the last change of state was one.
    pub(super) fn fault(&self) -> Option<String> {
        let change = self.change.filter(|entry| entry.event.state_change() == Some(StateChange::Fault));
        change.map(|entry| entry.to_string())
    }

    /// The entries for a report, newest first.
    pub(super) fn diagnostics(&self, view: &StationView) -> Vec<Diagnostic> {
        self.kept.iter().rev().map(|entry| view.diagnostic(view.diagnosis(entry))).collect()
    }
}

/// RUN and the like are information; STOP because of a fault is an error, with its cause below it.
fn tell(change: StateChange, entry: &DiagEntry, cause: Option<&DiagEntry>, view: &StationView) {
    let known = view.known.get();
    let text = known.places.told(entry);
    match change {
        StateChange::Startup => tracing::info!("STARTUP: {text}"),
        StateChange::Run => tracing::info!("RUN: {text}"),
        StateChange::Hold => tracing::info!("HOLD: {text}"),
        StateChange::Stop => tracing::info!("STOP: {text}"),
        StateChange::Fault => {
            tracing::error!("STOP: {text}");
            if let Some(cause) = cause {
                tracing::error!("  because of {}", known.places.told(cause));
            }
            let remedy = cause.map_or("", |cause| view.remedy(cause));
            let remedy = if remedy.is_empty() { entry.event.remedy() } else { remedy };
            tracing::error!("  = {remedy}");
        }
    }
}
