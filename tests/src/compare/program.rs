//! Snippets as a program: each is a function that starts from the same state and copies everything it changed to bit
//! memory.
//!
//! | bytes | |
//! |---|---|
//! | MB 0 to 191 | what is compared: a digest of each snippet, or all that a single snippet has left |
//! | MB 200 to 263 | the snippet's own memory; EB 64 to 95, AB 64 to 95, DB 10, DB 11 and its local data are filled from it |
//! | MB 264 to 295 | accumulators, address registers and status word at the snippet's end |
//! | MD 296 | a pointer |
//! | MB 300 and on | the digest at work |

use std::fmt::Write as _;

use super::generate::{Item, items, label};
use super::random::Random;
use crate::awlsim::STOP;

/// Number of snippets in a program: their digests fill MB 0 to 191.
pub const SNIPPETS: usize = 48;
/// Number of compared bytes of bit memory.
pub const COMPARED: usize = 192;

/// One snippet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Snippet {
    /// The initial content of its memory.
    pub memory: [u32; 16],
    /// Its statements. A removed item is empty, so that the labels keep their numbers.
    pub items: Vec<Item>,
    /// Number of accumulators of the CPU.
    pub accumulators: u8,
}

impl Snippet {
    /// Number `index` of a seed.
    #[must_use]
    pub fn new(seed: u64, index: usize, accumulators: u8) -> Self {
        let mut random = Random::new(Random::new(seed).bits() ^ (index as u64) << 8 ^ u64::from(accumulators));
        let memory = std::array::from_fn(|_| random.bits() as u32);
        Self { memory, items: items(&mut random, accumulators), accumulators }
    }

    fn function(&self, number: usize) -> String {
        let mut text = format!("FUNCTION FC {number} : VOID\nVAR_TEMP\n  t : ARRAY [0..3] OF DWORD;\nEND_VAR\nBEGIN\n");
        for (index, value) in self.memory.iter().enumerate() {
            let _ = write!(text, "L DW#16#{value:X};\nT MD {};\n", 200 + 4 * index);
        }
        for index in 0..4 {
            let _ = write!(text, "L MD {};\nT LD {};\n", 200 + 4 * index, 4 * index);
        }
        // The same accumulators, registers and status word each time: what the fill function leaves in them differs
        // between the engines.
        text.push_str("UC FC 101;\nAUF DB 10;\nAUF DI 11;\nLAR1 P#0.0;\nLAR2 P#0.0;\nL 0;\nL 0;\n");
        text.push_str(if self.accumulators == 4 { "ENT;\nENT;\n" } else { "" });
        text.push_str("T STW;\nCLR;\n");
        for (index, item) in self.items.iter().enumerate() {
            let _ = writeln!(text, "{}: NOP 0;", label(index));
            for line in item {
                let _ = writeln!(text, "{line};");
            }
        }
        let _ = writeln!(text, "{}: NOP 0;", label(self.items.len()));
        text.push_str("T MD 264;\nTAK;\nT MD 268;\n");
        text.push_str(match self.accumulators {
            4 => "LEAVE;\nTAK;\nT MD 284;\nLEAVE;\nTAK;\nT MD 288;\nL STW;\n",
            // Two accumulators: an S7-300, where L STW shows neither /ER nor STA nor OR. awlsim shows them.
            _ => "L STW;\nUW W#16#1F2;\n",
        });
        text.push_str("T MW 272;\nTAR1 MD 276;\nTAR2 MD 280;\nL DBNO;\nT MW 292;\nL DINO;\nT MW 294;\n");
        text.push_str("AUF DB 10;\nCLR;\nEND_FUNCTION\n\n");
        text
    }
}

