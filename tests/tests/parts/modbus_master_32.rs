//! The loadable driver with an independently written slave with 32-bit registers: every function at random, the result
//! of each job matches the slave's memory; and replies with a damaged character, none of which becomes data. In virtual
//! time.

use ob1_line::sim::SplitMix64;
use ob1_protocols::modbus_master_32::{Driver, Input, Order, Owner, Parameters};
use ob1_protocols::{LineFault, LineInput, MS, SECOND, Wire};
use ob1_tests::modbus_slave::{LONG_FIRST, LONGS, ModbusSlave, SIZE};
use ob1_time::{Instant, Span};

/// Ten bits at 9600 bit/s.
const CHARACTER: Span = Span::SECOND.over(960);

#[derive(Default)]
struct Cpu {
    line: Vec<u8>,
    data: Vec<u8>,
    outcomes: Vec<Result<(), u16>>,
    entries: Vec<u16>,
}

impl Wire for Cpu {
    fn transmit(&mut self, bytes: &[u8]) {
        self.line.extend(bytes);
    }
}

impl Owner for Cpu {
    fn deliver(&mut self, destination: &[u8]) {
        assert!(self.data.is_empty(), "two deliveries for one job");
        self.data.extend(destination);
    }

    fn ended(&mut self, outcome: Result<(), u16>) {
        self.outcomes.push(outcome);
    }

    fn event(&mut self, number: u16) {
        self.entries.push(number);
    }
}

/// Damage to one character of a reply.
#[derive(Clone, Copy, Debug)]
enum Damage {
    Other(u8),
    Lost,
    Fault(LineFault),
}

/// Driver, line and slave.
struct Bench {
    driver: Driver,
    slave: ModbusSlave,
    now: Instant,
    due: Option<Instant>,
}

impl Bench {
    fn new(parameters: Parameters) -> Self {
        let mut driver = Driver::new(parameters);
        let mut cpu = Cpu::default();
        let due = driver.step(Instant::START, Input::Tick, &mut cpu);
        assert!(driver.is_ready() && cpu.entries.is_empty());
        Self { driver, slave: ModbusSlave::new(5), now: Instant::START, due }
    }

    /// Advances the time to `end`, with a tick at each deadline.
    fn pass(&mut self, end: Instant, cpu: &mut Cpu) {
        while let Some(at) = self.due.filter(|at| *at < end) {
            self.due = self.driver.step(at, Input::Tick, cpu);
            assert_ne!(self.due, Some(at), "the driver does not get past {at}");
        }
        self.now = end;
    }

    fn step(&mut self, input: Input<'_>, cpu: &mut Cpu) {
        self.due = self.driver.step(self.now, input, cpu);
    }

    /// One job: returns the data for P_RCV_RK, or STATUS. `damage` is applied to the character at that position of the
    /// reply.
    fn job(&mut self, source: &[u8], damage: Option<(usize, Damage)>) -> Result<Vec<u8>, u16> {
        let mut cpu = Cpu::default();
        self.step(Input::Order(Order::Job { r_typ: b'X', source }), &mut cpu);
        let request = std::mem::take(&mut cpu.line);
        self.pass(self.now + CHARACTER * request.len() as u64, &mut cpu);
        let reply = self.slave.hear(&request);
        if !request.is_empty() {
            self.step(Input::Line(LineInput::TxDone), &mut cpu);
        }
        self.pass(self.now + 20 * MS, &mut cpu);
        for (at, character) in reply.iter().enumerate() {
            self.pass(self.now + CHARACTER, &mut cpu);
            match damage.filter(|(place, _)| *place == at).map(|(_, damage)| damage) {
                None => self.step(Input::Line(LineInput::Rx(&[*character])), &mut cpu),
                Some(Damage::Other(other)) => self.step(Input::Line(LineInput::Rx(&[other])), &mut cpu),
                Some(Damage::Lost) => {}
                Some(Damage::Fault(fault)) => self.step(Input::Line(LineInput::Fault(fault)), &mut cpu),
            }
        }
        if !cpu.data.is_empty() {
            self.step(Input::Order(Order::Taken(true)), &mut cpu);
        }
        self.pass(self.now + 15 * SECOND, &mut cpu);
        assert!(!self.driver.busy());
        let &[outcome] = &cpu.outcomes[..] else { panic!("{source:02X?} ended {} times", cpu.outcomes.len()) };
        match outcome {
            Ok(()) => assert!(cpu.entries.iter().all(|number| *number == 0x0834), "{:04X?}", cpu.entries),
            // "All errors are also entered in the diagnostic buffer." [S4 "Diagnostic Buffer of the CP"]
            Err(status) => assert!(cpu.entries.contains(&status) && status != 0x0834, "{status:04X}"),
        }
        outcome.map(|()| cpu.data)
    }
}

