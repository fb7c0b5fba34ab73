//! From the parameters to the protocol machine.

use ob1_params::{
    Ascii as AsciiParams, Cp040, Cp240 as Parameters, Priority, Protocol as Chosen, S3964 as S3964Params,
    StxEtx as StxEtxParams,
};
use ob1_protocols::modbus::{Master, Slave};
use ob1_protocols::rk512::{self, Rk512};
use ob1_protocols::{
    Ascii, Esp2, Input, Instant, MBus, MS, Machine, ModemLines, Order, S3964, Sink, Span, StxEtx, ascii, esp2, mbus,
    s3964, stx_etx,
};

use crate::modbus;
use crate::reason::{Reason, Why};
use ob1_words::cp240::Registers;

/// How to build the machine of a parameter record.
#[derive(Debug, Clone)]
pub(crate) enum Setup {
    Ascii(ascii::Config),
    S3964(s3964::Config),
    StxEtx(stx_etx::Config),
    Modbus(modbus::Setup),
    Rk512(rk512::Config),
    MBus(mbus::Config),
    EnOcean(esp2::Config),
}

impl Setup {
    /// `late`: how late the line may hand characters over.
    pub(crate) fn of(parameters: &Parameters, late: Span) -> Self {
        let char_time = parameters.char_time();
        match &parameters.protocol {
            Chosen::Ascii(p) => Self::Ascii(ascii_config(p, char_time)),
            Chosen::S3964(p) if p.rk512 => Self::Rk512(rk512::Config::cp240(s3964_config(p, char_time))),
            Chosen::S3964(p) => Self::S3964(s3964_config(p, char_time)),
            Chosen::StxEtx(p) => Self::StxEtx(stx_etx_config(p, char_time)),
            Chosen::Modbus(p) => Self::Modbus(modbus::Setup::of(p, parameters.baud, char_time, late)),
            Chosen::MBus => Self::MBus(mbus::Config::cp240().with_bursts(late)),
            Chosen::EnOcean => Self::EnOcean(esp2::Config::cp240()),
        }
    }

    /// The same for a CP 040 that occupies `io_bytes` each way: where 0 means double the character time for the CP 240,
    /// it means "triple character time" [S3 L303], for QVZ too [S3 L305], and the areas of its slave "short" are as
    /// long as its process image [S3 L385].
    pub(crate) fn of_040(parameters: &Cp040, io_bytes: usize, late: Span) -> Self {
        let mut setup = Self::of(&parameters.common, late);
        let triple = 3 * parameters.common.char_time();
        match &mut setup {
            Self::Ascii(config) if config.zvz == Span::ZERO => config.zvz = triple,
            Self::S3964(config) => {
                for time in [&mut config.zvz, &mut config.qvz] {
                    if *time == Span::ZERO {
                        *time = triple;
                    }
                }
            }
            Self::Modbus(modbus::Setup::Slave(config)) if !config.confirmed => config.area_bytes = io_bytes,
            _ => {}
        }
        setup
    }

    /// ASCII-fragmented: telegrams come in parts.
    pub(crate) fn is_fragmented(&self) -> bool {
        matches!(self, Self::Ascii(config) if config.criterion == ascii::Criterion::Fragments)
    }

    /// One of the Modbus modes.
    pub(crate) const fn is_modbus(&self) -> bool {
        matches!(self, Self::Modbus(_))
    }

    /// The machine, ready for its first step. That of RK 512 stands beside it: [`Setup::rk512`].
    pub(crate) fn build(&self) -> Protocol {
        match self {
            Self::Ascii(config) => Protocol::Ascii(Ascii::new(config.clone())),
            Self::S3964(config) => Protocol::S3964(S3964::new(config.clone())),
            Self::StxEtx(config) => Protocol::StxEtx(StxEtx::new(config.clone())),
            Self::Modbus(modbus::Setup::Master(config)) => Protocol::ModbusMaster(Master::new(config.clone())),
            Self::Modbus(modbus::Setup::Slave(config)) => Protocol::ModbusSlave(Box::new(Slave::new(config.clone()))),
            Self::Rk512(_) => Protocol::None,
            Self::MBus(config) => Protocol::MBus(MBus::new(config.clone())),
            Self::EnOcean(config) => Protocol::EnOcean(Box::new(Esp2::new(config.clone()))),
        }
    }

    /// The RK 512 machine, if that is the protocol: its orders and results are not those of the others.
    pub(crate) fn rk512(&self) -> Option<Box<Rk512>> {
        match self {
            Self::Rk512(config) => Some(Box::new(Rk512::new(config.clone()))),
            _ => None,
        }
    }

    /// Whether the CP shows a start-up identifier and waits for FC 9. In the Modbus modes the manual does not call FC
    /// 9.
    pub(crate) const fn has_identifier(&self) -> bool {
        !matches!(self, Self::Modbus(_))
    }

    /// EnOcean: ER "signalizes an error by buffer overflow" and nothing of the line, and there is no diagnostic
    /// interrupt. [S1 "LEDs"], [S1 "Technische Daten"]
    pub(crate) const fn is_enocean(&self) -> bool {
        matches!(self, Self::EnOcean(_))
    }
}

