//! The instance of FB 58 TCONT_CP, and the controller parameters in it: kept, restored, put into effect. Statics
//! after POI_CYCL are ours.

use super::input::{TRUE, real};
use crate::call::Call;
use crate::declare::params;

params!(TcontCp {
    Input { PV_IN: REAL, PV_PER: INT, DISV: REAL, INT_HPOS: BOOL, INT_HNEG: BOOL, SELECT: INT }
    Output {
        PV: REAL, LMN: REAL, LMN_PER: INT, QPULSE: BOOL, QLMN_HLM: BOOL, QLMN_LLM: BOOL, QC_ACT: BOOL = TRUE,
    }
    InOut {
        CYCLE: REAL = real(0.1), CYCLE_P: REAL = real(0.02), SP_INT: REAL, MAN: REAL, COM_RST: BOOL,
        MAN_ON: BOOL = TRUE,
    }
    Static {
        DEADB_W: REAL, I_ITLVAL: REAL, LMN_HLM: REAL = real(100.0), LMN_LLM: REAL, PV_FAC: REAL = real(1.0),
        PV_OFFS: REAL, LMN_FAC: REAL = real(1.0), LMN_OFFS: REAL, PER_TM: REAL = real(1.0), P_B_TM: REAL = real(0.02),
        TUN_DLMN: REAL = real(20.0), PER_MODE: INT, PVPER_ON: BOOL, I_ITL_ON: BOOL, PULSE_ON: BOOL, TUN_KEEP: BOOL,
        ER: REAL, LMN_P: REAL, LMN_I: REAL, LMN_D: REAL, PHASE: INT, STATUS_H: INT, STATUS_D: INT, QTUN_RUN: BOOL,
        PI_CON: PI_PARAMETERS, PID_CON: PID_PARAMETERS, PAR_SAVE: SAVED_PARAMETERS = PAR_SAVE_INITIAL,
        PFAC_SP: REAL = real(1.0), GAIN: REAL = real(2.0), TI: REAL = real(40.0), TD: REAL = real(10.0),
        D_F: REAL = real(5.0), CON_ZONE: REAL = real(100.0), CONZ_ON: BOOL, TUN_ON: BOOL, TUN_ST: BOOL, UNDO_PAR: BOOL,
        SAVE_PAR: BOOL, LOAD_PID: BOOL, PID_ON: BOOL = TRUE, GAIN_P: REAL, TU: REAL, TA: REAL, KIG: REAL, N_PTN: REAL,
        TM_LAG_P: REAL, T_P_INF: REAL, P_INF: REAL, LMN0: REAL, PV0: REAL, PVDT0: REAL, PVDT: REAL, PVDT_MAX: REAL,
        NOI_PVDT: REAL, NOISE_PV: REAL, FIL_CYC: INT = 1i16.to_be_bytes(), POI_CMAX: INT = 2i16.to_be_bytes(),
        POI_CYCL: INT,
        sStarted: BOOL, sOutside: BOOL, sSpOld: REAL, sErOld: REAL, sRueck: REAL, sPvSum: REAL, sPvNum: INT,
        sCalls: INT, sPeriod: REAL, sPulse: REAL, sLmnN: REAL, sPvOld: REAL, sPvMin: REAL, sPvMax: REAL, sLmnSum: REAL,
        sTunNum: DINT, sTime: REAL, sSpStart: REAL,
    }
});

/// PFAC_SP 1.0, GAIN 0.0, TI 40.0, TD 10.0, D_F 5.0, CON_ZONE 100.0, CONZ_ON.
const PAR_SAVE_INITIAL: [u8; 26] = {
    let values = [real(1.0), real(0.0), real(40.0), real(10.0), real(5.0), real(100.0)];
    let mut bytes = [0; 26];
    let mut i = 0;
    while i < 24 {
        bytes[i] = values[i / 4][i % 4];
        i += 1;
    }
    bytes
};

/// The parameters that PAR_SAVE keeps, in its order; CONZ_ON follows.
const SAVED: [TcontCp; 6] =
    [TcontCp::PFAC_SP, TcontCp::GAIN, TcontCp::TI, TcontCp::TD, TcontCp::D_F, TcontCp::CON_ZONE];

/// SAVE_PAR, UNDO_PAR and LOAD_PID: done once, then the bit resets itself. The last two only by hand.
pub(super) fn parameters(call: &mut Call<'_>) {
    if call.bool(TcontCp::SAVE_PAR) {
        call.set_bool(TcontCp::SAVE_PAR, false);
        save(call);
    }
    if call.bool(TcontCp::UNDO_PAR) {
        call.set_bool(TcontCp::UNDO_PAR, false);
        if call.bool(TcontCp::MAN_ON) && member(call, TcontCp::PAR_SAVE, 4) != 0.0 {
            for (i, p) in SAVED.into_iter().enumerate() {
                let value = member(call, TcontCp::PAR_SAVE, 4 * i as u32);
                call.set_real(p, value);
            }
            let mut zone = [0];
            let at = call.instance_byte(TcontCp::PAR_SAVE) + 24;
            // Inside the instance.
            let _ = call.cx.instance_read(at, &mut zone);
            call.set_bool(TcontCp::CONZ_ON, zone[0] & 1 == 1);
        }
    }
    if call.bool(TcontCp::LOAD_PID) {
        call.set_bool(TcontCp::LOAD_PID, false);
        if call.bool(TcontCp::MAN_ON) {
            load(call);
        }
    }
}

/// The parameters in effect into PAR_SAVE.
pub(super) fn save(call: &mut Call<'_>) {
    for (i, p) in SAVED.into_iter().enumerate() {
        let value = call.real(p);
        set_member(call, TcontCp::PAR_SAVE, 4 * i as u32, value);
    }
    let zone = [u8::from(call.bool(TcontCp::CONZ_ON))];
    let at = call.instance_byte(TcontCp::PAR_SAVE) + 24;
    // Inside the instance.
    let _ = call.cx.instance_write(at, &zone);
}

/// The PI or PID parameters that tuning found into effect, when there are any.
pub(super) fn load(call: &mut Call<'_>) {
    if call.bool(TcontCp::PID_ON) && member(call, TcontCp::PID_CON, 0) == 0.0 {
        call.set_bool(TcontCp::PID_ON, false);
    }
    let with_d = call.bool(TcontCp::PID_ON);
    let from = if with_d { TcontCp::PID_CON } else { TcontCp::PI_CON };
    let gain = member(call, from, 0);
    if gain == 0.0 {
        return;
    }
    let (ti, td) = (member(call, from, 4), if with_d { member(call, from, 8) } else { 0.0 });
    for (p, value) in
        [(TcontCp::GAIN, gain), (TcontCp::TI, ti), (TcontCp::TD, td), (TcontCp::CON_ZONE, (250.0 / gain).abs())]
    {
        call.set_real(p, value);
    }
}

/// A REAL in a structure of the instance.
fn member(call: &mut Call<'_>, p: TcontCp, offset: u32) -> f32 {
    let mut bytes = [0; 4];
    let at = call.instance_byte(p) + offset;
    // Inside the instance.
    let _ = call.cx.instance_read(at, &mut bytes);
    f32::from_be_bytes(bytes)
}

/// Sets a REAL in a structure of the instance.
pub(super) fn set_member(call: &mut Call<'_>, p: TcontCp, offset: u32, value: f32) {
    let at = call.instance_byte(p) + offset;
    // Inside the instance.
    let _ = call.cx.instance_write(at, &value.to_be_bytes());
}
