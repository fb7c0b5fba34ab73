//! The table of all standard blocks: the rows of every module, and what is looked up in them.

use crate::row::{Origin, Row, StandardBlock};
use crate::{handling, iec, pid, sfb, sfc, ti_s7};

pub(crate) fn rows() -> impl Iterator<Item = &'static Row> {
    [sfc::ROWS, sfb::ROWS, iec::ROWS, ti_s7::ROWS, pid::ROWS, handling::ROWS].into_iter().flatten().copied().flatten()
}

/// Every standard block: by library, kind and number in ascending order.
pub fn standard_blocks() -> Vec<StandardBlock> {
    let mut blocks: Vec<_> = rows().map(StandardBlock::of).collect();
    blocks.sort_by_key(|block| (block.origin, block.id));
    blocks
}

/// The system functions (SFC, SFB) of a CPU.
pub fn system_functions() -> Vec<StandardBlock> {
    rows().filter(|row| row.origin == Origin::System).map(StandardBlock::of).collect()
}

/// A block by its name in a station file: `IEC:FC4`, `IEC:FC 4` or `IEC:DELETE`, without regard to case. `None` when
/// there is none.
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
    fn a_cpu_offers_its_system_functions_and_no_library() {
        let blocks = system_functions();
        let offers = |name: &str| blocks.iter().any(|block| block.name == name);
        assert!(offers("BLKMOV") && offers("READ_CLK") && offers("SRT_DINT") && !offers("CONCAT"));
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
            assert_eq!(crate::tests::Fake::new(key).at(name), at, "{key} {name}");
        }
    }

    /// `docs/standard-blocks.md` holds exactly the rows made here.
    #[test]
    fn the_documentation_lists_what_there_is() {
        let document = include_str!("../../../docs/standard-blocks.md");
        let mut table = String::from("| Block | Name | Key | Notes |\n|---|---|---|---|\n");
        for block in standard_blocks() {
            table.push_str(&format!("| {} | {} | `{}` | {} |\n", block.id, block.name, block.key(), block.note));
        }
        assert!(document.contains(&table), "the table to put into docs/standard-blocks.md:\n{table}");
    }
}