fn long_mode() -> Parameters {
    Parameters { long_registers: true, ..Parameters::default() }
}

fn source(address: u8, code: u8, words: [u16; 2], data: &[u8]) -> Vec<u8> {
    let mut source = vec![address, code];
    source.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    source.extend(data);
    source
}

/// Bits as in the words of a destination or source area: the first eight in the low byte, at the odd address. [S4 L896]
fn in_words(bits: &[bool]) -> Vec<u8> {
    let mut bytes = vec![0; bits.len().div_ceil(16) * 2];
    for (n, _) in bits.iter().enumerate().filter(|(_, bit)| **bit) {
        bytes[n / 16 * 2 + usize::from(n % 16 < 8)] |= 1 << (n % 8);
    }
    bytes
}

fn random_bytes(rng: &mut SplitMix64, count: usize) -> Vec<u8> {
    (0..count).map(|_| rng.next_u64() as u8).collect()
}

/// A number from `low` to `high`, with frequent limits.
fn among(rng: &mut SplitMix64, low: u16, high: u16) -> u16 {
    match rng.below(8) {
        0 => low,
        1 => high,
        _ => low + rng.below(u64::from(high - low) + 1) as u16,
    }
}

/// A start address so that `count` elements fit before `end`, or (one time in ten) just do not; the second value says
/// which.
fn place(rng: &mut SplitMix64, low: u16, end: u16, count: u16) -> (u16, bool) {
    if rng.below(10) == 0 { (end - count + 1, false) } else { (among(rng, low, end - count), true) }
}

