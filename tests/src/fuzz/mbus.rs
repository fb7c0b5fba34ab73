//! M-Bus: frames of any characters, the master with any answers, and the records of any answer. Nothing panics, an
//! accepted frame is written back to the same characters, each order ends, and its response is one of those in the
//! manual; records follow one another inside the answer, and a malformed one is the last.

use ob1_fakes::sink::MachineLog;
use ob1_mbus::records::{Answer, RECORD_BYTES, Value};
use ob1_protocols::mbus::frame::{FRAME_MAX, Frame, Progress};
use ob1_protocols::mbus::{Config, MBus, RESPONSE_MAX};
use ob1_protocols::{Input, LineFault, LineInput, MS, Machine, Order};
use ob1_time::{Instant, Span};

fn is_request(bytes: &[u8]) {
    assert!(matches!(Frame::decode(bytes), Progress::Whole(frame, n) if n == bytes.len()
        && (frame == Frame::Single || frame.is_from_master() || bytes.len() > 1)));
}

fn is_response(telegram: &[u8]) {
    assert!(telegram.len() <= RESPONSE_MAX);
    match *telegram {
        [0x01] | [0x03] | [0x00, 0xE5] => {}
        [0x00, c, _, ..] => assert_eq!(c & 0x40, 0, "a master's frame is no answer"),
        _ => panic!("no response: {telegram:02X?}"),
    }
}

/// An accepted frame is written back to the same characters, and no beginning of it is also a frame.
fn codec(data: &[u8]) {
    let data = &data[..data.len().min(FRAME_MAX)];
    let Progress::Whole(frame, used) = Frame::decode(data) else { return };
    let mut back = [0; FRAME_MAX];
    let length = frame.encode(&mut back);
    assert_eq!(&back[..length], &data[..used]);
    for cut in 0..used {
        assert_eq!(Frame::decode(&data[..cut]), Progress::More);
    }
}

/// The first byte is the length of the program's telegram, which follows; the rest is received from the bus: FEh is a
/// silence, FFh a character error, FDh a break, FCh the end of our output, and FBh before any of them the character
/// itself.
fn master(data: &[u8]) {
    let [setup, data @ ..] = data else { return };
    let (telegram, mut data) = data.split_at(data.len().min(usize::from(setup & 0x1F)));
    let mut program = MachineLog::with_room(if setup & 0x80 == 0 { 2048 } else { RESPONSE_MAX });
    let mut machine = MBus::new(Config::cp240());
    let mut now = Instant::START;
    machine.step(now, Input::Tick, &mut program);
    let mut due = machine.step(now, Input::Order(Order::Send(telegram)), &mut program);
    while let [byte, rest @ ..] = data {
        data = rest;
        now += MS;
        due = match (byte, data) {
            (0xFB, [literal, rest @ ..]) => {
                data = rest;
                machine.step(now, Input::Line(LineInput::Rx(&[*literal])), &mut program)
            }
            (0xFC, _) => machine.step(now, Input::Line(LineInput::TxDone), &mut program),
            (0xFD, _) => machine.step(now, Input::Line(LineInput::Fault(LineFault::Break)), &mut program),
            (0xFE, _) => {
                pass(&mut machine, &mut program, &mut now, due, 400 * MS);
                machine.step(now, Input::Tick, &mut program)
            }
            (0xFF, _) => machine.step(now, Input::Line(LineInput::Fault(LineFault::Parity)), &mut program),
            (byte, _) => machine.step(now, Input::Line(LineInput::Rx(&[*byte])), &mut program),
        };
    }
    // Three attempts at 300 baud, with the tolerance for an output that never reports its end: less than a minute.
    pass(&mut machine, &mut program, &mut now, due, 60_000 * MS);
    assert_eq!((program.ended.len(), machine.busy()), (1, false));
    assert_eq!(program.telegrams.len(), usize::from(program.ended[0].is_ok()), "an order, a response");
    assert!(program.sent.len() <= 3);
    program.sent.iter().for_each(|bytes| is_request(bytes));
    program.telegrams.iter().for_each(|telegram| is_response(telegram));
}

/// Advances the time, with a tick at each deadline.
fn pass(machine: &mut MBus, program: &mut MachineLog, now: &mut Instant, mut due: Option<Instant>, time: Span) {
    let end = *now + time;
    while let Some(at) = due.filter(|at| *at <= end) {
        *now = at.max(*now);
        due = machine.step(*now, Input::Tick, program);
        assert!(due.is_none_or(|next| next > *now), "the machine does not get past {now}");
    }
    *now = end;
}

/// Tests the library with the bytes as fields of an answer and of a frame.
fn records(fields: &[u8]) {
    let Ok(answer) = Answer::parse(fields) else { return };
    let (mut behind, mut is_over) = (0, false);
    for record in answer.records() {
        assert!(!is_over, "behind a malformed one");
        let Ok(record) = record else {
            is_over = true;
            continue;
        };
        assert!(record.at >= behind && record.at + record.len <= fields.len(), "{record:?} behind {behind}");
        behind = record.at + record.len;
        assert!(!record.scaled().is_nan() || matches!(record.value, Value::Real(_)), "{record:?}");
        assert_eq!(record.to_bytes(1).len(), RECORD_BYTES);
    }
}

/// Tests everything.
pub fn run(data: &[u8]) {
    codec(data);
    master(data);
    records(data);
    if let [0x68, _, _, 0x68, fields @ .., _, _] = data {
        records(fields);
    }
}

#[cfg(test)]
mod tests {
    use ob1_line::sim::SplitMix64;

    /// The frames of the collection, as frames and as answers, each with one random character.
    #[test]
    fn frames_with_a_wrong_character() {
        let mut rng = SplitMix64::new(3);
        for fixture in crate::meters::fixtures() {
            let literal = fixture.bytes.iter().flat_map(|byte| [0xFB, *byte]);
            let mut data: Vec<u8> = [3, 0xBD, 0x7B, 1, 0xFC].into_iter().chain(literal).collect();
            super::run(&fixture.bytes);
            super::run(&data);
            for _ in 0..50 {
                let at = rng.below(data.len() as u64) as usize;
                let kept = std::mem::replace(&mut data[at], rng.next_u64() as u8);
                super::run(&data);
                data[at] = kept;
            }
        }
    }
}
