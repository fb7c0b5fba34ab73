//! What the CP 240's manual requires of FC 0 to FC 4 and FC 9, in a whole station, in virtual time, with a partner
//! controlled by the test: what goes over the line, what the program sees, and when.

use ob1_cpu::{Cell, Width};
use ob1_tests::sim::{MS, SECOND};

use crate::cp240_blocks::{DB_10, FEHLER, RK512, SERVES, SYNCHRON, Site, rtu};

/// FC 2 while M 6.1 is set: words `LANG` MW 80 from the partner's DB 5, word 3, to `target`, word 4; `KOOR` MW 82,
/// `ANZW` MW 70, `PAFE` MB 72.
fn fetch(source: &str, target: &str) -> String {
    format!(
        "U M 6.1;\nSPBN f2;\nCALL FC 2 (ADR := 256, QDB := {source}, QBDW := W#16#3, LANG := MW 80, ZDB := {target}, \
         ZBDW := 4, KOOR := MW 82, ANZW := MW 70, PAFE := MB 72, ANZ := MW 74, GESE := MW 76, KOPF_GESE := M 73.0, \
         WART_DATEN := M 73.1, EMPF_LAEUFT := M 73.2, LETZTER_BLOCK := M 73.3, FEHL_KOM := M 73.4);\n\
         L MW 70;\nL W#16#C;\nUW;\nSPZ f2;\nR M 6.1;\nf2: NOP 0;\n"
    )
}

/// FC 3 while M 6.3 is set: words `LANG` MW 102 from `source`, word 2, to the partner's `target`, word 9; `KOOR` MW
/// 104, `ANZW` MW 90, `PAFE` MB 92.
fn send(source: &str, target: &str) -> String {
    format!(
        "U M 6.3;\nSPBN f3;\nCALL FC 3 (ADR := 256, QDB := {source}, QBDW := W#16#2, LANG := MW 102, ZDB := {target}, \
         ZBDW := 9, KOOR := MW 104, ANZW := MW 90, PAFE := MB 92, ANZ := MW 94, GESE := MW 96, KOPF_GESENET := M 93.0, \
         ERSTER_BLOCK := M 93.1, SENDEN_LAEUFT := M 93.2, SENDEN_FERTIG := M 93.3, LETZTER_BLOCK := M 93.4, \
         FEHLER := M 93.5);\nL MW 90;\nL W#16#C;\nUW;\nSPZ f3;\nR M 6.3;\nf3: NOP 0;\n"
    )
}

/// FC 0: `FRG` M 2.0, `FEHLER_KOM` M 2.4, `ANZ` MW 60, from DB 10, byte 4; `PAFE` MB 62.
const SEND: &str = "CALL FC 0 (ADR := 256, _DB := DB 10, ABD := W#16#4, ANZ := MW 60, FRG := M 2.0, GESE := MW 64, \
     ANZ_INT := MW 66, ENDE_KOMM := M 2.1, LETZTER_BLOCK := M 2.2, SENDEN_LAEUFT := M 2.3, FEHLER_KOM := M 2.4, \
     PAFE := MB 62);\n";
/// FC 1: `EMFR` M 5.0, `FEHLER_EMPF` M 3.2, `ANZ` MW 40, to DB 11, byte 0; `PAFE` MB 42, kept in MB 43.
const RECEIVE: &str = "CALL FC 1 (ADR := 256, _DB := DB 11, ABD := W#16#0, ANZ := MW 40, EMFR := M 5.0, GEEM := MW 44, \
     ANZ_INT := MW 46, EMPF_LAEUFT := M 3.0, LETZTER_BLOCK := M 3.1, FEHLER_EMPF := M 3.2, PAFE := MB 42);\n\
     L MB 42;\nL 0;\n==I;\nSPB r1;\nL MB 42;\nT MB 43;\nr1: NOP 0;\n";
const WAIT_FOR_FC_9: &str = "U M 1.0;\nBEB;\n";
const DB_11: &str = "DATA_BLOCK DB 11\nSTRUCT\nD : ARRAY [1..96] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";
const RUNNING: u16 = 0x0002;
const DONE: u16 = 0x0004;

impl Site {
    /// A station past FC 9, DB 10 filled with 1, 2, 3 ... from byte 4 on, no coordination flags.
    fn past_fc_9(params: &str, cycle: &[&str]) -> Self {
        let cycle = [&[SYNCHRON, WAIT_FOR_FC_9][..], cycle].concat().concat();
        let mut site = Self::new(params, &cycle, &[DB_10, DB_11].concat());
        site.until(|site| site.is_set(1, 0));
        site.until(|site| !site.is_set(1, 0));
        site.fill();
        site
    }

