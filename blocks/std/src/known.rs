//! The system functions of STEP 7 by name, including those we lack: a call of one of these is reported by its name.

use ob1_model::{BlockId, BlockKind};

use crate::table::rows;

/// Numbers and names of the SFCs we lack, ascending.
const SFC: &[(u16, &str)] = &[
    (7, "DP_PRAL"),
    (25, "COMPRESS"),
    (35, "MP_ALM"),
    (48, "SNC_RTCB"),
    (54, "RD_DPARM"),
    (60, "GD_SND"),
    (61, "GD_RCV"),
    (63, "AB_CALL"),
    (65, "X_SEND"),
    (66, "X_RCV"),
    (67, "X_GET"),
    (68, "X_PUT"),
    (69, "X_ABORT"),
    (85, "CREA_DB"),
    (87, "C_DIAG"),
    (90, "H_CTRL"),
    (99, "WWW"),
    (102, "RD_DPARA"),
    (103, "DP_TOPOL"),
    (104, "CIR"),
    (109, "PROTECT"),
    (112, "PN_IN"),
    (113, "PN_OUT"),
    (114, "PN_DP"),
    (126, "SYNC_PI"),
    (127, "SYNC_PO"),
];

/// Numbers and names of the SFBs we lack, ascending.
const SFB: &[(u16, &str)] = &[
    (16, "PRINT"),
    (19, "START"),
    (20, "STOP"),
    (21, "RESUME"),
    (22, "STATUS"),
    (23, "USTATUS"),
    (29, "HS_COUNT"),
    (30, "FREQ_MES"),
    (38, "HSC_A_B"),
    (39, "POS"),
    (44, "ANALOG"),
    (46, "DIGITAL"),
    (47, "COUNT"),
    (48, "FREQUENC"),
    (49, "PULSE"),
    (60, "SEND_PTP"),
    (61, "RCV_PTP"),
    (62, "RES_RCVB"),
    (63, "SEND_RK"),
    (64, "FETCH_RK"),
    (65, "SERVE_RK"),
    (73, "RCVREC"),
    (74, "PRVREC"),
    (75, "SALRM"),
    (81, "RD_DPAR"),
    (104, "IP_CONF"),
];

/// STEP 7's name of an SFC or SFB, whether it is here or not; `None` for other blocks and numbers STEP 7 does not use.
pub fn known_system_function(id: BlockId) -> Option<&'static str> {
    let lacking = match id.kind {
        BlockKind::Sfc => SFC,
        BlockKind::Sfb => SFB,
        _ => return None,
    };
    let ours = rows().find(|row| row.id == id).map(|row| row.name);
    ours.or_else(|| lacking.iter().find(|(number, _)| *number == id.number).map(|(_, name)| *name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Origin, standard_blocks};

    #[test]
    fn the_names_are_sorted_and_those_of_the_table() {
        for (kind, names) in [(BlockKind::Sfc, SFC), (BlockKind::Sfb, SFB)] {
            assert!(names.windows(2).all(|pair| pair[0].0 < pair[1].0));
            assert!(names.iter().all(|(number, _)| rows().all(|row| row.id != BlockId::new(kind, *number))));
        }
        for block in standard_blocks().iter().filter(|b| b.origin == Origin::System) {
            assert_eq!(known_system_function(block.id), Some(block.name), "{}", block.id);
        }
        assert_eq!(known_system_function(BlockId::new(BlockKind::Sfc, 5)), Some("GADR_LGC"), "there is one");
        assert_eq!(known_system_function(BlockId::new(BlockKind::Sfc, 25)), Some("COMPRESS"), "there is none");
        assert_eq!(known_system_function(BlockId::new(BlockKind::Fc, 5)), None);
        assert_eq!(known_system_function(BlockId::new(BlockKind::Sfc, 16)), None);
    }
}
