//! What the scan gathers about itself while it runs; at its end it becomes a record and goes into the accounts.

use std::sync::Arc;

use ob1_model::{BlockId, Site};
use ob1_time::{Instant, Span};

use super::{Accounts, Flags, ScanRecord};
use crate::engine::Caller;

/// Most buckets a long pause is spread over in the distribution of the deadlines.
const SPREAD: u64 = 512;

/// The scan's side of the accounts.
#[derive(Debug)]
pub(crate) struct Trace {
    pub(crate) accounts: Arc<Accounts>,
    /// The record of the running scan so far.
    record: ScanRecord,
    /// The last finished scan.
    pub(crate) last: ScanRecord,
    /// Longest organization block since the last scan ended.
    longest_ob: (u16, Span),
    /// End of the last interrupt between two scans.
    between_end: Instant,
    /// When the running scan counts as long; [`Instant::NEVER`] once that has been noted.
    long_at: Instant,
    /// The statement that was about to be executed then.
    pub(crate) long_in: Option<Caller>,
    /// Time of plugin blocks within the running one.
    pub(crate) nested: Span,
    /// Time of all organization blocks when the scan began.
    inside: Span,
    statements: u64,
    watchdogs: u64,
}

impl Trace {
    pub(crate) fn new(accounts: Arc<Accounts>) -> Self {
        Self {
            accounts,
            record: ScanRecord::default(),
            last: ScanRecord::default(),
            longest_ob: (0, Span::ZERO),
            between_end: Instant::START,
            long_at: Instant::NEVER,
            long_in: None,
            nested: Span::ZERO,
            inside: Span::ZERO,
            statements: 0,
            watchdogs: 0,
        }
    }

    /// A start-up: nothing is carried over.
    pub(crate) fn start_up(&mut self) {
        (self.last, self.longest_ob, self.between_end) = (ScanRecord::default(), (0, Span::ZERO), Instant::START);
    }

    /// A scan begins. `inside` and `statements` are the machine's running sums.
    pub(crate) fn begin(&mut self, planned: Instant, start: Instant, inside: Span, statements: u64) {
        let accounts = &*self.accounts;
        let lateness = start.since(planned);
        if accounts.off {
            self.record.scan = accounts.scans.get() + 1;
            return;
        }
        accounts.wake.record(lateness);
        let (between_ob, _) = std::mem::take(&mut self.longest_ob);
        self.record = ScanRecord {
            scan: accounts.scans.get() + 1,
            planned,
            start,
            carried: self.last.end.since(planned).min(lateness),
            between: self.between_end.since(planned).min(lateness),
            between_ob,
            ..ScanRecord::default()
        };
        self.watch(start, inside, statements);
    }

    /// Interrupts between two scans are about to be served. If they end in STOP, [`Trace::end`] follows, else
    /// [`Trace::between`].
    pub(crate) fn begin_between(&mut self, start: Instant, inside: Span, statements: u64) {
        let scan = self.accounts.scans.get() + 1;
        self.record = ScanRecord { scan, planned: start, start, ..ScanRecord::default() };
        self.watch(start, inside, statements);
    }

    /// What is served now may become long, or trip the watchdog.
    fn watch(&mut self, start: Instant, inside: Span, statements: u64) {
        self.long_at = start.saturating_add(self.accounts.long_from);
        (self.long_in, self.nested) = (None, Span::ZERO);
        (self.inside, self.statements, self.watchdogs) = (inside, statements, self.accounts.watchdogs.get());
    }

    /// Records the time from the start of the previous scan to the start of this one.
    pub(crate) fn cycle(&self, time: Span) {
        if !self.accounts.off {
            self.accounts.cycle.record(time);
        }
    }

    /// Records the time of the exchange with the links.
    pub(crate) fn exchanged(&mut self, time: Span) {
        if !self.accounts.off {
            self.accounts.links.record(time);
        }
    }

    /// OB 1 has begun, after `inside` of interrupts in this scan.
    pub(crate) fn ob1_began(&mut self, at: Instant, inside: Span) {
        let interrupts = inside.saturating_sub(self.inside);
        self.record.inputs = at.since(self.record.start).saturating_sub(interrupts);
    }

