//! All other data in the segment, in both directions.

use super::{Noise, at, both_ends};
use crate::{
    Counter, CpuState, DriverState, Event, EventKind, Fault, Freshness, Leds, ModemInputs, ModemOutputs, Segment,
    SegmentError, TooLong, layout,
};

#[test]
fn parameters_arrive_and_every_transfer_is_noticed() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    assert!(!cp.params_changed());
    assert_eq!(cp.read_params().unwrap().revision, 0);
    let bytes: [u8; 16] = std::array::from_fn(|index| index as u8);
    cpu.write_params(&bytes, br#"{"protocol":"3964r"}"#).unwrap();
    assert!(cp.params_changed());
    let first = cp.read_params().unwrap();
    assert_eq!((first.bytes, first.json, first.freshness), (bytes, &br#"{"protocol":"3964r"}"#[..], Freshness::Fresh));
    let first = first.revision;
    assert!(!cp.params_changed());
    cpu.write_params(&bytes, br#"{"protocol":"3964r"}"#).unwrap();
    assert!(cp.params_changed(), "a transfer of the same content is a transfer");
    assert_ne!(cp.read_params().unwrap().revision, first);
    cpu.write_params(&bytes, b"").unwrap();
    assert_eq!(cp.read_params().unwrap().json, b"");
}

#[test]
fn parameters_fit_to_the_last_byte_and_no_further() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    let mut noise = Noise(4);
    let text: Vec<u8> = (0..layout::JSON_BYTES).map(|_| noise.next() as u8).collect();
    cpu.write_params(&[1; 16], &text).unwrap();
    assert_eq!(cp.read_params().unwrap().json, text);
    let longer = vec![b' '; layout::JSON_BYTES + 1];
    assert_eq!(cpu.write_params(&[2; 16], &longer), Err(TooLong { found: 4097, room: 4096 }));
    assert!(!cp.params_changed());
    assert_eq!(cp.read_params().unwrap().bytes, [1; 16]);
}

#[test]
fn a_parameter_length_without_room_is_a_fault() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    cpu.write_params(&[1; 16], b"{}").unwrap();
    for length in [4097, u64::MAX] {
        segment.poke(at("params.json_length"), length);
        assert_eq!(cp.read_params(), Err(Fault::ParameterLength(length)));
    }
    segment.poke(at("params.json_length"), 1);
    assert_eq!(cp.read_params().unwrap().json, b"{");
}

#[test]
fn the_diagnostic_record_crosses_whole_or_not_at_all() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    assert_eq!(cpu.read_diagnosis().unwrap().data(), &[]);
    let long = [0x5a; layout::RECORD_BYTES];
    cp.write_diagnosis(1, &long).unwrap();
    let diagnosis = cpu.read_diagnosis().unwrap();
    assert_eq!((diagnosis.number, diagnosis.data(), diagnosis.freshness), (1, &long[..], Freshness::Fresh));
    let longer = [0; layout::RECORD_BYTES + 1];
    assert_eq!(cp.write_diagnosis(1, &longer), Err(TooLong { found: 241, room: 240 }));
    assert_eq!(cpu.read_diagnosis().unwrap(), diagnosis);
    segment.poke(at("diagnosis.length"), 241);
    assert_eq!(cpu.read_diagnosis(), Err(Fault::RecordLength(241)));
}

#[test]
fn events_come_in_order_and_a_full_ring_counts_what_it_loses() {
    let (_segment, mut cpu, mut cp) = both_ends(16);
    let event = |number: u64| Event::new(number, EventKind::Message, number as u32, &number.to_le_bytes());
    assert_eq!(cpu.poll_event(), Ok(None));
    for number in 0..70 {
        assert_eq!(cp.emit_event(event(number)), number < 64);
    }
    assert_eq!(cpu.monitor().events_lost(), 6);
    for number in 0..64 {
        assert_eq!(cpu.poll_event(), Ok(Some(event(number))));
    }
    assert_eq!(cpu.poll_event(), Ok(None));
    for number in 100..400 {
        assert!(cp.emit_event(event(number)));
        assert_eq!(cpu.poll_event(), Ok(Some(event(number))));
    }
    assert_eq!(cpu.monitor().events_lost(), 6);
}

#[test]
fn an_event_keeps_its_parts() {
    use EventKind::*;
    let (segment, mut cpu, mut cp) = both_ends(16);
    for kind in [ProcessInterrupt, DiagnosticIncoming, DiagnosticOutgoing, Removed, Inserted, Message] {
        for len in 0..=16 {
            let data: Vec<u8> = (1..=len).collect();
            let event = Event::new(u64::MAX, kind, 0xdead_beef, &data);
            assert_eq!(event.data(), data);
            assert!(cp.emit_event(event));
            assert_eq!(cpu.poll_event(), Ok(Some(event)));
        }
    }
    assert_eq!(Event::new(0, Message, 0, &[9; 20]).data(), [9; 16], "what is longer is cut");
    // As written by a foreign driver: kind 6, two bytes of data, code 7, and noise after the data.
    let slot = at("events.slots") + segment.peek(at("events.produced")).unwrap() as usize % 64 * 32;
    let bytes = u64::from_ne_bytes([1, 2, 3, 4, 5, 6, 7, 8]);
    for (offset, word) in [(0, 1234), (8, 7 << 32 | 2 << 16 | 6), (16, bytes), (24, u64::MAX)] {
        segment.poke(slot + offset, word);
    }
    segment.poke(at("events.produced"), segment.peek(at("events.produced")).unwrap() + 1);
    assert_eq!(cpu.poll_event(), Ok(Some(Event::new(1234, Message, 7, &[1, 2]))));
}

