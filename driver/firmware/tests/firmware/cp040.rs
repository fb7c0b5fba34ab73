//! A CP 040 on the bench: the machine with its protocols, driven through its registers by the host's machines.

mod manual;

use ob1_fakes::cp_port::CpLog;
use ob1_firmware::{Counter, Cp as _, Cp040, CpInput, Instant, LineFault, LineInput, Reason, Span, Why};
use ob1_params::{Cp040 as Parameters, Value};
use ob1_words::slio::{Failure, ReceiveJob, ReceiveStep, Received, SendJob, SendStep};

const MS: Span = Span::MILLISECOND;

struct Bench {
    cp: Cp040,
    log: CpLog,
    now: Instant,
    due: Option<Instant>,
    outputs: Vec<u8>,
}

fn parameters(keys: &[(&str, &str)]) -> [u8; 16] {
    let value = |text: &str| text.parse().map_or_else(|_| Value::from(text), Value::Int);
    Parameters::from_keys(keys.iter().map(|(key, text)| (*key, value(text)))).expect("right").encode()
}

impl Bench {
    fn new(io_bytes: usize, keys: &[(&str, &str)]) -> Self {
        let (cp, outputs) = (Cp040::new(io_bytes), vec![0; io_bytes]);
        let mut bench = Self {
            cp,
            log: CpLog { inputs: outputs.clone(), ..CpLog::default() },
            now: Instant::START,
            due: None,
            outputs,
        };
        bench.step(CpInput::Outputs(&vec![0; io_bytes]));
        bench.step(CpInput::Parameters(&parameters(keys)));
        assert!(bench.cp.is_working());
        bench.put(&[0x88]);
        assert_eq!(bench.log.inputs[0], 0x88);
        bench
    }

    fn step(&mut self, input: CpInput<'_>) {
        self.due = self.cp.step(self.now, input, &mut self.log);
    }

    /// Diagnostic interrupts: whether the error comes, and the first byte of its record.
    fn interrupts(&self) -> Vec<(bool, u8)> {
        self.log.interrupts.iter().map(|(incoming, record)| (*incoming, record[0])).collect()
    }

    fn line(&mut self, input: LineInput<'_>) {
        self.step(CpInput::Line(input));
    }

    fn pass(&mut self, time: Span) {
        let end = self.now + time;
        while let Some(due) = self.due.filter(|due| *due <= end) {
            self.now = self.now.max(due);
            self.step(CpInput::Tick);
        }
        self.now = end;
        self.step(CpInput::Tick);
    }

    fn put(&mut self, front: &[u8]) {
        self.outputs[..front.len()].copy_from_slice(front);
        let outputs = self.outputs.clone();
        self.step(CpInput::Outputs(&outputs));
    }

    /// Hands over a telegram; returns how the order ended, or `None` while the protocol has it.
    fn send(&mut self, telegram: &[u8]) -> Option<Result<(), Failure>> {
        let mut job = SendJob::telegram(telegram.len() as u16).expect("1 to 1024");
        for _ in 0..400 {
            let io_bytes = self.outputs.len();
            let (next, step) = job.step(&self.log.inputs, self.outputs[0], io_bytes);
            job = next;
            match step {
                SendStep::Wait => return None,
                SendStep::Command(nibble) => self.put(&[0x80 | nibble]),
                SendStep::Put(piece) => {
                    let mut area = vec![0; io_bytes];
                    let at = 1 + piece.head(&mut area[1..]);
                    area[at..at + piece.count].copy_from_slice(&telegram[piece.from..piece.from + piece.count]);
                    area[0] = self.outputs[0] & 0xF0 | piece.command;
                    self.put(&area);
                    if piece.from + piece.count == telegram.len() {
                        self.line(LineInput::TxDone);
                    }
                }
                SendStep::Done => {
                    self.put(&[0x88]);
                    return Some(Ok(()));
                }
                SendStep::Failed(failure) => {
                    self.put(&[0x88]);
                    return Some(Err(failure));
                }
            }
        }
        panic!("it does not end");
    }

