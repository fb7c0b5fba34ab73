//! Differences of a CP 340 from a CP 341. The rest is in the CP 341's tests, because it is the same machine.

use ob1_fakes::cp_port::CpLog;
use ob1_firmware::cp341::Cp341;
use ob1_firmware::{Cp as _, CpInput, Instant};
use ob1_params::{Cp341 as Parameters, CpKind, Value};

/// [CP 340 manual 04/2011, p. 143], [CP 341 manual 09/2008, p. 204]
#[test]
fn wrong_parameters_of_a_cp_340_have_its_own_byte() {
    for (kind, byte) in [(CpKind::Cp340, 0x81), (CpKind::Cp341, 0x83)] {
        let (mut cp, mut port) = (Cp341::of(kind, 1), CpLog::default());
        assert_eq!(cp.kind(), kind);
        cp.enable_diagnostics(true);
        cp.step(Instant::START, CpInput::CpuRun(true), &mut port);
        let wrong = Parameters::of_kind(kind, [("protocol", Value::from("none of them"))]).expect_err("wrong");
        cp.step(Instant::from_nanos(1), CpInput::Keys(Err(&wrong)), &mut port);
        let record = |port: &CpLog| port.records.last().expect("diagnostic data")[..4].to_vec();
        assert_eq!((record(&port), port.interrupts.len()), (vec![byte, 0x0C, 0, 0], 1));
        assert_eq!(port.interrupts[0].1[..4], [byte, 0x0C, 0, 0]);
        let good = Parameters::of_kind(kind, [("protocol", Value::from("3964r"))]).expect("parameters");
        cp.step(Instant::from_nanos(2), CpInput::Keys(Ok(&good)), &mut port);
        assert_eq!(record(&port), [0, 0x0C, 0, 0]);
    }
}
