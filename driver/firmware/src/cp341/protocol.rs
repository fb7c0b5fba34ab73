//! From the parameters to the protocol machine.

use std::fmt;

use ob1_params::{AsciiOf341, Cp341 as Parameters, CpKind, EndOf341, Protocol341, S3964Of341, SendingOf341};
use ob1_protocols::modbus_master_32::{self, Driver};
use ob1_protocols::rk512::{self, Rk512};
use ob1_protocols::{
    Ascii, Input, Instant, LineFault, LineInput, MS, Machine, ModemLines, Order, S3964, Sink, Span, ascii, s3964,
    signals,
};

use super::loadable;
use super::model::{JOB_MAX, JOB_MAX_340};
use crate::choose_reason::Reason;
use crate::printer::Printer;
use crate::protocol::{priority, stopped_by};

/// The protocol that the parameters have chosen, running.
pub(crate) enum Protocol {
    /// No valid parameters: nothing is sent or received.
    None,
    Plain(Plain),
    /// Output only: the input is XON and XOFF, or nothing.
    Printer(Box<Printer>, Plain),
    Rk512(Box<Rk512<JOB_MAX>>),
    Loadable(Box<Driver>),
}

/// A protocol whose telegrams have no header and belong to no job: ASCII, 3964(R).
pub(crate) struct Plain {
    /// Boxed, because its buffers are as long as the CP's telegrams.
    machine: Box<dyn Machine>,
    /// Whether the protocol drives RTS and DTR: flow control, automatic use.
    driven: (bool, bool),
    is_acknowledged: bool,
    flow: ascii::Flow,
}

impl Plain {
    fn ascii(config: &ascii::Config, kind: CpKind) -> Self {
        let (automatic, flow) = (config.signals.is_some(), config.flow);
        let driven = (automatic || flow == ascii::Flow::Hardware, automatic);
        let machine: Box<dyn Machine> = match kind {
            CpKind::Cp340 => Box::new(Ascii::<JOB_MAX_340>::new(config)),
            _ => Box::new(Ascii::<JOB_MAX>::new(config)),
        };
        Self { machine, driven, is_acknowledged: false, flow }
    }

    fn s3964(config: s3964::Config, kind: CpKind) -> Self {
        let machine: Box<dyn Machine> = match kind {
            CpKind::Cp340 => Box::new(S3964::<JOB_MAX_340>::new(config)),
            _ => Box::new(S3964::<JOB_MAX>::new(config)),
        };
        Self { machine, driven: (false, false), is_acknowledged: true, flow: ascii::Flow::None }
    }

    /// A step of a protocol that does not listen.
    fn step_deaf(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match input {
            Input::Line(LineInput::Rx(bytes)) => {
                let steers =
                    |byte: &&u8| self.flow == ascii::Flow::XonXoff && [ascii::XON, ascii::XOFF].contains(*byte);
                let heard: Vec<u8> = bytes.iter().filter(steers).copied().collect();
                self.machine.step(
                    now,
                    if heard.is_empty() { Input::Tick } else { Input::Line(LineInput::Rx(&heard)) },
                    out,
                )
            }
            Input::Line(LineInput::Fault(LineFault::Parity | LineFault::Framing | LineFault::Overrun)) => {
                self.machine.step(now, Input::Tick, out)
            }
            other => self.machine.step(now, other, out),
        }
    }
}

impl fmt::Debug for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "None",
            Self::Plain(_) => "Plain",
            Self::Printer(..) => "Printer",
            Self::Rk512(_) => "Rk512",
            Self::Loadable(_) => "Loadable",
        })
    }
}

impl Protocol {
    /// `late`: how late the line may hand over characters.
    pub(crate) fn of(parameters: &Parameters, late: Span) -> Self {
        let char_time = parameters.line_settings().char_time();
        let p = match &parameters.protocol {
            Protocol341::Ascii(p) => {
                return Self::Plain(Plain::ascii(&ascii_config(p, parameters, late), parameters.kind));
            }
            Protocol341::Printer(p) => {
                let config = ascii::Config {
                    criterion: ascii::Criterion::Silence,
                    flow: parameters.line.flow,
                    flow_wait: u64::from(p.flow_wait_ms) * MS,
                    ..ascii::Config::unset(char_time)
                };
                // The output of one job may be longer than a CP 340's telegrams.
                return Self::Printer(Box::new(Printer::new(p)), Plain::ascii(&config, CpKind::Cp341));
            }
            Protocol341::S3964(p) => p,
            Protocol341::ModbusMaster32(p) => {
                return Self::Loadable(Box::new(loadable::of(p, &parameters.line_settings(), late)));
            }
        };
        let line = s3964_config(p, char_time);
        if p.rk512 {
            let mut config = rk512::Config::cp341(line);
            if p.reaction_by_baud {
                config.reaction = rk512::Config::reaction_at(parameters.line.baud);
            }
            Self::Rk512(Box::new(Rk512::new(config)))
        } else {
            Self::Plain(Plain::s3964(line, parameters.kind))
        }
    }

