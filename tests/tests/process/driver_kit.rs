//! `ob1 driver test`: our drivers keep the rules of docs/driver.md, and the kit finds each mutant of one.

use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::{checkout, program};

/// A change of one place of the driver in C, and the rules of which one must be named then.
struct Mutant {
    rules: &'static [u8],
    from: &'static str,
    to: &'static str,
}

const fn breaks(rules: &'static [u8], from: &'static str, to: &'static str) -> Mutant {
    Mutant { rules, from, to }
}

/// Each rule has one at least.
const MUTANTS: &[Mutant] = &[
    breaks(&[1], "put(GENERATION, generation);", ""),
    breaks(&[2], "refuse(\"the header of the segment is not one of version 1\");", ";"),
    breaks(&[3], "refuse(\"the segment is not sealed\");", ";"),
    breaks(&[3], "refuse(\"the segment has another size\");", ";"),
    breaks(&[4], "fcntl(fd, F_SETLK, &lock) != 0", "lock.l_type == 77"),
    breaks(&[5], "refuse(\"a driver is attached to the segment already\");", ";"),
    breaks(&[6], "write_words(INPUTS, zeros, 8);", ""),
    breaks(&[7], "write_words(SEND_TO_CPU, zeros, 8);", ""),
    breaks(&[7], "write_words(RECEIVE_TO_CPU, zeros, 8);", ""),
    breaks(&[8], "write_words(DIAGNOSIS, zeros, 2);", ""),
    breaks(&[9], "poke(LEDS, 0);", ""),
    breaks(&[9], "poke(REASON, 0);", ""),
    breaks(&[10], "s % 2 == 0 ? s + 1 : s + 2", "s + 1"),
    breaks(&[11], "count(ORDERS_LOST, lost(ACCEPTED, SENT));", ""),
    breaks(&[11], "count(RECEIVE_LOST, lost(RECEIVED, DELIVERED));", ""),
    breaks(&[12], "count(DRIVER_STARTS, 1);", ""),
    breaks(&[12], "    identify(tx);\n    poke(LEDS", "    count(DRIVER_STARTS, 1);\n    identify(tx);\n    poke(LEDS"),
    breaks(&[13, 38], "if (peek(PRODUCED) - get(CONSUMED) > 64)", "if (peek(PRODUCED) > 0)"),
    breaks(&[14], "if (peek(PRODUCED) - get(CONSUMED) > 64)", "if (peek(PRODUCED) == 7)"),
    breaks(&[15], "poke(REASON, 0);", "poke(REASON, 0); poke(0x2580 + 8 * 64, 0);"),
    breaks(&[15, 18], "poke(REASON, 0);", "poke(REASON, 0); poke(0x2500, 0);"),
    breaks(&[16], "peek(GENERATION) + 1", "peek(GENERATION) + 2"),
    breaks(
        &[16],
        "    identify(tx);\n    poke(LEDS",
        "    put(GENERATION, get(GENERATION) + 1);\n    identify(tx);\n    poke(LEDS",
    ),
    breaks(&[17], "poke(HEARTBEAT,", "poke(0x2f8, 1); poke(HEARTBEAT,"),
    breaks(&[17], "poke(HEARTBEAT,", "poke(CONSUMED, peek(PRODUCED)); poke(HEARTBEAT,"),
    breaks(&[18, 52], "count(BYTES_RX, (uint64_t)n);", "poke(COUNTERS + 8 * BYTES_RX, (uint64_t)n);"),
    breaks(&[19], "put(at, odd + 1);", "put(at, s);"),
    breaks(&[20], "put(at, odd + 1);", "if (peek(STATE) != READY) put(at, odd + 1);"),
    breaks(&[21], "if (a % 2 == 1)\n            continue;", ""),
    breaks(&[21, 23], "try < 4", "try < 4 || get(at) % 2 == 1"),
    breaks(&[22], ": READY);", ": 6);"),
    breaks(&[23], "poke(HEARTBEAT, peek(HEARTBEAT) + 1);", ""),
    breaks(&[24, 34], "emit(MESSAGE, 8, \"\", 0);\n    last_state", "exit(1);\n    last_state"),
    breaks(&[25], "return n != 0;", "return 1;"),
    breaks(&[25, 26], "close_line();\n    return 0;\n}", "return 4;\n}"),
    breaks(&[26], "sigaction(SIGTERM, &action, NULL);", "signal(SIGTERM, SIG_IGN); (void)action;"),
    breaks(&[27], "signal(SIGHUP, SIG_IGN);", ""),
    breaks(&[28], "born = nanos();", "born = nanos(); if (fork() == 0) for (;;) pause();"),
    breaks(&[29], "put(STATE, NO_PARAMETERS);", "put(STATE, READY);"),
    breaks(&[30], ": READY);", ": STARTING);"),
    breaks(&[31], "put(STATE, PARAMETER_ERROR | 0x100ull << 32);", ""),
    breaks(
        &[32],
        "    identify(tx);\n    poke(LEDS",
        "    if (phase <= REFUSED)\n        identify(tx);\n    poke(LEDS",
    ),
    breaks(&[33], "    if (line >= 0)\n        close(line);", ""),
    breaks(&[24, 34], "        text = 0;\n", ""),
    breaks(&[35], "int idle = peek(CHANGES) == mark;", "int idle = 1;"),
    breaks(
        &[35],
        "poke(SLEEPING, 1);\n        atomic_thread_fence(memory_order_seq_cst);\n        int idle = peek(CHANGES) == mark;",
        "int idle = peek(CHANGES) == mark;\n        poke(SLEEPING, 1);",
    ),
    breaks(&[35], "        atomic_thread_fence(memory_order_seq_cst);\n        int idle", "        int idle"),
    breaks(
        &[35],
        "        int again = look_at_cpu();\n        transmit();",
        "        int again = look_at_cpu();\n        mark = get(CHANGES);\n        transmit();",
    ),
    breaks(&[36], "poke(SLEEPING, 1);", ""),
    breaks(&[25, 37], "while ((n = read(0, bytes, sizeof bytes)) > 0)\n        ;", "n = bytes[0] = 1;"),
    breaks(&[38], "if (produced - get(CONSUMED) >= 64)", "if (produced == 7777)"),
    breaks(&[38], "poke(LOST, peek(LOST) + 1);", ""),
    breaks(&[39], "(uint64_t)length << 16", "(uint64_t)(length + 20) << 16"),
    breaks(&[40], "emit(MESSAGE, 1,", "emit(3, 1,"),
    breaks(&[41], "number = number % 255 + 1;", "number = 0;"),
    breaks(&[32, 41], "number = number % 255 + 1;", "number = 7;"),
    breaks(&[42], "phase == WORKING; i++", "phase >= IDENTIFY; i++"),
    breaks(&[43], " && tx == (0x8000 | number))", ")"),
    breaks(&[44], "reset && !reset_seen", "reset && reset_seen && !tx"),
    breaks(&[45], "rest = n;", "rest = n & 0xff;"),
    breaks(&[46], "memcpy(telegram + length, block, part);", "memcpy(telegram + length, block, part - 1);"),
    breaks(&[46, 52], "out_length = length;", "out_length = length - 1;"),
    breaks(
        &[46],
        "else if (sending == COLLECTING && n == 0) {",
        "else if (sending == COLLECTING && n == 0) {\n        write(line, telegram, 1);",
    ),
    breaks(&[47], "fail(0x17);", "fail(0x0c);"),
    breaks(&[47], "if (sending == FAILED && tx == 0x2000)", "if (sending == FAILED && (tx == 0x2000 || tx == 0))"),
    breaks(&[44, 46, 47, 48, 52], "n == 0 && rest > BLOCK)", "n == 0 && rest > 9999)"),
    breaks(&[45, 46, 47, 49, 52], "n == rest - BLOCK", "n < rest"),
    breaks(&[50], "queue[first].bytes + fetched", "queue[first].bytes"),
    breaks(&[50], "coming[coming_length++] = bytes[i];", "coming[coming_length++] = bytes[i] == 0x11 ? 0 : bytes[i];"),
    breaks(&[51], "offered != 0 && echo == offered", "offered != 0 && echo != 0"),
    breaks(&[51], "waiting > 0 && echo == 0)", "waiting > 0)"),
    breaks(&[52], "count(SENT, 1);", ""),
    breaks(&[52], "count(DELIVERED, 1);", ""),
    breaks(&[53], "count(REJECTED_FULL, 1);", ";"),
];

