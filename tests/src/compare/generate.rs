//! Random straight-line statements: the body of a snippet.
//!
//! Only statements for which both engines must agree: no operand beyond its area, no BCD number with a digit above 9,
//! no statement that causes a fault. `tests/compare/README.md` lists what is omitted because awlsim deviates from the
//! reference.

use super::random::Random;

/// Statements that belong together: they are kept or removed as a whole when a failure is reduced.
pub type Item = Vec<String>;

const SCANS: [&str; 6] = ["U", "UN", "O", "ON", "X", "XN"];
const STATUS: [&str; 9] = ["==0", ">0", "<0", ">=0", "<=0", "UO", "OV", "OS", "BIE"];
const BRACKETS: [&str; 6] = ["U(", "UN(", "O(", "ON(", "X(", "XN("];
const JUMPS: [&str; 16] = [
    "SPA", "SPB", "SPBN", "SPBB", "SPBNB", "SPBI", "SPBIN", "SPO", "SPS", "SPZ", "SPN", "SPP", "SPM", "SPPZ", "SPMZ",
    "SPU",
];
/// Values at the edges of the number formats.
const EDGES: [u32; 22] = [
    0,
    1,
    0xFFFF_FFFF,
    0x7FFF,
    0x8000,
    0xFFFF,
    0xFFFF_8000,
    0x7FFF_FFFF,
    0x8000_0000,
    0x0001_0000,
    0x3F80_0000,
    0xBF80_0000,
    0x4049_0FDB,
    0x8000_0000,
    0x7F80_0000,
    0xFF80_0000,
    0x7F7F_FFFF,
    0x0080_0000,
    0x4F00_0000,
    0xCF00_0000,
    0x3FC0_0000,
    0x4020_0000,
];

/// The statements of one snippet.
#[must_use]
pub fn items(random: &mut Random, accumulators: u8) -> Vec<Item> {
    let count = 6 + random.below(20);
    let mut items: Vec<Item> = (0..count).map(|index| item(random, index, count, accumulators)).collect();
    for item in &mut items {
        item.extend(keep(random, accumulators));
    }
    items
}

/// Stores a result, mostly where the following statements do not overwrite it at once.
fn keep(random: &mut Random, accumulators: u8) -> Item {
    let at = 200 + 4 * random.below(16);
    match random.below(8) {
        0..=3 => vec![format!("T MD {at}")],
        4 => vec![format!("T MD {at}"), "TAK".to_owned(), format!("T MD {}", 200 + 4 * random.below(16))],
        5 => then(load_status(accumulators), format!("T MW {at}")),
        _ => Vec::new(),
    }
}

/// The label of the item with this index; the label after the last one is the end of the snippet.
#[must_use]
pub fn label(index: usize) -> String {
    format!("m{index:03}")
}

fn item(random: &mut Random, index: usize, count: usize, accumulators: u8) -> Item {
    let later = |random: &mut Random| label(index + 1 + random.below(count - index));
    match random.below(30) {
        0..=4 => chain(random),
        5 | 6 => transfer(random),
        7 | 8 => integer(random),
        9 | 10 => double_integer(random),
        11 | 12 => real(random, accumulators),
        13 => compare(random),
        14 | 15 => word_logic(random),
        16 | 17 => shift(random),
        18 | 19 => convert(random),
        20 | 21 => vec![accumulator(random, accumulators)],
        22 => address_register(random),
        23 | 24 => indirect(random),
        25 => status(random, accumulators),
        26 => counter(random),
        27 => data_block(random),
        28 => master_control(random),
        _ => {
            let mut jump = if random.once_in(2) { compare(random) } else { Vec::new() };
            jump.push(format!("{} {}", random.of(&JUMPS), later(random)));
            jump
        }
    }
}

fn bit(random: &mut Random) -> String {
    let (area, from, len) =
        [("M", 200, 64), ("M", 200, 64), ("E", 64, 32), ("A", 64, 32), ("DBX", 0, 64), ("L", 0, 16)][random.below(6)];
    format!("{area} {}.{}", from + random.below(len), random.below(8))
}

/// An operand of 1, 2 or 4 bytes.
fn cell(random: &mut Random, width: usize) -> String {
    let letter = match width {
        1 => "B",
        2 => "W",
        _ => "D",
    };
    let (area, from, len) =
        [("M", 200, 64), ("M", 200, 64), ("E", 64, 32), ("A", 64, 32), ("DB", 0, 64), ("L", 0, 16)][random.below(6)];
    format!("{area}{letter} {}", from + random.below(len - width + 1))
}

