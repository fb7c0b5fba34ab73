//! What 0 means as the value of a time or of a number of attempts: the one table, for every CP. For users:
//! `docs/serial-couplings.md`.
//!
//! A time that is watched on the line cannot be 0: there 0 stands for some character times, or for no watch. A CP 340
//! and a CP 341 have lower limits above 0 for such times, and attempts from 1.

use crate::module_types::CpKind;

/// What the value 0 of a parameter means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Zero {
    /// As many character times.
    Characters(u64),
    /// No pause is kept.
    NoPause,
    /// The time is not watched.
    Unwatched,
    /// It is computed from the baud rate.
    Computed,
    /// One attempt, without repetitions.
    OneAttempt,
    /// The parameter has no meaning with this CP.
    Nothing,
}

/// What 0 means for this key of `params`; `None`: it is a number like others, or not allowed.
pub fn zero_of(kind: CpKind, key: &str) -> Option<Zero> {
    use CpKind::{Cp040, Cp240, Cp340, Cp341};
    Some(match (kind, key) {
        // "about double character time" [S0 L2014]
        (Cp240, "zvz_ms") => Zero::Characters(2),
        // The manual has the range 0..255 and no meaning [S0 L2022]. At once would let every connection fail: as ZVZ,
        // because the CP 040 has the same 0 for both (decision 20).
        (Cp240, "qvz_ms") => Zero::Characters(2),
        // No meaning in the manual [S0 L2023]; the 5 s of the reaction [S0 L1678] stay (decision 20).
        (Cp240, "bwz_ms") => Zero::Unwatched,
        // "with 0 triple character time is used": ZVZ of ASCII [S3 L303], ZVZ and QVZ of 3964(R) [S3 L305]. TMO has
        // the range 0..65535 (HB300 p. 66) and no meaning: as ZVZ (decision 20).
        (Cp040, "zvz_ms" | "qvz_ms" | "tmo_ms") => Zero::Characters(3),
        // There is no RK 512.
        (Cp040, "bwz_ms") => Zero::Nothing,
        // [S0 L2013]
        (Cp240 | Cp040, "zna_ms") => Zero::NoPause,
        // "With 0 the delay time is evaluated automatically" [S0 L2171]
        (Cp240 | Cp040, "wait_ms") => Zero::Computed,
        (Cp240 | Cp040, "stx_repetitions" | "dbl") => Zero::OneAttempt,
        (Cp340 | Cp341, "turnaround_ms" | "rts_off_ms" | "output_wait_ms") => Zero::NoPause,
        _ => return None,
    })
}

/// Character times that stand for a time of 0; 0 if it is not such a time.
pub fn characters(kind: CpKind, key: &str) -> u64 {
    match zero_of(kind, key) {
        Some(Zero::Characters(characters)) => characters,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cp040::table::CP040;
    use crate::cp240_table::{CP240, Kind};
    use crate::cp341::protocols_of;
    use crate::keyed::Kind341;

    /// Every time and every number of attempts that may be 0 has its row, and every row such a parameter.
    #[test]
    fn the_table_is_complete() {
        let is_such = |key: &str| key.ends_with("_ms") || matches!(key, "stx_repetitions" | "dbl");
        for (kind, tables) in [(CpKind::Cp240, CP240), (CpKind::Cp040, CP040)] {
            for (protocol, _, layout) in tables.protocols {
                for field in (tables.fields)(*layout) {
                    let zero = match field.kind {
                        Kind::Choice(_) => false,
                        Kind::Number { min, .. } | Kind::Ticks { min } => min == 0,
                    };
                    let expected = zero && is_such(field.key);
                    assert_eq!(zero_of(kind, field.key).is_some(), expected, "{kind:?} {protocol} {}", field.key);
                }
            }
        }
        for kind in [CpKind::Cp340, CpKind::Cp341] {
            for row in protocols_of(kind).iter().flat_map(|(_, tables)| *tables).flat_map(|table| *table) {
                let zero = matches!(row.kind, Kind341::Number { min: 0, .. });
                assert_eq!(zero_of(kind, row.key).is_some(), zero && is_such(row.key), "{kind:?} {}", row.key);
            }
        }
    }
}
