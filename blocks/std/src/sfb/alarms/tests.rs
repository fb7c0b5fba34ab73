use ob1_model::{ALARMS, AlarmChange, AlarmKind, AlarmTime, Displays};

use crate::tests::{Fake, any};

const KEYS: [&str; 5] = ["SYSTEM:SFB31", "SYSTEM:SFB33", "SYSTEM:SFB34", "SYSTEM:SFB35", "SYSTEM:SFB36"];

fn block(key: &str, id: u32) -> Fake {
    let mut fake = Fake::new(key).with("EV_ID", id.to_be_bytes());
    fake.station.alarms.set_displays(Displays(Displays::BLOCKS));
    fake
}

fn signal(fake: &mut Fake, value: u8) {
    fake.set(if fake.has("SIG") { "SIG" } else { "SIG_1" }, &[value]);
}

fn status(fake: &mut Fake) -> (u32, u32, u32) {
    fake.run();
    assert_eq!(fake.br, fake.value("ERROR") == 0);
    (fake.value("DONE"), fake.value("ERROR"), fake.value("STATUS"))
}

/// What the first call refuses; the next call is the first again.
#[test]
fn the_first_call() {
    for key in KEYS {
        let mut fake = block(key, 0);
        assert_eq!(status(&mut fake), (0, 1, 4), "{key}: EV_ID 0");
        fake.set("EV_ID", &7u32.to_be_bytes());
        let mut other = std::mem::take(&mut fake.station.alarms);
        other.register(AlarmKind::Alarm, 7, (99, 0)).expect("a place");
        fake.station.alarms = other;
        assert_eq!(status(&mut fake), (0, 1, 18), "{key}: another instance has it");
        for id in 0..ALARMS as u32 - 1 {
            fake.station.alarms.register(AlarmKind::Alarm, 1000 + id, (100, id)).expect("a place");
        }
        fake.set("EV_ID", &8u32.to_be_bytes());
        assert_eq!(status(&mut fake), (0, 1, 20), "{key}: no place");
        if key != "SYSTEM:SFB34" {
            fake.station.alarms.restart(true, AlarmTime::default());
            fake.set("SD_1", &[0x11; 10]);
            assert_eq!(status(&mut fake), (0, 1, 4), "{key}: no pointer");
        }
    }
}

/// EV_ID counts at the first call, and again after a restart.
#[test]
fn the_number_of_the_first_call() {
    let mut fake = block("SYSTEM:SFB35", 7);
    fake.run();
    fake.set("EV_ID", &8u32.to_be_bytes());
    fake.set("SIG_3", &[1]);
    assert_eq!(status(&mut fake), (0, 0, 25));
    let event = fake.station.alarms.next().copied().expect("a message");
    assert_eq!((event.state.id, event.state.signals, event.state.coming), (7, 4, 0xFB));
    assert_eq!(event.change, AlarmChange::Message { changed: 4, lost: false });
    fake.station.alarms.restart(false, AlarmTime::default());
    assert_eq!(status(&mut fake), (0, 0, 25), "the signals before count as 0");
    let ids: Vec<u32> = std::iter::from_fn(|| {
        let id = fake.station.alarms.next().map(|event| event.state.id);
        fake.station.alarms.sent();
        id
    })
    .collect();
    assert_eq!(ids, [0, 8], "all are deleted, then the new number");
    // An instance that was loaded again has its number back.
    let table = std::mem::take(&mut fake.station.alarms);
    let mut fake = block("SYSTEM:SFB35", 8);
    fake.station.alarms = table;
    fake.set("SIG_1", &[1]);
    assert_eq!(status(&mut fake), (0, 0, 25));
}

/// Values, and SEVERITY: the message is sent, STATUS 22 tells what is wrong.
#[test]
fn values_of_a_block() {
    for (pointers, severity, code, sent) in [
        (vec![any(4, 1, 10), any(8, 1, 12)], 64u16, 25, vec![(4, vec![1, 2]), (8, vec![3, 4, 5, 6])]),
        (vec![any(2, 32, 10)], 127, 25, vec![(2, (1..=32).collect())]),
        (vec![any(2, 100, 10), any(2, 61, 10)], 0, 22, vec![(2, (1..=100).collect::<Vec<u8>>())]),
        (vec![any(4, 1, 254), any(4, 1, 10)], 0, 25, vec![(4, vec![0, 0]), (4, vec![1, 2])]),
        (vec![any(4, 1, 255), any(4, 1, 10)], 0, 22, vec![(4, vec![1, 2])]),
        (vec![], 128, 22, vec![]),
    ] {
        let mut fake = block("SYSTEM:SFB31", 7).with("SEVERITY", severity.to_be_bytes());
        fake.memory(10, &(1..=160).collect::<Vec<u8>>());
        for (index, pointer) in pointers.iter().enumerate() {
            fake.set(&format!("SD_{}", index + 1), pointer);
        }
        assert_eq!(status(&mut fake), (0, 0, code), "{pointers:02X?}");
        let event = fake.station.alarms.next().copied().expect("a message");
        let values: Vec<_> = event.values.iter().map(|(ty, bytes)| (ty, bytes.to_vec())).collect();
        assert_eq!(values, sent, "{pointers:02X?}");
    }
}

/// Whatever is written into the statics, the block does not run into it.
#[test]
fn statics_that_were_overwritten() {
    for key in KEYS {
        let mut fake = block(key, 7);
        fake.run();
        for (name, bytes) in [("PLACE", &[0xFF, 0xFF][..]), ("NUMBER", &[9; 4]), ("LAST", &[0xFF])] {
            fake.set(name, bytes);
            fake.run();
            assert_eq!(fake.value("ERROR"), 0, "{key} {name}");
        }
    }
}

#[test]
fn nobody_has_named_an_archive() {
    let mut fake = Fake::new("SYSTEM:SFB37").with("AR_ID", 5u32.to_be_bytes()).with("SD_1", any(2, 4, 10));
    for (request, error, code) in [(0, 0, 0), (1, 1, 1), (1, 0, 0), (0, 0, 0), (1, 1, 1)] {
        fake.set("REQ", &[request]);
        assert_eq!(status(&mut fake), (0, error, code));
    }
    let mut fake = Fake::new("SYSTEM:SFB37").with("REQ", [1]).with("SD_1", any(2, 4, 10));
    assert_eq!(status(&mut fake), (0, 1, 4), "AR_ID 0");
}

/// A NOTIFY tells at its first call what is; an ALARM only what changes.
#[test]
fn what_the_first_call_sends() {
    for (key, sends) in
        [("SYSTEM:SFB31", true), ("SYSTEM:SFB36", true), ("SYSTEM:SFB33", false), ("SYSTEM:SFB35", false)]
    {
        let mut fake = block(key, 7);
        fake.run();
        assert_eq!(fake.station.alarms.next().is_some(), sends, "{key}");
        signal(&mut fake, 1);
        fake.run();
        while fake.station.alarms.next().is_some() {
            fake.station.alarms.sent();
        }
        assert_eq!(status(&mut fake), (1, 0, 0), "{key}: DONE once");
        assert_eq!(status(&mut fake), (0, 0, 0), "{key}");
    }
}
