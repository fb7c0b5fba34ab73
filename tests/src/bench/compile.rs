//! The compile time of the front ends for a large program: mixed statements, symbols, calls, structures; whether it is
//! proportional to the length; the way of a program to another process; and the lines of SCL a second.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ob1_ir::Symbol;
use ob1_model::DataType;
use ob1_stl::{Library, Options, Source};

use super::peer::Failure;
use super::{Figure, median};

/// Statements of the measured programs; the figure is from the second.
const SIZES: [usize; 3] = [50_000, 100_000, 200_000];
const ROUNDS: usize = 5;
/// Seconds for 100,000 statements.
const AIM_S: f64 = 2.0;
/// Limit of the time ratio for twice the statements; caches and allocation make it a little more than 2.
const LINEAR: f64 = 2.6;
/// Limit of the time for writing and reading the file form, as a multiple of that for compiling the source.
const HANDED_OVER: f64 = 2.0;
/// Statements of one generated function.
const BODY: usize = 50;
/// Functions of the SCL program, of 38 lines each.
const SCL_FUNCTIONS: usize = 2_500;
/// Lines of SCL a second.
const SCL_AIM: f64 = 200_000.0;

/// Compiles the programs; milliseconds of each.
///
/// # Errors
/// If the generated program is refused.
pub fn measure() -> Result<[Figure; 4], Failure> {
    let mut times = [0.0; SIZES.len()];
    for (time, statements) in times.iter_mut().zip(SIZES) {
        *time = compile(statements)?;
        println!(
            "compile: {statements:>7} statements {:>8.1} ms, {:.0} a second",
            *time,
            statements as f64 / *time * 1e3
        );
    }
    let growth = (times[1] / times[0]).max(times[2] / times[1]);
    Ok([
        Figure {
            what: "compile 100,000 statements".into(),
            value: times[1],
            unit: "ms",
            floor: None,
            aim: ("< 2000 ms", times[1] < AIM_S * 1e3),
        },
        Figure {
            what: "twice the statements: times as long".into(),
            value: growth,
            unit: "x",
            floor: None,
            aim: ("< 2.6", growth < LINEAR),
        },
        handed_over(times[1])?,
        scl()?,
    ])
}

/// The same program on its way to the process that makes machine code: written in the file form and read back.
fn handed_over(compiled_ms: f64) -> Result<Figure, Failure> {
    let (text, symbols) = program(SIZES[1]);
    let source = Source::new("generated.awl", text.into_bytes());
    let program = ob1_stl::compile(&[source], &Library::new(), &Options { symbols, ..Options::default() }).program;
    let mut times = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let began = Instant::now();
        let read = ob1_ir::parse(&ob1_ir::write(&program));
        times.push(began.elapsed().as_secs_f64() * 1e3);
        if read.as_ref() != Ok(&program) {
            return Err("the file form is not what was written".into());
        }
    }
    let value = median(&mut times);
    Ok(Figure {
        what: "hand 100,000 statements to another process".into(),
        value,
        unit: "ms",
        floor: Some(("compiling them", compiled_ms)),
        aim: ("<= 2 x", value <= HANDED_OVER * compiled_ms),
    })
}

/// Lines of SCL a second.
fn scl() -> Result<Figure, Failure> {
    let text = scl_program(SCL_FUNCTIONS);
    let lines = text.lines().count() as f64;
    let mut times = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let source = Source::new("generated.scl", text.clone().into_bytes());
        let began = Instant::now();
        let output = ob1_scl::compile(&[source], &Library::new(), &Options::default());
        times.push(began.elapsed().as_secs_f64());
        if let Some(first) = output.diagnostics.first() {
            return Err(format!("the generated program is refused: line {}: {}", first.line, first.message).into());
        }
    }
    let speed = lines / median(&mut times);
    println!("compile: {lines:>7} lines of SCL, {speed:.0} a second");
    let aim = (">= 200,000", speed >= SCL_AIM);
    Ok(Figure { what: "lines of SCL compiled".into(), value: speed, unit: "/s", floor: None, aim })
}

/// Functions with branches, loops, arrays, conversions and calls, as programs have them; with comments and empty lines.
fn scl_program(functions: usize) -> String {
    let mut text = String::with_capacity(functions * 1_000);
    for n in 1..=functions {
        let other = n % functions + 1;
        let _ = write!(
            text,
            "FUNCTION FC{n} : INT\nVAR_INPUT\n    on : BOOL;\n    amount : INT;\n    level : REAL;\nEND_VAR\nVAR_OUTPUT\n    done : BOOL;\n\
             END_VAR\nVAR\n    i, sum : INT;\n    list : ARRAY[0..15] OF INT;\n    word : WORD;\n    bits AT word : ARRAY[0..15] OF BOOL;\nEND_VAR\n\
             BEGIN\n\n(* what is seldom *)\nsum := 0;\nIF on AND NOT M{byte}.1 OR amount > 100 THEN\n    done := TRUE;     // at once\n\
             ELSIF level * 2.5 - 1.0 < INT_TO_REAL(amount) THEN\n    done := M{byte}.2;\nEND_IF;\nFOR i := 0 TO 15 DO\n    list[i] := amount + i * 3;\n    \
             sum := sum + list[i] MOD 7;\nEND_FOR;\nCASE amount OF\n    1, 2: sum := sum + 1;\n    3..9: sum := LIMIT(MN := 0, IN := sum, MX := 500);\nELSE\n    \
             sum := sum / 2;\nEND_CASE;\nword := INT_TO_WORD(sum) AND 16#FF;\ndone := done XOR bits[3];\n{call}FC{n} := sum;\nEND_FUNCTION\n",
            byte = n % 100,
            call = if n % 5 == 0 {
                format!("sum := FC{other}(on := done, amount := sum, level := 0.5, done := done);\n")
            } else {
                String::new()
            },
        );
    }
    text
}

