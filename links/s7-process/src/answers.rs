//! Answers of the broker as replies of the server.

use ob1_access::door::{Answer, Refusal};
use ob1_s7::Rights;
use ob1_s7::codes::Code;
use ob1_s7::server::{CodePlaces, Listed, Reply};
use ob1_s7::wire::DateTime;

use crate::cells;

/// RET_VAL of SFC 51: no such list, no such index.
const NO_LIST: u16 = 0x8082;
const NO_INDEX: u16 = 0x8083;

/// Converts an answer of the broker to a reply.
pub(crate) fn answered(answer: &Answer, rights: Option<Rights>) -> Reply {
    match answer {
        Answer::Done => rights.map_or(Reply::Done, Reply::Rights),
        Answer::Clock(bytes) => DateTime::of_date_and_time(*bytes).map_or(Reply::Refused(Code::NOT_NOW), Reply::Clock),
        Answer::Szl { record, bytes } => Reply::Szl { record: *record, bytes: bytes.to_vec() },
        Answer::NoSzl(NO_LIST) => Reply::Refused(Code::NO_LIST),
        Answer::NoSzl(NO_INDEX) => Reply::Refused(Code::NO_INDEX),
        Answer::NoSzl(_) => Reply::Refused(Code::NOT_NOW),
        Answer::Blocks(facts) => {
            let listed = |fact: &ob1_access::door::BlockFact| Listed {
                ty: cells::ty(fact.id.kind),
                number: fact.id.number,
                language: fact.language,
            };
            Reply::Blocks(facts.iter().map(listed).collect())
        }
        Answer::Block(bytes) => Reply::Block(bytes.to_vec()),
        Answer::Refused(refusal) => Reply::Refused(match refusal {
            Refusal::Right => Code::PROTECTED,
            Refusal::Password => Code::PASSWORD,
            Refusal::NotThere => Code::NO_BLOCK,
            Refusal::InRun => Code::COORDINATION,
            Refusal::Block => Code::BLOCK,
            Refusal::Room => Code::BLOCK_SIZE,
            Refusal::Watched => Code::WATCHED,
            Refusal::Cell(_) | Refusal::Full | Refusal::Silent => Code::NOT_NOW,
        }),
        Answer::Addresses(found) => {
            Reply::Code(CodePlaces { code: found.code, statements: found.statements, found: found.found.clone() })
        }
        Answer::Debug(answer) => Reply::Debug(answer.clone()),
        Answer::LoggedOn { .. } => Reply::Done,
        Answer::Alarms { list, .. } => Reply::Alarms(list.clone()),
        Answer::Ordered(found) => Reply::Ordered(found.clone()),
        Answer::Forced(cells) => Reply::Forced(cells.clone()),
        Answer::Diagnostics(_)
        | Answer::Modules { .. }
        | Answer::Document { .. }
        | Answer::Pass(_)
        | Answer::Point(_) => Reply::Refused(Code::SERVICE),
    }
}
