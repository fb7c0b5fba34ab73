//! Each finding with a program that has it, and with one that does not.

use std::collections::BTreeMap;
use std::path::Path;

use ob1_model::Interface;
use ob1_stl::Source;

use super::sites::Handling;
use super::*;
use crate::program;
use ob1_station_file::{library, sources};

/// A CP of a type at address 256, on a simulated line.
fn cp(kind: &str, params: &str, more: &str) -> String {
    format!("[[module]]\ntype = \"{kind}\"\nname = \"x\"\naddress = 256\nline = \"sim:l\"\nparams = {params}\n{more}\n")
}

const BOX: &str = "[[simulated_line]]\nname = \"l\"\n";

/// What is told of a program: number and line.
fn told(modules: &str, text: &str) -> Vec<(String, u32)> {
    findings_of(modules, text).into_iter().map(|finding| (finding.code, finding.line)).collect()
}

fn findings_of(modules: &str, text: &str) -> Vec<Finding> {
    let file = format!("[station]\nname = \"s\"\n[cpu]\ntimers = 8\n[program]\nsources = []\n{BOX}{modules}");
    let station = ob1_station_file::parse(&file, "s.toml", Path::new("/s")).unwrap_or_else(|found| panic!("{found:?}"));
    // The library of the CP of the modules: the plugins are not at hand here.
    let kind = station.modules.first().and_then(|module| module.kind.cp()).expect("a CP");
    let standard = library::whole(kind.name()).expect("its library");
    let blocks: Vec<(BlockId, Interface)> =
        standard.iter().filter_map(|choice| Some((choice.id, choice.block()?.interface))).collect();
    let handling: BTreeMap<BlockId, Handling<'_>> =
        blocks.iter().map(|(id, interface)| (*id, Handling::new(kind, *id, interface))).collect();
    let known = program::library(&[], &standard).expect("one library");
    let source = Source::new("p.awl", text.as_bytes());
    let wanted = sources::Sources { library: standard, ..sources::Sources::default() };
    let compiled = program::compile_texts(&[source], &wanted, &known, Vec::new());
    let compiled = compiled.unwrap_or_else(|found| panic!("{}", found[0].text));
    findings(&compiled.program, &handling, &station)
}

/// OB 1 of these statements, the first of them in line 3.
fn ob_1(code: &str) -> String {
    format!("ORGANIZATION_BLOCK OB 1\nBEGIN\n{code}\nEND_ORGANIZATION_BLOCK\n{DATA_BLOCKS}")
}

const DATA_BLOCKS: &str =
    "DATA_BLOCK DB 10\nSTRUCT\n  b : ARRAY [0 .. 99] OF BYTE;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";

const SYNCHRON: &str = "CALL FC 9 (ADR := 256, TIMER_NR := T 2, ANL := M 3.0, NULL := M 3.1, RESET := M 3.2, \
    STEUERB_S := MB 2, STEUERB_R := MB 1);\n";

/// FC 0 with an address, a data block, ABD and ANZ.
fn send(adr: &str, db: u16, abd: &str, anz: &str) -> String {
    format!(
        "CALL FC 0 (ADR := {adr}, _DB := DB {db}, ABD := {abd}, ANZ := {anz}, FRG := M 5.1, GESE := MW 48, ANZ_INT := MW \
         50, ENDE_KOMM := M 2.0, LETZTER_BLOCK := M 2.1, SENDEN_LAEUFT := M 2.2, FEHLER_KOM := M 2.3, PAFE := MB 43);\n"
    )
}

fn receive(number: u16, abd: &str) -> String {
    format!(
        "CALL FC {number} (ADR := 256, _DB := DB 10, ABD := {abd}, ANZ := MW 40, EMFR := M 5.0, GEEM := MW 44, ANZ_INT := \
         MW 46, EMPF_LAEUFT := M 1.0, LETZTER_BLOCK := M 1.1, FEHLER_EMPF := M 1.2, PAFE := MB 42);\n"
    )
}

