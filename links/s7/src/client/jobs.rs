//! The jobs of a programming device, as dialogues over any wire.
//!
//! [`Wire`] moves telegrams: it sends a client's output to the partner and passes the replies to the client. Everything
//! else is here, and is the same over a socket and in a test.

use super::{Came, Client, Failure};
use crate::codes::{Code, ItemCode};
use crate::wire::{
    Address, BlockName, BlockType, DataItems, DateTime, FileSystem, Group, Kind, UserData, function, sub,
};

/// Bytes of a part of a download: head, parameters, length and mark.
const PART: usize = crate::wire::ANSWER_HEAD + 2 + 4;
/// Bytes of a job that links blocks, without their names: head, the fixed parameters, number of blocks, service.
const LINK: usize = crate::wire::JOB_HEAD + 10 + 2 + 1 + LINK_NAME.len();
const LINK_NAME: &[u8] = b"_INSE";
/// A limit above the parts of any block or list.
const PARTS: usize = 100_000;

/// Moves bytes until something has come.
pub trait Wire {
    /// What can go wrong on the way, a [`Failure`] of the client included.
    type Error: From<Failure>;
    /// Sends the client's output, then waits for bytes and gives them to it.
    ///
    /// # Errors
    /// The partner is gone, or does not answer.
    fn exchange(&mut self, client: &mut Client) -> Result<(), Self::Error>;
}

/// Why a job has no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The partner refused the job.
    Job(Code),
    /// The partner refused an item.
    Item(ItemCode),
    /// The answer does not belong to this job.
    Answer,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Job(code) => code.fmt(f),
            Self::Item(code) => code.fmt(f),
            Self::Answer => f.write_str("the answer does not fit the job"),
        }
    }
}

/// A result, or why there is none; the outer error is that of the wire.
pub type Done<T, W> = Result<Result<T, Refused>, <W as Wire>::Error>;

/// A connected programming device.
#[derive(Debug)]
pub struct Device<W> {
    client: Client,
    wire: W,
}

impl<W: Wire> Device<W> {
    /// Waits until the connection is set up.
    ///
    /// # Errors
    /// The wire's error: the partner is gone or silent, or refuses the connection or its setup ([`Failure`]).
    pub fn connect(mut client: Client, mut wire: W) -> Result<Self, W::Error> {
        while client.pdu().is_none() {
            wire.exchange(&mut client)?;
        }
        Ok(Self { client, wire })
    }

    /// The next telegram for us; waits for it on the wire.
    fn next(&mut self) -> Result<Came, W::Error> {
        loop {
            if let Some(came) = self.client.take() {
                return Ok(came);
            }
            self.wire.exchange(&mut self.client)?;
        }
    }

    /// The answer to the job of this number; other messages in between are skipped.
    fn answer(&mut self, reference: u16) -> Done<Came, W> {
        loop {
            let came = self.next()?;
            if came.reference == reference && came.kind != Kind::Job {
                return Ok(if came.error == Code::DONE { Ok(came) } else { Err(Refused::Job(came.error)) });
            }
        }
    }

    fn job(&mut self, parameters: &[u8]) -> Done<Came, W> {
        let reference = self.client.job(parameters, &[]);
        self.answer(reference)
    }

    /// Runs a service and joins all parts of its answer.
    fn service(&mut self, group: Group, sub: u8, data: &[u8]) -> Done<Vec<u8>, W> {
        let mut job = UserData::job(group, sub, data);
        let mut all = Vec::new();
        for _ in 0..PARTS {
            let reference = self.client.service(&job);
            let came = match self.answer(reference)? {
                Ok(came) => came,
                Err(why) => return Ok(Err(why)),
            };
            let Some(answer) = UserData::read(&came.parameters, &came.data) else { return Ok(Err(Refused::Answer)) };
            if answer.error != Code::DONE {
                return Ok(Err(Refused::Job(answer.error)));
            }
            all.extend_from_slice(answer.data);
            if !answer.more {
                return Ok(Ok(all));
            }
            job = UserData { more: true, sequence: answer.sequence, ..UserData::job(group, sub, &[]) };
        }
        Ok(Err(Refused::Answer))
    }

