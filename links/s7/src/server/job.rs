//! Jobs: kinds of telegrams, setup, and dispatch.

use super::{Agreed, Connection, End, Step};
use crate::codes::Code;
use crate::wire::{Kind, Pdu, function, write};
use crate::{MIN_PDU, Rights};

/// Parameters of setup: function, reserved, jobs of both sides, PDU.
const SETUP_BYTES: usize = 8;
/// The smallest PDU of an S7 CPU. The others, 480 and 960, are multiples of it.
const USUAL_PDU: usize = 240;

impl Connection {
    /// A whole telegram: a job, a service, or an answer of the partner.
    pub(super) fn telegram(&mut self, bytes: &[u8]) {
        let Some(pdu) = Pdu::read(bytes) else {
            self.end = Some(End::NotS7);
            return;
        };
        if self.partner_telegram(&pdu) {
            return;
        }
        let step = match pdu.kind {
            Kind::Job | Kind::UserData if bytes.len() > self.pdu_bytes() => {
                self.refuse_job(pdu.reference, Code::PDU_SIZE)
            }
            Kind::Job => self.job(&pdu),
            Kind::UserData => self.user_data(&pdu),
            Kind::Answer | Kind::Ack => {
                // An answer to our own job: a download continues.
                self.download_answer(&pdu);
                return;
            }
        };
        self.counts.jobs += 1;
        self.enqueue(pdu.reference, step);
    }

    fn job(&mut self, pdu: &Pdu<'_>) -> Step {
        let Some(function) = pdu.parameters.first().copied() else {
            return self.refuse_job(pdu.reference, Code::NO_SERVICE);
        };
        if self.agreed.is_none() && function != function::SETUP {
            return self.refuse_job(pdu.reference, Code::NO_SERVICE);
        }
        match function {
            function::SETUP => self.setup(pdu),
            function::READ => self.read(pdu),
            function::WRITE => self.write(pdu),
            function::CONTROL | function::STOP => self.control(pdu, function),
            function::START_UPLOAD => self.start_upload(pdu),
            function::UPLOAD => self.upload(pdu),
            function::END_UPLOAD => self.end_upload(pdu),
            function::REQUEST_DOWNLOAD => self.request_download(pdu),
            _ => self.refuse_job(pdu.reference, Code::NO_SERVICE),
        }
    }

    /// Setup may come again; running jobs keep their places.
    fn setup(&mut self, pdu: &Pdu<'_>) -> Step {
        let Some(&[_, _, a, b, c, d, e, f]) = pdu.parameters.first_chunk::<SETUP_BYTES>() else {
            return self.refuse_job(pdu.reference, Code::PDU_SIZE);
        };
        let word = |high, low| u16::from_be_bytes([high, low]);
        let bytes = self.whole(word(e, f).min(self.settings.pdu));
        if bytes < MIN_PDU {
            return self.refuse_job(pdu.reference, Code::PDU_SIZE);
        }
        let [calling, called] = [word(a, b), word(c, d)].map(|jobs| jobs.clamp(1, self.settings.jobs));
        self.agreed = Some(Agreed { pdu: usize::from(bytes), jobs: usize::from(calling), own: usize::from(called) });
        let mut parameters = vec![function::SETUP, 0];
        for agreed in [calling, called, bytes] {
            parameters.extend_from_slice(&agreed.to_be_bytes());
        }
        Step::Answer(write(Kind::Answer, pdu.reference, Code::DONE, &parameters, &[]))
    }

    /// A PDU of at most `bytes` whose telegrams fit one TPDU each. libnodave asks for TPDUs of 512 bytes and a PDU of
    /// 960, and takes the first fragment for the whole answer.
    fn whole(&self, bytes: u16) -> u16 {
        match self.transport.whole() {
            Some(most) if most < usize::from(bytes) => bytes.min((most / USUAL_PDU * USUAL_PDU).max(USUAL_PDU) as u16),
            _ => bytes,
        }
    }

    /// The job as a whole is refused, without parameters.
    pub(super) fn refuse_job(&mut self, reference: u16, why: Code) -> Step {
        self.counts.errors += 1;
        Step::Answer(write(Kind::Ack, reference, why, &[], &[]))
    }

    /// The job is refused; the answer repeats its function.
    pub(super) fn refuse_function(&mut self, reference: u16, function: u8, why: Code) -> Vec<u8> {
        self.counts.errors += 1;
        write(Kind::Answer, reference, why, &[function], &[])
    }

    pub(super) fn may(&self, right: Rights) -> bool {
        self.rights >= right
    }
}