fn send_rk(qbdw: &str) -> String {
    format!(
        "CALL FC 3 (ADR := 256, QDB := DB 10, QBDW := {qbdw}, LANG := 20, ZDB := DB 20, ZBDW := 0, KOOR := W#16#FFFF, \
         ANZW := MW 60, PAFE := MB 62, ANZ := MW 64, GESE := MW 66, KOPF_GESENET := M 2.5, ERSTER_BLOCK := M 2.0, \
         SENDEN_LAEUFT := M 2.1, SENDEN_FERTIG := M 2.2, LETZTER_BLOCK := M 2.3, FEHLER := M 2.4);\n"
    )
}

const LINES: &str = "CALL FC 8 (ADR := 256, RTS := M 7.0, DTR := M 7.1, MASKE_RTS := M 7.2, MASKE_DTR := M 7.3, STATUS := MB \
    70, DELTA_STATUS := MB 71, START := M 7.4, AUFTRAG_LAEU := M 7.5, RET_VAL := MW 72);\n";

const ASCII: &str = "{ protocol = \"ascii\" }";
const FRAGMENTED: &str = "{ protocol = \"ascii-fragmented\" }";
const RK512: &str = "{ protocol = \"3964r-rk512\" }";
const MASTER: &str = "{ protocol = \"modbus-master-rtu\" }";

fn code(number: &str, line: u32) -> Vec<(String, u32)> {
    vec![(number.to_owned(), line)]
}

/// FC 0 as it should be.
fn good() -> String {
    send("256", 10, "W#16#0", "W#16#5")
}

#[test]
fn a_block_that_does_not_fit_its_protocol() {
    let told_of = |params: &str, call: &str| told(&cp("cp240", params, ""), &ob_1(&[SYNCHRON, call].concat()));
    for (params, call, expected) in [
        (RK512, good(), true),
        (RK512, receive(1, "W#16#0"), true),
        (RK512, receive(11, "W#16#0"), true),
        (RK512, send_rk("W#16#0"), false),
        (ASCII, send_rk("W#16#0"), true),
        (ASCII, good(), false),
        (FRAGMENTED, receive(1, "W#16#0"), true),
        (FRAGMENTED, receive(11, "W#16#0"), false),
        (ASCII, receive(11, "W#16#0"), false),
    ] {
        let expected = if expected { code(DOES_NOT_FIT, 4) } else { Vec::new() };
        assert_eq!(told_of(params, &call), expected, "{params} {call}");
    }
}

#[test]
fn fc_8_where_there_are_no_modem_lines() {
    for (params, interface, expected) in [
        (ASCII, "", false),
        (ASCII, "interface = \"rs232\"", false),
        (ASCII, "interface = \"rs422\"", true),
        (ASCII, "interface = \"rs485\"", true),
        ("{ protocol = \"mbus\" }", "", true),
    ] {
        let expected = if expected { code(DOES_NOT_FIT, 4) } else { Vec::new() };
        let program = ob_1(&[SYNCHRON, LINES].concat());
        assert_eq!(told(&cp("cp240", params, interface), &program), expected, "{params} {interface}");
    }
}

#[test]
fn a_cp_240_that_nobody_synchronises() {
    let module = |params| cp("cp240", params, "");
    assert_eq!(told(&module(ASCII), &ob_1(&good())), code(NO_SYNCHRONISATION, 3));
    assert_eq!(told(&module(ASCII), &ob_1(&[SYNCHRON, &good()].concat())), []);
    assert_eq!(told(&module(MASTER), &ob_1(&good())), [], "nothing to synchronise");
    // For another CP, in a block that never runs; and for an address that only the run knows, by the program itself.
    let elsewhere = SYNCHRON.replace("ADR := 256", "ADR := 512");
    assert_eq!(told(&module(ASCII), &ob_1(&(elsewhere + &good())))[1..], code(NO_SYNCHRONISATION, 4));
    let dead = format!("FUNCTION FC 100 : VOID\nBEGIN\n{SYNCHRON}END_FUNCTION\n{}", ob_1(&good()));
    assert_eq!(told(&module(ASCII), &dead), code(NO_SYNCHRONISATION, 7));
    let variable = SYNCHRON.replace("ADR := 256", "ADR := MW 90");
    assert_eq!(told(&module(ASCII), &ob_1(&(variable + &good()))), []);
    assert_eq!(told(&module(ASCII), &ob_1(&["L 0;\nT PAW 258;\n", &good()].concat())), []);
}

