//! Classes 14 and 30: loadable driver, and errors found by the blocks. [S4 "7.3.3 Error Codes for “General Processing
//! Errors”"] (docs/cp341-events.md)

use super::Origin::{FactOnly, HardwareFault, OtherModule};
use super::{Row, here, other};

const SOURCE: &str = "Correct the source DB.";
const SLAVE: &str = "Check the slave.";
const WIDTH: &str =
    "Check the slave; with 32-bit registers also whether the address lies in an area of that register width.";
const MANUAL: &str = "See the slave's manual or the Modbus specification.";
const PARAMETERS: &str = "Correct the driver's parameters in the station file and start the station again.";

pub(super) const ROWS: &[Row] = &[
    other(FactOnly, 0x0E01, "The driver's process could not be initialised"),
    other(FactOnly, 0x0E02, "The driver's process could not be initialised"),
    other(FactOnly, 0x0E03, "The driver cannot work with this way of transfer to the CPU"),
    other(FactOnly, 0x0E04, "The driver cannot work with this interface submodule"),
    other(HardwareFault, 0x0E05, "No dongle, or a faulty one"),
    other(HardwareFault, 0x0E06, "The dongle has no valid contents"),
    other(HardwareFault, 0x0E10, "Internal: no such state of the procedure"),
    other(HardwareFault, 0x0E11, "Internal: no such state of sending or receiving"),
    other(HardwareFault, 0x0E12, "Internal: no such state of the active side"),
    other(HardwareFault, 0x0E13, "Internal: no such state of the passive side"),
    here(0x0E20, "The data bits are not 7; the driver does not work", PARAMETERS),
    here(0x0E21, "The character delay time is not 1 to 6500 ms; the driver works with 1000 ms", PARAMETERS),
    here(
        0x0E22,
        "The operating mode is neither normal operation nor interference suppression; the driver does not work",
        PARAMETERS,
    ),
    here(0x0E23, "The response time-out is not 5 to 65500 ms; the driver works with 2000 ms", PARAMETERS),
    other(HardwareFault, 0x0E2E, "The interface's parameters cannot be read; the driver does not work"),
    here(0x0E30, "The CPU acknowledged data that were not being transferred", "Can be ignored when it is rare."),
    here(0x0E31, "The CPU did not take the reply in time", "Call P_RCV_RK with EN_R = 1."),
    here(
        0x0E32,
        "The CPU could not take the reply; the entry before this one in the diagnostic buffer is the reason",
        "See the remedy of the entry before.",
    ),
    other(HardwareFault, 0x0E33, "Internal: no such state of the transfer to the CPU"),
    here(0x0E40, "LEN is too small: not even slave address and function code", "Make LEN 2 or more."),
    here(0x0E41, "LEN is too small for this function code", "Make LEN 6 or more (06 with 32-bit registers: 8)."),
    here(0x0E42, "The driver does not have this function code", "Use 01 to 08, 11, 12, 15 or 16."),
    here(
        0x0E43,
        "Slave address 0 (broadcast) with a function that does not write",
        "Use 0 with 05, 06, 15 and 16 only.",
    ),
    here(0x0E44, "The number of bits is not 1 to 2008", SOURCE),
    here(0x0E45, "The number of registers is not 1 to 125 (32-bit registers: 1 to 62)", SOURCE),
    here(
        0x0E46,
        "Functions 15 and 16: the number is not 1 to 1976 bits, 1 to 123 registers or 1 to 61 32-bit registers",
        SOURCE,
    ),
    here(0x0E47, "Functions 15 and 16: LEN is too small for that number of bits or registers", "Make LEN longer."),
    here(0x0E48, "Function 05: the bit status is neither FF00h nor 0000h", SOURCE),
    here(0x0E49, "Function 08: the diagnostic code is not 0000h", SOURCE),
    here(0x0E4A, "32-bit registers (bit 6 of the function code) with another function than 03, 06, 16", SOURCE),
    here(0x0E4F, "R_TYP is not allowed with this driver", "Write 'X' at R_TYP of P_SND_RK."),
    here(0x0E50, "Another slave has answered", "Check line and slave addresses."),
    here(0x0E51, "The reply has another function code than the request", SLAVE),
    here(0x0E52, "The reply has fewer bytes than its byte counter says, or than its function has", WIDTH),
    here(0x0E53, "The reply has more bytes than its byte counter says, or than its function has", WIDTH),
    here(0x0E54, "The reply's byte counter is too small", SLAVE),
    here(0x0E55, "The reply's byte counter is wrong", SLAVE),
    here(0x0E56, "The reply does not echo the request", SLAVE),
    here(0x0E57, "The reply's LRC is wrong", SLAVE),
    here(0x0E58, "The reply has a character other than 0-9, A-F", "Check the slave: is it set to ASCII, not RTU?"),
    here(0x0E61, "Slave: exception 01, it does not have this function", MANUAL),
    here(0x0E62, "Slave: exception 02, it does not have this address", MANUAL),
    here(0x0E63, "Slave: exception 03, this value is not allowed", MANUAL),
    here(0x0E64, "Slave: exception 04, it has failed", MANUAL),
    here(0x0E65, "Slave: exception 05, it carries the job out", MANUAL),
    here(0x0E66, "Slave: exception 06, it is busy", MANUAL),
    here(0x0E67, "Slave: exception 07, it refuses", MANUAL),
    here(0x1E0D, "The job was dropped by a restart or by R = 1", "Start the job again."),
    here(
        0x1E0E,
        "Reading from the CP failed (SFC 59); SFCERR of the instance DB is its RET_VAL",
        "Check LADDR, and whether the CP is there.",
    ),
    here(
        0x1E0F,
        "Writing to the CP failed (SFC 58); SFCERR of the instance DB is its RET_VAL",
        "Check LADDR, and whether the CP is there.",
    ),
    other(OtherModule, 0x1E10, "Modbus slave: fault of the driver's block"),
    other(OtherModule, 0x1E11, "Modbus slave: fault of the driver's block"),
    other(OtherModule, 0x1E20, "Modbus slave: fault of the driver's block"),
    here(
        0x1E41,
        "LEN is not 1 to 4096 (CP 340: 1 to 1024); P_PRINT of a CP 340: as 1E42",
        "Correct LEN, or the lengths in the pointer DB.",
    ),
    here(
        0x1E42,
        "Printer: a variable is not 1 to 32 bytes long, or the format string not 1 to 150; or the pointers changed in a job",
        "Correct the lengths in the pointer DB, and leave it alone until DONE or ERROR.",
    ),
    here(
        0x1E43,
        "Printer: the pointer DB names no data block for the format string",
        "Write its DB number after those of the four variables.",
    ),
];
