//! The messages as packets.

use ob1_model::{
    AlarmAck, AlarmChange, AlarmEvent, AlarmKind, AlarmNow, AlarmOrder, AlarmQuery, AlarmState, AlarmTime, AlarmTurn,
    AlarmValues, Area, BlockId, BlockKind, Breakpoint, Cell, CellError, CodeAddress, Command, DebugAnswer, DebugEnd,
    DebugOrder, Displays, Forced, ForcedArea, Held, HeldBlock, OperatingState as State, Pass, PassEnd, PassLine,
    PassOrder, Piece, Point, PointItem, PointOrder, Put, Resume, Width,
};

use super::messages::{
    Addresses, Answer, Ask, BlockFact, Connection, Diagnosis, Document, Event, News, Refusal, Refused, ToBroker,
    ToLink, Welcome, What,
};
use super::wire::{Wire, wire};
use crate::Right;

impl Wire for Cell {
    fn put(&self, out: &mut Vec<u8>) {
        let (kind, number) = match self {
            Cell::Area(..) | Cell::Db(..) => self.block().unwrap_or((u8::MAX, 0)),
            Cell::Peripheral(_) => (4, 0),
            Cell::Timer(number) => (5, *number),
            Cell::Counter(number) => (6, *number),
        };
        kind.put(out);
        number.put(out);
        self.bit().put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        let (kind, number, bit) = (u8::get(bytes)?, u16::get(bytes)?, u32::get(bytes)?);
        Some(match kind {
            0 => Cell::Area(Area::Input, bit),
            1 => Cell::Area(Area::Output, bit),
            2 => Cell::Area(Area::Memory, bit),
            3 => Cell::Db(number, bit),
            4 => Cell::Peripheral(bit),
            5 => Cell::Timer(number),
            6 => Cell::Counter(number),
            _ => return None,
        })
    }
}

impl Wire for CellError {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(self.code());
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        CellError::from_code(u8::get(bytes)?)
    }
}

impl Wire for BlockId {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(self.kind as u8);
        self.number.put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        Some(BlockId::new(BlockKind::from_repr(u8::get(bytes)?)?, u16::get(bytes)?))
    }
}

impl Wire for AlarmValues {
    fn put(&self, out: &mut Vec<u8>) {
        (self.count() as u8).put(out);
        for (ty, value) in self.iter() {
            ty.put(out);
            Box::<[u8]>::from(value).put(out);
        }
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        let mut values = Self::default();
        for _ in 0..u8::get(bytes)? {
            let (ty, value) = (u8::get(bytes)?, Box::<[u8]>::get(bytes)?);
            values.push(ty, &value).then_some(())?;
        }
        Some(values)
    }
}

impl Wire for Displays {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        u8::get(bytes).map(Self)
    }
}

impl Wire for Box<AlarmEvent> {
    fn put(&self, out: &mut Vec<u8>) {
        (**self).put(out);
    }
    fn get(bytes: &mut &[u8]) -> Option<Self> {
        AlarmEvent::get(bytes).map(Self::new)
    }
}

