//! `TX` between the blocks that use it: FC 0, FC 2, FC 3, FC 4 and FC 8.
//!
//! A block asks with [`acquire`] and writes nothing before it has got `TX`. A line command of FC 8 needs no owner: the
//! CP answers it at once, and whichever block is called next fetches the answer. So a command that FC 8 does not come
//! back for holds up nobody, and a reading that FC 8 asks for while `TX` is in use is done by the next owner.

use std::cell::Cell;

use ob1_sdk::{Abort, Cx, ModuleInfo};

use crate::module::Module;
use crate::registers::{Count, FAILED, LINE, TX, Words, tx_count};
use crate::state::CpState;
use crate::turn::{GIVEN_UP, Key, Role, Take, Turn};

/// The key of FC 8: all its calls are one user of `TX`.
pub(crate) const LINES: Key = Key::new(Role::Line, 0);

/// Telegrams of FC 0 that the CP has finished and whose block has not been called since.
const UNTOLD: usize = 4;

ob1_sdk::state! {
    /// How such a telegram has ended: the key of its block (0: none) and the control words of its job.
    #[derive(Debug, Default)]
    struct Ended {
        key: Cell<u64>,
        progress: Cell<u32>,
        failed: Cell<bool>,
    }
}

/// What the CP has of the telegram of FC 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Handed {
    /// Not all of it.
    Part,
    /// All of it: the CP ends the order by itself.
    Whole,
    /// The order has failed.
    Failed,
}

/// The line command in `TX`.
const NONE: u8 = 0;
const READS: u8 = 1;
const SWITCHES: u8 = 2;

ob1_sdk::state! {
    /// Who has `TX`, and the line command in it.
    #[derive(Debug, Default)]
    pub(crate) struct Tx {
        pub(crate) turn: Turn,
        /// How far the telegram has been passed: a [`Handed`].
        handed: Cell<u8>,
        untold: [Ended; UNTOLD],
        oldest: Cell<u8>,
        /// None, or one that reads or switches; the start of the CP at which it was given, and when.
        command: Cell<u8>,
        generation: Cell<u32>,
        given: Cell<u64>,
        /// A command that switches has been answered: FC 8 is not told yet.
        pub(crate) switched: Cell<bool>,
        /// FC 8 has asked for a reading while another block had `TX`.
        pub(crate) wanted: Cell<bool>,
        /// The owner has already waited for a reading.
        has_read: Cell<bool>,
        /// STATUS and DELTA_STATUS of the last answer, if there was one.
        pub(crate) lines_known: Cell<bool>,
        pub(crate) lines: Cell<u8>,
        pub(crate) lines_changed: Cell<u8>,
    }
}

impl Tx {
    /// FC 9 has synchronised: nobody has `TX`, and it is 0. What has ended before is still to be told.
    pub(crate) fn clear(&self) {
        self.turn.clear();
        self.command.set(NONE);
        self.switched.set(false);
        self.wanted.set(false);
    }

    /// The job of FC 0 after this call.
    pub(crate) fn note(&self, progress: u32, handed: Handed) {
        self.turn.claim.note(progress);
        self.handed.set(handed as u8);
    }

    /// A job of this block begins: what is still to be told about an earlier one is void.
    pub(crate) fn begin(&self, key: Key) {
        self.untold.iter().filter(|ended| ended.key.get() == key.number()).for_each(|ended| ended.key.set(0));
    }

    /// How the job with these control words has ended, if another block has got `TX` since: `true`, it has failed.
    pub(crate) fn outcome(&self, key: Key, progress: u32) -> Option<bool> {
        let found = |ended: &&Ended| ended.key.get() == key.number() && ended.progress.get() == progress;
        let ended = self.untold.iter().find(found)?;
        ended.key.set(0);
        Some(ended.failed.get())
    }

    /// The CP has the whole telegram of a FC 0 that is not called: once the CP has ended the order, `TX` is free, and
    /// its end is kept for that block. False while the CP is at it.
    fn ends_by_itself(&self, key: Key, info: &ModuleInfo, words: Words, now: u64) -> bool {
        let claim = &self.turn.claim;
        let (owner, progress) = claim.job();
        let is_send = owner >> 56 == Role::Send as u64 && progress != 0 && claim.holds(info);
        if !is_send || claim.is_of(key) || claim.is_alive(info, now) || self.handed.get() == Handed::Part as u8 {
            return true;
        }
        let failed = match tx_count(words.tx_echo) {
            _ if self.handed.get() == Handed::Failed as u8 => true,
            Count::Failed(_) => true,
            Count::Bytes(0) => false,
            _ => return false,
        };
        let at = self.oldest.get() as usize % UNTOLD;
        self.oldest.set((at + 1) as u8);
        if let Some(ended) = self.untold.get(at) {
            ended.key.set(owner);
            ended.progress.set(progress);
            ended.failed.set(failed);
        }
        claim.abandon();
        true
    }

