//! Events between two threads at full speed: whole, in order, once.

use std::thread;

use super::{ROUNDS, both_ends};
use crate::{Event, EventKind};

const MANY: u64 = ROUNDS / 4;

#[test]
fn events_between_two_threads_are_whole_in_order_and_those_that_are_lost_are_counted() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    let event = |number: u64| {
        let data = [number.to_le_bytes(), (!number).to_le_bytes()].concat();
        Event::new(number, EventKind::Message, number as u32, &data)
    };
    thread::scope(|scope| {
        scope.spawn(move || {
            for number in 1..MANY {
                cp.emit_event(event(number));
            }
            // The last one waits for room: it ends the test.
            while !cp.emit_event(event(MANY)) {
                thread::yield_now();
            }
        });
        let (mut last, mut seen) = (0, 0);
        while last < MANY {
            let Some(next) = cpu.poll_event().unwrap() else {
                thread::yield_now();
                continue;
            };
            assert!(next.time > last, "{} after {last}", next.time);
            assert_eq!(next, event(next.time));
            (last, seen) = (next.time, seen + 1);
        }
        // Each refused attempt of the last one is also counted.
        assert!(seen + cpu.monitor().events_lost() >= MANY);
        assert_eq!(cpu.poll_event(), Ok(None));
    });
}
