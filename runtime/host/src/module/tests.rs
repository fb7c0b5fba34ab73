//! The module over a heap segment, with the driver's end in the test's hand.

use ob1_backplane::{CpSide, EventKind, Segment};
use ob1_model::Event;
use ob1_time::{Instant, Span};

use super::*;
use crate::supervisor::{Exit, Report};

fn module_with(link: Box<dyn DriverLink>, settings: CpSettings) -> (CpModule, Segment) {
    let segment = Segment::heap();
    let side = CpuSide::create(&segment, 16).expect("16 bytes are allowed");
    (CpModule::new(side, link, settings).expect("the JSON fits"), segment)
}

fn module() -> (CpModule, Segment) {
    module_with(Box::new(AlwaysThere), CpSettings::default())
}

fn driver(segment: &Segment) -> CpSide {
    let mut cp = CpSide::attach(segment).expect("a fresh segment");
    cp.set_state(DriverState::Ready);
    cp
}

fn read<const N: usize>(module: &mut CpModule, at: u16) -> [u8; N] {
    let mut bytes = [0xEE; N];
    module.read(at, &mut bytes).expect("inside, and absent is no fault");
    bytes
}

#[test]
fn registers_are_live_and_blocks_merge_their_outputs() {
    let (mut module, segment) = module();
    let mut cp = driver(&segment);
    cp.write_inputs(&[0, 18, 0, 30]);
    assert_eq!(read::<4>(&mut module, 0), [0, 18, 0, 30]);
    cp.write_inputs(&[0, 6]);
    assert_eq!(read::<2>(&mut module, 0), [0, 6], "without a new scan");
    assert_eq!(read::<1>(&mut module, 3), [30]);

    module.write(2, &[0, 30, 1, 2, 3]).expect("inside");
    module.write(0, &[0, 18]).expect("inside");
    let mut outputs = [0; 16];
    let _ = cp.read_outputs(&mut outputs);
    assert_eq!(outputs[..8], [0, 18, 0, 30, 1, 2, 3, 0]);
}

#[test]
fn accesses_outside_are_refused() {
    let (mut module, _segment) = module();
    assert_eq!(module.read(15, &mut [0; 2]), Err(ModuleError::Outside));
    assert_eq!(module.read(u16::MAX, &mut [0; 64]), Err(ModuleError::Outside));
    assert_eq!(module.write(14, &[0; 3]), Err(ModuleError::Outside));
    assert_eq!((module.input_bytes(), module.output_bytes()), (16, 16));
}

#[test]
fn an_absent_driver_reads_0_or_is_a_fault() {
    let (mut quiet, segment) = module();
    assert_eq!(read::<2>(&mut quiet, 0), [0, 0]);
    let mut cp = driver(&segment);
    cp.write_inputs(&[7; 16]);
    assert!(quiet.status().present);
    assert_eq!(read::<2>(&mut quiet, 0), [7, 7]);
    cp.set_state(DriverState::Starting);
    assert!(!quiet.status().present, "it has not shown its registers yet");
    assert_eq!(read::<2>(&mut quiet, 0), [0, 0]);

    let (mut strict, _segment) =
        module_with(Box::new(AlwaysThere), CpSettings { absent_is_fault: true, ..CpSettings::default() });
    assert_eq!(strict.read(0, &mut [0; 2]), Err(ModuleError::Absent));
    assert_eq!(strict.write(0, &[1, 2]), Err(ModuleError::Absent));
}

#[test]
fn each_restart_is_another_generation() {
    let (module, segment) = module();
    assert_eq!(module.status(), ModuleStatus::default());
    let cp = driver(&segment);
    let first = module.status();
    assert!(first.present);
    drop(cp);
    module.side.monitor().driver_gone();
    assert!(!module.status().present);
    let _cp = driver(&segment);
    assert!(module.status().present);
    assert_ne!(module.status().generation, first.generation);
}

