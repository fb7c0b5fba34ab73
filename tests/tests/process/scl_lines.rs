//! Programs of SCL in a running station: program status, breakpoints, the line of a fault.

use std::io::Write as _;
use std::process::Stdio;

use ob1_station::access::protocol::Op;

use crate::common::program;
use crate::common::site::Site;

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
