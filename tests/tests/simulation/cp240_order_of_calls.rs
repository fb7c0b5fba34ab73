//! The handling blocks of the CP 240 in any order and frequency of calls, in a whole station and in virtual time: no
//! block starves another one, nothing is lost, nothing is taken twice.

use ob1_tests::sim::{MS, SECOND};

use crate::cp240_blocks::{DB_10, RK512, SERVES, SYNCHRON, Site};

const ASCII: &str = "{ protocol = \"ascii\", baud = 115200, zna_ms = 0 }";

/// FC 0 as in the manual, with its control bits in MB `bits`, its words from MW `words` on, and its data in DB `db`.
fn send(db: u32, bits: u32, words: u32) -> String {
    format!(
        "CALL FC 0 (ADR := 256, _DB := DB {db}, ABD := W#16#0, ANZ := MW {words}, FRG := M {bits}.0, GESE := MW {}, \
         ANZ_INT := MW {}, ENDE_KOM := M {bits}.1, LETZTER_BLOCK := M {bits}.2, SENDEN_LAEUFT := M {bits}.3, \
         FEHLER_KOM := M {bits}.4, PAFE := MB {});\n",
        words + 2,
        words + 4,
        words + 6
    )
}

/// FC 1 into DB `db`, with its control bits in MB `bits` and its words from MW `words` on.
fn receive(db: u32, bits: u32, words: u32) -> String {
    format!(
        "CALL FC 1 (ADR := 256, _DB := DB {db}, ABD := W#16#0, ANZ := MW {words}, EMFR := M {bits}.0, GEEM := MW {}, \
         ANZ_INT := MW {}, EMPF_LAEUFT := M {bits}.1, LETZTER_BLOCK := M {bits}.2, FEHLER_EMPF := M {bits}.3, \
         PAFE := MB {});\n",
        words + 2,
        words + 4,
        words + 6
    )
}

/// FC 8; START M 110.4, AUFTRAG_LAEU M 110.5, STATUS MB 111.
const LINES: &str = "CALL FC 8 (ADR := 256, RTS := M 110.0, DTR := M 110.1, MASKE_RTS := M 110.2, \
     MASKE_DTR := M 110.3, STATUS := MB 111, DELTA_STATUS := MB 112, START := M 110.4, AUFTRAG_LAEU := M 110.5, \
     RET_VAL := MW 114);\n";
const FRG: (usize, u32) = (2, 0);
const SEND_BITS: u32 = 2;
const FEHLER_KOM: u32 = 4;
const START: (usize, u32) = (110, 4);

/// Another data block as long as DB 10.
fn db(number: u32) -> String {
    DB_10.replace("DB 10", &format!("DB {number}"))
}

/// Calls these only in every `n`-th scan, counted in MW `counter`.
fn every(n: u32, counter: u32, calls: &str) -> String {
    format!(
        "L MW {counter};\nL 1;\n+I;\nL {n};\nMOD;\nT MW {counter};\nL 0;\n<>I;\nSPB x{counter};\n{calls}x{counter}: NOP 0;\n"
    )
}

/// Calls these only while this bit of the memory is 0.
fn unless(bit: (usize, u32), calls: &str) -> String {
    format!("U M {}.{};\nSPB u{};\n{calls}u{}: NOP 0;\n", bit.0, bit.1, bit.0, bit.0)
}

fn site(min_cycle: u32, params: &str, cycle: &str, blocks: &str) -> Site {
    let mut site = Site::timed(min_cycle, params, &[SYNCHRON, "U M 1.0;\nBEB;\n", cycle].concat(), blocks);
    site.until(|site| site.is_set(1, 0));
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(50 * MS);
    site
}