#[test]
fn run_sends_the_parameters_again() {
    let settings = CpSettings { parameters: [3; 16], json: b"{}".to_vec(), ..CpSettings::default() };
    let (mut module, segment) = module_with(Box::new(AlwaysThere), settings);
    let mut cp = driver(&segment);
    let mut revisions = Vec::new();
    for _ in 0..2 {
        module.cpu_state(false);
        module.cpu_state(true);
        assert_eq!(cp.cpu_state(), Ok(CpuState::Run));
        let params = cp.read_params().expect("a whole record");
        assert_eq!((params.bytes, params.json), ([3; 16], &b"{}"[..]));
        revisions.push(params.revision);
    }
    assert_ne!(revisions[0], revisions[1]);
    module.cpu_state(false);
    assert_eq!(cp.cpu_state(), Ok(CpuState::Stop));
}

#[test]
fn a_configuration_that_does_not_fit_is_refused() {
    let side = CpuSide::create(&Segment::heap(), 16).expect("16 bytes are allowed");
    let settings = CpSettings { json: vec![b' '; 5000], ..CpSettings::default() };
    assert!(CpModule::new(side, Box::new(AlwaysThere), settings).is_err());
}

/// A link that records rings and has reports to give.
struct Recorder {
    rings: std::sync::Arc<std::sync::atomic::AtomicU32>,
    reports: Vec<Report>,
    /// Attempts and incidents.
    life: std::sync::Arc<[std::sync::atomic::AtomicU32; 2]>,
}

impl DriverLink for Recorder {
    fn ring(&mut self) {
        self.rings.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    }
    fn is_running(&self) -> bool {
        true
    }
    fn next_report(&mut self) -> Option<Report> {
        self.reports.pop()
    }
    fn life(&self) -> Life {
        let [attempts, incidents] = [0, 1].map(|index| self.life[index].load(std::sync::atomic::Ordering::Relaxed));
        Life { attempts, incidents }
    }
}

#[test]
fn the_doorbell_rings_once_for_a_driver_that_sleeps() {
    let rings = std::sync::Arc::<std::sync::atomic::AtomicU32>::default();
    let link = Recorder { rings: std::sync::Arc::clone(&rings), reports: Vec::new(), life: std::sync::Arc::default() };
    let (mut module, segment) = module_with(Box::new(link), CpSettings::default());
    let mut cp = driver(&segment);
    let count = || rings.load(std::sync::atomic::Ordering::Relaxed);
    module.write(0, &[1]).expect("inside");
    module.end_scan(Instant::START);
    assert_eq!(count(), 0, "the driver is awake");
    assert!(cp.prepare_sleep(cp.changes()));
    module.end_scan(Instant::START);
    assert_eq!(count(), 0, "nothing has changed");
    module.write(0, &[2]).expect("inside");
    module.write(2, &[3]).expect("inside");
    module.end_scan(Instant::START);
    module.end_scan(Instant::START);
    assert_eq!(count(), 1);
}

#[test]
fn reports_and_messages_become_entries() {
    let rings = std::sync::Arc::default();
    let reports = vec![Report::HeldUp(Span::from_millis(4_230)), Report::Up(2), Report::Lost(Exit::Signal(9))];
    let link = Recorder { rings, reports, life: std::sync::Arc::default() };
    let settings = CpSettings { diagnostics: true, ..CpSettings::default() };
    let (mut module, segment) = module_with(Box::new(link), settings);
    let mut cp = driver(&segment);
    for (code, data) in [
        (1, &[5, 0][..]),
        (4, &[0, 0, 0, 5]),
        (5, &[]),
        (5, &[]),
        (4, &[0, 0, 0, 99]),
        (5, &[]),
        (6, &[7]),
        (0x0701, &[]),
    ] {
        cp.emit_event(ob1_backplane::Event::new(0, EventKind::Message, code, data));
    }
    cp.emit_event(ob1_backplane::Event::new(0, EventKind::DiagnosticIncoming, 9, &[1, 2, 3, 4]));
    let entries: Vec<_> = std::iter::from_fn(|| module.poll_event())
        .map(|e| (e.event, e.diagnostic_interrupt, e.data[..usize::from(e.len)].to_vec()))
        .collect();
    assert_eq!(
        entries,
        [
            (Event::DRIVER_LOST, false, b"signal 9".to_vec()),
            (Event::DRIVER_UP, false, b"start 2".to_vec()),
            (Event::DRIVER_HELD_UP, false, b"4230 ms".to_vec()),
            (Event::CP_ERROR, false, b"line: unplugged".to_vec()),
            (Event::CP_ERROR_GONE, false, b"line up".to_vec()),
            (Event::CP_ERROR, false, b"line gone, os 99".to_vec()),
            (Event::CP_ERROR_GONE, false, b"line up".to_vec()),
            (Event::CP_ERROR, true, vec![1, 2, 3, 4]),
        ]
    );
}

