//! Status lists, lists of blocks and the clock.

use super::long::{ENTRY, MOST, refused};
use super::service::Service;
use super::{Ask, Connection, Listed, Step, test_functions};
use crate::Rights;
use crate::codes::Code;
use crate::wire::{BlockInfo, BlockName, BlockType, DateTime, FileSystem, Group, UserData, sub};

/// List of the protection of the CPU, and the index of its record.
const PROTECTION: [u16; 2] = [0x0132, 0x0232];
const PROTECTION_INDEX: u16 = 4;
/// Offsets in the record of the level that a password lifts (0: there is none) and of that in force, words.
const SET_AT: usize = 4;
const LEVEL_AT: usize = 6;
/// List of communication capabilities, the index of its general record, and in it the offset of the PDU and the
/// connections, words.
const CAPABILITIES: u16 = 0x0131;
const GENERAL_INDEX: u16 = 1;
const PDU_AT: usize = 2;
/// The index of its record of test functions, and the offset of their bits in it.
const TESTS_INDEX: u16 = 2;
const TESTS_AT: usize = 2;
/// The extract of a list that stands for "header only".
const HEADER_ONLY: u16 = 0x0F00;
/// The list of the operating state; in its record the state is the low half of this byte.
pub const OPERATING_STATE: u16 = 0x0424;
/// The offset of that byte.
pub const STATE_AT: usize = 3;
/// The header of the list of connections, and the places that it tells though nothing is in them. [recorded]
const CONNECTIONS: u16 = 0x0F3A;
const PLACES: u16 = 8;