fn scan(random: &mut Random) -> String {
    let what = match random.below(8) {
        0 => random.of(&STATUS).to_owned(),
        1 => format!("Z {}", random.below(4)),
        _ => bit(random),
    };
    format!("{} {what}", random.of(&SCANS))
}

/// Bit logic: scans, brackets up to four levels, `O` alone, and a use of the result.
fn chain(random: &mut Random) -> Item {
    let mut lines = Vec::new();
    scans(random, 4, &mut lines);
    for _ in 0..random.below(3) {
        let statement = random.of(&["=", "S", "R", "=", "FP", "FN"]);
        lines.push(format!("{statement} {}", bit(random)));
    }
    lines
}

fn scans(random: &mut Random, depth: usize, lines: &mut Item) {
    for _ in 0..1 + random.below(4) {
        match random.below(9) {
            0 if !lines.is_empty() => lines.push("O".to_owned()),
            1 if depth > 0 => {
                lines.push(random.of(&BRACKETS).to_owned());
                scans(random, depth - 1, lines);
                lines.push(")".to_owned());
            }
            2 => lines.push("NOT".to_owned()),
            _ => {}
        }
        lines.push(scan(random));
    }
}

fn value(random: &mut Random) -> u32 {
    match random.below(3) {
        0 => EDGES[random.below(EDGES.len())],
        1 => (random.bits() % 2001) as u32 ^ if random.once_in(2) { u32::MAX } else { 0 },
        _ => random.bits() as u32,
    }
}

fn load(random: &mut Random) -> String {
    match random.below(4) {
        0 | 1 => format!("L DW#16#{:X}", value(random)),
        2 => format!("L {}", cell(random, 4)),
        _ => {
            let width = [1, 2][random.below(2)];
            format!("L {}", cell(random, width))
        }
    }
}

fn loads(random: &mut Random) -> Item {
    (0..random.below(3)).map(|_| load(random)).collect()
}

fn then(mut lines: Item, last: String) -> Item {
    lines.push(last);
    lines
}

fn transfer(random: &mut Random) -> Item {
    let width = [1, 2, 4][random.below(3)];
    vec![load(random), format!("T {}", cell(random, width))]
}

fn integer(random: &mut Random) -> Item {
    let statement = match random.below(6) {
        5 => format!("+ {}", random.below(65_536) as i32 - 32_768),
        n => ["+I", "-I", "*I", "/I", "+I"][n].to_owned(),
    };
    let mut lines = then(loads(random), statement.clone());
    if matches!(statement.as_str(), "+I" | "-I" | "*I") && random.once_in(4) {
        // Only here: after a division by zero awlsim takes <>0 for true, though neither CC 1 nor CC 0 is 0.
        lines.push(format!("{} <>0", random.of(&SCANS)));
    }
    lines
}

fn double_integer(random: &mut Random) -> Item {
    let statement = match random.below(6) {
        5 => format!("+ L#{}", value(random) as i32),
        n => ["+D", "-D", "*D", "/D", "MOD"][n].to_owned(),
    };
    then(loads(random), statement)
}

/// A real number whose products and quotients are in range: overflow and NaN are tested by our own tables.
fn real_value(random: &mut Random) -> String {
    let numbers = ["0.0", "1.0", "-1.0", "0.5", "2.5", "3.5", "-2.5", "1.0e8", "-1.0e-8", "16777217.0", "12345.678"];
    let number = match random.below(3) {
        // 2 to the power of -15 to 16.
        0 => f32::from_bits(0x3F80_0000 ^ (random.bits() as u32 & 0x87FF_FFFF)),
        1 => random.below(100_000) as f32 / 64.0 - 700.0,
        _ => return format!("L {}", random.of(&numbers)),
    };
    format!("L DW#16#{:08X}", number.to_bits())
}

