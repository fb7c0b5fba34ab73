//! What waits to be written to memory: values across jumps, bits for their byte. Each program runs on the reference
//! engine and in both tiers; and where a write must not be there, the code is read.

use std::fmt::Write as _;

use fastrand::Rng;
use ob1_cpu::engine::{Factory, REFERENCE};
use ob1_cpu::{Command, Cpu, CpuConfig, Still, system_blocks};
use ob1_native::{AtLoad, Compiler, Target, Tier};

const SCANS: u32 = 6;
/// Random programs.
const PROGRAMS: u64 = 400;
/// A block that is inlined into its caller.
const FC: &str = "FUNCTION FC 1 : INT\nVAR_INPUT\n x : INT;\n on : BOOL;\nEND_VAR\nVAR_OUTPUT\n q : BOOL;\nEND_VAR\n\
    VAR_TEMP\n t : INT;\nEND_VAR\nBEGIN\nL #x;\n+ 3;\nT #t;\nU #on;\n= #q;\nSPBN z;\nL #t;\n+ 4;\nT #t;\nz: L #t;\nT #RET_VAL;\n\
    END_FUNCTION\n";
/// Words that [`program`] gives other values in each scan: MW 0, the count of scans, to MW 6.
const VALUES: usize = 4;

fn cpu(text: &str, engine: &dyn Factory) -> Cpu {
    let sources = [ob1_stl::Source::new("p.awl", text)];
    let output = ob1_stl::compile(&sources, &ob1_stl::Library::new(), &ob1_stl::Options::default());
    assert!(output.is_good(), "{:?}", output.diagnostics.first());
    Cpu::new(CpuConfig::default(), &output.program, system_blocks(), Vec::new(), engine).expect("it loads")
}

/// OB 1 with these statements, and data block 1 of eight words; `more`: other blocks.
fn program(statements: &str, more: &str) -> String {
    format!(
        "DATA_BLOCK DB 1\nSTRUCT\n a : ARRAY [0 .. 7] OF INT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n{more}\
         ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n info : ARRAY [1 .. 20] OF BYTE;\n t : ARRAY [0 .. 9] OF WORD;\nEND_VAR\n\
         BEGIN\nL MW 0;\n+ 1;\nT MW 0;\nL 12345;\n*I;\nT MW 2;\nL 321;\n*I;\nT MW 4;\nL 77;\n*I;\nT MW 6;\n\
         {statements}NOP 0;\nEND_ORGANIZATION_BLOCK\n"
    )
}

/// The program leaves the same memory, faults and counts on every engine, in each of some scans.
fn same(text: &str) {
    let mut reference = cpu(text, REFERENCE);
    let mut others = [cpu(text, &AtLoad(Tier::Fast)), cpu(text, &AtLoad(Tier::Optimised))];
    for tier in [Tier::Fast, Tier::Optimised] {
        let (made, all) = Compiler::new(Target::Host, tier).expect("this processor").image(reference.plan()).blocks();
        assert_eq!(made, all, "every block has code\n{text}");
    }
    reference.request(Command::Run);
    others.iter_mut().for_each(|cpu| cpu.request(Command::Run));
    for scan in 0..SCANS {
        reference.cycle(&mut Still);
        for cpu in &mut others {
            cpu.cycle(&mut Still);
            let what = format!("{} in scan {scan}\n{text}", cpu.engine());
            assert_eq!(reference.bit_memory(), cpu.bit_memory(), "{what}");
            assert_eq!(reference.data_block(1), cpu.data_block(1), "{what}");
            assert_eq!(reference.state(), cpu.state(), "{what}");
            assert_eq!(reference.statistics().statements, cpu.statistics().statements, "{what}");
            let [one, two] = [&reference, &*cpu].map(|cpu| cpu.diagnostics().map(ToString::to_string).collect());
            let (one, two): (Vec<String>, Vec<String>) = (one, two);
            assert_eq!(one, two, "{what}");
        }
    }
}

/// How often OB 1's code writes the memory of programs.
fn stores(statements: &str) -> usize {
    let cpu = cpu(&program(statements, ""), REFERENCE);
    let block = cpu.plan().blocks.iter().position(|block| block.id.to_string() == "OB 1").expect("it is there");
    let compiler = Compiler::new(Target::Host, Tier::Optimised).expect("this processor");
    let form = compiler.listing(cpu.plan(), block as u32).expect("code").form;
    form.lines().filter(|line| line.contains("store notrap region0")).count() - VALUES
}

