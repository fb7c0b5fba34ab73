//! The nodes of namespace 2: found by their identifiers and derived from the catalog on request. Nothing of the plant
//! is copied into a table of nodes.

use ob1_access::door::Command;
use ob1_access::{Allowed, Names, Typed};
use ob1_model::{Area, Cell, DataType, Layout};

/// The object of the station, below Objects.
pub(crate) const ROOT: &str = "/";

/// How many bytes, timers and counters a CPU has.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sizes {
    pub(crate) inputs: u32,
    pub(crate) outputs: u32,
    pub(crate) memory: u32,
    pub(crate) timers: u16,
    pub(crate) counters: u16,
}

/// The address space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Space<'a> {
    pub(crate) names: &'a Names,
    pub(crate) sizes: Sizes,
    pub(crate) allowed: &'a Allowed,
}

/// A folder of the station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Folder {
    Inputs,
    Outputs,
    Memory,
    Timers,
    Counters,
    Blocks,
    Symbols,
}

/// Folders by identifier.
const FOLDERS: [(&str, Folder); 7] = [
    ("/Inputs", Folder::Inputs),
    ("/Outputs", Folder::Outputs),
    ("/Memory", Folder::Memory),
    ("/Timers", Folder::Timers),
    ("/Counters", Folder::Counters),
    ("/DataBlocks", Folder::Blocks),
    ("/Symbols", Folder::Symbols),
];

/// A variable about the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fact {
    /// STOP, STARTUP, RUN.
    State,
    /// The number of the newest scan.
    Scan,
}

pub(crate) const FACTS: [(&str, Fact); 2] = [("/State", Fact::State), ("/Scan", Fact::Scan)];

/// Methods by identifier: the command, and its description.
pub(crate) const METHODS: [(&str, Command, &str); 6] = [
    ("/Start", Command::Run, "RUN, by the kind of restart that is due"),
    ("/Stop", Command::Stop, "STOP"),
    ("/WarmRestart", Command::Warm, "warm restart"),
    ("/ColdRestart", Command::Cold, "cold restart: retentive data is lost"),
    ("/HotRestart", Command::Hot, "hot restart, of an S7-400"),
    ("/MemoryReset", Command::Reset, "memory reset, in STOP"),
];

/// A node.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Node {
    Root,
    Folder(Folder),
    Fact(Fact),
    /// A row of [`METHODS`].
    Method(usize),
    /// A data block of the catalog, by its place there.
    Block(usize),
    /// A structure, or an array whose elements have no value as a whole.
    Composed(Typed),
    Value(Typed),
}

