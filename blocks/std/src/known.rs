//! The system functions of STEP 7 by name, including those we lack: a call of one of these is reported by its name.

use ob1_model::{BlockId, BlockKind};

/// SFC numbers and names, ascending.
const SFC: &[(u16, &str)] = &[
    (0, "SET_CLK"),
    (1, "READ_CLK"),
    (2, "SET_RTM"),
    (3, "CTRL_RTM"),
    (4, "READ_RTM"),
    (5, "GADR_LGC"),
    (6, "RD_SINFO"),
    (7, "DP_PRAL"),
    (9, "EN_MSG"),
    (10, "DIS_MSG"),
    (11, "DPSYC_FR"),
    (12, "D_ACT_DP"),
    (13, "DPNRM_DG"),
    (14, "DPRD_DAT"),
    (15, "DPWR_DAT"),
    (17, "ALARM_SQ"),
    (18, "ALARM_S"),
    (19, "ALARM_SC"),
    (20, "BLKMOV"),
    (21, "FILL"),
    (22, "CREAT_DB"),
    (23, "DEL_DB"),
    (24, "TEST_DB"),
    (25, "COMPRESS"),
    (26, "UPDAT_PI"),
    (27, "UPDAT_PO"),
    (28, "SET_TINT"),
    (29, "CAN_TINT"),
    (30, "ACT_TINT"),
    (31, "QRY_TINT"),
    (32, "SRT_DINT"),
    (33, "CAN_DINT"),
    (34, "QRY_DINT"),
    (35, "MP_ALM"),
    (36, "MSK_FLT"),
    (37, "DMSK_FLT"),
    (38, "READ_ERR"),
    (39, "DIS_IRT"),
    (40, "EN_IRT"),
    (41, "DIS_AIRT"),
    (42, "EN_AIRT"),
    (43, "RE_TRIGR"),
    (44, "REPL_VAL"),
    (46, "STP"),
    (47, "WAIT"),
    (48, "SNC_RTCB"),
    (49, "LGC_GADR"),
    (50, "RD_LGADR"),
    (51, "RDSYSST"),
    (52, "WR_USMSG"),
    (54, "RD_DPARM"),
    (55, "WR_PARM"),
    (56, "WR_DPARM"),
    (57, "PARM_MOD"),
    (58, "WR_REC"),
    (59, "RD_REC"),
    (60, "GD_SND"),
    (61, "GD_RCV"),
    (62, "CONTROL"),
    (63, "AB_CALL"),
    (64, "TIME_TCK"),
    (65, "X_SEND"),
    (66, "X_RCV"),
    (67, "X_GET"),
    (68, "X_PUT"),
    (69, "X_ABORT"),
    (70, "GEO_LOG"),
    (71, "LOG_GEO"),
    (72, "I_GET"),
    (73, "I_PUT"),
    (74, "I_ABORT"),
    (78, "OB_RT"),
    (79, "SET"),
    (80, "RSET"),
    (81, "UBLKMOV"),
    (82, "CREA_DBL"),
    (83, "READ_DBL"),
    (84, "WRIT_DBL"),
    (85, "CREA_DB"),
    (87, "C_DIAG"),
    (90, "H_CTRL"),
    (99, "WWW"),
    (100, "SET_CLKS"),
    (101, "RTM"),
    (102, "RD_DPARA"),
    (103, "DP_TOPOL"),
    (104, "CIR"),
    (105, "READ_SI"),
    (106, "DEL_SI"),
    (107, "ALARM_DQ"),
    (108, "ALARM_D"),
    (109, "PROTECT"),
    (112, "PN_IN"),
    (113, "PN_OUT"),
    (114, "PN_DP"),
    (126, "SYNC_PI"),
    (127, "SYNC_PO"),
];

/// SFB numbers and names, ascending. Those from 1000 on are system types of TIA Portal, which have no number there.
const SFB: &[(u16, &str)] = &[
    (0, "CTU"),
    (1, "CTD"),
    (2, "CTUD"),
    (3, "TP"),
    (4, "TON"),
    (5, "TOF"),
    (8, "USEND"),
    (9, "URCV"),
    (12, "BSEND"),
    (13, "BRCV"),
    (14, "GET"),
    (15, "PUT"),
    (16, "PRINT"),
    (19, "START"),
    (20, "STOP"),
    (21, "RESUME"),
    (22, "STATUS"),
    (23, "USTATUS"),
    (29, "HS_COUNT"),
    (30, "FREQ_MES"),
    (31, "NOTIFY_8P"),
    (32, "DRUM"),
    (33, "ALARM"),
    (34, "ALARM_8"),
    (35, "ALARM_8P"),
    (36, "NOTIFY"),
    (37, "AR_SEND"),
    (38, "HSC_A_B"),
    (39, "POS"),
    (41, "CONT_C"),
    (42, "CONT_S"),
    (43, "PULSEGEN"),
    (44, "ANALOG"),
    (46, "DIGITAL"),
    (47, "COUNT"),
    (48, "FREQUENC"),
    (49, "PULSE"),
    (52, "RDREC"),
    (53, "WRREC"),
    (54, "RALRM"),
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
    (1000, "CTU_INT"),
    (1001, "CTD_INT"),
    (1002, "CTUD_INT"),
    (1003, "TP_TIME"),
    (1004, "TON_TIME"),
    (1005, "TOF_TIME"),
    (1006, "R_TRIG"),
    (1007, "F_TRIG"),
];

/// STEP 7's name of an SFC or SFB, whether it is here or not; `None` for other blocks and numbers STEP 7 does not use.
#[must_use]
pub fn known_system_function(id: BlockId) -> Option<&'static str> {
    let names = match id.kind {
        BlockKind::Sfc => SFC,
        BlockKind::Sfb => SFB,
        _ => return None,
    };
    names.binary_search_by_key(&id.number, |(number, _)| *number).ok().map(|at| names[at].1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Origin, standard_blocks};

    #[test]
    fn the_names_are_sorted_and_those_of_the_table() {
        for names in [SFC, SFB] {
            assert!(names.windows(2).all(|pair| pair[0].0 < pair[1].0));
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