fn real(random: &mut Random, accumulators: u8) -> Item {
    let mut two = vec![real_value(random)];
    if accumulators == 4 {
        // The same in ACCU 2 to 4: awlsim's REAL arithmetic does not move ACCU 3 and 4.
        two.extend([two[0].clone(), "ENT".to_owned(), "ENT".to_owned()]);
    }
    two.push(real_value(random));
    match random.below(8) {
        0 => then(two, "ABS".to_owned()),
        1 => then(two, "NEGR".to_owned()),
        2 => vec![real_value(random), "ABS".to_owned(), "SQRT".to_owned()],
        3 => vec![format!("L {}.5", random.below(1_000)), "SQR".to_owned()],
        n => then(two, ["+R", "-R", "*R", "/R"][n - 4].to_owned()),
    }
}

fn compare(random: &mut Random) -> Item {
    let relation = random.of(&["==", "<>", "<", ">", "<=", ">="]);
    match random.below(3) {
        0 => then(loads(random), format!("{relation}I")),
        1 => then(loads(random), format!("{relation}D")),
        _ => vec![real_value(random), real_value(random), format!("{relation}R")],
    }
}

fn word_logic(random: &mut Random) -> Item {
    let (word, double) = (random.of(&["UW", "OW", "XOW"]), random.of(&["UD", "OD", "XOD"]));
    let statement = match random.below(4) {
        0 => word.to_owned(),
        1 => format!("{word} W#16#{:X}", value(random) & 0xFFFF),
        2 => double.to_owned(),
        _ => format!("{double} DW#16#{:X}", value(random)),
    };
    then(loads(random), statement)
}

fn shift(random: &mut Random) -> Item {
    let (word, double) = (random.of(&["SLW", "SRW", "SSI"]), random.of(&["SLD", "SRD", "SSD", "RLD", "RRD"]));
    match random.below(6) {
        0 | 1 => then(loads(random), format!("{word} {}", random.below(16))),
        2 | 3 => then(loads(random), format!("{double} {}", random.below(33))),
        4 => {
            let (statement, most) = [(word, 16), (double, 32)][random.below(2)];
            vec![format!("L {}", random.below(most + 1)), load(random), statement.to_owned()]
        }
        _ => then(loads(random), random.of(&["RLDA", "RRDA"]).to_owned()),
    }
}

fn convert(random: &mut Random) -> Item {
    let digits = |random: &mut Random, count| {
        (0..count).fold(u32::from(random.once_in(2)) * 0xF, |number, _| number << 4 | random.below(10) as u32)
    };
    match random.below(12) {
        0 => vec![format!("L W#16#{:X}", digits(random, 3)), "BTI".to_owned()],
        1 => vec![format!("L DW#16#{:X}", digits(random, 7)), "BTD".to_owned()],
        2 => vec![format!("L {}", random.below(1_999) as i32 - 999), "ITB".to_owned()],
        3 => vec![format!("L L#{}", random.below(19_999_999) as i32 - 9_999_999), "DTB".to_owned()],
        // NEGD: awlsim's rounding does not change an earlier OV.
        4 => vec![real_value(random), random.of(&["RND", "RND+", "RND-", "TRUNC"]).to_owned(), "NEGD".to_owned()],
        5 => then(loads(random), "DTR".to_owned()),
        _ => then(loads(random), random.of(&["ITD", "INVI", "INVD", "NEGI", "NEGD", "TAW", "TAD"]).to_owned()),
    }
}

fn accumulator(random: &mut Random, accumulators: u8) -> String {
    match random.below(6) {
        0 => format!("INC {}", random.below(256)),
        1 => format!("DEC {}", random.below(256)),
        2 => (if accumulators == 4 { "ENT" } else { "PUSH" }).to_owned(),
        3 => (if accumulators == 4 { "LEAVE" } else { "POP" }).to_owned(),
        _ => "TAK".to_owned(),
    }
}

/// With two accumulators without the bits that an S7-300 does not show.
fn load_status(accumulators: u8) -> Item {
    let mask = (accumulators != 4).then(|| "UW W#16#1F2".to_owned());
    std::iter::once("L STW".to_owned()).chain(mask).collect()
}

fn status(random: &mut Random, accumulators: u8) -> Item {
    match random.below(6) {
        // With two accumulators awlsim also writes /ER, STA and OR: the assignment shows the RLO and makes them
        // irrelevant.
        4 => {
            let end = (accumulators != 4).then(|| format!("= M {}.{}", 240 + random.below(16), random.below(8)));
            let word = format!("L W#16#{:X}", random.below(0x200) | 1);
            [word, "T STW".to_owned()].into_iter().chain(end).collect()
        }
        5 => load_status(accumulators),
        n => vec![["SET", "CLR", "NOT", "SAVE"][n].to_owned()],
    }
}

