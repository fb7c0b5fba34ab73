//! IEC timers: SFB 3 TP, SFB 4 TON, SFB 5 TOF. They count in the system time of SFC 64 and are brought up to date by
//! each call. A call with PT = 0 also initialises the instance: a program makes one in OB 100 when a timer is to begin
//! anew after a warm restart. ["IEC Timers and IEC Counters"]

use crate::Done;
use crate::call::Call;
use crate::declare::{Params, params};
use crate::row::Row;
use crate::ticks::time_tick;

params!(Timer {
    Input { IN: BOOL, PT: TIME }
    Output { Q: BOOL, ET: TIME }
    Static { STATE: BYTE, STIME: TIME, ATIME: TIME }
});

pub(super) const ROWS: &[Row] = &[
    Row::sfb::<Timer>(3, "TP", |call| run(call, pulse, State::runs)),
    Row::sfb::<Timer>(4, "TON", |call| run(call, on_delay, State::is_over)),
    Row::sfb::<Timer>(5, "TOF", |call| run(call, off_delay, State::holds)),
];

/// The state of a timer. The elapsed time itself wraps after 24 days, so that its end is kept.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Waits for its edge; a TOF with Q = 0.
    Idle,
    Running,
    /// The time is over; IN has not gone back.
    Over,
    /// TOF only: IN is 1.
    Held,
}

impl State {
    const fn from_byte(byte: u8) -> Self {
        match byte {
            1 => State::Running,
            2 => State::Over,
            3 => State::Held,
            _ => State::Idle,
        }
    }

    /// The output of a pulse.
    pub(super) fn runs(self) -> bool {
        self == State::Running
    }

    /// The output of an on-delay.
    pub(super) fn is_over(self) -> bool {
        self == State::Over
    }

    /// The output of an off-delay.
    pub(super) fn holds(self) -> bool {
        matches!(self, State::Held | State::Running)
    }
}

/// The timer's step: old state, IN, whether the time is over; the new state.
pub(super) type Step = fn(State, bool, bool) -> State;

fn run(call: &mut Call<'_>, step: Step, output: fn(State) -> bool) -> Done {
    let now = time_tick(call.cx.now());
    turn(call, now, [Timer::STATE, Timer::STIME], step, output);
    call.set(Timer::ATIME, now);
    Ok(())
}

/// One call of a timer with these statics; the state it keeps.
pub(super) fn turn<P: Params>(
    call: &mut Call<'_>,
    now: u32,
    [state, start]: [P; 2],
    step: Step,
    output: fn(State) -> bool,
) -> State {
    let (input, preset) = (call.bool(Timer::IN), call.dint(Timer::PT));
    let before = Moment { state: State::from_byte(call.byte(state)), start: call.raw(start) };
    let Reached { kept, state: reached, elapsed } = before.next(step, now, input, preset);
    call.set(state, kept.state as u32);
    call.set(start, kept.start);
    call.set_dint(Timer::ET, elapsed);
    call.set_bool(Timer::Q, output(reached));
    kept.state
}

/// The state of a timer, and since when it runs.
#[derive(Clone, Copy)]
struct Moment {
    state: State,
    start: u32,
}

/// What a call has reached.
#[derive(Clone, Copy)]
struct Reached {
    /// For the next call.
    kept: Moment,
    /// The state that decides Q.
    state: State,
    /// ET, elapsed time in milliseconds.
    elapsed: i32,
}

impl Moment {
    /// The next moment. A PT below 0, which the manual does not allow, counts as 0.
    fn next(self, step: Step, now: u32, input: bool, preset: i32) -> Reached {
        let (Self { state, mut start }, preset) = (self, preset.max(0));
        // "call with PT = 0 ms in OB 100": what was before is forgotten, and so is this call.
        let old = if preset == 0 { State::Idle } else { state };
        let elapsed = now.wrapping_sub(start) & 0x7FFF_FFFF;
        let mut new = step(old, input, old == State::Running && elapsed as i32 >= preset);
        if new == State::Running && old != State::Running {
            start = now;
            // A time of 0 is over at once.
            if preset == 0 {
                new = step(new, input, true);
            }
        }
        let shown = match new {
            State::Idle | State::Held => 0,
            State::Running if old == State::Running => elapsed as i32,
            State::Running => 0,
            State::Over => preset,
        };
        let kept = Self { state: if preset == 0 { State::Idle } else { new }, start };
        Reached { kept, state: new, elapsed: shown }
    }
}

