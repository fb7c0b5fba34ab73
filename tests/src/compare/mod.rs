//! `cargo xtask compare`: random straight-line programs must produce the same memory on our engine and on awlsim.
//!
//! awlsim takes long to start, so one run has many snippets ([`program::SNIPPETS`]) and compares a digest of each. A
//! snippet whose digest differs is run alone, reduced as far as it still differs, and written as a regression file: an
//! STL source with the expected bit memory, which a normal test replays on our engine (`tests/compare/*.awl`). Where
//! awlsim deviates from the published reference, the reference applies: `tests/compare/README.md`.

pub mod generate;
pub mod program;
pub mod random;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ob1_cpu::{Command, Cpu, CpuConfig, OperatingState};
use ob1_stl::{Library, Mnemonics, Options, Severity, Source};
use ob1_time::{Instant, Span};

use crate::awlsim::{Awlsim, Failure, Scratch};
use crate::sim::clock::VirtualClock;
use program::{COMPARED, SNIPPETS, Snippet};

/// The result of one seed.
#[derive(Debug)]
pub enum Verdict {
    /// The same memory.
    Same,
    /// A snippet differs.
    Differs(Box<Difference>),
}

/// The smallest snippet that still differs.
#[derive(Debug)]
pub struct Difference {
    /// Its number in the program of the seed.
    pub index: usize,
    /// The snippet.
    pub snippet: Snippet,
    /// MB 0 to 191 of our engine.
    pub ours: Vec<u8>,
    /// MB 0 to 191 of awlsim.
    pub theirs: Vec<u8>,
}

/// Runs the program on our engine until its fault; returns MB 0 to 191.
///
/// # Errors
/// If it does not compile or ends in any other way.
pub fn run_ours(text: &str, accumulators: u8) -> Result<Vec<u8>, Failure> {
    let options = Options { mnemonics: Mnemonics::German, ..Options::default() };
    let output = ob1_stl::compile(&[Source::new("compare.awl", text.as_bytes())], &Library::new(), &options);
    if let Some(error) = output.diagnostics.iter().find(|d| d.severity == Severity::Error) {
        return Err(format!("{}\n{text}", ob1_stl::render(error, &Source::new("compare.awl", text.as_bytes()))).into());
    }
    let config = CpuConfig { accumulators, memory_bytes: 2048, watchdog: Span::ZERO, ..CpuConfig::default() };
    let mut cpu = Cpu::new(config, &output.program, Vec::new(), Vec::new(), ob1_cpu::engine::REFERENCE)
        .map_err(|errors| format!("{errors:?}"))?;
    cpu.request(Command::Warm);
    let mut clock = VirtualClock(Instant::START);
    let end = cpu.cycle(&mut clock);
    // The deliberate fault opens data block 4711; any other fault is caused by the snippet.
    let fault = cpu.diagnostics().find(|entry| entry.site.is_some());
    if end.state != OperatingState::Stop || fault.is_none_or(|entry| entry.data != 4711) {
        let entries: String = cpu.diagnostics().map(|entry| format!("{entry}\n")).collect();
        return Err(format!("our engine did not stop at the end:\n{entries}{text}").into());
    }
    Ok(cpu.bit_memory()[..COMPARED].to_vec())
}

/// Compares the program of a seed.
///
/// # Errors
/// If one of the two cannot run it: an error of the generator or of the engine named in the text.
pub fn compare(seed: u64, awlsim: &Awlsim, scratch: &Scratch) -> Result<Verdict, Failure> {
    let accumulators = if seed.is_multiple_of(2) { 4 } else { 2 };
    let snippets: Vec<Snippet> = (0..SNIPPETS).map(|index| Snippet::new(seed, index, accumulators)).collect();
    let (ours, theirs) = both(&program::with_digests(&snippets), accumulators, awlsim, scratch)?;
    let digests = ours.chunks(4).zip(theirs.chunks(4));
    let Some((index, _)) = digests.enumerate().find(|(_, (ours, theirs))| ours != theirs) else {
        return Ok(Verdict::Same);
    };
    let snippet = minimal(&snippets[index], awlsim, scratch)?;
    let (ours, theirs) = both(&program::alone(&snippet), accumulators, awlsim, scratch)?;
    Ok(Verdict::Differs(Box::new(Difference { index, snippet, ours, theirs })))
}