/// Gives an order of FC 0 and waits for its end: it is done, and all its characters are on the line.
fn sends(site: &mut Site, bits: u32, words: u32, bytes: u16, what: &str) {
    let before = site.bench.device.heard.len();
    site.set_word(words, bytes);
    site.bit(bits, FRG.1, true);
    let (byte, most) = (bits as usize, 1000);
    for _ in 0..most {
        site.bench.pass(MS);
        if !site.is_set(byte, FRG.1) {
            break;
        }
    }
    assert!(!site.is_set(byte, FRG.1), "{what}: FRG stays\n{}", site.bench.log());
    assert!(!site.is_set(byte, FEHLER_KOM), "{what}: FEHLER_KOM");
    site.bench.pass(5 * MS);
    assert_eq!(site.bench.device.heard.len() - before, usize::from(bytes), "{what}");
}

/// [S0 L1035]: "This block must not be called as long as a transmit command is running". A program that obeys, one that
/// does not, one that calls it once: FC 0 sends.
#[test]
fn fc_8_never_holds_up_fc_0() {
    let blocks = [db(10), db(11)].concat();
    let (fc0, fc1) = (send(10, SEND_BITS, 40), receive(11, 3, 60));
    let fc8 = [
        ("each", LINES.to_owned()),
        ("while FRG = 0", unless(FRG, LINES)),
        ("every third", every(3, 80, LINES)),
        ("every seventh", every(7, 80, LINES)),
        ("once", format!("{}SET;\nS M 70.0;\n", unless((70, 0), LINES))),
    ];
    for cycle in [1, 5, 10] {
        for (how, fc8) in &fc8 {
            for order in [[fc8, &fc0, &fc1], [&fc0, fc8, &fc1], [&fc1, &fc0, fc8]] {
                let calls = order.map(String::as_str).concat();
                let mut site = site(cycle, ASCII, &calls, &blocks);
                for n in 0..4 {
                    site.bench.pass(n * MS);
                    sends(&mut site, SEND_BITS, 40, 20, &format!("{how} scan of {cycle} ms, {calls}"));
                }
                assert!(*how == "once" || site.is_set(111, 5), "{how} {cycle}: STATUS was read");
            }
        }
    }
}

/// The same with one of the two in OB 35, and FC 0 only in each n-th scan.
#[test]
fn fc_8_and_fc_0_in_different_levels() {
    let in_ob_35 = |calls: &str| {
        format!("{}ORGANIZATION_BLOCK OB 35\nBEGIN\nU M 1.0;\nBEB;\n{calls}END_ORGANIZATION_BLOCK\n", db(10))
    };
    let fc0 = send(10, SEND_BITS, 40);
    for cycle in [1, 5, 10] {
        for (what, ob_1, ob_35) in [
            ("FC 8 in OB 35", fc0.clone(), LINES.to_owned()),
            ("FC 0 in OB 35", LINES.to_owned(), fc0.clone()),
            ("FC 0 each third scan", [LINES, &every(3, 80, &fc0)].concat(), LINES.to_owned()),
            ("FC 8 each second in OB 35", fc0.clone(), every(2, 80, LINES)),
        ] {
            let mut site = site(cycle, ASCII, &ob_1, &in_ob_35(&ob_35));
            for _ in 0..4 {
                sends(&mut site, SEND_BITS, 40, 20, &format!("{what}, {cycle} ms"));
            }
        }
    }
}

/// A program that sends without a pause does not keep FC 8 from switching and reading, however rarely it is called.
#[test]
fn fc_0_never_holds_up_fc_8() {
    for n in [1, 2, 7, 10, 11] {
        let cycle = [&send(10, SEND_BITS, 40)[..], "SET;\nS M 2.0;\n", &every(n, 80, LINES)].concat();
        let mut site = site(2, ASCII, &cycle, &db(10));
        site.set_word(40, 20);
        site.bench.pass(SECOND);
        assert!(site.is_set(111, 5), "every {n}: RTS is read");
        // RTS off: MASKE_RTS.
        site.bit(110, 2, true);
        site.bit(START.0 as u32, START.1, true);
        site.bench.pass(SECOND);
        assert!(!site.is_set(START.0, START.1) && !site.is_set(110, 5), "every {n}: START");
        site.bench.pass(SECOND);
        assert!(!site.is_set(111, 5), "every {n}: RTS is off");
        let heard = site.bench.device.heard.len();
        assert!(heard > 100 && !site.is_set(2, FEHLER_KOM), "every {n}: {heard}");
    }
}