    /// One step; without a machine nothing happens.
    pub(crate) fn step<O: Sink + rk512::Owner + modbus_master_32::Owner>(
        &mut self,
        now: Instant,
        input: Input<'_>,
        out: &mut O,
    ) -> Option<Instant> {
        match self {
            Self::None => None,
            Self::Plain(plain) => plain.machine.step(now, input, out),
            Self::Printer(_, plain) => plain.step_deaf(now, input, out),
            // Its orders come through [`Protocol::rk512`].
            Self::Rk512(machine) => machine.step(now, input.with_orders(rk512::Order::Abort), out),
            Self::Loadable(driver) => driver.step(now, input.with_orders(modbus_master_32::Order::Abort), out),
        }
    }

    /// Whether an order is running.
    pub(crate) fn busy(&self) -> bool {
        match self {
            Self::None => false,
            Self::Plain(plain) | Self::Printer(_, plain) => plain.machine.busy(),
            Self::Rk512(machine) => machine.busy(),
            Self::Loadable(driver) => driver.busy(),
        }
    }

    /// What the running job waits for because the partner has stopped it; `lines`: the modem lines.
    pub(crate) fn stopped(&self, lines: ModemLines) -> Option<Reason> {
        match self {
            Self::Plain(plain) | Self::Printer(_, plain) => {
                plain.machine.is_stopped().then(|| stopped_by(plain.flow, lines))
            }
            _ => None,
        }
    }

    /// The RK 512 machine, if that is the protocol.
    pub(crate) fn rk512(&mut self) -> Option<&mut Rk512<JOB_MAX>> {
        match self {
            Self::Rk512(machine) => Some(machine),
            _ => None,
        }
    }

    /// Whether telegrams have no header and belong to no job: ASCII, 3964(R).
    pub(crate) const fn is_plain(&self) -> bool {
        matches!(self, Self::Plain(_))
    }

    /// Whether the protocol drives RTS and DTR: flow control, automatic use.
    pub(crate) fn driven(&self) -> (bool, bool) {
        match self {
            Self::Plain(plain) | Self::Printer(_, plain) => plain.driven,
            Self::Loadable(driver) => (driver.uses_signals(), driver.uses_signals()),
            _ => (false, false),
        }
    }

    /// Whether the partner acknowledges telegrams. If not, a job on a lost line must not count as done because its last
    /// bit has "left".
    pub(crate) const fn is_acknowledged(&self) -> bool {
        match self {
            Self::Plain(plain) | Self::Printer(_, plain) => plain.is_acknowledged,
            _ => true,
        }
    }

    /// Prints a job: returns the bytes for the line, and the STATUS with which the job ends after the output. With
    /// another protocol there is no printer. (docs/cp341-events.md)
    pub(crate) fn print(&mut self, job: &[u8]) -> Result<(Vec<u8>, Option<u16>), u16> {
        let Self::Printer(printer, _) = self else { return Err(0x0502) };
        printer.print(job).map(|printout| (printout.bytes, printout.fault.map(|fault| fault as u16)))
    }

    /// Drops the running order and what has been received of a telegram.
    pub(crate) const ABORT: Input<'static> = Input::Order(Order::Abort);
}

/// The configuration of the ASCII machine: what the parameters of `docs/cp341.md` mean to it.
fn ascii_config(p: &AsciiOf341, parameters: &Parameters, late: Span) -> ascii::Config {
    let zvz = u64::from(p.zvz_ms) * MS;
    let criterion = match p.end {
        EndOf341::Silence => ascii::Criterion::Silence,
        EndOf341::Length(length) => ascii::Criterion::Length(length.into()),
        EndOf341::Characters { characters, count, sending } => ascii::Criterion::Characters {
            end: ascii::Flags::new(characters, count),
            sending: match sending {
                SendingOf341::Through => ascii::Sending::Through,
                SendingOf341::Whole => ascii::Sending::Whole,
                SendingOf341::Appended => ascii::Sending::Appended,
            },
        },
    };
    ascii::Config {
        criterion,
        flow: parameters.line.flow,
        // Where ZVZ only supervises a telegram, characters that the line hands over late did not come late.
        zvz: if criterion == ascii::Criterion::Silence { zvz } else { zvz + late },
        pause: if p.send_pause { zvz } else { Span::ZERO },
        flow_wait: u64::from(p.flow_wait_ms) * MS,
        signals: p.signals.map(|(rts_off_ms, output_wait_ms)| signals::Times {
            rts_off: u64::from(rts_off_ms) * MS,
            output_wait: u64::from(output_wait_ms) * MS,
        }),
        ..ascii::Config::unset(parameters.line_settings().char_time())
    }
}

fn s3964_config(p: &S3964Of341, char_time: Span) -> s3964::Config {
    s3964::Config {
        bcc: p.bcc,
        priority: priority(p.priority),
        zvz: u64::from(p.zvz_ms) * MS,
        qvz: u64::from(p.qvz_ms) * MS,
        connect_attempts: p.connect_attempts,
        block_attempts: p.block_attempts,
        ..s3964::Config::cp341(char_time)
    }
}