fn both(text: &str, accumulators: u8, awlsim: &Awlsim, scratch: &Scratch) -> Result<(Vec<u8>, Vec<u8>), Failure> {
    let ours = run_ours(text, accumulators)?;
    let theirs = awlsim.run(&scratch.write("compare.awl", text)?, accumulators)?.bytes();
    Ok((ours, theirs))
}

/// Removes items, and then single statements, as long as the rest still differs.
fn minimal(snippet: &Snippet, awlsim: &Awlsim, scratch: &Scratch) -> Result<Snippet, Failure> {
    let differs = |snippet: &Snippet| {
        // A snippet that one of the two refuses (for example an unclosed bracket) is not a smaller example.
        both(&program::alone(snippet), snippet.accumulators, awlsim, scratch).is_ok_and(|(ours, theirs)| ours != theirs)
    };
    let mut smallest = snippet.clone();
    if !differs(&smallest) {
        return Err("a snippet differs behind the others, and not alone".into());
    }
    for index in (0..smallest.items.len()).rev() {
        let mut smaller = smallest.clone();
        smaller.items[index].clear();
        if differs(&smaller) {
            smallest = smaller;
        }
    }
    for index in 0..smallest.items.len() {
        for line in (0..smallest.items[index].len()).rev() {
            let mut smaller = smallest.clone();
            smaller.items[index].remove(line);
            if differs(&smaller) {
                smallest = smaller;
            }
        }
    }
    Ok(smallest)
}

impl Difference {
    /// The rest of the snippet, and the bytes that differ.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (index, item) in self.snippet.items.iter().enumerate().filter(|(_, item)| !item.is_empty()) {
            let _ = writeln!(text, "  {}: {}", generate::label(index), item.join("; "));
        }
        for (at, (ours, theirs)) in self.ours.iter().zip(&self.theirs).enumerate().filter(|(_, (a, b))| a != b) {
            let _ = writeln!(text, "  MB {at} ({}): ob1 {ours:02X}, awlsim {theirs:02X}", meaning(at));
        }
        text
    }

    /// The regression file: the source, and awlsim's bytes as the expected ones. If awlsim is wrong, replace them by
    /// those of the reference when adding the file.
    #[must_use]
    pub fn regression(&self) -> String {
        let rows = self.theirs.chunks(16).map(|row| row.iter().map(|b| format!(" {b:02X}")).collect::<String>());
        let expected: String = rows.map(|row| format!("{EXPECTED}{row}\n")).collect();
        format!("{ACCUMULATORS} {}\n{expected}\n{}", self.snippet.accumulators, program::alone(&self.snippet))
    }
}

/// The meaning of a byte of a single snippet.
fn meaning(at: usize) -> String {
    match at {
        0..64 => format!("its MB {}", at + 200),
        64..68 => "ACCU 1".into(),
        68..72 => "ACCU 2".into(),
        72..74 => "STW".into(),
        76..80 => "AR 1".into(),
        80..84 => "AR 2".into(),
        84..92 => "ACCU 3, 4".into(),
        92..96 => "DBNO, DINO".into(),
        96..160 => format!("DB 10 and 11, byte {}", at - 96),
        _ => format!("E and A, byte {}", at - 96),
    }
}

const ACCUMULATORS: &str = "// accumulators:";
const EXPECTED: &str = "// expected:";

/// Replays a regression file on our engine.
///
/// # Errors
/// The bytes that differ, or the reason why it did not run.
pub fn replay(text: &str) -> Result<(), Failure> {
    let accumulators =
        text.lines().find_map(|line| line.strip_prefix(ACCUMULATORS)).map_or(Ok(2), |n| n.trim().parse())?;
    let expected: Vec<u8> = text
        .lines()
        .filter_map(|line| line.strip_prefix(EXPECTED))
        .flat_map(str::split_whitespace)
        .map(|byte| u8::from_str_radix(byte, 16))
        .collect::<Result<_, _>>()?;
    if expected.len() != COMPARED {
        return Err(format!("{} bytes are expected, not {COMPARED}", expected.len()).into());
    }
    let ours = run_ours(text, accumulators)?;
    let differences: Vec<String> = (0..COMPARED)
        .filter(|&at| ours[at] != expected[at])
        .map(|at| format!("MB {at} ({}): {:02X}, expected {:02X}", meaning(at), ours[at], expected[at]))
        .collect();
    if differences.is_empty() { Ok(()) } else { Err(differences.join("\n").into()) }
}

/// The folder of the regression files.
#[must_use]
pub fn regressions() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("compare")
}
