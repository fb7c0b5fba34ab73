//! The walk of docs/online.md, "A fault in a running plant": its commands give what it shows.

use std::fs;

use ob1_backplane::IoField;

use crate::common::checkout;
use crate::common::site::Site;

/// A command of the walk, and the lines it shows.
fn steps(page: &str) -> Vec<(String, Vec<String>)> {
    let (_, rest) = page.split_once("## A fault in a running plant\n").expect("the section");
    let section = rest.split("\n## ").next().unwrap_or_default();
    let mut steps: Vec<(String, Vec<String>)> = Vec::new();
    for fence in section.split("```console\n").skip(1) {
        for line in fence.split("```").next().unwrap_or_default().lines() {
            match (line.strip_prefix("$ "), steps.last_mut()) {
                (Some(command), _) => steps.push((command.to_owned(), Vec::new())),
                (None, Some((_, shown))) => shown.push(line.to_owned()),
                (None, None) => panic!("a line without a command: {line}"),
            }
        }
    }
    steps
}

#[test]
fn the_walk_shows_what_the_commands_say() {
    let site = Site::new();
    let example = checkout("examples/step7-project").display().to_string();
    site.ob1(&["import", &example, "--out", "press"]).fine();
    let station = site.run("press/station.toml").until_run();
    let field = IoField::open(&station.rundir.join("io")).expect("process I/O");
    field.write_inputs(0, &[3]);
    let motor = "the start button is pressed";
    station.until(motor, |_| site.ob1(&["get", "press", "I0.0"]).out.contains("1").then_some(()));
    let steps = steps(&fs::read_to_string(checkout("docs/online.md")).expect("the page"));
    assert!(steps.len() >= 12, "{steps:?}");
    let main = site.path("press/blocks/OB_1.awl");
    let source = fs::read_to_string(&main).expect("a source");
    for (command, shown) in &steps {
        if command == "ob1 load press --check" {
            fs::write(&main, source.replace("S5T#2S", "S5T#1S")).expect("room");
        }
        let words: Vec<&str> = command.split_whitespace().collect();
        let ran = site.ob1(&words[1..]);
        let said = format!("{}{}", ran.out, ran.err.replace("ob1: ", ""));
        for line in shown {
            assert!(said.lines().any(|of| of == line), "{command}\n{line}\nis not in\n{said}");
        }
    }
    assert_eq!(station.interrupt().code(), Some(0));
}
