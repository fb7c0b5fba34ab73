//! A CPU in memory, and a client that sends bytes.

#![allow(dead_code, reason = "each test binary uses a part of it")]

pub(crate) mod cyclic;

use std::collections::BTreeMap;

use ob1_model::{
    AlarmNow, AlarmOrder, AlarmQuery, BlockId, DebugAnswer, DebugEnd, DebugOrder, Displays, Forced, ForcedArea, Held,
    Pass, Point, Resume, Width,
};
use ob1_s7::Rights;
use ob1_s7::codes::{Code, ItemCode};
use ob1_s7::server::{Access, Ask, CodePlaces, Connection, Control, Listed, Reply, Request, Settings};
use ob1_s7::wire::{Address, Area, BlockType, DataType, DateTime};

/// A CPU in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ModelCpu {
    pub(crate) peripheral: Vec<u8>,
    pub(crate) inputs: Vec<u8>,
    pub(crate) outputs: Vec<u8>,
    pub(crate) memory: Vec<u8>,
    pub(crate) dbs: BTreeMap<u16, Vec<u8>>,
    pub(crate) timers: Vec<u16>,
    pub(crate) counters: Vec<u16>,
    pub(crate) blocks: BTreeMap<(BlockType, u16), Vec<u8>>,
    pub(crate) clock: DateTime,
    pub(crate) runs: bool,
    pub(crate) password: Option<String>,
    /// How often something has changed, whatever it was.
    pub(crate) changes: u32,
    /// What lies in the machine code of blocks: for each address the statement.
    pub(crate) code: BTreeMap<BlockId, CodePlaces>,
    /// What is forced; bytes only.
    pub(crate) forced: Vec<Forced>,
    /// The orders about breakpoints, in the order they came.
    pub(crate) orders: Vec<DebugOrder>,
    /// Where it holds, or has stopped.
    pub(crate) held: Option<Held>,
    pub(crate) alarms: Vec<AlarmNow>,
    /// Log-ons and orders about alarms, in the order they came.
    pub(crate) logons: Vec<(Displays, String)>,
    pub(crate) alarm_orders: Vec<AlarmOrder>,
    /// There is no room for a display.
    pub(crate) is_full: bool,
}

/// A block with header and footer around this code.
pub(crate) fn block(ty: BlockType, number: u16, code: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x70, 0x70, 1, 1, if ty == BlockType::Db { 5 } else { 1 }];
    bytes.push((ty.letter() as char).to_digit(16).expect("hexadecimal") as u8);
    bytes.extend_from_slice(&number.to_be_bytes());
    bytes.extend_from_slice(&(72 + code.len() as u32).to_be_bytes());
    bytes.resize(34, 0);
    bytes.extend_from_slice(&(code.len() as u16).to_be_bytes());
    bytes.extend_from_slice(code);
    bytes.extend_from_slice(b"AUTHOR\0\0FAMILY\0\0NAME\0\0\0\0\x12\0\xAB\xCD\0\0\0\0\0\0\0\0");
    bytes
}

impl Default for ModelCpu {
    fn default() -> Self {
        let ramp = |n: usize, from: usize| (0..n).map(|i| (i + from) as u8).collect::<Vec<u8>>();
        let blocks = [
            (BlockType::Ob, 1, &[0x65u8, 0, 1, 2][..]),
            (BlockType::Fc, 7, &[1, 2]),
            (BlockType::Db, 1, &[0; 1000]),
            (BlockType::Db, 9, &[9; 4]),
            (BlockType::Sfc, 1, &[]),
        ];
        Self {
            peripheral: ramp(64, 0x40),
            inputs: ramp(128, 0x10),
            outputs: ramp(128, 0x20),
            memory: ramp(256, 0),
            dbs: [(1, ramp(1000, 1)), (9, ramp(4, 0x90))].into(),
            timers: (0..16).map(|n| 0x2000 + n).collect(),
            counters: (0..16).collect(),
            blocks: blocks.into_iter().map(|(ty, n, code)| ((ty, n), block(ty, n, code))).collect(),
            clock: DateTime { year: 2026, month: 11, day: 22, hour: 12, minute: 30, second: 15, ms: 250 },
            runs: true,
            password: None,
            changes: 0,
            code: BTreeMap::new(),
            forced: Vec::new(),
            orders: Vec::new(),
            held: None,
            alarms: Vec::new(),
            logons: Vec::new(),
            alarm_orders: Vec::new(),
            is_full: false,
        }
    }
}

