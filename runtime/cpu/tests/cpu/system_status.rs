//! What the CPU tells a program about itself: run times, system status lists, the diagnostic buffer.

use ob1_cpu::{CpuConfig, CyclicInterrupt, Family};
use ob1_model::{AlarmChange, Displays};
use ob1_time::{Instant, Span};

use crate::common::calls::{module, on_demand};
use crate::common::source::{bench, bench_with};
use crate::common::{MS, on_each_engine};

#[test]
fn run_times_of_organization_blocks() {
    on_each_engine(|| {
        let times =
            "PRIO := MW 20, LAST_RT := MD 24, LAST_ET := MD 28, CUR_T := MD 32, CUR_RT := MD 36, CUR_ET := MD 40,
            NEXT_ET := MD 44";
        let source = format!(
            "ORGANIZATION_BLOCK OB 35 BEGIN CALL SFC 47 (WT := 2000);
             CALL SFC 78 (OB_NR := 1, RET_VAL := MW 10, {times}); L MD 36; T MD 60; L MD 40; T MD 64; END_ORGANIZATION_BLOCK
             ORGANIZATION_BLOCK OB 1 BEGIN CALL SFC 47 (WT := 12000);
             CALL SFC 78 (OB_NR := 0, RET_VAL := MW 12, {times});
             L MD 24; T MD 68; CALL SFC 78 (OB_NR := 0, RET_VAL := MW 12, {times}); L MD 24; T MD 72;
             CALL SFC 78 (OB_NR := 35, RET_VAL := MW 14, {times}); END_ORGANIZATION_BLOCK"
        );
        let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, 10 * MS)], ..CpuConfig::default() };
        let mut bench = bench_with(&source, &[], config, vec![]);
        bench.clock.per_statement = Span::ZERO;
        bench.run();
        // OB 35 asked for OB 1 after 12 ms, of which 2 were its own.
        assert_eq!((bench.md(60), bench.md(64)), (10_000, 12_000));
        assert_eq!((bench.mw(12), bench.mw(14), bench.md(68)), (1, 35, u32::MAX));
        assert_eq!((bench.mw(20), bench.md(24), bench.md(28), bench.md(36), bench.md(40)), (12, 2000, 2000, 0, 0));
        bench.run();
        assert_eq!((bench.md(68), bench.md(72)), (10_000, u32::MAX), "once in a run");
    });
}

/// A list: family, SZL_ID, INDEX; RET_VAL, length and number of records, first bytes.
type List<'a> = (Family, u16, u16, u32, u32, u32, &'a [u8]);

