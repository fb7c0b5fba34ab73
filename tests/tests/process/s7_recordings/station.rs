//! A station that has the blocks which the requests of a recording ask for.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_s7::wire::{BlockName, BlockType};

use super::answers::Parts;
use super::capture::Conversation;
use crate::common::s7::free_port;
use crate::common::site::Site;
use crate::common::station::Running;
use crate::load_siege::connect;

/// The block that a telegram is about.
fn block_of(parts: &Parts<'_>) -> Option<(BlockType, u16)> {
    let name = match (parts.kind, parts.parameters.first()?) {
        (7, _) if parts.service() == (4, 3, 3) => parts.data.get(4..12)?,
        (1, 0x1A | 0x1D) => parts.parameters.get(9..18)?,
        _ => return None,
    };
    BlockName::read(name).map(|name| (name.ty, name.number))
}

/// Which blocks were there when they were first asked for, and the addresses of the statements that were watched.
#[derive(Default)]
struct Wanted {
    there: BTreeMap<(BlockType, u16), bool>,
    watched: BTreeMap<(BlockType, u16), Vec<u16>>,
    data_bytes: BTreeMap<u16, u32>,
}

fn word(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().map_or(0, u16::from_be_bytes)
}

impl Wanted {
    fn of(conversations: &[Conversation]) -> Self {
        let mut wanted = Self::default();
        for conversation in conversations {
            for (at, telegram) in conversation.iter().enumerate().filter(|(_, telegram)| telegram.to_cpu) {
                let Some(request) = Parts::of(&telegram.bytes) else { continue };
                let answer = super::answer_to(conversation, at).and_then(Parts::of);
                if let Some(block) = block_of(&request) {
                    let is_load = request.parameters.first() == Some(&0x1A);
                    let there = !is_load && answer.is_some_and(|answer| !answer.is_refusal());
                    wanted.there.entry(block).or_insert(there);
                }
                if request.kind == 7 && request.service() == (4, 1, 0x13) {
                    wanted.watch(request.data);
                }
                if request.kind == 1 && matches!(request.parameters.first(), Some(4 | 5)) {
                    wanted.access(request.parameters, answer.is_some_and(|answer| answer.data.contains(&0xFF)));
                }
            }
        }
        wanted
    }

    /// Parameters of a block status: block, number; then the address of each line.
    fn watch(&mut self, data: &[u8]) {
        let lines = usize::from(data.get(4 + 4 + 28 + 1).copied().unwrap_or(0));
        let ty = BlockType::of_head(word(data, 4 + 4 + 20) as u8).filter(|_| word(data, 4) == 0x1C);
        let addresses = (0..lines).map(|line| word(data, 4 + 4 + 28 + 4 + 4 * line));
        if let Some(ty) = ty {
            self.watched.insert((ty, word(data, 4 + 4 + 22)), addresses.collect());
        }
    }

    fn access(&mut self, parameters: &[u8], there: bool) {
        let (items, _) = parameters.get(2..).unwrap_or_default().as_chunks::<12>();
        for item in items.iter().filter(|item| item[8] == 0x84 && there) {
            let end = (u32::from(item[10]) << 8 | u32::from(item[11])) / 8 + 4 * u32::from(word(item, 4)) + 8;
            let bytes = self.data_bytes.entry(word(item, 6)).or_default();
            *bytes = end.max(*bytes);
        }
    }

    fn source(&self) -> String {
        let mut out = String::new();
        let mut all = self.there.clone();
        all.extend(self.data_bytes.keys().map(|number| ((BlockType::Db, *number), true)));
        all.insert((BlockType::Ob, 1), true);
        all.extend(self.watched.keys().map(|block| (*block, true)));
        for ((ty, number), _) in all.iter().filter(|(_, there)| **there) {
            let text = self.statements((*ty, *number));
            let _ = match ty {
                BlockType::Ob => write!(out, "ORGANIZATION_BLOCK OB {number}\nBEGIN\n{text}END_ORGANIZATION_BLOCK\n"),
                BlockType::Fc => write!(out, "FUNCTION FC {number} : VOID\nBEGIN\n{text}END_FUNCTION\n"),
                BlockType::Fb => write!(out, "FUNCTION_BLOCK FB {number}\nBEGIN\n{text}END_FUNCTION_BLOCK\n"),
                BlockType::Db => {
                    let last = self.data_bytes.get(number).copied().unwrap_or(100).max(100) - 1;
                    write!(
                        out,
                        "DATA_BLOCK DB {number}\nSTRUCT\n a : ARRAY[0..{last}] OF BYTE;\nEND_STRUCT\nBEGIN\n\
                         END_DATA_BLOCK\n"
                    )
                }
                BlockType::Sdb | BlockType::Sfc | BlockType::Sfb => Ok(()),
            };
        }
        out
    }

    /// Statements whose lengths are those between the watched addresses.
    fn statements(&self, block: (BlockType, u16)) -> String {
        let addresses = self.watched.get(&block).map_or(&[0][..], Vec::as_slice);
        let lengths = addresses.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).chain([4]);
        let statement = |length| match length {
            2 => "      NOP   0;\n",
            6 => "      L     L#100000;\n",
            _ => "      L     1;\n",
        };
        std::iter::repeat_n(statement(2), usize::from(addresses[0] / 2)).chain(lengths.map(statement)).collect()
    }
}

/// System data in the form of a block: as many bytes as one of a 315 without anything configured.
fn system_data(number: u16) -> Vec<u8> {
    let mut block = vec![0x70, 0x70, 3, 2, 7, 0x0B];
    block.extend_from_slice(&number.to_be_bytes());
    block.extend_from_slice(&216_u32.to_be_bytes());
    block.resize(216, 0);
    block[34..36].copy_from_slice(&144_u16.to_be_bytes());
    block
}

/// The station in RUN, and the port of its link.
pub(super) fn start(site: &Site, conversations: &[Conversation]) -> (Running, u16) {
    let wanted = Wanted::of(conversations);
    let port = free_port();
    site.write("plant.awl", &wanted.source());
    site.write(
        "station.toml",
        &format!(
            "[station]\nname = \"recorded\"\n\n[cpu]\nmin_cycle = \"2ms\"\nwatchdog = \"10s\"\nmemory_bytes = 2048\n\
             process_image = {{ inputs = 2048, outputs = 2048 }}\norder = \"6ES7 315-2EH14-0AB0\"\n\n\
             [program]\nsources = [\"plant.awl\"]\n\n\
             [[link]]\ntype = \"s7\"\nname = \"desk\"\nlisten = \"127.0.0.1:{port}\"\nrights = \"operate\"\npdu = 240\n"
        ),
    );
    let station = site.run("station.toml").until_run();
    let mut device = station.until("the link listens", |_| connect(port));
    // System data comes by the network only, and in STOP.
    assert_eq!(device.stop().expect("a wire"), Ok(()));
    let there = wanted.there.iter().filter(|((ty, _), there)| *ty == BlockType::Sdb && **there);
    for number in there.map(|((_, number), _)| *number).chain([0]) {
        device.download(BlockType::Sdb, number, &system_data(number)).expect("a wire").expect("loaded");
        device.link(&[(BlockType::Sdb, number)]).expect("a wire").expect("linked");
    }
    assert_eq!(device.control(b"", b"P_PROGRAM").expect("a wire"), Ok(()));
    (station, port)
}
