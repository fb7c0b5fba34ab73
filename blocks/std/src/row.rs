//! A standard block as a row: what a module of blocks declares of each, and the block that is made of it.

use std::fmt;

use ob1_model::{BitAddr, BlockId, BlockKind, Interface, Section, named};

use crate::call::{Call, Code};
use crate::declare::{self, At, Declared, Params};
use crate::{Context, Done};

named! {
    /// The library a block comes from, named as in a station file: `IEC:FC4`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Origin {
        /// System functions: part of the CPU, their numbers are fixed and no station file lists them.
        System = "SYSTEM",
        /// "IEC Function Blocks": FC 1 to 40.
        Iec = "IEC",
        /// The library "TI-S7 Converting Blocks".
        TiS7 = "TI-S7",
        /// The library "PID Control Blocks".
        Pid = "PID",
        /// The handling blocks of the CP 240: declared here, served by a plugin.
        Cp240 = "CP240",
        /// The handling blocks of the CP 341: declared here, served by a plugin.
        Cp341 = "CP341",
        /// The handling blocks of the CP 340: declared here, served by a plugin.
        Cp340 = "CP340",
        /// The handling blocks of the CP 040: declared here, served by a plugin.
        Cp040 = "CP040",
        /// The handling blocks of the CP 342-5: declared here, served by a plugin.
        Cp342 = "CP342",
        /// The handling blocks of the CP 343 (library CP 300): declared here, served by a plugin.
        Cp300 = "CP300",
        /// The system blocks of an S7-400 for S7 communication: declared here, served by the plugin of the CP 343.
        S7_400 = "S7-400",
    }
}

impl Origin {
    /// The plugin that serves its blocks, as a station file names it; none: the CPU does.
    pub const fn plugin(self) -> Option<&'static str> {
        match self {
            Origin::System | Origin::Iec | Origin::TiS7 | Origin::Pid => None,
            Origin::Cp240 => Some("ob1_cp240"),
            Origin::Cp341 => Some("ob1_cp341"),
            Origin::Cp340 => Some("ob1_cp340"),
            Origin::Cp040 => Some("ob1_cp040"),
            Origin::Cp342 => Some("ob1_cp342"),
            Origin::Cp300 | Origin::S7_400 => Some("ob1_cp343"),
        }
    }

    /// Only names and parameters of its blocks are known here: a plugin has to serve them.
    pub const fn is_declared_only(self) -> bool {
        self.plugin().is_some()
    }
}