#[test]
fn system_status_lists() {
    on_each_engine(|| {
        let read = |family, id: u16, index: u16| {
            let call = format!(
                "CALL SFC 51 (REQ := TRUE, SZL_ID := W#16#{id:X}, INDEX := W#16#{index:X}, RET_VAL := MW 10, BUSY := M 12.0,
                 SZL_HEADER := DB10.head, DR := P#M 20.0 BYTE 200); L DB10.head.LENTHDR; T MW 14; L DB10.head.N_DR; T MW 16"
            );
            let (_, modules) = module();
            let mut bench = bench_with(&on_demand(&call), &[], CpuConfig::of(family), modules);
            bench.run();
            bench.set_m(0, 0, true);
            bench.run();
            let bytes = bench.cpu.bit_memory()[20..].to_vec();
            (bench.mw(10), bench.mw(14), bench.mw(16), bytes)
        };
        use Family::{S7_300, S7_400};
        let cases: &[List<'_>] = &[
            (S7_300, 0x0111, 1, 0, 28, 1, b"\x00\x01ob1 S7-300          \0\xC0\0\x01\0\x01"),
            (S7_400, 0x0111, 6, 0, 28, 1, b"\x00\x06ob1 S7-400          "),
            (S7_300, 0x0011, 0, 0, 28, 4, &[0, 1]),
            (S7_300, 0x0F11, 0, 0, 28, 4, &[0, 0]),
            (S7_300, 0x0111, 2, 0x8083, 0, 0, &[]),
            (S7_300, 0x0112, 0x100, 0, 2, 2, &[1, 1, 1, 5, 0]),
            (S7_300, 0x0112, 0x300, 0, 2, 20, &[3, 2, 3, 3, 3, 4, 3, 6]),
            (S7_400, 0x0112, 0x300, 0, 2, 21, &[3, 2, 3, 3, 3, 4, 3, 5]),
            (S7_300, 0x0112, 0x200, 0, 0, 0, &[]),
            (S7_400, 0x0112, 0x200, 0, 2, 1, &[2, 2]),
            (S7_300, 0x0F12, 0, 0, 2, 23, &[0]),
            (S7_300, 0x0112, 0x900, 0x8083, 0, 0, &[]),
            (S7_300, 0x0113, 1, 0, 36, 1, &[0, 1, 0, 1]),
            (S7_300, 0x0014, 0, 0, 8, 9, &[0, 1, 0, 1, 0, 128, 0, 0, 0, 2, 0, 1, 0, 128, 0, 0, 0, 3, 0, 1, 8, 0, 0, 0]),
            (S7_300, 0x0115, 0x0800, 0, 10, 1, &[8, 0]),
            (S7_300, 0x0174, 4, 0, 4, 1, &[0, 4, 1, 0]),
            (S7_300, 0x0119, 5, 0, 4, 1, &[0, 5, 0, 0]),
            (S7_300, 0x011C, 7, 0, 34, 1, b"\x00\x07ob1 S7-300\0\0"),
            (S7_300, 0x0222, 35, 0, 28, 1, &[0x11, 0x36, 12, 35]),
            (S7_300, 0x0222, 2, 0x8083, 0, 0, &[]),
            (S7_300, 0x0025, 0, 0, 4, 0, &[]),
            (S7_300, 0x0131, 1, 0, 40, 1, &[0, 1, 0, 0, 0, 0]),
            (S7_300, 0x0131, 0, 0, 40, 1, &[0, 1, 0, 0, 0, 0]),
            (S7_300, 0x0232, 0, 0, 40, 1, &[0, 4, 0, 1, 0, 0, 0, 1]),
            (S7_300, 0x0132, 0, 0x8083, 0, 0, &[]),
            (S7_300, 0x0F1C, 0, 0, 34, 10, &[0, 0]),
            (S7_300, 0x011C, 8, 0, 34, 1, &[0, 8, 0, 0]),
            (S7_300, 0x0131, 3, 0, 40, 1, &[0, 3, 0x7F, 0xFC, 0x83, 1, 0, 0xF0, 0, 16, 0, 1, 2, 9, 0]),
            (S7_400, 0x0131, 3, 0, 40, 1, &[0, 3, 0xFF, 0xFF, 0x83, 1, 1, 0xE0, 0, 32, 0, 1, 3, 0x84, 0]),
            (S7_300, 0x0131, 6, 0, 40, 1, &[0, 6, 0xF3, 0, 0, 0xF8, 1, 0xF0, 0xFF, 0x4E]),
            (S7_400, 0x0131, 6, 0, 40, 1, &[0, 6, 0xF3, 0, 0xE0, 0xFB, 1, 0xF0, 0xFF, 0x7E]),
            (S7_300, 0x0131, 0x10, 0x8083, 0, 0, &[]),
            (S7_400, 0x0131, 0x10, 0, 40, 1, &[0, 0x10, 0x3F, 0, 0x0F, 0, 0x3F, 0, 0x7F, 0, 0, 64, 0]),
            (S7_400, 0x0132, 6, 0, 40, 1, &[0, 6]),
            (S7_300, 0x0131, 8, 0x8083, 0, 0, &[]),
            (S7_300, 0x0132, 1, 0, 40, 1, &[0, 1, 0, 1]),
            (S7_300, 0x0132, 4, 0, 40, 1, &[0, 4, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0]),
            (S7_300, 0x0232, 4, 0, 40, 1, &[0, 4, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0]),
            (S7_300, 0x0232, 9, 0x8083, 0, 0, &[]),
            (S7_300, 0x0132, 8, 0, 40, 1, &[0, 8, 0, 0]),
            (S7_300, 0x0013, 0, 0, 36, 5, &[0, 1, 0, 1]),
            (S7_300, 0x0074, 0, 0, 4, 7, &[0, 1]),
            (S7_300, 0x001A, 0, 0, 12, 3, &[9, 1]),
            (S7_300, 0x001B, 0, 0, 20, 6, &[9, 0]),
            (S7_300, 0x003A, 0, 0, 148, 0, &[]),
            (S7_300, 0x0591, 0, 0, 16, 0, &[]),
            (S7_300, 0x0D91, 0, 0, 16, 2, &[0, 0, 2, 0, 0x7F, 0xFF, 0, 0xC0, 0, 0xC0, 0, 0, 0xB4, 2, 0, 0x11]),
            (S7_300, 0x0424, 4, 0, 20, 1, &[0x43, 0x02, 0xFF, 0x08]),
            (S7_300, 0x0692, 0, 0, 16, 1, &[1, 0]),
            (S7_300, 0x0092, 1, 0x8083, 0, 0, &[]),
            (S7_300, 0x0124, 0, 0, 20, 1, &[0x43, 0x02, 0xFF, 0x68]),
            (S7_300, 0x0424, 0, 0, 20, 1, &[0x43, 0x02, 0xFF, 0x08, 0, 0, 0, 0, 0x81, 4, 0x77, 4]),
            (S7_300, 0x0091, 0, 0, 16, 1, &[0, 0, 4, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0x82, 0, 0x11]),
            (S7_300, 0x0C91, 0x102, 0, 16, 1, &[0, 0, 4, 0, 1, 0]),
            (S7_300, 0x0C91, 0x8103, 0, 16, 1, &[0, 0, 4, 0, 1, 0]),
            (S7_300, 0x0C91, 0x104, 0x8083, 0, 0, &[]),
            (S7_300, 0x01A0, 1, 0, 20, 1, &[0x43, 0x02]),
            (S7_300, 0x00A0, 0, 0, 20, 2, &[0x43, 0x02]),
            (S7_300, 0x00B1, 0x100, 0, 4, 1, &[0, 0x0C, 0, 0]),
            (S7_300, 0x00B3, 0x100, 0, 1, 1, &[0x42]),
            (S7_300, 0x00B1, 0x200, 0x8083, 0, 0, &[]),
            (S7_300, 0x00B2, 0x0004, 0, 1, 1, &[0x42]),
            (S7_300, 0x00B2, 0x0003, 0x8083, 0, 0, &[]),
            (S7_300, 0x00B2, 0x0005, 0x8083, 0, 0, &[]),
            (S7_300, 0x00B2, 0x0104, 0x8083, 0, 0, &[]),
            (S7_300, 0xC0A0, 0x100, 0x8083, 0, 0, &[]),
            (S7_300, 0xC0A0, 0x200, 0x8083, 0, 0, &[]),
            (S7_300, 0x0000, 0, 0x81, 2, 100, &[0, 0, 0x0F, 0]),
            (S7_300, 0x0099, 0, 0x8082, 0, 0, &[]),
        ];
        for (family, id, index, result, len, number, bytes) in cases {
            let (got, got_len, got_number, data) = read(*family, *id, *index);
            let name = format!("{id:04X} {index:04X}: {data:02X?}");
            assert_eq!((got, got_len, got_number), (*result, *len, *number), "{name}");
            assert_eq!(&data[..bytes.len()], *bytes, "{name}");
        }
    });
}

