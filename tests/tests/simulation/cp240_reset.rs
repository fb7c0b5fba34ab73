//! What the outputs of the CP 240's handling blocks say after a reset and while a data block is wrong, in a whole
//! station and in virtual time: nothing counts as done that was not.

use ob1_tests::sim::{MS, SECOND};

use crate::cp240_blocks::{DB_10, FRAGMENTS, RK512, SERVES, SYNCHRON, Site, rtu};

/// FC 9 with the manual's wiring: the control bits of SEND and of FC 3 in MB 2, those of RECEIVE, FC 2 and FC 4 in MB
/// 3.
fn site(params: &str, cycle: &str, blocks: &str) -> Site {
    let mut site = Site::new(params, &[SYNCHRON, "U M 1.0;\nBEB;\n", cycle].concat(), blocks);
    site.until(|site| site.is_set(1, 0));
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(50 * MS);
    site
}

/// The rule of the manual's program, before FC 0: when FRG (M 2.0) falls, FEHLER_KOM (M 2.4) says how the order (M
/// 10.0) has ended. MW 60 counts those done, MW 62 those failed. M 10.1 gives an order.
const RULE: &str = "U M 10.0;\nUN M 2.0;\nSPBN r1;\nR M 10.0;\nU M 2.4;\nSPB r2;\nL MW 60;\n+ 1;\nT MW 60;\nSPA r1;\n\
     r2: L MW 62;\n+ 1;\nT MW 62;\nr1: U M 10.1;\nSPBN r3;\nR M 10.1;\nS M 10.0;\nS M 2.0;\nr3: NOP 0;\n\
     CALL FC 0 (ADR := 256, _DB := DB 10, ABD := W#16#0, ANZ := W#16#28, FRG := M 2.0, GESE := MW 40, ANZ_INT := MW 42, \
     ENDE_KOM := M 2.1, LETZTER_BLOCK := M 2.2, SENDEN_LAEUFT := M 2.3, FEHLER_KOM := M 2.4, PAFE := MB 44);\n";
const DONE: usize = 60;
const FAILED: usize = 62;

/// [S0 L1090] names ENDE_KOM, LETZTER_BLOCK, SENDEN_LAEUFT and FEHLER_KOM, not FRG. A reset at any moment of a SEND,
/// with all bits in STEUERB_S as in the manual's program: a telegram that counts as done is the partner's.
#[test]
fn a_reset_of_the_cp_is_never_taken_for_done() {
    let mut failed = 0;
    for at in 0..40 {
        let mut site = site("{ protocol = \"3964r\", baud = 19200 }", RULE, DB_10);
        site.bit(10, 1, true);
        site.bench.pass(MS + at * MS);
        site.bit(1, 2, true);
        site.bench.pass(SECOND);
        site.until(|site| site.word(DONE) + site.word(FAILED) == 1 && !site.is_set(1, 0));
        assert!(usize::from(site.word(DONE)) <= site.bench.device.telegrams.len(), "after {at} ms");
        failed += site.word(FAILED);
        // The next order is sent; the partner no longer waits for the rest of this one.
        site.bench.meanwhile(|partner, _, _| {
            partner.from = None;
            None
        });
        let before = site.bench.device.telegrams.len();
        site.bit(10, 1, true);
        site.until(|site| site.word(DONE) + site.word(FAILED) == 2);
        assert_eq!((site.bench.device.telegrams.len(), site.is_set(2, 4)), (before + 1, false), "after {at} ms");
    }
    assert!(failed > 10, "{failed}");
}

/// The same with a driver that is killed, and an order given while FC 9 is at work: it is sent afterwards.
#[test]
fn an_order_that_is_given_during_a_reset_is_sent_after_it() {
    for at in [0, 2, 4, 8, 16, 32, 64] {
        let mut site = site("{ protocol = \"3964r\", baud = 19200 }", RULE, DB_10);
        site.bit(1, 2, true);
        site.bench.pass(MS + at * MS);
        site.bit(10, 0, true);
        site.bit(2, 0, true);
        site.until(|site| !site.is_set(1, 0) && !site.is_set(10, 0));
        let sent = site.bench.device.telegrams.len();
        assert_eq!((site.word(DONE) as usize, sent), (sent, sent), "after {at} ms");
        assert_eq!(site.word(DONE) + site.word(FAILED), 1);
        site.bit(10, 1, true);
        site.bench.pass((1 + at) * MS);
        site.bench.kill_driver();
        site.until(|site| !site.is_set(10, 0) && site.word(DONE) + site.word(FAILED) == 2);
        assert!(usize::from(site.word(DONE)) <= site.bench.device.telegrams.len(), "killed after {at} ms");
    }
}