    /// Fetches a telegram, if any: its offset, its bytes, and the return value.
    fn fetch(&mut self) -> Option<(usize, Vec<u8>, u16)> {
        let (mut job, mut data, mut begin) = (ReceiveJob::default(), Vec::new(), None);
        for _ in 0..400 {
            let (next, step) = job.step(&self.log.inputs, self.outputs[0], SendJob::default());
            job = next;
            match step {
                ReceiveStep::Wait => return None,
                ReceiveStep::Acknowledge(nibble) => self.put(&[nibble << 4 | 8]),
                ReceiveStep::Failed(failure) => panic!("{failure:?}"),
                ReceiveStep::Take(take) => {
                    data.extend_from_slice(&self.log.inputs[take.from..take.from + take.count]);
                    begin = begin.or((take.count > 0).then_some(take.at));
                    self.put(&[take.acknowledge << 4 | 8]);
                    if let Some(Received { return_value, .. }) = take.received {
                        self.put(&[0x88]);
                        return Some((begin.unwrap_or(0), data, return_value));
                    }
                }
            }
        }
        panic!("it does not end");
    }

    /// What its owner would show as its reason.
    fn reason(&mut self) -> Option<Reason> {
        self.log.troubles.reason(self.now, &self.cp)
    }

    fn count(&self, counter: Counter) -> u64 {
        self.log.counters.get(&counter).copied().unwrap_or(0)
    }
}

fn pattern(length: usize) -> Vec<u8> {
    (0..length).map(|n| (n * 7 % 251) as u8).collect()
}

#[test]
fn ascii_goes_both_ways_with_every_io_size() {
    for io_bytes in 8..=60 {
        let mut bench = Bench::new(io_bytes, &[("protocol", "ascii"), ("duplex", "full"), ("zvz_ms", "3")]);
        for length in [1, 4, io_bytes - 4, io_bytes - 3, 250, 1024] {
            bench.log.wire.tx.clear();
            assert_eq!(bench.send(&pattern(length)), Some(Ok(())), "{length} bytes of {io_bytes}");
            assert_eq!(bench.log.wire.tx, pattern(length));
            bench.line(LineInput::Rx(&pattern(length)));
            assert_eq!(bench.fetch(), None, "ZVZ ends a telegram");
            bench.pass(3 * MS);
            assert_eq!(bench.fetch(), Some((0, pattern(length), 0)));
        }
        assert_eq!((bench.count(Counter::TelegramsSent), bench.count(Counter::TelegramsDelivered)), (6, 6));
    }
}

#[test]
fn a_zvz_of_0_is_three_characters() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("zvz_ms", "0"), ("baud", "9600")]);
    bench.line(LineInput::Rx(b"a"));
    // 10 bits at 9600: 1.042 ms.
    bench.pass(3 * MS);
    assert_eq!(bench.cp.received_waiting(), 0);
    bench.pass(MS / 5);
    assert_eq!(bench.cp.received_waiting(), 1);
}

#[test]
fn errors_are_told_by_the_return_value() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full"), ("zvz_ms", "3")]);
    bench.line(LineInput::Fault(LineFault::Parity));
    bench.pass(100 * MS);
    assert_eq!(bench.fetch(), Some((0, vec![], 0x080C)));
    // One receive buffer: the second telegram finds none.
    bench.line(LineInput::Rx(b"one"));
    bench.pass(10 * MS);
    bench.line(LineInput::Rx(b"two"));
    bench.pass(10 * MS);
    assert_eq!(bench.fetch(), Some((0, b"one".to_vec(), 0)));
    assert_eq!(bench.fetch(), Some((0, vec![], 0x080A)));
    assert_eq!(bench.fetch(), None);
}

/// A telegram that does not fit into what is free of the buffer has no wrong length. [S3 L319]
#[test]
fn a_telegram_that_finds_too_little_room_is_080ah() {
    let mut bench = Bench::new(60, &[("protocol", "stx-etx"), ("duplex", "full")]);
    let framed = |length| [&[0x02][..], &vec![b'x'; length], &[0x03]].concat();
    for length in [1000, 25, 24] {
        bench.line(LineInput::Rx(&framed(length)));
    }
    for (length, value) in [(1000, 0), (0, 0x080A), (24, 0)] {
        assert_eq!(bench.fetch(), Some((0, vec![b'x'; length], value)));
    }
    bench.line(LineInput::Rx(&framed(1025)));
    assert_eq!(bench.fetch(), Some((0, vec![], 0x0517)), "longer than any telegram");
}

