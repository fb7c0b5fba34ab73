//! Between compiled interfaces and the declarations of the program: types, names made up where the bytes have none,
//! start values.

use std::collections::BTreeMap;

use ob1_model::{BlockId, Component, DataType, Dimension, Field, Interface, Layout, Param, Section};

use crate::compiled::{CompiledInterface, DEPTH, Entry, EntryType, InterfaceKind, STARTS, section_code};
use crate::error::{Mc7Error, Problem};

/// The names of declarations without one: section and number.
const fn prefix(section: Section) -> &'static str {
    match section {
        Section::Input => "IN",
        Section::Output => "OUT",
        Section::InOut => "IN_OUT",
        Section::Static => "STAT",
        Section::Temp => "TEMP",
        Section::Return => "RET_VAL",
    }
}

/// Counts the declarations of each section.
#[derive(Default)]
struct Names(BTreeMap<&'static str, u32>);

impl Names {
    fn next(&mut self, section: Section) -> String {
        let prefix = prefix(section);
        let count = self.0.entry(prefix).or_default();
        let name =
            if section == Section::Return && *count == 0 { prefix.to_owned() } else { format!("{prefix}{count}") };
        *count += 1;
        name
    }
}

impl CompiledInterface {
    /// The declarations of a code block, laid out, with the names `IN0`, `OUT0`, ... that count in each section.
    /// `has_instance`: the block is an FB or SFB.
    pub fn interface(&self, has_instance: bool) -> Interface {
        let mut start = Start { bytes: Some(&self.start) };
        let mut names = Names::default();
        let mut params = Vec::new();
        for entry in &self.entries {
            let Some(section) = entry.section() else { continue };
            let name = names.next(section);
            let mut param = Param::new(&name, section, data_type(&entry.ty, &mut start));
            param.initial = start.take(entry, &param.ty);
            params.push(param);
        }
        let mut interface = Interface { params, ..Interface::default() };
        interface.lay_out(has_instance);
        interface
    }

    /// Which declarations of [`interface`](Self::interface) are instances of a function block, by their index.
    pub fn instances(&self) -> BTreeMap<usize, BlockId> {
        let placed = self.entries.iter().filter(|e| e.section().is_some()).enumerate();
        placed
            .filter_map(|(at, entry)| match &entry.ty {
                EntryType::Instance(id, _) => Some((at, *id)),
                _ => None,
            })
            .collect()
    }

    /// The declarations of a data block, named as those of [`interface`](Self::interface), with their addresses.
    pub fn components(&self) -> Vec<Component> {
        let instance = matches!(self.kind, InterfaceKind::OfFb | InterfaceKind::OfSfb);
        let interface = self.interface(true);
        let mut layout = Layout::new();
        let place = |p: &Param| {
            let ty = if p.is_pointer() { DataType::Pointer } else { p.ty.clone() };
            let at = if instance { p.at } else { layout.place(&ty) };
            Component { path: p.name.clone(), ty, at }
        };
        interface.params.iter().filter(|p| p.section != Section::Temp).map(place).collect()
    }

    /// The compiled form of a code block's declarations. `instances` says which declarations are instances of a
    /// function block, by their index in [`Interface::params`]; `blocks` gives the same of the function blocks.
    ///
    /// # Errors
    /// S1508 where an instance is of a block that is not known, or lies too deep, and where the whole is longer than
    /// 65,535 bytes.
    pub fn of(
        number: u16,
        interface: &Interface,
        instances: &BTreeMap<usize, BlockId>,
        blocks: &Blocks<'_>,
    ) -> Result<Self, Mc7Error> {
        let mut start = Vec::new();
        let entries = entries(interface, instances, blocks, Some(&mut start), 0)
            .map_err(|what| Mc7Error::at(Problem::Interface(what), 0, &[]))?;
        let compiled = Self { kind: InterfaceKind::Code, number, entries, start, rest: vec![0] };
        compiled.bytes().map(|_| compiled)
    }
}

/// The interface of a function block, and which of its declarations are instances of others.
pub type Blocks<'b> = dyn Fn(BlockId) -> Option<(&'b Interface, &'b BTreeMap<usize, BlockId>)> + 'b;

/// The entries of an interface; of an instance, without `start`, its temporaries and start values are left out.
fn entries(
    interface: &Interface,
    instances: &BTreeMap<usize, BlockId>,
    blocks: &Blocks<'_>,
    mut start: Option<&mut Vec<u8>>,
    depth: u32,
) -> Result<Vec<Entry>, &'static str> {
    const ORDER: [Section; 6] =
        [Section::Input, Section::Return, Section::Output, Section::InOut, Section::Static, Section::Temp];
    if depth > DEPTH / 2 {
        return Err("instances are nested too deep");
    }
    let mut out = Vec::new();
    for section in ORDER {
        for (index, param) in interface.params.iter().enumerate().filter(|(_, p)| p.section == section) {
            if section == Section::Temp && start.is_none() {
                continue;
            }
            if let Some(id) = instances.get(&index) {
                let (inner, within) = blocks(*id).ok_or("an instance is of a block that is not known")?;
                let ty = EntryType::Struct(entries(inner, within, blocks, None, depth + 1)?);
                let made = Entry { ty, attribute: section_code(section), extra: 0 };
                out.push(Entry { ty: EntryType::Instance(*id, Box::new(made)), attribute: 0, extra: 0 });
                continue;
            }
            let mut values = Vec::new();
            let mut made = entry(&param.ty, section, &mut values);
            if let Some(initial) = &param.initial
                && start.is_some()
                && packed(&param.ty, initial, &mut values)
            {
                made.attribute |= STARTS;
            }
            match start.as_deref_mut() {
                Some(start) => start.extend(values),
                None => made.clear_starts(),
            }
            out.push(made);
        }
    }
    Ok(out)
}

