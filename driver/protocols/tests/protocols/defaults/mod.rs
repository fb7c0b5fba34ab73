//! Configurations with the defaults of the parameter tables, for the tests of the machines.

#![allow(dead_code)] // each test file uses its own part of it

use ob1_protocols::s3964::{self, Priority};
use ob1_protocols::{MS, SECOND, Span, ascii, stx_etx};

/// 3964(R) of a CP 240.
pub(crate) fn cp240(bcc: bool, char_time: Span) -> s3964::Config {
    s3964::Config {
        bcc,
        zvz: 200 * MS,
        qvz: 500 * MS,
        bwz: 2 * SECOND,
        connect_attempts: 6,
        block_attempts: 6,
        ..s3964::Config::cp240(char_time)
    }
}

/// 3964(R) of a CP 341.
pub(crate) fn cp341(bcc: bool, char_time: Span) -> s3964::Config {
    s3964::Config {
        bcc,
        priority: Priority::High,
        zvz: 220 * MS,
        qvz: if bcc { 2 * SECOND } else { 550 * MS },
        connect_attempts: 6,
        block_attempts: 6,
        ..s3964::Config::cp341(char_time)
    }
}

/// ASCII.
pub(crate) fn ascii(char_time: Span) -> ascii::Config {
    ascii::Config { zvz: 200 * MS, ..ascii::Config::unset(char_time) }
}

/// STX/ETX.
pub(crate) fn stx_etx(char_time: Span) -> stx_etx::Config {
    stx_etx::Config {
        start: stx_etx::Flags::new([0x02, 0], 1),
        end: stx_etx::Flags::new([0x03, 0], 1),
        tmo: 200 * MS,
        ..stx_etx::Config::unset(char_time)
    }
}
