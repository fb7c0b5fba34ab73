//! The parts of the station's program.

use ob1_access::Names;
use ob1_ir::Program;

use crate::shared::Trouble;

/// The program of a station, and the names of its cells. It does not change while the station runs.
#[derive(Clone, Debug, Default)]
pub(crate) struct Catalog {
    /// Blocks, data blocks with their declarations, symbols, names of the sources.
    pub(crate) program: Program,
    /// Finds a cell by name: `MW10`, `DB10.DBW0`, `DB10.Motor.Speed`, a symbol.
    pub(crate) names: Names,
}

impl Catalog {
    /// Reads the broker's document.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, Trouble> {
        let text = std::str::from_utf8(bytes).map_err(|error| Trouble::Program(error.to_string()))?;
        let program = ob1_ir::parse(text).map_err(|error| Trouble::Program(error.to_string()))?;
        Ok(Self { names: Names::new(&program), program })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_with_the_program() {
        let text =
            "symbol \"start\" \"E 0.0\" BOOL\ndata DB 7 \"TANK\" of FB 3\n  at \"level\" @0.0 INT\n  bytes 00FF\n";
        let catalog = Catalog::read(text.as_bytes()).expect("a program");
        assert_eq!(catalog.names.parse("TANK.level").expect("there").ty.name(), "INT");
        assert!(catalog.names.parse("start").is_ok());
        for wrong in [&b"data DB"[..], b"\xFF"] {
            assert!(matches!(Catalog::read(wrong), Err(Trouble::Program(_))));
        }
    }
}
