//! Random programs leave the same on the reference engine and on the native one.

mod random;

use ob1_cpu::engine::Factory;
use ob1_native::{AtLoad, Tier};
use random::Mixed;

/// Programs of a run in CI. A campaign: `cargo run --release -p ob1-native --example compare -- 1000000`.
const PROGRAMS: u64 = 2000;

fn campaign(first: u64, programs: u64, engines: &[&dyn Factory]) {
    let mut loaded = 0;
    for seed in first..first + programs {
        match random::compare(seed, 6, engines) {
            Ok(runs) => loaded += u64::from(runs),
            Err(difference) => panic!("{difference}"),
        }
    }
    assert!(loaded * 2 > programs, "only {loaded} of {programs} programs load");
}

#[test]
fn random_programs_do_the_same_optimised() {
    campaign(0, PROGRAMS * 2 / 5, &[&AtLoad(Tier::Optimised)]);
}

#[test]
fn random_programs_do_the_same_compiled_fast() {
    campaign(PROGRAMS * 2 / 5, PROGRAMS * 2 / 5, &[&AtLoad(Tier::Fast)]);
}

/// As a station takes machine code over.
#[test]
fn random_programs_do_the_same_while_engines_change() {
    campaign(PROGRAMS * 4 / 5, PROGRAMS / 5, &[&AtLoad(Tier::Fast), &Mixed, &AtLoad(Tier::Optimised)]);
}

/// Breakpoints and steps change nothing but the time, on every engine and while engines change. A campaign: the example
/// above with `held` behind its numbers.
#[test]
fn random_programs_do_the_same_held() {
    let (mut holds, programs) = (0, PROGRAMS / 4);
    for seed in 0..programs {
        match random::compare_held(seed) {
            Ok((_, seen)) => holds += seen,
            Err(difference) => panic!("{difference}"),
        }
    }
    assert!(holds > 4 * programs, "only {holds} holds in {programs} programs");
}

/// Watching one block or another changes nothing, and passes are seen: on the reference engine, on machine code, and
/// while engines change. A campaign: the example above with `watched` behind its numbers.
#[test]
fn random_programs_do_the_same_watched() {
    let mut passes = 0;
    for seed in 0..PROGRAMS {
        match random::compare_watched(seed) {
            Ok((_, seen)) => passes += seen,
            Err(difference) => panic!("{difference}"),
        }
    }
    assert!(passes > PROGRAMS / 2, "only {passes} passes in {PROGRAMS} programs");
}
