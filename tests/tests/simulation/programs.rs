//! Programs drawn at random around the handling blocks: a few of each CP, and the seeds that have found something.

use ob1_tests::programs::{SUBJECTS, Subject};

/// Seeds that failed once, with the cause. They stay as long as the generator gives the same programs for them.
const FOUND: &[(&str, u64, &str)] = &[
    ("cp240", 1, "RESET in a SEND: FC 9 cleared FRG, and FEHLER_KOM was 0"),
    ("cp240", 3, "FC 8 and FC 0 waited for each other"),
    ("cp240", 19, "FC 3 was cut off by RESET and began again by itself, without ANZW 0008h"),
    ("cp240", 37, "PAFE of FC 4 stood for one call"),
    ("cp240", 88, "FC 3 waited for TX, and ANZW was still 0004h of the order before"),
    ("cp240", 261, "FC 3 was cut off by RESET: the partner got the order twice"),
    ("cp240", 523, "FC 3 with PAFE 2, and ANZW was still 0004h of the order before"),
    ("cp240", 1582, "FC 2 was not called between two RESETs: ANZW 0008h never came"),
    ("cp240", 21003, "the judge: a doubled reaction to an order before, which FC 3 must take for its own"),
    ("cp240", 21964, "the judge: the time of a running telegram was that of an ANZ written meanwhile"),
    ("cp240", 22066, "the partner: after a RESET its reactions were one order behind, for ever"),
    ("cp240", 22439, "the judge: two equal characters were lost, and the check character was the same"),
    ("cp240", 30699, "as 22066: each order failed, and the next one waited for its late reaction"),
    ("cp240", 31229, "the judge: the NAK of a partner that gives up crossed the STX of the CP"),
    ("cp240", 145_519, "FC 2 was not called, FC 4 fetched its result, RESET: FC 2 began again without ANZW 0008h"),
    ("cp240", 183_259, "the judge: the two orders after one without its reaction wait for that"),
    ("cp240", 190_639, "the judge: a reaction that is too short, in place of the partner's order refused with 34h"),
    ("cp240", 157_789, "the judge: FC 4 was no longer called"),
    ("cp240", 140059, "3964R: ZVZ above QVZ, DLE lost: each STX of the partner kept the block open, nobody could send"),
    ("cp240", 144209, "as 140059, with 3964 and a RESET: START of FC 8 stayed 1"),
    ("cp240", 161426, "as 140059; the judge: a doubled 00h, which the check character does not show, was read late"),
    ("cp240", 131512, "the partner: several STX behind the block that a RESET has cut off came at once, as data"),
    ("cp240", 146587, "the judge: on a late line a DLE acknowledged the order before"),
    ("cp240", 149190, "the judge: the other FC 0 was called so seldom that its telegram took two seconds"),
    ("cp240", 170136, "the judge: the rest of a telegram behind an STX had the check character of the whole"),
    ("cp240", 192807, "the judge: a doubled 00h, as 161426"),
    ("cp240", 15210, "the judge: a NAK was lost, and the DLE for the check character 02h acknowledged the order"),
    ("cp240", 55177, "as 420799"),
    ("cp240", 57609, "the judge: FC 0 was not called for two seconds, and FC 8 had its turn"),
    ("cp240", 64154, "the judge: a RESET had taken the telegram long before FC 1 was called again"),
    ("cp240", 76256, "as 420799: the CP refuses the rest of a telegram whose beginning a start has cut off"),
    ("cp240", 81169, "the judge: the process died in the first synchronisation, and the next one does not know it"),
    ("cp240", 82034, "as 420799"),
    ("cp240", 410_982, "FC 3 waited for its turn, then LANG was wrong: FC 2 waited a second for it"),
    ("cp240", 417_073, "the judge: on a late line a DLE for 02h in the rest of a telegram acknowledged the order"),
    ("cp240", 420_799, "the partner: it took what the CP refuses for the answer to an order that it had not sent yet"),
    ("cp341", 4, "R of an idle P_SND_RK was not answered"),
    ("cp341", 6, "a job that waited for the CP had the LEN of a later call, not that of the edge of REQ"),
    ("cp341", 20, "of two P_SND_RK at one CP one had no end"),
    ("cp341", 29, "two P_SND_RK at one CP, one request on the line, DONE at both"),
    ("cp341", 24, "DONE of a reading job before its NDR"),
    ("cp340", 7, "as cp341 6, with P_SEND"),
    ("cp340", 18, "as cp341 29, with P_SEND"),
    ("cp341", 702, SAME_START),
    ("cp341", 729, SAME_START),
    ("cp341", 766, SAME_START),
    ("cp340", 492, SAME_START),
    ("cp340", 496, SAME_START),
    ("cp340", 703, SAME_START),
    ("cp340", 728, SAME_START),
    ("cp340", 767, SAME_START),
    ("cp340", 772, SAME_START),
    ("cp340", 641, "the judge called an answer good that a fault of the line had hit"),
    ("cp040", 302, "a request in a reset: one telegram with parts of two areas, because DBB_NO changed meanwhile"),
    ("cp040", 32, "as 302, with FB 65"),
    ("cp040", 92, "of two FB 60: a request that waited had the DBB_NO of a later call"),
    ("cp040", 112, "of two FB 60: a request that waited had the LEN of a later call"),
    ("cp040", 774, "DONE for a telegram that no call had asked for: LEN of a later call"),
    ("cp040", 1078, "of two FB 60 the one that was called less often never had its turn"),
    ("cp040", 306, "the judge: two jobs of a block had the same mark"),
    ("cp040", 409, "the judge: a late answer of a slave is taken for that to the next request"),
    ("cp040", 445, "the judge: STX lost on the line, and nobody acknowledges"),
    ("cp040", 685, "the judge: a start-up in the middle of a telegram of the partner leaves its rest"),
    ("cp040", 692, "the judge: DONE of a reset taken for that of a job which may not have begun"),
    ("cp040", 1111, "the judge: FB 61 too slow for the answers of a Modbus slave, no buffer for the next"),
    ("cp040", 1678, "the judge: the line spoilt an answer of 3964R"),
    ("cp040", 200028, "of two FB 60: a request that had ended with ERROR was sent after the RESET of the other one"),
    ("cp040", 206292, "FB 61 got nothing while FB 60 sent: fragment 0 beside the answer 0 was taken for no CP"),
    ("cp040", 201138, "the judge: one error for a job and a RESET, and the DONE of the RESET taken for that of a job"),
    ("cp040", 203534, "the judge: two FB 60 sent the same bytes"),
    ("cp040", 206301, "the partner: it answered a request before, when the line had spoilt the next one"),
    ("cp340", 203437, "the partner: its XON overtook the telegram before it"),
    ("cp340", 204355, "the judge: a telegram was longer than the time in which the error of a BREAK was awaited"),
    ("cp340", 211748, "the partner: a late DLE at the end of a block which it then refused"),
    ("cp341", 208997, "after STOP -> RUN the job of before ended the first one after it"),
    ("cp341", 311460, "RK 512: after a kill a late reaction ended the order of the next process"),
    ("cp341", 310759, "the partner: a request that it did not answer left the late answer to the one before"),
    ("cp341", 319356, "the partner: it repeated an order whose response it had"),
    ("cp341", 319875, "the judge: the bytes of a job that was broken off, taken for those of one that was refused"),
    ("cp340", 310986, "the judge: a telegram that began within ZVZ of a fault belongs to the one that is lost"),
    ("cp340", 313547, "the judge: after kills telegrams stand behind one another without a silence"),
    ("cp040", 305015, "the partner: its echo came behind its late answer"),
    ("cp040", 312215, "the judge: the rest of a telegram that a RESET had cut off took FB 65 three seconds"),
    ("cp040", 105371, "the judge: the telegrams before it took their time, 7 bytes in a call"),
    ("cp341", 104044, "the partner: a late DLE in the middle of the next block, which the CP must repeat"),
    ("cp340", 104045, "as cp341 104044"),
    (
        "cp341",
        423146,
        "RK 512: a job of the partner that showed that our reaction had arrived was closed with that one",
    ),
    ("cp341", 29430, "the partner: it refused a block without a 00h, whose repetition it then took"),
    ("cp341", 41370, "the partner: it took the next block for the repetition of one with the same end"),
    ("cp341", 410500, "the partner: it answered a reaction that had lost a 00h, in place of the order behind it"),
    ("cp341", 429724, "the partner: a late DLE behind a block whose end the line had spoilt"),
    ("cp341", 16150, "as 410500"),
    ("cp341", 18085, "as 429724"),
    ("cp340", 18084, "as cp341 429724"),
    ("cp341", 501686, "the judge: the CP reports a block that the partner has given up after four seconds"),
    ("cp341", 48579, "the judge: the bytes of a job that ran, taken for those of one that was refused meanwhile"),
    ("cp341", 58473, "as 48579"),
    ("cp341", 63859, "as 48579"),
    (
        "cp341",
        66156,
        "the judge: after a start-up either of two edges may be the FETCH that runs, and it held one only",
    ),
    ("cp340", 20877, "the judge: EN_R was 0, and the receive buffer had no room for the second telegram"),
    (
        "cp040",
        37826,
        "the judge: after a start-up with a reset and a job in one call it took the DONE of the job for the reset's",
    ),
    ("cp040", 48184, "as 37826"),
    ("cp040", 75203, "the judge: an edge of REQ while R is on may be that of a job which waits for the reset"),
    ("cp040", 89889, "as 75203"),
    ("cp040", 15506, "the judge, after the mend of 37826: the DONE of the reset for that of the job"),
    ("cp040", 28002, "the judge: an edge of REQ in the call of R, behind one of which nobody knew whether it counts"),
];

