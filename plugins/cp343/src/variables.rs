//! PUT and GET: FB 15 and 14 of an S7-300, SFB 15 and 14 of an S7-400.

use ob1_sdk::{Abort, Cx};
use ob1_words::boxes::Service;

use crate::partner::{Pair, Sender, both, items};
use crate::state::CpState;
use ob1_siemens::outputs::Outputs;

both! {
    /// FB 15, SFB 15: PUT.
    Put = "PUT" 15: mod put, put4 {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Word;
        /// For one call: the partner has written the data.
        out    DONE: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error; 11: REQ came while a job was running, 25: the job is running.
        out    STATUS: Word;
    }
    in_out { ADDR_1: Any; SD_1: Any; }
    in_out { ADDR_1: Any; ADDR_2: Any; ADDR_3: Any; ADDR_4: Any; SD_1: Any; SD_2: Any; SD_3: Any; SD_4: Any; }
}

impl<const FOUR: bool> Put<FOUR> {
    fn run(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        let pairs: &[Pair] = if FOUR {
            &[
                (put4::SD_1, put4::ADDR_1),
                (put4::SD_2, put4::ADDR_2),
                (put4::SD_3, put4::ADDR_3),
                (put4::SD_4, put4::ADDR_4),
            ]
        } else {
            &[(put::SD_1, put::ADDR_1)]
        };
        let outputs = Outputs { end: put::DONE, error: put::ERROR, status: put::STATUS };
        let at = (cx.get(put::ID)?, 0);
        let sender = Sender { req: put::REQ, memory: Self::MEMORY, outputs };
        sender.call(cx, Service::Put, at, |cx, wanted| {
            Ok(items(cx, wanted, pairs)?.map(|spans| wanted.source = spans))
        })?;
        Ok(())
    }
}

both! {
    /// FB 14, SFB 14: GET.
    Get = "GET" 14: mod get, get4 {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Word;
        /// For one call: the data have been stored.
        out    NDR: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error; 11: REQ came while a job was running, 25: the job is running.
        out    STATUS: Word;
    }
    in_out { ADDR_1: Any; RD_1: Any; }
    in_out { ADDR_1: Any; ADDR_2: Any; ADDR_3: Any; ADDR_4: Any; RD_1: Any; RD_2: Any; RD_3: Any; RD_4: Any; }
}

impl<const FOUR: bool> Get<FOUR> {
    fn run(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        let pairs: &[Pair] = if FOUR {
            &[
                (get4::RD_1, get4::ADDR_1),
                (get4::RD_2, get4::ADDR_2),
                (get4::RD_3, get4::ADDR_3),
                (get4::RD_4, get4::ADDR_4),
            ]
        } else {
            &[(get::RD_1, get::ADDR_1)]
        };
        let outputs = Outputs { end: get::NDR, error: get::ERROR, status: get::STATUS };
        let at = (cx.get(get::ID)?, 0);
        let sender = Sender { req: get::REQ, memory: Self::MEMORY, outputs };
        sender.call(cx, Service::Get, at, |cx, wanted| {
            Ok(items(cx, wanted, pairs)?.map(|spans| wanted.target = spans))
        })?;
        Ok(())
    }
}
