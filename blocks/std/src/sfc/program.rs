//! SFC 43 RE_TRIGR, SFC 46 STP, SFC 47 WAIT. ["Controlling Program Execution"]

use ob1_time::Span;

use crate::Done;
use crate::call::Call;
use crate::declare::{Declared, Params, params};
use crate::row::Row;

/// A block without parameters.
#[derive(Clone, Copy)]
struct Nothing;

impl Params for Nothing {
    const DECLARED: &'static [Declared] = &[];
    fn index(self) -> u32 {
        0
    }
}

params!(Wait { Input { WT: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::sfc::<Nothing>(43, "RE_TRIGR", |call| {
        call.cx.retrigger_watchdog();
        Ok(())
    }),
    Row::sfc::<Nothing>(46, "STP", |call| Err(call.cx.stop_by_program())),
    Row::sfc::<Wait>(47, "WAIT", wait).note("a time not above 0 does not wait"),
];

fn wait(call: &mut Call<'_>) -> Done {
    let time = call.int(Wait::WT);
    match u64::try_from(time) {
        Ok(microseconds @ 1..) => call.cx.wait(Span::from_micros(microseconds)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use ob1_time::Span;

    use crate::Abort;
    use crate::tests::Fake;

    #[test]
    fn the_program_is_controlled() {
        let mut fake = Fake::new("SYSTEM:SFC43");
        fake.run();
        assert_eq!((fake.retriggered, fake.ended), (1, Ok(())));
        let mut fake = Fake::new("SYSTEM:SFC46");
        fake.run();
        assert_eq!(fake.ended, Err(Abort));
        for (time, waited) in [(500i16, vec![Span::from_micros(500)]), (0, vec![]), (-1, vec![])] {
            let mut fake = Fake::new("SYSTEM:SFC47").with("WT", time.to_be_bytes());
            fake.run();
            assert_eq!((fake.station.waited, fake.ended), (waited, Ok(())));
        }
    }
}
