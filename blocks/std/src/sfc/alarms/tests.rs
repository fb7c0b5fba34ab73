use ob1_model::{ALARMS, AlarmAck, AlarmTime, Displays};

use crate::services::AlarmTable;
use crate::tests::{Fake, any};

/// A call of SFC 17 or 18, with a display.
fn function(key: &str, id: u32, signal: bool) -> Fake {
    let fake = Fake::new(key).with("SIG", [u8::from(signal)]).with("ID", [0xEE, 0xEE]);
    let mut fake = fake.with("EV_ID", id.to_be_bytes()).with("RET_VAL", [9; 2]);
    fake.station.alarms.set_displays(Displays(Displays::FUNCTIONS));
    fake
}

/// RET_VAL, and the value that was sent, by the associated value. ["Error Information" of SFC 17]
#[test]
fn values_of_a_function() {
    for (value, code, sent) in [
        (any(2, 3, 10), 0, Some((2, vec![1, 2, 3]))),
        (any(4, 6, 10), 0, Some((4, vec![1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]))),
        (any(5, 1, 10), 0, Some((5, vec![1, 2]))),
        (any(2, 13, 10), 1, None),
        (any(19, 4, 10), 1, None),
        (any(1, 1, 12), 0, Some((1, vec![1]))),
        (any(1, 8, 10), 1, None),
        (any(2, 3, 255), 1, None),
        ([0; 10], 0, None),
        // Local data: the message is sent with it, and a warning.
        ([0x10, 2, 0, 1, 0, 0, 0x86, 0, 0, 0], 1, None),
    ] {
        let mut fake = function("SYSTEM:SFC18", 5, true).with("SD", value);
        fake.memory(10, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.br), (code, true), "{value:02X?}");
        let event = fake.station.alarms.next().copied().expect("sent in any case");
        let values: Vec<_> = event.values.iter().map(|(ty, bytes)| (ty, bytes.to_vec())).collect();
        assert_eq!(values, Vec::from_iter(sent), "{value:02X?}");
    }
}

/// Every RET_VAL of SFC 17, 18, 107 and 108 that this CPU can give. 8086 needs a call that is interrupted by another.
#[test]
fn codes_of_the_functions() {
    let mut table = AlarmTable::default();
    let mut call = |key: &str, id: u32, component: u32, signal: bool, displays: u8| {
        let mut fake = function(key, id, signal);
        if key.len() > "SYSTEM:SFC17".len() {
            fake.set("CMP_ID", &component.to_be_bytes());
        }
        std::mem::swap(&mut table, &mut fake.station.alarms);
        fake.station.alarms.set_displays(Displays(displays));
        fake.run();
        std::mem::swap(&mut table, &mut fake.station.alarms);
        (fake.value("RET_VAL"), fake.br)
    };
    const ON: u8 = Displays::FUNCTIONS;
    for (key, id, component, signal, displays, code) in [
        ("SYSTEM:SFC17", 0, 0, true, ON, 0x8081),
        ("SYSTEM:SFC107", 0, 1, true, ON, 0x8081),
        ("SYSTEM:SFC107", 7, 0, true, ON, 0x8089),
        ("SYSTEM:SFC18", 1, 0, false, ON, 0x8087),
        ("SYSTEM:SFC18", 1, 0, true, 0, 0x8085),
        ("SYSTEM:SFC18", 1, 0, true, Displays::BLOCKS, 0x8085),
        ("SYSTEM:SFC18", 1, 0, true, ON, 0),
        ("SYSTEM:SFC18", 1, 0, true, ON, 0x8084),
        ("SYSTEM:SFC17", 1, 0, false, ON, 0x8088),
        ("SYSTEM:SFC18", 1, 0, false, ON, 0),
        ("SYSTEM:SFC18", 1, 0, true, ON, 0x8083),
        ("SYSTEM:SFC107", 2, 8, true, ON, 0),
        ("SYSTEM:SFC107", 2, 9, false, ON, 0x8088),
        ("SYSTEM:SFC108", 3, 8, true, ON, 0),
        ("SYSTEM:SFC17", 4, 0, true, ON, 0),
        // The signal is followed without a display too, but no message is sent.
        ("SYSTEM:SFC17", 4, 0, false, 0, 0x8085),
        ("SYSTEM:SFC17", 4, 0, false, ON, 0x8084),
    ] {
        assert_eq!(call(key, id, component, signal, displays), (code, code < 0x8000), "{key} {id} {signal}");
    }
    // Of the numbers 1 to 4 all are in use; SQ and DQ until they are acknowledged.
    let taken = 4;
    for id in 0..(ALARMS - taken) as u32 {
        let code = if id as usize == ALARMS - taken - 1 { 2 } else { 0 };
        // Without fetching, the way to the displays is full some time.
        let (got, _) = call("SYSTEM:SFC18", 1000 + id, 0, true, ON);
        assert!(got == code || got == 0x8083, "{id}: {got:04X}");
    }
    assert_eq!(call("SYSTEM:SFC18", 9999, 0, true, ON), (0x8082, false));
}

/// The last free place is a warning.
#[test]
fn the_last_place_is_a_warning() {
    let mut table = AlarmTable::default();
    for id in 1..=ALARMS as u32 + 1 {
        let mut fake = function("SYSTEM:SFC18", id, true);
        std::mem::swap(&mut table, &mut fake.station.alarms);
        fake.station.alarms.set_displays(Displays(Displays::FUNCTIONS));
        fake.run();
        std::mem::swap(&mut table, &mut fake.station.alarms);
        let code = match id as usize {
            ALARMS => 0x0002,
            id if id > ALARMS => 0x8082,
            _ => 0,
        };
        assert_eq!(fake.value("RET_VAL"), code, "{id}");
        while table.next().is_some() {
            table.sent();
        }
    }
}