    /// Whether a line command is in `TX` that this start of the CP answers.
    pub(crate) fn has_command(&self, info: &ModuleInfo) -> bool {
        self.command.get() != NONE && info.present && self.generation.get() == info.generation
    }

    /// Whether nobody uses `TX`, for this start of the CP.
    pub(crate) fn is_unused(&self, info: &ModuleInfo) -> bool {
        !self.has_command(info) && !self.turn.claim.holds(info)
    }
}

/// A line command in `TX`, seen from the block that is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Line {
    /// `TX` has no line command.
    None,
    /// The CP has not answered yet.
    Waits,
    /// The answer has been fetched in this call; `TX echo` still shows it.
    Answered,
}

/// Fetches the answer to a line command, whichever block has given it.
pub(crate) fn settle(cx: &mut Cx<'_, CpState>, module: &Module<'_>, words: Words, now: u64) -> Result<Line, Abort> {
    let tx = &module.state.tx;
    if tx.command.get() == NONE {
        return Ok(Line::None);
    }
    if !tx.has_command(&module.info) || module.is_closed(words) {
        // The CP was reset or restarted and has forgotten it.
        tx.command.set(NONE);
        return Ok(Line::None);
    }
    let Count::Line { status, delta } = tx_count(words.tx_echo) else {
        // Somebody else has written to TX.
        if now.saturating_sub(tx.given.get()) >= GIVEN_UP {
            tx.command.set(NONE);
        }
        return Ok(Line::Waits);
    };
    if !module.write(cx, TX, &[0, 0])? {
        return Ok(Line::Waits);
    }
    tx.lines_known.set(true);
    tx.lines.set(status);
    tx.lines_changed.set(delta);
    tx.switched.set(tx.command.replace(NONE) == SWITCHES);
    Ok(Line::Answered)
}

/// Writes a line command; only for the owner of `TX`. False if the access failed and OB 122 has handled it.
pub(crate) fn give(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    word: u16,
    switches: bool,
    now: u64,
) -> Result<bool, Abort> {
    let tx = &module.state.tx;
    let written = module.write(cx, TX, &word.to_be_bytes())?;
    if written {
        tx.command.set(if switches { SWITCHES } else { READS });
        tx.generation.set(module.info.generation);
        tx.given.set(now);
        tx.switched.set(false);
        tx.wanted.set(false);
    }
    Ok(written)
}

/// What `TX` needs before its owner may begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Left {
    /// Nothing: CP and CPU both start from 0.
    Nothing,
    /// The CP has to act.
    Wait,
    /// An earlier job has left something: write this word.
    Word(u16),
}

impl Left {
    pub(crate) fn of(words: Words) -> Self {
        match tx_count(words.tx_echo) {
            _ if words.not_ready() => Left::Wait,
            _ if words.tx_echo == 0 => Left::Nothing,
            Count::System => Left::Wait,
            Count::Failed(_) => Left::Word(FAILED),
            Count::Bytes(_) | Count::Line { .. } | Count::Nonsense => Left::Word(0),
        }
    }
}

/// Asks for `TX`. True: it is the block's, and both sides are at 0. It is the block's until it releases the claim.
pub(crate) fn acquire(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    words: Words,
    key: Key,
    now: u64,
) -> Result<bool, Abort> {
    let tx = &module.state.tx;
    if !tx.ends_by_itself(key, &module.info, words, now) {
        return Ok(false);
    }
    let had = tx.turn.claim.is_of(key);
    let take = tx.turn.take(key, &module.info, now);
    if take == Take::No {
        return Ok(false);
    }
    if !had {
        tx.has_read.set(tx.command.get() != NONE);
    }
    if settle(cx, module, words, now)? != Line::None {
        return Ok(false);
    }
    let left = match Left::of(words) {
        // Its block may stand in TX though the CP has not seen it.
        Left::Nothing if take == Take::Over => Left::Word(0),
        left => left,
    };
    match left {
        Left::Nothing if tx.wanted.get() && !tx.has_read.replace(true) => {
            give(cx, module, LINE, false, now)?;
            Ok(false)
        }
        Left::Nothing => Ok(true),
        Left::Wait => Ok(false),
        Left::Word(word) => module.write(cx, TX, &word.to_be_bytes()).map(|_| false),
    }
}
