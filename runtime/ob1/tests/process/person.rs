//! What the person at the machine asks a running station: what runs, what has which value, why it is off, why STOP.

use crate::bench::{Bench, until};

const PLANT: &str = "FUNCTION_BLOCK FB 20\nVAR_INPUT\n on : BOOL;\nEND_VAR\nVAR_OUTPUT\n run : BOOL;\nEND_VAR\nBEGIN\nNETWORK\nU #on;\n\
    U E 0.1;\n= #run;\nEND_FUNCTION_BLOCK\n\
    DATA_BLOCK DB 21 FB 20\nBEGIN\nEND_DATA_BLOCK\n\
    DATA_BLOCK DB 5\nSTRUCT\n TEXT : STRING[8] := 'new';\n SPEED : REAL := 12.565;\n WHEN : DATE_AND_TIME := DT#2026-1-31-6:30:0;\n\
    RAMP : S5TIME := S5T#1S500MS;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\
    FUNCTION FC 3 : VOID\nBEGIN\nNETWORK\nU E 0.7;\n= A 5.0;\nAUF DB 77;\nEND_FUNCTION\n\
    ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nU E 0.2;\nUN E 0.3;\n= M 10.0;\nNETWORK\nU M 10.0;\nU(;\nO E 0.4;\nO E 0.5;\n);\n= A 4.0;\n\
    NETWORK\nCALL FB 20, DB 21 (on := M 10.0, run := A 4.1);\nNETWORK\nU E 0.6;\nSPBN m1;\nCALL FC 3;\nm1: NOP 0;\n\
    END_ORGANIZATION_BLOCK\n";

const SYMBOLS: &str = "\"Motor\",\"A       4.0\",\"BOOL\",\"the motor\"\r\n\"Guard\",\"E       0.1\",\"BOOL\",\"the guard\"\r\n\
    \"Delay\",\"T       1\",\"TIMER\",\"\"\r\n";

fn plant() -> Bench {
    let bench = Bench::new();
    bench.write("bench.awl", PLANT);
    bench.write("bench.sdf", SYMBOLS);
    let station = crate::bench::STATION.replace("[\"bench.awl\"]", "[\"bench.awl\"]\nsymbols = [\"bench.sdf\"]");
    bench.write("bench.toml", &station.replace("\n[process_io]\nstimulus = \"panel.toml\"\n", ""));
    bench
}

fn said(bench: &Bench, args: &[&str]) -> String {
    let output = bench.ob1(args);
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// The lines that decide are marked.
fn marked(text: &str) -> Vec<String> {
    let lines = text.lines().filter(|line| line.ends_with('<'));
    lines.map(|line| line.split_whitespace().take(3).collect::<Vec<_>>().join(" ")).collect()
}

#[test]
fn the_contact_that_keeps_an_output_off_is_named() {
    let bench = plant();
    let _station = bench.start(&[]);
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "RUN");
    assert_eq!(bench.code(&["set", "bench", "E0.4=1"]), Some(0));
    // Two levels: the flag, and what keeps it off.
    let why = said(&bench, &["why", "bench", "Motor"]);
    assert!(why.starts_with("A 4.0 \"Motor\" is 0\n  by OB 1, network 2, "), "{why}");
    assert!(why.contains("    M 10.0 is 0\n      by OB 1, network 1, "), "{why}");
    assert_eq!(marked(&why), ["0 E 0.2", "0 E 0.2"], "{why}");
    // Through a call, an instance and its parameter.
    assert_eq!(bench.code(&["set", "bench", "E0.2=1"]), Some(0));
    let why = said(&bench, &["why", "bench", "Q4.1"]);
    assert!(why.contains("FB 20 #run is 0") && why.contains("FB 20 #on = M 10.0"), "{why}");
    assert_eq!(marked(&why), ["0 E 0.1"], "{why}");
    assert_eq!(bench.code(&["set", "bench", "E0.1=1"]), Some(0));
    assert!(said(&bench, &["why", "bench", "A4.1"]).contains("FB 20 #run is 1"));
    // A block that is not called, and what it would write.
    for asked in [&["why", "bench", "FC 3"][..], &["why", "bench", "A5.0"]] {
        let why = said(&bench, asked);
        assert!(why.contains("not reached: led away by OB 1, network 4, "), "{why}");
        assert_eq!(marked(&why), ["0 E 0.6"], "{why}");
    }
    let wrong = bench.ob1(&["why", "bench", "MW0"]);
    assert_eq!(wrong.status.code(), Some(8), "{wrong:?}");
    // A fault: run waits for the first scan, and says why there is none.
    assert_eq!(bench.code(&["set", "bench", "E0.6=1"]), Some(0));
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "STOP");
    let run = bench.ob1(&["ctl", "bench", "run"]);
    let text = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.code() == Some(3) && text.contains("STOP: 253Ah") && text.contains("FC 3"), "{run:?}");
    assert!(said(&bench, &["ctl", "bench", "status"]).contains("STOP: 253Ah"));
    // In STOP its cause is why everything is off.
    let why = said(&bench, &["why", "bench", "Motor"]);
    assert!(why.contains("bench is in STOP") && why.contains("STOP: 253Ah") && why.contains("FC 3"), "{why}");
}

