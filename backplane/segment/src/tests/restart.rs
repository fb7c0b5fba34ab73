//! A driver dies and another one replaces it.

use super::{at, both_ends};
use crate::{Counter, CpSide, DriverState, Event, EventKind, Freshness, Leds, ModemInputs, Reason, Why};

#[test]
fn a_new_driver_is_another_generation_and_starts_from_zero() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    let first = cp.generation();
    assert_ne!(first, 0);
    assert_eq!(cpu.monitor().generation(), first);
    cpu.write_outputs(&[4; 16]);
    cpu.write_params(&[1; 16], b"{}").unwrap();
    cp.write_inputs(&[5; 16]);
    cp.write_diagnosis(1, &[6; 16]).unwrap();
    segment.poke(at("diagnosis.sequence"), segment.peek(at("diagnosis.sequence")).unwrap() + 1);
    cp.set_state(DriverState::Ready);
    cp.set_leds(Leds { power: true, ..Leds::default() });
    cp.set_modem_inputs(ModemInputs { rts: true, ..ModemInputs::default() });
    cpu.set_time(12_999_999_999);
    let reason = Reason::state(Why::StartUp, 0x8001);
    cp.set_reason(Some(reason));
    assert_eq!(cpu.monitor().reason(), Some((reason, 12)));
    drop(cp);
    let mut cp = CpSide::attach(&segment).unwrap();
    assert_ne!(cp.generation(), first);
    assert_eq!(cpu.monitor().generation(), cp.generation());
    assert_eq!(cpu.monitor().driver_state(), Ok(DriverState::Starting));
    assert_eq!(cpu.monitor().leds(), Leds::default());
    assert_eq!(cpu.monitor().modem_inputs(), ModemInputs::default());
    assert_eq!(cpu.monitor().reason(), None);
    let mut registers = [1; 16];
    assert_eq!(cpu.read_inputs(&mut registers), Freshness::Fresh);
    assert_eq!(registers, [0; 16]);
    assert!(cp.outputs_changed() && cp.params_changed(), "what the CPU side says is new to it");
    let diagnosis = cpu.read_diagnosis().unwrap();
    assert_eq!((diagnosis.freshness, diagnosis.number, diagnosis.data()), (Freshness::Fresh, 0, &[][..]));
    assert_eq!(cp.read_outputs(&mut registers), Freshness::Fresh);
    assert_eq!(registers, [4; 16]);
    assert_eq!(cp.read_params().unwrap().json, b"{}");
    assert_eq!(cp.counters().get(Counter::DriverStarts), 2);
}

#[test]
fn the_generation_never_is_zero() {
    let (segment, cpu, _cp) = both_ends(16);
    segment.poke(at("cp.generation"), u64::MAX);
    assert_eq!(CpSide::attach(&segment).unwrap().generation(), 1);
    assert_eq!(cpu.monitor().generation(), 1);
}

#[test]
fn while_no_driver_is_there_its_side_reads_zero() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    cp.write_inputs(&[5; 16]);
    cp.set_state(DriverState::Ready);
    cp.set_leds(Leds { error: true, ..Leds::default() });
    cp.set_modem_inputs(ModemInputs { cd: true, ..ModemInputs::default() });
    cp.set_reason(Some(Reason::state(Why::Stopped, 0)));
    assert!(cp.prepare_sleep(cp.changes()));
    // Killed while sleeping, and during a write, as far as this can be simulated.
    segment.poke(at("inputs.sequence"), 1001);
    drop(cp);
    cpu.monitor().driver_gone();
    let mut registers = [1; 16];
    assert_eq!(cpu.read_inputs(&mut registers), Freshness::Fresh);
    assert_eq!(registers, [0; 16]);
    assert_eq!(cpu.monitor().driver_state(), Ok(DriverState::Absent));
    assert_eq!((cpu.monitor().leds(), cpu.monitor().modem_inputs()), (Leds::default(), ModemInputs::default()));
    assert_eq!(cpu.monitor().reason(), None);
    cpu.write_outputs(&[1; 16]);
    assert!(!cpu.take_doorbell(), "nobody is there to be woken");
}

#[test]
fn what_lay_in_the_buffers_of_a_killed_driver_is_lost_once() {
    let (segment, cpu, mut cp) = both_ends(16);
    cp.count(Counter::OrdersAccepted, 5);
    cp.count(Counter::TelegramsSent, 3);
    cp.count(Counter::TelegramsReceived, 4);
    assert_eq!(cpu.monitor().counters().open_orders(), 2);
    drop(cp);
    cpu.monitor().driver_gone();
    let _cp = CpSide::attach(&segment).unwrap();
    let counters = cpu.monitor().counters();
    assert_eq!((counters.get(Counter::OrdersLost), counters.get(Counter::ReceiveLost)), (2, 4));
    assert_eq!((counters.open_orders(), counters.open_receives()), (0, 0));
}

#[test]
fn a_new_driver_puts_counters_right_that_an_old_one_has_spoilt() {
    let (segment, mut cpu, _cp) = both_ends(16);
    segment.poke(at("events.produced"), 1 << 50);
    let mut cp = CpSide::attach(&segment).unwrap();
    let event = Event::new(1, EventKind::Message, 2, &[]);
    assert!(cp.emit_event(event));
    assert_eq!(cpu.poll_event(), Ok(Some(event)));
}

#[test]
fn complete_events_of_a_dead_driver_still_come() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    let last_words = Event::new(9, EventKind::DiagnosticIncoming, 1, &[1]);
    assert!(cp.emit_event(last_words));
    drop(cp);
    let mut cp = CpSide::attach(&segment).unwrap();
    let first_words = Event::new(1, EventKind::Message, 2, &[]);
    assert!(cp.emit_event(first_words));
    assert_eq!((cpu.poll_event(), cpu.poll_event()), (Ok(Some(last_words)), Ok(Some(first_words))));
    assert_eq!(cpu.poll_event(), Ok(None));
}