impl ModelCpu {
    fn bytes(&mut self, area: Area, db: u16) -> Result<&mut Vec<u8>, ItemCode> {
        Ok(match area {
            Area::Peripheral => &mut self.peripheral,
            Area::Inputs => &mut self.inputs,
            Area::Outputs => &mut self.outputs,
            Area::Memory => &mut self.memory,
            Area::Db => self.dbs.get_mut(&db).ok_or(ItemCode::NO_OBJECT)?,
            Area::Counters | Area::Timers => return Err(ItemCode::TYPE),
        })
    }

    fn words(&mut self, area: Area) -> Option<&mut Vec<u16>> {
        match area {
            Area::Counters => Some(&mut self.counters),
            Area::Timers => Some(&mut self.timers),
            _ => None,
        }
    }

    pub(crate) fn read(&mut self, address: &Address) -> Result<Vec<u8>, ItemCode> {
        let (from, count) = (address.first() as usize, usize::from(address.count));
        if let Some(words) = self.words(address.area) {
            let words = words.get(from..from + count).ok_or(ItemCode::ADDRESS)?;
            return Ok(words.iter().flat_map(|word| word.to_be_bytes()).collect());
        }
        let bytes = self.bytes(address.area, address.db)?;
        let bytes = bytes.get(from..from + address.bytes()).ok_or(ItemCode::ADDRESS)?;
        Ok(if address.ty == DataType::Bit { vec![bytes[0] >> (address.start % 8) & 1] } else { bytes.to_vec() })
    }

    fn write(&mut self, address: &Address, new: &[u8]) -> ItemCode {
        self.changes += 1;
        let (from, count) = (address.first() as usize, usize::from(address.count));
        if let Some(words) = self.words(address.area) {
            let Some(words) = words.get_mut(from..from + count) else { return ItemCode::ADDRESS };
            for (word, new) in words.iter_mut().zip(new.as_chunks::<2>().0) {
                *word = u16::from_be_bytes(*new);
            }
            return ItemCode::DONE;
        }
        let bytes = match self.bytes(address.area, address.db) {
            Ok(bytes) => bytes,
            Err(code) => return code,
        };
        let Some(bytes) = bytes.get_mut(from..from + address.bytes()) else { return ItemCode::ADDRESS };
        if address.ty == DataType::Bit {
            let mask = 1 << (address.start % 8);
            bytes[0] = if new[0] & 1 == 1 { bytes[0] | mask } else { bytes[0] & !mask };
        } else {
            bytes.copy_from_slice(new);
        }
        ItemCode::DONE
    }

