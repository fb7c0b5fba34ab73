//! The loadable driver in its CP: parameters, jobs of P_SND_RK, replies for P_RCV_RK. [S4 "6 CPU – CP Interface"]
//!
//! A reply is kept in the receive buffer like any telegram, and there is never more than one: the driver's job
//! continues until P_RCV_RK has it. If the job ends before that, the reply is removed: "no receive data are transferred
//! to the CPU" [S4 L1652].

use ob1_params::{LineSettings, ModbusMaster32, StopBits};
use ob1_protocols::Span;
use ob1_protocols::modbus_master_32::{Driver, Owner, Parameters, Signals, Wiring};

use super::outlet::Outlet;
use crate::port::{Counter, CpEvent};

/// The driver with these parameters. `late`: how late the line may hand over characters.
pub(super) fn of(p: &ModbusMaster32, line: &LineSettings, late: Span) -> Driver {
    Driver::new(Parameters {
        baud: line.baud,
        data_bits: line.data_bits,
        stop_bits: if line.stop_bits == StopBits::One { 1 } else { 2 },
        parity: line.parity,
        character_delay_ms: p.character_delay_ms,
        response_timeout_ms: p.response_timeout_ms,
        turnaround_ms: p.turnaround_ms,
        operating_mode: if p.suppresses_interference {
            Parameters::INTERFERENCE_SUPPRESSION
        } else {
            Parameters::NORMAL
        },
        long_registers: p.long_registers,
        wiring: Wiring { half_duplex: p.half_duplex, breaks: p.breaks },
        signals: p.signals.map(|(rts_off_ms, output_wait_ms)| Signals { rts_off_ms, output_wait_ms }),
        late,
    })
}

impl Owner for Outlet<'_> {
    fn deliver(&mut self, destination: &[u8]) {
        self.parts.ring.push(destination);
        self.port.count(Counter::TelegramsReceived, 1);
        self.port.event(self.now, CpEvent::Received(destination));
    }

    fn ended(&mut self, outcome: Result<(), u16>) {
        self.collected.ended = Some(outcome.map(|()| 0));
    }

    fn event(&mut self, number: u16) {
        self.enter(number);
    }
}
