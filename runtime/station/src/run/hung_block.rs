//! The monitor: names a native block that never returns, switches the outputs off and ends the process.
//!
//! Nothing can bring the scan thread back from such a block. A loop of statements is caught by the watchdog; one that
//! triggers the watchdog again and again (SFC 43), or that has none, is told of.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender};

use ob1_model::{BlockId, Event};

use super::scan::ScanState;
use crate::exit::Exit;
use crate::io::ProcessIo;
use ob1_cpu::{Running, ScanPosition};
use ob1_rt::SideThread;
use ob1_time::Span;

/// Time between two looks.
const LOOK: Span = Span::from_millis(100);
/// Looks in which nothing must have moved, at least: looks are counted, not time, so that a process that was stopped as
/// a whole is not taken for a hung scan.
const LOOKS: u32 = 20;
/// Looks in one cycle after which that is told of: 3 s, unless the watchdog allows more.
const STANDS: u32 = 30;
/// The same for a CPU without a watchdog.
const LOOKS_WITHOUT_WATCHDOG: u32 = 600;

/// How long a native block may stay in one cycle before it is given up, with this watchdog.
pub(crate) fn time(watchdog: Span) -> Span {
    LOOK * Suspicion::new(watchdog).needed.into()
}

/// Decides, look by look, whether a native block hangs. Pure.
#[derive(Debug)]
struct Suspicion {
    needed: u32,
    seen: Option<(u64, u32, BlockId)>,
    looks: u32,
}

impl Suspicion {
    /// For a CPU with this watchdog; 0: none.
    fn new(watchdog: Span) -> Self {
        let twice = (watchdog.times(2) / LOOK).min(u64::from(u32::MAX)) as u32;
        let needed = if watchdog.is_zero() { LOOKS_WITHOUT_WATCHDOG } else { twice.max(LOOKS) };
        Self { needed, seen: None, looks: 0 }
    }

    /// One look: cycles so far, and the call of a native block that is under way within one: a loop of statements may
    /// call the same block again and again. The block, when it must be given up.
    fn look(&mut self, cycles: u64, call: Option<(u32, BlockId)>) -> Option<BlockId> {
        let now = call.map(|(number, block)| (cycles, number, block));
        if now.is_none() || now != self.seen {
            (self.seen, self.looks) = (now, 0);
            return None;
        }
        self.looks += 1;
        if self.looks >= self.needed { call.map(|(_, block)| block) } else { None }
    }
}

/// Tells, look by look, of a cycle that does not end. Pure.
#[derive(Debug)]
struct Standstill {
    needed: u32,
    cycles: u64,
    looks: u32,
}

/// What is due for the log.
#[derive(Debug, PartialEq, Eq)]
enum Told {
    Nothing,
    Stands,
    GoesOn,
}

impl Standstill {
    /// For a CPU with this watchdog.
    fn new(watchdog: Span) -> Self {
        let needed = Suspicion::new(watchdog).needed.clamp(STANDS, LOOKS_WITHOUT_WATCHDOG);
        Self { needed: if watchdog.is_zero() { STANDS } else { needed }, cycles: 0, looks: 0 }
    }

    /// One look: cycles so far, and whether one runs.
    fn look(&mut self, cycles: u64, runs: bool) -> Told {
        if !runs || cycles != self.cycles {
            let told = self.looks >= self.needed;
            (self.cycles, self.looks) = (cycles, 0);
            return if told { Told::GoesOn } else { Told::Nothing };
        }
        self.looks += 1;
        if self.looks == self.needed { Told::Stands } else { Told::Nothing }
    }

    /// Seconds since the cycle began that does not end; 0: there is none.
    fn seconds(&self) -> u64 {
        if self.looks < self.needed { 0 } else { u64::from(self.looks) * LOOK.millis() / 1000 }
    }
}

/// The monitor thread. Dropping it ends it.
#[derive(Debug)]
pub(super) struct Monitor {
    _thread: SideThread<Sender<()>>,
}

