//! Classes 0 to 4: start-up, hardware, initialisation, block parameters, traffic with the CPU.
//! [TIA help "PtP data link CP 341"]

use super::Origin::{FactOnly, HardwareFault, OtherModule};
use super::{Row, here, other};

pub(super) const ROWS: &[Row] = &[
    other(OtherModule, 0x0001, "Initialisation is complete"),
    here(0x0003, "The parameters were accepted", ""),
    here(0x0004, "The CP has these parameters already: their time stamps are equal", ""),
    here(0x0007, "The CPU went to STOP", ""),
    here(0x0008, "The CPU went to RUN or START-UP", ""),
    other(HardwareFault, 0x0101, "The operating system memory failed its test"),
    other(HardwareFault, 0x0102, "The RAM failed its test"),
    other(HardwareFault, 0x0103, "The CP's interface for jobs is defective"),
    other(OtherModule, 0x0104, "No interface submodule"),
    other(OtherModule, 0x0105, "The parameter memory is defective"),
    other(HardwareFault, 0x0110, "Fault in the firmware"),
    other(OtherModule, 0x0201, "No parameters"),
    other(OtherModule, 0x0204, "Character frame not allowed"),
    other(OtherModule, 0x0205, "Transmission rate not allowed"),
    other(OtherModule, 0x0208, "Further error in the parameters"),
    here(
        0x020F,
        "The parameters are invalid; the interface was not parametrised",
        "Correct the parameters in the station file and start the station again.",
    ),
    other(OtherModule, 0x0210, "Sum of the transmission rates of both interfaces too high"),
    other(OtherModule, 0x0211, "Sum of the transmission rates of both interfaces too high"),
    other(OtherModule, 0x0212, "Monitoring time not allowed"),
    here(
        0x0301,
        "A parameter of the block, or of the partner's header, is wrong: area type, area or DB missing, coordination flag, or SF neither 'S' nor 'F'",
        "Check SF, R_TYP, DB_NO, DBB_NO, R_CF_BYT and R_CF_BIT; with RK 512 also the partner's job.",
    ),
    other(OtherModule, 0x0302, "The area is too short"),
    other(OtherModule, 0x0303, "The area cannot be accessed"),
    other(OtherModule, 0x0401, "Traffic between CP and CPU disturbed"),
    other(OtherModule, 0x0402, "Traffic between CP and CPU disturbed"),
    other(FactOnly, 0x0403, "The data type is wrong, unknown or not allowed"),
    here(
        0x0407,
        "The transfer between CP and CPU failed. ASCII and 3964(R): the CP tries again until the CPU has the data; RK 512: the job is refused",
        "With RK 512 let the program repeat the job. Right after power-on: wait until the CPU is there.",
    ),
    here(
        0x0408,
        "The CPU cannot take the data at the moment; the CP tries again",
        "Call P_RCV_RK more often, and with EN_R = 1.",
    ),
    here(
        0x0409,
        "The CPU has not taken the data for 10 s; the transfer was given up",
        "Call P_RCV_RK, set EN_R = 1, and see that DB_NO, DBB_NO and the DB's length fit the data.",
    ),
    here(
        0x040A,
        "The transfer was cancelled by RESET: destination DB missing or too short, or R = 1",
        "Create the DB, make it long enough, or take R back to 0.",
    ),
    other(OtherModule, 0x040B, "Traffic between CP and CPU disturbed"),
];
