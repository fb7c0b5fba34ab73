//! Every number of 3964(R) and RK 512 that a partner can cause, with a whole CP 341 in virtual time: STL program,
//! handling blocks, CP and line are real, the partner is written here from the manual's description. Checks STATUS of
//! P_SND_RK and P_RCV_RK, and the CP's diagnostic buffer. (docs/cp341-events.md)

use ob1_tests::sim::{MS, SECOND};

use crate::cp341_status_site::Report::{Error, Ndr};
use crate::cp341_status_site::*;

/// STATUS is the first error of the job; 0709h or 070Ah is entered after it. (docs/cp341.md)
const SENDING: &[(Manner, u16, &[u16])] = &[
    (Manner::ToStx(&[NAK]), 0x0702, &[0x0702, 0x0701, 0x0702, 0x0702, 0x0709]),
    (Manner::ToStx(b"A"), 0x0702, &[0x0702, 0x0701, 0x0702, 0x0702, 0x0709]),
    (Manner::ToStx(b""), 0x0703, &[0x0703, 0x0701, 0x0703, 0x0703, 0x0709]),
    (Manner::Within(b"A"), 0x0704, &[0x0704, 0x0701, 0x0704, 0x0704, 0x070A]),
    (Manner::Within(&[NAK]), 0x0704, &[0x0704, 0x0701, 0x0704, 0x0704, 0x070A]),
    // "DLE too early"
    (Manner::Within(&[DLE]), 0x0706, &[0x0706, 0x0701, 0x0706, 0x0706, 0x070A]),
    (Manner::AtEnd(&[NAK]), 0x0706, &[0x0706, 0x0701, 0x0706, 0x0706, 0x070A]),
    (Manner::AtEnd(b"A"), 0x0706, &[0x0706, 0x0701, 0x0706, 0x0706, 0x070A]),
    (Manner::AtEnd(b""), 0x0707, &[0x0707, 0x0701, 0x0707, 0x0707, 0x070A]),
];

#[test]
fn what_fails_while_sending() {
    for (manner, status, entries) in SENDING {
        let mut site = Site::new("3964r", "");
        site.bench.device.manner = *manner;
        assert_eq!(hex(&[site.job(100)]), hex(&[*status]), "{manner:?}");
        assert_eq!(site.entries(), hex(entries), "{manner:?}");
        site.is_well();
        assert_eq!(site.job(100), 0, "{manner:?}: and it works again");
        assert_eq!(site.bench.device.telegrams, [patterns(100)]);
    }
}

/// The same below RK 512: "the procedure error was entered in STATUS immediately before". (051Ah)
#[test]
fn what_fails_below_rk_512() {
    for (manner, _, entries) in SENDING {
        let mut site = Site::new("3964r-rk512", "");
        site.bench.device.manner = *manner;
        assert_eq!(hex(&[site.job(100)]), ["051A"], "{manner:?}");
        assert_eq!(site.entries(), hex(&[*entries, &[0x051A]].concat()), "{manner:?}");
    }
}

/// Errors of a sending partner: its blocks, the entries, STATUS of P_RCV_RK. (docs/cp341-events.md)
#[test]
fn what_fails_while_receiving() {
    let (good, bad) = (block(b"123"), spoilt(b"123"));
    let bad_dle = b"1\x10A23\x10\x03\x11".to_vec();
    let silent = b"12".to_vec();
    for (name, blocks, entries, reports) in [
        ("repeated once", vec![bad.clone(), good.clone()], &[0x0808, 0x0801][..], &[Ndr(3)][..]),
        ("DLE and another character", vec![bad_dle, good.clone()], &[0x0805, 0x0801], &[Ndr(3)]),
        ("a pause longer than ZVZ", vec![silent], &[0x0806], &[Error(0x0806)]),
        ("never repeated", vec![bad.clone()], &[0x0808, 0x0801, 0x0815], &[Error(0x0808)]),
        ("given up by both", vec![bad.clone(); 3], &[0x0808, 0x0801, 0x0808, 0x0808], &[Error(0x0808)]),
        (
            "repeated more often than is set here",
            vec![bad.clone(), bad.clone(), bad, good],
            &[0x0808, 0x0801, 0x0808, 0x0808, 0x0815],
            &[Error(0x0808), Ndr(3)],
        ),
    ] {
        let mut site = Site::new("3964r", "");
        site.partner_sends(blocks);
        site.pass(6 * SECOND);
        assert_eq!(site.entries(), hex(entries), "{name}");
        assert_eq!(site.reports, reports, "{name}");
    }
}