/// QVZ: "with 0 triple character time is used". [S3 L305]
#[test]
fn a_qvz_of_0_is_three_characters() {
    let mut bench = Bench::new(16, &[("protocol", "3964"), ("duplex", "full"), ("qvz_ms", "0"), ("baud", "9600")]);
    assert_eq!(bench.send(b"a"), None);
    // 10 bits at 9600: 1.042 ms.
    bench.pass(3 * MS);
    assert_eq!(bench.log.wire.tx, [0x02]);
    bench.pass(MS / 5);
    assert_eq!(bench.log.wire.tx, [0x02; 2]);
}

/// TMO = 0 is three characters, too: at once would let no telegram come.
#[test]
fn a_tmo_of_0_is_three_characters() {
    let keys = [("protocol", "stx-etx"), ("duplex", "full"), ("tmo_ms", "0"), ("end_flags", "0"), ("baud", "9600")];
    let mut bench = Bench::new(60, &keys);
    bench.line(LineInput::Rx(b"\x02a"));
    bench.pass(2 * MS);
    bench.line(LineInput::Rx(b"b"));
    bench.pass(3 * MS);
    assert_eq!(bench.fetch(), None);
    bench.pass(MS / 5);
    assert_eq!(bench.fetch(), Some((0, b"ab".to_vec(), 0)));
}

#[test]
fn an_order_the_partner_does_not_answer_ends_with_e() {
    let mut bench =
        Bench::new(60, &[("protocol", "3964r"), ("duplex", "full"), ("qvz_ms", "20"), ("stx_repetitions", "1")]);
    assert_eq!(bench.send(b"hello"), None);
    bench.line(LineInput::TxDone);
    bench.pass(30 * MS);
    bench.line(LineInput::TxDone);
    bench.pass(30 * MS);
    bench.line(LineInput::TxDone);
    bench.pass(1000 * MS);
    assert_eq!(bench.log.inputs[0], 0xE8);
    bench.put(&[0x88]);
    assert_eq!((bench.log.inputs[0], bench.count(Counter::SendErrors)), (0x88, 1));
}

#[test]
fn in_half_duplex_a_cp_does_not_hear_itself() {
    let mut bench = Bench::new(60, &[("protocol", "ascii"), ("zvz_ms", "3")]);
    let mut area = vec![0x8A, 0, 0, 2, b'h', b'i'];
    area.resize(60, 0);
    bench.put(&area);
    assert_eq!(bench.log.wire.tx, b"hi");
    bench.line(LineInput::Rx(b"hi"));
    bench.line(LineInput::TxDone);
    bench.pass(10 * MS);
    assert_eq!((bench.log.inputs[0], bench.cp.received_waiting()), (0xA8, 0));
    bench.line(LineInput::Rx(b"yes"));
    bench.pass(10 * MS);
    assert_eq!(bench.cp.received_waiting(), 1);
}

#[test]
fn a_reset_empties_both_directions() {
    let mut bench = Bench::new(16, &[("protocol", "3964r"), ("duplex", "full")]);
    assert_eq!(bench.send(b"hello"), None);
    bench.put(&[0x8B]);
    assert_eq!(bench.log.inputs[0], 0xC8);
    assert_eq!(bench.count(Counter::OrdersAborted), 1);
    bench.put(&[0x88]);
    assert_eq!(bench.log.inputs[0], 0x88);
}

