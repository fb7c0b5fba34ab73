//! The partner of a CP 240, by protocol.

use ob1_time::{Instant, Span};

use crate::compare::random::Random;
use crate::programs::partner::procedure::Procedure;
use crate::programs::partner::rk512::Rk512;
use crate::programs::partner::stream::Stream;
use crate::programs::partner::{Manners, Pace, telegram};
use crate::programs::run::Partner;
use crate::sim::MS;
use crate::sim::device::Device;

use super::draw::Times;
use super::serve;

/// A partner.
#[derive(Debug)]
pub enum Partner240 {
    /// 3964, 3964R; the number of its next telegram.
    Procedure(Box<Procedure>, u32),
    /// RK 512
    Rk512(Box<Rk512>, u32),
    /// ASCII, STX/ETX
    Stream(Box<Stream>, u32),
}

/// Numbers of the partner's telegrams begin here, those of the station at 1.
const OWN: u32 = 0x4000;

impl Partner240 {
    /// A partner with 3964 or 3964R.
    #[must_use]
    pub fn procedure(checked: bool, high: bool, manners: Manners, pace: Pace, random: Random) -> Self {
        Self::Procedure(Box::new(Procedure::new(checked, high, manners, pace, random)), OWN)
    }

    /// A partner with RK 512; its line is good or bad, and so are its reactions.
    #[must_use]
    pub fn rk512(high: bool, manners: Manners, pace: Pace, bwz: Span, mut random: Random) -> Self {
        let good = random.once_in(2);
        let (line, own) = (Random::new(random.bits()), Random::new(random.bits()));
        let (below, above) = if good { (Manners::GOOD, manners) } else { (manners, Manners::GOOD) };
        let line = Procedure::new(true, high, below, pace, line);
        Self::Rk512(Box::new(Rk512::new(line, above, bwz, own)), OWN)
    }

    /// A partner without a procedure.
    #[must_use]
    pub fn stream(framed: bool, times: Times, stops: Option<(usize, Span)>, echo: bool) -> Self {
        let around = if framed { (vec![2], vec![3]) } else { (Vec::new(), Vec::new()) };
        let pause = times.zvz + 40 * MS;
        let mut stream = Stream::default();
        (stream.echo, stream.around, stream.pause, stream.char, stream.stops) =
            (echo, around, pause, times.char, stops);
        Self::Stream(Box::new(stream), OWN)
    }

    /// It has the high priority.
    #[must_use]
    pub fn is_high(&self) -> bool {
        match self {
            Self::Procedure(line, _) => line.high,
            Self::Rk512(rk, _) => rk.line.high,
            Self::Stream(..) => false,
        }
    }

    /// It is an echo.
    #[must_use]
    pub fn is_echo(&self) -> bool {
        matches!(self, Self::Stream(stream, _) if stream.echo)
    }
}

impl Device for Partner240 {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        match self {
            Self::Procedure(line, _) => line.hear(now, bytes, out),
            Self::Rk512(rk, _) => rk.hear(now, bytes, out),
            Self::Stream(stream, _) => stream.hear(now, bytes, out),
        }
    }
}

impl Partner for Partner240 {
    /// It sends a telegram; the number gives its length.
    fn told(&mut self, now: Instant, what: u32, out: &mut Vec<u8>) -> Option<Instant> {
        let len = match what % 8 {
            0 => 4 + what as usize / 8 % 200,
            _ => 4 + what as usize / 8 % 40,
        };
        match self {
            Self::Procedure(line, next) => {
                line.send(telegram(*next, len, false));
                *next += 1;
            }
            Self::Stream(stream, next) => {
                stream.send(telegram(*next, len, true));
                *next += 1;
            }
            Self::Rk512(rk, next) => {
                rk.request(serve::request(*next, what));
                *next += 1;
            }
        }
        self.hear(now, &[], out)
    }
}