    fn fill(&mut self) {
        for n in 1..=250_u32 {
            self.bench.station.cpu.write(Cell::Db(10, 8 * (3 + n)), Width::Byte, n).expect("a byte of DB 10");
        }
        self.set_word(82, 0xFFFF);
        self.set_word(104, 0xFFFF);
    }

    fn telegrams(&self) -> &[Vec<u8>] {
        &self.bench.device.telegrams
    }

    /// Gives an order of FC 2 or FC 3 and waits until the partner has its telegram.
    fn orders(&mut self, bit: u32, words: u16) {
        self.bench.device.telegrams.clear();
        self.set_word(if bit == 1 { 80 } else { 102 }, words);
        self.bit(6, bit, true);
        self.until(|site| !site.telegrams().is_empty());
    }

    /// An order that fails before anything is sent: its indicator word.
    fn refused(&mut self, bit: u32, words: u16) -> u16 {
        let (lang, anzw) = if bit == 1 { (80, 70) } else { (102, 90) };
        self.set_word(lang, words);
        self.bit(6, bit, true);
        self.bench.pass(200 * MS);
        self.word(anzw)
    }

    fn says(&mut self, characters: Vec<u8>) {
        self.bench.meanwhile(|_, _, out| {
            out.extend(characters);
            None
        });
    }

    fn data(&self, number: u16) -> &[u8] {
        self.bench.station.cpu.data_block(number).expect("a block of the program")
    }
}

const FETCH_HEADER: [u8; 10] = [0, 0, b'E', b'D', 5, 3, 0, 2, 0xFF, 0xFF];
const SEND_2_WORDS: [u8; 14] = [0, 0, b'A', b'D', 7, 9, 0, 2, 0xFF, 0xFF, 1, 2, 3, 4];
const TAKEN: [u8; 4] = [0; 4];

/// [S0 L1141-L1153], [S0 L1304-L1316]: "running" until the data are in the data block, then "ready"; the next order
/// deletes that.
#[test]
fn a_fetch_from_the_partner() {
    let mut site = Site::past_fc_9(RK512, &[&fetch("DB 5", "DB 11")]);
    assert_eq!(site.word(70), 0, "nothing is ordered");
    for round in 0..2_u8 {
        site.orders(1, 2);
        assert_eq!(site.telegrams(), [FETCH_HEADER], "source by QDB, QBDW and LANG");
        assert_eq!(site.word(70), RUNNING);
        site.bench.pass(SECOND);
        assert_eq!((site.word(70), site.telegrams().len()), (RUNNING, 1), "one order, as often as the block is called");
        site.partner_sends(&[0, 0, 0, 0, 0xAA, 0xBB, 0xCC, round]);
        site.until(|site| site.word(70) != RUNNING);
        assert_eq!((site.word(70), site.word(72) >> 8), (DONE, 0));
        assert_eq!(site.data(11)[6..14], [0, 0, 0xAA, 0xBB, 0xCC, round, 0, 0], "target by ZDB and ZBDW, in words");
        site.bench.pass(SECOND);
        assert_eq!((site.word(70), site.telegrams().len(), site.is_set(6, 1)), (DONE, 1, false));
    }
}

/// [S0 L1191-L1200], [S0 L1684-L1711]: header and data in one telegram, "ready" with the partner's reaction.
#[test]
fn a_send_to_the_partner() {
    let mut site = Site::past_fc_9(RK512, &[&send("DB 10", "DB 7")]);
    for _ in 0..2 {
        site.orders(3, 2);
        assert_eq!(site.telegrams(), [SEND_2_WORDS], "source by QDB, QBDW and LANG, target by ZDB and ZBDW");
        site.bench.pass(SECOND);
        assert_eq!((site.word(90), site.telegrams().len()), (RUNNING, 1));
        site.partner_sends(&TAKEN);
        site.until(|site| site.word(90) != RUNNING);
        assert_eq!((site.word(90), site.word(92) >> 8), (DONE, 0));
    }
    // 65 words are two telegrams.
    site.orders(3, 65);
    site.partner_sends(&TAKEN);
    site.until(|site| site.telegrams().len() == 2);
    assert_eq!(
        site.telegrams()[0],
        [&[0, 0, b'A', b'D', 7, 9, 0, 65, 0xFF, 0xFF][..], &site.data(10)[4..132]].concat()
    );
    assert_eq!(site.telegrams()[1], [&[0xFF, 0, b'A', b'D'][..], &site.data(10)[132..134]].concat());
    assert_eq!(site.word(90), RUNNING);
    site.partner_sends(&[0xFF, 0, 0, 0]);
    site.until(|site| site.word(90) == DONE);
}

