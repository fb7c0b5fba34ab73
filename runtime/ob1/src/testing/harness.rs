//! A program that calls one block, for tests of that block alone.
//!
//! The call is in a generated function that becomes OB 1; no other organization block of the program stays. A
//! function gets its actual parameters from a generated data block, a function block keeps its own in a generated
//! instance. The first step of a test opens the call: in the scan before, with the start of the CPU, nothing is set
//! yet.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_cpu::Cell;
use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind, DataType, Interface};
use ob1_stl::Library;

use super::plan::Call;
use ob1_station_file::finding::Text;
use ob1_station_file::findings::{CALL, Findings};
use ob1_station_file::sources::Mnemonics;

/// The number from which free ones are looked for, downwards.
const HIGHEST: u16 = 65_000;

/// The generated source, and where the parameters lie.
#[derive(Debug)]
pub(super) struct Harness {
    pub(super) source: String,
    function: BlockId,
    /// The data block whose first bit opens the call.
    data: u16,
    /// Parameters by upper-case name, as names of cells.
    parameters: BTreeMap<String, String>,
    /// The instance of a function block: every name in it is known.
    instance: Option<u16>,
}

impl Harness {
    /// For a block of a program or its library.
    pub(super) fn new(
        call: &Call,
        program: &Program,
        library: &Library,
        mnemonics: Mnemonics,
        f: &mut Findings<'_>,
    ) -> Option<Self> {
        let own = program.blocks.iter().find(|block| block.id == call.block).map(|block| &block.interface);
        let Some(interface) = own.or_else(|| library.get(call.block).map(|block| &block.interface)) else {
            let remedy = "a block of the sources, of a plugin, or a standard block";
            f.error(CALL, call.at.clone(), format!("{} is not there", call.block), remedy);
            return None;
        };
        for (name, _) in &call.with {
            if interface.formal(name.get_ref()).is_none() {
                let names: Vec<&str> = interface.formals().map(|p| p.name.as_str()).collect();
                let remedy = format!("{} has {}", call.block, names.join(", "));
                f.error(CALL, name.span(), format!("{} has no parameter {}", call.block, name.get_ref()), remedy);
            }
        }
        let is_free = |number: &u16| program.data.iter().all(|db| db.number != *number);
        let mut free = (1..=HIGHEST).rev().filter(is_free);
        let (data, instance) = (free.next()?, free.next()?);
        let instance = call.block.kind.has_instance().then_some(instance);
        let function = (1..=HIGHEST).rev().map(|number| BlockId::new(BlockKind::Fc, number));
        let function = function.into_iter().find(|id| program.blocks.iter().all(|b| b.id != *id))?;
        let mut making =
            Making { call, data, declared: String::new(), actuals: Vec::new(), parameters: BTreeMap::new() };
        if call.block.kind.has_instance() {
            making.function_block(interface);
        } else {
            making.function(interface, f);
        }
        let source = making.source(function, instance, mnemonics);
        Some(Self { source, function, data, parameters: making.parameters, instance })
    }

    /// Makes the generated function OB 1 and drops the others.
    pub(super) fn install(&self, program: &mut Program) {
        program.blocks.retain(|block| block.id.kind != BlockKind::Ob);
        if let Some(block) = program.blocks.iter_mut().find(|block| block.id == self.function) {
            block.id = BlockId::new(BlockKind::Ob, 1);
        }
    }

    /// The bit that opens the call.
    pub(super) fn opening(&self) -> Cell {
        Cell::Db(self.data, 0)
    }

    /// The cell a parameter lies in, or a name in the instance; other names stay.
    pub(super) fn cell(&self, name: &str, program: &Program) -> Option<String> {
        if let Some(cell) = self.parameters.get(&name.to_ascii_uppercase()) {
            return Some(cell.clone());
        }
        let number = self.instance?;
        let db = program.data.iter().find(|db| db.number == number)?;
        ob1_model::Component::find(&db.components, name).map(|_| format!("DB{number}.{name}"))
    }
}