#[test]
fn what_has_happened_keeps_its_date_when_the_clock_is_set() {
    on_each_engine(|| {
        let list = |id: &str, to: u32| {
            format!(
                "CALL SFC 51 (REQ := TRUE, SZL_ID := {id}, INDEX := W#16#1, RET_VAL := MW 12, BUSY := M 14.0,
                 SZL_HEADER := DB10.head, DR := P#M {to}.0 BYTE 20)"
            )
        };
        // To the year 2001; then the newest entry of the diagnostic buffer, and the last start-up.
        let set = "CALL SFC 0 (PDT := DB10.at, RET_VAL := MW 10)";
        let call = format!("{set}; {}; {}", list("W#16#1A0", 20), list("W#16#424", 40));
        let mut bench = bench_with(&on_demand(&call), &[], CpuConfig::default(), vec![]);
        bench.run();
        bench.set_m(0, 0, true);
        bench.run();
        let memory = bench.cpu.bit_memory();
        assert_eq!((&memory[10..14], &memory[20..22], &memory[40..42]), (&[0; 4][..], &[0x43, 2][..], &[0x43, 2][..]));
        assert_eq!((&memory[32..35], &memory[52..55]), (&[0x90, 1, 1][..], &[0x90, 1, 1][..]));
    });
}

