//! Class 5: jobs of the CPU. [TIA help "PtP data link CP 341"], [S4 "7.3.1 Error Codes for “CPU Job Errors”"]

use super::Origin::{FactOnly, OtherModule};
use super::{Row, here, other};

pub(super) const ROWS: &[Row] = &[
    here(0x0501, "The job was dropped: the CP started again or got new parameters", "Start the job again."),
    here(
        0x0502,
        "The job is not allowed now: the interface has no valid parameters, or a protocol that does not do such jobs",
        "Look for 020Fh or 0E2xh in the diagnostic buffer; P_PRINT needs protocol \"printer\", the other blocks need another.",
    ),
    other(OtherModule, 0x0503, "Wrong time"),
    here(
        0x0505,
        "Printer: there are no message texts; the printout has asterisks",
        "Write `texts` into the parameters of the CP, or take %N out of the format string.",
    ),
    here(
        0x0506,
        "Printer: there is no message text of this number; the printout has asterisks",
        "Correct the variable of %N, or add the text to `texts`.",
    ),
    here(
        0x0507,
        "Printer: more than 250 characters with the variables; nothing was printed",
        "Print it with two jobs; \\x at the end of the first format string keeps the line open.",
    ),
    here(
        0x0508,
        "Printer: more conversion statements than variables; those without one print nothing",
        "Give each conversion statement its variable in the pointer DB, or remove it.",
    ),
    here(
        0x0509,
        "Printer: more variables than conversion statements; those without one are not printed",
        "Write a conversion statement for each variable, or set its DB number in the pointer DB to 0.",
    ),
    here(
        0x050A,
        "Printer: unknown conversion statement; the printout has asterisks",
        "Correct the statement: % - width . precision and one of A C D F H I N P R S T U X Y Z.",
    ),
    here(
        0x050B,
        "Printer: unknown control statement; it was neither carried out nor printed",
        "Correct the statement after \\, or define it with `controls` in the parameters of the CP.",
    ),
    here(
        0x050C,
        "Printer: the variable has a value that its conversion statement cannot show; the printout has asterisks",
        "Check that the variable is a valid date, time of day or number.",
    ),
    here(
        0x050D,
        "Printer: the width is too small for the value (it was cut, or the printout has asterisks), or not 1 to 255",
        "Make the width of the conversion statement greater, or leave it out.",
    ),
    here(
        0x050E,
        "ASCII: no end character within the length to send, or no room to append it; CP 340: more than 1024 bytes came",
        "Put the end character into the data, or make LEN smaller by what is appended; the partner sends shorter telegrams.",
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
        "RK 512: the command telegram could not be sent; the entry before this one is the error of the procedure",
        "See the remedy of the entry before.",
    ),
    here(
        0x051B,
        "Printer: the precision of a conversion statement is not allowed; the printout has asterisks",
        "1 to 99 places with F and R, 2 or 4 digits of the year with A and D.",
    ),
    here(
        0x051C,
        "Printer: a variable does not have the length its conversion statement needs; the printout has asterisks",
        "Correct the length in the pointer DB, or the statement: %I needs 2 or 4 bytes, %F 4, %Y 8.",
    ),
    other(OtherModule, 0x051D, "Sending or receiving was interrupted by a reset or by new parameters"),
    here(
        0x051E,
        "Printer: a text has more lines than a page; nothing was printed",
        "Print it with several jobs, or make `lines_per_page` greater.",
    ),
    here(
        0x0522,
        "A new job came before the one before had ended",
        "Wait for DONE or ERROR before the next edge of REQ; call one P_SND_RK for each CP.",
    ),
];