#[test]
fn each_start_of_a_driver_finds_the_segment_whole() {
    let life = std::sync::Arc::<[std::sync::atomic::AtomicU32; 2]>::default();
    let link = Recorder {
        rings: std::sync::Arc::default(),
        reports: vec![Report::Lost(Exit::Hung)],
        life: std::sync::Arc::clone(&life),
    };
    let settings = CpSettings { parameters: [9; 16], ..CpSettings::default() };
    let (mut module, segment) = module_with(Box::new(link), settings);
    life[0].store(1, std::sync::atomic::Ordering::Relaxed);
    module.cpu_state(true);
    module.write(0, &[1, 2, 3]).expect("inside");
    assert_eq!(module.poll_event().map(|e| e.event), Some(Event::DRIVER_LOST));
    // Long after the last one has gone, and each time again: somebody writes noise into every field.
    for attempt in 2..5 {
        segment.scribble(|offset| offset as u64 ^ 0x5555_5555_5555_5555);
        assert!(CpSide::attach(&segment).is_err(), "no segment any more");
        module.side.monitor().restore_header();
        life[0].store(attempt, std::sync::atomic::Ordering::Relaxed);
        while module.poll_event().is_some() {}
        let mut cp = CpSide::attach(&segment).expect("the header is whole again");
        assert_eq!(cp.read_params().expect("the record too").bytes, [9; 16]);
        let mut outputs = [0; 4];
        assert_eq!(cp.read_outputs(&mut outputs), ob1_backplane::Freshness::Fresh);
        assert_eq!((outputs, cp.cpu_state()), ([1, 2, 3, 0], Ok(CpuState::Run)));
    }
}

#[test]
fn a_driver_that_is_started_during_a_scan_is_there_from_the_next_one_on() {
    let life = std::sync::Arc::<[std::sync::atomic::AtomicU32; 2]>::default();
    let link = Recorder { rings: std::sync::Arc::default(), reports: Vec::new(), life: std::sync::Arc::clone(&life) };
    let segment = Segment::heap_with_boxes();
    let side = CpuSide::create(&segment, 16).expect("16 bytes are allowed");
    let settings = CpSettings { boxes: true, ..CpSettings::default() };
    let mut module = CpModule::new(side, Box::new(link), settings).expect("the JSON fits");
    let record = ob1_words::boxes::record(0);
    let order = [7; ob1_words::boxes::HEAD_BYTES];
    let mut at_the_cp = [0; ob1_words::boxes::HEAD_BYTES];
    for attempt in 1..4 {
        life[0].store(attempt, std::sync::atomic::Ordering::Relaxed);
        let mut cp = driver(&segment);
        if attempt > 1 {
            assert!(!module.status().present, "attempt {attempt}");
            assert_eq!(module.record_write(record, &order), Err(ModuleError::Absent), "it would be wiped away");
            assert_eq!(read::<2>(&mut module, 0), [0, 0]);
        }
        // The cycle control point.
        while module.poll_event().is_some() {}
        assert!(module.status().present, "attempt {attempt}");
        assert_eq!(module.record_write(record, &order), Ok(()));
        while module.poll_event().is_some() {}
        let _ = cp.read_box(0, &mut at_the_cp);
        assert_eq!(at_the_cp, order, "attempt {attempt}");
    }
}