fn ascii_config(p: &AsciiParams, char_time: Span) -> ascii::Config {
    ascii::Config {
        criterion: if p.fragmented { ascii::Criterion::Fragments } else { ascii::Criterion::Silence },
        flow: p.flow,
        zna: u64::from(p.zna_ms) * MS,
        zvz: u64::from(p.zvz_ms) * MS,
        ..ascii::Config::unset(char_time)
    }
}

fn stx_etx_config(p: &StxEtxParams, char_time: Span) -> stx_etx::Config {
    stx_etx::Config {
        start: stx_etx::Flags::new(p.start, p.start_flags),
        end: stx_etx::Flags::new(p.end, p.end_flags),
        flow: p.flow,
        zna: u64::from(p.zna_ms) * MS,
        tmo: u64::from(p.tmo_ms) * MS,
        ..stx_etx::Config::unset(char_time)
    }
}

fn s3964_config(p: &S3964Params, char_time: Span) -> s3964::Config {
    s3964::Config {
        bcc: p.bcc,
        priority: priority(p.priority),
        zvz: u64::from(p.zvz_ms) * MS,
        qvz: u64::from(p.qvz_ms) * MS,
        zna: u64::from(p.zna_ms) * MS,
        bwz: u64::from(p.bwz_ms) * MS,
        // [S0 "STX repetitions"] counts the repetitions, [S0 "DBL"] the attempts.
        connect_attempts: u16::from(p.stx_repetitions) + 1,
        block_attempts: u16::from(p.dbl).max(1),
        ..s3964::Config::cp240(char_time)
    }
}

/// Why an order waits that flow control has stopped.
pub(crate) fn stopped_by(flow: ascii::Flow, lines: ModemLines) -> Reason {
    match flow {
        ascii::Flow::Hardware => signals_off(lines),
        ascii::Flow::XonXoff | ascii::Flow::None => Reason::state(Why::Stopped, 0),
    }
}

/// CTS or DSR is OFF.
pub(crate) fn signals_off(lines: ModemLines) -> Reason {
    Reason::state(Why::Signals, u16::from(lines.cts) | u16::from(lines.dsr) << 1)
}

/// The priority of the parameters, for the machine.
pub(crate) const fn priority(priority: Priority) -> s3964::Priority {
    match priority {
        Priority::Low => s3964::Priority::Low,
        Priority::High => s3964::Priority::High,
    }
}

/// The running protocol, of those that give their telegrams to a [`Sink`]. There is only one, and the variants differ
/// little in size, so only those with areas or a send buffer are boxed.
#[derive(Debug)]
pub(crate) enum Protocol {
    /// The CP does not work, or its protocol is RK 512.
    None,
    Ascii(Ascii),
    S3964(S3964),
    StxEtx(StxEtx),
    ModbusMaster(Master),
    ModbusSlave(Box<Slave>),
    MBus(MBus),
    EnOcean(Box<Esp2>),
}

impl Protocol {
    /// One step; without a machine nothing happens.
    pub(crate) fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant> {
        match self {
            Self::None => None,
            Self::Ascii(machine) => machine.step(now, input, out),
            Self::S3964(machine) => machine.step(now, input, out),
            Self::StxEtx(machine) => machine.step(now, input, out),
            Self::ModbusMaster(machine) => machine.step(now, input, out),
            Self::ModbusSlave(machine) => machine.step(now, input, out),
            Self::MBus(machine) => machine.step(now, input, out),
            Self::EnOcean(machine) => machine.step(now, input, out),
        }
    }

    /// What the running order waits for because the partner has stopped it; `lines`: the modem lines.
    pub(crate) fn stopped(&self, lines: ModemLines) -> Option<Reason> {
        let (is_stopped, flow) = match self {
            Self::Ascii(machine) => (machine.is_stopped(), machine.config().flow),
            Self::StxEtx(machine) => (machine.is_stopped(), machine.config().flow),
            _ => return None,
        };
        is_stopped.then(|| stopped_by(flow, lines))
    }

    /// Whether the partner acknowledges telegrams. If not, an order on a lost line must not count as done because its
    /// last bit has "left".
    pub(crate) const fn is_acknowledged(&self) -> bool {
        matches!(self, Self::S3964(_) | Self::ModbusMaster(_) | Self::MBus(_))
    }

    /// Whether what could not be received is lost: the partner does not repeat it, and no program asks for it again.
    pub(crate) const fn is_heard_once(&self) -> bool {
        matches!(self, Self::Ascii(_) | Self::StxEtx(_))
    }

    /// The Modbus slave, if it is one.
    pub(crate) const fn slave(&mut self) -> Option<&mut Slave> {
        match self {
            Self::ModbusSlave(slave) => Some(slave),
            _ => None,
        }
    }

    /// The registers, where they are not a handshake: the data of the Modbus slave "short".
    pub(crate) fn image(&self) -> Option<Registers> {
        match self {
            Self::ModbusSlave(slave) => modbus::image(slave),
            _ => None,
        }
    }

    /// Whether the protocol drives RTS: hardware flow control.
    pub(crate) fn drives_rts(&self) -> bool {
        match self {
            Self::Ascii(machine) => machine.config().flow == ascii::Flow::Hardware,
            Self::StxEtx(machine) => machine.config().flow == ascii::Flow::Hardware,
            _ => false,
        }
    }

    /// Drops the running order.
    pub(crate) const ABORT: Input<'static> = Input::Order(Order::Abort);
}