    /// Values of addresses, as many as fit into a PDU.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn read(&mut self, addresses: &[Address]) -> Done<Vec<Result<Vec<u8>, ItemCode>>, W> {
        let mut parameters = vec![function::READ, addresses.len() as u8];
        addresses.iter().for_each(|address| address.write(&mut parameters));
        Ok(self.job(&parameters)?.and_then(|came| {
            let items: Option<Vec<_>> = DataItems::new(&came.data).take(addresses.len()).collect();
            let items = items.filter(|items| items.len() == addresses.len()).ok_or(Refused::Answer)?;
            let value = |item: crate::wire::DataItem<'_>| {
                if item.code == ItemCode::DONE { Ok(item.bytes.to_vec()) } else { Err(item.code) }
            };
            Ok(items.into_iter().map(value).collect())
        }))
    }

    /// A system status list: bytes of a record, and the records.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn szl(&mut self, id: u16, index: u16) -> Done<(u16, Vec<u8>), W> {
        let wanted = [id.to_be_bytes(), index.to_be_bytes()].concat();
        Ok(self.service(Group::Cpu, sub::SZL, &wanted)?.and_then(|data| {
            let (&[_, _, _, _, high, low, _, _], records) = data.split_first_chunk::<8>().ok_or(Refused::Answer)?;
            Ok((u16::from_be_bytes([high, low]), records.to_vec()))
        }))
    }

    /// Date and time of the CPU.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn clock(&mut self) -> Done<DateTime, W> {
        let data = self.service(Group::Clock, sub::CLOCK, &[])?;
        Ok(data.and_then(|data| DateTime::read(&data).ok_or(Refused::Answer)))
    }

    /// Gives the password, which extends the rights of the connection.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); a wrong password is the inner result.
    pub fn login(&mut self, password: &str) -> Done<(), W> {
        let Some(bytes) = crate::wire::encode_password(password) else {
            return Ok(Err(Refused::Job(Code::PASSWORD)));
        };
        Ok(self.service(Group::Security, sub::PASSWORD, &bytes)?.map(drop))
    }

    /// The numbers of all blocks of a type; none is no error.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn blocks(&mut self, ty: BlockType) -> Done<Vec<u16>, W> {
        let data = match self.service(Group::Blocks, sub::BLOCK_LIST, &[b'0', ty.letter()])? {
            Err(Refused::Job(Code::NO_MORE_BLOCKS | Code::NO_BLOCK)) => Vec::new(),
            Err(why) => return Ok(Err(why)),
            Ok(data) => data,
        };
        let (entries, rest) = data.as_chunks::<4>();
        if !rest.is_empty() {
            return Ok(Err(Refused::Answer));
        }
        Ok(Ok(entries.iter().map(|entry| u16::from_be_bytes([entry[0], entry[1]])).collect()))
    }

    /// A whole block: header, code or values, interface, segments, foot.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); a block that is not there is the inner result.
    pub fn upload(&mut self, ty: BlockType, number: u16) -> Done<Vec<u8>, W> {
        let name = BlockName { ty, number, place: FileSystem::Active }.text();
        let start = [&[function::START_UPLOAD, 0, 0, 0, 0, 0, 0, 0, 9, b'_'][..], &name].concat();
        let started = match self.job(&start)? {
            Ok(came) => came,
            Err(why) => return Ok(Err(why)),
        };
        let Some(&[a, b, c, d]) = started.parameters.get(4..).and_then(<[u8]>::first_chunk::<4>) else {
            return Ok(Err(Refused::Answer));
        };
        let part = [function::UPLOAD, 0, 0, 0, a, b, c, d];
        let mut block = Vec::new();
        for _ in 0..PARTS {
            let came = match self.job(&part)? {
                Ok(came) => came,
                Err(why) => return Ok(Err(why)),
            };
            let (Some(bytes), Some(more)) = (self::part(&came.data), came.parameters.get(1)) else {
                return Ok(Err(Refused::Answer));
            };
            block.extend_from_slice(bytes);
            if *more == 0 {
                break;
            }
        }
        Ok(self.job(&[function::END_UPLOAD, 0, 0, 0, a, b, c, d])?.map(|_| block))
    }

    /// Loads a block; it takes effect when it is linked ([`Device::link`]).
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn download(&mut self, ty: BlockType, number: u16, block: &[u8]) -> Done<(), W> {
        let name = BlockName { ty, number, place: FileSystem::Passive }.text();
        let code = block.get(34..36).and_then(<[u8]>::first_chunk::<2>).map_or(0, |len| u16::from_be_bytes(*len));
        let sizes = format!("1{:06}{code:06}", block.len());
        let start = [&[function::REQUEST_DOWNLOAD, 0, 1, 0, 0, 0, 0, 0, 9, b'_'][..], &name, &[13], sizes.as_bytes()];
        if let Err(why) = self.job(&start.concat())? {
            return Ok(Err(why));
        }
        let most = self.pdu().saturating_sub(PART).max(1);
        let mut parts = block.chunks(most).peekable();
        loop {
            // From here on the partner sends the jobs.
            let came = self.next()?;
            match (came.kind, came.parameters.first().copied()) {
                (Kind::Job, Some(function::DOWNLOAD)) => {
                    let bytes = parts.next().unwrap_or_default();
                    let data = [&(bytes.len() as u16).to_be_bytes()[..], &[0, 0xFB], bytes].concat();
                    let more = u8::from(parts.peek().is_some());
                    self.client.answer(came.reference, &[function::DOWNLOAD, more], &data);
                }
                (Kind::Job, Some(function::DOWNLOAD_ENDED)) => {
                    self.client.answer(came.reference, &[function::DOWNLOAD_ENDED], &[]);
                    return Ok(Ok(()));
                }
                // A message in between.
                (Kind::UserData, _) => {}
                _ => return Ok(Err(Refused::Answer)),
            }
        }
    }

    /// The agreed PDU: bytes of a telegram. An S7-300 has 240.
    #[must_use]
    pub fn pdu(&self) -> usize {
        usize::from(self.client.pdu().unwrap_or(crate::MIN_PDU))
    }

    /// How many blocks [`Device::link`] takes: their names are in one telegram.
    #[must_use]
    pub fn linkable(&self) -> usize {
        (self.pdu().saturating_sub(LINK) / BlockName::BYTES).clamp(1, usize::from(u8::MAX))
    }

    /// Links blocks that were loaded into the program, together; at most [`Device::linkable`].
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn link(&mut self, blocks: &[(BlockType, u16)]) -> Done<(), W> {
        let mut argument = vec![blocks.len() as u8, 0];
        for (ty, number) in blocks {
            argument.extend_from_slice(&BlockName { ty: *ty, number: *number, place: FileSystem::Passive }.text());
        }
        self.control(&argument, LINK_NAME)
    }

    /// A program invocation service.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn control(&mut self, argument: &[u8], name: &[u8]) -> Done<(), W> {
        let mut parameters = vec![function::CONTROL, 0, 0, 0, 0, 0, 0, 0xFD];
        parameters.extend_from_slice(&(argument.len() as u16).to_be_bytes());
        parameters.extend_from_slice(argument);
        parameters.push(name.len() as u8);
        parameters.extend_from_slice(name);
        Ok(self.job(&parameters)?.map(drop))
    }

    /// Takes the CPU to STOP.
    ///
    /// # Errors
    /// The wire's error ([`Wire::exchange`]); what the partner refuses is the inner result.
    pub fn stop(&mut self) -> Done<(), W> {
        let parameters = [&[function::STOP, 0, 0, 0, 0, 0, 9][..], b"P_PROGRAM"].concat();
        Ok(self.job(&parameters)?.map(drop))
    }
}

/// A part: the length, a mark, and the bytes.
fn part(data: &[u8]) -> Option<&[u8]> {
    let (&[high, low, _, _], bytes) = data.split_first_chunk::<4>()?;
    bytes.get(..usize::from(u16::from_be_bytes([high, low])))
}
