//! When the server checks whether something is to be published: right after sampling.
//!
//! The library publishes at the first check after a publishing interval has passed, and counts the next interval from
//! that check. With a check every millisecond an interval of 100 ms becomes 100.5 ms, so the checks drift against the
//! samples, and a value waits between zero and one interval. Here the server's own future makes the check: it is polled
//! only at beats. Beats are one step apart, to the microsecond, and where changes come as regularly, each beat comes
//! right after them. (Connections are separate tasks; a new one waits for the next beat.)
//!
//! A beat is a little later than due, never earlier. When beats have drifted from regular changes by a quarter of a
//! step, one beat is moved back to its sample; the changes of that step are published with the next beat.

use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::Poll;
use std::time::{Duration, Instant};

use tokio::sync::watch;
use tokio::time::{sleep, sleep_until};

/// Longest time between two beats, which is also the longest wait of a new connection.
const LONGEST: Duration = Duration::from_millis(100);
/// Shortest time between two beats: publishing intervals without a common divisor are rounded up to multiples of it.
const SHORTEST: Duration = Duration::from_millis(10);
/// Time between two beats without subscriptions.
const IDLE: Duration = Duration::from_millis(50);
/// The library usually reads its clock at most this long after a beat begins.
const MARGIN: Duration = Duration::from_micros(20);
/// The runtime's timers have a resolution of a millisecond: the rest is waited for by yielding, while other tasks run.
const COARSE: Duration = Duration::from_micros(1_200);
/// Time to a second check after each beat, for an interval that ended a moment too late for it.
const ECHO: Duration = Duration::from_millis(1);
/// Minimum number of steps between two beats that are moved back: at most one in two hundred is late because of it.
const SLIPS: u32 = 200;
/// Time between two updates of the clients' intervals.
const REFRESH: Duration = Duration::from_secs(1);

/// The times of sampled changes.
pub(crate) struct Pace {
    /// When changes were last handed to the subscriptions.
    told: watch::Sender<Option<Instant>>,
}

impl Pace {
    pub(crate) fn new() -> Self {
        Self { told: watch::Sender::new(None) }
    }

    /// Changes have been handed to the subscriptions.
    pub(crate) fn told(&self) {
        self.told.send_replace(Some(Instant::now()));
    }
}

/// Runs a server at beats; `intervals` gives the publishing intervals of its clients.
pub(crate) async fn conduct<F: Future>(server: F, pace: &Pace, intervals: impl Fn() -> Vec<Duration>) -> F::Output {
    let mut server = pin!(server);
    let mut told = pace.told.subscribe();
    let mut beats = Beats::new(Instant::now());
    let mut refreshed = None;
    loop {
        beats.last = Instant::now();
        for echo in [false, true] {
            if echo {
                sleep(ECHO).await;
            }
            if let Poll::Ready(ended) = poll_fn(|context| Poll::Ready(server.as_mut().poll(context))).await {
                return ended;
            }
        }
        if refreshed.is_none_or(|at: Instant| at.elapsed() >= REFRESH) {
            beats.measure(&intervals());
            refreshed = Some(Instant::now());
        }
        let mut due = beats.due();
        loop {
            if told.has_changed().unwrap_or(false)
                && let Some(at) = *told.borrow_and_update()
            {
                due = beats.told(at);
            }
            let early = due.saturating_duration_since(Instant::now());
            if early.is_zero() {
                break;
            }
            if beats.exact && early <= COARSE {
                tokio::task::yield_now().await;
                continue;
            }
            let sleep = due - if beats.exact { COARSE } else { Duration::ZERO };
            tokio::select! {
                // Its sender lives as long as this function runs.
                _ = told.changed() => told.mark_changed(),
                () = sleep_until(sleep.into()) => {}
            }
        }
    }
}

/// When the next beat is due.
#[derive(Clone, Copy, Debug)]
struct Beats {
    last: Instant,
    step: Duration,
    /// There are subscriptions.
    exact: bool,
    /// The newest changes.
    told: Option<Instant>,
    /// When the next changes are expected, if they come regularly.
    expected: Option<Instant>,
    /// When a beat was last moved back.
    slipped: Option<Instant>,
}

impl Beats {
    fn new(now: Instant) -> Self {
        Self { last: now, step: IDLE, exact: false, told: None, expected: None, slipped: None }
    }

    /// The step for these publishing intervals: each is a multiple of it.
    fn measure(&mut self, intervals: &[Duration]) {
        let common = intervals.iter().map(Duration::as_millis).fold(0, gcd);
        let parts = common.div_ceil(LONGEST.as_millis()).max(1);
        self.exact = common > 0;
        self.step = if self.exact { (Duration::from_millis(common as u64) / parts as u32).max(SHORTEST) } else { IDLE };
    }

    /// How far a beat may be behind regular changes, and how regular they must be.
    fn slack(&self) -> Duration {
        self.step / 4
    }

    /// The end of a whole step.
    fn whole(&self) -> Instant {
        self.last + self.step + MARGIN
    }

    /// One step after the last beat; changes expected at about that time are waited for.
    fn due(&self) -> Instant {
        let whole = self.whole();
        let near = |expected: &Instant| apart(whole, *expected) <= self.slack();
        self.expected.filter(near).map_or(whole, |expected| whole.max(expected + self.slack()))
    }

