//! Occurrences and amounts in words, for traces and logs.

use core::fmt;

use ob1_words::cp341_events;

use crate::machine::{Event, Phase, What};
use crate::modbus::Failure;
use crate::rk512;

/// `1 byte`, `2 bytes`.
pub(crate) struct Bytes(pub(crate) usize);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.0, if self.0 == 1 { "byte" } else { "bytes" })
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Phase::Idle => "between telegrams",
            Phase::Connect => "while the connection is set up",
            Phase::Output => "while a telegram is sent",
            Phase::Acknowledge => "while the acknowledgement is awaited",
            Phase::Receive => "while a telegram is received",
        })
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Failure::NoData => "no telegram within the delay time",
            Failure::DataLost => "characters were lost: a full buffer, or an error of the line",
            Failure::Overflow => "a telegram without an end, or longer than permitted",
            Failure::Incomplete => "only a part of a telegram",
            Failure::Fault => "wrong check sum",
            Failure::Start => "wrong start character",
        })
    }
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            What::Unexpected(byte) => write!(f, "unexpected character {byte:02X}h"),
            What::Nak => f.write_str("NAK from the partner"),
            What::AckDelay => f.write_str("no answer within the acknowledgement delay"),
            What::Conflict { yielded: true } => f.write_str("both want to send; this side gives way"),
            What::Conflict { yielded: false } => f.write_str("both want to send; the partner gives way"),
            What::Repetition(number) => write!(f, "repetition {number}"),
            What::Exhausted => f.write_str("all repetitions are used up"),
            What::CharacterDelay => f.write_str("character delay exceeded within a telegram"),
            What::BadDle(byte) => write!(f, "DLE followed by {byte:02X}h"),
            What::BadCheck { computed, received } => {
                write!(f, "block check character {received:02X}h instead of {computed:02X}h")
            }
            What::NoBuffer => f.write_str("no receive buffer is free"),
            What::TooLong => f.write_str("the telegram is too long"),
            What::Restarted => f.write_str("a telegram began before the one before it had ended"),
            What::Empty => f.write_str("a telegram without user data"),
            What::Refused(number) => write!(f, "telegram refused, attempt {number}"),
            What::NoRepetition => f.write_str("the partner does not repeat a refused telegram"),
            What::OneMoreRepetition => f.write_str("the partner repeats more often than is permitted"),
            What::Line(fault) => fault.fmt(f),
            What::Signals => f.write_str("DSR or CTS is OFF"),
            What::Modbus(failure) => failure.fmt(f),
        }
    }
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.what, self.phase)
    }
}

impl fmt::Display for rk512::Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            rk512::Event::Line(event) => event.fmt(f),
            rk512::Event::Repeated => f.write_str("RK 512: the partner repeats a telegram that is known"),
            rk512::Event::Repetition(number) => write!(f, "RK 512: no reaction; repetition {number}"),
            event => match event.number().map(|number| (number, cp341_events::row(number))) {
                Some((number, Some(row))) => write!(f, "RK 512: {number:04X}h {}", row.text),
                Some((number, None)) => write!(f, "RK 512: event {number:04X}h"),
                None => f.write_str("RK 512: an order has failed"),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString as _;

    use super::*;
    use crate::machine::LineFault;

    #[test]
    fn an_event_is_a_sentence_and_no_structure() {
        let event = |what, phase| Event { what, phase };
        for (event, words) in [
            (
                event(What::AckDelay, Phase::Connect),
                "no answer within the acknowledgement delay while the connection is set up",
            ),
            (
                event(What::BadCheck { computed: 1, received: 0xA2 }, Phase::Receive),
                "block check character A2h instead of 01h while a telegram is received",
            ),
            (event(What::Line(LineFault::Break), Phase::Idle), "BREAK between telegrams"),
        ] {
            assert_eq!(event.to_string(), words);
        }
        let refused = rk512::Event::RefusedByCpu(0x10).to_string();
        assert!(refused.starts_with("RK 512: ") && !refused.contains("RefusedByCpu"), "{refused}");
    }
}