/// A pulse of PT, whatever IN does meanwhile.
pub(super) const fn pulse(state: State, input: bool, over: bool) -> State {
    match state {
        State::Running if !over => State::Running,
        State::Running | State::Over if input => State::Over,
        State::Running | State::Over => State::Idle,
        _ if input => State::Running,
        _ => State::Idle,
    }
}

/// Q follows IN's rise after PT.
pub(super) const fn on_delay(state: State, input: bool, over: bool) -> State {
    match state {
        _ if !input => State::Idle,
        State::Running if over => State::Over,
        State::Over => State::Over,
        _ => State::Running,
    }
}

/// Q follows IN's fall after PT.
pub(super) const fn off_delay(state: State, input: bool, over: bool) -> State {
    match state {
        _ if input => State::Held,
        State::Held => State::Running,
        State::Running if over => State::Over,
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use ob1_time::Instant;

    use crate::tests::Fake;

    /// Time in ms, IN; Q and ET after the call.
    type Row = (u64, u8, u32, i32);

    fn check(key: &str, pt: i32, moments: &[Row]) {
        let mut fake = Fake::new(key).with("PT", pt.to_be_bytes());
        for (ms, input, q, et) in moments {
            fake.now = Instant::from_millis(*ms);
            fake = fake.with("IN", [*input]);
            fake.run();
            assert_eq!((fake.value("Q"), fake.dint("ET")), (*q, *et), "{key} at {ms} ms");
        }
    }

    #[test]
    fn pulses() {
        check(
            "SYSTEM:SFB3",
            100,
            &[
                (5, 0, 0, 0),
                (10, 1, 1, 0),
                (50, 0, 1, 40),
                (60, 1, 1, 50),
                (110, 1, 0, 100),
                (300, 1, 0, 100),
                (301, 0, 0, 0),
                (302, 1, 1, 0),
            ],
        );
        check("SYSTEM:SFB3", 100, &[(0, 1, 1, 0), (10, 0, 1, 10), (200, 0, 0, 0)]);
        check("SYSTEM:SFB3", 0, &[(0, 1, 0, 0), (10, 1, 0, 0), (20, 0, 0, 0)]);
    }

    #[test]
    fn on_delays() {
        check(
            "SYSTEM:SFB4",
            100,
            &[(0, 0, 0, 0), (10, 1, 0, 0), (109, 1, 0, 99), (110, 1, 1, 100), (500, 1, 1, 100), (501, 0, 0, 0)],
        );
        check("SYSTEM:SFB4", 100, &[(10, 1, 0, 0), (50, 0, 0, 0), (60, 1, 0, 0), (159, 1, 0, 99), (160, 1, 1, 100)]);
        check("SYSTEM:SFB4", -5, &[(10, 1, 1, 0)]);
    }

    #[test]
    fn off_delays() {
        check(
            "SYSTEM:SFB5",
            100,
            &[
                (0, 0, 0, 0),
                (10, 1, 1, 0),
                (20, 0, 1, 0),
                (119, 0, 1, 99),
                (120, 0, 0, 100),
                (300, 0, 0, 100),
                (301, 1, 1, 0),
            ],
        );
        check(
            "SYSTEM:SFB5",
            100,
            &[(10, 1, 1, 0), (20, 0, 1, 0), (50, 1, 1, 0), (60, 0, 1, 0), (159, 0, 1, 99), (160, 0, 0, 100)],
        );
    }

    #[test]
    fn a_call_without_a_time_initialises() {
        // TP and TON are over with IN = 1, TOF after IN has fallen.
        for (key, end, q) in [("SYSTEM:SFB3", 1, 1), ("SYSTEM:SFB4", 1, 0), ("SYSTEM:SFB5", 0, 0)] {
            let mut fake = Fake::new(key).with("PT", 100i32.to_be_bytes());
            for (ms, input) in [(0, 1), (1, end), (500, end)] {
                fake.now = Instant::from_millis(ms);
                fake = fake.with("IN", [input]);
                fake.run();
            }
            // OB 100 of a warm restart, then OB 1 again.
            for (ms, pt) in [(600, 0i32), (601, 100)] {
                fake.now = Instant::from_millis(ms);
                fake = fake.with("PT", pt.to_be_bytes());
                fake.run();
            }
            assert_eq!((fake.value("Q"), fake.dint("ET")), (q, 0), "{key} begins anew");
        }
    }

    #[test]
    fn the_system_time_wraps_after_24_days() {
        let wrap = 0x8000_0000;
        check(
            "SYSTEM:SFB4",
            100,
            &[(wrap - 50, 1, 0, 0), (wrap + 49, 1, 0, 99), (wrap + 50, 1, 1, 100), (2 * wrap, 1, 1, 100)],
        );
    }
}