    /// The beat for these changes: as soon as the step is over. Regular changes that would wait too long move the beats
    /// to themselves, whatever happens to this step.
    fn told(&mut self, at: Instant) -> Instant {
        let pause = self.told.replace(at).map_or(Duration::ZERO, |before| at.saturating_duration_since(before));
        let steps = ((pause + self.step / 2).as_micros() / self.step.as_micros()) as u32;
        let regular = (1..=10).contains(&steps) && pause.abs_diff(self.step * steps) <= self.slack();
        self.expected = regular.then(|| at + pause);
        let whole = self.whole();
        let slip = self.exact
            && regular
            && whole.saturating_duration_since(at) > self.slack()
            && self.slipped.is_none_or(|slipped| at.saturating_duration_since(slipped) >= self.step * SLIPS);
        if slip {
            self.slipped = Some(at);
            return at;
        }
        whole.max(at)
    }
}

fn apart(a: Instant, b: Instant) -> Duration {
    a.saturating_duration_since(b).max(b.saturating_duration_since(a))
}

fn gcd(a: u128, b: u128) -> u128 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn measured(intervals: &[u32]) -> Beats {
        let mut beats = Beats::new(Instant::now());
        beats.measure(&intervals.iter().map(|ms| MS * *ms).collect::<Vec<_>>());
        beats
    }

    #[test]
    fn every_interval_is_a_multiple_of_the_step() {
        for (intervals, step) in
            [(&[100][..], 100), (&[50], 50), (&[100, 150], 50), (&[1000], 100), (&[100, 133], 10), (&[], 50)]
        {
            let beats = measured(intervals);
            assert_eq!((beats.step, beats.exact), (MS * step, !intervals.is_empty()), "{intervals:?}");
        }
    }

    /// A model of the library with one subscription: at which of these checks it publishes.
    fn published(looks: &[Instant], interval: Duration) -> Vec<Instant> {
        let mut last = looks[0];
        looks
            .iter()
            .copied()
            .filter(|look| {
                *look - last >= interval && {
                    last = *look;
                    true
                }
            })
            .collect()
    }

    /// Changes at these times, and beats between them, each `late` after it is due.
    fn play(mut beats: Beats, changes: &[Instant], late: impl Fn(usize) -> Duration) -> Vec<Instant> {
        let mut looks = vec![beats.last];
        let mut changes = changes.iter().copied().peekable();
        while changes.peek().is_some() {
            let mut due = beats.due();
            while let Some(change) = changes.next_if(|change| *change <= due) {
                due = beats.told(change);
            }
            beats.last = due + late(looks.len());
            looks.push(beats.last);
        }
        looks
    }

    /// How long changes wait until they are published, sorted, in microseconds.
    fn waits(changes: &[Instant], published: &[Instant]) -> Vec<u128> {
        let behind = |change: &Instant| published.iter().find(|at| *at >= change).map(|at| (*at - *change).as_micros());
        let mut waits: Vec<u128> = changes.iter().filter_map(behind).collect();
        waits.sort_unstable();
        waits
    }

    fn share(waits: &[u128], per_mille: usize) -> u128 {
        waits[(waits.len() - 1) * per_mille / 1000]
    }

    /// A beat is a little late, sometimes very late.
    fn late(n: usize) -> Duration {
        if n.is_multiple_of(499) { MS * 3 } else { Duration::from_micros(15) }
    }

    #[test]
    fn regular_changes_are_published_at_once_and_nearly_all_of_them_for_ever() {
        for interval in [50, 100] {
            let mut beats = measured(&[interval]);
            beats.last += MS * 37;
            // To the millisecond, like the runtime's timers.
            let begin = beats.last + MS * 60;
            let changes: Vec<Instant> = (1..4_000).map(|n| begin + MS * 100 * n + (MS / 10) * (n * 7 % 10)).collect();
            let waits = waits(&changes, &published(&play(beats, &changes, late), MS * interval));
            let [half, nearly, all] = [500, 990, 1000].map(|per_mille| share(&waits, per_mille));
            assert!(half < 20_000 && nearly < 30_000 && all < 110_000, "{interval} ms: {half}, {nearly}, {all} us");
        }
    }

    #[test]
    fn what_changes_at_any_time_waits_for_an_interval_at_most() {
        let beats = measured(&[100]);
        let mut at = beats.last;
        // 3 to 402 ms apart.
        let changes: Vec<Instant> = (0..4_000_u32)
            .map(|n| {
                at += MS * (3 + n.wrapping_mul(2_654_435_761) % 400);
                at
            })
            .collect();
        let waits = waits(&changes, &published(&play(beats, &changes, late), MS * 100));
        assert!(share(&waits, 985) < 105_000, "{} us", share(&waits, 985));
    }

    #[test]
    fn regular_changes_that_stay_away_are_waited_for_no_longer_than_a_quarter_of_a_step() {
        let mut beats = measured(&[100]);
        let begin = beats.last;
        beats.told(begin - MS * 100);
        beats.told(begin);
        assert_eq!(beats.due(), begin + MS * 125);
        beats.last = beats.due();
        assert_eq!(beats.due(), begin + MS * 225 + MARGIN);
    }

    #[tokio::test]
    async fn a_server_is_looked_at_again_and_again_and_its_end_is_told() {
        let mut looks = 0;
        let server = poll_fn(|_| {
            looks += 1;
            if looks == 5 { Poll::Ready("over") } else { Poll::Pending }
        });
        assert_eq!(conduct(server, &Pace::new(), Vec::new).await, "over");
        assert_eq!(looks, 5);
    }
}
