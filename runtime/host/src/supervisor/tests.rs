//! The supervisor in virtual time: tables of (time in ms, input, expected request and report).

use ob1_time::{Instant, Span};

use super::*;

const MS: Span = Span::MILLISECOND;

fn at(ms: u64) -> Instant {
    Instant::from_millis(ms)
}

/// Runs a table; times in milliseconds.
fn run(supervisor: &mut Supervisor, table: &[(u64, Input, Option<Request>, Option<Report>)]) {
    for (row, &(ms, input, request, report)) in table.iter().enumerate() {
        let step = supervisor.step(at(ms), input);
        assert_eq!((step.request, step.report), (request, report), "row {row}, {ms} ms, {input:?}");
    }
}

const KILLED: Input = Input::Exited(Exit::Signal(9));
const LOST: Option<Report> = Some(Report::Lost(Exit::Signal(9)));
const SPAWN: Option<Request> = Some(Request::Spawn);

fn up() -> Supervisor {
    let mut supervisor = Supervisor::new(Times::default());
    run(
        &mut supervisor,
        &[
            (0, Input::Tick, SPAWN, None),
            (1, Input::Spawned, None, None),
            (4, Input::Heartbeat, None, Some(Report::Up(1))),
        ],
    );
    supervisor
}

#[test]
fn a_killed_driver_starts_again_at_once() {
    let mut supervisor = up();
    run(
        &mut supervisor,
        &[
            (100, KILLED, SPAWN, LOST),
            (101, Input::Tick, None, None),
            (102, Input::Spawned, None, None),
            (105, Input::Heartbeat, None, Some(Report::Up(2))),
        ],
    );
    assert_eq!((supervisor.phase(), supervisor.starts()), (Phase::Up, 2));
}

#[test]
fn the_wait_grows_to_its_longest_and_no_further() {
    let mut supervisor = up();
    let mut now = at(10);
    let mut waits = Vec::new();
    for _ in 0..9 {
        let step = supervisor.step(now, KILLED);
        let start_at = if step.request == SPAWN { now } else { step.deadline.expect("a start is due") };
        if step.request.is_none() {
            assert_eq!(supervisor.step(start_at - Span::from_nanos(1), Input::Tick).request, None);
            assert_eq!(supervisor.step(start_at, Input::Tick).request, SPAWN);
        }
        waits.push((start_at - now) / MS);
        now = start_at + MS;
        supervisor.step(now, Input::Spawned);
        now += 2 * MS;
        supervisor.step(now, Input::Heartbeat);
    }
    assert_eq!(waits, [0, 50, 100, 200, 400, 800, 800, 800, 800]);
}

#[test]
fn five_seconds_of_health_forget_the_failures() {
    let mut supervisor = up();
    run(
        &mut supervisor,
        &[
            (10, KILLED, SPAWN, LOST),
            (11, Input::Spawned, None, None),
            (12, Input::Heartbeat, None, Some(Report::Up(2))),
            (5011, Input::Heartbeat, None, None),
            // One millisecond short of five seconds.
            (5011, KILLED, None, LOST),
            (5061, Input::Tick, SPAWN, None),
            (5062, Input::Spawned, None, None),
            (5063, Input::Heartbeat, None, Some(Report::Up(3))),
            (10_063, Input::Heartbeat, None, None),
            (10_064, KILLED, SPAWN, LOST),
        ],
    );
}

#[test]
fn a_hang_is_killed_and_reported_as_a_hang() {
    let mut supervisor = up();
    run(
        &mut supervisor,
        &[
            (900, Input::Heartbeat, None, None),
            (1899, Input::Tick, None, None),
            (1900, Input::Tick, Some(Request::Kill), None),
            (1901, Input::Tick, None, None),
            // A last beat of the dying changes nothing.
            (1902, Input::Heartbeat, None, None),
            (1903, KILLED, SPAWN, Some(Report::Lost(Exit::Hung))),
        ],
    );
}