#[test]
fn values_are_shown_and_written_in_their_form() {
    let bench = plant();
    let _station = bench.start(&[]);
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "RUN");
    assert!(said(&bench, &["list"]).lines().any(|line| line.starts_with("bench ") && line.contains(" RUN ")));
    let all = said(&bench, &["get", "bench"]);
    for part in ["Motor", "Guard", "Delay", "S5T#0MS"] {
        assert!(all.contains(part), "{part}\n{all}");
    }
    let text = |names: &[&str]| {
        let names: Vec<&str> = ["get", "bench"].iter().chain(names).copied().collect();
        said(&bench, &names)
            .lines()
            .map(|line| line.split_once("  ").map_or("", |(_, v)| v.trim()).to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(
        text(&["DB5.TEXT", "DB5.SPEED", "DB5.WHEN", "DB5.RAMP", "DB5.DBW10:hex"]),
        ["'new'", "12.565", "DT#2026-1-31-6:30:0.000", "S5T#1S500MS", "16#4149"]
    );
    let set = [
        "set",
        "bench",
        "DB5.TEXT='it is'",
        "DB5.SPEED=1.5",
        "DB5.WHEN=DT#2026-2-1-0:0:0",
        "DB5.RAMP=S5T#5S",
        "MD20=1.5",
    ];
    assert_eq!(bench.code(&set), Some(0), "{}", said(&bench, &set));
    assert_eq!(
        text(&["DB5.TEXT", "DB5.SPEED", "DB5.WHEN", "DB5.RAMP", "MD20:hex"]),
        ["'it is'", "1.5", "DT#2026-2-1-0:0:0.000", "S5T#5S", "16#3FC00000"]
    );
    let reset = bench.ob1(&["ctl", "bench", "reset", "--yes"]);
    assert!(
        reset.status.code() == Some(8) && String::from_utf8_lossy(&reset.stderr).contains("first ob1 ctl bench stop")
    );
    assert_eq!(bench.code(&["ctl", "bench", "stop"]), Some(0));
    until(|| bench.json(&["ctl", "bench", "status", "--json"])["state"] == "STOP");
    assert_eq!(bench.code(&["ctl", "bench", "reset"]), Some(1), "it asks, and nobody answers");
    assert_eq!(bench.code(&["ctl", "bench", "reset", "--yes"]), Some(0));
    until(|| text(&["DB5.SPEED"]) == ["12.565"]);
    let restart = said(&bench, &["ctl", "bench", "restart"]);
    assert!(restart.contains("ob1 ctl bench warm, or ob1 ctl bench cold"), "{restart}");
}
