//! Differences of a CP 340 from a CP 341. The rest is in the CP 341's tests, because it is the same machine.

use ob1_firmware::cp341::{Channel, ChannelBlock, Cp341};
use ob1_firmware::{Cp as _, CpCounter, CpEvent, CpInput, CpPort, Instant, Leds, LineSettings, Wire};
use ob1_params::{Cp341 as Parameters, CpKind, Value};

#[derive(Default)]
struct Port {
    record: Vec<u8>,
    interrupts: Vec<Vec<u8>>,
}

impl Wire for Port {
    fn transmit(&mut self, _: &[u8]) {}
}

impl CpPort for Port {
    fn inputs(&mut self, _: &[u8]) {}

    fn channel(&mut self, _: Channel, _: &ChannelBlock) {}

    fn line_settings(&mut self, _: &LineSettings) {}

    fn leds(&mut self, _: Leds) {}

    fn count(&mut self, _: CpCounter, _: u64) {}

    fn record(&mut self, record: &[u8]) {
        self.record = record.to_vec();
    }

    fn event(&mut self, _: Instant, event: CpEvent<'_>) {
        if let CpEvent::Diagnosis { data, .. } = event {
            self.interrupts.push(data[..4].to_vec());
        }
    }
}

/// [CP 340 manual 04/2011, p. 143], [CP 341 manual 09/2008, p. 204]
#[test]
fn wrong_parameters_of_a_cp_340_have_its_own_byte() {
    for (kind, byte) in [(CpKind::Cp340, 0x81), (CpKind::Cp341, 0x83)] {
        let (mut cp, mut port) = (Cp341::of(kind, 1), Port::default());
        assert_eq!(cp.kind(), kind);
        cp.enable_diagnostics(true);
        cp.step(Instant::START, CpInput::CpuRun(true), &mut port);
        let wrong = Parameters::of_kind(kind, [("protocol", Value::from("none of them"))]).expect_err("wrong");
        cp.step(Instant::from_nanos(1), CpInput::Keys(Err(&wrong)), &mut port);
        assert_eq!(
            (&port.record[..4], port.interrupts.as_slice()),
            (&[byte, 0x0C, 0, 0][..], &[vec![byte, 0x0C, 0, 0]][..])
        );
        let good = Parameters::of_kind(kind, [("protocol", Value::from("3964r"))]).expect("parameters");
        cp.step(Instant::from_nanos(2), CpInput::Keys(Ok(&good)), &mut port);
        assert_eq!(port.record[..4], [0, 0x0C, 0, 0]);
    }
}