    pub(crate) fn serve(&mut self, ask: Ask) -> Reply {
        match ask {
            Ask::Read(addresses) => Reply::Values(addresses.iter().map(|address| self.read(address)).collect()),
            Ask::Write(puts) => Reply::Written(puts.iter().map(|put| self.write(&put.address, &put.bytes)).collect()),
            Ask::Szl { id: 0x0011, .. } => {
                let mut bytes = vec![0, 1];
                bytes.extend_from_slice(b"6ES7 315-2EH14-0AB0 \0\0\0\x01\0\x01");
                Reply::Szl { record: 28, bytes }
            }
            Ask::Szl { id: 0x0424, .. } => {
                let mut bytes = vec![0; 20];
                bytes[3] = if self.runs { 8 } else { 4 };
                Reply::Szl { record: 20, bytes }
            }
            Ask::Szl { id: 0x00A0, .. } => {
                Reply::Szl { record: 20, bytes: (0..2000).map(|n| (n / 20) as u8).collect() }
            }
            Ask::Szl { id: 0x0232, index: 0 | 4 } => Reply::Szl { record: 40, bytes: [&[0, 4][..], &[0; 38]].concat() },
            Ask::Szl { id: 0x0131, index: 0 | 1 } => Reply::Szl { record: 40, bytes: [&[0, 1][..], &[0; 38]].concat() },
            Ask::Szl { .. } => Reply::Refused(Code::NO_LIST),
            Ask::Blocks => {
                let list = |(ty, number): &(BlockType, u16)| Listed { ty: *ty, number: *number, language: 1 };
                Reply::Blocks(self.blocks.keys().map(list).collect())
            }
            Ask::Block { ty, number } => {
                self.blocks.get(&(ty, number)).map_or(Reply::Refused(Code::NO_BLOCK), |b| Reply::Block(b.clone()))
            }
            Ask::Clock => Reply::Clock(self.clock),
            Ask::SetClock(time) => {
                self.changes += 1;
                self.clock = time;
                Reply::Done
            }
            Ask::Control(control) => {
                self.changes += 1;
                let runs = match control {
                    Control::Stop => false,
                    Control::Reset if self.runs => return Reply::Refused(Code::COORDINATION),
                    Control::Reset => return Reply::Done,
                    Control::Warm | Control::Cold => true,
                    Control::Compress | Control::CopyRamToRom => return Reply::Done,
                };
                if std::mem::replace(&mut self.runs, runs) == runs { Reply::Already } else { Reply::Done }
            }
            Ask::Load(blocks) => {
                self.changes += 1;
                if self.runs && blocks.iter().any(|block| block.ty != BlockType::Db) {
                    return Reply::Refused(Code::COORDINATION);
                }
                self.blocks.extend(blocks.into_iter().map(|block| ((block.ty, block.number), block.bytes)));
                Reply::Done
            }
            Ask::Delete(names) => {
                self.changes += 1;
                let there = names.iter().all(|name| self.blocks.remove(name).is_some());
                if there { Reply::Done } else { Reply::Refused(Code::NO_BLOCK) }
            }
            Ask::Login(password) => {
                if self.password.as_deref() == Some(password.as_str()) {
                    Reply::Rights(Rights::Operate)
                } else {
                    Reply::Refused(Code::PASSWORD)
                }
            }
            Ask::Logout => Reply::Rights(Rights::Read),
            Ask::At { access: Access::Read(addresses), .. } => self.serve(Ask::Read(addresses)),
            Ask::At { access: Access::Write(puts), .. } => self.serve(Ask::Write(puts)),
            Ask::Code { block, wanted } => {
                let Some(code) = self.code.get(&block) else { return Reply::Refused(Code::NO_BLOCK) };
                let at = |at: &u16| code.found.iter().flatten().find(|one| one.at == u32::from(*at)).copied();
                Reply::Code(CodePlaces { found: wanted.iter().map(at).collect(), ..code.clone() })
            }
            // A block that nobody calls.
            Ask::Pass(_) => Reply::Pass(Pass::default()),
            Ask::Forget { .. } | Ask::Blink => Reply::Done,
            Ask::Debug(DebugOrder::Stack { level }) => {
                let end = match (&self.held, self.runs) {
                    (Some(_), true) => DebugEnd::Held,
                    (None, true) => DebugEnd::Runs,
                    (_, false) => DebugEnd::Stopped,
                };
                let mut held = self.held.clone().unwrap_or_default();
                held.local = vec![level; 4];
                Reply::Debug(DebugAnswer { end, held })
            }
            Ask::Debug(order) => {
                self.changes += 1;
                self.orders.push(order);
                Reply::Debug(DebugAnswer { end: DebugEnd::Done, held: Held::default() })
            }
            Ask::LogOn { .. } if self.is_full => Reply::Refused(Code::NOT_NOW),
            Ask::LogOn { displays, name } => {
                self.logons.push((displays, name));
                Reply::Done
            }
            Ask::Alarms(AlarmOrder::Query(AlarmQuery::Standing)) => Reply::Alarms(self.alarms.clone()),
            Ask::Alarms(AlarmOrder::Query(AlarmQuery::Number(id))) => {
                Reply::Alarms(self.alarms.iter().filter(|now| now.state.id == id).copied().collect())
            }
            Ask::Alarms(order) => {
                self.changes += 1;
                let known = |id: &u32| self.alarms.iter().any(|now| now.state.id == *id);
                let found = match &order {
                    AlarmOrder::Acknowledge(acks) => acks.iter().map(|ack| known(&ack.id)).collect(),
                    AlarmOrder::Lock { ids, .. } => ids.iter().map(known).collect(),
                    AlarmOrder::Query(_) => Vec::new(),
                };
                self.alarm_orders.push(order);
                Reply::Ordered(found)
            }
            Ask::Forced => Reply::Forced(self.forced.clone()),
            Ask::Force(puts) => {
                self.changes += 1;
                let byte = |put: &ob1_s7::server::Put| Forced {
                    area: if put.address.area == Area::Inputs { ForcedArea::Input } else { ForcedArea::Output },
                    bit: put.address.start,
                    width: Width::Byte,
                    value: put.bytes[0].into(),
                };
                self.forced = puts.iter().map(byte).collect();
                Reply::Done
            }
        }
    }

