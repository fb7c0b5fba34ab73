//! Block status over S7 communication beside a judge that is not ours: a client in Python uploads a program drawn at
//! random, executes its machine code, and compares the registers behind every statement, in both forms.

use std::net::TcpStream;
use std::process::Stdio;

use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::{checkout, python};

/// Blocks of the program, without OB 1.
const BLOCKS: u64 = 100;

/// The output of one of the scripts.
fn script(site: &Site, name: &str, arguments: &[&str]) -> (bool, String) {
    let mut command = site.command(python());
    command.arg(checkout("tests/peers").join(name)).args(arguments);
    let output = command.stderr(Stdio::inherit()).output().expect("it starts");
    (output.status.success(), String::from_utf8(output.stdout).expect("text"))
}

/// The numbers in a line.
fn numbers(line: &str) -> Vec<u64> {
    let parts = line.split(|sign: char| !sign.is_ascii_alphanumeric());
    parts.filter_map(|part| part.parse().ok()).collect()
}

fn every_statement_is_told_as_it_ran(engine: &str, seed: &str) {
    let (site, port) = (Site::new(), free_port());
    let (drawn, source) = script(&site, "s7_programs.py", &[seed, &BLOCKS.to_string()]);
    assert!(drawn, "a program");
    site.write("p.awl", &source);
    // What a watched block may cost is no matter here.
    site.write(
        "judge.toml",
        &format!(
            "[station]\nname = \"judge\"\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\nmemory_bytes = 2048\n\
             test_load = 1000\nengine = \"{engine}\"\n[program]\nsources = [\"p.awl\"]\n[[link]]\ntype = \"s7\"\n\
             name = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"read\"\n"
        ),
    );
    let station = site.run("judge.toml").until_run();
    station.until("the link listens", |_| TcpStream::connect(("127.0.0.1", port)).ok());
    let (equal, said) = script(&site, "s7_status.py", &["127.0.0.1", &port.to_string(), "--seed", seed]);
    assert!(equal, "{engine}, seed {seed}\n{said}");
    let lines: Vec<&str> = said.lines().collect();
    let [new, old, verdict] = lines[..] else { panic!("{said}") };
    for (line, form) in [(new, "form 13: "), (old, "form 01: ")] {
        let counted = numbers(line.strip_prefix(form).unwrap_or_else(|| panic!("{said}")));
        let [blocks, environments, statements, ran, left, scans] = counted[..] else { panic!("{said}") };
        assert_eq!(blocks, BLOCKS + 1, "{said}");
        // Blocks with several callers are watched from each; some statements are jumped over. Most of what is left by a
        // CALL, and so is not compared, is behind the statements of that CALL.
        assert!(environments > 0 && ran < statements && statements > 50 * BLOCKS && left < ran, "{said}");
        // Each block is watched in a scan of its own.
        assert!(scans >= BLOCKS, "{said}");
    }
    let counted = numbers(verdict);
    assert_eq!((counted[0], counted[2]), (BLOCKS, 0), "{said}");
    assert_eq!(station.interrupt().code(), Some(0));
}

#[test]
fn a_stranger_agrees_with_block_status_on_the_reference_engine() {
    every_statement_is_told_as_it_ran("reference", "1");
}

#[test]
fn a_stranger_agrees_with_block_status_on_machine_code() {
    every_statement_is_told_as_it_ran("native", "2");
}