/// Everything that comes in so many scans of a millisecond.
fn entries_of(module: &mut CpModule, scans: u64, mut each: impl FnMut(u64)) -> Vec<ModuleEvent> {
    let mut entries = Vec::new();
    for scan in 0..scans {
        each(scan);
        module.begin_scan(Instant::from_millis(scan));
        entries.extend((0..8).map_while(|_| module.poll_event()));
        module.end_scan(Instant::from_millis(scan));
    }
    entries
}

#[test]
fn a_driver_raises_no_interrupt_that_its_parameters_do_not_allow() {
    for (diagnostics, interrupts) in [(false, 0), (true, 2)] {
        let settings = CpSettings { diagnostics, ..CpSettings::default() };
        let (mut module, segment) = module_with(Box::new(AlwaysThere), settings);
        let mut cp = driver(&segment);
        for kind in [EventKind::DiagnosticIncoming, EventKind::DiagnosticOutgoing] {
            cp.emit_event(ob1_backplane::Event::new(0, kind, 0, &[0x25, 0x0C, 2, 0]));
        }
        let entries = entries_of(&mut module, 3, |_| ());
        assert_eq!(entries.iter().filter(|e| e.diagnostic_interrupt).count(), interrupts);
        let garbage: Vec<_> = entries.iter().filter(|e| e.event == Event::SEGMENT_GARBAGE).collect();
        assert_eq!(garbage.len(), usize::from(!diagnostics), "said once");
        assert!(garbage.iter().all(|e| e.data.starts_with(b"interrupt off")), "{garbage:?}");
    }
}

#[test]
fn interrupts_and_a_line_that_flaps_have_their_limits_and_the_last_word_is_told() {
    let settings = CpSettings { diagnostics: true, ..CpSettings::default() };
    let (mut module, segment) = module_with(Box::new(AlwaysThere), settings);
    let mut cp = driver(&segment);
    let entries = entries_of(&mut module, 1000, |_| {
        while cp.emit_event(ob1_backplane::Event::new(0, EventKind::DiagnosticIncoming, 0, &[1])) {}
    });
    let (lost, entries): (Vec<_>, Vec<_>) = entries.into_iter().partition(|e| e.event == Event::CP_EVENTS_LOST);
    assert_eq!(lost.len(), 1, "said once in a second");
    assert!((64..=75).contains(&entries.len()), "64, and 10 more in a second: {}", entries.len());
    assert!(entries.iter().all(|e| e.diagnostic_interrupt));

    let (mut module, segment) = self::module();
    let mut cp = driver(&segment);
    let entries = entries_of(&mut module, 12_000, |scan| {
        let code = if scan < 11_000 { 4 + (scan % 2) as u32 } else { 5 };
        if scan <= 11_000 {
            cp.emit_event(ob1_backplane::Event::new(0, EventKind::Message, code, &[0, 0, 0, 5]));
        }
    });
    assert!((16..=18).contains(&entries.len()), "16, and one more in 10 s: {}", entries.len());
    let late = entries_of(&mut module, 40_000, |_| ());
    let last = late.last().or(entries.last()).map(|e| e.event);
    assert_eq!(last, Some(Event::CP_ERROR_GONE), "the line is up, and the buffer says so");
}

#[test]
fn a_line_that_echoes_is_entered_once_and_its_end_too() {
    let (mut module, segment) = module();
    let mut cp = driver(&segment);
    let entries = entries_of(&mut module, 10, |scan| {
        if matches!(scan, 1 | 5) {
            cp.emit_event(ob1_backplane::Event::new(0, EventKind::Message, 9, &[u8::from(scan == 1)]));
        }
    });
    let told: Vec<_> = entries.iter().map(|e| (e.event, &e.data[..usize::from(e.len)])).collect();
    assert_eq!(told, [(Event::CP_ERROR, &b"line: local echo"[..]), (Event::CP_ERROR_GONE, b"line: local echo")]);
}

