//! A connection of S7 communication with any bytes: no panic, no answer longer than agreed, no request to the CPU
//! beyond the rights, limited memory; and a programming device with any answers.

use ob1_s7::Rights;
use ob1_s7::client::Client;
use ob1_s7::codes::Code;
use ob1_s7::iso::Place;
use ob1_s7::server::{Ask, Connection, Put, Reply, Settings};
use ob1_s7::wire::DateTime;

/// The first bytes of a client: the call, and setup for a PDU of 240.
const OPENING: [u8; 47] = [
    3, 0, 0, 22, 17, 0xE0, 0, 0, 0, 1, 0, 0xC0, 1, 10, 0xC1, 2, 1, 0, 0xC2, 2, 1, 2, 3, 0, 0, 25, 2, 0xF0, 0x80, 0x32,
    1, 0, 0, 0, 1, 0, 8, 0, 0, 0xF0, 0, 0, 8, 0, 8, 0, 240,
];
/// Limit for all data waiting to be sent.
const OUTPUT: usize = 256 * 1024;

/// The first byte is the rights of the connection; in the rest each piece starts with its length.
pub fn run(data: &[u8]) {
    let Some((&kind, mut rest)) = data.split_first() else { return };
    let rights = [Rights::Read, Rights::Write, Rights::Operate][usize::from(kind % 3)];
    let settings = Settings { rights, has_password: kind & 0x10 != 0, ..Settings::default() };
    let mut server = Connection::new(settings);
    let mut device = Client::call(Place { rack: 0, slot: 2 });
    if kind & 0x80 != 0 {
        server.receive(&OPENING);
        serve(&mut server, kind);
    }
    let mut now = 0;
    while let Some((&len, behind)) = rest.split_first() {
        let (piece, behind) = behind.split_at(usize::from(len).min(behind.len()));
        rest = behind;
        server.receive(&piece[..piece.len().min(server.room())]);
        now += u64::from(len);
        server.tick(now);
        serve(&mut server, kind);
        assert!(server.output().len() < OUTPUT);
        // Every other answer is taken later.
        if len % 2 == 0 {
            server.sent(server.output().len());
        }
        let _ = device.receive(&piece[..piece.len().min(device.room())]);
        while device.take().is_some() {}
        device.sent(device.output().len());
    }
}

fn serve(server: &mut Connection, kind: u8) {
    if server.call().is_some() {
        server.accept();
    }
    while let Some(request) = server.next_ask() {
        assert!(server.rights() >= needed(&request.ask), "{:?}", request.ask);
        server.reply(request.id, reply(request.ask, kind));
    }
}

fn needed(ask: &Ask) -> Rights {
    match ask {
        Ask::Write(_) => Rights::Write,
        Ask::SetClock(_) | Ask::Control(_) | Ask::Load(_) | Ask::Delete(_) => Rights::Operate,
        _ => Rights::Read,
    }
}

fn reply(ask: Ask, kind: u8) -> Reply {
    if kind & 0x40 != 0 {
        return Reply::Refused(Code::NOT_NOW);
    }
    match ask {
        Ask::Read(addresses) => {
            Reply::Values(addresses.iter().map(|address| Ok(vec![kind; address.bytes()])).collect())
        }
        Ask::Write(puts) => {
            assert!(puts.iter().all(|Put { address, bytes }| address.bytes() == bytes.len()));
            Reply::Written(vec![ob1_s7::codes::ItemCode::DONE; puts.len()])
        }
        Ask::Szl { id, .. } => Reply::Szl { record: id, bytes: vec![1; usize::from(id) * 3] },
        Ask::Block { number, .. } => Reply::Block(vec![0x0A; usize::from(number)]),
        Ask::Clock => Reply::Clock(DateTime { year: 2026, month: 2, day: 3, hour: 4, minute: 5, second: 6, ms: 7 }),
        Ask::Login(password) if password == "secret" => Reply::Rights(Rights::Operate),
        _ => Reply::Done,
    }
}