/// [S0 L1291-L1301], [S0 L1317-L1322]: bit 3 and the number; the next order deletes both.
#[test]
fn an_order_that_fails_has_its_number_in_anzw() {
    let program = [fetch("DB 5", "DB 11"), send("DB 10", "DB 7")].concat();
    let mut site = Site::past_fc_9(RK512, &[&program]);
    for (bit, anzw) in [(1, 70), (3, 90)] {
        // Refused by the partner.
        for number in [0x0A, 0x0C, 0x10, 0x14, 0x32, 0x36] {
            site.orders(bit, 2);
            assert_eq!(site.word(anzw), RUNNING, "the number before is deleted");
            site.partner_sends(&[0, 0, 0, number]);
            site.until(|site| site.word(anzw) != RUNNING);
            assert_eq!(site.word(anzw), u16::from(number) << 8 | 8);
        }
        // Too long: nothing goes out.
        site.bench.device.telegrams.clear();
        assert_eq!(site.refused(bit, 513), 0x1708);
        assert!(site.telegrams().is_empty());
    }
    // The partner acknowledges each request and does not react: DBL is used up.
    let params = "{ protocol = \"3964r-rk512\", baud = 115200, priority = \"high\", bwz_ms = 200, dbl = 3 }";
    let mut site = Site::past_fc_9(params, &[&program]);
    for (bit, anzw) in [(1, 70), (3, 90)] {
        site.orders(bit, 2);
        site.until(|site| site.word(anzw) != RUNNING);
        assert_eq!((site.word(anzw), site.telegrams().len()), (0x0A08, 3));
    }
    // It does not even acknowledge: the partner of the bench answers 3964R alone.
    let mut site = Site::past_fc_9("{ protocol = \"3964-rk512\", baud = 115200 }", &[&program]);
    for (bit, anzw) in [(1, 70), (3, 90)] {
        site.bench.device.heard.clear();
        assert_eq!(site.refused(bit, 2), RUNNING);
        site.until(|site| site.word(anzw) != RUNNING);
        assert_eq!((site.word(anzw), &site.bench.device.heard[..]), (0x0708, &[2, 2, 2, 2, 2, 2, 0x15][..]));
    }
}

/// [S0 L1302-L1310]: the second order is blocked until the first has ended, and each has its own indicator word.
#[test]
fn one_order_at_a_time() {
    let mut site = Site::past_fc_9(RK512, &[&fetch("DB 5", "DB 11"), &send("DB 10", "DB 7")]);
    site.orders(1, 2);
    site.set_word(102, 2);
    site.bit(6, 3, true);
    site.bench.pass(SECOND);
    assert_eq!((site.word(70), site.word(90)), (RUNNING, RUNNING), "running, and blocked");
    assert_eq!(site.telegrams(), [FETCH_HEADER]);
    site.partner_sends(&[0, 0, 0, 0, 1, 2, 3, 4]);
    site.until(|site| site.telegrams().len() == 2);
    assert_eq!((site.word(70), site.word(90)), (DONE, RUNNING));
    assert_eq!(site.telegrams()[1], SEND_2_WORDS);
    site.partner_sends(&TAKEN);
    site.until(|site| site.word(90) == DONE);
    assert_eq!(site.word(70), DONE);
}

/// [S0 L1297]: 00h with bit 3, where the control bits lie outside of STEUERB_S and STEUERB_R.
#[test]
fn an_order_that_a_reset_ends() {
    let mut site = Site::past_fc_9(RK512, &[&send("DB 10", "DB 7")]);
    site.orders(3, 2);
    site.bit(1, 2, true);
    site.until(|site| !site.is_set(1, 2) && !site.is_set(1, 0));
    site.until(|site| site.word(90) != RUNNING);
    assert_eq!(site.word(90), 0x0008);
    // Given again, it arrives.
    site.orders(3, 2);
    assert_eq!(site.telegrams(), [SEND_2_WORDS]);
    site.partner_sends(&TAKEN);
    site.until(|site| site.word(90) == DONE);
}