#[test]
fn a_wire_break_is_seen_with_the_preset_for_it_and_in_full_duplex_alone() {
    for (duplex, preset, seen) in
        [("full", "break", true), ("full", "idle", false), ("full", "none", false), ("half", "break", false)]
    {
        for fault in [LineFault::Break, LineFault::Gone] {
            let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", duplex), ("preset", preset)]);
            bench.cp.enable_diagnostics(true);
            bench.now = Instant::from_millis(70);
            bench.line(LineInput::Fault(fault));
            let record = bench.log.records.last().expect("one at the start");
            let expected =
                if seen { [0x05, 0x1C, 0, 0, 0x60, 8, 1, 1, 0x10] } else { [0, 0x1C, 0, 0, 0x60, 8, 1, 0, 0] };
            assert_eq!(record[..9], expected, "{duplex} {preset} {fault:?}");
            assert_eq!(bench.interrupts(), if seen { vec![(true, 5)] } else { vec![] });
            if seen {
                assert_eq!(record[16..], 70_000_u32.to_be_bytes(), "the ticker");
                bench.line(if fault == LineFault::Gone {
                    LineInput::Fault(LineFault::Back)
                } else {
                    LineInput::Rx(b"x")
                });
                assert_eq!(bench.interrupts(), [(true, 5), (false, 0)]);
            }
        }
    }
}

#[test]
fn a_line_that_comes_later_is_no_wire_break_and_one_that_never_comes_is() {
    for comes in [true, false] {
        let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full"), ("preset", "break")]);
        bench.cp.enable_diagnostics(true);
        bench.step(CpInput::NoLine);
        bench.line(LineInput::TxDone);
        assert_eq!((bench.interrupts().len(), bench.log.records.last().map(|r| r[8])), (0, Some(0)));
        bench.line(LineInput::Fault(if comes { LineFault::Back } else { LineFault::Gone }));
        assert_eq!(bench.interrupts(), if comes { vec![] } else { vec![(true, 5)] });
    }
}

#[test]
fn without_diag_en_there_is_a_record_and_no_interrupt() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full"), ("preset", "break")]);
    bench.line(LineInput::Fault(LineFault::Break));
    assert_eq!((bench.log.records.last().map(|r| r[8]), bench.interrupts().len()), (Some(0x10), 0));
}

#[test]
fn if_flashes_at_2_hz_while_there_are_errors() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full")]);
    assert!(bench.log.leds.power && !bench.log.leds.error);
    bench.line(LineInput::Fault(LineFault::Framing));
    let mut seen = Vec::new();
    for _ in 0..4 {
        seen.push(bench.log.leds.error);
        bench.pass(250 * MS);
    }
    assert_eq!(seen, [true, false, true, false]);
    bench.pass(10_000 * MS);
    assert!(!bench.log.leds.error);
    assert_eq!(bench.due, None, "nothing flashes any more");
}

#[test]
fn wrong_parameters_show_nothing_but_mf() {
    let mut bench = Bench::new(16, &[("protocol", "ascii")]);
    bench.cp.enable_diagnostics(true);
    let mut bytes = parameters(&[("protocol", "ascii")]);
    bytes[0] = 0x77;
    bench.step(CpInput::Parameters(&bytes));
    assert!(!bench.cp.is_working());
    assert_eq!((bench.log.inputs.as_slice(), bench.log.leds.power, bench.log.leds.error), (&[0; 16][..], false, true));
    assert_eq!(bench.interrupts(), [(true, 0x81)]);
    bench.step(CpInput::Parameters(&parameters(&[("protocol", "ascii")])));
    assert_eq!(bench.interrupts(), [(true, 0x81), (false, 0)]);
    assert!(bench.cp.is_working());
}

/// Read or write of words in RTU, with its check sum.
fn rtu(body: &[u8]) -> Vec<u8> {
    let mut crc = 0xFFFF_u16;
    for byte in body {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 };
        }
    }
    [body, &crc.to_le_bytes()].concat()
}