wire!(enum AlarmKind {
    0 => AlarmSq, 1 => AlarmS, 2 => AlarmDq, 3 => AlarmD, 4 => Notify8p, 5 => Alarm, 6 => Alarm8, 7 => Alarm8p,
    8 => Notify,
});
wire!(struct AlarmState { kind, id, component, signals, coming, going, locked });
wire!(struct AlarmTime { nanos, wall });
wire!(enum AlarmChange {
    0 => Message { changed, lost }, 1 => Acknowledged, 2 => Locked, 3 => Unlocked, 4 => Released, 5 => Deleted, 6 => Lost(count),
});
wire!(struct AlarmEvent { number, time, change, state, values });
wire!(struct AlarmTurn { time, values });
wire!(struct AlarmNow { state, came, went });
wire!(enum AlarmQuery { 0 => Standing, 1 => Number(id) });
wire!(struct AlarmAck { id, coming, going });
wire!(enum AlarmOrder { 0 => Query(query), 1 => Acknowledge(acks), 2 => Lock { ids, locked } });
wire!(enum Width { 0 => Bit, 1 => Byte, 2 => Word, 3 => DWord });
wire!(enum Piece { 0 => Bytes { at, len }, 1 => Value(cell, width) });
wire!(enum Put { 0 => Value(cell, width, value), 1 => Bytes(cell, bytes) });
wire!(enum State { 0 => Stop, 1 => Startup, 2 => Run, 3 => Hold });
wire!(enum Right { 0 => Read, 1 => Write, 2 => Operate });
wire!(enum Command { 0 => Run, 1 => Stop, 2 => Warm, 3 => Cold, 4 => Hot, 5 => Reset, 6 => Keep });
wire!(enum Ask {
    0 => Login(password), 1 => Logout, 2 => Command(command), 3 => Clock, 4 => SetClock(clock), 5 => Szl { id, index },
    6 => Diagnostics(count), 7 => Modules, 8 => Blocks, 9 => Block(id), 10 => Events { after }, 11 => NoEvents,
    12 => Document(which), 13 => Stage { id, bytes }, 14 => Link, 15 => Delete(ids),
    16 => Pass(order), 17 => Point(order), 18 => Forget(ticket), 19 => Addresses { block, wanted }, 20 => Debug(order),
    21 => Force(cells), 22 => Forced, 23 => LogOn { displays, name }, 24 => Alarms(order),
});
wire!(enum Document { 0 => Program, 1 => Status, 2 => Timing, 3 => Buffers, 4 => Links, 5 => Sources, 6 => AlarmTexts, });
wire!(enum Answer {
    0 => Done, 1 => Clock(clock), 2 => Szl { record, bytes }, 3 => NoSzl(code), 4 => Diagnostics(entries),
    5 => Modules { state, present }, 6 => Blocks(blocks), 7 => Block(block), 8 => Refused(why),
    9 => Document { last, bytes }, 10 => Pass(pass), 11 => Point(outcomes), 12 => Addresses(found), 13 => Debug(answer),
    14 => Forced(cells), 15 => LoggedOn { after }, 16 => Alarms { last, after, list }, 17 => Ordered(found),
});
wire!(struct Breakpoint { block, statement });
wire!(enum Resume { 0 => Run, 1 => Into, 2 => Over, 3 => Out });
wire!(enum DebugOrder {
    0 => Breakpoints(list), 1 => Hold { resume, wait }, 2 => End, 3 => Stack { level }, 4 => Outputs(enabled),
});
wire!(struct HeldBlock { block, statement, blocks, ob, priority, began, address });
wire!(struct Held { stack, status, accus, addresses, local, start });
wire!(enum DebugEnd { 0 => Done, 1 => Held, 2 => Runs, 3 => Stopped, 4 => NoStatement(index) });
wire!(struct DebugAnswer { end, held });
wire!(struct PassOrder { block, from, db, first, count, wait, before });
wire!(enum ForcedArea { 0 => Input, 1 => Output, 2 => Memory, 3 => PeripheralInput, 4 => PeripheralOutput });
wire!(struct Forced { area, bit, width, value });
wire!(struct PassLine { times, status, accus, addresses, blocks });
wire!(enum PassEnd { 0 => Whole, 1 => Stopped, 2 => NotCalled, 3 => NoBlock, 4 => Full, 5 => TooLong });
wire!(struct Pass { end, cut, statements, ob, caller, time, lines, before });
wire!(struct CodeAddress { at, statement, opens });
wire!(enum Point { 0 => Now, 1 => Start, 2 => End, 3 => Stop });
wire!(enum PointItem { 0 => Read(piece), 1 => Write(put) });
wire!(struct PointOrder { point, stays, items });
wire!(struct Addresses { code, statements, found });
wire!(enum Refusal {
    0 => Cell(error), 1 => Right, 2 => Password, 3 => NotThere, 4 => Full, 5 => Silent,
    6 => InRun, 7 => Block, 8 => Room, 9 => Watched,
});
wire!(struct Refused { entry, why });
wire!(struct Diagnosis { number, time, wall, event, block, line, data, text, place, because, remedy });
wire!(struct BlockFact { id, bytes, language, name });
wire!(struct Event { number, time, what });
wire!(enum What {
    0 => Diagnosis(entry), 1 => State(state), 2 => Driver { name, up }, 3 => Link { name, up }, 4 => Lost(count),
});
wire!(struct Welcome {
    version, station, link, family, config, rights, inputs, outputs, memory, timers, counters, min_cycle, generation,
    listeners,
});
wire!(enum ToBroker {
    0 => Beat, 1 => Watch { generation, pieces }, 2 => Write { client, ticket, puts }, 3 => Ask { client, ticket, ask },
    4 => Gone(client), 5 => Connections(list), 6 => Partner { client, partner },
    7 => Handed { client, number }, 8 => Sending { client, ends },
});
wire!(struct Connection { partner, name, state, pdu, jobs, errors });
wire!(enum ToLink {
    0 => Welcome(welcome), 1 => Watching(generation), 2 => Unwatched { generation, refused }, 3 => News(news),
});
wire!(enum News {
    0 => Watching, 1 => Written { client, ticket, outcome }, 2 => Answer { client, ticket, answer }, 3 => Event(event),
    4 => Alarm { client, event },
});

