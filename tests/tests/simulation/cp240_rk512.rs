//! RK 512 of the CP 240 in a whole station, in virtual time: what the program or its memory does to an order that is
//! running. The partner is controlled by the test.

use ob1_cpu::{Cell, OperatingState, Width};
use ob1_line::sim::SplitMix64;
use ob1_model::Area;
use ob1_tests::sim::{MS, SECOND};

use crate::cp240_blocks::{DB_10, FEHLER, FRAGMENTS, RK512, SENDE_LAEUFT, SERVES, SYNCHRON, Site, rtu};

/// FC 2 while M 6.1 is set, until its order has ended; `ANZW` MW 70, `LANG` MW 80.
const FETCHES: &str = "U M 6.1;\nSPBN f2;\nCALL FC 2 (ADR := 256, QDB := DB 5, QBDW := W#16#0, LANG := MW 80, \
     ZDB := DB 11, ZBDW := 0, KOOR := W#16#FFFF, ANZW := MW 70, PAFE := MB 72, ANZ := MW 74, GESE := MW 76, \
     KOPF_GESE := M 73.0, WART_DATEN := M 73.1, EMPF_LAEUFT := M 73.2, LETZTER_BLOCK := M 73.3, \
     FEHL_KOM := M 73.4);\nL MW 70;\nL W#16#C;\nUW;\nSPZ f2;\nR M 6.1;\nf2: NOP 0;\n";
/// FC 3, without end; `ANZW` MW 90.
const SENDS: &str = "CALL FC 3 (ADR := 256, QDB := DB 10, QBDW := MW 100, LANG := MW 102, ZDB := DB 5, ZBDW := 0, \
     KOOR := W#16#FFFF, ANZW := MW 90, PAFE := MB 92, ANZ := MW 94, GESE := MW 96, KOPF_GESENET := M 93.0, \
     ERSTER_BLOCK := M 93.1, SENDEN_LAEUFT := M 93.2, SENDEN_FERTIG := M 93.3, LETZTER_BLOCK := M 93.4, \
     FEHLER := M 93.5);\n";
const LINES: &str = "CALL FC 8 (ADR := 256, RTS := M 110.0, DTR := M 110.1, MASKE_RTS := M 110.2, \
     MASKE_DTR := M 110.3, STATUS := MB 111, DELTA_STATUS := MB 112, START := M 110.4, AUFTRAG_LAEU := M 110.5, \
     RET_VAL := MW 114);\n";
const DB_11: &str = "DATA_BLOCK DB 11\nSTRUCT\nD : ARRAY [1..100] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";

impl Site {
    pub(crate) fn set_word(&mut self, at: u32, word: u16) {
        let cell = Cell::Area(Area::Memory, 8 * at);
        self.bench.station.cpu.write(cell, Width::Word, u32::from(word)).expect("bit memory");
    }

    pub(crate) fn set_byte(&mut self, at: u32, byte: u8) {
        let cell = Cell::Area(Area::Memory, 8 * at);
        self.bench.station.cpu.write(cell, Width::Byte, u32::from(byte)).expect("bit memory");
    }

    /// Gives an order of FC 2 and waits until the partner has its header.
    fn fetches(&mut self, words: u16) {
        self.set_word(80, words);
        self.bit(6, 1, true);
        self.until(|site| !site.bench.device.telegrams.is_empty());
    }
}

fn fetching(target: &str, more: &str) -> Site {
    let mut site = Site::new(RK512, &[SYNCHRON, "U M 1.0;\nBEB;\n", FETCHES].concat(), &[target, more].concat());
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(100 * MS);
    site
}

/// A data block that is deleted while the partner fetches from it: the partner gets 14h, not zeros, and the
/// coordination flag is free again.
#[test]
fn a_data_block_that_goes_while_it_is_fetched() {
    let makes = "U M 6.0;\nSPB m1;\nCALL SFC 22 (LOW_LIMIT := W#16#3C, UP_LIMIT := W#16#3C, COUNT := W#16#64, \
         RET_VAL := MW 56, DB_NUMBER := MW 58);\nm1: NOP 0;\nU M 6.2;\nSPBN m2;\n\
         CALL SFC 23 (DB_NUMBER := W#16#3C, RET_VAL := MW 56);\nm2: NOP 0;\n";
    let mut site = Site::new(RK512, &[makes, SYNCHRON, SERVES].concat(), DB_10);
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(100 * MS);
    site.bit(6, 0, true);
    site.partner_sends(&[0, 0, b'E', b'D', 60, 0, 0, 40, 7, 0]);
    site.until(|site| site.is_set(52, SENDE_LAEUFT) && site.word(44) >= 12);
    assert!(site.is_set(7, 0), "the flag is set while the order is carried out");
    site.bit(6, 2, true);
    site.until(|site| !site.bench.device.telegrams.is_empty());
    assert_eq!(site.bench.device.telegrams, [[0, 0, 0, 0x14]]);
    site.until(|site| site.word(40) == 0x1408);
    assert!(site.is_set(52, FEHLER) && !site.is_set(7, 0));
}