    /// Equality without the count of changes.
    pub(crate) fn same_as(&self, other: &Self) -> bool {
        Self { changes: 0, ..self.clone() } == Self { changes: 0, ..other.clone() }
    }
}

/// A connection to such a CPU.
#[derive(Debug)]
pub(crate) struct Desk {
    pub(crate) cpu: ModelCpu,
    pub(crate) connection: Connection,
    /// What waits for a point of the cycle, or for a pass.
    pub(crate) armed: Vec<Request>,
    /// What is to be forgotten: the request to do so, and the forgotten one.
    forgets: Vec<(u64, u64)>,
}

pub(crate) const CALL: [u8; 22] = [3, 0, 0, 22, 17, 0xE0, 0, 0, 0, 1, 0, 0xC0, 1, 10, 0xC1, 2, 1, 0, 0xC2, 2, 1, 2];

impl Desk {
    pub(crate) fn new(settings: Settings) -> Self {
        Self { cpu: ModelCpu::default(), connection: Connection::new(settings), armed: Vec::new(), forgets: Vec::new() }
    }

    /// Connected, and set up with this PDU.
    pub(crate) fn open(settings: Settings, pdu: u16) -> Self {
        let mut desk = Self::new(settings);
        desk.give(&CALL);
        desk.answers();
        let [high, low] = pdu.to_be_bytes();
        let answer = desk.job(&[0xF0, 0, 0, 8, 0, 8, high, low], &[]);
        assert_eq!(answer[..2], [0x32, 3], "{answer:02X?}");
        desk
    }

    pub(crate) fn with(rights: Rights) -> Self {
        Self::open(Settings { rights, ..Settings::default() }, 480)
    }

    /// Passes bytes from the wire; the CPU serves the requests.
    pub(crate) fn give(&mut self, bytes: &[u8]) {
        self.connection.receive(bytes);
        self.serve();
    }

    pub(crate) fn serve(&mut self) {
        loop {
            if self.connection.call().is_some() {
                self.connection.accept();
            }
            let Some(request) = self.connection.next_ask() else { return };
            match &request.ask {
                Ask::At { point: Point::Now, stays: false, .. } => {}
                Ask::At { .. } | Ask::Pass(_) | Ask::Debug(DebugOrder::Hold { .. }) => {
                    self.armed.push(request);
                    continue;
                }
                Ask::Forget { request: forgotten, patience } if self.armed.iter().any(|one| one.id == *forgotten) => {
                    let at_once = *patience == 0;
                    self.forgets.push((request.id, *forgotten));
                    if at_once {
                        self.patience_ends();
                    }
                    continue;
                }
                _ => {}
            }
            let reply = self.cpu.serve(request.ask);
            self.connection.reply(request.id, reply);
        }
    }