macro_rules! packets {
    ($($message:ty),*) => {$(
        impl $message {
            /// The message as a packet of the socket.
            #[must_use]
            pub fn encode(&self) -> Vec<u8> {
                super::wire::encode(self)
            }

            /// From a packet; `None`: it is not a message.
            #[must_use]
            pub fn decode(bytes: &[u8]) -> Option<Self> {
                super::wire::decode(bytes)
            }
        }
    )*};
}
packets!(ToBroker, ToLink);

#[cfg(test)]
mod tests {
    use super::super::VERSION;
    use super::*;

    fn samples() -> (Vec<ToBroker>, Vec<ToLink>) {
        let at = Cell::Db(7, 160);
        let cells = [at, Cell::Area(Area::Output, 3), Cell::Peripheral(8), Cell::Timer(2), Cell::Counter(9)];
        let pieces = cells.into_iter().map(|cell| Piece::Value(cell, Width::DWord)).collect();
        let entry = Diagnosis {
            number: 1,
            time: 2,
            wall: [3; 8],
            event: 0x4302,
            block: Some(BlockId::new(BlockKind::Fb, 7)),
            line: 5,
            data: 6,
            text: "ü".into(),
            place: "a.awl:5".into(),
            because: "kernel".into(),
            remedy: String::new(),
        };
        let welcome = Welcome {
            version: VERSION,
            station: "press".into(),
            link: "panel".into(),
            family: 300,
            config: "{}".into(),
            rights: Right::Operate,
            inputs: 1,
            outputs: 2,
            memory: 3,
            timers: 4,
            counters: 5,
            min_cycle: 6,
            generation: 7,
            listeners: 1,
        };
        let asks = [
            Ask::Login("secret".into()),
            Ask::Command(Command::Hot),
            Ask::SetClock([1; 8]),
            Ask::Szl { id: 0x11, index: 2 },
            Ask::Block(BlockId::new(BlockKind::Db, 65_535)),
            Ask::Events { after: u64::MAX },
            Ask::Document(Document::Timing),
            Ask::Stage { id: BlockId::new(BlockKind::Fc, 5), bytes: [1, 2, 3].into() },
            Ask::Link,
            Ask::Delete(vec![BlockId::new(BlockKind::Ob, 35)]),
            Ask::Force(vec![Forced::parse("QW4=16#1234").expect("a cell"); 2]),
            Ask::Forced,
            Ask::Pass(PassOrder {
                block: BlockId::new(BlockKind::Fb, 20),
                from: None,
                db: 7,
                first: 3,
                count: 4,
                wait: 5,
                before: true,
            }),
            Ask::Point(PointOrder {
                point: Point::Start,
                stays: true,
                items: vec![
                    PointItem::Read(Piece::Bytes { at, len: 4 }),
                    PointItem::Write(Put::Value(at, Width::Byte, 3)),
                ],
            }),
            Ask::Forget(4),
            Ask::LogOn { displays: Displays(Displays::ALARMS), name: "HmiRtm".into() },
            Ask::Alarms(AlarmOrder::Query(AlarmQuery::Number(7))),
            Ask::Alarms(AlarmOrder::Acknowledge(vec![AlarmAck { id: 7, coming: 1, going: 0 }])),
            Ask::Alarms(AlarmOrder::Lock { ids: vec![7, 8], locked: true }),
            Ask::Addresses { block: BlockId::new(BlockKind::Fc, 5), wanted: vec![0, 4] },
        ];
        let mut to = vec![
            ToBroker::Beat,
            ToBroker::Watch { generation: 1, pieces },
            ToBroker::Write {
                client: 1,
                ticket: 2,
                puts: vec![Put::Value(at, Width::Bit, 1), Put::Bytes(at, Box::from([1, 2]))],
            },
            ToBroker::Gone(5),
            ToBroker::Handed { client: 5, number: 77 },
            ToBroker::Sending { client: 5, ends: vec![(77, 1000), (78, 1060)] },
            ToBroker::Partner { client: 7, partner: "[2001:db8::5]:1102".into() },
        ];
        to.extend(asks.into_iter().map(|ask| ToBroker::Ask { client: 1, ticket: 2, ask }));
        let mut values = AlarmValues::default();
        assert!(values.push(4, &[1, 2]) && values.push(2, &[9; 32]));
        let state = AlarmState { kind: AlarmKind::Alarm8p, id: 7, signals: 3, ..AlarmState::default() };
        let time = AlarmTime { nanos: 5, wall: [1; 8] };
        let change = AlarmChange::Message { changed: 1, lost: true };
        let event = Box::new(AlarmEvent { number: 6, time, change, state, values });
        let answers = [
            Answer::Done,
            Answer::Szl { record: 4, bytes: Box::from([0; 12]) },
            Answer::Diagnostics(vec![entry.clone(), Diagnosis::default()]),
            Answer::Modules { state: State::Run, present: vec![true, false] },
            Answer::Blocks(vec![BlockFact {
                id: BlockId::new(BlockKind::Ob, 1),
                bytes: 0,
                language: 1,
                name: "main".into(),
            }]),
            Answer::Refused(Refusal::Cell(CellError::NoDb)),
            Answer::Forced(vec![Forced::parse("I0.3=1").expect("a cell")]),
            Answer::Pass(Pass {
                end: PassEnd::Whole,
                caller: Some((BlockId::new(BlockKind::Ob, 1), 4)),
                lines: vec![PassLine::default(), PassLine { times: 2, accus: [1, 2], ..PassLine::default() }],
                ..Pass::default()
            }),
            Answer::Point(vec![Ok([1, 2].into()), Err(Refusal::Right)]),
            Answer::LoggedOn { after: 6 },
            Answer::Alarms {
                last: true,
                after: 6,
                list: vec![AlarmNow { state, came: Some(AlarmTurn { time, values }), went: None }],
            },
            Answer::Ordered(vec![true, false]),
            Answer::Addresses(Addresses {
                code: 1,
                statements: 2,
                found: vec![None, Some(CodeAddress { at: 4, statement: 1, opens: true })],
            }),
        ];
        let mut from = vec![
            ToLink::Welcome(welcome),
            ToLink::Watching(3),
            ToLink::Unwatched { generation: 3, refused: vec![1, 2] },
        ];
        let mut news = vec![
            News::Watching,
            News::Written { client: 1, ticket: 2, outcome: Ok(9) },
            News::Written { client: 1, ticket: 2, outcome: Err(Refused { entry: 3, why: Refusal::Right }) },
            News::Event(Event { number: 1, time: 2, what: What::Diagnosis(entry) }),
            News::Alarm { client: 4, event },
            News::Event(Event { number: 1, time: 2, what: What::Driver { name: "cp".into(), up: true } }),
        ];
        news.extend(answers.into_iter().map(|answer| News::Answer { client: 1, ticket: 2, answer }));
        from.extend(news.into_iter().map(ToLink::News));
        (to, from)
    }

    #[test]
    fn messages_come_back_from_their_bytes() {
        let (to, from) = samples();
        for message in to {
            assert_eq!(ToBroker::decode(&message.encode()), Some(message));
        }
        for message in from {
            assert_eq!(ToLink::decode(&message.encode()), Some(message));
        }
    }

    /// Cut, longer, and with each byte changed: a message or none, never a panic, never much memory.
    #[test]
    fn other_bytes_are_survived() {
        let (to, from) = samples();
        let all = to.iter().map(ToBroker::encode).chain(from.iter().map(ToLink::encode));
        for packet in all {
            for cut in 0..packet.len() {
                let _ = (ToBroker::decode(&packet[..cut]), ToLink::decode(&packet[..cut]));
                for value in [0, 1, 7, 0x7F, 0xFF] {
                    let mut changed = packet.clone();
                    changed[cut] = value;
                    let _ = (ToBroker::decode(&changed), ToLink::decode(&changed));
                }
            }
            let mut longer = packet.clone();
            longer.push(0);
            assert!(ToBroker::decode(&longer).is_none() || ToLink::decode(&longer).is_none());
        }
        assert_eq!(ToBroker::decode(&[1, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF]), None);
    }
}