#[test]
fn a_value_waits_across_a_jump_that_leads_forward() {
    let one = "L MW 0;\n+ 5;\nT MW 10;\nU M 1.0;\nSPBN a;\nL MW 4;\nT MW 12;\na: L MW 6;\nT MW 10;\n";
    same(&program(one, ""));
    assert_eq!(stores(one), 2, "what is replaced behind the jump is not written");
    let both = "L MW 0;\nT MW 10;\nU M 1.0;\nSPBN a;\nL 7;\nT MW 10;\na: L MW 10;\n+ 1;\nT MW 10;\n";
    same(&program(both, ""));
    assert_eq!(stores(both), 1);
}

/// A statement or some that mean something together, about few bytes of memory.
fn piece(random: &mut Rng) -> String {
    let byte = random.u8(8..16);
    let bit = format!("M {byte}.{}", random.u8(0..8));
    let width = *random.choice(["B", "W", "D"].iter()).expect("one of them");
    let computed = format!("L P#{byte}.{};\nT MD 20;\n", if width == "B" { random.u8(0..8) } else { 0 });
    let value = random.u8(0..8);
    match random.u8(0..16) {
        0 | 1 => format!("L M{width} {value};\nT M{width} {byte};\n"),
        2 => format!("L M{width} {byte};\nT M{width} {};\n", random.u8(8..16)),
        3 => format!("L {value};\nT M{width} {byte};\n"),
        4 => format!("L MW {byte};\nL MW {value};\n*I;\nT MW {};\n", random.u8(8..16)),
        5 => format!("L MD {value};\nL MW {byte};\n+D;\nT MD {};\n", random.u8(8..16)),
        6 | 7 => format!("U M 1.{value};\n= {bit};\n"),
        8 => format!("U {bit};\n= M {}.{value};\n", random.u8(8..16)),
        9 => format!("U M 2.{value};\nS {bit};\nUN M 4.{value};\nR M {byte}.{value};\n"),
        10 => format!("U M 3.{value};\nFP {bit};\n= M {}.1;\n", random.u8(8..16)),
        11 => format!("SET;\n= {bit};\nR M {byte}.{value};\n"),
        12 => format!("{computed}L MW {value};\nT M{} [MD 20];\n", if width == "D" { "W" } else { "B" }),
        13 => format!("{computed}U M 1.{value};\n= M [MD 20];\n"),
        14 => format!("LAR1 P#M {byte}.0;\nL W [AR1,P#1.0];\nT W [AR1,P#0.0];\n"),
        _ => format!("CALL FC 1 (x := MW {byte}, on := {bit}, q := M {byte}.{value}, RET_VAL := MW {});\n", 8 + value),
    }
}

/// Paths that know other things of overlapping places meet; all mixtures cannot be named.
#[test]
fn random_paths_meet() {
    for seed in 0..PROGRAMS {
        let mut random = Rng::with_seed(seed);
        let pieces = random.usize(4..40);
        let mut jump =
            |at: usize| (random.u8(0..3) == 0).then(|| (random.usize(at + 1..=pieces), random.u8(0..3), random.bool()));
        let jumps: Vec<_> = (0..pieces).map(&mut jump).collect();
        let mut text = String::new();
        for (at, jump) in jumps.iter().chain([&None]).enumerate() {
            if jumps.iter().flatten().any(|(to, ..)| *to == at) {
                let _ = writeln!(text, "a{at}: NOP 0;");
            }
            text.push_str(&piece(&mut random));
            if let Some((to, bit, on)) = jump {
                let _ = writeln!(text, "U M 1.{bit};\n{} a{to};", if *on { "SPB" } else { "SPBN" });
            }
        }
        same(&program(&text, FC));
    }
}

#[test]
fn a_fault_beside_finds_what_waits() {
    let seen = "ORGANIZATION_BLOCK OB 121\nVAR_TEMP\n info : ARRAY [1 .. 20] OF BYTE;\nEND_VAR\nBEGIN\nL MW 10;\nT MW 40;\n\
        L MW 12;\nT MW 42;\nL MB 14;\nT MB 44;\nL MW 46;\n+ 1;\nT MW 46;\nEND_ORGANIZATION_BLOCK\n";
    // Beyond the data block in every other scan.
    let text = "L MW 0;\nT MW 10;\nUN M 14.6;\n= M 14.6;\nL MW 0;\nSLW 7;\nL W#16#80;\nUW;\nT MD 20;\nAUF DB 1;\n\
        U M 1.1;\nSPBN a;\nL 9;\nT MW 12;\na: L DBW [MD 20];\nT MW 10;\nU M 14.6;\n= M 14.0;\nL MW 12;\n+ 1;\nT MW 12;\n";
    same(&program(text, seen));
}