    /// What is to be forgotten is waited for no longer.
    pub(crate) fn patience_ends(&mut self) {
        for (id, forgotten) in std::mem::take(&mut self.forgets) {
            if self.armed.iter().any(|armed| armed.id == forgotten) {
                self.armed.retain(|armed| armed.id != forgotten);
                self.connection.reply(forgotten, Reply::Forgotten);
            }
            self.connection.reply(id, Reply::Done);
        }
        self.serve();
    }

    /// An armed request has its reply, then those that want it forgotten.
    pub(crate) fn came(&mut self, id: u64, reply: Reply) {
        self.connection.reply(id, reply);
        for (forget, _) in self.forgets.extract_if(.., |(_, forgotten)| *forgotten == id).collect::<Vec<_>>() {
            self.connection.reply(forget, Reply::Done);
        }
    }

    /// The cycle comes to a point: what waits for it is done.
    pub(crate) fn point(&mut self, now: Point) {
        for request in std::mem::take(&mut self.armed) {
            let Ask::At { point, stays, .. } = &request.ask else {
                self.armed.push(request);
                continue;
            };
            if *point != now {
                self.armed.push(request);
                continue;
            }
            if *stays {
                self.armed.push(request.clone());
                self.cpu.serve(request.ask);
                continue;
            }
            let reply = self.cpu.serve(request.ask);
            self.came(request.id, reply);
        }
        self.serve();
    }

    /// The pass that is waited for was this one.
    pub(crate) fn pass(&mut self, pass: Pass) {
        let index =
            self.armed.iter().position(|armed| matches!(armed.ask, Ask::Pass(_))).expect("a pass is waited for");
        let request = self.armed.remove(index);
        self.came(request.id, Reply::Pass(pass));
        self.serve();
    }

    /// The CPU holds, or not: what waits for that is told.
    pub(crate) fn hold(&mut self, end: DebugEnd) {
        let wanted = |armed: &Request| matches!(armed.ask, Ask::Debug(DebugOrder::Hold { .. }));
        let index = self.armed.iter().position(wanted).expect("a hold is waited for");
        let request = self.armed.remove(index);
        let held = if end == DebugEnd::Held { self.cpu.held.clone().unwrap_or_default() } else { Held::default() };
        self.came(request.id, Reply::Debug(DebugAnswer { end, held }));
        self.serve();
    }

    /// How the CPU is to go on, of the request that waits for the next hold.
    pub(crate) fn resume(&self) -> Option<Resume> {
        self.armed.iter().find_map(|armed| match armed.ask {
            Ask::Debug(DebugOrder::Hold { resume, .. }) => resume,
            _ => None,
        })
    }

    /// A test function, in the long form that programming devices send; its answers and messages.
    pub(crate) fn test(&mut self, function: u8, data: &[u8]) -> Vec<Vec<u8>> {
        self.send(&test_service(function, data));
        self.answers()
    }

    /// The output as messages without TPKT and COTP.
    pub(crate) fn answers(&mut self) -> Vec<Vec<u8>> {
        let out = self.connection.output().to_vec();
        self.connection.sent(out.len());
        self.serve();
        let mut rest = &out[..];
        let mut messages = Vec::new();
        while rest.len() >= 4 {
            let (frame, behind) = rest.split_at(usize::from(u16::from_be_bytes([rest[2], rest[3]])));
            messages.push(frame[5 + usize::from(frame[4])..].to_vec());
            rest = behind;
        }
        messages
    }

    /// A message in a frame of its own.
    pub(crate) fn send(&mut self, message: &[u8]) {
        self.send_only(message);
        self.serve();
    }

    /// The CPU does not serve it yet.
    pub(crate) fn send_only(&mut self, message: &[u8]) {
        let mut frame = vec![3, 0];
        frame.extend_from_slice(&(message.len() as u16 + 7).to_be_bytes());
        frame.extend_from_slice(&[2, 0xF0, 0x80]);
        frame.extend_from_slice(message);
        self.connection.receive(&frame);
    }

    /// A job and its one answer.
    pub(crate) fn job(&mut self, parameters: &[u8], data: &[u8]) -> Vec<u8> {
        self.send(&job(7, parameters, data));
        let mut answers = self.answers();
        assert_eq!(answers.len(), 1, "{answers:02X?}");
        answers.remove(0)
    }

