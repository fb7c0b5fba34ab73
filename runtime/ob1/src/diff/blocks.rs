//! Blocks as lines: each as it is shown, and as it is compared, with names that say the place only.

use std::collections::BTreeMap;

use ob1_ir::{CodeBlock, DataBlock, Op, Program, Target};
use ob1_model::{BlockId, BlockKind, DataType, Interface, Section};
use ob1_stl::print::{Declared, Heading, Listing, Printer, Unprintable};
use similar::{Algorithm, ChangeTag, DiffOp, capture_diff_slices};

/// Lines shown before and after a difference.
const CONTEXT: usize = 2;

/// A line of a block.
#[derive(Debug)]
pub(super) struct Line {
    /// With the names of its program.
    pub(super) shown: String,
    /// Without any: two lines that mean the same are equal.
    meant: String,
}

/// A block as text.
#[derive(Debug)]
pub(super) struct Text {
    pub(super) id: BlockId,
    name: Option<String>,
    pub(super) lines: Vec<Line>,
}

/// Lines that differ, in one part of a block.
#[derive(Debug)]
pub(super) struct Change<'t> {
    /// `declarations`, `network 3`, `values`.
    pub(super) at: String,
    /// The side: `-`, `+`, or a blank for a line of both; the line.
    pub(super) lines: Vec<(char, &'t str)>,
}

impl Text {
    /// Kind, number and name: `FC 5 "Valve"`.
    pub(super) fn title(&self) -> String {
        self.name.as_ref().map_or_else(|| self.id.to_string(), |name| format!("{} \"{name}\"", self.id))
    }

    /// A data block's declarations alone; another block whole.
    pub(super) fn without_values(mut self) -> Self {
        if self.id.kind == BlockKind::Db {
            let values = self.lines.iter().position(|line| line.meant == "BEGIN");
            self.lines.truncate(values.unwrap_or(self.lines.len()));
        }
        self
    }

    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.lines.iter().map(|line| &line.meant).eq(other.lines.iter().map(|line| &line.meant))
    }
}

/// The blocks of a program as text: `shown` has the names of what it calls, `meant` has none.
pub(super) fn texts(program: &Program, shown: &Printer<'_>, meant: &Printer<'_>) -> Vec<Text> {
    let function_blocks = program.blocks.iter().filter(|block| block.id.kind == BlockKind::Fb);
    let types: Vec<(BlockId, DataType)> =
        function_blocks.map(|block| (block.id, nameless_type(&block.interface.instance_type()))).collect();
    let of_block = |block: &CodeBlock| {
        let bare = CodeBlock { name: None, interface: nameless(&block.interface), ..block.clone() };
        let declared = Declared { instances: instances(block, &types), ..Declared::default() };
        let text = |printer: &Printer<'_>, block: &CodeBlock| {
            printed(printer.block(block, &Heading::default(), &declared, &Listing::default()), || {
                block.code.iter().map(|stmt| stmt.op.to_string()).collect()
            })
        };
        lines(block.id, block.name.clone(), text(shown, block), text(meant, &bare))
    };
    let of_data = |data: &DataBlock| {
        let mut bare = DataBlock { name: None, ..data.clone() };
        for (component, at) in bare.components.iter_mut().zip(0..) {
            component.path = format!("c{at}");
            component.ty = nameless_type(&component.ty);
        }
        let text = |printer: &Printer<'_>, data: &DataBlock| {
            let raw = || data.bytes.chunks(16).map(|row| format!("{row:02X?}")).collect();
            printed(printer.data(data, &Heading::default()), raw)
        };
        let id = BlockId::new(BlockKind::Db, data.number);
        lines(id, data.name.clone(), text(shown, data), text(meant, &bare))
    };
    program.blocks.iter().map(of_block).chain(program.data.iter().map(of_data)).collect()
}

/// The variables that are instances of function blocks. A declaration does not say of which: the calls do, else the
/// first function block with the same variables.
fn instances(block: &CodeBlock, types: &[(BlockId, DataType)]) -> BTreeMap<usize, BlockId> {
    let called = |at| {
        block.code.iter().find_map(|stmt| match &stmt.op {
            Op::Call(call) => match call.target {
                Target::Local(id, place) if place == at => Some(id),
                _ => None,
            },
            _ => None,
        })
    };
    let like = |ty: &DataType| {
        let ty = is_instance(ty).then(|| nameless_type(ty))?;
        types.iter().find(|(_, instance)| *instance == ty).map(|(id, _)| *id)
    };
    let statics = block.interface.params.iter().enumerate().filter(|(_, param)| param.section == Section::Static);
    statics.filter_map(|(index, param)| called(param.at).or_else(|| like(&param.ty)).map(|id| (index, id))).collect()
}

/// Whether it has what stands between the sections of an instance.
fn is_instance(ty: &DataType) -> bool {
    matches!(ty, DataType::Struct(fields) if fields.iter().any(|field| field.name.is_empty() || is_instance(&field.ty)))
}

