//! What is true: the telegrams that reached the partner beside the jobs of the blocks, and those of the partner beside
//! what the blocks have taken.

use ob1_time::{Instant, Span};

use super::numbers::Number;
use super::rule::{Findings as _, Rule};
use super::sender::End;
use crate::programs::judge::Verdict;

/// A job as a block has named it.
#[derive(Debug)]
struct Job {
    block: &'static str,
    began: Instant,
    /// What has to arrive, one of these; none: its parameters are wrong, nothing may.
    telegrams: Vec<Vec<u8>>,
    arrived: u32,
    /// When it arrived first.
    last: Instant,
    /// Repetitions have a cause: the partner or the line spoilt an answer.
    spoilt: bool,
    refused: bool,
    /// The block has told its end.
    over: bool,
}

/// Telegrams from the CP to the partner.
#[derive(Debug, Default)]
pub struct Outbox {
    jobs: Vec<Job>,
    /// DONE was seen, and the partner does not know yet whether the telegram has ended: silence ends it.
    open: Vec<(Instant, usize)>,
    /// When the line had a fault.
    faults: Vec<Instant>,
}

/// A character of the slowest line is shorter.
pub const CHARACTER: Span = Span::from_millis(3);

/// Longest silence after which a partner knows that a telegram has ended.
const ENDS: Span = Span::from_millis(400);

impl Outbox {
    /// A job has begun; returns its number.
    pub fn began(&mut self, at: Instant, block: &'static str, telegram: Option<Vec<u8>>) -> usize {
        let (arrived, last, spoilt, refused, over) = (0, Instant::NEVER, false, false, false);
        let telegrams = telegram.into_iter().collect();
        self.jobs.push(Job { block, began: at, telegrams, arrived, last, spoilt, refused, over });
        self.jobs.len() - 1
    }

    /// The program has changed the data of a job that waits or runs: this telegram is right, too.
    pub fn also(&mut self, job: usize, telegram: Vec<u8>) {
        if self.jobs[job].arrived == 0 && !self.jobs[job].telegrams.contains(&telegram) {
            self.jobs[job].telegrams.push(telegram);
        }
    }

    /// Answers to this job were lost or spoilt: the partner may get it more than once.
    /// [TIA help "Configuration for point-to-point links"]
    pub fn spoilt(&mut self, job: usize) {
        self.jobs[job].spoilt = true;
    }

    /// The line reports a fault now: an answer of the partner that is on its way is spoilt.
    pub fn line_fault(&mut self, now: Instant) {
        self.faults.push(now);
    }

    /// A whole telegram has reached the partner, and it has answered that it took it. `answered` is false when its
    /// answer was kept back or spoilt; `lenient`: the line changes telegrams so that nobody can know.
    pub fn arrived(&mut self, at: Instant, telegram: &[u8], answered: bool, lenient: bool, findings: &mut Verdict) {
        let is_it = |job: &&mut Job| job.began <= at && job.telegrams.iter().any(|own| own == telegram);
        let fresh = |job: &&mut Job| is_it(job) && job.arrived == 0 && !job.refused;
        let job = match self.jobs.iter_mut().rev().find(fresh) {
            Some(job) => Some(job),
            None => self.jobs.iter_mut().rev().find(is_it),
        };
        let Some(job) = job else {
            if lenient {
                self.jobs.iter_mut().for_each(|job| job.spoilt = true);
                return;
            }
            findings.breaks(at, Rule::SentOnce, format!("the partner got {} bytes of no job", telegram.len()));
            return;
        };
        let block = job.block;
        // A fault before the answer leaves spoils the answer, too.
        let hits = |fault: &Instant| job.arrived > 0 && *fault >= job.began && *fault < job.last + CHARACTER;
        job.spoilt |= self.faults.iter().any(hits);
        findings.must(job.arrived == 0 || job.spoilt || lenient, at, Rule::SentOnce, || {
            format!("{block}: the partner got the same job twice, and its first answer was good")
        });
        findings.must(!job.refused, at, Rule::RefusedIsNotSent, || {
            format!("{block}: the job was refused, and yet its telegram arrived")
        });
        job.last = job.last.min(at);
        job.arrived += 1;
        job.spoilt |= !answered;
    }