/// The start values, taken from the front. Nothing more is taken once one is met whose form is unknown.
struct Start<'s> {
    bytes: Option<&'s [u8]>,
}

impl Start<'_> {
    /// The start value of an entry, laid out as in memory.
    fn take(&mut self, entry: &Entry, ty: &DataType) -> Option<Vec<u8>> {
        if !entry.has_start() {
            return None;
        }
        let bytes = self.bytes?;
        let length = match ty {
            DataType::String(_) => {
                // Greatest length, length, characters.
                2 + usize::from(bytes.get(1).copied().unwrap_or(0))
            }
            ty => match ty.elementary_bits() {
                Some(bits) => bits.div_ceil(8) as usize,
                None => {
                    self.bytes = None;
                    return None;
                }
            },
        };
        let Some(value) = bytes.get(..length) else {
            self.bytes = None;
            return None;
        };
        self.bytes = bytes.get(length..);
        let mut value = value.to_vec();
        if matches!(ty, DataType::String(_)) {
            value.resize(Layout::bits(ty) as usize / 8, 0);
        } else {
            value.reverse();
        }
        Some(value)
    }
}

/// Appends a start value in the packed form; false where its type has none that is known.
fn packed(ty: &DataType, initial: &[u8], out: &mut Vec<u8>) -> bool {
    match ty {
        DataType::String(_) => {
            let length = 2 + usize::from(initial.get(1).copied().unwrap_or(0));
            out.extend(initial.iter().copied().chain(std::iter::repeat(0)).take(length));
        }
        ty => {
            let Some(bits) = ty.elementary_bits() else { return false };
            if initial.len() != bits.div_ceil(8) as usize {
                return false;
            }
            out.extend(initial.iter().rev());
        }
    }
    true
}

/// The type of an entry. Components are named `X0`, `X1`, ...
fn data_type(ty: &EntryType, start: &mut Start<'_>) -> DataType {
    match ty {
        EntryType::Simple(ty) => ty.clone(),
        EntryType::String(length) => DataType::String(*length),
        EntryType::Array(dims, element) => DataType::Array(dims.clone(), Box::new(data_type(&element.ty, start))),
        EntryType::Struct(children) => DataType::Struct(fields(children, false, start)),
        EntryType::Instance(_, inner) => match &inner.ty {
            EntryType::Struct(children) => DataType::Struct(fields(children, true, start)),
            other => data_type(other, start),
        },
    }
}

/// The components of a structure; of an instance without its temporaries, and separated by section as `ob1_ir`'s layout
/// text says: nameless structures of no length make the next section begin on an even byte.
fn fields(children: &[Entry], instance: bool, start: &mut Start<'_>) -> Vec<Field> {
    let mut out: Vec<Field> = Vec::new();
    let mut last = None;
    let mut names = Names::default();
    for (named, child) in children.iter().enumerate() {
        let section = child.section();
        if instance && section == Some(Section::Temp) {
            continue;
        }
        if instance && last.is_some() && last != section {
            out.push(Field { name: String::new(), ty: DataType::Struct(Vec::new()), initial: None });
        }
        last = section;
        let mut ty = data_type(&child.ty, start);
        let initial = start.take(child, &ty);
        let pointer =
            section == Some(Section::InOut) && ty.is_composed() && !matches!(ty, DataType::Pointer | DataType::Any);
        if instance && pointer {
            ty = DataType::Pointer;
        }
        // The components of an instance are named as the function block's own interface names them.
        let name = match section.filter(|_| instance) {
            Some(section) => names.next(section),
            None => format!("X{named}"),
        };
        out.push(Field { name, ty, initial });
    }
    out
}

/// The entry of a type.
fn entry(ty: &DataType, section: Section, start: &mut Vec<u8>) -> Entry {
    let ty = match ty {
        DataType::String(length) => EntryType::String(*length),
        DataType::Array(dims, element) => EntryType::Array(
            dims.iter().map(|d| Dimension { low: d.low, high: d.high }).collect(),
            Box::new(entry(element, section, &mut Vec::new())),
        ),
        DataType::Struct(fields) => {
            let named = fields.iter().filter(|f| !f.name.is_empty());
            let child = |f: &Field| {
                let mut made = entry(&f.ty, section, start);
                if let Some(initial) = &f.initial
                    && packed(&f.ty, initial, start)
                {
                    made.attribute |= STARTS;
                }
                made
            };
            EntryType::Struct(named.map(child).collect())
        }
        DataType::TimerOrWord => EntryType::Simple(DataType::Word),
        simple => EntryType::Simple(simple.clone()),
    };
    Entry { ty, attribute: section_code(section), extra: 0 }
}
