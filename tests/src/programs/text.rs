//! The text of a drawn program: operands, calls of handling blocks with their records, and the blocks around them.
//!
//! The program keeps its own records: before and after each call it appends the values of all parameters to data block
//! [`TRACE_DB`], which the run reads and empties after each cycle. A record is written between two safe points, so an
//! OB 35 that interrupts the OB 1 puts its records between two others, never into one.

use std::fmt::Write as _;

/// Data block of the records: word 0 is the place of the next one.
pub const TRACE_DB: u16 = 200;
/// Place of the first record.
pub const TRACE_START: u16 = 2;
/// Bytes of that data block.
const TRACE_BYTES: u16 = 8000;

/// Elementary type of a parameter, as far as a record needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// BOOL
    Bool,
    /// BYTE
    Byte,
    /// WORD, INT
    Word,
    /// DWORD, DINT, TIME
    Dword,
    /// Has no value in a record: a data block, a timer, an ANY.
    None,
}

impl Type {
    /// Bytes in a record.
    #[must_use]
    pub fn bytes(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Bool | Self::Byte => 1,
            Self::Word => 2,
            Self::Dword => 4,
        }
    }

    /// Name in a declaration.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bool => "BOOL",
            Self::Byte => "BYTE",
            Self::Word => "WORD",
            Self::Dword | Self::None => "DWORD",
        }
    }
}

/// A parameter of a block.
pub type Parameter = (&'static str, Type);

/// The interface of a handling block.
#[derive(Debug)]
pub struct Block {
    /// As in a CALL: `FC 0`.
    pub id: &'static str,
    /// Its parameters in the manual's order.
    pub parameters: &'static [Parameter],
}

/// An actual parameter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Operand {
    /// Bit memory: byte and bit.
    Memory(u32, u32),
    /// Data block, byte and bit.
    Data(u16, u32, u32),
    /// A local name: temporary, static or a parameter of the calling block.
    Local(String),
    /// Anything without a value in the record: a constant, a block.
    Fixed(String),
}

impl Operand {
    /// A constant or block.
    #[must_use]
    pub fn fixed(text: &str) -> Self {
        Self::Fixed(text.to_owned())
    }

    /// As it stands in the text.
    #[must_use]
    pub fn text(&self, of: Type) -> String {
        match (self, of) {
            (Self::Memory(byte, bit), Type::Bool) => format!("M {byte}.{bit}"),
            (Self::Memory(byte, _), Type::Byte) => format!("MB {byte}"),
            (Self::Memory(byte, _), Type::Word) => format!("MW {byte}"),
            (Self::Memory(byte, _), _) => format!("MD {byte}"),
            (Self::Data(db, byte, bit), Type::Bool) => format!("DB{db}.DBX {byte}.{bit}"),
            (Self::Data(db, byte, _), Type::Byte) => format!("DB{db}.DBB {byte}"),
            (Self::Data(db, byte, _), Type::Word) => format!("DB{db}.DBW {byte}"),
            (Self::Data(db, byte, _), _) => format!("DB{db}.DBD {byte}"),
            (Self::Local(name), _) => format!("#{name}"),
            (Self::Fixed(text), _) => text.clone(),
        }
    }

    fn is_recorded(&self, of: Type) -> bool {
        of != Type::None && !matches!(self, Self::Fixed(_))
    }
}

/// A place in the program where a handling block is called, or where something else is recorded.
#[derive(Clone, Debug)]
pub struct Site {
    /// The block; without one the record is a mark of the program (only `after`).
    pub block: Option<&'static Block>,
    /// What is written after the block's name, for example `DB 15`; empty for an FC, `#name` alone for a
    /// multi-instance.
    pub instance: String,
    /// Actual parameters in the order of the interface; None: not supplied.
    pub operands: Vec<Option<Operand>>,
    /// What is recorded besides.
    pub extra: Vec<(Operand, Type)>,
}

impl Site {
    /// A call of an FC.
    #[must_use]
    pub fn call(block: &'static Block, operands: Vec<Operand>) -> Self {
        assert_eq!(operands.len(), block.parameters.len(), "{}", block.id);
        let operands = operands.into_iter().map(Some).collect();
        Self { block: Some(block), instance: String::new(), operands, extra: Vec::new() }
    }

    /// A mark with these values.
    #[must_use]
    pub fn mark(extra: Vec<(Operand, Type)>) -> Self {
        Self { block: None, instance: String::new(), operands: Vec::new(), extra }
    }

    /// What a record has: None for a parameter without a value.
    pub fn values(&self) -> impl Iterator<Item = Option<(&Operand, Type)>> {
        let types = self.block.map_or(&[][..], |block| block.parameters).iter().map(|(_, of)| *of);
        let own = self.operands.iter().zip(types).map(|(operand, of)| operand.as_ref().map(|operand| (operand, of)));
        let all = own.chain(self.extra.iter().map(|(operand, of)| Some((operand, *of))));
        all.map(|value| value.filter(|(operand, of)| operand.is_recorded(*of)))
    }

