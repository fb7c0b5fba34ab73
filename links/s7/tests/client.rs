//! The programming device against the CPU, in memory: each understands what the other sends.

mod common;

use common::{Desk, block};
use ob1_s7::Rights;
use ob1_s7::client::jobs::{Device, Refused, Wire};
use ob1_s7::client::{Client, Failure};
use ob1_s7::codes::{Code, ItemCode};
use ob1_s7::iso::Place;
use ob1_s7::server::Settings;
use ob1_s7::wire::{Address, Area, BlockType, DataType};

impl Wire for &mut Desk {
    type Error = Failure;

    fn exchange(&mut self, client: &mut Client) -> Result<(), Failure> {
        let out = client.output().to_vec();
        client.sent(out.len());
        // In small pieces, as a wire may cut them.
        out.chunks(100).for_each(|piece| self.give(piece));
        let back = self.connection.output().to_vec();
        self.connection.sent(back.len());
        self.serve();
        back.chunks(64).try_for_each(|piece| client.receive(piece))
    }
}

const PLACE: Place = Place { rack: 0, slot: 2 };

fn desk(pdu: u16) -> Desk {
    let mut desk = Desk::new(Settings { rights: Rights::Read, pdu, has_password: true, ..Settings::default() });
    desk.cpu.password = Some("secret".into());
    desk
}

#[test]
fn everything_there_is_to_see() {
    for pdu in [240, 960] {
        let mut desk = desk(pdu);
        let expected = desk.cpu.clone();
        let mut device = Device::connect(Client::call(PLACE), &mut desk).expect("connected");
        assert_eq!(device.clock(), Ok(Ok(expected.clock)));
        let (record, list) = device.szl(0x00A0, 0).expect("a wire").expect("a list");
        assert_eq!((record, list.len()), (20, 2000));
        assert_eq!(device.szl(0x7777, 0), Ok(Err(Refused::Job(Code::NO_LIST))));
        for ty in BlockType::ALL {
            let numbers: Vec<u16> = expected.blocks.keys().filter(|key| key.0 == ty).map(|key| key.1).collect();
            assert_eq!(device.blocks(ty), Ok(Ok(numbers)), "{}", ty.name());
        }
        for ((ty, number), bytes) in &expected.blocks {
            assert_eq!(device.upload(*ty, *number), Ok(Ok(bytes.clone())));
        }
        assert_eq!(device.upload(BlockType::Fb, 3), Ok(Err(Refused::Job(Code::NO_BLOCK))));
        let words = Address { area: Area::Db, db: 9, start: 0, ty: DataType::Word, count: 2 };
        let read = device.read(&[words, Address { db: 8, ..words }]);
        assert_eq!(read, Ok(Ok(vec![Ok(vec![0x90, 0x91, 0x92, 0x93]), Err(ItemCode::NO_OBJECT)])));
    }
}

#[test]
fn a_program_is_loaded_with_the_password() {
    let mut desk = desk(240);
    let blocks = [
        (BlockType::Fc, 50, block(BlockType::Fc, 50, &[5; 900])),
        (BlockType::Db, 51, block(BlockType::Db, 51, &[1; 3])),
    ];
    let mut device = Device::connect(Client::call(PLACE), &mut desk).expect("connected");
    assert_eq!(device.stop(), Ok(Err(Refused::Job(Code::PROTECTED))));
    assert_eq!(device.login("wrong"), Ok(Err(Refused::Job(Code::PASSWORD))));
    assert_eq!(device.login("secret"), Ok(Ok(())));
    assert_eq!(device.stop(), Ok(Ok(())));
    for (ty, number, bytes) in &blocks {
        assert_eq!(device.download(*ty, *number, bytes), Ok(Ok(())));
    }
    assert_eq!(device.link(&[(BlockType::Fc, 50), (BlockType::Db, 51)]), Ok(Ok(())));
    assert_eq!(device.link(&[(BlockType::Fc, 50)]), Ok(Err(Refused::Job(Code::NO_BLOCK))), "it is linked already");
    for (ty, number, bytes) in &blocks {
        assert_eq!(device.upload(*ty, *number), Ok(Ok(bytes.clone())));
    }
    assert_eq!(device.control(b"", b"P_PROGRAM"), Ok(Ok(())));
    assert!(desk.cpu.runs);
}

#[test]
fn a_partner_that_refuses_is_named() {
    for (bytes, failure) in [
        (&[3, 0, 0, 11, 6, 0x80, 0, 1, 0, 0, 3][..], Failure::Refused(3)),
        (&[3, 0, 0, 11, 6, 0xD0, 0, 1, 0, 1, 0, 3, 0, 0, 8, 2, 0xF0, 0x80, 0x72], Failure::NotS7),
    ] {
        let mut client = Client::call(PLACE);
        assert_eq!(client.receive(bytes), Err(failure));
    }
    let mut client = Client::call(PLACE);
    assert!(matches!(client.receive(b"HTTP/1.1"), Err(Failure::Broken(_))));
}