    /// An organization block has ended.
    #[inline]
    pub(crate) fn ob_ran(&mut self, ob: u16, own: Span) {
        if own > self.longest_ob.1 {
            self.longest_ob = (ob, own);
        }
    }

    /// A block of a plugin has returned after `own` time of its own.
    #[inline]
    pub(crate) fn plugin_ran(&mut self, account: u32, own: Span) {
        let Some(account) = self.accounts.blocks.get(account as usize) else { return };
        account.execution.record(own);
        self.record.plugins += own;
        if own >= self.record.longest_plugin_time {
            (self.record.longest_plugin, self.record.longest_plugin_time) = (Some(account.block), own);
        }
    }

    /// A safe point: notes where the program is when the scan has become long.
    #[inline]
    pub(crate) fn safe_point(&mut self, now: Instant, at: Option<Caller>) {
        if now >= self.long_at {
            (self.long_at, self.long_in) = (Instant::NEVER, at);
        }
    }

    /// Interrupts between two scans have been served.
    pub(crate) fn between(&mut self, end: Instant) {
        self.between_end = end;
    }

    /// The scan has ended; the program had ended at `outputs_from`. Returns whether the scan was late.
    pub(crate) fn end(&mut self, ended: &Ended) -> bool {
        let accounts = &*self.accounts;
        let record = &mut self.record;
        if accounts.off {
            accounts.overruns.add(u64::from(ended.overran));
            accounts.missed.add(ended.missed);
            accounts.scans.set(record.scan);
            return false;
        }
        record.end = ended.end;
        record.outputs = ended.end.since(ended.outputs_from);
        record.program = ended.inside.saturating_sub(self.inside);
        record.statements = ended.statements.saturating_sub(self.statements);
        (record.longest_ob, record.longest_ob_time) = std::mem::take(&mut self.longest_ob);
        if let Some(site) = ended.site {
            (record.long_in, record.long_at_line) = (Some(site.block), site.line);
        }
        record.missed = ended.missed;
        record.flags = Flags {
            began_late: record.lateness() >= accounts.late_from,
            took_long: record.execution() >= accounts.long_from,
            overran: ended.overran,
            watchdog: accounts.watchdogs.get() > self.watchdogs,
        };
        accounts.execution.record(record.execution());
        accounts.inputs.record(record.inputs);
        accounts.outputs.record(record.outputs);
        accounts.overruns.add(u64::from(ended.overran));
        accounts.missed.add(ended.missed);
        let late = record.flags.is_late();
        accounts.late.add(u64::from(late));
        accounts.statements.set(ended.statements);
        accounts.recorder.push(record, ended.overran);
        accounts.scans.set(record.scan);
        self.last = *record;
        late
    }

    /// Records deadlines without a scan: each is as late as the scan that comes next.
    pub(crate) fn missed(&self, first: Instant, period: Span, count: u64, next: Instant) {
        let stride = count.div_ceil(SPREAD).max(1);
        let mut index = 0;
        while index < count {
            let times = stride.min(count - index);
            let deadline = first.saturating_add(period.times(index));
            self.accounts.skipped.record_times(next.since(deadline), times);
            index += times;
        }
    }
}

/// How a scan ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ended {
    pub(crate) end: Instant,
    pub(crate) outputs_from: Instant,
    /// The machine's running sums.
    pub(crate) inside: Span,
    pub(crate) statements: u64,
    pub(crate) overran: bool,
    pub(crate) missed: u64,
    pub(crate) site: Option<Site>,
}

/// The blocks of plugins, without those of the standard library: id and name.
pub(crate) fn plugin_blocks<'a>(
    natives: impl Iterator<Item = &'a dyn crate::NativeBlock> + 'a,
) -> impl Iterator<Item = (BlockId, Box<str>)> + 'a {
    natives.filter(|block| block.is_plugin()).map(|block| (block.id(), block.name().into()))
}