#[test]
fn the_slave_short_is_the_process_image_itself() {
    let mut bench = Bench::new(20, &[("protocol", "ascii")]);
    bench.step(CpInput::Parameters(&parameters(&[("protocol", "modbus-slave-rtu-short"), ("address", "3")])));
    // The master reads the output area from word 8 on: the last 4 of our 20 bytes.
    let outputs = pattern(20);
    bench.put(&outputs);
    bench.line(LineInput::Rx(&rtu(&[3, 4, 0, 8, 0, 2])));
    bench.pass(100 * MS);
    assert_eq!(bench.log.wire.tx, rtu(&[&[3, 4, 4], &outputs[16..]].concat()));
    bench.line(LineInput::TxDone);
    bench.log.wire.tx.clear();
    // It writes word 9.
    bench.line(LineInput::Rx(&rtu(&[3, 6, 0, 9, 0xAB, 0xCD])));
    bench.pass(100 * MS);
    assert_eq!(bench.log.inputs[18..], [0xAB, 0xCD]);
    assert_eq!(bench.log.wire.tx, rtu(&[3, 6, 0, 9, 0xAB, 0xCD]));
    bench.line(LineInput::TxDone);
    bench.log.wire.tx.clear();
    // Word 10 does not exist.
    bench.line(LineInput::Rx(&rtu(&[3, 6, 0, 10, 0xAB, 0xCD])));
    bench.pass(100 * MS);
    assert_eq!(bench.log.wire.tx[1], 0x86);
}

#[test]
fn the_slave_long_tells_where_the_master_has_written() {
    for io_bytes in [8, 16, 60] {
        let mut bench =
            Bench::new(io_bytes, &[("protocol", "modbus-slave-rtu-long"), ("address", "3"), ("duplex", "full")]);
        // The host's data are in the area the master reads.
        assert_eq!(bench.send(&pattern(100)), Some(Ok(())));
        bench.line(LineInput::Rx(&rtu(&[3, 4, 0, 0, 0, 50])));
        bench.pass(100 * MS);
        assert_eq!(bench.log.wire.tx, rtu(&[&[3, 4, 100][..], &pattern(100)].concat()));
        bench.line(LineInput::TxDone);
        bench.log.wire.tx.clear();
        // Two words at byte 280: block 35, 8 bytes.
        bench.line(LineInput::Rx(&rtu(&[3, 0x10, 0, 140, 0, 2, 4, 1, 2, 3, 4])));
        bench.pass(50 * MS);
        assert_eq!(bench.log.wire.tx, [], "answered when the CPU has the data");
        assert_eq!(bench.fetch(), Some((280, vec![1, 2, 3, 4, 0, 0, 0, 0], 0)));
        assert_eq!(bench.log.wire.tx, rtu(&[3, 0x10, 0, 140, 0, 2]));
    }
}

#[test]
fn a_modbus_master_delivers_the_answer() {
    let mut bench = Bench::new(16, &[("protocol", "modbus-master-rtu"), ("duplex", "full"), ("baud", "109700")]);
    assert_eq!(bench.log.settings.last().map(|s| s.baud), Some(109_700));
    assert_eq!(bench.send(&[5, 3, 0, 0, 0, 1]), None);
    bench.pass(100 * MS);
    assert_eq!(bench.log.wire.tx, rtu(&[5, 3, 0, 0, 0, 1]));
    bench.line(LineInput::TxDone);
    bench.line(LineInput::Rx(&rtu(&[5, 3, 2, 0x12, 0x34])));
    bench.pass(50 * MS);
    assert_eq!(bench.log.inputs[0] >> 4, 0xA);
    assert_eq!(bench.fetch(), Some((0, vec![5, 3, 2, 0x12, 0x34], 0)));
}

#[test]
fn a_stopped_cpu_commands_nothing() {
    let mut bench = Bench::new(16, &[("protocol", "ascii"), ("duplex", "full")]);
    bench.step(CpInput::CpuRun(false));
    bench.put(&[0x8A, 0, 0, 1, b'x']);
    assert_eq!(bench.log.wire.tx, b"");
    bench.put(&[0; 16]);
    bench.step(CpInput::CpuRun(true));
    bench.put(&[0x88]);
    assert_eq!(bench.send(b"y"), Some(Ok(())));
    assert_eq!(bench.log.wire.tx, b"y");
}