fn pointer(random: &mut Random) -> String {
    format!("P#{}.{}", random.below(4_096), random.below(8))
}

fn address_register(random: &mut Random) -> Item {
    let one = random.of(&["1", "2"]);
    match random.below(9) {
        0 => vec![format!("LAR{one} {}", pointer(random))],
        1 => vec![format!("L {}", pointer(random)), format!("LAR{one}")],
        2 => vec![format!("LAR{one} MD {}", 200 + random.below(60))],
        3 => vec![format!("TAR{one} MD {}", 200 + random.below(60))],
        4 => vec![format!("TAR{one}")],
        5 => vec![format!("LAR{one} {}", pointer(random)), format!("+AR{one} {}", pointer(random))],
        6 => vec![format!("LAR{one} {}", pointer(random)), load(random), format!("+AR{one}")],
        7 => vec!["LAR1 AR2".to_owned()],
        _ => vec![random.of(&["TAR", "TAR1 AR2"]).to_owned()],
    }
}

/// Register-indirect within and across areas, memory-indirect; the pointer is created directly before its use.
fn indirect(random: &mut Random) -> Item {
    let one = random.of(&["1", "2"]);
    let (area, name, from) = [("M", "M", 200), ("DBX", "DB", 0), ("E", "E", 64), ("A", "A", 64)][random.below(4)];
    let at = from + random.below(8);
    let is_bit = random.once_in(2);
    let plus =
        if is_bit { format!("P#{}.{}", random.below(8), random.below(8)) } else { format!("P#{}.0", random.below(8)) };
    let bits = if is_bit { random.below(8) } else { 0 };
    let letter = random.of(&["B", "W", "D"]);
    let verb = match (is_bit, random.below(2)) {
        (true, _) => random.of(&["U", "ON", "X", "=", "S", "R", "FP"]),
        (false, 0) => "L",
        (false, _) => "T",
    };
    match random.below(3) {
        0 => {
            let operand = if is_bit { area.to_owned() } else { format!("{name}{letter}") };
            vec![format!("LAR{one} P#{at}.{bits}"), format!("{verb} {operand} [AR{one},{plus}]")]
        }
        1 => {
            let operand = if is_bit { String::new() } else { format!("{letter} ") };
            vec![format!("LAR{one} P#{area} {at}.{bits}"), format!("{verb} {operand}[AR{one},{plus}]")]
        }
        _ => {
            let operand = if is_bit { area.to_owned() } else { format!("{name}{letter}") };
            vec![format!("L P#{at}.{bits}"), "T MD 296".to_owned(), format!("{verb} {operand} [MD 296]")]
        }
    }
}

fn counter(random: &mut Random) -> Item {
    let number = random.below(4);
    match random.below(6) {
        0 => vec![format!("L C#{}", random.below(1_000)), scan(random), format!("S Z {number}")],
        1 => vec![scan(random), format!("ZV Z {number}")],
        2 => vec![scan(random), format!("ZR Z {number}")],
        3 => vec![scan(random), format!("R Z {number}")],
        4 => vec![format!("L Z {number}")],
        _ => vec![format!("LC Z {number}")],
    }
}

fn data_block(random: &mut Random) -> Item {
    match random.below(6) {
        0 => vec![format!("L DB10.DBD {}", random.below(61))],
        1 => vec![format!("T DB10.DBW {}", random.below(63))],
        2 => vec![format!("U DB10.DBX {}.{}", random.below(64), random.below(8))],
        3 => vec![format!("L {}", random.of(&["DBLG", "DBNO", "DILG", "DINO"]))],
        4 => vec!["TDB".to_owned(), format!("L DBNO"), "TDB".to_owned()],
        _ => vec![format!("L DID {}", random.below(61)), format!("T DIB {}", random.below(64))],
    }
}

/// A zone of the master control relay with its end.
fn master_control(random: &mut Random) -> Item {
    let mut lines = vec!["MCRA".to_owned(), scan(random), "MCR(".to_owned()];
    for _ in 0..1 + random.below(3) {
        lines.extend(if random.once_in(3) { transfer(random) } else { chain(random) });
    }
    lines.extend([")MCR".to_owned(), "MCRD".to_owned()]);
    lines
}