const SAME_START: &str =
    "after STOP -> RUN the block showed the START of before, byte for byte, and the CP did not look";

fn passes(subject: &Subject, seed: u64) {
    let folder = tempfile::tempdir().expect("a folder");
    let outcome = (subject.run)(seed, folder.path(), false).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    });
    let findings: Vec<String> = outcome.verdict.findings.iter().map(ToString::to_string).collect();
    let replay = format!("cargo xtask programs {} --seed {seed} --log", subject.name);
    assert!(findings.is_empty(), "{} seed {seed}: {findings:#?}\nreplay: {replay}", subject.name);
}

#[test]
fn a_few_programs_of_each_cp() {
    for subject in SUBJECTS {
        (1..=12).for_each(|seed| passes(subject, seed));
    }
}

#[test]
fn programs_that_found_something() {
    for (name, seed, cause) in FOUND {
        let subject =
            SUBJECTS.iter().find(|subject| subject.name == *name).unwrap_or_else(|| panic!("{name}: {cause}"));
        passes(subject, *seed);
    }
}

/// Everything is drawn from the seed: the same log again.
#[test]
fn the_same_seed_gives_the_same_log() {
    for subject in SUBJECTS {
        let folder = tempfile::tempdir().expect("a folder");
        let run = || (subject.run)(7, folder.path(), true).expect("a run").log;
        assert!(run() == run(), "{}", subject.name);
    }
}