    /// A job has ended. `number`: what its STATUS says.
    pub fn ended(&mut self, at: Instant, job: usize, end: End, number: Option<Number>, findings: &mut Verdict) {
        let number_of = job;
        if end == End::Done && self.jobs[job].arrived == 0 {
            self.exchange(job);
        }
        if matches!(end, End::Error(_)) && number == Some(Number::Refused) && self.jobs[job].arrived == 1 {
            self.give_back(job);
        }
        let job = &mut self.jobs[job];
        job.over = true;
        let block = job.block;
        match end {
            End::Done => {
                if job.arrived == 0 && !job.spoilt {
                    self.open.push((at, number_of));
                }
            }
            End::Error(status) if number == Some(Number::Refused) => {
                job.refused = true;
                findings.must(job.arrived == 0, at, Rule::RefusedIsNotSent, || {
                    format!("{block}: ERROR {status:04X}h says that nothing was sent, but it arrived")
                });
            }
            End::Error(status) if number == Some(Number::Rejected) => {
                findings.must(job.arrived == 0 || job.spoilt, at, Rule::RefusedIsNotSent, || {
                    format!("{block}: ERROR {status:04X}h says that the partner refused it, but it took it")
                });
            }
            // R: what has reached the CP is still sent. [TIA help "PtP data link CP 341"]
            End::Error(_) | End::Reset => job.spoilt = true,
        }
    }

    /// A job is DONE whose telegram was counted for another one that still runs: two instances send the same bytes, and
    /// on the line nothing tells them apart. The other one needs an arrival of its own then.
    fn exchange(&mut self, done: usize) {
        let Job { telegrams, began, .. } = &self.jobs[done];
        let is_same = |job: &Job| {
            job.arrived == 1
                && !job.over
                && job.last >= *began
                && job.telegrams.iter().any(|own| telegrams.contains(own))
        };
        let Some(other) = self.jobs.iter().rposition(is_same) else { return };
        let last = std::mem::replace(&mut self.jobs[other].last, Instant::NEVER);
        self.jobs[other].arrived = 0;
        (self.jobs[done].arrived, self.jobs[done].last) = (1, last);
    }

    /// A job was refused, and the same bytes have arrived: they may be those of a job before it that still runs, or
    /// that ended with an error when they were on the line already.
    fn give_back(&mut self, refused: usize) {
        let (before, from) = self.jobs.split_at_mut(refused);
        let is_same = |job: &&mut Job| {
            job.arrived == 0
                && (!job.over || job.spoilt)
                && job.telegrams.iter().any(|own| from[0].telegrams.contains(own))
        };
        if let Some(other) = before.iter_mut().rev().find(is_same) {
            (other.arrived, from[0].arrived) = (1, 0);
            other.last = std::mem::replace(&mut from[0].last, Instant::NEVER);
        }
    }

    /// Looks at the jobs that were DONE a while ago. `loses`: the line loses characters and nobody acknowledges
    /// telegrams: one whose first character is lost is none for the partner.
    pub fn settle(&mut self, now: Instant, loses: bool, findings: &mut Verdict) {
        let jobs = &self.jobs;
        self.open.retain(|(done, job)| {
            let Job { block, arrived, spoilt, last, .. } = &jobs[*job];
            if now.since(*done) < ENDS && *arrived == 0 {
                return true;
            }
            let there = *arrived > 0 && last <= done || *spoilt || loses && *arrived == 0;
            findings.must(there, *done, Rule::DoneArrived, || match arrived {
                0 => format!("{block}: DONE, but the partner did not get it"),
                _ => format!("{block}: DONE {} us before its last character", last.since(*done).micros()),
            });
            false
        });
    }
}

/// A telegram of the partner.
#[derive(Debug)]
struct Letter {
    at: Instant,
    telegram: Vec<u8>,
    /// How often it may be taken: the partner has sent it again because the answer did not come.
    copies: u32,
    taken: u32,
    /// The CP has acknowledged it and nothing has happened to it since.
    owed: bool,
    /// A reception was broken off when it was under way.
    broken: bool,
}

/// Telegrams from the partner to the CP.
#[derive(Debug)]
pub struct Inbox {
    letters: Vec<Letter>,
    /// Bytes of the receive buffer.
    buffer: usize,
    /// The newest that was taken.
    newest: usize,
    /// When the last one was taken.
    last: Instant,
}

impl Inbox {
    /// Of a CP with a receive buffer of so many bytes.
    #[must_use]
    pub fn new(buffer: usize) -> Self {
        Self { letters: Vec::new(), buffer, newest: 0, last: Instant::START }
    }