impl Connection {
    pub(super) fn szl(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let Some(&[a, b, c, d]) = service.data.first_chunk::<4>() else {
            return self.refuse_service(reference, service, Code::NO_INFORMATION);
        };
        let (id, index) = (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        let asked = if id & HEADER_ONLY == HEADER_ONLY { id & !HEADER_ONLY } else { id };
        Self::later(Ask::Szl { id: asked, index }, Service::Szl { id, index })
    }

    pub(super) fn szl_answer(&mut self, reference: u16, id: u16, index: u16, record: u16, bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::with_capacity(8 + bytes.len());
        let header_only = id & HEADER_ONLY == HEADER_ONLY;
        let count = match bytes.len().checked_div(usize::from(record)).unwrap_or(0) {
            0 if id == CONNECTIONS => PLACES,
            count => count as u16,
        };
        // There is one record whatever is asked, and the answer says so.
        let index = if id == OPERATING_STATE { 0 } else { index };
        for word in [id, index, record, count] {
            out.extend_from_slice(&word.to_be_bytes());
        }
        let bytes = if header_only { &[] } else { bytes };
        out.extend_from_slice(bytes.get(..MOST).unwrap_or(bytes));
        // Of the record: a client may ask for index 0.
        let told = out.get(8..).and_then(|record| record.first_chunk()).copied().map(u16::from_be_bytes);
        if id == CAPABILITIES && told == Some(GENERAL_INDEX) {
            let [a, b] = self.settings.pdu.to_be_bytes();
            let [c, d] = self.settings.connections.to_be_bytes();
            if let Some(place) = out.get_mut(8 + PDU_AT..12 + PDU_AT) {
                place.copy_from_slice(&[a, b, c, d]);
            }
        }
        if id == CAPABILITIES
            && told == Some(TESTS_INDEX)
            && let Some(place) = out.get_mut(8 + TESTS_AT..8 + TESTS_AT + 3)
        {
            place.copy_from_slice(&test_functions::bits(self.settings.is_400));
        }
        // The level in force is that of this connection: 1 all, 2 no changes of program and operating state.
        if PROTECTION.contains(&id) && told == Some(PROTECTION_INDEX) {
            let level = |rights| if rights >= Rights::Operate { 1_u16 } else { 2 };
            let set = if self.settings.has_password { level(self.settings.rights) } else { 0 };
            if let Some(place) = out.get_mut(8 + SET_AT..10 + LEVEL_AT) {
                let [a, b] = set.to_be_bytes();
                let [c, d] = level(self.rights).to_be_bytes();
                place.copy_from_slice(&[a, b, c, d]);
            }
        }
        let pdu = self.pdu_bytes();
        self.long.first(reference, Group::Cpu, sub::SZL, out, pdu)
    }

    pub(super) fn lists(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let ty = match service.data {
            [b'0', letter, ..] => BlockType::of(*letter),
            _ => None,
        };
        match service.sub {
            sub::BLOCK_COUNTS => Self::later(Ask::Blocks, Service::Counts),
            sub::BLOCK_LIST => match ty {
                Some(ty) => Self::later(Ask::Blocks, Service::List(ty)),
                None => self.refuse_service(reference, service, Code::BLOCK_NAME),
            },
            sub::BLOCK_INFO => match BlockName::read(service.data) {
                Some(name) if name.place == FileSystem::Passive => {
                    self.refuse_service(reference, service, Code::NO_BLOCK)
                }
                Some(name) => Self::later(Ask::Block { ty: name.ty, number: name.number }, Service::Info),
                None => self.refuse_service(reference, service, Code::BLOCK_NAME),
            },
            _ => self.refuse_service(reference, service, Code::NO_INFORMATION),
        }
    }

    pub(super) fn counts_answer(&mut self, reference: u16, blocks: &[Listed]) -> Vec<u8> {
        let mut out = Vec::new();
        for ty in BlockType::ALL {
            let count = blocks.iter().filter(|block| block.ty == ty).count();
            out.extend_from_slice(&[b'0', ty.letter()]);
            out.extend_from_slice(&(count as u16).to_be_bytes());
        }
        let pdu = self.pdu_bytes();
        self.long.first(reference, Group::Blocks, sub::BLOCK_COUNTS, out, pdu)
    }

    pub(super) fn list_answer(&mut self, reference: u16, ty: BlockType, blocks: &[Listed]) -> Vec<u8> {
        let mut of_type: Vec<&Listed> = blocks.iter().filter(|block| block.ty == ty).collect();
        of_type.sort_by_key(|block| block.number);
        of_type.truncate(MOST / ENTRY);
        if of_type.is_empty() {
            self.counts.errors += 1;
            return refused(reference, Group::Blocks, sub::BLOCK_LIST, Code::NO_MORE_BLOCKS);
        }
        let mut out = Vec::with_capacity(of_type.len() * ENTRY);
        for block in of_type {
            out.extend_from_slice(&block.number.to_be_bytes());
            out.extend_from_slice(&[block.ty.flags(), block.language]);
        }
        let pdu = self.pdu_bytes();
        self.long.first(reference, Group::Blocks, sub::BLOCK_LIST, out, pdu)
    }

    pub(super) fn info_answer(&mut self, reference: u16, block: &[u8]) -> Vec<u8> {
        let Some(info) = BlockInfo::of(block) else {
            self.counts.errors += 1;
            return refused(reference, Group::Blocks, sub::BLOCK_INFO, Code::NO_BLOCK);
        };
        let pdu = self.pdu_bytes();
        self.long.first(reference, Group::Blocks, sub::BLOCK_INFO, info.bytes(), pdu)
    }

    pub(super) fn clock(&mut self, reference: u16, service: &UserData<'_>) -> Step {
        let sub = service.sub;
        match sub {
            sub::CLOCK | sub::FOLLOWING_CLOCK => Self::later(Ask::Clock, Service::Clock { sub }),
            sub::SET_CLOCK | sub::SET_FOLLOWING_CLOCK if !self.may(Rights::Operate) => {
                self.refuse_service(reference, service, Code::PROTECTED)
            }
            sub::SET_CLOCK | sub::SET_FOLLOWING_CLOCK => match DateTime::read(service.data) {
                Some(time) => Self::later(Ask::SetClock(time), Service::SetClock { sub }),
                None => self.refuse_service(reference, service, Code::CLOCK),
            },
            _ => self.refuse_service(reference, service, Code::NO_INFORMATION),
        }
    }
}