/// The lines of a text, or what stands for a block that no source can express.
fn printed(text: Result<String, Unprintable>, raw: impl FnOnce() -> Vec<String>) -> Vec<String> {
    text.map_or_else(|_| raw(), |text| text.lines().map(str::to_owned).collect())
}

fn lines(id: BlockId, name: Option<String>, shown: Vec<String>, meant: Vec<String>) -> Text {
    let whole = shown.len() == meant.len();
    // Names never change how many lines there are; where they did, the lines are compared as they are shown.
    let meant = if whole { meant } else { shown.clone() };
    let lines = shown.into_iter().zip(meant).map(|(shown, meant)| Line { shown, meant }).collect();
    Text { id, name, lines }
}

pub(super) fn nameless(interface: &Interface) -> Interface {
    let mut bare = interface.clone();
    for (param, at) in bare.params.iter_mut().zip(0..) {
        param.name = format!("p{at}");
        param.ty = nameless_type(&param.ty);
    }
    bare
}

fn nameless_type(ty: &DataType) -> DataType {
    match ty {
        DataType::Struct(fields) => {
            let mut fields = fields.clone();
            for (field, at) in fields.iter_mut().zip(0..) {
                if !field.name.is_empty() {
                    field.name = format!("f{at}");
                }
                field.ty = nameless_type(&field.ty);
            }
            DataType::Struct(fields)
        }
        DataType::Array(dims, element) => DataType::Array(dims.clone(), Box::new(nameless_type(element))),
        other => other.clone(),
    }
}

/// What is compared of a line: a label and where a jump leads move with the lines before them.
fn key(line: &str) -> &str {
    let statement = match line.split_once(':') {
        Some((label, rest)) if label.len() <= 5 && !rest.starts_with('=') && !label.contains(' ') => rest,
        _ => line,
    };
    let statement = statement.trim();
    match statement.split_once(' ') {
        Some((mnemonic, _)) if mnemonic.starts_with('J') || mnemonic == "LOOP" => mnemonic,
        _ => statement,
    }
}

/// What differs between two texts of a block.
pub(super) fn difference<'t>(old: &'t Text, new: &'t Text) -> Vec<Change<'t>> {
    // One more variable gives those behind it other places, and where the names are the same they say more. Last: where
    // jumps lead.
    let by_place = |text: &'t Text| text.lines.iter().map(|line| key(&line.meant)).collect::<Vec<_>>();
    let by_name = |text: &'t Text| text.lines.iter().map(|line| key(&line.shown)).collect::<Vec<_>>();
    let whole = |text: &'t Text| text.lines.iter().map(|line| line.meant.as_str()).collect::<Vec<_>>();
    let ways = [(by_place(old), by_place(new)), (by_name(old), by_name(new)), (whole(old), whole(new))];
    let changed = |op: &DiffOp| match op {
        DiffOp::Equal { .. } => 0,
        other => other.old_range().len() + other.new_range().len(),
    };
    let count = |ops: &[DiffOp]| ops.iter().map(changed).sum::<usize>();
    let found = ways.into_iter().map(|(a, b)| (capture_diff_slices(Algorithm::Myers, &a, &b), a, b));
    let Some((ops, a, b)) = found.filter(|(ops, ..)| count(ops) > 0).min_by_key(|(ops, ..)| count(ops)) else {
        return Vec::new();
    };
    let mut changes: Vec<Change<'t>> = Vec::new();
    for group in similar::group_diff_ops(ops, CONTEXT) {
        let mut part = None;
        for change in group.iter().flat_map(|op| op.iter_changes(&a, &b)) {
            let (side, text, at) = match (change.tag(), change.old_index(), change.new_index()) {
                (ChangeTag::Delete, Some(at), _) => ('-', old, at),
                (ChangeTag::Insert, _, Some(at)) => ('+', new, at),
                (_, _, Some(at)) => (' ', new, at),
                _ => continue,
            };
            let here = place(text, at);
            if part.as_ref() != Some(&here) {
                changes.push(Change { at: here.clone(), lines: Vec::new() });
                part = Some(here);
            }
            if let (Some(change), Some(line)) = (changes.last_mut(), text.lines.get(at)) {
                change.lines.push((side, &line.shown));
            }
        }
    }
    changes.retain(|change| change.lines.iter().any(|(side, _)| *side != ' '));
    changes
}

/// The part of a block that a line belongs to.
fn place(text: &Text, at: usize) -> String {
    let before = text.lines.get(..=at).unwrap_or_default();
    let networks = before.iter().filter(|line| line.meant == "NETWORK").count();
    match (networks, before.iter().any(|line| line.meant == "BEGIN")) {
        (0, false) => "declarations".to_owned(),
        (0, true) if text.id.kind == BlockKind::Db => "values".to_owned(),
        (0, true) => "statements".to_owned(),
        (network, _) => format!("network {network}"),
    }
}