#[test]
fn events_without_meaning_are_faults_and_the_next_one_still_comes() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    for head in [0, 7, 0xffff, 17 << 16 | 1, 255 << 16 | 6] {
        let slot = at("events.slots") + segment.peek(at("events.produced")).unwrap() as usize % 64 * 32;
        assert!(cp.emit_event(Event::new(1, EventKind::Removed, 0, &[])));
        segment.poke(slot + 8, head);
        assert!(cp.emit_event(Event::new(2, EventKind::Inserted, 0, &[])));
        assert_eq!(cpu.poll_event(), Err(Fault::Event(head)));
        assert_eq!(cpu.poll_event().map(|event| event.map(|event| event.kind)), Ok(Some(EventKind::Inserted)));
    }
    for produced in [75, u64::MAX, 1 << 32] {
        segment.poke(at("events.produced"), produced);
        let consumed = segment.peek(at("events.consumed")).unwrap();
        assert_eq!(cpu.poll_event(), Err(Fault::EventRing { produced, consumed }));
        assert_eq!(cpu.poll_event(), Ok(None), "what was in it is dropped");
    }
    segment.poke(at("events.consumed"), 1 << 40);
    assert!(!cp.emit_event(Event::new(3, EventKind::Message, 0, &[])), "a consumer gone mad is a full ring");
}

#[test]
fn states_lamps_and_lines_are_seen_on_the_other_side() {
    let (segment, mut cpu, mut cp) = both_ends(16);
    assert_eq!(cpu.monitor().driver_state(), Ok(DriverState::Starting));
    assert_eq!(cp.cpu_state(), Ok(CpuState::Stop));
    cp.set_state(DriverState::LineError(2));
    cp.set_leds(Leds { power: true, error: true, ..Leds::default() });
    cp.set_modem_inputs(ModemInputs { cts: true, ..ModemInputs::default() });
    cpu.set_cpu_state(CpuState::Run);
    cpu.set_modem_outputs(ModemOutputs { drive_dtr: true, dtr: true, ..ModemOutputs::default() });
    let monitor = cpu.monitor().clone();
    assert_eq!(monitor.driver_state(), Ok(DriverState::LineError(2)));
    assert_eq!(monitor.leds(), Leds { power: true, error: true, ..Leds::default() });
    assert_eq!(monitor.modem_inputs(), ModemInputs { cts: true, ..ModemInputs::default() });
    assert_eq!(cp.cpu_state(), Ok(CpuState::Run));
    assert_eq!(cp.modem_outputs(), ModemOutputs { drive_dtr: true, dtr: true, ..ModemOutputs::default() });
    let (cp_before, cpu_before) = (monitor.cp_heartbeat(), cp.cpu_heartbeat());
    cp.beat();
    cpu.beat();
    assert_ne!(monitor.cp_heartbeat(), cp_before);
    assert_ne!(cp.cpu_heartbeat(), cpu_before);
    assert_eq!(monitor.cpu_heartbeat(), cp.cpu_heartbeat());
    segment.poke(at("cp.state"), 99);
    segment.poke(at("cpu.state"), 99);
    assert_eq!(monitor.driver_state(), Err(Fault::DriverState(99)));
    assert_eq!(cp.cpu_state(), Err(Fault::CpuState(99)));
}

#[test]
fn counters_lie_where_the_document_says() {
    let (segment, cpu, mut cp) = both_ends(16);
    for (index, counter) in Counter::ALL.iter().enumerate() {
        let before = cpu.monitor().counters().get(*counter);
        cp.count(*counter, 3 + index as u64);
        assert_eq!(cpu.monitor().counters().get(*counter), before + 3 + index as u64);
        assert_eq!(segment.peek(at("counters") + 8 * index), Some(before + 3 + index as u64), "{}", counter.name());
    }
    assert_eq!(cp.counters(), cpu.monitor().counters());
}

#[test]
fn a_segment_with_a_wrong_header_is_refused_by_name() {
    let fields = layout::FIELDS.iter().filter(|field| field.name.starts_with("header."));
    for field in fields {
        let (segment, _cpu, _cp) = both_ends(16);
        segment.poke(field.offset, 77);
        let refused = crate::CpSide::attach(&segment).err();
        let named = matches!(refused, Some(SegmentError::Header { field: name, found: 77 }) if name == field.name);
        assert!(named, "{}: {refused:?}", field.name);
    }
    assert!(crate::CpSide::attach(&Segment::heap()).is_err(), "an empty segment has no version yet");
}