impl Space<'_> {
    /// The node of an identifier.
    pub(crate) fn find(&self, id: &str) -> Option<Node> {
        if id.starts_with('/') {
            if id == ROOT {
                return Some(Node::Root);
            }
            let folder = FOLDERS.iter().find(|(name, _)| *name == id).map(|(_, folder)| Node::Folder(*folder));
            let fact = || FACTS.iter().find(|(name, _)| *name == id).map(|(_, fact)| Node::Fact(*fact));
            let method = || METHODS.iter().position(|(name, ..)| *name == id).map(Node::Method);
            return folder.or_else(fact).or_else(method);
        }
        match self.names.typed(id) {
            Ok(typed) => {
                let there = self.exists(&typed) && self.allowed.has(typed.cell);
                there.then(|| if typed.has_value() { Node::Value(typed) } else { Node::Composed(typed) })
            }
            Err(_) => self.block(id).map(Node::Block),
        }
    }

    /// The data block `DB10`, or of that name, when it has declarations.
    fn block(&self, id: &str) -> Option<usize> {
        let bare = id.trim().trim_matches('"');
        let number = bare.get(..2).filter(|kind| kind.eq_ignore_ascii_case("DB")).and_then(|_| bare[2..].parse().ok());
        let blocks = self.names.blocks();
        let place = blocks.iter().position(|block| {
            Some(block.number) == number || block.name.as_deref().is_some_and(|name| name.eq_ignore_ascii_case(bare))
        })?;
        self.allowed.has(Cell::Db(blocks[place].number, 0)).then_some(place)
    }

    /// Whether the CPU has the cell; for a data block that the program creates, only reading it tells.
    fn exists(&self, typed: &Typed) -> bool {
        let ends = |bytes: u32| typed.cell.bit() + Layout::bits(&typed.ty) <= bytes * 8;
        match typed.cell {
            Cell::Area(Area::Input, _) => ends(self.sizes.inputs),
            Cell::Area(Area::Output, _) => ends(self.sizes.outputs),
            Cell::Area(Area::Memory, _) => ends(self.sizes.memory),
            Cell::Area(..) => false,
            Cell::Timer(number) => number < self.sizes.timers,
            Cell::Counter(number) => number < self.sizes.counters,
            Cell::Db(number, _) => {
                self.names.blocks().iter().find(|block| block.number == number).is_none_or(|block| ends(block.bytes))
            }
            Cell::Peripheral(_) => true,
        }
    }

    /// Whether the program allows writing a value.
    pub(crate) fn writable(&self, typed: &Typed) -> bool {
        let read_only = match typed.cell {
            Cell::Db(number, _) => self.names.blocks().iter().any(|block| block.number == number && block.read_only),
            _ => false,
        };
        !read_only && !matches!(typed.ty, DataType::Pointer | DataType::Any)
    }

    /// The identifiers of a node's children.
    pub(crate) fn children(&self, id: &str, node: &Node) -> Vec<String> {
        let allowed = |cell: Cell| self.allowed.has(cell);
        let bytes = |letter: &str, area: Area, count: u32| match allowed(Cell::Area(area, 0)) {
            true => (0..count).map(|byte| format!("{letter}B{byte}")).collect(),
            false => Vec::new(),
        };
        match node {
            Node::Root => {
                let own = FOLDERS.iter().map(|(id, _)| *id).chain(FACTS.iter().map(|(id, _)| *id));
                own.chain(METHODS.iter().map(|(id, ..)| *id)).map(str::to_owned).collect()
            }
            Node::Folder(Folder::Inputs) => bytes("I", Area::Input, self.sizes.inputs),
            Node::Folder(Folder::Outputs) => bytes("Q", Area::Output, self.sizes.outputs),
            Node::Folder(Folder::Memory) => bytes("M", Area::Memory, self.sizes.memory),
            Node::Folder(Folder::Timers) => {
                (0..self.sizes.timers).filter(|n| allowed(Cell::Timer(*n))).map(|n| format!("T{n}")).collect()
            }
            Node::Folder(Folder::Counters) => {
                (0..self.sizes.counters).filter(|n| allowed(Cell::Counter(*n))).map(|n| format!("C{n}")).collect()
            }
            Node::Folder(Folder::Blocks) => {
                let numbers = self.names.blocks().iter().map(|block| block.number);
                numbers.filter(|number| allowed(Cell::Db(*number, 0))).map(|number| format!("DB{number}")).collect()
            }
            Node::Folder(Folder::Symbols) => {
                let ids = self.names.symbols().iter().map(|symbol| format!("\"{}\"", symbol.name));
                // Symbols of blocks and of missing places do not name a value.
                ids.filter(|id| matches!(self.find(id), Some(Node::Value(_)))).collect()
            }
            Node::Block(place) => {
                let Some(block) = self.names.blocks().get(*place) else { return Vec::new() };
                block.components.iter().map(|component| format!("DB{}.{}", block.number, component.path)).collect()
            }
            Node::Composed(typed) => match &typed.ty {
                DataType::Struct(fields) => fields.iter().map(|field| format!("{id}.{}", field.name)).collect(),
                DataType::Array(dims, _) => {
                    let count: u32 = dims.iter().map(|dim| dim.len()).product();
                    (0..count).map(|flat| format!("{id}{}", Layout::index_text(dims, flat))).collect()
                }
                _ => Vec::new(),
            },
            // The bits of a byte of an area, listed there.
            Node::Value(typed) => {
                match (typed.cell, &typed.ty, id.strip_suffix(|c: char| c.is_ascii_digit()).is_some()) {
                    (Cell::Area(..), DataType::Byte, true) => {
                        let letter = id.get(..1).unwrap_or_default();
                        (0..8).map(|bit| format!("{letter}{}.{bit}", typed.cell.byte())).collect()
                    }
                    _ => Vec::new(),
                }
            }
            Node::Fact(_) | Node::Method(_) => Vec::new(),
        }
    }

    /// The identifier of a node's parent; `None` for the root.
    pub(crate) fn parent(&self, id: &str, node: &Node) -> Option<String> {
        let place = match node {
            Node::Root => return None,
            Node::Folder(_) | Node::Fact(_) | Node::Method(_) => return Some(ROOT.to_owned()),
            Node::Block(_) => return Some("/DataBlocks".to_owned()),
            Node::Composed(typed) | Node::Value(typed) => typed.cell,
        };
        if id.starts_with('"') {
            return Some("/Symbols".to_owned());
        }
        let bit = matches!(node, Node::Value(typed) if typed.ty == DataType::Bool);
        let folder = |letter: &str, folder: &str| match bit {
            true => format!("{letter}B{}", place.byte()),
            false => folder.to_owned(),
        };
        Some(match place {
            Cell::Area(Area::Input, _) => folder("I", "/Inputs"),
            Cell::Area(Area::Output, _) => folder("Q", "/Outputs"),
            Cell::Area(..) => folder("M", "/Memory"),
            Cell::Timer(_) => "/Timers".to_owned(),
            Cell::Counter(_) => "/Counters".to_owned(),
            Cell::Peripheral(_) => ROOT.to_owned(),
            Cell::Db(number, _) => {
                let end = if id.ends_with(']') { id.rfind('[') } else { id.rfind('.') };
                match end.map(|end| &id[..end]).filter(|_| !absolute(id)) {
                    Some(above) if above.contains('.') => above.to_owned(),
                    _ => format!("DB{number}"),
                }
            }
        })
    }

    /// The name of a node in its folder.
    pub(crate) fn browse_name(&self, id: &str, node: &Node) -> String {
        match node {
            Node::Root => "Station".to_owned(),
            Node::Folder(_) | Node::Fact(_) | Node::Method(_) => id.trim_start_matches('/').to_owned(),
            Node::Block(place) => match self.names.blocks().get(*place) {
                Some(block) => format!("DB{}", block.number),
                None => id.to_owned(),
            },
            Node::Composed(typed) | Node::Value(typed) => match typed.cell {
                _ if id.starts_with('"') => id.trim_matches('"').to_owned(),
                // `DB10.a[1]` is `[1]` of `a`; `DB10.DBX0.1` is a separate name.
                Cell::Db(..) if id.ends_with(']') => id[id.rfind('[').unwrap_or(0)..].to_owned(),
                Cell::Db(..) => {
                    let rest = id.split_once('.').map_or(id, |(_, rest)| rest);
                    match rest.rfind('.') {
                        Some(end) if !absolute(id) => rest[end + 1..].to_owned(),
                        _ => rest.to_owned(),
                    }
                }
                _ => id.to_owned(),
            },
        }
    }

    /// The STEP 7 type of a node as text: `ARRAY [1..3] OF INT`.
    pub(crate) fn description(&self, node: &Node) -> String {
        match node {
            Node::Composed(typed) | Node::Value(typed) => declared(&typed.ty),
            Node::Block(place) => {
                self.names.blocks().get(*place).and_then(|block| block.name.clone()).unwrap_or_default()
            }
            Node::Method(row) => METHODS.get(*row).map_or_else(String::new, |(.., text)| (*text).to_owned()),
            Node::Root | Node::Folder(_) | Node::Fact(_) => String::new(),
        }
    }
}