#[test]
fn the_diagnostic_buffer_of_a_cp_in_the_status_lists() {
    on_each_engine(|| {
        let call = "CALL SFC 51 (REQ := TRUE, SZL_ID := MW 4, INDEX := W#16#100, RET_VAL := MW 10, BUSY := M 12.0,
             SZL_HEADER := DB10.head, DR := P#M 20.0 BYTE 50); L DB10.head.LENTHDR; T MW 14; L DB10.head.N_DR; T MW 16";
        let (module, modules) = module();
        let mut bench = bench_with(&on_demand(call), &[], CpuConfig::default(), modules);
        bench.run();
        let entry = |number, incoming, ms| {
            let time = Instant::from_millis(ms);
            ob1_cpu::ModuleEntry { number, incoming, time }
        };
        let entries = vec![entry(0x080D, false, 3_723_004), entry(0x1E0D, true, u64::MAX), entry(0x0003, true, 0)];
        module.look(|seen| seen.buffer = entries);
        bench.set(4, ob1_cpu::Width::Word, 0xC0A0);
        bench.set_m(0, 0, true);
        bench.run();
        assert_eq!((bench.mw(10), bench.mw(14), bench.mw(16)), (0x0081, 20, 2), "there is room for two");
        let memory = &bench.cpu.bit_memory()[20..60];
        // The day of the bench begins at 1990-01-01.
        let first = [0xF8, 0x08, 0, 0, 0, 0, 0x08, 0x0D, 1, 0, 0, 0, 0x90, 0x01, 0x01, 0x01, 0x02, 0x03, 0x00, 0x42];
        assert_eq!(memory[..20], first);
        assert_eq!(memory[20..32], [0xF9, 0x1E, 0, 0, 0, 0, 0x1E, 0x0D, 1, 0, 0, 0]);
        bench.set(4, ob1_cpu::Width::Word, 0xCFA0);
        bench.set_m(0, 0, false);
        bench.run();
        bench.set_m(0, 0, true);
        bench.run();
        assert_eq!((bench.mw(10), bench.mw(14), bench.mw(16)), (0, 20, 3), "the header alone says how many there are");
    });
}

#[test]
fn a_module_that_is_gone_in_the_status_lists() {
    on_each_engine(|| {
        let call = |id: &str, index: &str, at: u32| {
            format!(
                "CALL SFC 51 (REQ := TRUE, SZL_ID := W#16#{id}, INDEX := W#16#{index}, RET_VAL := MW 10, BUSY := M 12.0,
                 SZL_HEADER := DB10.head, DR := P#M {at}.0 BYTE 16);"
            )
        };
        let calls = call("91", "0", 20) + &call("B1", "100", 40) + &call("174", "1", 50);
        let (module, modules) = module();
        let mut bench = bench_with(&on_demand(calls.trim_end_matches(';')), &[], CpuConfig::default(), modules);
        bench.run();
        module.look(|seen| seen.absent = true);
        bench.set_m(0, 0, true);
        bench.run();
        let memory = bench.cpu.bit_memory();
        assert_eq!((memory[33], &memory[40..44], &memory[50..54]), (0x85, &[1, 0x0C, 3, 0][..], &[0, 1, 1, 0][..]));
    });
}

#[test]
fn entries_and_messages_of_the_program() {
    on_each_engine(|| {
        let call = "CALL SFC 52 (SEND := FALSE, EVENTN := W#16#A123, INFO1 := MW 60, INFO2 := MD 62, RET_VAL := MW 10);
            CALL SFC 17 (SIG := M 70.0, ID := W#16#EEEE, EV_ID := DW#16#12, SD := MW 60, RET_VAL := MW 20)";
        let mut bench = bench(&on_demand(call), &[]);
        bench.run();
        bench.set(60, ob1_cpu::Width::Word, 0x1122);
        bench.set(62, ob1_cpu::Width::DWord, 0x3344_5566);
        let mut alarms = bench.cpu.alarm_client().expect("the first");
        assert!(bench.cpu.alarm_client().is_none());
        // The start-up has deleted all alarms.
        assert_eq!(alarms.take().map(|event| event.change), Some(AlarmChange::Deleted));
        for (signal, displays, code, message) in [
            (false, 0, 0x8087, None),
            (true, 0, 0x8085, None),
            (true, Displays::BLOCKS, 0x8085, None),
            (true, Displays::FUNCTIONS, 0, Some((1, 0))),
            (true, Displays::FUNCTIONS, 0x8084, None),
            (false, Displays::FUNCTIONS, 0, Some((0, 0))),
        ] {
            alarms.set_displays(Displays(displays));
            bench.set_m(70, 0, signal);
            bench.set_m(0, 0, true);
            bench.run();
            assert_eq!(bench.mw(20), code);
            let event = alarms.take();
            assert_eq!(event.map(|event| (event.state.signals, event.state.coming)), message);
            if let Some(event) = event {
                assert_eq!(event.values.iter().collect::<Vec<_>>(), [(4, &[0x11, 0x22][..])]);
                // The clock of the bench begins at 1990-01-01.
                assert_eq!(event.time.wall[..3], [0x90, 0x01, 0x01]);
            }
        }
        // An entry of the program is sent to whoever has logged on for it.
        alarms.set_displays(Displays(Displays::DIAGNOSIS));
        bench.run();
        let entry = bench.cpu.diagnostics().next().expect("an entry").to_string();
        assert_eq!(entry, "A123h entry of the program: INFO1 1122, INFO2 33445566");
    });
}