/// Compiles a driver in C.
fn compile(source: &str, to: &Path) {
    let file = to.with_extension("c");
    std::fs::write(&file, source).expect("written");
    let cc = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let built = Command::new(cc).args(["-std=gnu11", "-O1", "-w", "-o"]).arg(to).arg(&file).status();
    assert!(built.expect("a C compiler").success(), "{}", file.display());
}

/// The exit code and what was printed.
fn kit(driver: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let run = Command::new(program("ob1")).args(["driver", "test"]).arg(driver).args(arguments).output();
    let run = run.expect("ob1 runs");
    let text = String::from_utf8_lossy(&run.stdout).into_owned() + &String::from_utf8_lossy(&run.stderr);
    (run.status.code(), text)
}

fn keeps_the_rules(driver: &Path, arguments: &[&str]) {
    let (code, text) = kit(driver, arguments);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("all kept"), "{text}");
}

#[test]
fn our_driver_keeps_the_rules() {
    keeps_the_rules(&program("ob1-cp"), &["--seeds", "108", "--jobs", "6"]);
    for other in ["cp040", "cp340", "cp341"] {
        keeps_the_rules(&program("ob1-cp"), &["--seeds", "24", "--jobs", "6", "--cp", other]);
    }
}

#[test]
fn the_driver_in_c_keeps_the_rules() {
    let dir = tempfile::tempdir().expect("a folder");
    let driver = dir.path().join("driver");
    compile(&std::fs::read_to_string(checkout("examples").join("driver-c/driver.c")).expect("the source"), &driver);
    keeps_the_rules(&driver, &["--seeds", "108", "--jobs", "6"]);
}