    /// Bytes of a record, its head included.
    #[must_use]
    pub fn bytes(&self) -> u32 {
        2 + self.values().flatten().map(|(_, of)| of.bytes()).sum::<u32>()
    }

    fn record(&self, number: usize, after: bool, out: &mut String) {
        let head = 2 * number + usize::from(after);
        let _ = write!(out, "AUF DB {TRACE_DB};\nL DBW 0;\nSLD 3;\nLAR1;\nL {head};\nT DBW [AR1,P#0.0];\n");
        let mut at = 2;
        for (operand, of) in self.values().flatten() {
            let text = operand.text(of);
            let open = match operand {
                Operand::Data(..) => format!("AUF DB {TRACE_DB};\n"),
                _ => String::new(),
            };
            let _ = match of {
                Type::Bool => write!(out, "U {text};\n{open}= DBX [AR1,P#{at}.0];\n"),
                Type::Byte => write!(out, "L {text};\n{open}T DBB [AR1,P#{at}.0];\n"),
                Type::Word => write!(out, "L {text};\n{open}T DBW [AR1,P#{at}.0];\n"),
                Type::Dword | Type::None => write!(out, "L {text};\n{open}T DBD [AR1,P#{at}.0];\n"),
            };
            at += of.bytes();
        }
        let _ = write!(out, "AUF DB {TRACE_DB};\nL DBW 0;\nL {at};\n+I;\nT DBW 0;\n");
    }

    fn text(&self, number: usize) -> String {
        let mut out = String::new();
        if let Some(block) = self.block {
            self.record(number, false, &mut out);
            let actual = block.parameters.iter().zip(&self.operands);
            let list: Vec<String> = actual
                .filter_map(|((name, of), operand)| Some(format!("{name} := {}", operand.as_ref()?.text(*of))))
                .collect();
            let name = match self.instance.as_str() {
                "" => block.id.to_owned(),
                local if local.starts_with('#') => local.to_owned(),
                db => format!("{}, {db}", block.id),
            };
            let _ = writeln!(out, "CALL {name} ({});", list.join(", "));
        }
        self.record(number, true, &mut out);
        out
    }
}

/// A program that grows.
#[derive(Debug, Default)]
pub struct Program {
    /// The places with records, by their number.
    pub sites: Vec<Site>,
    blocks: String,
    labels: usize,
}

impl Program {
    /// Registers a place; returns its text.
    pub fn site(&mut self, site: Site) -> String {
        self.sites.push(site);
        self.sites[self.sites.len() - 1].text(self.sites.len() - 1)
    }

    /// A label that is new.
    pub fn label(&mut self) -> String {
        self.labels += 1;
        format!("m{:03}", self.labels)
    }

    /// The text, passed over while `condition` (which ends with an RLO) is false.
    pub fn only_if(&mut self, condition: &str, text: &str) -> String {
        let label = self.label();
        format!("{condition}SPBN {label};\n{text}{label}: NOP 0;\n")
    }

    /// The text in every `n`-th pass; the word of bit memory at `counter` counts.
    pub fn every(&mut self, n: u32, counter: u32, text: &str) -> String {
        let text = format!("L 0;\nT MW {counter};\n{text}");
        let rest = self.only_if(&format!("L MW {counter};\nL {n};\n>=I;\n"), &text);
        format!("L MW {counter};\nL 1;\n+I;\nT MW {counter};\n{rest}")
    }

    /// A whole block of the program: `head` with its declarations (up to BEGIN) and its end.
    pub fn block(&mut self, kind: &str, name: &str, declarations: &str, text: &str) {
        let end = format!("END_{}", kind.split(' ').next().unwrap_or(kind));
        let kind = if kind == "FUNCTION" { format!("FUNCTION {name} : VOID") } else { format!("{kind} {name}") };
        let _ = write!(self.blocks, "{kind}\n{declarations}BEGIN\n{text}{end}\n");
    }

    /// A data block of so many bytes.
    pub fn data_block(&mut self, number: u16, bytes: u16) {
        let _ = write!(
            self.blocks,
            "DATA_BLOCK DB {number}\nSTRUCT\nD : ARRAY [1..{bytes}] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"
        );
    }

    /// The instance data block of a function block.
    pub fn instance(&mut self, number: u16, of: &str) {
        let _ = write!(self.blocks, "DATA_BLOCK DB {number}\n{of}\nBEGIN\nEND_DATA_BLOCK\n");
    }

    /// The finished text: the blocks first that others call.
    #[must_use]
    pub fn finish(self) -> (String, Vec<Site>) {
        let trace = format!(
            "DATA_BLOCK DB {TRACE_DB}\nSTRUCT\nNEXT : INT := {TRACE_START};\nD : ARRAY [1..{TRACE_BYTES}] OF BYTE;\n\
             END_STRUCT\nBEGIN\nEND_DATA_BLOCK\n"
        );
        (trace + &self.blocks, self.sites)
    }
}
