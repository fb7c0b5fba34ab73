//! Why nothing happens at a CP, in words: for `status`, `diag`, `top`, the page and the log.

use ob1_backplane::{DriverState, Ends, Monitor, Reason, Why};
use ob1_host::module::line_gone;
use ob1_params::CpKind;
use ob1_time::Instant;
use ob1_words::cp341_events;

use crate::access::protocol::ReasonStatus;

/// [`DriverState::ParameterError`] when the configuration of the driver is refused; below, the parameter byte.
const CONFIGURATION: u32 = 0x100;
/// The largest code of the indicator word; greater numbers are events of the classes 1 to 30.
const CODE_MAX: u16 = 0xFF;
/// Nobody has acknowledged, or answered: code, STX, telegram, Modbus reply, reaction of RK 512.
const NO_ANSWER: [u16; 6] = [0x07, 0x0703, 0x0707, 0x0709, 0x0830, 0x0A05];

/// What the CP says, or its driver's state says of it; `now` by the clock of the runtime.
pub(crate) fn of(cp: CpKind, monitor: &Monitor, now: Instant) -> Option<ReasonStatus> {
    of_state(monitor.driver_state().ok()?).or_else(|| {
        let (reason, at) = monitor.reason()?;
        let age_s = (now.nanos() / 1_000_000_000).saturating_sub(at);
        let (text, remedy) = words(cp, reason, &age(age_s));
        let remedy = remedy.to_owned();
        Some(ReasonStatus {
            why: name(reason.why).to_owned(),
            number: reason.number.into(),
            count: reason.count,
            age_s: Some(age_s),
            text,
            remedy,
        })
    })
}

/// What the driver's state says.
fn of_state(state: DriverState) -> Option<ReasonStatus> {
    let (why, number, text, remedy) = match state {
        DriverState::Absent => (
            "no_driver",
            0,
            "its driver does not run".to_owned(),
            "The log and the diagnostic buffer say why it ended.",
        ),
        DriverState::NoParameters => {
            ("no_parameters", 0, "waits for its parameters: the CPU sends them when it goes to RUN".to_owned(), "")
        }
        DriverState::ParameterError(code) => {
            let text = match code {
                0 => "parameters refused".to_owned(),
                CONFIGURATION.. => "configuration refused".to_owned(),
                byte => format!("parameters refused: byte {byte}"),
            };
            ("parameters_refused", code, text, "Correct the module in the station file; the log names what is wrong.")
        }
        DriverState::LineError(errno) => {
            let text = line_gone(errno)
                .map_or_else(|| format!("line gone: error {errno} of the system"), |why| format!("line gone: {why}"));
            ("line_gone", errno, text, "The log has the whole text; the line is tried again twice a second.")
        }
        DriverState::Starting | DriverState::Ready => return None,
    };
    Some(ReasonStatus { why: why.to_owned(), number, count: 0, age_s: None, text, remedy: remedy.to_owned() })
}

/// The name of a reason in JSON.
const fn name(why: Why) -> &'static str {
    match why {
        Why::StartUp => "start_up",
        Why::Interrupted => "interrupted",
        Why::Stopped => "stopped",
        Why::Signals => "signals",
        Why::OrderFailed => "order_failed",
        Why::Full => "buffer_full",
        Why::NotFetched => "not_fetched",
        Why::ReceiveError => "receive_error",
        Why::Echoes => "echoes",
    }
}