#[test]
fn the_driver_in_python_keeps_the_rules() {
    keeps_the_rules(&checkout("examples").join("driver-python/driver.py"), &["--seeds", "60", "--jobs", "6"]);
}

/// Mutants tested at the same time: most of the time the kit waits for a driver that does not answer.
const AT_ONCE: usize = 4;

#[test]
fn each_mutant_is_found_and_its_rule_named() {
    let source = std::fs::read_to_string(checkout("examples").join("driver-c/driver.c")).expect("the source");
    let dir = tempfile::tempdir().expect("a folder");
    let (next, missed) = (AtomicUsize::new(0), Mutex::new(String::new()));
    let work = || {
        while let Some((index, mutant)) = MUTANTS.iter().enumerate().nth(next.fetch_add(1, Ordering::Relaxed)) {
            assert!(source.contains(mutant.from), "the source has no {:?}", mutant.from);
            let driver = dir.path().join(format!("mutant-{index}"));
            compile(&source.replacen(mutant.from, mutant.to, 1), &driver);
            let (code, text) = kit(&driver, &["--seeds", "120", "--jobs", "3", "--breaks", "1"]);
            let is_named = mutant.rules.iter().any(|rule| text.contains(&format!("D{rule} is broken")));
            if code != Some(1) || !is_named {
                let told = format!("{index}: {:?} -> {:?}, rules {:?}\n{text}\n", mutant.from, mutant.to, mutant.rules);
                *missed.lock().expect("whole") += &told;
            }
        }
    };
    std::thread::scope(|scope| (0..AT_ONCE).for_each(|_| drop(scope.spawn(work))));
    let missed = missed.into_inner().expect("whole");
    assert!(missed.is_empty(), "{missed}");
}

#[test]
fn each_rule_has_a_mutant() {
    for rule in ob1_command::driver::Rule::ALL {
        let number = *rule as u8;
        assert!(MUTANTS.iter().any(|mutant| mutant.rules.contains(&number)), "D{number}");
    }
}

#[test]
fn a_verdict_names_rule_seed_and_step_for_people_and_as_junit() {
    let dir = tempfile::tempdir().expect("a folder");
    let (driver, junit) = (dir.path().join("driver"), dir.path().join("results.xml"));
    let source = std::fs::read_to_string(checkout("examples").join("driver-c/driver.c")).expect("the source");
    compile(&source.replacen("fail(0x17);", "fail(0x0c);", 1), &driver);
    let (code, text) = kit(&driver, &["--seeds", "30", "--junit", &junit.to_string_lossy()]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("D47 is broken: ") && text.contains("an order that is too long: "), "{text}");
    let xml = std::fs::read_to_string(junit).expect("written");
    assert!(xml.contains("tests=\"53\" failures=\"1\" errors=\"0\""), "{xml}");
    assert!(xml.contains("name=\"D47 ") && xml.contains("<failure message=\"seed "), "{xml}");
    let (code, text) = kit(&dir.path().join("nothing"), &[]);
    assert_eq!(code, Some(2), "{text}");
    // A program that cannot be started at all.
    let (code, text) = kit(&dir.path().join("driver.c"), &["--seeds", "1"]);
    assert_eq!(code, Some(2), "{text}");
}