/// Numbers of the dynamic alarms: read with their states, selected, read on, set free.
#[test]
fn numbers_in_use() {
    let mut fake = Fake::new("SYSTEM:SFC105");
    let table = &mut fake.station.alarms;
    table.set_displays(Displays(Displays::FUNCTIONS));
    let mut table = std::mem::take(table);
    for (key, id, component) in
        [("SYSTEM:SFC18", 1u32, 0u32), ("SYSTEM:SFC107", 2, 8), ("SYSTEM:SFC108", 3, 9), ("SYSTEM:SFC107", 4, 9)]
    {
        let mut fake = function(key, id, true);
        if component > 0 {
            fake.set("CMP_ID", &component.to_be_bytes());
        }
        std::mem::swap(&mut table, &mut fake.station.alarms);
        fake.station.alarms.set_displays(Displays(Displays::FUNCTIONS));
        fake.run();
        std::mem::swap(&mut table, &mut fake.station.alarms);
        assert_eq!(fake.value("RET_VAL"), 0);
    }
    assert!(table.acknowledge(AlarmAck { id: 2, coming: 1, going: 1 }, AlarmTime::default()));
    // MODE, SI_ID, room in bytes; RET_VAL and the EV_IDs that come.
    for (mode, given, room, code, ids) in [
        (0i16, 0u32, 48, 0x8083, vec![]),
        (1, 0, 48, 0, vec![2u32, 3, 4]),
        (1, 0, 24, 1, vec![2, 3]),
        (0, 0, 24, 0, vec![4]),
        (1, 0, 12, 1, vec![2]),
        (0, 1, 12, 0x8083, vec![]),
        (0, 0, 12, 1, vec![3]),
        (0, 0, 12, 0, vec![4]),
        (2, 3, 12, 0, vec![3]),
        (3, 9, 24, 0, vec![3, 4]),
        (3, 7, 12, 0, vec![]),
        (2, 0, 12, 0x8081, vec![]),
        (3, 0, 12, 0x8081, vec![]),
        (1, 5, 12, 0x8082, vec![]),
        (4, 0, 12, 0x8084, vec![]),
        (1, 0, 11, 0x8086, vec![]),
    ] {
        let mut fake = Fake::new("SYSTEM:SFC105").with("MODE", mode.to_be_bytes()).with("SI_ID", given.to_be_bytes());
        fake = fake.with("RET_VAL", [9; 2]).with("N_SI", [0; 2]).with("SYS_INST", any(2, room, 100));
        std::mem::swap(&mut table, &mut fake.station.alarms);
        fake.run();
        std::mem::swap(&mut table, &mut fake.station.alarms);
        assert_eq!((fake.value("RET_VAL"), fake.value("N_SI")), (code, ids.len() as u32), "{mode} {given} {room}");
        for (i, id) in ids.iter().enumerate() {
            let bytes = fake.memory_at(100 + 12 * i, 12);
            // SFC_NO, LEN, SIG_STAT and ACK_STAT, EV_ID.
            let (sfc, bits) = match id {
                2 => (107, 3),
                3 => (108, 3),
                _ => (107, 1),
            };
            let expected = [&[0, sfc, 12, bits][..], &id.to_be_bytes()].concat();
            assert_eq!(bytes[..8], expected, "{mode}");
        }
    }
    for (mode, given, code, left) in
        [(2i16, 3u32, 0, vec![1u32, 2, 4]), (4, 0, 0x8084, vec![1, 2, 4]), (1, 0, 0, vec![1])]
    {
        let mut fake = Fake::new("SYSTEM:SFC106").with("MODE", mode.to_be_bytes()).with("SI_ID", given.to_be_bytes());
        fake = fake.with("RET_VAL", [9; 2]);
        std::mem::swap(&mut table, &mut fake.station.alarms);
        fake.run();
        std::mem::swap(&mut table, &mut fake.station.alarms);
        assert_eq!(fake.value("RET_VAL"), code, "{mode}");
        assert_eq!(table.iter().map(|now| now.state.id).collect::<Vec<_>>(), left, "{mode}");
    }
}

/// What SFC 9 and 10 refuse; what they do is in the property test.
#[test]
fn codes_of_locking() {
    for (req, mode, id, code) in
        [(0, 4, 5u32, 0x7000u32), (1, 7, 5, 0x8082), (1, 4, 0, 0x8083), (1, 5, 0, 0x8083), (1, 2, 0, 0), (1, 5, 9, 0)]
    {
        for key in ["SYSTEM:SFC9", "SYSTEM:SFC10"] {
            let mut fake = Fake::new(key).with("REQ", [req]).with("MODE", [mode]).with("MESGN", id.to_be_bytes());
            fake = fake.with("RET_VAL", [9; 2]).with("BUSY", [1]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY")), (code, 0), "{key} {req} {mode} {id}");
        }
    }
    let mut fake = function("SYSTEM:SFC18", 5, true);
    fake.run();
    let mut table = std::mem::take(&mut fake.station.alarms);
    let mut fake = Fake::new("SYSTEM:SFC10").with("REQ", [1]).with("MODE", [4]).with("MESGN", 5u32.to_be_bytes());
    fake = fake.with("RET_VAL", [9; 2]).with("BUSY", [1]);
    std::mem::swap(&mut table, &mut fake.station.alarms);
    fake.run();
    assert_eq!(fake.value("RET_VAL"), 0x8083, "messages of functions cannot be locked");
}