struct Making<'a> {
    call: &'a Call,
    data: u16,
    declared: String,
    actuals: Vec<String>,
    parameters: BTreeMap<String, String>,
}

impl Making<'_> {
    fn with(&self, name: &str) -> Option<&str> {
        self.call
            .with
            .iter()
            .find(|(n, _)| n.get_ref().eq_ignore_ascii_case(name))
            .map(|(_, text)| text.get_ref().as_str())
    }

    /// Elementary parameters stay in the instance, where they keep their initial values.
    fn function_block(&mut self, interface: &Interface) {
        for param in interface.formals() {
            if let Some(text) = self.with(&param.name) {
                self.actuals.push(format!("{} := {text}", param.name));
            }
        }
    }

    fn function(&mut self, interface: &Interface, f: &mut Findings<'_>) {
        for (index, param) in interface.formals().enumerate() {
            let given = self.with(&param.name).map(str::to_owned);
            let declared = match (&param.ty, &given) {
                (DataType::String(_), _) if given.as_ref().is_none_or(|text| text.starts_with('\'')) => true,
                (DataType::DateAndTime, _) => given.as_ref().is_none_or(|text| text.contains('#')),
                (ty, None) => ty.elementary_bits().is_some(),
                (_, Some(_)) => false,
            };
            let actual = match (declared, given) {
                (true, given) => {
                    let start = given.map_or_else(String::new, |text| format!(" := {text}"));
                    let _ = writeln!(self.declared, "  P{index} : {}{start};", type_text(&param.ty));
                    let cell = format!("DB{}.P{index}", self.data);
                    self.parameters.insert(param.name.to_ascii_uppercase(), cell.clone());
                    cell
                }
                (false, Some(text)) => text,
                (false, None) => {
                    let message = format!("{} is a {} and needs an actual parameter", param.name, param.ty.name());
                    let remedy =
                        format!("with = {{ {} = \"...\" }}, as a CALL in STL has it: T 5, P#M 0.0 BYTE 4", param.name);
                    f.error(CALL, self.call.at.clone(), message, remedy);
                    continue;
                }
            };
            self.actuals.push(format!("{} := {actual}", param.name));
        }
    }

    fn source(&self, function: BlockId, instance: Option<u16>, mnemonics: Mnemonics) -> String {
        let (Self { data, declared, call, .. }, instance) =
            (self, instance.map_or_else(String::new, |number| format!(", DB {number}")));
        let actuals = self.actuals.join(",\n    ");
        let actuals = if actuals.is_empty() { String::new() } else { format!(" (\n    {actuals})") };
        let (scan, jump) = if mnemonics == Mnemonics::International { ("A", "JCN") } else { ("U", "SPBN") };
        format!(
            "DATA_BLOCK DB {data}\nSTRUCT\n  OPEN : BOOL;\n{declared}END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\
             FUNCTION {function} : VOID\nBEGIN\nNETWORK\n  {scan} DB{data}.OPEN;\n  {jump} end;\n  \
             CALL {}{instance}{actuals};\nend: NOP 0;\nEND_FUNCTION\n",
            call.block
        )
    }
}

fn type_text(ty: &DataType) -> String {
    match ty {
        DataType::String(len) => format!("STRING [{len}]"),
        other => other.name().to_owned(),
    }
}

/// Findings about the generated source, reported at the place of the call.
pub(super) fn of_generated(
    findings: &[ob1_station_file::finding::Finding],
    call: &Call,
    source: Text<'_>,
) -> Vec<ob1_station_file::finding::Finding> {
    let told = findings.iter().map(|found| {
        let message = format!("{} cannot be called in this way: {}", call.block, found.message);
        source.finding(found.level, CALL, call.at.clone(), message, found.remedy.clone())
    });
    told.collect()
}