/// [S0 L1185], [S0 L1235]: 1, 2, 3, nothing goes out, and 0 when the cause is gone.
#[test]
fn pafe_of_fc_2_and_fc_3() {
    for (program, bit, pafe) in [
        (fetch("DB 5", "DB 99"), 1, 1),
        (fetch("DB 300", "DB 11"), 1, 3),
        (send("DB 99", "DB 7"), 3, 1),
        (send("DB 10", "DB 300"), 3, 3),
    ] {
        let mut site = Site::past_fc_9(RK512, &[&program]);
        site.refused(bit, 2);
        assert_eq!(site.word(if bit == 1 { 72 } else { 92 }) >> 8, pafe, "{program}");
        assert!(site.bench.device.heard.is_empty(), "{program}");
    }
    for (program, bit, byte, answer) in
        [(fetch("DB 5", "DB 11"), 1, 72, &[0, 0, 0, 0, 1, 2, 3, 4][..]), (send("DB 11", "DB 7"), 3, 92, &TAKEN[..])]
    {
        let mut site = Site::past_fc_9(RK512, &[&program]);
        site.refused(bit, 50);
        assert_eq!((site.word(byte) >> 8, site.bench.device.heard.len()), (2, 0), "{program}");
        site.orders(bit, 2);
        assert_eq!(site.word(byte) >> 8, 0, "{program}");
        site.partner_sends(answer);
        site.until(|site| site.word(byte - 2) == DONE);
    }
}

/// [S0 L1183], [S0 L1233], [S0 L1796]: the flag goes out with the order. Here it is set with the data of an order of
/// the partner; then each order that names it is refused with 32h until the program has reset it.
#[test]
fn the_coordination_flag() {
    let mut site = Site::past_fc_9(RK512, &[&fetch("DB 5", "DB 11"), &send("DB 10", "DB 7"), SERVES]);
    for (bit, koor, anzw, answer) in [(1, 82, 70, &[0, 0, 0, 0, 1, 2, 3, 4][..]), (3, 104, 90, &TAKEN[..])] {
        site.set_word(koor, 0x0604);
        site.orders(bit, 2);
        assert_eq!(site.telegrams()[0][8..10], [6, 4], "M 6.4 in the partner");
        site.partner_sends(answer);
        site.until(|site| site.word(anzw) == DONE);
    }
    let order = |site: &mut Site, telegram: &[u8]| {
        site.bench.device.telegrams.clear();
        site.partner_sends(telegram);
        site.until(|site| !site.telegrams().is_empty());
        site.bench.pass(100 * MS);
        site.telegrams()[0].clone()
    };
    let stores = |first| [0, 0, b'A', b'D', 11, 0, 0, 1, 120, 0, first, 2];
    assert_eq!(order(&mut site, &stores(1)), TAKEN);
    assert_eq!((&site.data(11)[..2], site.is_set(120, 0)), (&[1, 2][..], true));
    assert_eq!(order(&mut site, &stores(9)), [0, 0, 0, 0x32]);
    assert_eq!(order(&mut site, &[0, 0, b'E', b'D', 11, 0, 0, 1, 120, 0]), [0, 0, 0, 0x32], "nor are data given");
    assert_eq!(site.data(11)[0], 1, "not stored");
    assert_eq!(order(&mut site, &[0, 0, b'E', b'D', 11, 0, 0, 1, 0xFF, 0xFF]), [0, 0, 0, 0, 1, 2], "FFFFh: no flag");
    site.bit(120, 0, false);
    assert_eq!(order(&mut site, &stores(9)), TAKEN);
    assert_eq!((site.data(11)[0], site.is_set(120, 0)), (9, true));
}