/// A partner that abandons its block sends NAK: its next block is not a repetition.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn a_new_telegram_is_no_repetition() {
    let mut site = Site::new("3964r", "");
    site.partner_sends(vec![spoilt(b"123"); 3]);
    site.pass(SECOND);
    site.bench.meanwhile(|_, _, out| {
        out.push(NAK);
        None
    });
    site.pass(100 * MS);
    site.partner_sends([block(b"4567")]);
    site.pass(SECOND);
    assert_eq!(site.entries(), ["0808", "0801", "0808", "0808"]);
    assert_eq!(site.reports, [Error(0x0808), Ndr(4)]);
}

/// A meaningless character: NAK when the line is silent. It is not reported as an error of the next telegram.
/// [TIA help "Configuration for point-to-point links"]
#[test]
fn a_character_in_idle() {
    let mut site = Site::new("3964r", "");
    site.bench.meanwhile(|_, _, out| {
        out.push(b'A');
        None
    });
    site.pass(SECOND);
    assert_eq!(site.entries(), ["0802"]);
    site.partner_sends([spoilt(b"123")]);
    site.pass(6 * SECOND);
    assert_eq!(site.reports, [Error(0x0808)]);
}

/// [TIA help "PtP data link CP 341"]: "Data that already reached the CP is still transmitted to the partner."
#[test]
fn what_the_cp_has_is_sent_in_spite_of_r() {
    let mut site = Site::new("3964r", "");
    site.begin(200);
    site.until(|site| site.bench.device.telegram.len() >= 50);
    site.bit(80, 1, true);
    site.pass(10 * MS);
    assert_eq!(hex(&site.ends), ["1E0D"], "told at once");
    site.begin(10);
    assert_eq!(site.ends.len(), 1, "blocked while R is 1");
    site.bit(80, 1, false);
    // The next one waits for the line.
    site.begin(10);
    assert!(site.bench.device.telegrams.is_empty());
    site.pass(SECOND);
    assert_eq!(site.bench.device.telegrams, [patterns(200), patterns(10)]);
    assert_eq!(hex(&site.ends), ["1E0D", "0000"]);
    assert!(site.entries().is_empty());
}

/// EN_R = 0 while a telegram is being passed: the transfer fails, the CP keeps the telegram and passes it again.
/// [TIA help "PtP data link CP 341"]
#[test]
fn the_cp_repeats_a_transfer_that_the_cpu_broke_off() {
    let mut site = Site::new("3964r", "");
    let telegram: Vec<u8> = (0..200).collect();
    site.partner_sends([block(&telegram)]);
    site.until(|site| site.block(40)[1] == 1);
    site.bit(84, 0, false);
    site.pass(100 * MS);
    assert_eq!((site.reports.as_slice(), site.entries()), (&[Error(0x1E0D)][..], hex(&[0x0407])));
    site.bit(84, 0, true);
    site.pass(SECOND);
    assert_eq!(site.reports, [Error(0x1E0D), Ndr(200)]);
    assert_eq!(site.block(40)[..201], [&telegram[..], &[0]].concat());
    // R = 1 during the transfer is a RESET.
    site.partner_sends([block(&telegram[1..])]);
    site.until(|site| site.block(40)[0] != 0);
    site.bit(84, 1, true);
    site.pass(100 * MS);
    site.bit(84, 1, false);
    site.pass(SECOND);
    assert_eq!(site.reports[2..], [Error(0x1E0D), Ndr(199)]);
    assert_eq!(site.entries(), ["0407", "040A"]);
}

/// With RK 512 the job of the partner is refused instead: its program must repeat it.
#[test]
fn rk_512_refuses_a_job_that_the_cpu_broke_off() {
    for (bit, entry) in [(0, "0407"), (1, "040A")] {
        let mut site = Site::new("3964r-rk512", "");
        let job = [&b"\0\0AD\x1F\0\0\x32\xFF\xFF"[..], &[7; 100]].concat();
        site.partner_sends([block(&job)]);
        site.until(|site| site.block(31)[0] != 0);
        site.bit(84, bit, bit == 1);
        site.pass(SECOND);
        assert_eq!(site.bench.device.telegrams, [b"\0\0\0\x2A"]);
        assert_eq!((site.reports.as_slice(), site.entries()), (&[Error(0x1E0D)][..], vec![entry.to_owned()]));
        site.bit(84, bit, bit == 0);
        site.pass(SECOND);
        site.partner_sends([block(&job)]);
        site.pass(SECOND);
        assert_eq!(site.bench.device.telegrams, [b"\0\0\0\x2A", b"\0\0\0\0"]);
        assert_eq!(site.reports[1..], [Ndr(100)]);
    }
}

