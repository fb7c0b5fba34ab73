//! What happens in the station beside its scans: the broker's events, late scans with their causes, orders that CPs
//! have ended with an error.

use std::os::fd::BorrowedFd;

use ob1_access::door::{Ask, Door, News, What};
use ob1_backplane::BufferEntry;
use ob1_record::Event;

use crate::view::{StationView, event_number};

/// What happens, since it was asked last.
#[derive(Debug)]
pub(super) struct Happenings {
    door: Option<Door>,
    view: StationView,
    /// The last late scan that was told.
    late: u64,
    /// The newest entry of each CP that was told.
    buffers: Vec<Option<BufferEntry>>,
    /// How often each driver was lost and started, as it was told.
    drivers: Vec<[u32; 2]>,
}

impl Happenings {
    pub(super) fn new(mut door: Door, view: StationView) -> Self {
        door.ask(0, Ask::Events { after: 0 });
        let buffers = vec![None; view.modules.len()];
        let drivers = vec![[0; 2]; view.modules.len()];
        Self { door: Some(door), view, late: 0, buffers, drivers }
    }

    /// What becomes ready when the broker says something.
    pub(super) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.door.as_ref().map(Door::fd)
    }

    /// Everything so far is of no interest.
    pub(super) fn forget(&mut self) {
        self.take();
    }

    /// What has happened since.
    pub(super) fn take(&mut self) -> Vec<Event> {
        let mut events = self.of_broker();
        for late in self.view.timings.late_after(self.late) {
            self.late = late.scan;
            events.push(Event::Late(late));
        }
        // A driver is started again so soon that only the counts show it.
        let time_ns = self.view.clock.time().nanos();
        for (module, told) in self.view.modules.iter().zip(&mut self.drivers) {
            let Some(driver) = &module.driver else { continue };
            let now = [driver.losses(), driver.starts()];
            let before = std::mem::replace(told, now);
            for (is_new, up) in [(now[0] != before[0], false), (now[1] != before[1], true)] {
                events.extend(is_new.then(|| Event::Process { time_ns, name: module.name.clone(), up }));
            }
        }
        for (module, told) in self.view.modules.iter().zip(&mut self.buffers) {
            let Some(monitor) = &module.monitor else { continue };
            let before = *told;
            let new: Vec<BufferEntry> = monitor.buffer().take_while(|entry| Some(*entry) != before).collect();
            *told = new.first().copied().or(before);
            let ended = new.into_iter().rev().map(|entry| Event::Order {
                module: module.name.clone(),
                time_ns: entry.time_ms * 1_000_000,
                took_ns: 0,
                what: self.view.cp_text(module, entry),
                status: entry.number.into(),
            });
            events.extend(ended);
        }
        events
    }

    fn of_broker(&mut self) -> Vec<Event> {
        let mut events = Vec::new();
        // A broker that is gone ends with its station.
        if self.door.as_mut().is_some_and(|door| door.pump().is_err()) {
            self.door = None;
        }
        while let Some(news) = self.door.as_mut().and_then(Door::take_news) {
            let News::Event(event) = news else { continue };
            let time_ns = event.time;
            events.extend(match event.what {
                What::Diagnosis(entry) => {
                    let text = [entry.text, entry.place, entry.because].into_iter().filter(|part| !part.is_empty());
                    let text = text.collect::<Vec<_>>().join("; ");
                    Some(Event::Diagnosis { time_ns, number: event_number(entry.event), text })
                }
                What::Link { name, up } => Some(Event::Process { time_ns, name, up }),
                What::Driver { .. } | What::State(_) | What::Lost(_) => None,
            });
        }
        events
    }
}
