//! From the parameters to the protocol machine.

use ob1_params::{Cp341 as Parameters, Priority, Protocol341, S3964Of341};
use ob1_protocols::modbus_master_32::{self, Driver};
use ob1_protocols::rk512::{self, Rk512};
use ob1_protocols::{MS, Machine, Nanos, Order, S3964, Sink, machine, s3964};

use super::loadable;
use super::send::JOB_MAX;

/// The protocol at work.
#[derive(Debug)]
pub(crate) enum Protocol {
    /// No valid parameters.
    None,
    S3964(Box<S3964<JOB_MAX>>),
    Rk512(Box<Rk512<JOB_MAX>>),
    Loadable(Box<Driver>),
}

impl Protocol {
    /// `late`: how late the line may hand over characters.
    pub(crate) fn of(parameters: &Parameters, late: Nanos) -> Self {
        let p = match &parameters.protocol {
            Protocol341::S3964(p) => p,
            Protocol341::ModbusMaster32(p) => {
                return Self::Loadable(Box::new(loadable::of(p, &parameters.line_settings(), late)));
            }
        };
        let line = s3964_config(p, parameters.line_settings().char_time_ns());
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

    /// Drops everything.
    pub(crate) const ABORT: machine::Input<'static> = machine::Input::Order(Order::Abort);
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
