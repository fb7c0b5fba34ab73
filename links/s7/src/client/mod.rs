//! A connection as a programming device sees it: jobs out, answers back, one at a time.
//!
//! [`Client`] knows telegrams and their order; [`jobs`] builds the jobs and evaluates the answers. The owner of the
//! socket passes bytes in and takes bytes out.

pub mod jobs;
mod observer;

use std::collections::VecDeque;

pub use observer::Observer;

use crate::codes::Code;
use crate::iso::{Broken, Event, Place, Resource, Transport, Tsap};
use crate::wire::{Kind, Pdu, function, write};
use crate::{MAX_JOBS, MAX_PDU};

/// Why a connection cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The partner refuses the connection, with this reason.
    Refused(u8),
    /// The received bytes are not ISO transport.
    Broken(Broken),
    /// The received telegram is not S7 communication, or not the expected answer.
    NotS7,
    /// The partner refuses the setup.
    Setup(Code),
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            // To some clients a CPU in another slot and one without free connections look the same.
            Self::Refused(3) => f.write_str("the partner has no such rack and slot (try --rack and --slot)"),
            Self::Refused(1) => f.write_str("all connections of the partner are taken"),
            Self::Refused(reason) => write!(f, "the partner refuses the connection (reason {reason:02X})"),
            Self::Broken(_) => f.write_str("the partner does not speak ISO on TCP"),
            Self::NotS7 => f.write_str("the partner does not speak S7 communication, or answers something else"),
            Self::Setup(code) => write!(f, "the partner refuses the setup: {code}"),
        }
    }
}

impl std::error::Error for Failure {}

/// An answer, or a job of the partner (in a download).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Came {
    /// Job, answer, or service.
    pub kind: Kind,
    /// Number of the job, which its answer copies.
    pub reference: u16,
    /// The outcome of the job.
    pub error: Code,
    /// The parameters: function, and what belongs to it.
    pub parameters: Vec<u8>,
    /// The data behind the parameters; empty for some jobs.
    pub data: Vec<u8>,
}

/// A connection of a programming device.
#[derive(Debug)]
pub struct Client {
    transport: Transport,
    pdu: Option<u16>,
    reference: u16,
    came: VecDeque<Came>,
}

impl Client {
    /// Calls the CPU in this place as a programming device; the call is in the output.
    #[must_use]
    pub fn call(place: Place) -> Self {
        let mut transport = Transport::new();
        transport.call(Tsap::of(Resource::Pg, Place { rack: 0, slot: 0 }), Tsap::of(Resource::Pg, place));
        Self { transport, pdu: None, reference: 0, came: VecDeque::new() }
    }

    /// Number of bytes that [`Client::receive`] accepts now.
    #[must_use]
    pub const fn room(&self) -> usize {
        self.transport.room()
    }

    /// Bytes from the wire.
    ///
    /// # Errors
    /// [`Failure`]: the partner refuses, or its bytes make no sense. The connection is of no use then.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.transport.receive(bytes).map_err(Failure::Broken)?;
        while let Some(event) = self.transport.event().map_err(Failure::Broken)? {
            match event {
                Event::Open => {
                    let [high, low] = MAX_JOBS.to_be_bytes();
                    let [pdu_high, pdu_low] = MAX_PDU.to_be_bytes();
                    self.job(&[function::SETUP, 0, high, low, high, low, pdu_high, pdu_low], &[]);
                }
                Event::Message(message) => self.telegram(&message)?,
                Event::Ended(reason) => return Err(Failure::Refused(reason)),
                Event::Call(_) => return Err(Failure::NotS7),
            }
        }
        Ok(())
    }

    fn telegram(&mut self, message: &[u8]) -> Result<(), Failure> {
        let pdu = Pdu::read(message).ok_or(Failure::NotS7)?;
        if self.pdu.is_none() {
            if pdu.error != Code::DONE {
                return Err(Failure::Setup(pdu.error));
            }
            let agreed = pdu.parameters.get(6..8).and_then(|bytes| bytes.first_chunk::<2>());
            let agreed = agreed.map(|bytes| u16::from_be_bytes(*bytes)).filter(|_| pdu.kind == Kind::Answer);
            self.pdu = Some(agreed.filter(|pdu| *pdu >= crate::MIN_PDU).ok_or(Failure::NotS7)?);
            return Ok(());
        }
        self.came.push_back(Came {
            kind: pdu.kind,
            reference: pdu.reference,
            error: pdu.error,
            parameters: pdu.parameters.to_vec(),
            data: pdu.data.to_vec(),
        });
        Ok(())
    }

    /// The agreed PDU, when the connection is ready for jobs.
    #[must_use]
    pub const fn pdu(&self) -> Option<u16> {
        self.pdu
    }

    /// Sends a job; returns its number.
    pub fn job(&mut self, parameters: &[u8], data: &[u8]) -> u16 {
        self.reference = self.reference.wrapping_add(1);
        self.transport.send(&write(Kind::Job, self.reference, Code::DONE, parameters, data));
        self.reference
    }

    /// Sends a service of a programming device; returns its number.
    pub fn service(&mut self, service: &crate::wire::UserData<'_>) -> u16 {
        self.reference = self.reference.wrapping_add(1);
        self.transport.send(&service.write(self.reference));
        self.reference
    }

    /// Answers a job of the partner.
    pub fn answer(&mut self, reference: u16, parameters: &[u8], data: &[u8]) {
        self.transport.send(&write(Kind::Answer, reference, Code::DONE, parameters, data));
    }

    /// The next received telegram.
    pub fn take(&mut self) -> Option<Came> {
        self.came.pop_front()
    }

    /// The bytes to send.
    #[must_use]
    pub fn output(&self) -> &[u8] {
        self.transport.output()
    }

    /// Reports that `count` bytes of the output have been sent.
    pub fn sent(&mut self, count: usize) {
        self.transport.sent(count);
    }
}