impl Monitor {
    pub(super) fn start(
        (scan, position, stands): (Arc<ScanState>, Arc<ScanPosition>, Arc<AtomicU64>),
        running: Arc<Running>,
        io: Option<ProcessIo>,
        watchdog: Span,
    ) -> std::io::Result<Self> {
        let thread = SideThread::looking("ob1-monitor", move |stopped| {
            let (mut suspicion, mut standstill) = (Suspicion::new(watchdog), Standstill::new(watchdog));
            while stopped.recv_timeout(LOOK.into()) == Err(RecvTimeoutError::Timeout) {
                let call = running.call().filter(|_| scan.is_in_cycle());
                if let Some(block) = suspicion.look(scan.cycles(), call) {
                    give_up(block, io.as_ref());
                }
                let told = standstill.look(scan.cycles(), scan.is_in_cycle());
                stands.store(standstill.seconds(), Ordering::Relaxed);
                match told {
                    Told::Nothing => {}
                    Told::Stands => {
                        let ob = position.ob().map_or_else(String::new, |ob| format!(", in OB {ob}"));
                        let (text, seconds) = (Event::CYCLE_STANDS.text(), standstill.seconds());
                        tracing::warn!("{text}: one began {seconds} s ago{ob}");
                        tracing::warn!("  = {}", Event::CYCLE_STANDS.remedy());
                    }
                    Told::GoesOn => tracing::info!("cycles end again"),
                }
            }
        })?;
        Ok(Self { _thread: thread })
    }
}

/// Drivers end with the process (end of file on their stdin), the guardian removes the runtime directory.
fn give_up(block: BlockId, io: Option<&ProcessIo>) -> ! {
    if let Some(io) = io {
        io.switch_off();
    }
    err!("\nob1: native block {block} does not return; outputs are off, the station ends");
    err!("  = a block must return; one that waits keeps its state and returns, or calls `attend` in its loop");
    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
    ob1_rt::lower_exit_guard();
    std::process::exit(i32::from(Exit::Hung as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::BlockKind;

    const BLOCK: BlockId = BlockId::new(BlockKind::Fc, 7);
    const CALL: Option<(u32, BlockId)> = Some((1, BLOCK));

    #[test]
    fn a_block_that_stays_is_given_up() {
        let mut suspicion = Suspicion::new(Span::from_millis(150));
        assert_eq!((0..LOOKS).find_map(|_| suspicion.look(5, CALL)), None);
        assert_eq!(suspicion.look(5, CALL), Some(BLOCK));
    }

    #[test]
    fn a_cycle_that_does_not_end_is_told_once() {
        let mut standstill = Standstill::new(Span::from_millis(150));
        let mut looks = |cycles, runs, times| -> Vec<Told> {
            let told = (0..times).map(|_| standstill.look(cycles, runs)).filter(|told| *told != Told::Nothing);
            let told = told.collect();
            assert_eq!(standstill.seconds() > 0, runs && times >= STANDS, "{cycles}");
            told
        };
        assert_eq!(looks(7, false, 100), [], "it sleeps");
        assert_eq!(looks(7, true, STANDS - 1), []);
        assert_eq!(looks(8, true, 100), [Told::Stands]);
        assert_eq!(looks(9, true, 1), [Told::GoesOn]);
        assert_eq!(looks(9, true, STANDS), [Told::Stands]);
        assert_eq!(Standstill::new(Span::from_secs(10)).needed, 200);
    }

    #[test]
    fn any_progress_starts_anew() {
        let mut suspicion = Suspicion::new(Span::from_millis(150));
        for cycle in 0..10 {
            assert_eq!((0..LOOKS).find_map(|_| suspicion.look(cycle, CALL)), None);
        }
        assert_eq!(suspicion.look(9, None), None);
        assert_eq!((0..LOOKS).find_map(|_| suspicion.look(9, CALL)), None);
        assert_eq!(
            (0..1_000).find_map(|call| suspicion.look(9, Some((call, BLOCK)))),
            None,
            "the program calls it again"
        );
    }

    #[test]
    fn a_long_watchdog_is_waited_for_twice() {
        let mut suspicion = Suspicion::new(Span::from_secs(6));
        assert_eq!((0..120).find_map(|_| suspicion.look(1, CALL)), None);
        assert_eq!(suspicion.look(1, CALL), Some(BLOCK));
        assert_eq!(Suspicion::new(Span::ZERO).needed, LOOKS_WITHOUT_WATCHDOG);
    }
}
