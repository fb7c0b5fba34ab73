//! Noise in every field: every method of both ends returns, without a panic and with valid values.

use super::{Noise, at, both_ends};
use crate::{
    Channel, Counter, CpSide, CpuSide, CpuState, DriverState, Event, EventKind, Freshness, Leds, ModemInputs,
    ModemOutputs, Segment, layout,
};

const SEEDS: u64 = if cfg!(miri) { 2 } else { 300 };

/// Values at the limits of the valid range, and random values.
fn nasty(noise: &mut Noise) -> u64 {
    let number = noise.next();
    match number % 6 {
        0 => number >> 8 & 3,
        1 => number >> 8 & 0x1ff,
        2 => u64::MAX - (number >> 8 & 3),
        3 => 1 << (number >> 8 & 63),
        4 => (number >> 8 & 0xff) << 16 | (number >> 16 & 7),
        _ => number,
    }
}

fn use_all_of_the_cpu_side(cpu: &mut CpuSide) {
    let mut registers = [0; 64];
    for index in [0, layout::BOXES - 1, layout::BOXES] {
        let _ = cpu.read_box(index, &mut registers);
        cpu.write_box(index, &registers);
    }
    let _ = cpu.write_outputs(&[7; 64]) | cpu.write_outputs(&[8; 3]);
    assert!(matches!(cpu.read_inputs(&mut registers), Freshness::Fresh | Freshness::Stale));
    cpu.write_params(&[1; 16], b"{}").unwrap();
    if let Ok(record) = cpu.read_diagnosis() {
        assert!(record.data().len() <= layout::RECORD_BYTES);
    }
    // A fault in the ring empties it, so the polls end.
    let mut polls = 0;
    while !matches!(cpu.poll_event(), Ok(None)) {
        polls += 1;
        assert!(polls <= layout::EVENT_SLOTS + 1, "the ring never ends");
    }
    for channel in Channel::ALL {
        let _ = (cpu.read_channel(channel, &mut registers), cpu.write_channel(channel, &[3; 64]));
    }
    cpu.set_cpu_state(CpuState::Run);
    cpu.set_modem_outputs(ModemOutputs { rts: true, ..ModemOutputs::default() });
    cpu.beat();
    cpu.set_time(u64::MAX);
    cpu.restore();
    let _ = cpu.take_doorbell();
    let monitor = cpu.monitor();
    let _ = (monitor.driver_state(), monitor.generation(), monitor.cp_heartbeat(), monitor.cpu_heartbeat());
    let _ = (monitor.leds(), monitor.modem_inputs(), monitor.events_lost(), monitor.driver_sleeps());
    assert!(monitor.buffer().count() <= layout::BUFFER_ENTRIES);
    let counters = monitor.counters();
    let _ = (counters.open_orders(), counters.open_receives(), cpu.io_bytes());
}

fn use_all_of_the_cp_side(cp: &mut CpSide) {
    let mut registers = [0; 64];
    for index in [0, layout::BOXES - 1, layout::BOXES] {
        let _ = (cp.box_changed(index), cp.read_box(index, &mut registers));
        cp.write_box(index, &registers);
    }
    assert!(matches!(cp.read_outputs(&mut registers), Freshness::Fresh | Freshness::Stale));
    let _ = cp.write_inputs(&[5; 64]) | cp.write_inputs(&[6; 5]) | cp.outputs_changed();
    if let Ok(params) = cp.read_params() {
        assert!(params.json.len() <= layout::JSON_BYTES);
    }
    cp.write_diagnosis(1, &[1; 240]).unwrap();
    for number in 0..3 {
        let _ = cp.emit_event(Event::new(number, EventKind::Message, 0, &[1; 16]));
        cp.enter(0x0703, number == 0);
    }
    for channel in Channel::ALL {
        let _ = (cp.read_channel(channel, &mut registers), cp.write_channel(channel, &[4; 64]));
        let _ = cp.channel_changed(channel);
    }
    let _ = (cp.cpu_state(), cp.modem_outputs(), cp.cpu_heartbeat());
    for counter in Counter::ALL {
        cp.count(*counter, u64::MAX);
    }
    cp.set_state(DriverState::Ready);
    cp.set_leds(Leds::default());
    cp.set_modem_inputs(ModemInputs::default());
    cp.beat();
    let _ = cp.prepare_sleep(cp.changes());
    cp.awake();
    let _ = (cp.counters(), cp.params_changed(), cp.generation(), cp.io_bytes());
}

