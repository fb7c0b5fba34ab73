//! Writes an invented plant: a folder of STL sources with calls, data types, instances and symbols, to measure
//! what reading a large program takes.
//!
//!     cargo run --release -p ob1-stl --example plant -- FOLDER [SOURCES] [LINES]
//!     time ob1 check FOLDER

#![allow(clippy::disallowed_methods, reason = "it writes the sources it makes")]

use std::fmt::Write as _;

/// Lines of all sources but the heads.
const LINES: usize = 1_500_000;

fn main() -> std::io::Result<()> {
    let mut words = std::env::args().skip(1);
    let folder = std::path::PathBuf::from(words.next().unwrap_or_else(|| "plant".into()));
    let sources: usize = words.next().and_then(|w| w.parse().ok()).unwrap_or(2_000);
    let lines: usize = words.next().and_then(|w| w.parse().ok()).unwrap_or(LINES);
    std::fs::create_dir_all(&folder)?;
    let mut table = String::new();
    let mut written = 0;
    for number in 1..=sources {
        let text = source(number, lines / sources, &mut table);
        written += text.lines().count();
        std::fs::write(folder.join(format!("unit_{number:04}.awl")), text)?;
    }
    let main: String = (1..=sources).map(|n| format!("      CALL FB {n}, DB {n} (Start := E 0.0);\r\n")).collect();
    let main = format!("ORGANIZATION_BLOCK OB 1\r\nBEGIN\r\nNETWORK\r\n{main}END_ORGANIZATION_BLOCK\r\n");
    written += main.lines().count();
    std::fs::write(folder.join("main.awl"), main)?;
    std::fs::write(folder.join("symbols.sdf"), table)?;
    println!("{} sources, {written} lines", sources + 1);
    Ok(())
}

/// One unit: a function block with its instance, its data type, a function, and statements of every kind.
fn source(n: usize, lines: usize, table: &mut String) -> String {
    let mut out = String::new();
    let _ = write!(table, "\"Unit {n}\",\"FB {n:>6}\",\"FB {n:>6}\",\"unit {n}\"\r\n");
    let _ = write!(table, "\"Run {n}\",\"M {:>5}.{}\",\"BOOL\",\"\"\r\n", n / 8 + 100, n % 8);
    let _ = write!(
        out,
        "TYPE UDT {n}\r\nVERSION : 0.1\r\nSTRUCT\r\n speed : REAL := 1.5;\r\n count : INT;\r\n text : STRING [20] := 'unit {n}';\r\n\
         END_STRUCT;\r\nEND_TYPE\r\n\r\nFUNCTION FC {n} : INT\r\nTITLE = a function\r\nVAR_INPUT\r\n x : INT;\r\nEND_VAR\r\n\
         BEGIN\r\nNETWORK\r\n      L #x;\r\n      L {};\r\n      +I;\r\n      T #RET_VAL;\r\nEND_FUNCTION\r\n\r\n\
         FUNCTION_BLOCK FB {n}\r\nTITLE = unit {n}\r\nAUTHOR : plant\r\nVERSION : 1.0\r\nVAR_INPUT\r\n Start : BOOL; //begin\r\nEND_VAR\r\n\
         VAR_OUTPUT\r\n Ready : BOOL;\r\nEND_VAR\r\nVAR\r\n data : UDT {n};\r\n list : ARRAY [0 .. 9] OF INT := 10(0);\r\n\
         END_VAR\r\nVAR_TEMP\r\n t : INT;\r\n d : DINT;\r\nEND_VAR\r\nBEGIN\r\n",
        n % 1000
    );
    let mut left = lines.saturating_sub(60);
    let mut network = 0;
    while left > 0 {
        network += 1;
        let _ = write!(out, "NETWORK\r\nTITLE = step {network} of the unit\r\n//what happens here\r\n");
        let (byte, bit) = (network % 1000, network % 8);
        let statements = [
            "      U     #Start;".to_owned(),
            format!("      UN    M {byte}.{bit};"),
            format!("      U(;\r\n      O     E {}.{bit};\r\n      O     \"Run {n}\";\r\n      );", byte % 100),
            format!("      SPBN  m{:03};", network % 1000),
            format!("      L     #list[{}];", network % 10),
            "      L     5;".to_owned(),
            "      +I    ;".to_owned(),
            "      T     #t;                 //between".to_owned(),
            format!("      CALL  FC {} (x := #t, RET_VAL := #data.count);", (n * 7 + network) % 2000 + 1),
            "      L     #data.speed;".to_owned(),
            "      L     1.250000e+001;".to_owned(),
            "      *R    ;".to_owned(),
            "      T     #data.speed;".to_owned(),
            format!("      L     DB{n}.DBW 0;"),
            format!("      T     MW {};", byte * 2 % 2000),
            "      L     S5T#2S;".to_owned(),
            format!("      SE    T {};", network % 256),
            format!("m{:03}: NOP   0;", network % 1000),
            "      =     #Ready;".to_owned(),
        ];
        for statement in statements {
            let _ = write!(out, "{statement}\r\n");
        }
        left = left.saturating_sub(25);
        if network % 1000 == 999 {
            break;
        }
    }
    let _ = write!(
        out,
        "END_FUNCTION_BLOCK\r\n\r\nDATA_BLOCK DB {n}\r\nFB {n}\r\nBEGIN\r\n data.count := {};\r\nEND_DATA_BLOCK\r\n",
        n % 100
    );
    out
}