#[test]
fn an_address_without_such_a_cp() {
    let module = cp("cp240", ASCII, "") + "[[module]]\ntype = \"di\"\nname = \"i\"\naddress = 0\nbytes = 1\n";
    let calls = |adr: &str| ob_1(&[SYNCHRON, &send(adr, 10, "W#16#0", "W#16#5")].concat());
    assert_eq!(told(&module, &calls("512")), code(NO_CP, 4), "nothing there");
    assert_eq!(told(&module, &calls("0")), code(NO_CP, 4), "inputs");
    assert_eq!(told(&module, &calls("256")), []);
    assert_eq!(told(&module, &calls("MW 90")), [], "known in the run");
}

#[test]
fn a_data_block_that_is_missing_or_too_short() {
    let told_of = |call: &str, more: &str| told(&cp("cp240", ASCII, more), &ob_1(&[SYNCHRON, call].concat()));
    for (call, expected) in [
        (send("256", 99, "W#16#0", "MW 12"), true),
        (send("256", 10, "W#16#14", "W#16#50"), false),
        (send("256", 10, "W#16#14", "W#16#51"), true),
        (send("256", 10, "W#16#14", "MW 12"), false),
        (send("256", 10, "W#16#14", "W#16#4050"), false),
        (receive(1, "W#16#63"), false),
        (receive(1, "W#16#64"), true),
    ] {
        let expected = if expected { code(DATA, 4) } else { Vec::new() };
        assert_eq!(told_of(&call, ""), expected, "{call}");
    }
    assert_eq!(told_of(&receive(1, "W#16#32"), "abd = \"word\""), code(DATA, 4), "word 50 is byte 100");
    assert_eq!(told_of(&receive(1, "W#16#31"), "abd = \"word\""), []);
    // A program that makes data blocks may make this one.
    let made = "CALL SFC 22 (LOW_LIMIT := W#16#63, UP_LIMIT := W#16#63, COUNT := W#16#64, RET_VAL := MW 80, DB_NUMBER := \
        MW 82);\n";
    assert_eq!(told_of(&[made, &send("256", 99, "W#16#0", "MW 12")].concat(), ""), []);
    // RK 512 counts words: 20 from word 30 on are bytes 60 to 99.
    let rk512 = |qbdw: &str| told(&cp("cp240", RK512, ""), &ob_1(&[SYNCHRON, &send_rk(qbdw)].concat()));
    assert_eq!((rk512("W#16#1E"), rk512("W#16#1F")), (vec![], code(DATA, 4)));
}

#[test]
fn a_timer_that_the_cpu_does_not_have() {
    let with = |timer: &str| told(&cp("cp240", ASCII, ""), &ob_1(&SYNCHRON.replace("T 2", timer)));
    assert_eq!((with("T 8"), with("T 7")), (code(TIMER, 3), vec![]));
}

/// FB 8 with this instance.
fn send_341(instance: u16) -> String {
    format!("CALL FB 8, DB {instance} (SF := 'S', REQ := M 0.0, R := M 0.1, LADDR := 256, DB_NO := 10, DBB_NO := 0);\n")
}

fn instances_341() -> String {
    [20, 21].map(|db| format!("DATA_BLOCK DB {db}\nFB 8\nBEGIN\nEND_DATA_BLOCK\n")).concat()
}

