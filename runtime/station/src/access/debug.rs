//! Breakpoints and single step as the socket tells them.

use ob1_access::why::{find_block, place_of};
use ob1_model::{BREAKPOINTS, Breakpoint, DebugAnswer, DebugEnd, DebugOrder, PASS_WAIT, Resume};
use serde::{Deserialize, Serialize};

use super::pass::named;
use crate::program_facts::KnownProgram;

/// What a client wants of breakpoints and single step.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", tag = "do")]
pub enum DebugWanted {
    /// Breakpoints at these places, no others: `FB 20`, `FB 20:14` (a line of its source), `FB 20+3` (a statement, from
    /// 0). At most [`BREAKPOINTS`].
    Break {
        /// The places, each as above.
        at: Vec<String>,
    },
    /// Wait until the CPU holds.
    Wait {
        /// How long, in milliseconds.
        wait_ms: u64,
    },
    /// Leave HOLD, and wait until the CPU holds again.
    Go {
        /// How far it may go.
        to: GoTo,
        /// How long it is waited for, in milliseconds.
        wait_ms: u64,
    },
    /// No breakpoints any more. A CPU in HOLD goes to STOP.
    End,
    /// The stacks of a CPU in HOLD or in STOP. Whoever may read may ask.
    Stack {
        /// The local data of the block at this place of the stack: 0 is the innermost.
        #[serde(default)]
        level: u8,
    },
    /// In STOP: enables the peripheral outputs, or disables them. They are disabled again when the operating state
    /// changes or this client is gone.
    Outputs {
        /// Whether they can be written.
        enabled: bool,
    },
}

/// How far a CPU goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GoTo {
    /// To the next breakpoint.
    Run,
    /// One statement, into a block that it calls.
    Into,
    /// One statement, a called block included.
    Over,
    /// To the end of the running block.
    Out,
}

impl From<GoTo> for Resume {
    fn from(to: GoTo) -> Self {
        match to {
            GoTo::Run => Self::Run,
            GoTo::Into => Self::Into,
            GoTo::Over => Self::Over,
            GoTo::Out => Self::Out,
        }
    }
}

/// What has become of it, and where the CPU is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct DebugStatus {
    /// `done`, `held`, `runs` (it has not come to a breakpoint in time), `stopped`.
    pub outcome: String,
    /// The blocks under way, the innermost first; of `held`, and of `stopped` if the stacks are asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stack: Vec<DebugBlock>,
    /// The registers before the next statement; in STOP, at the one that the program was left at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registers: Option<DebugRegisters>,
    /// Local data of the innermost block, or of the one that was asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub local: Vec<u8>,
}

/// A block under way.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct DebugBlock {
    /// Kind and number: `FB 20`.
    pub block: String,
    /// Block, file and line: `FB 20, press.awl:14`.
    pub place: String,
    /// Its statement, from 0: the next of the innermost, of the others the call.
    pub statement: u32,
    /// The statement as the compiler prints it.
    pub text: String,
    /// The number in the DB register; 0: none is open.
    pub db: u16,
    /// The number in the DI register.
    pub di: u16,
    /// The organization block it runs in.
    pub ob: u16,
}

/// The registers of the innermost block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct DebugRegisters {
    /// The status word: from bit 0 /FC, RLO, STA, OR, OS, OV, CC0, CC1, BR.
    pub status: u16,
    /// ACCU1 to ACCU4, in this order.
    pub accus: [u32; 4],
    /// Address registers AR1 and AR2.
    pub addresses: [u32; 2],
}

/// The order for a question.
pub(super) fn order(known: &KnownProgram, wanted: &DebugWanted) -> Result<DebugOrder, String> {
    let nanos = |ms: u64| ms.saturating_mul(1_000_000).min(PASS_WAIT);
    Ok(match wanted {
        DebugWanted::Break { at } if at.len() > BREAKPOINTS => {
            return Err(format!("{} breakpoints: this CPU has {BREAKPOINTS}\n  = delete one first", at.len()));
        }
        DebugWanted::Break { at } => {
            DebugOrder::Breakpoints(at.iter().map(|place| breakpoint(known, place)).collect::<Result<_, _>>()?)
        }
        DebugWanted::Wait { wait_ms } => DebugOrder::Hold { resume: None, wait: nanos(*wait_ms) },
        DebugWanted::Go { to, wait_ms } => DebugOrder::Hold { resume: Some((*to).into()), wait: nanos(*wait_ms) },
        DebugWanted::End => DebugOrder::End,
        DebugWanted::Stack { level } => DebugOrder::Stack { level: *level },
        DebugWanted::Outputs { enabled } => DebugOrder::Outputs(*enabled),
    })
}

fn breakpoint(known: &KnownProgram, text: &str) -> Result<Breakpoint, String> {
    let number = |digits: &str, what: &str| {
        digits.trim().parse::<u32>().map_err(|_| format!("\"{text}\": \"{}\" is no {what}", digits.trim()))
    };
    if let Some((block, line)) = text.split_once(':') {
        let (block, line) = (named(known, block.trim())?, number(line, "line")?);
        let stmts = find_block(&known.program, block).map_or(&[][..], |block| &block.code);
        let found = stmts.iter().position(|stmt| stmt.line >= line);
        let statement = found.ok_or_else(|| {
            let last = stmts.iter().map(|stmt| stmt.line).max().unwrap_or(0);
            format!("{block} has no statement at or after line {line}\n  = its last one stands in line {last}")
        })?;
        return Ok(Breakpoint { block, statement: statement as u32 });
    }
    let (block, statement) = text.split_once('+').unwrap_or((text, "0"));
    Ok(Breakpoint { block: named(known, block.trim())?, statement: number(statement, "statement")? })
}

/// The answer of the CPU as a client is told it.
pub(super) fn status(known: &KnownProgram, order: &DebugOrder, answer: DebugAnswer) -> Result<DebugStatus, String> {
    let outcome = match answer.end {
        DebugEnd::Done => "done",
        DebugEnd::Held => "held",
        DebugEnd::Runs => "runs",
        DebugEnd::Stopped => "stopped",
        DebugEnd::NoStatement(index) => {
            let DebugOrder::Breakpoints(list) = order else { return Err("no answer".into()) };
            let place = list.get(usize::from(index));
            let place = place.map_or_else(String::new, |place| format!("{}+{}", place.block, place.statement));
            return Err(format!("{place}: there is no such statement in the running program"));
        }
    };
    let held = answer.held;
    let stack: Vec<DebugBlock> = held
        .stack
        .iter()
        .map(|at| {
            let stmt = find_block(&known.program, at.block).and_then(|block| block.code.get(at.statement as usize));
            DebugBlock {
                block: at.block.to_string(),
                place: place_of(&known.program, at.block, at.statement),
                statement: at.statement,
                text: stmt.map_or_else(|| "end of the block".into(), |stmt| stmt.op.to_string()),
                db: at.blocks[0],
                di: at.blocks[1],
                ob: at.ob,
            }
        })
        .collect();
    let registers = DebugRegisters { status: held.status, accus: held.accus, addresses: held.addresses };
    let registers = (!held.stack.is_empty()).then_some(registers);
    Ok(DebugStatus { outcome: outcome.to_owned(), stack, registers, local: held.local })
}