/// Executes one random job, and compares its result with the slave's memory.
fn any_job(bench: &mut Bench, rng: &mut SplitMix64) -> u8 {
    const OUTSIDE: Result<Vec<u8>, u16> = Err(0x0E62);
    let codes = [1, 2, 3, 0x43, 4, 5, 6, 0x46, 7, 8, 11, 12, 15, 16, 0x50];
    let code = codes[rng.below(codes.len() as u64) as usize];
    let is_long = code & 0x40 != 0;
    let (low, end) = if is_long { (LONG_FIRST, LONG_FIRST + LONGS) } else { (0, SIZE) };
    // A broadcast writes the same data, without an answer. [S4 "Broadcast Message"]
    let address = if rng.below(6) == 0 && matches!(code & 0x3F, 5 | 6 | 15 | 16) { 0 } else { 5 };
    let outside = if address == 0 { Ok(Vec::new()) } else { OUTSIDE };
    let slave = bench.slave.clone();
    match code & 0x3F {
        1 | 2 => {
            let count = among(rng, 1, 2008);
            let (first, fits) = place(rng, low, end, count);
            let bits = if code == 1 { &slave.coils } else { &slave.inputs };
            let expected = if fits { Ok(in_words(&bits[first.into()..(first + count).into()])) } else { OUTSIDE };
            assert_eq!(bench.job(&source(5, code, [first, count], &[]), None), expected);
        }
        3 | 4 => {
            let count = among(rng, 1, if is_long { 62 } else { 125 });
            let (first, fits) = place(rng, low, end, count);
            let words = if code == 4 { &slave.input_registers } else { &slave.registers };
            let bytes: Vec<u8> = if !fits {
                Vec::new()
            } else if is_long {
                (first..first + count).flat_map(|at| slave.longs[usize::from(at - LONG_FIRST)].to_be_bytes()).collect()
            } else {
                words[first.into()..(first + count).into()].iter().flat_map(|word| word.to_be_bytes()).collect()
            };
            let expected = if fits { Ok(bytes) } else { OUTSIDE };
            assert_eq!(bench.job(&source(5, code, [first, count], &[]), None), expected);
        }
        5 => {
            let (at, fits) = place(rng, low, end, 1);
            let on = rng.below(2) == 0;
            let done = bench.job(&source(address, code, [at, if on { 0xFF00 } else { 0 }], &[]), None);
            assert_eq!(done, if fits { Ok(Vec::new()) } else { outside });
            assert!(!fits || bench.slave.coils[usize::from(at)] == on);
        }
        6 => {
            let (at, fits) = place(rng, low, end, 1);
            let value = random_bytes(rng, if is_long { 4 } else { 2 });
            let source = [&[address, code][..], &at.to_be_bytes(), &value].concat();
            assert_eq!(bench.job(&source, None), if fits { Ok(Vec::new()) } else { outside });
            assert!(!fits || stored(&bench.slave, at, 1) == value);
        }
        7 => assert_eq!(bench.job(&[5, code], None), Ok(vec![slave.exception_status])),
        8 => assert_eq!(bench.job(&source(5, code, [0, rng.next_u64() as u16], &[]), None), Ok(Vec::new())),
        11 => {
            let expected = [[0; 2], slave.events.to_be_bytes()].concat();
            assert_eq!(bench.job(&[5, code], None), Ok(expected));
        }
        12 => {
            let data = bench.job(&[5, code], None).expect("a log");
            // The slave counts the request before it answers.
            let messages = slave.messages.wrapping_add(1);
            assert_eq!(data[..6], [[0; 2], slave.events.to_be_bytes(), messages.to_be_bytes()].concat());
            assert_eq!((data[6], &data[7..]), (0x80, &slave.log[..63]));
        }
        15 => {
            let count = among(rng, 1, 1976);
            let (first, fits) = place(rng, low, end, count);
            let bits: Vec<bool> = (0..count).map(|_| rng.below(2) == 0).collect();
            let done = bench.job(&source(address, code, [first, count], &in_words(&bits)), None);
            assert_eq!(done, if fits { Ok(Vec::new()) } else { outside });
            assert!(!fits || bench.slave.coils[first.into()..(first + count).into()] == bits);
        }
        _ => {
            let count = among(rng, 1, if is_long { 61 } else { 123 });
            let (first, fits) = place(rng, low, end, count);
            let data = random_bytes(rng, usize::from(count) * if is_long { 4 } else { 2 });
            let done = bench.job(&source(address, code, [first, count], &data), None);
            assert_eq!(done, if fits { Ok(Vec::new()) } else { outside });
            assert!(!fits || stored(&bench.slave, first, count) == data);
        }
    }
    code
}

/// The slave's registers as bytes.
fn stored(slave: &ModbusSlave, first: u16, count: u16) -> Vec<u8> {
    let each = |at: u16| match at.checked_sub(LONG_FIRST) {
        Some(n) => slave.longs[usize::from(n)].to_be_bytes().to_vec(),
        None => slave.registers[usize::from(at)].to_be_bytes().to_vec(),
    };
    (first..first + count).flat_map(each).collect()
}

fn filled(rng: &mut SplitMix64) -> Bench {
    let mut bench = Bench::new(long_mode());
    bench.slave.inputs.fill_with(|| rng.below(2) == 0);
    bench.slave.input_registers.fill_with(|| rng.next_u64() as u16);
    bench.slave.exception_status = rng.next_u64() as u8;
    bench
}

