//! A connection between two CPUs: the caller sets it up, and both sides send jobs and serve the partner's.

use super::{Agreed, Connection, End, Settings};
use crate::client::Came;
use crate::codes::Code;
use crate::iso::{Transport, Tsap};
use crate::wire::{Kind, Pdu, function, pbc, write};
use crate::{MAX_JOBS, MIN_PDU};

/// Maximum of received telegrams not taken yet; beyond that the partner has to wait.
const CAME: usize = 16;

/// The additional state of a connection to another CPU.
#[derive(Debug, Default)]
pub(super) struct Partner {
    /// We have called, so we send the setup.
    calls: bool,
    /// Number of the setup not answered yet.
    setup: Option<u16>,
    reference: u16,
    /// Our jobs not answered yet.
    own: Vec<u16>,
    came: std::collections::VecDeque<Came>,
}

impl Connection {
    /// Calls another CPU; the call is in the output.
    #[must_use]
    pub fn calling(settings: Settings, calling: Tsap, called: Tsap) -> Self {
        let mut connection = Self::new(settings);
        connection.transport.call(calling, called);
        connection.partner = Some(Partner { calls: true, ..Partner::default() });
        connection
    }

    /// Accepts the call of another CPU that this transport contains.
    #[must_use]
    pub fn called(settings: Settings, transport: Transport) -> Self {
        let mut connection = Self::new(settings);
        connection.transport = transport;
        connection.partner = Some(Partner::default());
        connection.accept();
        connection
    }

    /// The transport of a caller, for the connection that the call is meant for.
    #[must_use]
    pub fn into_transport(self) -> Transport {
        self.transport
    }

    /// Number of our jobs that may be sent now.
    #[must_use]
    pub fn places(&self) -> usize {
        match (&self.partner, self.agreed, self.end) {
            (Some(partner), Some(agreed), None) => agreed.own.saturating_sub(partner.own.len()),
            _ => 0,
        }
    }

    /// Sends a job of ours; returns its number.
    pub fn own_job(&mut self, kind: Kind, parameters: &[u8], data: &[u8]) -> u16 {
        let Some(partner) = &mut self.partner else { return 0 };
        partner.reference = partner.reference.wrapping_add(1);
        let reference = partner.reference;
        partner.own.push(reference);
        self.transport.send(&write(kind, reference, Code::DONE, parameters, data));
        reference
    }

    /// Sends a message without an answer.
    pub fn own_message(&mut self, parameters: &[u8], data: &[u8]) {
        let Some(partner) = &mut self.partner else { return };
        partner.reference = partner.reference.wrapping_add(1);
        self.transport.send(&write(Kind::UserData, partner.reference, Code::DONE, parameters, data));
    }

    /// Answers a telegram from [`Connection::take_came`].
    pub fn answer(&mut self, telegram: &[u8]) {
        self.transport.send(telegram);
    }

    /// The next answer to a job of ours, or the next telegram of the partner's sending blocks.
    pub fn take_came(&mut self) -> Option<Came> {
        let came = self.partner.as_mut()?.came.pop_front();
        if came.is_some() {
            self.advance();
        }
        came
    }

    /// The transport is open.
    pub(super) fn opened(&mut self) {
        if !self.partner.as_ref().is_some_and(|partner| partner.calls) {
            self.end = Some(End::Closed);
            return;
        }
        let [jobs_high, jobs_low] = MAX_JOBS.to_be_bytes();
        let [high, low] = self.settings.pdu.to_be_bytes();
        let setup = [function::SETUP, 0, jobs_high, jobs_low, jobs_high, jobs_low, high, low];
        let reference = self.own_job(Kind::Job, &setup, &[]);
        if let Some(partner) = &mut self.partner {
            partner.setup = Some(reference);
        }
    }

    pub(super) fn is_full(&self) -> bool {
        self.partner.as_ref().is_some_and(|partner| partner.came.len() >= CAME)
    }

    /// Handles a telegram for our own blocks. False: it is for the server.
    pub(super) fn partner_telegram(&mut self, pdu: &Pdu<'_>) -> bool {
        let Some(partner) = &mut self.partner else { return false };
        let is_answer = match pdu.kind {
            Kind::Job => return false,
            Kind::Answer | Kind::Ack => true,
            Kind::UserData => pbc::is_answer(pdu.parameters),
        };
        if is_answer {
            let Some(index) = partner.own.iter().position(|own| *own == pdu.reference) else {
                // An answer to a job of the server (a download continues), or to none.
                return pdu.kind == Kind::UserData;
            };
            partner.own.swap_remove(index);
            if partner.setup.take_if(|setup| *setup == pdu.reference).is_some() {
                self.agree(pdu);
                return true;
            }
        } else if !pbc::is_for_blocks(pdu.parameters) {
            return false;
        }
        if let Some(partner) = &mut self.partner {
            partner.came.push_back(Came {
                kind: pdu.kind,
                reference: pdu.reference,
                error: pdu.error,
                parameters: pdu.parameters.to_vec(),
                data: pdu.data.to_vec(),
            });
        }
        true
    }

    /// The answer to our setup.
    fn agree(&mut self, pdu: &Pdu<'_>) {
        let agreed = match pdu.parameters {
            &[function::SETUP, _, a, b, c, d, e, f] if pdu.error == Code::DONE => {
                let word = |high, low| u16::from_be_bytes([high, low]);
                let jobs = |word: u16| usize::from(word.clamp(1, MAX_JOBS));
                let bytes = word(e, f);
                let fits = (MIN_PDU..=self.settings.pdu).contains(&bytes);
                fits.then(|| Agreed { pdu: usize::from(bytes), own: jobs(word(a, b)), jobs: jobs(word(c, d)) })
            }
            _ => None,
        };
        match agreed {
            Some(agreed) => self.agreed = Some(agreed),
            None => self.end = Some(End::NotS7),
        }
    }
}