#[test]
fn events_that_a_full_ring_loses_are_entered_when_that_begins_and_then_from_time_to_time() {
    let (mut module, segment) = module();
    let mut cp = driver(&segment);
    assert_eq!(entries_of(&mut module, 3, |_| ()).len(), 0);
    // One more than there is room for in each scan of 15 s.
    let entries = entries_of(&mut module, 40_000, |scan| {
        while scan < 15_000 && cp.emit_event(ob1_backplane::Event::new(0, EventKind::Message, 99, &[])) {}
    });
    assert!(entries.iter().all(|e| e.event == Event::CP_EVENTS_LOST && !e.diagnostic_interrupt), "{entries:?}");
    let texts: Vec<_> = entries.iter().map(|e| String::from_utf8_lossy(&e.data[..usize::from(e.len)])).collect();
    assert_eq!(texts, ["1 lost", "10001 lost", "15000 lost"], "the last word is told");
}

#[test]
fn garbage_is_entered_once_in_an_incident_whatever_number_the_driver_gives_itself() {
    let life = std::sync::Arc::<[std::sync::atomic::AtomicU32; 2]>::default();
    let link = Recorder { rings: std::sync::Arc::default(), reports: Vec::new(), life: std::sync::Arc::clone(&life) };
    let (mut module, segment) = module_with(Box::new(link), CpSettings::default());
    let generation = ob1_backplane::layout::FIELDS.iter().find(|f| f.name == "cp.generation").expect("there").offset;
    let entries = |module: &mut CpModule| {
        module.side.monitor().restore_header();
        let mut cp = driver(&segment);
        entries_of(module, 5000, |scan| {
            segment.poke(generation, scan + 7);
            for kind in [EventKind::Message, EventKind::DiagnosticIncoming] {
                cp.emit_event(ob1_backplane::Event::new(0, kind, 8, &[]));
            }
            segment
                .scribble(|offset| if offset % 64 == 16 { scan | 1 << 40 } else { segment.peek(offset).unwrap_or(0) });
        })
        .iter()
        .filter(|e| e.event == Event::SEGMENT_GARBAGE)
        .count()
    };
    let first = entries(&mut module);
    assert!((2..=8).contains(&first), "{first} entries of at most 8 kinds");
    let second = entries(&mut module);
    assert!(first + second <= 8, "the same incident: {second} more");
    life[1].store(1, std::sync::atomic::Ordering::Relaxed);
    assert!((2..=8).contains(&entries(&mut module)), "another incident");
}

#[test]
fn noise_is_entered_once_and_never_a_panic() {
    let (mut module, segment) =
        module_with(Box::new(AlwaysThere), CpSettings { channels: true, ..CpSettings::default() });
    let mut noise = 0x9E37_79B9_7F4A_7C15_u64;
    let mut entries = 0;
    for _ in 0..200 {
        segment.scribble(|_| {
            noise = noise.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            noise
        });
        // The same driver all the time.
        segment.poke(0x200, 77);
        module.begin_scan(Instant::START);
        let _ = module.read(0, &mut [0; 16]);
        let _ = module.write(0, &[1; 16]);
        let _ = module.record_read(0, &mut [0; 240]);
        assert!(module.diagnostic_buffer(&mut |_| {}));
        let _ = module.status();
        while let Some(event) = module.poll_event() {
            entries += u32::from(event.event == Event::SEGMENT_GARBAGE);
        }
        module.end_scan(Instant::START);
    }
    assert!((1..=8).contains(&entries), "{entries} entries for one driver");
}