/// What was fetched and cannot be stored is not "done": a write-protected data block is event 2530h at each attempt.
#[test]
fn a_target_that_is_write_protected() {
    let target =
        "DATA_BLOCK DB 11\nREAD_ONLY\nSTRUCT\nD : ARRAY [1..100] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";
    let counts = "ORGANIZATION_BLOCK OB 121\nBEGIN\nL MW 62;\n+ 1;\nT MW 62;\nEND_ORGANIZATION_BLOCK\n";
    let mut site = fetching(target, counts);
    site.fetches(10);
    site.partner_sends(&[&[0; 4][..], &[7; 20]].concat());
    site.until(|site| site.word(62) > 2);
    site.bench.pass(SECOND);
    assert_eq!(site.word(70), 0x0002, "running");
    assert_eq!(site.bench.station.cpu.state(), OperatingState::Run);
}

/// LANG must stay while an order runs. If it does not, the result has the wrong length, whatever LANG is then.
#[test]
fn lang_that_changes_while_an_order_runs() {
    for lang in [11, 0, 512, i16::MAX as u16, i16::MIN as u16, u16::MAX] {
        let mut site = fetching(DB_11, "");
        site.fetches(10);
        site.set_word(80, lang);
        site.partner_sends(&[&[0; 4][..], &[7; 20]].concat());
        site.until(|site| site.word(70) & 0xC != 0);
        assert_eq!((site.word(70), site.is_set(73, 4)), (0x0C08, true), "LANG {lang:04X}h");
    }
}

/// "Internal use" does not stop a program from writing there. Whatever stands in the words and bits of the blocks, and
/// whatever the partner sends then, the CPU stays in RUN.
#[test]
fn nothing_that_a_program_scribbles_stops_it() {
    let rk512 = [LINES, FETCHES, SENDS, SYNCHRON, SERVES].concat();
    let telegrams = "CALL FC 0 (ADR := 256, _DB := DB 10, ABD := MW 100, ANZ := MW 102, FRG := M 93.0, GESE := MW 94, \
         ANZ_INT := MW 96, ENDE_KOMM := M 93.1, LETZTER_BLOCK := M 93.2, SENDEN_LAEUFT := M 93.3, \
         FEHLER_KOM := M 93.4, PAFE := MB 92);\n\
         CALL FC 1 (ADR := 256, _DB := DB 11, ABD := MW 104, ANZ := MW 70, EMFR := M 73.0, GEEM := MW 74, \
         ANZ_INT := MW 76, EMPF_LAEUFT := M 73.1, LETZTER_BLOCK := M 73.2, FEHLER_EMPF := M 73.3, PAFE := MB 72);\n";
    let others = [LINES, telegrams, SYNCHRON, FRAGMENTS].concat();
    for (params, cycle, seed) in [
        (RK512, &rk512, 1),
        (RK512, &rk512, 2),
        ("{ protocol = \"ascii-fragmented\", baud = 115200, zvz_ms = 20 }", &others, 3),
        ("{ protocol = \"3964r\", baud = 115200 }", &others, 4),
        ("{ protocol = \"modbus-slave-rtu-long\", baud = 38400 }", &others, 5),
    ] {
        let mut random = SplitMix64::new(seed);
        let mut site = Site::new(params, cycle, &[DB_10, DB_11].concat());
        site.until(|site| !site.is_set(1, 0));
        for _ in 0..6_000 {
            site.bench.pass(MS);
            for _ in 0..random.below(3) {
                // MB 4 keeps FC 4 off, the others belong to the blocks.
                let at = [1, 2, 3, 5, 6].into_iter().chain(40..116).nth(random.below(81) as usize);
                site.set_byte(at.unwrap_or(40), [0, 0xFF, random.next_u64() as u8][random.below(3) as usize]);
            }
            if random.below(40) == 0 && !params.contains("3964r") {
                let bytes: Vec<u8> = (0..random.below(40)).map(|_| random.next_u64() as u8).collect();
                let write = rtu(&[&[1, 16, 0, bytes.len() as u8, 0, 4, 8][..], &[bytes.len() as u8; 8]].concat());
                site.bench.meanwhile(|_, _, out| {
                    out.extend(if params.contains("modbus") { write } else { bytes });
                    None
                });
            } else if random.below(40) == 0 {
                let words = random.below(70) as u8;
                let head = [0, 0, [b'A', b'E', 0][random.below(3) as usize], b'D', 10, 0, 0, words, 0xFF, 0xFF];
                let head = if head[2] == 0 { &head[..4] } else { &head[..] };
                let data = if head[2] == b'E' { 0 } else { 2 * usize::from(words) };
                site.partner_sends(&[head, &[7; 200][..data]].concat());
            }
        }
        assert_eq!(site.bench.station.cpu.state(), OperatingState::Run, "{params}\n{}", site.bench.log());
        // It still works, once nobody writes there any more.
        (40..116).chain([2, 3, 5, 6]).for_each(|at| site.set_byte(at, 0));
        site.bit(1, 0, true);
        site.until(|site| !site.is_set(1, 0));
    }
}
