//! Programs of SCL in a running station: program status and breakpoints with their lines; SCL sources of a project.

use std::io::Write as _;
use std::process::Stdio;

use ob1_project::NewProject;
use ob1_station::access::protocol::Op;
use ob1_tests::step7;

use crate::common::program;
use crate::common::site::Site;
use crate::import::{project, text};

const SOURCE: &str = "\
FUNCTION FC5 : INT
VAR_INPUT
    most : INT;
END_VAR
VAR
    i, sum : INT;
END_VAR
BEGIN
    sum := 0;
    FOR i := 1 TO most DO
        sum := sum + i;     // the heart of it
    END_FOR;
    IF sum > 100 THEN
        MW10 := 1;
    ELSIF sum > 5 THEN
        MW10 := 2;
    END_IF;
    CASE sum OF
        6:
            MW12 := 6;
        7:
            MW12 := 7;
    END_CASE;
    FC5 := sum;
END_FUNCTION
ORGANIZATION_BLOCK OB1
VAR_TEMP
    info : ARRAY[0..19] OF BYTE;
END_VAR
BEGIN
    MW20 := INT_TO_WORD(FC5(most := 3));
END_ORGANIZATION_BLOCK
";

fn site(engine: &str) -> Site {
    let site = Site::new();
    site.write("p.scl", SOURCE);
    let text = format!(
        "[station]\nname = \"lines\"\n[cpu]\nmin_cycle = \"5ms\"\nengine = \"{engine}\"\n[program]\nsources = [\"p.scl\"]\n"
    );
    site.write("st.toml", &text);
    site
}

#[test]
fn status_and_breakpoints_have_the_lines_of_the_source() {
    for engine in ["reference", "native"] {
        let site = site(engine);
        let station = site.run("st.toml").until_run();
        let said = site.ob1(&["status", "lines", "FC", "5", "--once"]).fine();
        let row = |line: &str| said.lines().find(|row| row.trim_start().starts_with(line)).unwrap_or_default();
        assert!(said.starts_with("FC 5 in OB 1, called by OB 1, ") && said.contains("p.scl:31, "), "{said}");
        assert!(row("9 ").contains("sum := 0;") && row("9 ").ends_with(" 1"), "{said}");
        assert!(row("10 ").contains("FOR i := 1 TO most DO") && row("10 ").contains("00000004"), "{said}");
        let heart = row("11 ");
        assert!(heart.contains("// the heart of it") && heart.contains("00000006") && heart.ends_with(" 3"), "{said}");
        assert!(row("14 ").ends_with(" -"), "not taken: {said}");
        assert!(row("15 ").contains("ELSIF") && row("15 ").ends_with(" 1"), "{said}");
        assert!(row("16 ").ends_with(" 1") && row("20 ").ends_with(" 1") && row("22 ").ends_with(" -"), "{said}");

        let mut command = site.command(program("ob1"));
        command.args(["debug", "lines", "--break", "FC 5:11"]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("ob1 starts");
        let mut tell =
            |lines: &str| child.stdin.as_mut().expect("a pipe").write_all(lines.as_bytes()).expect("it reads");
        tell("wait\n");
        station.until("HOLD", |s| (s.ask(Op::Status).ok()?.status?.state == "HOLD").then_some(()));
        tell("break FC 5:16\nstack\ndelete\nquit\n");
        let said = String::from_utf8(child.wait_with_output().expect("it ends").stdout).expect("text");
        for part in ["HOLD before FC 5, ", "p.scl:11, ", "1: OB 1, "] {
            assert!(said.contains(part), "{part}: {said}");
        }
        assert_eq!(station.interrupt().code(), Some(0));
    }
}

/// SCL sources of a project lie beside the station, and run in the place of the machine code when that is wanted.
#[test]
fn scl_sources_lie_beside_and_run_with_the_option() {
    let site = Site::new();
    let latch = "FUNCTION FC1 : VOID\nVAR_INPUT\n    Start, Stop : BOOL;\nEND_VAR\nVAR_OUTPUT\n    Motor : BOOL;\nEND_VAR\nBEGIN\n    \
                 Motor := (Start OR Motor) AND NOT Stop;     // für immer\nEND_FUNCTION\n";
    let source = |name: &str, text: &str| ob1_project::SourceText { name: name.into(), stl: false, text: text.into() };
    let changed = latch.replace("FC1", "FC2");
    let sources = vec![source("Latch", latch), source("Hidden", &changed)];
    let project = project(&site, &NewProject { sources, ..step7::example() }.files());
    for (folder, options, runs) in [("plain", &[][..], "FC_1.awl"), ("taken", &["--scl"][..], "Latch.scl")] {
        let out = site.path(folder);
        let folder = out.display().to_string();
        site.ob1(&[&["import", &project, "--out", &folder][..], options].concat()).fine();
        assert_eq!(text(&out.join("scl/Latch.scl")), latch);
        let report = text(&out.join("report.txt"));
        let how = if options.is_empty() {
            "can run in its place: --scl takes them"
        } else {
            "run in the place of the machine code"
        };
        let beside = format!(
            "2 SCL sources of the project lie here; 1 compile and declare the interface of their blocks, and {how}"
        );
        assert!(report.contains(&beside), "{report}");
        let stays = "scl/Hidden.scl: its blocks stay as they were compiled: it declares other parameters than FC 2 was compiled with";
        assert!(report.contains(stays), "{report}");
        let station = out.join("station.toml").display().to_string();
        site.ob1(&["check", &station]).fine();
        let listed = text(&out.join("station.toml"));
        assert!(listed.contains(runs) && listed.contains("FC_1.awl") != listed.contains("Latch.scl"), "{listed}");
        site.ob1(&["run", &station, "--scans", "20", "--quiet"]).fine();
    }
}