/// The median of a few rounds, in milliseconds.
fn compile(statements: usize) -> Result<f64, Failure> {
    let (text, symbols) = program(statements);
    let options = Options { symbols, ..Options::default() };
    let mut times = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let source = Source::new("generated.awl", text.clone().into_bytes());
        let began = Instant::now();
        let output = ob1_stl::compile(&[source], &Library::new(), &options);
        times.push(began.elapsed().as_secs_f64() * 1e3);
        if !output.is_good() {
            let first =
                output.diagnostics.first().map(|d| format!("line {}: {}", d.line, d.message)).unwrap_or_default();
            return Err(format!("the generated program is refused: {first}").into());
        }
        let compiled: usize = output.program.blocks.iter().map(|block| block.code.len()).sum();
        if compiled < statements {
            return Err(format!("{compiled} operations for {statements} statements").into());
        }
    }
    Ok(median(&mut times))
}

/// A station with such a program in a folder: its file.
pub(super) fn station(folder: &Path, statements: usize) -> Result<PathBuf, Failure> {
    let (text, symbols) = program(statements);
    std::fs::write(folder.join("generated.awl"), text)?;
    let row = |symbol: Symbol| format!("\"{}\",\"{}\",\"BOOL\",\"\"\r\n", symbol.name, symbol.address);
    std::fs::write(folder.join("symbols.sdf"), symbols.into_iter().map(row).collect::<String>())?;
    let file = folder.join("station.toml");
    let text = "[station]\nname = \"bench-start\"\n\n[cpu]\nmin_cycle = \"10ms\"\nwatchdog = \"1s\"\n\n[program]\n\
                sources = [\"generated.awl\"]\nsymbols = [\"symbols.sdf\"]\nmnemonics = \"de\"\n";
    std::fs::write(&file, text)?;
    Ok(file)
}

/// A program of functions of [`BODY`] statements, called from OB 1, with a data block and a symbol for every four of
/// them.
pub(super) fn program(statements: usize) -> (String, Vec<Symbol>) {
    let functions = statements / BODY;
    let mut text = String::with_capacity(statements * 24);
    let mut symbols = Vec::new();
    for n in 0..functions {
        let number = n + 1;
        // Inside the process images; otherwise the first call ends in STOP.
        let byte = n % 100;
        if n % 4 == 0 {
            symbols.push(Symbol {
                name: format!("Motor_{number}"),
                address: format!("M {byte}.4"),
                ty: Some(DataType::Bool),
                ..Symbol::default()
            });
            let _ = write!(
                text,
                "DATA_BLOCK DB {number}\nSTRUCT\n speed : REAL := 1.5;\n set : STRUCT\n  low, high : INT := 7;\n END_STRUCT;\n \
                 list : ARRAY [1..8] OF INT := 8(3);\nEND_STRUCT;\nBEGIN\n set.high := 9;\nEND_DATA_BLOCK\n"
            );
        }
        let of_four = n - n % 4 + 1;
        let _ = write!(
            text,
            "FUNCTION FC {number} : VOID\nVAR_INPUT\n on : BOOL;\n amount : INT;\nEND_VAR\nVAR_OUTPUT\n done : BOOL;\nEND_VAR\nVAR_TEMP\n \
             t : INT;\nEND_VAR\nBEGIN\n"
        );
        for part in 0..2 {
            let _ = write!(
                text,
                "NETWORK\nTITLE = part {part} of function {number}\n      U     #on;   // a comment that is read over\n      UN    \"Motor_{of_four}\";\n\
                 \x20     U(    ;\n      O     E {byte}.0;\n      O     M {byte}.1;\n      )     ;\n      FP    M {byte}.2;\n      =     #done;\n      \
                 SPBN  a{part}00;\n      L     #amount;\n      L     DB{of_four}.set.high;\n      +I    ;\n      T     #t;\n      L     #t;\n      L     W#16#FF;\n      \
                 UW    ;\n      T     MW {byte};\na{part}00: NOP   0;\n      L     DB{of_four}.list[3];\n      L     L#5;\n      >D    ;\n      =     A {byte}.3;\n      U     T 5;\n      \
                 L     S5T#2S;\n      SE    T 6;\n"
            );
        }
        text.push_str("END_FUNCTION\n");
    }
    text.push_str("ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n");
    for number in 1..=functions {
        let _ = writeln!(text, "      CALL  FC {number} (on := M 0.0, amount := MW 2, done := M 1.0);");
    }
    text.push_str("END_ORGANIZATION_BLOCK\n");
    (text, symbols)
}
