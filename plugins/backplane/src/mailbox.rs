//! The mailbox: one mail of 32 bytes each way at a time (a CP 341 exchanges its telegrams in such pieces).
//!
//! The poster owns the mail while `posted == taken`, the taker while `posted == taken + 1`; anything else is a fault:
//! who finds it takes over the other side's number, and the mailbox is empty.
//! A mail carries the generation of the driver it belongs to: what an earlier driver has posted, or was to get, is
//! thrown away.

use crate::bytes::{copy_out, words_of};
use crate::cells::MailboxCells;
use crate::fault::Fault;
use crate::layout::MAIL_BYTES;
use crate::sync::Ordering;

/// One mail.
pub type Mail = [u8; MAIL_BYTES];

/// The posting end of one direction.
pub(crate) struct Poster {
    posted: u64,
}

impl Poster {
    /// The poster of a fresh segment.
    pub(crate) const fn new() -> Self {
        Self { posted: 0 }
    }

    /// The poster that follows a dead one: what that one has posted completely stays, its own mark is on it.
    pub(crate) fn resume(cells: &MailboxCells) -> Self {
        let taken = cells.taken.load(Ordering::Acquire);
        let posted = cells.posted.load(Ordering::Relaxed);
        if posted.wrapping_sub(taken) > 1 {
            cells.posted.store(taken, Ordering::Release);
            return Self { posted: taken };
        }
        Self { posted }
    }

    /// Posts a mail; false if the last one has not been taken yet.
    pub(crate) fn post(&mut self, cells: &MailboxCells, generation: u64, mail: &Mail) -> Result<bool, Fault> {
        // Pairs with the taker's store(Release): it has read the old mail before we write the new one.
        let taken = cells.taken.load(Ordering::Acquire);
        match self.posted.wrapping_sub(taken) {
            0 => {}
            1 => return Ok(false),
            _ => {
                let fault = Fault::Mailbox { posted: self.posted, taken };
                self.posted = taken;
                self.publish(cells);
                return Err(fault);
            }
        }
        cells.generation.store(generation, Ordering::Relaxed);
        for (cell, word) in cells.data.0.iter().zip(words_of(mail)) {
            cell.store(word, Ordering::Relaxed);
        }
        self.posted = self.posted.wrapping_add(1);
        self.publish(cells);
        Ok(true)
    }

    /// Shows how far the poster is.
    pub(crate) fn publish(&self, cells: &MailboxCells) {
        // Pairs with the taker's load(Acquire) of `posted`.
        cells.posted.store(self.posted, Ordering::Release);
    }
}

/// The taking end of one direction.
pub(crate) struct Taker {
    taken: u64,
}

impl Taker {
    /// The taker of a fresh segment.
    pub(crate) const fn new() -> Self {
        Self { taken: 0 }
    }

    /// The taker that follows a dead one: whatever lies there was not meant for it.
    pub(crate) fn resume(cells: &MailboxCells) -> Self {
        let taken = cells.posted.load(Ordering::Acquire);
        cells.taken.store(taken, Ordering::Release);
        Self { taken }
    }

    /// Takes the mail that lies there, if it is of this generation.
    pub(crate) fn take(&mut self, cells: &MailboxCells, generation: u64) -> Result<Option<Mail>, Fault> {
        // Pairs with the poster's store(Release) of `posted`.
        let posted = cells.posted.load(Ordering::Acquire);
        match posted.wrapping_sub(self.taken) {
            0 => return Ok(None),
            1 => {}
            _ => {
                let fault = Fault::Mailbox { posted, taken: self.taken };
                self.taken = posted;
                self.publish(cells);
                return Err(fault);
            }
        }
        let mine = cells.generation.load(Ordering::Relaxed) == generation;
        let words = cells.data.0.each_ref().map(|cell| cell.load(Ordering::Relaxed));
        self.taken = posted;
        self.publish(cells);
        let mut mail = [0; MAIL_BYTES];
        copy_out(&words, &mut mail);
        Ok(mine.then_some(mail))
    }

    /// Shows how far the taker is.
    pub(crate) fn publish(&self, cells: &MailboxCells) {
        // Pairs with the poster's load(Acquire) of `taken`.
        cells.taken.store(self.taken, Ordering::Release);
    }
}
