//! From the parameters to the protocol machine.

use ob1_params::{
    Ascii as AsciiParams, Cp040, Cp240 as Parameters, CpKind, Priority, Protocol as Chosen, S3964 as S3964Params,
    StxEtx as StxEtxParams, zero,
};
use ob1_protocols::modbus::{Master, Slave};
use ob1_protocols::rk512::{self, Rk512};
use ob1_protocols::{
    Ascii, Esp2, Input, Instant, MBus, MS, Machine, ModemLines, Order, S3964, Sink, Span, StxEtx, ascii, esp2, mbus,
    s3964, stx_etx,
};

use crate::choose_reason::{Reason, Why};
use crate::modbus;
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
        Self::of_kind(CpKind::Cp240, parameters, late)
    }

    fn of_kind(kind: CpKind, parameters: &Parameters, late: Span) -> Self {
        let char_time = parameters.char_time();
        let times = Times { kind, char_time };
        match &parameters.protocol {
            Chosen::Ascii(p) => Self::Ascii(ascii_config(p, times)),
            Chosen::S3964(p) if p.rk512 => Self::Rk512(rk512::Config::cp240(s3964_config(p, times))),
            Chosen::S3964(p) => Self::S3964(s3964_config(p, times)),
            Chosen::StxEtx(p) => Self::StxEtx(stx_etx_config(p, times)),
            Chosen::Modbus(p) => Self::Modbus(modbus::Setup::of(p, parameters.baud, char_time, late)),
            Chosen::MBus => Self::MBus(mbus::Config::cp240().with_bursts(late)),
            Chosen::EnOcean => Self::EnOcean(esp2::Config::cp240()),
        }
    }

    /// The same for a CP 040 that occupies `io_bytes` each way: the areas of its slave "short" are as long as its
    /// process image [S3 L385].
    pub(crate) fn of_040(parameters: &Cp040, io_bytes: usize, late: Span) -> Self {
        let mut setup = Self::of_kind(CpKind::Cp040, &parameters.common, late);
        if let Self::Modbus(modbus::Setup::Slave(config)) = &mut setup
            && !config.confirmed
        {
            config.area_bytes = io_bytes;
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
            Self::Ascii(config) => Protocol::Ascii(Ascii::new(config)),
            Self::S3964(config) => Protocol::S3964(S3964::new(config.clone())),
            Self::StxEtx(config) => Protocol::StxEtx(StxEtx::new(config)),
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

    /// EnOcean: ER "signalizes an error by buffer overflow" and nothing of the line. [S1 "LEDs"]
    pub(crate) const fn is_enocean(&self) -> bool {
        matches!(self, Self::EnOcean(_))
    }
}

/// The times of the parameters of a CP, for its machine.
#[derive(Clone, Copy)]
struct Times {
    kind: CpKind,
    char_time: Span,
}

impl Times {
    /// The time of a key, or what its 0 stands for.
    fn of(self, key: &str, ms: u16) -> Span {
        if ms == 0 { zero::characters(self.kind, key) * self.char_time } else { u64::from(ms) * MS }
    }
}

fn ascii_config(p: &AsciiParams, times: Times) -> ascii::Config {
    ascii::Config {
        criterion: if p.fragmented { ascii::Criterion::Fragments } else { ascii::Criterion::Silence },
        flow: p.flow,
        zna: times.of("zna_ms", p.zna_ms),
        zvz: times.of("zvz_ms", p.zvz_ms),
        ..ascii::Config::unset(times.char_time)
    }
}

fn stx_etx_config(p: &StxEtxParams, times: Times) -> stx_etx::Config {
    stx_etx::Config {
        start: stx_etx::Flags::new(p.start, p.start_flags),
        end: stx_etx::Flags::new(p.end, p.end_flags),
        flow: p.flow,
        zna: times.of("zna_ms", p.zna_ms),
        tmo: times.of("tmo_ms", p.tmo_ms),
        ..stx_etx::Config::unset(times.char_time)
    }
}

fn s3964_config(p: &S3964Params, times: Times) -> s3964::Config {
    s3964::Config {
        bcc: p.bcc,
        priority: priority(p.priority),
        zvz: times.of("zvz_ms", p.zvz_ms),
        qvz: times.of("qvz_ms", p.qvz_ms),
        zna: times.of("zna_ms", p.zna_ms),
        bwz: times.of("bwz_ms", p.bwz_ms),
        // [S0 "STX repetitions"] counts the repetitions, [S0 "DBL"] the attempts.
        connect_attempts: u16::from(p.stx_repetitions) + 1,
        block_attempts: u16::from(p.dbl).max(1),
        ..s3964::Config::cp240(times.char_time)
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
            Self::Ascii(machine) => (machine.is_stopped(), machine.flow()),
            Self::StxEtx(machine) => (machine.is_stopped(), machine.flow()),
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
            Self::Ascii(machine) => machine.flow() == ascii::Flow::Hardware,
            Self::StxEtx(machine) => machine.flow() == ascii::Flow::Hardware,
            _ => false,
        }
    }

    /// Drops the running order.
    pub(crate) const ABORT: Input<'static> = Input::Order(Order::Abort);
}