/// [S0 L2287]: a Modbus master has a SEND data block for each slave. Orders given in one scan are sent one after the
/// other, each once; a block that is called rarely gets its turn, too.
#[test]
fn several_fc_0_take_turns() {
    let blocks = [db(10), db(11), db(12)].concat();
    let fc0 = [send(10, 2, 40), send(11, 5, 50), send(12, 6, 60)];
    for (what, third) in [("each", fc0[2].clone()), ("every ninth", every(9, 80, &fc0[2]))] {
        let mut site = site(2, ASCII, &[&fc0[0][..], &fc0[1], &third].concat(), &blocks);
        for (bits, words, bytes) in [(2, 40, 10), (5, 50, 30), (6, 60, 100)] {
            site.set_word(words, bytes);
            site.bit(bits, 0, true);
        }
        site.until(|site| [2, 5, 6].iter().all(|bits| !site.is_set(*bits, 0)));
        site.bench.pass(20 * MS);
        assert_eq!(site.bench.device.heard.len(), 140, "{what}");
        assert!([2, 5, 6].iter().all(|bits| !site.is_set(*bits, FEHLER_KOM)), "{what}");
    }
    // Two that always want to send do not starve the third.
    let always = "SET;\nS M 2.0;\nS M 5.0;\n";
    let mut site = site(2, ASCII, &[&fc0[0][..], &fc0[1], always, &every(9, 80, &fc0[2])].concat(), &blocks);
    site.set_word(40, 10);
    site.set_word(50, 10);
    for _ in 0..5 {
        site.set_word(60, 100);
        site.bit(6, 0, true);
        site.bench.pass(2 * SECOND);
        assert!(!site.is_set(6, 0) && !site.is_set(6, FEHLER_KOM));
    }
}

/// A program that stops calling FC 0 in the middle of its job, or takes FRG back: after two seconds another block gets
/// `TX`. When FC 0 comes back its job has failed if the CP did not have the whole telegram, and it never continues a
/// job of another one.
#[test]
fn a_job_that_is_abandoned() {
    let blocks = [db(10), db(11)].concat();
    let slow = "{ protocol = \"ascii\", baud = 1200 }";
    for scans in [1, 4, 20, 150] {
        let cycle = [&unless((70, 0), &send(10, 2, 40))[..], &send(11, 5, 50), LINES].concat();
        let mut site = site(2, slow, &cycle, &blocks);
        site.bit(110, 2, true);
        site.set_word(40, 40);
        site.bit(2, 0, true);
        site.bench.pass(2 * scans * MS);
        site.bit(70, 0, true);
        site.bit(START.0 as u32, START.1, true);
        site.set_word(50, 40);
        site.bit(5, 0, true);
        site.until(|site| !site.is_set(5, 0) && !site.is_set(START.0, START.1));
        assert!(!site.is_set(5, FEHLER_KOM), "{scans}: the second has sent");
        // A job of the second one is in the same phase when the first comes back.
        site.bit(5, 0, true);
        site.bench.pass(2 * scans * MS);
        site.bit(70, 0, false);
        site.until(|site| !site.is_set(2, 0) && !site.is_set(5, 0));
        // The CP had the whole telegram after 20 scans and has sent it.
        assert_eq!((site.is_set(2, FEHLER_KOM), site.is_set(5, FEHLER_KOM)), (scans < 20, false), "{scans}");
        sends(&mut site, 2, 40, 10, "and it works again");
    }
}

/// FC 0 is not called while its telegram is on the line, and another block gets `TX` meanwhile: FC 0 is told how its
/// order has ended, so that nothing is sent twice.
#[test]
fn a_telegram_that_ends_while_fc_0_is_not_called() {
    let blocks = [db(10), db(11)].concat();
    for (params, failed) in
        [("{ protocol = \"3964r\", baud = 9600 }", false), ("{ protocol = \"3964\", baud = 9600 }", true)]
    {
        let cycle = [&unless((70, 0), &send(10, 2, 40))[..], &send(11, 5, 50), LINES].concat();
        let mut site = site(2, params, &cycle, &blocks);
        site.set_word(40, 20);
        site.bit(2, 0, true);
        site.until(|site| site.is_set(2, 1));
        site.bit(70, 0, true);
        site.bench.pass(15 * SECOND);
        site.bit(START.0 as u32, START.1, true);
        site.until(|site| !site.is_set(START.0, START.1));
        site.bit(70, 0, false);
        site.until(|site| !site.is_set(2, 0));
        assert_eq!((site.is_set(2, FEHLER_KOM), site.bench.device.telegrams.len()), (failed, usize::from(!failed)));
    }
}