#[test]
fn bits_wait_for_their_byte() {
    let mut all = String::from("L MB 1;\nT MB 9;\n");
    for at in 0..8 {
        let _ = writeln!(all, "U M 0.{at};\nXN M 1.{};\n= M 8.{at};", 7 - at);
    }
    same(&program(&all, ""));
    assert_eq!(stores(&all), 2, "a byte is written once");
    let others = [
        "U M 1.0;\n= M 8.0;\nU M 8.0;\n= M 8.1;\nUN M 8.0;\n= M 8.0;\nU M 8.1;\nFP M 8.2;\n= M 8.3;\nU M 8.2;\nFN M 8.4;\n= M 8.5;\n",
        "SET;\n= M 8.0;\nCLR;\n= M 8.7;\nU M 1.0;\nR M 8.0;\nS M 8.7;\nU M 1.1;\nS M 8.0;\nR M 8.7;\nS M 8.5;\nR M 8.5;\n",
        "U M 1.0;\n= M 8.1;\nU M 1.1;\n= M 8.2;\nU M 1.2;\n= M 8.3;\nL MB 8;\nT MB 9;\nU M 9.2;\n= M 8.0;\nL MW 8;\nT MW 12;\n",
        "U M 1.0;\n= M 8.1;\nL 0;\nT MW 8;\nU M 1.1;\n= M 9.1;\nL MB 9;\nT MB 13;\n",
        "U M 1.0;\n= M 8.1;\nL P#8.2;\nT MD 20;\nU M [MD 20];\n= M 9.0;\nUN M 8.1;\n= M [MD 20];\nU M 8.2;\n= M 8.4;\n",
        "U M 1.0;\n= M 8.1;\nSPBN a;\nU M 1.1;\n= M 8.2;\n= M 9.1;\na: U M 8.1;\n= M 9.0;\nL MB 8;\nT MB 13;\n",
        "AUF DB 1;\nU M 1.0;\n= DBX 3.1;\nU M 1.1;\n= DBX 3.2;\nL DBW 2;\nT DBW 4;\nU DB1.DBX 3.1;\n= DB1.DBX 3.3;\n",
        "LAR1 P#M 8.0;\nU M 1.0;\n= [AR1,P#0.1];\nU M 1.1;\n= [AR1,P#0.2];\nL B [AR1,P#0.0];\nT MB 9;\n",
    ];
    for text in others {
        same(&program(text, ""));
        same(&program(&format!("L 3;\nm: T MW 30;\n{text}L MW 30;\nLOOP m;\n"), ""));
    }
}

/// More values wait than are kept: the oldest are written first.
#[test]
fn many_values_wait() {
    let mut text = String::new();
    for round in 0..3 {
        for word in 0..20 {
            text.push_str(&format!("L MW {};\n+ {round};\nT MW {};\n", 2 * (word % 7), 40 + 2 * word));
            if word % 6 == 5 {
                text.push_str(&format!(
                    "U M 1.{};\nSPBN a{round}{word};\nL 1;\nT MW {};\na{round}{word}: NOP 0;\n",
                    word % 3,
                    40 + word
                ));
            }
        }
    }
    same(&program(&text, ""));
}

#[test]
fn an_inlined_block_leaves_what_it_has_written() {
    let block = "FUNCTION_BLOCK FB 1\nVAR_INPUT\n set : BOOL;\n v : INT;\nEND_VAR\nVAR_OUTPUT\n q : INT;\n on : BOOL;\nEND_VAR\n\
        VAR\n n : INT;\n e : BOOL;\nEND_VAR\nBEGIN\nU #set;\nFP #e;\n= #on;\nSPBN z1;\nL #v;\nT #n;\nz1: L #n;\n+ 1;\nT #n;\nT #q;\nEND_FUNCTION_BLOCK\n\
        DATA_BLOCK DB 2\nFB 1\nBEGIN\nEND_DATA_BLOCK\n";
    let pair = |k: u32| {
        format!(
            "CALL FC 1 (x := MW {a}, on := M 1.{b}, q := M 8.{b}, RET_VAL := MW {c});\n\
             CALL FB 1, DB 2 (set := M 1.{b}, v := MW {c}, q := MW {d}, on := M 9.{b});\n",
            a = 2 * k,
            b = k % 8,
            c = 2 * k + 20,
            d = 2 * k + 60
        )
    };
    let text: String = (0..10).map(pair).collect();
    same(&program(&format!("{text}L DB2.DBW 4;\nT MW 100;\nL DB2.DBB 0;\nT MB 102;\n{text}"), &format!("{FC}{block}")));
}