/// A reason and its remedy in words; `age`: how long ago.
fn words(cp: CpKind, reason: Reason, age: &str) -> (String, &'static str) {
    let (number, count) = (reason.number, Count(reason.count));
    let event = |number: u16| cp341_events::row(number).map_or("", |row| row.remedy);
    match reason.why {
        Why::StartUp => {
            (format!("waits for FC 9 ({number:04X}h), for {age}"), "Call FC 9 in OB 1 with ANL = 1 after each start.")
        }
        Why::Interrupted => (format!("the receiving line is interrupted (BREAK), for {age}"), event(0x080D)),
        Why::Stopped => (
            format!("the partner stopped us (XOFF), {age} ago"),
            "The partner has to send XON; if it has no flow control, set flow = \"none\".",
        ),
        Why::Signals => {
            let off = ["CTS and DSR off", "DSR off", "CTS off", "CTS or DSR was off"][usize::from(number & 3)];
            (format!("{off}, for {age}"), event(0x0818))
        }
        Why::OrderFailed => {
            let head = if NO_ANSWER.contains(&number) { "no answer" } else { "orders fail" };
            let (end, remedy) = end(number);
            let text = match reason.count {
                0 | 1 => format!("{head}: the last order ended {end}, {age} ago"),
                _ => format!("{head}: {count} orders in a row ended {end}, the last {age} ago"),
            };
            (text, remedy)
        }
        Why::Full => (
            format!("receive buffer full: {count} telegram{} rejected, the last {age} ago", plural(reason.count)),
            "Fetch telegrams in each scan, or set more receive buffers.",
        ),
        Why::NotFetched => {
            let block = block(cp, number);
            let text = format!("waits for {block}: {count} telegram{} not fetched, for {age}", plural(reason.count));
            (text, "Call the block in each scan; a block with EN_R needs EN_R = 1.")
        }
        Why::ReceiveError => {
            let which = if number == 0 { String::new() } else { format!(" {}", end(number).0) };
            let text = format!("{count} receive error{} in a row, the last{which} {age} ago", plural(reason.count));
            (text, event(number))
        }
        Why::Echoes => (
            format!("the line echoes what is sent, for {age}"),
            "Switch the local echo of the adapter off: an answer that repeats its request is hard to tell from it.",
        ),
    }
}

/// The block that fetches what a CP has received.
fn block(cp: CpKind, number: u16) -> String {
    match cp {
        CpKind::Cp240 => format!("FC {number}"),
        CpKind::Cp040 => "FB 61".to_owned(),
        CpKind::Cp341 => "P_RCV_RK".to_owned(),
        CpKind::Cp340 => "P_RCV".to_owned(),
        CpKind::Cp343 => "its block".to_owned(),
    }
}

/// The number with which an order has ended, with its meaning, and the remedy. [S0 "Error message CP Byte 0"]
pub(crate) fn end(number: u16) -> (String, &'static str) {
    let (meaning, remedy) = match number {
        0..=CODE_MAX => code(number as u8),
        _ => cp341_events::row(number).map_or(("unknown", ""), |row| (row.text, row.remedy)),
    };
    (format!("{} ({meaning})", number_text(number)), remedy)
}

/// A code of the indicator word and its remedy. The two of the block check come from the CP too, the others from the
/// partner's CP with RK 512.
pub(crate) const fn code(code: u8) -> (&'static str, &'static str) {
    match code {
        0x00 => ("dropped: the CP started again", "Give the order again."),
        0x07 => (
            "no acknowledgement",
            "Check baud rate, character frame, the crossed wires, and whether the partner is on.",
        ),
        0x0A => (
            "repetitions used up, or no access",
            "Check block check (3964 or 3964R) and line; with RK 512 the partner's data.",
        ),
        0x0C => ("frame error", "Check the protocol of both sides, and the coordination flag of RK 512."),
        0x10 => ("the partner: no such area", "Check the order's area."),
        0x12 => ("the partner: wrong type", "Check the order's data type."),
        0x14 => ("the partner: data block missing or too short", "Check the partner's data blocks."),
        0x16 => ("the partner: no such order", "Check the order."),
        0x17 => ("telegram too long", "A CP 240 sends at most 1024 bytes; check ANZ or LANG."),
        0x2A => ("the partner is in STOP or serves no orders", "Check its mode, and whether it calls FC 4."),
        0x32 => ("the partner's coordination flag is set", "Check its program."),
        0x34 | 0x36 => ("the partner: wrong length or sequence", "Check the partner."),
        _ => ("unknown", ""),
    }
}

/// A number as the manuals write it: `07h`, `0708h`.
pub(crate) fn number_text(number: u16) -> String {
    if number > CODE_MAX { format!("{number:04X}h") } else { format!("{number:02X}h") }
}

/// The name of a count of [`Ends`] among the counters of a module.
pub(crate) fn end_counter(number: u16) -> String {
    if number == Ends::OTHERS { "ended_other".to_owned() } else { format!("ended_{}", number_text(number)) }
}

const fn plural(count: u32) -> &'static str {
    if count == 1 { "" } else { "s" }
}

/// A count as the segment holds it.
struct Count(u32);

impl std::fmt::Display for Count {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let more = if self.0 >= Reason::COUNT_MAX { " or more" } else { "" };
        write!(f, "{}{more}", self.0)
    }
}