/// [S0 L1238], [S0 L1259]: FC 4 stores what the partner sends and gives what it fetches.
#[test]
fn a_partner_is_served() {
    let mut site = Site::past_fc_9(RK512, &[SERVES]);
    site.partner_sends(&[0, 0, b'A', b'D', 11, 2, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    site.until(|site| !site.telegrams().is_empty());
    assert_eq!((site.telegrams(), &site.data(11)[2..10]), (&[TAKEN.to_vec()][..], &b"\0\0abcd\0\0"[..]));
    site.until(|site| site.word(40) == DONE);
    for (area, db, start, units, data) in
        [(b'D', 10, 2, 2, vec![1, 2, 3, 4]), (b'M', 0, 82, 2, vec![0xFF, 0xFF]), (b'D', 11, 2, 1, b"ab".to_vec())]
    {
        site.bench.device.telegrams.clear();
        site.partner_sends(&[0, 0, b'E', area, db, start, 0, units, 0xFF, 0xFF]);
        site.until(|site| !site.telegrams().is_empty());
        assert_eq!(site.telegrams(), [[&TAKEN[..], &data].concat()], "{}", area as char);
        site.until(|site| site.word(40) == DONE);
        assert!(!site.is_set(52, FEHLER));
    }
}

/// [S0 L1262-L1266]: a data block that is not there, or too short, for the partner's order.
#[test]
fn a_partner_that_asks_for_what_is_not_there() {
    let keeps = "L MB 42;\nL 0;\n==I;\nSPB k1;\nL MB 42;\nT MB 60;\nk1: NOP 0;\n";
    let mut site = Site::past_fc_9(RK512, &[SERVES, keeps]);
    for (telegram, pafe) in [
        (&[0, 0, b'E', b'D', 99, 0, 0, 1, 0xFF, 0xFF][..], 1),
        (&[0, 0, b'E', b'D', 11, 47, 0, 2, 0xFF, 0xFF], 2),
        (&[0, 0, b'A', b'D', 99, 0, 0, 1, 0xFF, 0xFF, 1, 2], 1),
        (&[0, 0, b'A', b'D', 11, 48, 0, 1, 0xFF, 0xFF, 1, 2], 2),
    ] {
        site.set_byte(60, 0);
        site.bench.device.telegrams.clear();
        site.partner_sends(telegram);
        site.until(|site| !site.telegrams().is_empty());
        assert_eq!(site.telegrams(), [[0, 0, 0, 0x14]]);
        site.until(|site| site.word(40) == 0x1408);
        assert_eq!((site.word(60) >> 8, site.is_set(52, FEHLER)), (pafe, true), "{telegram:02X?}");
    }
    // The next order that can be served takes PAFE back.
    site.partner_sends(&[0, 0, b'E', b'D', 11, 47, 0, 1, 0xFF, 0xFF]);
    site.until(|site| site.word(40) == DONE);
    assert_eq!((site.word(42) >> 8, site.is_set(52, FEHLER)), (0, false));
}

/// [S0 L962], [S0 L1572]: sent once, and FRG is taken back when the last bit is out and ZNA has expired.
#[test]
fn frg_is_taken_back_when_zna_has_run_out() {
    let mut site = Site::past_fc_9("{ protocol = \"ascii\", baud = 9600, zna_ms = 400 }", &[SEND]);
    site.set_word(60, 5);
    site.bit(2, 0, true);
    site.until(|site| site.bench.device.heard.len() == 5);
    assert_eq!(site.bench.device.heard, [1, 2, 3, 4, 5]);
    site.bench.pass(380 * MS);
    assert!(site.is_set(2, 0) && site.is_set(2, 3), "ZNA runs");
    site.bench.pass(60 * MS);
    assert!(!site.is_set(2, 0) && !site.is_set(2, 3) && !site.is_set(2, 4));
    site.bench.pass(2 * SECOND);
    assert_eq!(site.bench.device.heard.len(), 5, "once");
}

/// [S0 L1067-L1069], [S0 L1421]: no telegram goes or comes before FC 9 has synchronised.
#[test]
fn nothing_goes_before_fc_9_has_ended() {
    let cycle = ["U M 6.0;\nSPBN s9;\n", SYNCHRON, "s9: NOP 0;\n", SEND, RECEIVE].concat();
    let mut site = Site::new("{ protocol = \"ascii\", baud = 9600, zvz_ms = 20 }", &cycle, &[DB_10, DB_11].concat());
    site.bench.pass(100 * MS);
    site.fill();
    site.set_word(60, 5);
    site.bit(2, 0, true);
    site.bench.pass(2 * SECOND);
    site.says(b"early".to_vec());
    site.bench.pass(2 * SECOND);
    assert!(site.bench.device.heard.is_empty() && site.is_set(2, 0) && !site.is_set(2, 4), "the order waits");
    assert!(!site.is_set(5, 0));
    site.bit(6, 0, true);
    site.until(|site| !site.is_set(1, 0));
    // The order that waited went, and the end of FC 9 has cleared its bits: the manual's program leaves by BEB.
    site.bench.pass(100 * MS);
    site.bench.device.heard.clear();
    site.bit(2, 0, true);
    site.until(|site| site.bench.device.heard.len() == 5 && !site.is_set(2, 0));
    site.says(b"late".to_vec());
    site.until(|site| site.is_set(5, 0));
    assert_eq!((site.word(40), &site.data(11)[..4]), (4, &b"late"[..]), "what came before is not kept");
}

/// [S0 L1408-L1417]: each protocol has its blocks. Others end their job with an error, and nothing goes out.
#[test]
fn blocks_that_do_not_fit_the_protocol() {
    let program = [&fetch("DB 5", "DB 11"), &send("DB 10", "DB 7"), SEND].concat();
    let mut site = Site::past_fc_9(RK512, &[&program]);
    site.set_word(60, 5);
    site.bit(2, 0, true);
    site.until(|site| !site.is_set(2, 0));
    assert!(site.is_set(2, 4) && site.bench.device.heard.is_empty(), "FC 0 with RK 512");
    for params in ["{ protocol = \"3964r\", baud = 9600 }", "{ protocol = \"ascii\", baud = 9600 }"] {
        let mut site = Site::past_fc_9(params, &[&program]);
        assert_eq!((site.refused(1, 2), site.refused(3, 2)), (0x0C08, 0x0C08), "FC 2 and FC 3 with {params}");
        assert!(site.bench.device.heard.is_empty());
        // ANZ OR 4000h is for the Modbus slave "long".
        site.set_word(60, 0x4005);
        site.bit(2, 0, true);
        site.until(|site| !site.is_set(2, 0));
        assert!(site.is_set(2, 4) && site.bench.device.heard.is_empty(), "{params}");
    }
}

/// [S0 L2070-L2075], [S0 L2263-L2281], [S0 L2311-L2313], [S0 L2622-L2624]: the slave "long" with its program.
#[test]
fn a_slave_long_stores_and_gives() {
    let mut site = Site::new(
        "{ protocol = \"modbus-slave-rtu-long\", baud = 9600 }",
        &[SEND, RECEIVE].concat(),
        &[DB_10, DB_11].concat(),
    );
    site.bench.pass(100 * MS);
    site.fill();
    let asks = |site: &mut Site, telegram: &[u8]| {
        site.bench.device.heard.clear();
        site.says(rtu(telegram));
        site.bench.pass(500 * MS);
        site.bench.device.heard.clone()
    };
    // SEND: the input area from 0 on; with 4000h the output area.
    for (anz, code) in [(4, 4), (0x4006, 3)] {
        assert_eq!(asks(&mut site, &[1, code, 0, 0, 0, 1]), rtu(&[1, code, 2, 0, 0]));
        site.set_word(60, anz);
        site.bit(2, 0, true);
        site.until(|site| !site.is_set(2, 0));
        assert!(!site.is_set(2, 4));
        assert_eq!(asks(&mut site, &[1, code, 0, 0, 0, 2]), rtu(&[1, code, 4, 1, 2, 3, 4]));
    }
    assert!(!site.is_set(5, 0), "the CPU knows what it has sent");
    // A word of the master: its block of 8 bytes is in the data block, and then the master has its answer.
    assert_eq!(asks(&mut site, &[1, 6, 0, 20, 0xAB, 0xCD]), rtu(&[1, 6, 0, 20, 0xAB, 0xCD]));
    assert!(site.is_set(5, 0) && !site.is_set(3, 2));
    assert_eq!(site.data(11)[40..48], [0xAB, 0xCD, 0, 0, 0, 0, 0, 0]);
    // While EMFR is 1 the next change waits in the CP, and the master with it.
    assert!(asks(&mut site, &[1, 6, 0, 21, 0x12, 0x34]).is_empty());
    site.bit(5, 0, false);
    site.until(|site| site.bench.device.heard == rtu(&[1, 6, 0, 21, 0x12, 0x34]));
    assert_eq!(site.data(11)[40..44], [0xAB, 0xCD, 0x12, 0x34]);
    site.bit(5, 0, false);
    // Outside of the 96 bytes: a range error here, exception 02h there.
    site.set_byte(43, 0);
    assert_eq!(asks(&mut site, &[1, 6, 0, 48, 0xAB, 0xCD]), rtu(&[1, 0x86, 2]));
    assert!(site.is_set(3, 2) && !site.is_set(5, 0), "FEHLER_EMPF");
    assert_eq!(site.word(43) >> 8, 2, "PAFE");
}