#[test]
fn a_driver_that_is_kept_from_beating_is_no_hang() {
    let mut supervisor = up();
    run(
        &mut supervisor,
        &[
            (900, Input::Starved, None, None),
            (1800, Input::Starved, None, None),
            (1900, Input::Heartbeat, None, Some(Report::HeldUp(1896 * MS))),
            // Not worth a word.
            (2700, Input::Starved, None, None),
            (2800, Input::Heartbeat, None, None),
            (3600, Input::Starved, None, None),
            // Free again: a second from the last time that it was not.
            (4599, Input::Tick, None, None),
            (4600, Input::Tick, Some(Request::Kill), None),
            (4603, KILLED, SPAWN, Some(Report::Lost(Exit::Hung))),
            (4604, Input::Spawned, None, None),
            (9000, Input::Starved, None, None),
            (9100, Input::Heartbeat, None, Some(Report::Up(2))),
            (9200, Input::Starved, None, None),
            // For ever is too long: half a minute from the last sign of life.
            (39_099, Input::Starved, None, None),
            (39_100, Input::Starved, Some(Request::Kill), None),
        ],
    );
}

#[test]
fn a_driver_that_never_answers_is_killed_too() {
    let mut supervisor = Supervisor::new(Times::default());
    run(
        &mut supervisor,
        &[
            (0, Input::Tick, SPAWN, None),
            (1, Input::Spawned, None, None),
            (5000, Input::Tick, None, None),
            (5001, Input::Tick, Some(Request::Kill), None),
            (5002, KILLED, SPAWN, Some(Report::Lost(Exit::Hung))),
        ],
    );
}

#[test]
fn a_program_that_is_missing_is_reported_once() {
    let missing = Exit::NotStarted(2);
    let mut supervisor = Supervisor::new(Times::default());
    run(
        &mut supervisor,
        &[
            (0, Input::Tick, SPAWN, None),
            (0, Input::Exited(missing), SPAWN, Some(Report::Lost(missing))),
            (0, Input::Exited(missing), None, None),
            (49, Input::Tick, None, None),
            (50, Input::Tick, SPAWN, None),
            (50, Input::Exited(missing), None, None),
            (150, Input::Tick, SPAWN, None),
            (151, Input::Spawned, None, None),
            (152, Input::Heartbeat, None, Some(Report::Up(1))),
        ],
    );
}

#[test]
fn a_stopped_supervisor_starts_nothing() {
    let mut supervisor = up();
    supervisor.stop();
    run(&mut supervisor, &[(10, KILLED, None, None), (10_000, Input::Tick, None, None)]);
    assert_eq!(supervisor.step(at(20_000), Input::Tick).deadline, None);
}

#[test]
fn every_deadline_lies_ahead_or_is_answered() {
    // Whatever comes in whatever order, following the deadlines never stands still.
    let inputs = [Input::Tick, Input::Spawned, Input::Heartbeat, Input::Starved, KILLED];
    let mut seed = 1u64;
    let mut supervisor = Supervisor::new(Times::default());
    let mut now = at(0);
    for _ in 0..10_000 {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        now += Span::from_nanos((seed >> 40) % (700 * MS).nanos());
        let step = supervisor.step(now, inputs[(seed >> 33) as usize % inputs.len()]);
        if let (None, Some(deadline)) = (step.request, step.deadline)
            && deadline <= now
        {
            let next = supervisor.step(now, Input::Tick);
            assert!(next.request.is_some(), "a deadline at {deadline} that asks for nothing at {now}");
        }
    }
}

#[test]
fn exits_fit_the_sixteen_bytes_of_an_event() {
    let texts: Vec<String> = [Exit::Code(1), Exit::Code(255), Exit::Signal(9), Exit::Hung, Exit::NotStarted(2)]
        .iter()
        .map(ToString::to_string)
        .collect();
    assert_eq!(texts, ["exit status 1", "exit status 255", "signal 9", "hung, killed", "no start, os 2"]);
    assert!(texts.iter().all(|text| text.len() <= 16));
}

#[test]
fn an_incident_lasts_until_a_driver_is_healthy() {
    let mut supervisor = up();
    assert_eq!(supervisor.incidents(), 0);
    let mut now = 10;
    for _ in 0..20 {
        supervisor.step(at(now), KILLED);
        assert_eq!(supervisor.incidents(), 1, "one crash after the other");
        supervisor.step(at(now + 1000), Input::Tick);
        supervisor.step(at(now + 1001), Input::Spawned);
        supervisor.step(at(now + 1002), Input::Heartbeat);
        now += 1003;
    }
    supervisor.step(at(now + 5000), KILLED);
    assert_eq!(supervisor.incidents(), 2, "it was healthy in between");
}
