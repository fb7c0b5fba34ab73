//! From the parameters to the protocol machine.

use ob1_params::{AsciiOf341, Cp341 as Parameters, EndOf341, Flow, Priority, Protocol341, S3964Of341, SendingOf341};
use ob1_protocols::modbus_master_32::{self, Driver};
use ob1_protocols::rk512::{self, Rk512};
use ob1_protocols::{Ascii, MS, Machine, Nanos, Order, S3964, Sink, ascii, machine, s3964, signals};

use super::loadable;
use super::send::JOB_MAX;

/// The protocol at work.
#[derive(Debug)]
pub(crate) enum Protocol {
    /// No valid parameters.
    None,
    Ascii(Box<Ascii<JOB_MAX>>),
    S3964(Box<S3964<JOB_MAX>>),
    Rk512(Box<Rk512<JOB_MAX>>),
    Loadable(Box<Driver>),
}

impl Protocol {
    /// `late`: how late the line may hand over characters.
    pub(crate) fn of(parameters: &Parameters, late: Nanos) -> Self {
        let char_time = parameters.line_settings().char_time_ns();
        let p = match &parameters.protocol {
            Protocol341::Ascii(p) => return Self::Ascii(Box::new(Ascii::new(ascii_config(p, parameters, late)))),
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
            Self::S3964(Box::new(S3964::new(line)))
        }
    }

    /// One step; with no machine nothing happens.
    pub(crate) fn step<O: Sink + rk512::Owner + modbus_master_32::Owner>(
        &mut self,
        now: Nanos,
        input: machine::Input<'_>,
        out: &mut O,
    ) -> Option<Nanos> {
        match self {
            Self::None => None,
            Self::Ascii(machine) => machine.step(now, input, out),
            Self::S3964(machine) => machine.step(now, input, out),
            // Its orders come the other way.
            Self::Rk512(machine) => machine.step(now, rk512::Input::of_line(input)?, out),
            Self::Loadable(driver) => driver.step(now, loadable::of_line(input)?, out),
        }
    }

    /// Whether an order is running.
    pub(crate) fn busy(&self) -> bool {
        match self {
            Self::None => false,
            Self::Ascii(machine) => machine.busy(),
            Self::S3964(machine) => machine.busy(),
            Self::Rk512(machine) => machine.busy(),
            Self::Loadable(driver) => driver.busy(),
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
        matches!(self, Self::Ascii(_) | Self::S3964(_))
    }

    /// Whether RTS and DTR are the protocol's: flow control, automatic use.
    pub(crate) fn driven(&self) -> (bool, bool) {
        match self {
            Self::Ascii(machine) => {
                let automatic = machine.config().signals.is_some();
                (automatic || machine.config().flow == ascii::Flow::Hardware, automatic)
            }
            Self::Loadable(driver) => (driver.uses_signals(), driver.uses_signals()),
            _ => (false, false),
        }
    }

    /// Whether the partner acknowledges telegrams. Where nobody does, a job on a line that is known to be gone must not
    /// count as done because its last bit has "left".
    pub(crate) const fn is_acknowledged(&self) -> bool {
        !matches!(self, Self::Ascii(_))
    }

    /// Drops everything.
    pub(crate) const ABORT: machine::Input<'static> = machine::Input::Order(Order::Abort);
}

/// [reference 6]
fn ascii_config(p: &AsciiOf341, parameters: &Parameters, late: Nanos) -> ascii::Config {
    let zvz = Nanos::from(p.zvz_ms) * MS;
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
        flow: match parameters.line.flow {
            Flow::None => ascii::Flow::None,
            Flow::Hardware => ascii::Flow::Hardware,
            Flow::XonXoff => ascii::Flow::XonXoff,
        },
        // Where ZVZ only watches over a telegram, characters that the line hands over late are none that came late.
        zvz: if criterion == ascii::Criterion::Silence { zvz } else { zvz + late },
        pause: if p.send_pause { zvz } else { 0 },
        flow_wait: Nanos::from(p.flow_wait_ms) * MS,
        signals: p.signals.map(|(rts_off_ms, output_wait_ms)| signals::Times {
            rts_off: Nanos::from(rts_off_ms) * MS,
            output_wait: Nanos::from(output_wait_ms) * MS,
        }),
        ..ascii::Config::cp240(parameters.line_settings().char_time_ns())
    }
}

fn s3964_config(p: &S3964Of341, char_time: Nanos) -> s3964::Config {
    s3964::Config {
        priority: match p.priority {
            Priority::Low => s3964::Priority::Low,
            Priority::High => s3964::Priority::High,
        },
        zvz: Nanos::from(p.zvz_ms) * MS,
        qvz: Nanos::from(p.qvz_ms) * MS,
        connect_attempts: p.connect_attempts,
        block_attempts: p.block_attempts,
        ..s3964::Config::cp341(p.bcc, char_time)
    }
}
