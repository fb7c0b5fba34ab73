//! A station is killed around loads of data blocks in RUN. Short here; long runs with `cargo xtask siege load_kill`.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::sync::mpsc;

use ob1_model::{BlockId, BlockKind};
use ob1_s7::client::jobs::{Device, Wire};
use ob1_s7::client::{Client, Failure};
use ob1_s7::iso::Place;
use ob1_s7::wire::BlockType;
use ob1_stl::{Library, Options, Source};
use ob1_tests::siege::{random, rounds};

use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::{Running, counting};

/// A socket whose station may be gone at any time.
pub(crate) struct Socket(TcpStream);

/// It is gone.
#[derive(Debug)]
pub(crate) struct Gone;

impl From<Failure> for Gone {
    fn from(_: Failure) -> Self {
        Self
    }
}

impl Wire for Socket {
    type Error = Gone;

    fn exchange(&mut self, client: &mut Client) -> Result<(), Gone> {
        self.0.write_all(client.output()).map_err(|_| Gone)?;
        client.sent(client.output().len());
        let mut buffer = [0; 4096];
        let room = client.room().min(buffer.len());
        match self.0.read(&mut buffer[..room]) {
            Ok(len) if len > 0 => Ok(client.receive(&buffer[..len])?),
            _ => Err(Gone),
        }
    }
}

/// A programming device at this port.
pub(crate) fn connect(port: u16) -> Option<Device<Socket>> {
    let stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
    Device::connect(Client::call(Place { rack: 0, slot: 2 }), Socket(stream)).ok()
}

/// A data block of so many words, as STEP 7 loads it.
fn block(number: u16, words: u16) -> Vec<u8> {
    let text = format!(
        "DATA_BLOCK DB {number}\nSTRUCT\n a : ARRAY[1..{words}] OF INT;\nEND_STRUCT\nBEGIN\n a[1] := {words};\n\
         END_DATA_BLOCK\n"
    );
    let output = ob1_stl::compile(&[Source::new("db.awl", text)], &Library::new(), &Options::default());
    let image = ob1_mc7::image(&output.program, BlockId::new(BlockKind::Db, number), &|_| None);
    image.expect("machine code").bytes().expect("short")
}

const DATA: &str = "DATA_BLOCK DB 10\nSTRUCT\n mark : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
    DATA_BLOCK DB 20\nSTRUCT\n a : INT := 77;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";

/// The station, and an S7 connection to it.
fn start(site: &Site) -> (Running, Device<Socket>) {
    let port = free_port();
    let file = format!(
        "[station]\nname = \"load-kill\"\n\n[cpu]\nmin_cycle = \"5ms\"\nwatchdog = \"10s\"\n\n\
         [program]\nsources = [\"plant.awl\"]\n\n[retentive]\nmemory = [\"100..199\"]\nevery = \"100ms\"\n\n\
         [[link]]\ntype = \"s7\"\nname = \"panel\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"operate\"\n"
    );
    site.write("station.toml", &file);
    let station = site.run("station.toml").until_run();
    let device = station.until("the link listens", |_| connect(port));
    (station, device)
}

fn generation(station: &Running) -> u64 {
    station.status().retentive.and_then(|retentive| retentive.generation).unwrap_or(0)
}

/// Data blocks are loaded, made longer and shorter while the program runs; the station is killed at any moment of it.
/// At the next start bit memory and the data blocks that nobody has loaded have what was on the disk.
#[test]
fn load_kill() {
    let site = Site::new();
    site.write("plant.awl", &counting(DATA, ""));
    let mut random = random(0x10AD);
    let (mut marked, mut loads) = (0, 0_u64);
    let kills = rounds(4);
    for kill in 0..kills {
        let (station, mut device) = start(&site);
        assert_eq!((station.cell("MW 120"), station.cell("DB10.DBW 0")), (marked, marked), "kill {kill}");
        marked = 1 + (kill % 30_000) as i64;
        station.set("MW 120", marked);
        station.set("DB10.DBW 0", marked);
        // The image after the next one was taken later than this.
        let before = generation(&station);
        station.until("the values are on the disk", |station| (generation(station) >= before + 2).then_some(()));
        let (told, done) = mpsc::channel();
        let mut lot = ob1_tests::siege::random(kill);
        let loading = std::thread::spawn(move || {
            loop {
                let number = 20 + lot.below(3) as u16;
                let bytes = block(number, 1 + lot.below(50) as u16);
                let loaded = device.download(BlockType::Db, number, &bytes).and_then(|loaded| {
                    loaded.expect("the station takes it");
                    device.link(&[(BlockType::Db, number)]).map(|linked| linked.expect("it is linked"))
                });
                if loaded.is_err() || told.send(()).is_err() {
                    return;
                }
            }
        });
        for _ in 0..random.below(4) {
            done.recv().expect("the station lives");
            loads += 1;
        }
        for _ in 0..random.below(2_000_000) {
            std::hint::spin_loop();
        }
        let ended = station.kill();
        loading.join().expect("loads are taken");
        assert!(!ended.err.contains("without retentive memory"), "kill {kill}: {}", ended.err);
    }
    let (station, _) = start(&site);
    assert_eq!((station.cell("MW 120"), station.cell("DB10.DBW 0")), (marked, marked));
    println!("{kills} kills after {loads} loads: nothing was lost");
    assert_eq!(station.interrupt().code(), Some(0));
}
