//! The table of all standard blocks.

use std::fmt;

use ob1_model::{BitAddr, BlockId, BlockKind, Interface};

use crate::call::Call;
use crate::declare::{self, Declared, Params};
use crate::{Context, Done, Service, handling, iec, pid, sfb, sfc, ti_s7};

/// The library a block comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// System functions: part of the CPU, their numbers are fixed and no station file lists them.
    System,
    /// "IEC Function Blocks": FC 1 to 40.
    Iec,
    /// "TI-S7 Converting Blocks".
    TiS7,
    /// "PID Control Blocks".
    Pid,
    /// The handling blocks of the CP 240: declared here, served by a plugin.
    Cp240,
    /// The handling blocks of the CP 341: declared here, served by a plugin.
    Cp341,
    /// The handling blocks of the CP 340: declared here, served by a plugin.
    Cp340,
    /// The handling blocks of the CP 040: declared here, served by a plugin.
    Cp040,
}

impl Origin {
    /// The name in a station file: `IEC:FC4`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Origin::System => "SYSTEM",
            Origin::Iec => "IEC",
            Origin::TiS7 => "TI-S7",
            Origin::Pid => "PID",
            Origin::Cp240 => "CP240",
            Origin::Cp341 => "CP341",
            Origin::Cp340 => "CP340",
            Origin::Cp040 => "CP040",
        }
    }

    /// Only names and parameters of its blocks are known here: a plugin has to serve them.
    #[must_use]
    pub const fn is_declared_only(self) -> bool {
        matches!(self, Origin::Cp240 | Origin::Cp341 | Origin::Cp340 | Origin::Cp040)
    }
}

/// A row of the table, made at compile time.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    origin: Origin,
    id: BlockId,
    name: &'static str,
    note: &'static str,
    needs: Option<Service>,
    declared: &'static [Declared],
    /// The addresses of an instance by byte and bit, and its length, where they do not follow from the declaration.
    places: Option<(&'static [(u32, u8)], u32)>,
    run: fn(&mut Call<'_>) -> Done,
}

impl Row {
    pub(crate) const fn new<P: Params>(
        origin: Origin,
        kind: BlockKind,
        number: u16,
        name: &'static str,
        run: fn(&mut Call<'_>) -> Done,
    ) -> Self {
        let id = BlockId::new(kind, number);
        Self { origin, id, name, note: "", needs: None, declared: P::DECLARED, places: None, run }
    }

    pub(crate) const fn sfc<P: Params>(number: u16, name: &'static str, run: fn(&mut Call<'_>) -> Done) -> Self {
        Self::new::<P>(Origin::System, BlockKind::Sfc, number, name, run)
    }

    pub(crate) const fn sfb<P: Params>(number: u16, name: &'static str, run: fn(&mut Call<'_>) -> Done) -> Self {
        Self::new::<P>(Origin::System, BlockKind::Sfb, number, name, run)
    }

    pub(crate) const fn needs(self, service: Service) -> Self {
        Self { needs: Some(service), ..self }
    }

    pub(crate) const fn places(self, places: &'static [(u32, u8)], bytes: u32) -> Self {
        Self { places: Some((places, bytes)), ..self }
    }

    pub(crate) const fn note(self, note: &'static str) -> Self {
        Self { note, ..self }
    }
}

/// A standard block: what it is called, takes and gives, and its function.
#[derive(Clone)]
pub struct StandardBlock {
    /// Where it comes from.
    pub origin: Origin,
    /// Kind and default number. Numbers of blocks that are not system functions are the user's.
    pub id: BlockId,
    /// Standard name.
    pub name: &'static str,
    /// What one should know of this implementation, for the documentation.
    pub note: &'static str,
    /// The service the CPU must have.
    pub needs: Option<Service>,
    /// Parameters with STEP 7's names and types, laid out.
    pub interface: Interface,
    run: fn(&mut Call<'_>) -> Done,
}

impl StandardBlock {
    fn of(row: &Row) -> Self {
        let &Row { origin, id, name, note, needs, declared, places, run } = row;
        let mut interface = declare::interface(declared, id.kind.has_instance());
        if let Some((places, bytes)) = places {
            let addresses: Vec<_> = places.iter().map(|(byte, bit)| BitAddr::new(*byte, *bit)).collect();
            interface.place_at(&addresses, bytes);
        }
        Self { origin, id, name, note, needs, interface, run }
    }

    /// Runs the block: a pure function of parameters, instance, time and what the context answers.
    ///
    /// # Errors
    /// The CPU goes to STOP, or lacks the service.
    pub fn run(&self, cx: &mut dyn Context) -> Done {
        (self.run)(&mut Call { cx, interface: &self.interface })
    }

    /// The name in a station file: `IEC:FC4`, `SYSTEM:SFC20`.
    #[must_use]
    pub fn key(&self) -> String {
        format!("{}:{}{}", self.origin.name(), self.id.kind.name(), self.id.number)
    }
}

impl fmt::Debug for StandardBlock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StandardBlock").field("key", &self.key()).field("name", &self.name).finish_non_exhaustive()
    }
}