#[test]
fn records_have_their_limits() {
    let (mut module, segment) = module();
    assert_eq!(module.record_read(0, &mut [0; 4]), Err(ModuleError::Absent));
    let mut cp = driver(&segment);
    assert_eq!(module.record_read(1, &mut [0; 4]), Err(ModuleError::NoRecord));
    cp.write_diagnosis(1, &[1, 2, 3]).expect("short");
    let mut into = [0; 2];
    assert_eq!((module.record_read(1, &mut into), into), (Ok(2), [1, 2]));
    let mut four = [9; 8];
    assert_eq!(
        (module.record_read(0, &mut four), four[3]),
        (Ok(3), 9),
        "record 0 begins record 1, as far as there is one"
    );
    cp.write_diagnosis(1, &[0x25, 0x0C, 2, 0, 7, 7]).expect("short");
    assert_eq!((module.record_read(0, &mut four), four), (Ok(4), [0x25, 0x0C, 2, 0, 9, 9, 9, 9]));
    cp.write_diagnosis(240, b"a text").expect("short");
    assert_eq!(module.record_read(0, &mut four), Err(ModuleError::NoRecord));
    assert_eq!(module.record_read(1, &mut four), Err(ModuleError::NoRecord));
    for record in [0, 1, 59, 240] {
        assert_eq!(module.record_write(record, &[4, 5]), Err(ModuleError::NoRecord), "no CP takes record {record}");
    }
    for offset in (0x780..0x900).step_by(8) {
        assert_eq!(segment.peek(offset), Some(0), "{offset:#x} is reserved");
    }
}

#[test]
fn the_diagnostic_buffer_has_the_time_of_the_cpu_and_outlives_its_driver() {
    let (mut module, segment) =
        module_with(Box::new(AlwaysThere), CpSettings { channels: true, ..CpSettings::default() });
    let mut cp = driver(&segment);
    module.end_scan(Instant::from_millis(2_500));
    cp.enter(0x0703, true);
    drop(cp);
    module.side.monitor().driver_gone();
    module.side.restore();
    module.end_scan(Instant::from_secs(7));
    let mut cp = driver(&segment);
    cp.enter(0x080D, false);
    let mut entries = Vec::new();
    assert!(module.diagnostic_buffer(&mut |entry| entries.push((entry.number, entry.incoming, entry.time))));
    assert_eq!(entries, [(0x080D, false, Instant::from_secs(7)), (0x0703, true, Instant::from_millis(2_500))]);
    let (mut other, _segment) = self::module();
    assert!(!other.diagnostic_buffer(&mut |_| {}), "a CP 240 has none");
}

/// "DS: record set for access via CPU" [S3 L341]; 00h and 02h "may only be transferred at STOP state" [S3 L375].
#[test]
fn a_program_writes_the_parameters_of_a_cp_040() {
    let settings = CpSettings { takes_parameters: true, parameters: [3; 16], ..CpSettings::default() };
    let (mut module, segment) = module_with(Box::new(AlwaysThere), settings);
    let mut cp = driver(&segment);
    module.cpu_state(true);
    let mut bytes = || cp.read_params().expect("they are whole").bytes;
    assert_eq!(bytes(), [3; 16]);
    for (record, len, answer) in [
        (0x80, 15, Err(ModuleError::Outside)),
        (0x80, 17, Err(ModuleError::Outside)),
        (0x02, 2, Err(ModuleError::NoRecord)),
        (0x00, 1, Err(ModuleError::NoRecord)),
        (0x81, 16, Err(ModuleError::NoRecord)),
    ] {
        assert_eq!(module.record_write(record, &[7; 17][..len]), answer, "{record:02X}h, {len} bytes");
        assert_eq!(bytes(), [3; 16]);
    }
    assert_eq!((module.is_of_blocks(0x80), module.record_write(0x80, &[7; 16])), (false, Ok(())));
    assert_eq!(bytes(), [7; 16]);
    module.cpu_state(true);
    assert_eq!(bytes(), [3; 16], "a start-up brings the parameters of the station file");
}

#[test]
fn records_of_handling_blocks_are_theirs() {
    let settings = [
        CpSettings { channels: true, ..CpSettings::default() },
        CpSettings { boxes: true, ..CpSettings::default() },
        CpSettings::default(),
    ];
    let modules = settings.map(|settings| module_with(Box::new(AlwaysThere), settings).0);
    assert_eq!(modules.map(|module| module.is_of_blocks(0x80)), [true, true, false]);
}