/// A time in the largest unit of which there are two or more.
fn age(seconds: u64) -> String {
    match seconds {
        0..120 => format!("{seconds} s"),
        120..7_200 => format!("{} min", seconds / 60),
        7_200..172_800 => format!("{} h", seconds / 3_600),
        _ => format!("{} days", seconds / 86_400),
    }
}

#[cfg(test)]
mod tests {
    use ob1_backplane::{CpSide, CpuSide, Segment};

    use super::*;

    fn told(cp: CpKind, why: Why, number: u16, count: u32) -> String {
        words(cp, Reason { why, number, count }, &age(3)).0
    }

    #[test]
    fn each_reason_in_words() {
        use CpKind::{Cp040, Cp240, Cp340, Cp341};
        for (text, expected) in [
            (told(Cp240, Why::StartUp, 0x8001, 0), "waits for FC 9 (8001h), for 3 s"),
            (told(Cp341, Why::Interrupted, 0, 0), "the receiving line is interrupted (BREAK), for 3 s"),
            (told(Cp240, Why::Stopped, 0, 0), "the partner stopped us (XOFF), 3 s ago"),
            (told(Cp240, Why::Signals, 2, 0), "CTS off, for 3 s"),
            (told(Cp341, Why::Signals, 1, 0), "DSR off, for 3 s"),
            (
                told(Cp240, Why::OrderFailed, 7, 5),
                "no answer: 5 orders in a row ended 07h (no acknowledgement), the last 3 s ago",
            ),
            (
                told(Cp341, Why::OrderFailed, 0x0E61, 1),
                "orders fail: the last order ended 0E61h (Slave: exception 01, it does not have this function), 3 s ago",
            ),
            (told(Cp240, Why::Full, 0, 2), "receive buffer full: 2 telegrams rejected, the last 3 s ago"),
            (told(Cp240, Why::NotFetched, 4, 1), "waits for FC 4: 1 telegram not fetched, for 3 s"),
            (told(Cp040, Why::NotFetched, 0, 2), "waits for FB 61: 2 telegrams not fetched, for 3 s"),
            (told(Cp341, Why::NotFetched, 0, 2), "waits for P_RCV_RK: 2 telegrams not fetched, for 3 s"),
            (told(Cp340, Why::NotFetched, 0, 4095), "waits for P_RCV: 4095 or more telegrams not fetched, for 3 s"),
            (
                told(Cp240, Why::ReceiveError, 0x0806, 1),
                "1 receive error in a row, the last 0806h (The character delay time ran out within a telegram) 3 s ago",
            ),
            (told(Cp341, Why::Echoes, 0, 0), "the line echoes what is sent, for 3 s"),
            (told(Cp240, Why::ReceiveError, 0, 2), "2 receive errors in a row, the last 3 s ago"),
        ] {
            assert_eq!(text, expected);
        }
        for (seconds, text) in [(119, "119 s"), (120, "2 min"), (7_200, "2 h"), (172_800, "2 days")] {
            assert_eq!(age(seconds), text);
        }
    }

    #[test]
    fn the_state_of_the_driver_goes_first() {
        let segment = Segment::heap();
        let mut cpu = CpuSide::create(&segment, 16).expect("16 bytes are allowed");
        let told = |cpu: &CpuSide| of(CpKind::Cp240, cpu.monitor(), Instant::from_secs(72)).map(|reason| reason.text);
        assert_eq!(told(&cpu).as_deref(), Some("its driver does not run"));
        let mut cp = CpSide::attach(&segment).expect("a fresh segment");
        cpu.set_time(12_000_000_000);
        cp.set_reason(Some(Reason { why: Why::Full, number: 0, count: 1 }));
        for (state, text) in [
            (DriverState::Ready, "receive buffer full: 1 telegram rejected, the last 60 s ago"),
            (DriverState::LineError(2), "line gone: no device"),
            (DriverState::LineError(4000), "line gone: error 4000 of the system"),
            (DriverState::ParameterError(5), "parameters refused: byte 5"),
            (DriverState::ParameterError(CONFIGURATION), "configuration refused"),
            (DriverState::NoParameters, "waits for its parameters: the CPU sends them when it goes to RUN"),
        ] {
            cp.set_state(state);
            assert_eq!(told(&cpu).as_deref(), Some(text));
        }
        cp.set_state(DriverState::Ready);
        cp.set_reason(None);
        assert_eq!(told(&cpu), None, "as with a driver that leaves the word 0");
    }
}