#[test]
fn the_reason_says_what_is_wrong() {
    let mut bench = Bench::new(60, &[("protocol", "stx-etx"), ("duplex", "full"), ("preset", "break")]);
    bench.step(CpInput::CpuRun(true));
    assert_eq!(bench.reason(), None);
    bench.line(LineInput::Fault(LineFault::Break));
    assert_eq!(bench.reason(), Some(Reason::state(Why::Interrupted, 0)));
    for length in [1000, 25] {
        bench.line(LineInput::Rx(&[&[0x02][..], &vec![b'x'; length], &[0x03]].concat()));
    }
    assert_eq!(bench.reason(), Some(Reason { why: Why::Full, number: 0, count: 1 }));
    while bench.fetch().is_some() {}
    assert_eq!(bench.reason(), None);
    bench.line(LineInput::Rx(b"\x02late\x03"));
    assert_eq!(bench.reason(), None, "a telegram has just come");
    bench.pass(1_001 * MS);
    assert_eq!(bench.reason(), Some(Reason { why: Why::NotFetched, number: 0, count: 1 }));
    assert_eq!(bench.fetch(), Some((0, b"late".to_vec(), 0)));
    assert_eq!(bench.reason(), None);

    let mut bench = Bench::new(60, &[("protocol", "3964r")]);
    bench.send(b"a");
    bench.pass(20_000 * MS);
    assert_eq!(bench.reason(), Some(Reason { why: Why::OrderFailed, number: 0x07, count: 1 }));
}

/// "The entered length is not valid" [S3 L315]: a request has at least 2 bytes and at most 257 [S3 L305], and only
/// functions that write may be sent to all slaves.
#[test]
fn a_modbus_master_does_not_take_what_is_no_request() {
    let mut bench = Bench::new(60, &[("protocol", "modbus-master-rtu"), ("duplex", "full")]);
    for telegram in [&[5][..], &[5; 258], &[5; 1024], &[0, 3, 0, 0, 0, 1]] {
        assert_eq!(bench.send(telegram), Some(Err(Failure::Length)), "{} bytes", telegram.len());
    }
    bench.pass(1000 * MS);
    assert_eq!(bench.log.wire.tx, b"");
    assert_eq!(bench.send(&[5, 3, 0, 0, 0, 1]), None);
    bench.pass(100 * MS);
    assert_eq!(bench.log.wire.tx, rtu(&[5, 3, 0, 0, 0, 1]));
}

/// "Character with error received" [S3 L319]: one error for each telegram, however often the CPU looks.
#[test]
fn a_garbled_telegram_is_one_error() {
    for protocol in ["ascii", "stx-etx"] {
        for scans in [false, true] {
            let mut bench = Bench::new(16, &[("protocol", protocol), ("duplex", "full")]);
            let mut told = Vec::new();
            for _ in 0..3 {
                for byte in [None, Some(b'a'), None, None, Some(b'b'), None, Some(0x03)] {
                    match &byte {
                        None => bench.line(LineInput::Fault(LineFault::Parity)),
                        Some(byte) => bench.line(LineInput::Rx(std::slice::from_ref(byte))),
                    }
                    bench.pass(MS);
                    if scans {
                        told.extend(bench.fetch());
                    }
                }
                bench.pass(1000 * MS);
            }
            told.extend(std::iter::from_fn(|| bench.fetch()));
            assert_eq!(told, vec![(0, vec![], 0x080C); 3], "{protocol}, {scans}");
        }
    }
}

/// "A free receive buffer is not available" [S3 L319], with as many telegrams waiting as there can be.
#[test]
fn a_full_buffer_is_told_once_until_something_has_come_out() {
    let mut bench =
        Bench::new(16, &[("protocol", "ascii"), ("duplex", "full"), ("zvz_ms", "3"), ("receive_buffers", "250")]);
    for round in 0..2 {
        for _ in 0..255 {
            bench.line(LineInput::Rx(b"abcd"));
            bench.pass(10 * MS);
        }
        let fetched: Vec<_> =
            std::iter::from_fn(|| bench.fetch()).map(|(_, data, value)| (data.len(), value)).collect();
        let expected = [vec![(4, 0); 250], vec![(0, 0x080A)]].concat();
        assert_eq!(fetched, expected, "round {round}");
    }
}