/// FC 3 with its control bits in STEUERB_S and FC 2 with its own in STEUERB_R, as in the manual, each while M 6.1 or M
/// 6.2 is set. MW 60 and MW 62 count the scans in which they have ended with an error.
const ORDERS: &str = "U M 6.1;\nSPBN f3;\nCALL FC 3 (ADR := 256, QDB := DB 10, QBDW := W#16#0, LANG := MW 80, ZDB := DB 5, \
     ZBDW := 0, KOOR := W#16#FFFF, ANZW := MW 90, PAFE := MB 92, ANZ := MW 94, GESE := MW 96, KOPF_GESENET := M 2.0, \
     ERSTER_BLOCK := M 2.1, SENDEN_LAEUFT := M 2.2, SENDEN_FERTIG := M 2.3, LETZTER_BLOCK := M 2.4, FEHLER := M 2.5);\n\
     L MW 90;\nL W#16#C;\nUW;\nSPZ f3;\nR M 6.1;\nf3: NOP 0;\n\
     U M 6.2;\nSPBN f2;\nCALL FC 2 (ADR := 256, QDB := DB 5, QBDW := W#16#0, LANG := 10, ZDB := DB 10, ZBDW := 0, \
     KOOR := W#16#FFFF, ANZW := MW 100, PAFE := MB 102, ANZ := MW 104, GESE := MW 106, KOPF_GESE := M 3.0, \
     WART_DATEN := M 3.1, EMPF_LAEUFT := M 3.2, LETZTER_BLOCK := M 3.3, FEHL_KOM := M 3.4);\n\
     L MW 100;\nL W#16#C;\nUW;\nSPZ f2;\nR M 6.2;\nf2: NOP 0;\n";

/// [S0 L1297]: 00h with bit 3: "the CP had to reinitialize the connection, e.g. after a reboot or RESET". The order is
/// not given again behind the program's back.
#[test]
fn a_reset_ends_an_order_of_rk_512_with_0008h() {
    for (bit, anzw) in [(1, 90), (2, 100)] {
        for at in [2, 6, 10, 20, 40, 80, 300] {
            let mut site = site(RK512, ORDERS, DB_10);
            site.set_word(80, 10);
            site.bit(6, bit, true);
            site.bench.pass(at * MS);
            assert_eq!(site.word(anzw), 0x0002);
            let sent = site.bench.device.telegrams.len();
            site.bit(1, 2, true);
            site.until(|site| site.is_set(1, 0));
            site.until(|site| !site.is_set(1, 0));
            site.bench.pass(300 * MS);
            assert_eq!((site.word(anzw), site.is_set(6, bit)), (0x0008, false), "ANZW at {anzw}, {at} ms");
            let more = site.bench.device.telegrams.len() - sent;
            assert!(more == 0 || sent == 0 && more == 1, "{at} ms: {more} more");
            // The program gives it again.
            site.bench.device.telegrams.clear();
            site.bit(6, bit, true);
            site.until(|site| !site.bench.device.telegrams.is_empty());
            let data = if bit == 2 { 20 } else { 0 };
            site.partner_sends(&vec![0; 4 + data]);
            site.until(|site| !site.is_set(6, bit));
            assert_eq!(site.word(anzw), 0x0004, "ANZW at {anzw}, {at} ms");
        }
    }
}

/// [S0 L1315], [S0 L1320]: bits 2 and 3 are deleted "when the according order is triggered for a second time", also if
/// it cannot begin yet: while PAFE is not 0, while the CP is down, while FC 9 is at work.
#[test]
fn an_order_that_cannot_begin_is_not_done() {
    // DB 10 has 1100 bytes: from word 600 on there are none. The first word is made right later.
    let cycle = ORDERS.replace("QBDW := W#16#0", "QBDW := MW 82");
    let mut site = site(RK512, &cycle, DB_10);
    site.set_word(80, 10);
    site.bit(6, 1, true);
    site.until(|site| !site.bench.device.telegrams.is_empty());
    site.partner_sends(&[0; 4]);
    site.until(|site| !site.is_set(6, 1));
    site.bench.device.telegrams.clear();
    site.set_word(82, 600);
    site.bit(6, 1, true);
    site.bench.pass(SECOND);
    let pafe = site.word(92) >> 8;
    assert_eq!((pafe, site.word(90), site.is_set(6, 1)), (2, 0x0000, true), "it waits");
    assert_eq!(site.bench.log().matches("FC 3 waits, DB 10 is too short (PAFE 2)").count(), 1, "{}", site.bench.log());
    site.set_word(82, 0);
    site.bench.pass(SECOND);
    assert_eq!((site.word(92) >> 8, site.word(90)), (0, 0x0002));
    site.partner_sends(&[0; 4]);
    site.until(|site| !site.is_set(6, 1));
    assert_eq!(site.word(90), 0x0004);
    // The CP is gone for a moment.
    site.bench.kill_driver();
    site.bench.pass(4 * MS);
    site.bit(6, 1, true);
    site.bench.pass(4 * MS);
    assert_eq!((site.word(90), site.is_set(6, 1)), (0, true));
}