/// Whether this names a bit by its address, `DB10.DBX1.2`: its point does not separate components.
fn absolute(id: &str) -> bool {
    let rest = id.split_once('.').map_or("", |(_, rest)| rest);
    rest.get(..3).is_some_and(|start| start.eq_ignore_ascii_case("DBX"))
}

/// A type as it is declared, a structure without its components.
fn declared(ty: &DataType) -> String {
    match ty {
        DataType::String(most) => format!("STRING[{most}]"),
        DataType::Array(dims, element) => {
            let dims: Vec<String> = dims.iter().map(|dim| format!("{}..{}", dim.low, dim.high)).collect();
            format!("ARRAY [{}] OF {}", dims.join(", "), declared(element))
        }
        other => other.name().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_access::NamedBlock;
    use ob1_ir::Symbol;
    use ob1_model::{BitAddr, Component, Dimension, Field};

    fn names() -> Names {
        let field = |name: &str, ty| Field { name: name.into(), ty, initial: None };
        let motor = DataType::Struct(vec![field("Speed", DataType::Int), field("Name", DataType::String(10))]);
        let axes = DataType::Array(vec![Dimension { low: 1, high: 2 }], Box::new(motor.clone()));
        let ramp = DataType::Array(vec![Dimension { low: 0, high: 3 }], Box::new(DataType::Real));
        let component = |path: &str, ty, at| Component { path: path.into(), ty, at: BitAddr(at) };
        let components = vec![component("Motor", motor, 0), component("Axes", axes, 112), component("Ramp", ramp, 336)];
        let block = NamedBlock { number: 10, name: Some("Press".into()), components, bytes: 58, read_only: false };
        let symbol =
            |name: &str, address: &str| Symbol { name: name.into(), address: address.into(), ..Symbol::default() };
        Names::of(vec![block], vec![symbol("Start", "E 0.0"), symbol("Press", "DB 10"), symbol("Far", "M 999.0")])
    }

    const SIZES: Sizes = Sizes { inputs: 2, outputs: 2, memory: 20, timers: 4, counters: 2 };

    /// Every node found by browsing is found again by its identifier, and its parent lists it.
    #[test]
    fn the_tree_is_whole() {
        let (names, allowed) = (names(), Allowed::default());
        let space = Space { names: &names, sizes: SIZES, allowed: &allowed };
        let mut waiting = vec![(ROOT.to_owned(), Node::Root)];
        let mut ids = Vec::new();
        while let Some((id, node)) = waiting.pop() {
            for child in space.children(&id, &node) {
                let found = space.find(&child).unwrap_or_else(|| panic!("{child}"));
                assert_eq!(space.parent(&child, &found).as_deref(), Some(id.as_str()), "{child}");
                assert!(!space.browse_name(&child, &found).is_empty(), "{child}");
                ids.push(child.clone());
                waiting.push((child, found));
            }
        }
        for wanted in
            ["/DataBlocks", "DB10", "DB10.Motor.Speed", "DB10.Axes[2].Name", "DB10.Ramp", "\"Start\"", "MB19", "M19.7"]
        {
            assert!(ids.iter().any(|id| id == wanted), "{wanted}: {ids:?}");
        }
        assert!(!ids.iter().any(|id| id == "\"Far\"" || id == "\"Press\"" || id == "MB20"), "{ids:?}");
        let names: std::collections::BTreeSet<&String> = ids.iter().collect();
        assert_eq!(names.len(), ids.len(), "no identifier twice");
    }

    #[test]
    fn identifiers_are_the_names_of_the_tools() {
        let (names, allowed) = (names(), Allowed::default());
        let space = Space { names: &names, sizes: SIZES, allowed: &allowed };
        for (id, name) in [
            ("MW10", "MW10"),
            ("DB10.DBW0", "DBW0"),
            ("DB10.DBX1.2", "DBX1.2"),
            ("Press.Motor.Speed", "Speed"),
            ("DB10.Ramp[2]", "[2]"),
            ("\"Start\"", "Start"),
            ("T3", "T3"),
            ("C1", "C1"),
            ("PIW256", "PIW256"),
        ] {
            let node = space.find(id).unwrap_or_else(|| panic!("{id}"));
            assert!(matches!(node, Node::Value(_)), "{id}: {node:?}");
            assert_eq!(space.browse_name(id, &node), name);
        }
        for id in
            ["", "/", "//", "MW19", "T4", "C2", "DB10.DBW58", "DB10.Nothing", "DB11", "DB10.Axes[3]", "X", "ä", "\""]
        {
            assert!(!matches!(space.find(id), Some(Node::Value(_))), "{id}");
        }
    }

    #[test]
    fn what_the_link_may_not_touch_is_not_there() {
        let names = names();
        let allowed = Allowed::of(Some(&["M".to_owned()]), None).expect("right");
        let space = Space { names: &names, sizes: SIZES, allowed: &allowed };
        assert!(space.find("MW10").is_some());
        for id in ["DB10", "DB10.Motor.Speed", "IB0", "\"Start\"", "T0"] {
            assert_eq!(space.find(id), None, "{id}");
        }
        assert_eq!(space.children("/DataBlocks", &Node::Folder(Folder::Blocks)), Vec::<String>::new());
        assert_eq!(space.children("/Inputs", &Node::Folder(Folder::Inputs)), Vec::<String>::new());
    }
}