#[test]
fn ten_thousand_jobs() {
    let mut rng = SplitMix64::new(5);
    let mut bench = filled(&mut rng);
    let mut times = [0; 256];
    for _ in 0..10_000 {
        times[usize::from(any_job(&mut bench, &mut rng))] += 1;
    }
    assert_eq!(times.iter().filter(|times| **times > 500).count(), 15, "every function, and often: {times:?}");
}

/// "If bit 2^6 is set and a normal 2 bytes per register range is read ... Likewise ..." [S4 L844], [S4 L846]
#[test]
fn the_wrong_register_width() {
    let mut bench = Bench::new(long_mode());
    assert_eq!(bench.job(&source(5, 0x43, [100, 2], &[]), None), Err(0x0E52), "fewer bytes than expected");
    assert_eq!(bench.job(&source(5, 0x03, [LONG_FIRST, 2], &[]), None), Err(0x0E53), "more bytes than expected");
    let illegal_value = Err(0x0E63);
    assert_eq!(bench.job(&[5, 0x46, 0, 100, 1, 2, 3, 4], None), illegal_value);
    assert_eq!(bench.job(&[5, 0x06, 0x13, 0x88, 1, 2], None), illegal_value);
    assert_eq!(bench.job(&source(5, 0x50, [100, 1], &[1, 2, 3, 4]), None), illegal_value);
    assert_eq!(bench.job(&source(5, 0x10, [LONG_FIRST, 1], &[1, 2]), None), illegal_value);
    assert_eq!((bench.slave.registers[100], bench.slave.longs[0]), (0, 0), "nothing was written");
}

/// [S4 L1819]
#[test]
fn each_exception_has_its_number() {
    let mut bench = Bench::new(long_mode());
    for exception in 1..=7 {
        bench.slave.refuses = Some(exception);
        for source in [source(5, 3, [0, 1], &[]), source(5, 0x50, [LONG_FIRST, 1], &[1, 2, 3, 4]), vec![5, 7]] {
            assert_eq!(bench.job(&source, None), Err(0x0E60 + u16::from(exception)));
        }
    }
}

#[test]
fn a_slave_that_is_not_there() {
    assert_eq!(Bench::new(long_mode()).job(&[6, 7], None), Err(0x0830));
}

/// A sum finds every single wrong digit; the frame, the lengths and the faults of the line find the rest.
#[test]
fn no_damaged_character_becomes_data() {
    let mut rng = SplitMix64::new(6);
    let mut bench = filled(&mut rng);
    let reading =
        [source(5, 1, [3, 77], &[]), source(5, 3, [9, 5], &[]), source(5, 0x43, [LONG_FIRST, 3], &[]), vec![5, 12]];
    let mut statuses = std::collections::BTreeMap::<u16, u32>::new();
    let mut good = 0;
    for _ in 0..4000 {
        let source = &reading[rng.below(4) as usize];
        // Reading changes only the counters of function 12.
        let before = bench.slave.clone();
        let right = bench.job(source, None).expect("an undamaged reply");
        bench.slave = before;
        let length = if source[1] == 12 { 155 } else { right.len() * 2 + 11 };
        let damage = match rng.below(3) {
            0 => Damage::Lost,
            1 => Damage::Fault(LineFault::Parity),
            _ => Damage::Other(rng.next_u64() as u8 & 0x7F),
        };
        match bench.job(source, Some((rng.below(length as u64) as usize, damage))) {
            Ok(data) => {
                assert_eq!(data, right, "{damage:?}");
                good += 1;
            }
            Err(status) => *statuses.entry(status).or_default() += 1,
        }
    }
    // A reply is still good if its character was replaced by the same one, or is after the end.
    assert!(good < 200, "{good}");
    for status in [0x0806, 0x080C, 0x0833, 0x0E52, 0x0E57, 0x0E58] {
        assert!(statuses.contains_key(&status), "{status:04X} never came: {statuses:04X?}");
    }
}