/// FC 101: fills the areas from the snippet's memory, and resets the counters.
fn fill() -> String {
    let mut text = String::from("FUNCTION FC 101 : VOID\nBEGIN\nAUF DB 10;\nAUF DI 11;\n");
    for at in (0..64).step_by(4) {
        let _ = write!(text, "L MD {};\nT DBD {at};\nINVD;\nT DID {at};\n", 200 + at);
    }
    for at in (0..32).step_by(4) {
        let _ = write!(text, "L MD {};\nT ED {};\nL MD {};\nT AD {};\n", 200 + at, 64 + at, 232 + at, 64 + at);
    }
    text.push_str("SET;\nR Z 0;\nR Z 1;\nR Z 2;\nR Z 3;\n");
    // Each edge for counting and setting starts with 0.
    text.push_str("CLR;\nZV Z 0;\nZV Z 1;\nZV Z 2;\nZV Z 3;\nZR Z 0;\nZR Z 1;\nZR Z 2;\nZR Z 3;\n");
    text.push_str("L C#0;\nCLR;\nS Z 0;\nS Z 1;\nS Z 2;\nS Z 3;\nL 0;\nT MD 296;\n");
    for at in (264..296).step_by(4) {
        let _ = writeln!(text, "T MD {at};");
    }
    text.push_str("END_FUNCTION\n\n");
    text
}

/// FC 100: calculates the digest of everything a snippet leaves, in MD 300.
fn digest() -> String {
    let mut text = String::from("FUNCTION FC 100 : VOID\nBEGIN\nAUF DB 10;\nAUF DI 11;\nL 0;\nT MD 300;\n");
    let left = (200..296).step_by(4).map(|at| format!("MD {at}"));
    let data = (0..64).step_by(4).flat_map(|at| [format!("DBD {at}"), format!("DID {at}")]);
    let images = (64..96).step_by(4).flat_map(|at| [format!("ED {at}"), format!("AD {at}")]);
    for cell in left.chain(data).chain(images) {
        let _ = write!(text, "L MD 300;\nRLD 7;\nL {cell};\nXOD;\nT MD 300;\n");
    }
    text.push_str("END_FUNCTION\n\n");
    text
}

const DATA: &str = "DATA_BLOCK DB 10\nSTRUCT\n  a : ARRAY [0..15] OF DWORD;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\n\
    DATA_BLOCK DB 11\nSTRUCT\n  a : ARRAY [0..15] OF DWORD;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\n";

/// Copies MB 64 to 191 to the bytes that awlsim shows, and causes the fault.
fn show() -> String {
    let mut text = String::new();
    for at in (0..64).step_by(4) {
        let _ = write!(text, "L MD {};\nT ED {at};\nL MD {};\nT AD {at};\n", 64 + at, 128 + at);
    }
    text + STOP
}

/// A program with all snippets: MD 4n is the digest of snippet n.
#[must_use]
pub fn with_digests(snippets: &[Snippet]) -> String {
    let mut text = format!("{DATA}{}{}", fill(), digest());
    let mut ob1 = String::from("ORGANIZATION_BLOCK OB 1\nBEGIN\n");
    for (index, snippet) in snippets.iter().enumerate() {
        text.push_str(&snippet.function(index + 1));
        let _ = write!(ob1, "UC FC {};\nUC FC 100;\nL MD 300;\nT MD {};\n", index + 1, 4 * index);
    }
    format!("{text}{ob1}{}END_ORGANIZATION_BLOCK\n", show())
}

/// A program with one snippet, which copies its results to MB 0 to 191: its memory and results (96 bytes), DB 10 (32
/// bytes XORed on 32), DB 11 in the same way, E, A.
#[must_use]
pub fn alone(snippet: &Snippet) -> String {
    let mut ob1 = String::from("ORGANIZATION_BLOCK OB 1\nBEGIN\nUC FC 1;\nAUF DB 10;\nAUF DI 11;\n");
    for at in (0..96).step_by(4) {
        let _ = write!(ob1, "L MD {};\nT MD {at};\n", 200 + at);
    }
    for at in (0..64).step_by(4) {
        let _ = write!(ob1, "L DBD {at};\nL DID {at};\nRLD 3;\nXOD;\nT MD {};\n", 96 + at);
    }
    for at in (0..32).step_by(4) {
        let _ = write!(ob1, "L ED {};\nL AD {};\nRLD 3;\nXOD;\nT MD {};\n", 64 + at, 64 + at, 160 + at);
    }
    format!("{DATA}{}{}{ob1}{}END_ORGANIZATION_BLOCK\n", fill(), snippet.function(1), show())
}