    /// A service and its answers: parameters from the group on, and data.
    pub(crate) fn service(&mut self, group: u8, sub: u8, data: &[u8]) -> Vec<Vec<u8>> {
        self.send(&service(group, sub, data));
        self.answers()
    }

    /// The answer to the request for the next part.
    pub(crate) fn next_part(&mut self, group: u8, sub: u8, sequence: u8) -> Vec<u8> {
        let mut bytes = job(6, &[0, 1, 0x12, 8, 0x12, 0x40 | group, sub, sequence, 0, 0, 0, 0], &[0x0A, 0, 0, 0]);
        bytes[1] = 7;
        self.send(&bytes);
        self.answers().remove(0)
    }
}

/// A job as bytes.
pub(crate) fn job(reference: u16, parameters: &[u8], data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x32, 1, 0, 0];
    for word in [reference, parameters.len() as u16, data.len() as u16] {
        bytes.extend_from_slice(&word.to_be_bytes());
    }
    bytes.extend_from_slice(parameters);
    bytes.extend_from_slice(data);
    bytes
}

/// A service of a programming device as bytes.
pub(crate) fn service(group: u8, sub: u8, data: &[u8]) -> Vec<u8> {
    let mut all = if data.is_empty() { vec![0x0A, 0, 0, 0] } else { vec![0xFF, 9, 0, data.len() as u8] };
    all.extend_from_slice(data);
    let mut bytes = job(5, &[0, 1, 0x12, 4, 0x11, 0x40 | group, sub, 0], &all);
    bytes[1] = 7;
    bytes
}

/// The data of a test function: the words of its parameters, what follows them, data.
pub(crate) fn test_data(words: [u16; 10], more: &[u8], data: &[u8]) -> Vec<u8> {
    let mut bytes = (20 + more.len() as u16).to_be_bytes().to_vec();
    bytes.extend_from_slice(&(data.len() as u16).to_be_bytes());
    bytes.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    bytes.extend_from_slice(more);
    bytes.extend_from_slice(data);
    bytes
}

/// Words of the parameters: begin, end, length of a result, trigger.
pub(crate) const fn test_words(begin: u16, end: u16, result: u16, trigger: u16) -> [u16; 10] {
    [0, begin, end, result, 1, 1, 1, 1, 1, trigger]
}

/// A test function as bytes.
pub(crate) fn test_service(function: u8, data: &[u8]) -> Vec<u8> {
    let mut all = if data.is_empty() { vec![0x0A, 0, 0, 0] } else { vec![0xFF, 9, 0, data.len() as u8] };
    all.extend_from_slice(data);
    let mut bytes = job(5, &[0, 1, 0x12, 8, 0x12, 0x41, function, 0, 0, 0, 0, 0], &all);
    bytes[1] = 7;
    bytes
}

/// An item of a read or write.
pub(crate) fn item(ty: u8, count: u16, db: u16, area: u8, start: u32) -> Vec<u8> {
    let mut bytes = vec![0x12, 0x0A, 0x10, ty];
    bytes.extend_from_slice(&count.to_be_bytes());
    bytes.extend_from_slice(&db.to_be_bytes());
    bytes.push(area);
    bytes.extend_from_slice(&start.to_be_bytes()[1..]);
    bytes
}

/// Parameters of a read or write with these items.
pub(crate) fn items(function: u8, items: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = vec![function, items.len() as u8];
    bytes.extend(items.iter().flatten());
    bytes
}

/// An item of areas of data blocks: bytes, block, first byte of each.
pub(crate) fn areas(list: &[(u8, u16, u16)]) -> Vec<u8> {
    let mut bytes = vec![0x12, 2 + 5 * list.len() as u8, 0xB0, list.len() as u8];
    for (count, db, at) in list {
        bytes.push(*count);
        bytes.extend_from_slice(&db.to_be_bytes());
        bytes.extend_from_slice(&at.to_be_bytes());
    }
    bytes
}
