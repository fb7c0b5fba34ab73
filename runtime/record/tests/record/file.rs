use ob1_cpu::{Flags, ObRun};
use ob1_model::OperatingState;
use ob1_record::{Entry, Event, FormatError, Head, MAGIC, Reader, Row, Scan, Signal, Writer};
use ob1_time::{Instant, Span};
use proptest::prelude::*;

fn signal(at: usize) -> Signal {
    Signal { name: format!("s{at}"), address: format!("MD{}", 4 * at), ty: "DINT".into() }
}

fn head(signals: usize) -> Head {
    Head { station: "press".into(), signals: (0..signals).map(signal).collect(), ..Head::default() }
}

prop_compose! {
    fn scan()(
        times in any::<[u64; 7]>(), numbers in any::<[u64; 3]>(), flags in any::<[bool; 4]>()
    ) -> Scan {
        let [began_late, took_long, overran, watchdog] = flags;
        let span = Span::from_nanos;
        Scan {
            number: numbers[0], statements: numbers[1], missed: numbers[2], start: Instant::from_nanos(times[0]),
            lateness: span(times[1]), execution: span(times[2]), inputs: span(times[3]), program: span(times[4]),
            plugins: span(times[5]), outputs: span(times[6]), flags: Flags { began_late, took_long, overran, watchdog },
        }
    }
}

fn entry(signals: usize) -> impl Strategy<Value = Entry> {
    let words = any::<[u64; 4]>();
    let row = (words, scan(), 0..4_u64, prop::collection::vec(any::<u64>(), signals)).prop_map(
        |([point, time, lost, lost_runs], scan, state, values)| {
            let (time, state) = (Instant::from_nanos(time), OperatingState::of(state));
            Entry::Row(Row { point, time, state, lost, lost_runs, scan, values })
        },
    );
    let run = (any::<u16>(), any::<[u64; 3]>()).prop_map(|(ob, [began, whole, own])| {
        let (whole, own) = (Span::from_nanos(whole), Span::from_nanos(own));
        Entry::Run(ObRun { ob, began: Instant::from_nanos(began), whole, own })
    });
    let event = (any::<u64>(), ".{0,20}")
        .prop_map(|(time_ns, text)| Entry::Event(Event::Diagnosis { time_ns, number: "4562h".into(), text }));
    let line =
        (any::<u8>(), prop::collection::vec(any::<u8>(), 0..40)).prop_map(|(tap, bytes)| Entry::Line(tap, bytes));
    prop_oneof![4 => row, 2 => run, 1 => event, 1 => line]
}

/// The file of these entries, with a block after each of `flush`; and how many entries each length of it holds whole.
fn written(signals: usize, entries: &[Entry], flush: &[bool]) -> (Vec<u8>, Vec<(usize, usize)>) {
    let (mut out, mut writer) = (Writer::begin(&head(signals)), Writer::default());
    let mut whole = vec![(out.len(), 0)];
    let mut runs_wait = false;
    for (at, entry) in entries.iter().enumerate() {
        match entry {
            Entry::Row(row) => {
                // Rows come before runs in a block.
                if std::mem::take(&mut runs_wait) {
                    writer.take(&mut out);
                    whole.push((out.len(), at));
                }
                writer.row(row);
            }
            Entry::Run(run) => {
                writer.run(run);
                runs_wait = true;
            }
            Entry::Event(event) => {
                writer.event(event.clone(), &mut out);
                runs_wait = false;
            }
            Entry::Line(tap, bytes) => {
                writer.take(&mut out);
                runs_wait = false;
                Writer::line(*tap, bytes, &mut out);
            }
        }
        if flush.get(at).copied().unwrap_or(false) {
            writer.take(&mut out);
            runs_wait = false;
        }
        if writer.waiting() == 0 {
            whole.push((out.len(), at + 1));
        }
    }
    writer.take(&mut out);
    whole.push((out.len(), entries.len()));
    (out, whole)
}

fn read(bytes: &[u8]) -> Result<(Vec<Entry>, bool, u64), FormatError> {
    let mut reader = Reader::new(bytes)?;
    let mut entries = Vec::new();
    while let Some(entry) = reader.next_entry()? {
        entries.push(entry);
    }
    Ok((entries, reader.is_cut(), reader.whole_bytes()))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    /// Cut at every byte, a file gives everything up to its last whole block, and nothing else.
    #[test]
    fn what_is_written_comes_back_up_to_any_cut(
        (signals, entries, flush) in (0..10_usize).prop_flat_map(|signals| (
            Just(signals), prop::collection::vec(entry(signals), 0..30), prop::collection::vec(any::<bool>(), 30)
        ))
    ) {
        let (file, whole) = written(signals, &entries, &flush);
        for length in 0..=file.len() {
            let Some((_, sure)) = whole.iter().rev().find(|(bytes, _)| *bytes <= length) else {
                prop_assert!(read(&file[..length]).is_err(), "a head cut at {length}");
                continue;
            };
            let (found, cut, bytes) = read(&file[..length]).expect("a recording");
            prop_assert!(found.len() >= *sure, "{} of {sure} at {length}", found.len());
            prop_assert_eq!(&found[..], &entries[..found.len()]);
            prop_assert_eq!(cut, bytes < length as u64);
        }
        prop_assert_eq!(read(&file).expect("whole").0, entries);
    }

    /// Noise never panics, and costs no memory.
    #[test]
    fn noise_is_refused(noise in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = read(&noise);
        let _ = read(&[&MAGIC[..], &noise].concat());
        let _ = read(&[&Writer::begin(&head(3))[..], &noise].concat());
    }
}

#[test]
fn a_changed_bit_is_noticed() {
    let row = |point| Entry::Row(Row { point, values: vec![point, 7], ..Row::default() });
    let (file, whole) = written(2, &(1..=6).map(row).collect::<Vec<_>>(), &[false, true, false, true]);
    let begin = whole[0].0;
    for bit in begin * 8..file.len() * 8 {
        let mut changed = file.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        let mut reader = Reader::new(&changed[..]).expect("its head is whole");
        let mut found = 0;
        let end = loop {
            match reader.next_entry() {
                Ok(Some(entry)) => {
                    found += 1;
                    assert_eq!(entry, row(found));
                }
                other => break other,
            }
        };
        // A length that says too much looks like a cut.
        assert!(end.is_err() || reader.is_cut(), "bit {bit}: {end:?}");
        assert!(found < 6, "bit {bit}");
    }
    let mut newer = file;
    newer[6] = 2;
    assert!(matches!(Reader::new(&newer[..]), Err(FormatError::Version(2))));
    assert!(matches!(Reader::new(&b"OB1TRACE\x01\0"[..]), Err(FormatError::Foreign)));
}
