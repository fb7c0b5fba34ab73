//! Classes 6 to 10: jobs of the partner, sending, receiving, responses. [TIA help "PtP data link CP 341"],
//! [S4 "7.3.2 Error Codes for “Receive Errors”"]

use super::Origin::OtherModule;
use super::{Row, here, other};

const HEADER: &str = "Check the partner: its RK 512 header does not follow the protocol.";
const LINE: &str = "Look for interference on the line; both ends need the same rate, data bits, parity and stop bits.";
const ATTEMPTS: &str = "Check the line, and whether the partner is on and set to the same procedure.";

pub(super) const ROWS: &[Row] = &[
    here(0x0601, "1st byte of the command is neither 00h nor FFh", HEADER),
    here(0x0602, "3rd byte of the command is not A, O or E", HEADER),
    here(0x0603, "3rd byte of a continuation differs from the first telegram's", HEADER),
    here(0x0604, "4th byte of the command is no area, or not allowed with this command", HEADER),
    here(0x0605, "4th byte of a continuation differs from the first telegram's", HEADER),
    here(0x0606, "5th byte: this DB number is not allowed", "Let the partner name another DB."),
    here(0x0607, "5th and 6th byte: start address too high", "Let the partner name a lower address."),
    here(0x0608, "7th and 8th byte: this length is not allowed", "Let the partner ask for another length."),
    here(
        0x0609,
        "9th and 10th byte: this coordination flag is not allowed, or its bit is too high",
        "Correct the coordination flag in the partner's job.",
    ),
    here(0x060A, "10th byte: this CPU number is not allowed", "Correct the CPU number in the partner's job."),
    here(0x060B, "The SEND telegram has more or fewer data than its header says", HEADER),
    here(0x060C, "The FETCH telegram has data", HEADER),
    here(
        0x060D,
        "The job came at the wrong time: CPU in STOP, start-up not over, or nobody receives",
        "Put the CPU into RUN and call P_RCV_RK with EN_R = 1.",
    ),
    here(
        0x060E,
        "Telegrams of the partner out of order: a new one before our response, or first and continuation confused",
        HEADER,
    ),
    here(0x060F, "The coordination flag locks the data", "Reset the flag in the program when the data have been used."),
    here(0x0610, "The telegram is too short for its header", HEADER),
    here(0x0611, "The telegram's length differs from the length in its header", HEADER),
    here(
        0x0612,
        "The response could not be sent; the entry before this one is the error of the procedure",
        "See the remedy of the entry before.",
    ),
    here(0x0701, "The first repetition is being sent", ""),
    here(0x0702, "After STX came NAK or a character that is no answer", ATTEMPTS),
    here(0x0703, "No answer to STX within the acknowledgement delay", ATTEMPTS),
    here(
        0x0704,
        "The partner interrupted our telegram with a character",
        "Check whether the partner reports an error.",
    ),
    other(OtherModule, 0x0705, "NAK while sending"),
    here(
        0x0706,
        "At the end of the telegram came NAK, another character than DLE, or DLE too early",
        "Check whether the partner reports an error; look for interference.",
    ),
    here(
        0x0707,
        "At the end of the telegram no answer came within the acknowledgement delay, or no response to it",
        ATTEMPTS,
    ),
    here(
        0x0708,
        "The partner did not release the flow control (XON, CTS = ON) in time",
        "Check the partner, or make the waiting time longer.",
    ),
    here(0x0709, "No connection: the permitted attempts are used up", ATTEMPTS),
    here(0x070A, "The telegram was not accepted: the permitted attempts are used up", ATTEMPTS),
    here(0x0801, "A repetition is awaited: the telegram was refused with NAK", ""),
    here(0x0802, "A character that is neither NAK nor STX in idle, or characters after STX before our DLE", ATTEMPTS),
    here(
        0x0805,
        "DLE was followed by neither DLE nor ETX",
        "Look for interference; check whether the partner doubles DLE.",
    ),
    here(
        0x0806,
        "The character delay time ran out within a telegram",
        "Check the partner and the line, or make the character delay time longer.",
    ),
    here(0x0808, "The block check character is wrong", "Look for interference; check whether the partner sends BCC."),
    here(0x080A, "No receive buffer is free", "Call P_RCV_RK more often."),
    here(0x080C, "A character with wrong parity, without stop bit, or lost", LINE),
    here(
        0x080D,
        "BREAK: the receiving line is interrupted",
        "Connect the devices, switch the partner on; with RS 422/485 check the wires R(A), R(B).",
    ),
    here(
        0x0810,
        "CP 340, ASCII: parity error; the telegram is lost",
        "Compare the character frame and the baud rate of both sides; look for interference on the line.",
    ),
    here(
        0x0811,
        "CP 340, ASCII: stop bit missing; the telegram is lost",
        "Compare the character frame and the baud rate of both sides; look for interference on the line.",
    ),
    other(OtherModule, 0x0812, "The partner went on sending after XOFF"),
    here(
        0x0815,
        "The partner gave up after another number of attempts than is set here",
        "Set the same number at both ends.",
    ),
    here(0x0816, "The telegram is longer than the receive buffer", "Let the partner send shorter telegrams."),
    here(0x0818, "DSR = OFF or CTS = OFF before or during a transmission", "Check how the partner drives DSR and CTS."),
    here(
        0x0830,
        "No reply began within the response time-out",
        "Check line, parameters and slave address, or make the response time-out longer.",
    ),
    here(0x0832, "The reply is longer than the receive buffer", "Check the slave's protocol settings."),
    here(0x0833, "The reply does not begin with a colon (3Ah)", "Check the slave's protocol settings."),
    here(
        0x0834,
        "A colon within a reply: the characters before it were dropped. The job continues",
        "Look for interference on the line.",
    ),
    here(
        0x0902,
        "Partner: its memory cannot be accessed; area missing or too short",
        "Check the area named in the job.",
    ),
    here(0x0903, "Partner: DB missing or too short, or its number not allowed", "Check R_NO, R_OFFSET and LEN."),
    here(0x0904, "Partner: it does not know this kind of job", "Use a kind of job the partner has."),
    here(0x0905, "Partner: area not allowed, memory fault, or the partner cannot work", "Check the partner's state."),
    here(0x0908, "Partner: telegrams out of order", "Start the job again; check both ends' settings."),
    here(0x0909, "Partner: the data are locked by the coordination flag", "Let the partner's program reset the flag."),
    here(0x090A, "Partner: 3rd byte of our header wrong", HEADER),
    here(0x090B, "Partner: 1st or 4th byte of our header wrong", HEADER),
    here(0x090C, "Partner: length of our telegram wrong", HEADER),
    here(0x090D, "Partner: not started again yet", "Put the partner into RUN."),
    here(0x090E, "Partner: unknown error number", "See the partner's manual."),
    here(0x0A01, "The response came at the wrong time", HEADER),
    here(0x0A02, "The response's first bytes are wrong", HEADER),
    here(0x0A03, "The response has too many or too few data", HEADER),
    here(0x0A04, "The response to a SEND has data", HEADER),
    here(0x0A05, "No response within the monitoring time", "Check whether the partner is in RUN, or too slow."),
];