/// [S4 L1584]
#[test]
fn two_instances_at_one_cp() {
    let module = cp("cp341", "{ protocol = \"3964r\" }", "");
    let with = |calls: [u16; 2]| told(&module, &(ob_1(&calls.map(send_341).concat()) + &instances_341()));
    assert_eq!((with([20, 21]), with([20, 20])), (code(INSTANCES, 4), vec![]));
    let other = send_341(21).replace("256", "272");
    let two = module.clone() + &module.replace("256", "272").replace("\"x\"", "\"y\"").replace("sim:l", "sim:m");
    let two = two + "[[simulated_line]]\nname = \"m\"\n";
    let program = ob_1(&[send_341(20), other].concat()) + &instances_341();
    assert_eq!(told(&two, &program), [], "each has its own");
    let slio = cp("cp040", "{ protocol = \"ascii\" }", "");
    let call = |db| format!("CALL FB 60, DB {db} (REQ := M 0.0, LADDR := 256, DB_NO := 10, CONTROL := MB 9);\n");
    let instances = instances_341().replace("FB 8", "FB 60");
    let with = |calls: [u16; 2]| told(&slio, &(ob_1(&calls.map(call).concat()) + &instances));
    assert_eq!((with([20, 21]), with([20, 20])), (code(INSTANCES, 4), vec![]));
}

/// A multi-instance is one for each instance around it.
#[test]
fn two_instances_of_the_block_around() {
    let module = cp("cp341", "{ protocol = \"3964r\" }", "");
    let around = "FUNCTION_BLOCK FB 100\nVAR\n  snd : FB 8;\nEND_VAR\nBEGIN\nCALL #snd (SF := 'S', REQ := M 0.0, R := M \
        0.1, LADDR := 256, DB_NO := 10, DBB_NO := 0);\nEND_FUNCTION_BLOCK\n";
    let instances = instances_341().replace("FB 8", "FB 100");
    let with = |calls: &str| told(&module, &[around, &ob_1(calls), &instances].concat());
    assert_eq!(with("CALL FB 100, DB 20;\n"), []);
    assert_eq!(with("CALL FB 100, DB 20;\nCALL FB 100, DB 20;\n"), []);
    assert_eq!(with("CALL FB 100, DB 20;\nCALL FB 100, DB 21;\n"), code(INSTANCES, 6));
}

#[test]
fn fc_0_twice_in_one_path() {
    let module = cp("cp240", MASTER, "");
    let of = |code: &str| told(&module, &ob_1(code));
    let one = good();
    assert_eq!(of(&[one.as_str(), &one].concat()), code(TWICE, 4));
    // One or the other.
    let either = format!("U M 0.0;\nSPB two;\n{one}SPA end;\ntwo: {one}end: NOP 0;\n");
    assert_eq!(of(&either), []);
    // The first can be followed by the second.
    let both = format!("U M 0.0;\nSPB two;\n{one}two: {one}");
    assert_eq!(of(&both), code(TWICE, 6));
    // Steps: the condition of the second may be that the first has no order.
    let steps = format!("U M 0.0;\nSPBN two;\n{one}two: U M 0.1;\nSPBN end;\n{one}end: NOP 0;\n");
    assert_eq!(of(&steps), []);
    assert_eq!(of(&format!("{one}U M 0.0;\nBEB;\n{one}")), []);
    // Through blocks.
    let block = format!("FUNCTION FC 100 : VOID\nBEGIN\n{one}END_FUNCTION\n");
    let calls = |code: &str| told(&module, &(block.clone() + &ob_1(code)));
    assert_eq!(calls("CALL FC 100;\nCALL FC 100;\n"), code(TWICE, 3), "the same call, twice in a scan");
    assert_eq!(calls("CALL FC 100;\n"), []);
    assert_eq!(calls("U M 0.0;\nSPB two;\nCALL FC 100;\nBEA;\ntwo: CALL FC 100;\n"), []);
    let guarded = format!("FUNCTION FC 100 : VOID\nBEGIN\nU M 0.0;\nSPBN end;\n{one}end: NOP 0;\nEND_FUNCTION\n");
    assert_eq!(told(&module, &(guarded + &ob_1("CALL FC 100;\nCALL FC 100;\n"))), [], "it may leave it out");
}

/// Every message says what it means on the machine, and what helps.
#[test]
fn a_finding_has_its_place_and_its_remedy() {
    let found = findings_of(&cp("cp240", ASCII, ""), &ob_1(&good()));
    let text = &found[0].text;
    assert!(text.starts_with("p.awl:3: warning L025: nothing calls FC 9 for \"x\": it shows its start-up"), "{text}");
    assert!(text.contains("  = call FC 9 with its ADR"), "{text}");
}