/// [S0 L1262]: "after elimination of the error cause, the byte is set back to 0": here by the program, which makes the
/// data block, or by the partner, whose next order is right.
#[test]
fn pafe_of_fc_4_stands_as_long_as_its_cause() {
    let makes = "U M 6.0;\nSPBN m1;\nR M 6.0;\nCALL SFC 22 (LOW_LIMIT := W#16#3C, UP_LIMIT := W#16#3C, \
         COUNT := W#16#64, RET_VAL := MW 56, DB_NUMBER := MW 58);\nm1: NOP 0;\n";
    for by_partner in [false, true] {
        let mut site = site(RK512, &[makes, SERVES].concat(), DB_10);
        site.bench.pass(100 * MS);
        for (db, words, pafe) in [(60, 10, 1), (10, 255, 2)] {
            let header = [0, 0, b'E', b'D', db, if db == 10 { 255 } else { 0 }, 1, words, 0xFF, 0xFF];
            site.set_word(40, 0);
            site.partner_sends(&header);
            site.until(|site| site.word(40) == 0x1408);
            for _ in 0..10 {
                assert_eq!(site.word(42) >> 8, pafe, "DB {db}");
                site.bench.pass(50 * MS);
            }
            if db == 60 && !by_partner {
                break;
            }
        }
        if by_partner {
            site.partner_sends(&[0, 0, b'E', b'D', 10, 0, 0, 4, 0xFF, 0xFF]);
        } else {
            site.bit(6, 0, true);
            site.partner_sends(&[0, 0, b'E', b'D', 60, 0, 0, 10, 0xFF, 0xFF]);
        }
        site.until(|site| site.word(40) == 0x0004);
        assert_eq!(site.word(42) >> 8, 0);
    }
}

/// [S0 L2624]: "otherwise the RECEIVE block announces a range error". It stands until the area fits, or another one
/// comes.
#[test]
fn a_range_error_of_a_slave_long_stands() {
    let receives = "CALL FC 1 (ADR := 256, _DB := DB 10, ABD := MW 80, ANZ := MW 40, EMFR := M 5.0, GEEM := MW 44, \
         ANZ_INT := MW 46, EMPF_LAEUFT := M 3.0, LETZTER_BLOCK := M 3.1, FEHLER_EMPF := M 3.2, PAFE := MB 42);\n";
    let write = |site: &mut Site, register: u8| {
        let telegram = rtu(&[1, 16, 0, register, 0, 4, 8, 1, 2, 3, 4, 5, 6, 7, register]);
        site.bench.meanwhile(|_, _, out| {
            out.extend(telegram);
            None
        });
        site.bench.pass(SECOND);
    };
    for by_master in [false, true] {
        let mut site = Site::new("{ protocol = \"modbus-slave-rtu-long\", baud = 38400 }", receives, DB_10);
        site.bench.pass(100 * MS);
        // DB 10 ends at byte 1100: from byte 1000 on registers 0 to 3 fit, registers 80 to 83 do not.
        site.set_word(80, 1000);
        write(&mut site, 80);
        for _ in 0..10 {
            assert_eq!((site.word(42) >> 8, site.is_set(3, 2), site.is_set(5, 0)), (2, true, false));
            site.bench.pass(20 * MS);
        }
        if by_master {
            write(&mut site, 4);
            assert!(site.is_set(5, 0));
        } else {
            site.set_word(80, 0);
            site.bench.pass(4 * MS);
        }
        assert_eq!(site.word(42) >> 8, 0, "by the master: {by_master}");
    }
}

/// FC 9 RESET in the middle of a telegram that FC 11 receives in parts: "GEEM is 0 between telegrams", and the next
/// telegram is whole.
#[test]
fn a_reset_in_the_middle_of_fragments() {
    let params = "{ protocol = \"ascii-fragmented\", baud = 9600, zvz_ms = 100 }";
    let mut site = site(params, &FRAGMENTS.replace("U M 1.0;\nBEB;\n", ""), DB_10);
    let hears = |site: &mut Site, bytes: usize| {
        site.bench.meanwhile(|_, _, out| {
            out.extend(vec![7; bytes]);
            None
        });
    };
    hears(&mut site, 24);
    site.until(|site| site.word(44) == 24);
    site.bit(1, 2, true);
    site.until(|site| site.is_set(1, 0));
    assert_eq!(site.word(44), 24);
    site.until(|site| !site.is_set(1, 0));
    site.bench.pass(4 * MS);
    assert_eq!((site.word(44), site.is_set(5, 0), site.is_set(3, 2)), (0, false, true), "GEEM, EMFR, FEHLER_EMPF");
    site.bench.pass(SECOND);
    hears(&mut site, 30);
    site.until(|site| site.is_set(5, 0));
    assert_eq!(site.word(40), 30);
}