fn rows() -> impl Iterator<Item = &'static Row> {
    [sfc::ROWS, sfb::ROWS, iec::ROWS, ti_s7::ROWS, pid::ROWS, handling::ROWS].into_iter().flatten().copied().flatten()
}

/// Every standard block: by library, kind and number in ascending order.
#[must_use]
pub fn standard_blocks() -> Vec<StandardBlock> {
    let mut blocks: Vec<_> = rows().map(StandardBlock::of).collect();
    blocks.sort_by_key(|block| (block.origin, block.id));
    blocks
}

/// The system functions (SFC, SFB) a CPU with these services has.
#[must_use]
pub fn system_functions(has: &[Service]) -> Vec<StandardBlock> {
    let offered = |block: &StandardBlock| {
        block.origin == Origin::System && block.needs.is_none_or(|service| has.contains(&service))
    };
    standard_blocks().into_iter().filter(offered).collect()
}

/// The system functions a CPU has whose only services are parameters, memory and modules.
#[must_use]
pub fn library() -> Vec<StandardBlock> {
    system_functions(&[])
}

/// A block by its name in a station file: `IEC:FC4`, `IEC:FC 4` or `IEC:DELETE`, without regard to case. `None` when
/// there is none.
#[must_use]
pub fn standard_block(key: &str) -> Option<StandardBlock> {
    let (origin, block) = key.split_once(':')?;
    let named = |row: &&Row| {
        let number = format!("{}{}", row.id.kind.name(), row.id.number);
        let wanted: String = block.split_whitespace().collect();
        row.origin.name().eq_ignore_ascii_case(origin.trim())
            && (number.eq_ignore_ascii_case(&wanted) || row.name.eq_ignore_ascii_case(&wanted))
    };
    rows().find(named).map(StandardBlock::of)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_unique_and_lead_back() {
        let blocks = standard_blocks();
        for pair in blocks.windows(2) {
            assert!((pair[0].origin, pair[0].id) < (pair[1].origin, pair[1].id), "{pair:?}");
        }
        for block in &blocks {
            let by_name = format!("{}:{}", block.origin.name(), block.name.to_ascii_lowercase());
            for key in [block.key(), by_name] {
                assert_eq!(standard_block(&key).map(|b| b.id), Some(block.id), "{key}");
            }
        }
        assert!(standard_block("IEC:FC41").is_none() && standard_block("FC4").is_none());
    }

    #[test]
    fn statics_come_last_and_initial_values_fit() {
        for block in standard_blocks() {
            let statics = block.interface.params.iter().skip_while(|p| p.section != ob1_model::Section::Static);
            assert!(statics.clone().all(|p| p.section == ob1_model::Section::Static), "{block:?}");
            assert!(statics.count() == 0 || block.id.kind.has_instance(), "{block:?}");
            for param in &block.interface.params {
                if let Some(initial) = &param.initial {
                    let bits = ob1_model::Layout::bits(&param.ty) as usize;
                    assert_eq!(initial.len(), bits.div_ceil(8), "{block:?} {}", param.name);
                }
            }
        }
    }

    #[test]
    fn a_cpu_offers_what_it_has_the_services_for() {
        let offers = |blocks: &[StandardBlock], name: &str| blocks.iter().any(|block| block.name == name);
        let (few, more) = (library(), system_functions(&[Service::WallClock]));
        assert!(offers(&few, "BLKMOV") && !offers(&few, "READ_CLK") && !offers(&few, "CONCAT"));
        assert!(offers(&more, "BLKMOV") && offers(&more, "READ_CLK") && !offers(&more, "SRT_DINT"));
    }

    #[test]
    fn instances_are_laid_out_as_in_step_7() {
        for (key, name, at) in [
            ("SYSTEM:CTU", "CUO", "8.0"),
            ("SYSTEM:CTUD", "CV", "6.0"),
            ("SYSTEM:TON", "ET", "8.0"),
            ("SYSTEM:TON", "ATIME", "18.0"),
            ("SYSTEM:DRUM", "OUT0", "4.0"),
            ("SYSTEM:RDREC", "STATUS", "12.0"),
            ("SYSTEM:RDREC", "RECORD", "18.0"),
        ] {
            assert_eq!(crate::testing::Fake::new(key).at(name), at, "{key} {name}");
        }
    }

    /// `docs/standard-blocks.md` holds exactly the rows made here.
    #[test]
    fn the_documentation_lists_what_there_is() {
        let document = include_str!("../../../docs/standard-blocks.md");
        let mut table = String::from("| Block | Name | Key | Notes |\n|---|---|---|---|\n");
        for block in standard_blocks() {
            let mut note = block.note.to_owned();
            if let Some(service) = block.needs {
                note = format!("{note}{}needs `{service:?}`", if note.is_empty() { "" } else { "; " });
            }
            table.push_str(&format!("| {} | {} | `{}` | {note} |\n", block.id, block.name, block.key()));
        }
        assert!(document.contains(&table), "the table to put into docs/standard-blocks.md:\n{table}");
    }
}