/// The telegram is not accepted: "temporarily" after a second, aborted after 10 s. A telegram of 3964R is kept; with RK
/// 512 the partner gets 2Ah.
#[test]
fn nobody_takes_it() {
    let mut site = Site::new("3964r", "");
    site.bit(84, 0, false);
    site.partner_sends([block(b"123")]);
    site.pass(900 * MS);
    assert!(site.entries().is_empty());
    site.pass(300 * MS);
    assert_eq!(site.entries(), ["0408"]);
    site.pass(8_500 * MS);
    assert_eq!(site.entries(), ["0408"]);
    site.pass(SECOND);
    assert_eq!(site.entries(), ["0408", "0409"]);
    site.pass(20 * SECOND);
    assert_eq!((site.entries().len(), site.reports.len()), (2, 0), "once");
    site.bit(84, 0, true);
    site.pass(SECOND);
    assert_eq!(site.reports, [Ndr(3)]);

    let mut site = Site::new("3964r-rk512", "");
    site.bit(84, 0, false);
    site.partner_sends([block(b"\0\0AD\x1F\0\0\x01\xFF\xFFab")]);
    site.pass(9 * SECOND);
    assert_eq!(site.entries(), ["0408"]);
    assert!(site.bench.device.telegrams.is_empty());
    site.pass(2 * SECOND);
    assert_eq!(site.bench.device.telegrams, [b"\0\0\0\x2A"]);
    assert_eq!(site.entries(), ["0408", "060D", "0409"]);
    assert!(site.reports.is_empty());
}

/// A missing target: the block reports it in each attempt, and the telegram is not lost. (040Ah)
#[test]
fn a_target_that_is_not_there() {
    let mut site = Site::new("3964r", "");
    site.set_bytes(&[(121, 99)]);
    site.partner_sends([block(b"123")]);
    site.pass(12_500 * MS);
    assert_eq!(site.reports, [Error(0x040A); 13], "an attempt each second");
    let entries = site.entries();
    assert_eq!(entries.iter().filter(|entry| *entry == "040A").count(), 13);
    let others: Vec<_> = entries.iter().filter(|entry| *entry != "040A").collect();
    assert_eq!(others, ["0408", "0409"]);
    site.set_bytes(&[(121, 40)]);
    site.pass(SECOND);
    assert_eq!(site.reports[13..], [Ndr(3)]);
}

/// Refused telegrams of the partner: the error number it gets, and the number here. (docs/cp341-events.md)
#[test]
fn what_the_partner_does_wrong() {
    let data = |n: usize| vec![b'a'; n];
    let with = |head: &[u8], n: usize| [head, &data(n)].concat();
    for (telegrams, number, status) in [
        (vec![b"\x01\0AD\x1F\0\0\x01\xFF\xFFab".to_vec()], 0x10, 0x0601),
        (vec![b"\0\0BD\x1F\0\0\x01\xFF\xFFab".to_vec()], 0x16, 0x0602),
        (vec![with(b"\0\0AD\x1F\0\0\x42\xFF\xFF", 128), with(b"\xFF\0ED", 0)], 0x16, 0x0603),
        (vec![b"\0\0AM\0\0\0\x02\xFF\xFFab".to_vec()], 0x10, 0x0604),
        (vec![with(b"\0\0AD\x1F\0\0\x42\xFF\xFF", 128), with(b"\xFF\0OD", 4)], 0x10, 0x0605),
        (vec![b"\0\0AD\0\0\0\x01\xFF\xFFab".to_vec()], 0x14, 0x0606),
        (vec![b"\0\0AD\x63\0\0\x01\xFF\xFFab".to_vec()], 0x14, 0x0606),
        (vec![b"\0\0AD\x1F\xFF\0\x02\xFF\xFFabcd".to_vec()], 0x14, 0x0607),
        (vec![b"\0\0ED\x1F\0\x08\x01\xFF\xFF".to_vec()], 0x14, 0x0608),
        (vec![b"\0\0AD\x1F\0\0\x01\x06\x08ab".to_vec()], 0x0C, 0x0609),
        (vec![b"\0\0AD\x1F\0\0\x01\x06\x54ab".to_vec()], 0x0C, 0x060A),
        (vec![b"\0\0AD\x1F\0\0\x01\xFF\xFFabc".to_vec()], 0x34, 0x060B),
        (vec![b"\0\0AD\x1F\x04\0\x04\xFF\xFFab".to_vec()], 0x34, 0x060B),
        (vec![b"\0\0ED\x1F\0\0\x01\xFF\xFFab".to_vec()], 0x34, 0x060C),
        (vec![with(b"\xFF\0AD", 2)], 0x36, 0x060E),
        (vec![b"\0\0A".to_vec()], 0x34, 0x0610),
        (vec![b"\0\0AD\x1F\0".to_vec()], 0x34, 0x0610),
        (vec![with(b"\0\0AD\x1F\0\0\x42\xFF\xFF", 128), with(b"\xFF\0AD", 6)], 0x34, 0x0611),
    ] {
        let mut site = Site::new("3964r-rk512", "");
        let last = telegrams.len() - 1;
        let follow = if telegrams[last][0] == 0xFF { 0xFF } else { 0 };
        for telegram in &telegrams {
            site.partner_sends([block(telegram)]);
            site.pass(SECOND);
        }
        let reactions = &site.bench.device.telegrams;
        assert_eq!(reactions[last], [follow, 0, 0, number], "{telegrams:02X?}");
        assert_eq!(site.entries(), hex(&[status]), "{telegrams:02X?}");
        assert_eq!(site.reports, [Error(status)], "{telegrams:02X?}");
        site.partner_sends([block(b"\0\0AD\x1F\0\0\x01\xFF\xFFab")]);
        site.pass(SECOND);
        assert_eq!(site.bench.device.telegrams[last + 1], b"\0\0\0\0", "and it works again");
    }
}