/// The program gives a job up by resetting its control bits, and sends another telegram at once.
#[test]
fn control_bits_that_the_program_resets() {
    for scans in [1, 2, 3, 6] {
        let mut site = site(2, ASCII, &send(10, 2, 40), &db(10));
        site.set_word(40, 40);
        site.bit(2, 0, true);
        site.bench.pass(2 * scans * MS);
        (0..5).for_each(|bit| site.bit(2, bit, false));
        site.bench.pass(20 * MS);
        site.bench.device.heard.clear();
        sends(&mut site, 2, 40, 10, "at once");
    }
}

/// Two FC 1 with data blocks of their own: a telegram is for one of them, whole.
#[test]
fn two_fc_1_take_a_telegram_once() {
    let blocks = [db(10), db(11)].concat();
    let first = unless((70, 0), &receive(10, 5, 40));
    let mut site = site(2, ASCII, &[&first[..], &receive(11, 6, 50)].concat(), &blocks);
    let telegram = |site: &mut Site, bytes: &[u8]| {
        let bytes = bytes.to_vec();
        site.bench.meanwhile(|_, _, out| {
            out.extend(bytes);
            None
        });
    };
    telegram(&mut site, &[7; 30]);
    site.bench.pass(SECOND);
    assert_eq!((site.is_set(5, 0), site.word(40), site.is_set(6, 0)), (true, 30, false));
    // While EMFR of the first is 1 the next one is for the second.
    telegram(&mut site, &[8; 40]);
    site.bench.pass(SECOND);
    assert_eq!((site.is_set(6, 0), site.word(50)), (true, 40));
    // The first is no longer called in the middle of its telegram: the next telegram comes whole.
    site.bit(5, 0, false);
    site.bit(6, 0, false);
    telegram(&mut site, &[9; 300]);
    site.until(|site| site.word(42) >= 24);
    site.bit(70, 0, true);
    site.bench.pass(4 * SECOND);
    assert!(!site.is_set(6, 0), "no rest of a telegram");
    telegram(&mut site, &[1; 50]);
    site.bench.pass(SECOND);
    assert_eq!((site.is_set(6, 0), site.word(50)), (true, 50));
    site.bit(70, 0, false);
    site.bench.pass(20 * MS);
    assert_eq!((site.is_set(5, 0), site.is_set(5, 1), site.is_set(5, 3)), (false, false, true), "FEHLER_EMPF");
}

/// FC 3 as long as M 6.1 is set, until its order has ended.
const ORDER: &str = "U M 6.1;\nSPBN f3;\nCALL FC 3 (ADR := 256, QDB := DB 10, QBDW := W#16#0, LANG := 10, ZDB := DB 5, \
     ZBDW := 0, KOOR := W#16#FFFF, ANZW := MW 90, PAFE := MB 92, ANZ := MW 94, GESE := MW 96, KOPF_GESENET := M 93.0, \
     ERSTER_BLOCK := M 93.1, SENDEN_LAEUFT := M 93.2, SENDEN_FERTIG := M 93.3, LETZTER_BLOCK := M 93.4, \
     FEHLER := M 93.5);\nL MW 90;\nL W#16#C;\nUW;\nSPZ f3;\nR M 6.1;\nf3: NOP 0;\n";

