//! Class 5: jobs of the CPU. [reference 3.7], [S4 "7.3.1 Error Codes for “CPU Job Errors”"]

use super::Origin::{FactOnly, OtherModule, PrinterDriver};
use super::{Row, here, other};

pub(super) const ROWS: &[Row] = &[
    here(0x0501, "The job was dropped: the CP started again or got new parameters", "Start the job again."),
    here(
        0x0502,
        "The job is not allowed now: the interface has no valid parameters",
        "Look for 020Fh or 0E2xh in the diagnostic buffer and correct the parameters.",
    ),
    other(OtherModule, 0x0503, "Wrong time"),
    other(PrinterDriver, 0x0505, "The system data block with the texts is missing"),
    other(PrinterDriver, 0x0506, "The text is missing"),
    other(PrinterDriver, 0x0507, "The text is too long"),
    other(PrinterDriver, 0x0508, "Too many conversion instructions"),
    other(PrinterDriver, 0x0509, "Too many variables"),
    other(PrinterDriver, 0x050A, "Unknown conversion instruction"),
    other(PrinterDriver, 0x050B, "Unknown control instruction"),
    other(PrinterDriver, 0x050C, "The conversion cannot be carried out"),
    other(PrinterDriver, 0x050D, "Width too small or too great"),
    here(
        0x050E,
        "ASCII: no end character within the length to send, or no room to append it",
        "Put the end character into the data, or make LEN smaller by what is appended.",
    ),
    other(OtherModule, 0x050F, "Job of the CPU not possible"),
    other(OtherModule, 0x0510, "Job of the CPU not possible"),
    other(OtherModule, 0x0511, "Job of the CPU not possible"),
    other(OtherModule, 0x0512, "Job of the CPU not possible"),
    other(OtherModule, 0x0513, "Job of the CPU not possible"),
    here(
        0x0514,
        "RK 512: start address too high for the area, or start address or DB number too low",
        "Correct R_OFFSET and R_NO.",
    ),
    here(0x0515, "RK 512: the coordination flag's bit is not 0 to 7", "Correct R_CF_BIT."),
    here(0x0516, "RK 512: the CPU number is not 0 to 4", "Correct R_CPU_NO."),
    other(FactOnly, 0x0517, "The length is above 1 kbyte, too long for a CP 340"),
    here(0x0518, "The length is above 4096 bytes, or nothing is to be sent", "Correct LEN: 1 to 4096."),
    other(OtherModule, 0x0519, "Job of the CPU not possible"),
    here(
        0x051A,
        "RK 512: the command telegram could not be sent; the procedure's error stands before this entry",
        "See the remedy of the entry before.",
    ),
    other(PrinterDriver, 0x051B, "Precision invalid"),
    other(PrinterDriver, 0x051C, "Variable invalid"),
    other(OtherModule, 0x051D, "Sending or receiving was interrupted by a reset or by new parameters"),
    other(PrinterDriver, 0x051E, "The line end does not fit on the page"),
    here(
        0x0522,
        "A new job came before the one before had ended",
        "Wait for DONE or ERROR before the next edge of REQ.",
    ),
];