/// An aborted job of the partner is reported once with its cause, in the block and in the buffer, and not as a CPU that
/// took nothing for 10 s (0409h). (docs/cp341-events.md)
#[test]
fn a_job_that_the_partner_breaks_off() {
    let fetch = b"\0\0ED\x1F\0\0\x42\xFF\xFF".to_vec();
    let other = b"\0\0AD\x1F\0\0\x01\xFF\xFFab".to_vec();
    let begin = [b"\0\0AD\x1F\0\0\x42\xFF\xFF".to_vec(), vec![b'a'; 128]].concat();
    for (first, second, status) in [
        // It starts another job after half of the data of its FETCH.
        (&fetch, Some(&other), 0x060E),
        (&fetch, Some(&b"\xFF\0EM".to_vec()), 0x0605),
        // It does not continue.
        (&fetch, None, 0x060E),
        // A SEND whose rest never arrives: the received part was acknowledged but is not stored.
        (&begin, None, 0x060E),
        (&begin, Some(&other), 0x060E),
    ] {
        let mut site = Site::new("3964r-rk512", "");
        site.partner_sends([block(first)]);
        site.pass(SECOND);
        assert_eq!(site.reports, [], "{first:02X?}");
        site.partner_sends(second.map(|telegram| block(telegram)));
        site.pass(21 * SECOND);
        assert_eq!(
            (&site.reports, site.entries()),
            (&vec![Error(status)], hex(&[status])),
            "{first:02X?} {second:02X?}"
        );
        site.partner_sends([block(&other)]);
        site.pass(SECOND);
        assert_eq!(site.reports[1..], [Ndr(2)], "and it works again");
    }
}

/// The data are in the CPU, but the partner does not accept the reaction. (0612h)
#[test]
fn a_reaction_that_cannot_be_sent() {
    let mut site = Site::new("3964r-rk512", "");
    site.bench.device.manner = Manner::ToStx(&[NAK]);
    site.partner_sends([block(b"\0\0AD\x1F\0\0\x01\xFF\xFFab")]);
    site.pass(SECOND);
    assert_eq!(site.reports, [Error(0x0612)]);
    assert_eq!(site.entries(), ["0702", "0701", "0702", "0702", "0709", "0612"]);
    assert_eq!(site.block(31)[..2], *b"ab");
    site.is_well();
}

