//! What happens, as one numbered stream.

use std::sync::atomic::Ordering;

use ob1_access::Right;
use ob1_access::door::{Answer, Ask, Command, Door, Event, News, State, What};

use crate::station::{Station, link};

#[test]
fn events_are_one_stream_that_can_be_resumed() {
    let mut station = Station::new(vec![link("panel", Right::Operate), link("gate", Right::Read)]);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 0, Ask::Events { after: 0 }), Answer::Done);
    station.driver_up.store(true, Ordering::Relaxed);
    assert_eq!(station.ask(&mut door, 0, Ask::Command(Command::Stop)), Answer::Done);
    let mut other = station.open(1);
    other.beat();
    other.pump().expect("open");
    station.cycles(3);
    drop(other);
    station.cycles(3);
    let events = |door: &mut Door| -> Vec<Event> {
        door.pump().expect("open");
        let news = std::iter::from_fn(|| door.take_news());
        news.filter_map(|news| if let News::Event(event) = news { Some(event) } else { None }).collect()
    };
    let mut seen = std::mem::take(&mut station.seen);
    seen.extend(events(&mut door));
    let numbers: Vec<u64> = seen.iter().map(|event| event.number).collect();
    let last = *numbers.last().expect("some");
    assert_eq!(numbers, (last + 1 - numbers.len() as u64..=last).collect::<Vec<_>>(), "no gap");
    let has = |what: &What| seen.iter().any(|event| event.what == *what);
    assert!(has(&What::Driver { name: "cp".into(), up: true }));
    assert!(has(&What::State(State::Stop)));
    assert!(has(&What::Link { name: "gate".into(), up: true }) && has(&What::Link { name: "gate".into(), up: false }));
    assert!(
        seen.iter().any(|event| matches!(&event.what, What::Diagnosis(entry) if entry.event == 0x4304)),
        "{seen:?}"
    );
    // The process dies and comes back: it continues where it was.
    drop(door);
    assert!(station.ask_again_after(last).is_empty());
}

#[test]
fn a_client_can_ask_for_new_events_only() {
    let mut station = Station::new(vec![link("panel", Right::Operate)]);
    let mut door = station.open(0);
    assert_eq!(station.ask(&mut door, 0, Ask::Command(Command::Stop)), Answer::Done);
    station.cycles(3);
    assert_eq!(station.ask(&mut door, 0, Ask::Events { after: u64::MAX }), Answer::Done);
    assert_eq!(station.ask(&mut door, 0, Ask::Command(Command::Warm)), Answer::Done);
    station.cycles(3);
    door.pump().expect("open");
    let mut seen = std::mem::take(&mut station.seen);
    seen.extend(std::iter::from_fn(|| door.take_news()).filter_map(|news| match news {
        News::Event(event) => Some(event),
        _ => None,
    }));
    let has = |state: State| seen.iter().any(|event| event.what == What::State(state));
    assert!(has(State::Run), "{seen:?}");
    assert!(!has(State::Stop), "{seen:?}");
}

impl Station {
    fn ask_again_after(&mut self, last: u64) -> Vec<Event> {
        let mut door = self.open(0);
        assert_eq!(self.ask(&mut door, 0, Ask::Events { after: last }), Answer::Done);
        self.cycles(2);
        door.pump().expect("open");
        let news = std::iter::from_fn(|| door.take_news());
        let events = news.filter_map(|news| if let News::Event(event) = news { Some(event) } else { None });
        events.filter(|event| !matches!(event.what, What::Link { .. })).collect()
    }
}