/// FC 3 gives an order; the partner says "done".
fn orders(site: &mut Site, what: &str) {
    site.bench.device.telegrams.clear();
    site.bit(6, 1, true);
    site.bench.pass(300 * MS);
    assert_eq!(site.bench.device.telegrams.len(), 1, "{what}: ANZW {:04X}h\n{}", site.word(90), site.bench.log());
    site.partner_sends(&[0; 4]);
    site.bench.pass(300 * MS);
    assert_eq!((site.word(90), site.is_set(6, 1)), (0x0004, false), "{what}");
}

/// The partner gives an order; FC 4 carries it out.
fn serves(site: &mut Site, what: &str) {
    site.bench.device.telegrams.clear();
    site.partner_sends(&[0, 0, b'A', b'D', 10, 0, 0, 1, 0xFF, 0xFF, 1, 2]);
    site.bench.pass(500 * MS);
    assert!(site.bench.device.telegrams.contains(&vec![0; 4]), "{what}: {:?}", site.bench.device.telegrams);
}

/// RK 512: FC 8 in each scan, rarely, once; before, behind and between FC 3 and FC 4.
#[test]
fn fc_8_never_holds_up_an_order_of_rk_512() {
    let fc4 = SERVES.replace("U M 1.0;\nBEB;\nU M 4.0;\nBEB;\n", "");
    for (how, fc8) in [
        ("each", LINES.to_owned()),
        ("once", format!("{}SET;\nS M 70.0;\n", unless((70, 0), LINES))),
        ("every third", every(3, 80, LINES)),
    ] {
        for cycle in [1, 5] {
            for order in [[&fc8[..], ORDER, &fc4], [ORDER, &fc4, &fc8], [&fc4, &fc8, ORDER]] {
                let mut site = site(cycle, RK512, &order.concat(), &db(10));
                for _ in 0..3 {
                    orders(&mut site, how);
                    serves(&mut site, how);
                }
                assert!(how == "once" || site.is_set(111, 5), "{how}: STATUS was read");
            }
        }
    }
}

/// FC 3 is no longer called: while it passes its order, while it waits for the result, while the result is there. FC 4
/// serves the partner all the same, and the order of FC 3 is lost (00h).
#[test]
fn an_order_that_is_abandoned() {
    let fc4 = SERVES.replace("U M 1.0;\nBEB;\nU M 4.0;\nBEB;\n", "");
    for scans in 1..12 {
        let mut site = site(2, RK512, &[&unless((70, 0), ORDER)[..], &fc4].concat(), &db(10));
        site.bit(6, 1, true);
        site.bench.pass(2 * scans * MS);
        site.bit(70, 0, true);
        site.bench.pass(300 * MS);
        let is_out = !site.bench.device.telegrams.is_empty();
        if is_out {
            site.partner_sends(&[0; 4]);
        }
        site.bench.pass(3 * SECOND);
        serves(&mut site, &format!("{scans} scans"));
        site.bit(70, 0, false);
        site.bench.pass(20 * MS);
        assert!(!site.is_set(6, 1) && matches!(site.word(90), 0x0008 | 0x0004), "{scans}: {:04X}h", site.word(90));
        // Once its last block is in the registers, the CP sends it all the same, and waits for the partner.
        site.bench.pass(20 * SECOND);
        orders(&mut site, "the next one");
    }
}

/// FC 4 is no longer called in the middle of an order of the partner: FC 3 works.
#[test]
fn an_order_of_the_partner_that_is_abandoned() {
    let fc4 = SERVES.replace("U M 1.0;\nBEB;\nU M 4.0;\nBEB;\n", "");
    for scans in 1..10 {
        let mut site = site(2, RK512, &[&unless((70, 0), &fc4)[..], ORDER].concat(), &db(10));
        let data: Vec<u8> = (0..20).collect();
        site.partner_sends(&[&[0, 0, b'A', b'D', 10, 0, 0, 10, 0xFF, 0xFF][..], &data].concat());
        site.until(|site| site.word(44) != 0);
        site.bench.pass(2 * scans * MS);
        site.bit(70, 0, true);
        site.bench.pass(6 * SECOND);
        orders(&mut site, &format!("{scans} scans"));
        site.bit(70, 0, false);
        site.bench.pass(50 * MS);
        serves(&mut site, &format!("{scans} scans"));
    }
}