    /// The partner has sent a telegram whole; `owed`: the CP has acknowledged it, or there is nothing to acknowledge
    /// and the line was good; `broken`: a kill or a reset may have cut off its beginning.
    pub fn said(&mut self, at: Instant, telegram: &[u8], owed: bool, broken: bool) {
        // "Telegrams stay in the receive buffer until it is full (080Ah)" [TIA help "PtP data link CP 341"]; a block
        // with EN_R = 0 is not told of the one that is lost then.
        let owed = owed && self.room() >= telegram.len();
        self.letters.push(Letter { at, telegram: telegram.to_vec(), copies: 1, taken: 0, owed, broken });
    }

    /// The CP has acknowledged this telegram.
    pub fn owed(&mut self, at: Instant, telegram: &[u8]) {
        if self.letters.iter().any(|letter| letter.telegram == telegram && letter.taken > 0) {
            return;
        }
        let newest = self.letters.iter_mut().rev().find(|letter| letter.telegram == telegram);
        if let Some(letter) = newest.filter(|letter| !letter.broken) {
            (letter.owed, letter.at) = (true, at);
        }
    }

    /// What is in the CP may be lost: a kill, new parameters, a full buffer.
    pub fn forget(&mut self) {
        for letter in &mut self.letters {
            letter.copies += 1;
            (letter.owed, letter.broken) = (false, true);
        }
    }

    /// A reception was broken off: the telegram may be gone or come again. [TIA help "PtP data link CP 341"]
    pub fn broken_off(&mut self) {
        for letter in self.letters.iter_mut().filter(|letter| letter.taken == 0) {
            (letter.owed, letter.broken) = (false, true);
        }
    }

    /// NDR with these data.
    pub fn taken(&mut self, at: Instant, block: &str, telegram: &[u8], lenient: bool, findings: &mut Verdict) {
        let same = |letter: &Letter| letter.telegram == telegram;
        let fresh = |(place, letter): (usize, &Letter)| same(letter) && letter.taken == 0 && place >= self.newest;
        let place = (0..).zip(&self.letters).position(fresh);
        let place = place.or_else(|| self.letters.iter().position(|letter| same(letter) && letter.taken == 0));
        let place = place.or_else(|| self.letters.iter().position(same));
        let found = place.map(|place| (place, &mut self.letters[place]));
        let Some((place, letter)) = found else {
            // The rest of one that was cut off, however many calls it took.
            if lenient || self.letters.iter().any(|letter| letter.broken && letter.telegram.ends_with(telegram)) {
                return;
            }
            let head = &telegram[..telegram.len().min(12)];
            findings.breaks(
                at,
                Rule::NdrWhole,
                format!("{block}: NDR with {} bytes that the partner did not send: {head:02X?}", telegram.len()),
            );
            return;
        };
        letter.taken += 1;
        self.last = at;
        findings.must(letter.taken <= letter.copies, at, Rule::TakenOnce, || {
            format!("{block}: a telegram of the partner was taken {} times, sent {}", letter.taken, letter.copies)
        });
        findings.must(place >= self.newest, at, Rule::InOrder, || format!("{block}: an older telegram after a newer"));
        self.newest = self.newest.max(place);
        // It was sent again because its answer did not come: whether it comes again, nobody knows.
        // [TIA help "Configuration for point-to-point links"]
        self.letters.iter_mut().filter(|letter| letter.telegram == telegram).for_each(|letter| letter.owed = false);
    }

    /// Bytes for which the receive buffer surely has room: without the telegrams that came after the newest which was
    /// taken.
    #[must_use]
    pub fn room(&self) -> usize {
        let behind = self.letters.iter().skip(self.newest).filter(|letter| letter.taken == 0);
        self.buffer.saturating_sub(behind.map(|letter| letter.telegram.len()).sum())
    }

    /// Whether something is still to be delivered.
    #[must_use]
    pub fn has_owed(&self) -> bool {
        self.letters.iter().any(|letter| letter.owed && letter.taken == 0)
    }

    /// The end of the run at `now`: each telegram is delivered within `patience` after those before it.
    pub fn finish(&self, block: &str, now: Instant, patience: Span, findings: &mut Verdict) {
        let owed = (0..).zip(&self.letters).filter(|(_, letter)| letter.owed && letter.taken == 0);
        for ((place, letter), before) in owed.zip(1_u64..) {
            // Those before it came first, each a portion in a call. [TIA help "PtP data link CP 341"]
            let since = if place > self.newest { letter.at.max(self.last) } else { letter.at };
            if now > since + patience * before {
                let (ms, len) = (letter.at.millis(), letter.telegram.len());
                findings.breaks(now, Rule::Delivered, format!("{block}: {len} bytes of {ms} ms were never delivered"));
            }
        }
    }
}