/// What the function of a block does.
#[derive(Clone, Copy)]
enum Run {
    /// All of it.
    Whole(fn(&mut Call<'_>) -> Done),
    /// All but RET_VAL (of some function blocks ERR_CODE) and BR, which its code gives.
    Coded(fn(&mut Call<'_>) -> Code),
    /// The same, for a block that is asked by REQ and answers in the same call, so that BUSY stays 0.
    Asked(fn(&mut Call<'_>) -> Code),
}

/// REQ is 0 and no job is under way.
const NO_JOB: u16 = 0x7000;

/// A row of the table, made at compile time.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    pub(crate) origin: Origin,
    pub(crate) id: BlockId,
    pub(crate) name: &'static str,
    note: &'static str,
    declared: &'static [Declared],
    /// The addresses of an instance by byte and bit, and its length, where they do not follow from the declaration.
    places: Option<(&'static [(u32, u8)], u32)>,
    run: Run,
}

impl Row {
    pub(crate) const fn new<P: Params>(
        origin: Origin,
        kind: BlockKind,
        number: u16,
        name: &'static str,
        run: fn(&mut Call<'_>) -> Done,
    ) -> Self {
        Self::of::<P>(origin, BlockId::new(kind, number), name, Run::Whole(run))
    }

    const fn of<P: Params>(origin: Origin, id: BlockId, name: &'static str, run: Run) -> Self {
        Self { origin, id, name, note: "", declared: P::DECLARED, places: None, run }
    }

    /// A system function without RET_VAL, or whose RET_VAL is no code.
    pub(crate) const fn sfc<P: Params>(number: u16, name: &'static str, run: fn(&mut Call<'_>) -> Done) -> Self {
        Self::new::<P>(Origin::System, BlockKind::Sfc, number, name, run)
    }

    /// A block that ends with RET_VAL or ERR_CODE.
    pub(crate) const fn with_code<P: Params>(
        origin: Origin,
        kind: BlockKind,
        number: u16,
        name: &'static str,
        run: fn(&mut Call<'_>) -> Code,
    ) -> Self {
        Self::of::<P>(origin, BlockId::new(kind, number), name, Run::Coded(run))
    }

    /// The same of the TI library.
    pub(crate) const fn ti<P: Params>(
        kind: BlockKind,
        number: u16,
        name: &'static str,
        run: fn(&mut Call<'_>) -> Code,
    ) -> Self {
        Self::with_code::<P>(Origin::TiS7, kind, number, name, run)
    }

    /// A system function that ends with RET_VAL.
    pub(crate) const fn coded<P: Params>(number: u16, name: &'static str, run: fn(&mut Call<'_>) -> Code) -> Self {
        Self::with_code::<P>(Origin::System, BlockKind::Sfc, number, name, run)
    }

    /// A system function that is asked by REQ, its first parameter, and answers in the same call.
    pub(crate) const fn asked<P: Params>(number: u16, name: &'static str, run: fn(&mut Call<'_>) -> Code) -> Self {
        Self::of::<P>(Origin::System, BlockId::new(BlockKind::Sfc, number), name, Run::Asked(run))
    }

    pub(crate) const fn sfb<P: Params>(number: u16, name: &'static str, run: fn(&mut Call<'_>) -> Done) -> Self {
        Self::new::<P>(Origin::System, BlockKind::Sfb, number, name, run)
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
    /// Standard name, as the manual prints it.
    pub name: &'static str,
    /// What one should know of this implementation, for the documentation.
    pub note: &'static str,
    /// Parameters with STEP 7's names and types, laid out.
    pub interface: Interface,
    run: Run,
    /// RET_VAL or ERR_CODE, and BUSY, of blocks whose code sets them.
    ret_val: At,
    busy: At,
}

impl StandardBlock {
    pub(crate) fn of(row: &Row) -> Self {
        let &Row { origin, id, name, note, declared, places, run } = row;
        let mut interface = declare::interface(declared, id.kind.has_instance());
        if let Some((places, bytes)) = places {
            let addresses: Vec<_> = places.iter().map(|(byte, bit)| BitAddr::new(*byte, *bit)).collect();
            interface.place_at(&addresses, bytes);
        }
        let at = |found: fn(&Declared) -> bool| At(declared.iter().position(found).unwrap_or_default() as u32);
        let (ret_val, busy) = (at(|d| d.section == Section::Return || d.name == "ERR_CODE"), at(|d| d.name == "BUSY"));
        Self { origin, id, name, note, interface, run, ret_val, busy }
    }

    /// Runs the block: a pure function of parameters, instance, time and what the context answers.
    ///
    /// # Errors
    /// The CPU goes to STOP.
    pub fn run(&self, cx: &mut dyn Context) -> Done {
        let call = &mut Call { cx, interface: &self.interface };
        let code = match self.run {
            Run::Whole(run) => return run(call),
            Run::Coded(run) => run(call),
            Run::Asked(run) => {
                let code = if call.bool(At(0)) { run(call) } else { Ok(NO_JOB) };
                call.set_bool(self.busy, false);
                code
            }
        };
        let (Ok(value) | Err(value)) = code;
        // RET_VAL of a system function has its highest bit where BR is 0.
        debug_assert!(self.origin != Origin::System || code.is_ok() == (value & 0x8000 == 0), "{self:?}: {code:04X?}");
        call.set(self.ret_val, u32::from(value));
        call.br(code.is_ok())
    }

    /// The name in a station file: `IEC:FC4`, `SYSTEM:SFC20`.
    pub fn key(&self) -> String {
        format!("{}:{}{}", self.origin.name(), self.id.kind.name(), self.id.number)
    }
}

impl fmt::Debug for StandardBlock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("StandardBlock").field("key", &self.key()).field("name", &self.name).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_has_a_parameter() {
        let mut with_code = 0;
        for block in crate::standard_blocks() {
            let name = |at: At| block.interface.formals().nth(at.0 as usize).map(|formal| formal.name.as_str());
            match block.run {
                Run::Whole(_) => continue,
                Run::Coded(_) => {}
                Run::Asked(_) => assert_eq!((name(At(0)), name(block.busy)), (Some("REQ"), Some("BUSY")), "{block:?}"),
            }
            with_code += 1;
            assert!(matches!(name(block.ret_val), Some("RET_VAL" | "ERR_CODE")), "{block:?}");
        }
        assert!(with_code > 50, "{with_code}");
    }
}