/// Answers of the partner to our job. (docs/cp341-events.md)
#[test]
fn what_the_partner_answers() {
    for (sf, reaction, status) in [
        (b'S', &b"\0\0\0\0"[..], 0),
        (b'S', b"\0\0\0\x0A", 0x0905),
        (b'S', b"\0\0\0\x0C", 0x0902),
        (b'S', b"\0\0\0\x10", 0x090B),
        (b'S', b"\0\0\0\x12", 0x0904),
        (b'S', b"\0\0\0\x14", 0x0903),
        (b'S', b"\0\0\0\x16", 0x090A),
        (b'S', b"\0\0\0\x2A", 0x090D),
        (b'S', b"\0\0\0\x32", 0x0909),
        (b'S', b"\0\0\0\x34", 0x090C),
        (b'S', b"\0\0\0\x36", 0x0908),
        (b'S', b"\0\0\0\x77", 0x090E),
        (b'S', b"\xFF\0\0\0", 0x0A01),
        (b'S', b"\x01\0\0\0", 0x0A02),
        (b'S', b"\0\0\0\0a", 0x0A04),
        (b'F', b"\0\0\0\0abcd", 0),
        (b'F', b"\0\0\0\0", 0x0A03),
        (b'F', b"\0\0\0\0abcdef", 0x0A03),
        (b'F', b"\0\0\0\x14", 0x0903),
    ] {
        let mut site = Site::new("3964r-rk512", "");
        site.set_bytes(&[(100, sf)]);
        site.bench.device.reactions.push_back(reaction.to_vec());
        assert_eq!(hex(&[site.job(4)]), hex(&[status]), "{reaction:02X?}");
        let expected = if status == 0 { vec![] } else { hex(&[status]) };
        assert_eq!(site.entries(), expected, "{reaction:02X?}");
        if (sf, status) == (b'F', 0) {
            assert_eq!(site.block(10)[..5], *b"abcd$");
        }
    }
}

/// [TIA help "Configuration for point-to-point links"]: 20 s, or depending on the transmission rate: 5 s at 9600 baud.
#[test]
fn no_reaction_within_the_monitoring_time() {
    for (reaction, time) in [("", 20 * SECOND), (", reaction = \"baud\"", 5 * SECOND)] {
        let mut site = Site::new("3964r-rk512", reaction);
        site.begin(4);
        site.until(|site| !site.bench.device.telegrams.is_empty());
        site.pass(time - 100 * MS);
        assert!(site.ends.is_empty(), "{reaction}");
        site.pass(200 * MS);
        assert_eq!((hex(&site.ends), site.entries()), (hex(&[0x0A05]), hex(&[0x0A05])), "{reaction}");
    }
}

/// A reaction after the monitoring time belongs to no job: the next job does not accept it, whether it has already
/// arrived or not; nor does the job after that, if the late reaction arrived as the answer to the second job.
/// 0A01h: the response came at the wrong time.
#[test]
fn a_late_reaction_ends_no_other_job() {
    let late = |site: &mut Site, reaction: &[u8]| site.partner_sends([block(reaction)]);
    // The late reaction arrives while the next job waits.
    let mut site = Site::new("3964r-rk512", ", reaction = \"baud\"");
    assert_eq!(hex(&[site.job(4)]), ["0A05"]);
    site.begin(6);
    site.pass(500 * MS);
    assert_eq!(site.bench.device.telegrams.len(), 1, "the second job waits for it");
    site.bench.device.reactions.push_back(b"\0\0\0\x14".to_vec());
    late(&mut site, b"\0\0\0\0");
    site.pass(SECOND);
    assert_eq!(site.bench.device.telegrams.len(), 2, "it has come");
    assert_eq!((hex(&site.ends[1..]), site.entries()), (hex(&[0x0903]), hex(&[0x0A05, 0x0A01, 0x0903])));
    // It does not arrive: the job is sent after 2 s, and the next one waits again.
    let mut site = Site::new("3964r-rk512", ", reaction = \"baud\"");
    assert_eq!(hex(&[site.job(4)]), ["0A05"]);
    for expected in [2, 2, 0] {
        let begun = site.bench.now;
        site.bench.device.reactions.push_back(b"\0\0\0\0".to_vec());
        assert_eq!(site.job(6), 0);
        assert_eq!((site.bench.now - begun) / SECOND, expected);
    }
    assert_eq!(site.entries(), ["0A05"]);
    // It arrives as the answer to the second job: the real answer after it is not taken for that of the third.
    let mut site = Site::new("3964r-rk512", ", reaction = \"baud\"");
    assert_eq!(hex(&[site.job(4)]), ["0A05"]);
    site.bench.device.reactions.push_back(b"\0\0\0\0".to_vec());
    assert_eq!(site.job(6), 0, "nothing tells it from its own");
    site.bench.device.reactions.push_back(b"\0\0\0\0".to_vec());
    site.begin(8);
    late(&mut site, b"\0\0\0\x14");
    site.pass(SECOND);
    assert_eq!((hex(&site.ends[1..]), site.entries()), (hex(&[0, 0]), hex(&[0x0A05, 0x0A01])));
}