#[test]
fn noise_in_every_field_is_survived_by_both_ends() {
    for seed in 0..SEEDS {
        let mut noise = Noise(seed);
        let segment = if seed % 2 == 0 { Segment::heap() } else { Segment::heap_with_boxes() };
        let mut cpu = CpuSide::create(&segment, 8 + (seed as usize) % 57).unwrap();
        let mut cp = CpSide::attach(&segment).unwrap();
        for round in 0..4 {
            if round % 2 == 0 {
                segment.scribble(|_| nasty(&mut noise));
            } else {
                segment.scribble(|_| noise.next());
            }
            use_all_of_the_cpu_side(&mut cpu);
            use_all_of_the_cp_side(&mut cp);
            cpu.monitor().driver_gone();
        }
    }
}

#[test]
fn noise_is_never_taken_for_a_segment() {
    for seed in 0..SEEDS {
        let mut noise = Noise(seed ^ 0xabcd);
        let segment = Segment::heap();
        segment.scribble(|_| nasty(&mut noise));
        assert!(CpSide::attach(&segment).is_err());
    }
}

#[test]
fn a_restored_segment_works_for_the_next_driver_whatever_the_last_one_did() {
    for seed in 0..SEEDS {
        let mut noise = Noise(seed ^ 0x1234);
        let (segment, mut cpu, _) = both_ends(16);
        cpu.set_cpu_state(CpuState::Run);
        cpu.write_outputs(&seed.to_le_bytes().repeat(2));
        cpu.write_channel(Channel::Send, &[seed as u8; 64]);
        segment.scribble(|_| nasty(&mut noise));
        cpu.monitor().driver_gone();
        cpu.restore();
        cpu.write_params(&[9; 16], b"[]").unwrap();
        let mut cp = CpSide::attach(&segment).unwrap();
        // Events that the last driver has completed, or seems to have, come first.
        while cpu.poll_event() != Ok(None) {}
        let mut registers = [0; 16];
        assert_eq!(cp.read_outputs(&mut registers), Freshness::Fresh);
        assert_eq!(registers[..8], seed.to_le_bytes());
        assert_eq!(cp.cpu_state(), Ok(CpuState::Run));
        assert_eq!(cp.modem_outputs(), ModemOutputs::default());
        assert_eq!(cp.read_params().unwrap().json, b"[]");
        cp.write_inputs(&[seed as u8 | 1; 16]);
        assert_eq!(cpu.read_inputs(&mut registers), Freshness::Fresh);
        assert_eq!(registers, [seed as u8 | 1; 16]);
        let event = Event::new(seed, EventKind::Message, 1, &[]);
        assert!(cp.emit_event(event));
        assert_eq!(cpu.poll_event(), Ok(Some(event)));
        let mut block = [0; 64];
        assert_eq!(
            (cpu.read_channel(Channel::Send, &mut block), block),
            (Freshness::Fresh, [0; 64]),
            "nothing of an earlier driver"
        );
        assert_eq!((cp.read_channel(Channel::Send, &mut block), block), (Freshness::Fresh, [seed as u8; 64]));
        assert!(cp.prepare_sleep(cp.changes()));
        cpu.set_cpu_state(CpuState::Stop);
        assert!(cpu.take_doorbell());
    }
}

#[test]
fn a_segment_made_anew_over_noise_is_like_new() {
    let segment = Segment::heap();
    let mut noise = Noise(1);
    segment.scribble(|_| noise.next());
    let cpu = CpuSide::create(&segment, 16).unwrap();
    for offset in (0..layout::SEGMENT_BYTES).step_by(8).filter(|offset| *offset >= at("outputs.sequence")) {
        let expected = if offset == at("channels.version") { layout::CHANNELS_VERSION } else { 0 };
        assert_eq!(segment.peek(offset), Some(expected), "{offset:#x}");
    }
    assert_eq!(cpu.monitor().generation(), 0);
    assert!(CpSide::attach(&segment).is_ok());
    assert_eq!((segment.peek(4), segment.peek(layout::SEGMENT_BYTES)), (None, None));
    assert!(!segment.poke(1, 0) && !segment.poke(usize::MAX - 7, 0));
}
