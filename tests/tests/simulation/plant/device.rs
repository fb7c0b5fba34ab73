//! The devices in the field: slaves on PROFIBUS, couplers on two wires or on a connection. Their inputs change with
//! each read; all have a watchdog.

use ob1_coupler::{Input, LineInput, MasterInput};
use ob1_fakes::dp_slave::{Slave, SlaveConfig};
use ob1_tests::coupler::{Coupler, crc};
use ob1_time::{Instant, Span};

/// Bytes of a device in each direction.
pub(crate) const BYTES: usize = 4;

/// The inputs of device `n` after this number of reads.
pub(crate) fn sensed(n: usize, reads: u64) -> [u8; BYTES] {
    let k = reads as u8;
    [k, n as u8, k ^ 0xA5, !k]
}

enum Kind {
    Slave(Box<Slave>, SlaveConfig),
    /// With the received part of a telegram, and whether it is corrupted.
    Coupler(Box<Coupler>, Vec<u8>, bool),
}

pub(crate) struct Device {
    n: usize,
    kind: Kind,
    /// Time of its next call.
    pub(crate) deadline: Instant,
    /// End of a power failure.
    off_until: Instant,
    /// End of an interruption of its cable.
    cut_until: Instant,
    reads: u64,
    /// Time of the last exchange.
    pub(crate) heard: Instant,
    /// Values written since the last check.
    written: Vec<Vec<u8>>,
    /// Restarted since the last check.
    restarted: bool,
    /// Number of times its watchdog has expired.
    pub(crate) expired: u32,
}

impl Device {
    fn new(n: usize, kind: Kind) -> Self {
        let mut device = Self {
            n,
            kind,
            deadline: Instant::NEVER,
            off_until: Instant::START,
            cut_until: Instant::START,
            reads: 0,
            heard: Instant::START,
            written: Vec::new(),
            restarted: false,
            expired: 0,
        };
        device.sense();
        device
    }

    pub(crate) fn slave(n: usize, config: SlaveConfig) -> Self {
        Self::new(n, Kind::Slave(Box::new(Slave::new(config.clone())), config))
    }

    pub(crate) fn coupler(n: usize, unit: u8) -> Self {
        Self::new(n, Kind::Coupler(Box::new(Coupler::new(unit, BYTES / 2)), Vec::new(), false))
    }

    /// Restarts it like after power on; without power until `off_until`.
    pub(crate) fn restart(&mut self, off_until: Instant) {
        match &mut self.kind {
            Kind::Slave(slave, config) => **slave = Slave::new(config.clone()),
            Kind::Coupler(coupler, heard, _) => {
                **coupler = Coupler::new(coupler.unit, BYTES / 2);
                heard.clear();
            }
        }
        (self.reads, self.off_until, self.deadline, self.restarted) = (0, off_until, Instant::NEVER, true);
        self.sense();
    }

    /// Interrupts its cable until `until`.
    pub(crate) fn cut(&mut self, until: Instant) {
        self.cut_until = until;
    }

    /// Reports a fault, or no fault. Only for a slave.
    pub(crate) fn report(&mut self, blocks: &[u8]) {
        if let Kind::Slave(slave, _) = &mut self.kind {
            slave.report(blocks);
        }
    }

    pub(crate) fn is_reached(&self, now: Instant) -> bool {
        now >= self.off_until && now >= self.cut_until
    }

    pub(crate) fn has_power(&self, now: Instant) -> bool {
        now >= self.off_until
    }

    pub(crate) fn outputs(&self) -> Vec<u8> {
        match &self.kind {
            Kind::Slave(slave, _) => slave.outputs.clone(),
            Kind::Coupler(coupler, ..) => bytes(&coupler.driven),
        }
    }

    /// Number of reads.
    pub(crate) fn reads(&self) -> u64 {
        self.reads
    }

    pub(crate) fn take_written(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.written)
    }

    pub(crate) fn take_restarted(&mut self) -> bool {
        std::mem::take(&mut self.restarted)
    }

    fn sense(&mut self) {
        let [a, b, c, d] = sensed(self.n, self.reads);
        match &mut self.kind {
            Kind::Slave(slave, _) => slave.inputs = vec![a, b, c, d],
            Kind::Coupler(coupler, ..) => {
                coupler.sensed = vec![u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])];
            }
        }
    }

    /// Handles an input from the wires; returns its answer. `quiet`: a pause that ends a telegram.
    pub(crate) fn on_wires(&mut self, now: Instant, input: MasterInput<'_>, quiet: Span) -> Vec<u8> {
        let silent = !self.is_reached(now);
        let mut out = Vec::new();
        match &mut self.kind {
            Kind::Slave(slave, _) => {
                // Its cable is interrupted: it receives nothing. A telegram being sent is completed.
                let deaf = now < self.cut_until && matches!(input, Input::Line(LineInput::Rx(_) | LineInput::Fault(_)));
                let input = if deaf { Input::Tick } else { input };
                if now < self.off_until {
                    self.deadline = Instant::NEVER;
                    return out;
                }
                self.deadline = slave.step(now, input, &mut out);
                if slave.exchanges() != self.reads {
                    (self.reads, self.heard) = (slave.exchanges(), now);
                    self.written.push(slave.outputs.clone());
                    self.sense();
                }
            }
            Kind::Coupler(coupler, heard, spoiled) => match input {
                Input::Line(LineInput::Rx(bytes)) if !silent => {
                    heard.extend_from_slice(bytes);
                    self.deadline = now + quiet;
                }
                Input::Line(LineInput::Fault(_)) if !silent => {
                    *spoiled = true;
                    self.deadline = now + quiet;
                }
                Input::Tick if now >= self.deadline => {
                    self.deadline = Instant::NEVER;
                    let (telegram, whole) = (std::mem::take(heard), !std::mem::take(spoiled));
                    if let Some((telegram, check)) = telegram.split_last_chunk::<2>().map(|(t, c)| (t.to_vec(), *c))
                        && whole
                        && check == crc(&telegram)
                        && coupler.unit == telegram[0]
                    {
                        out = self.asked(now, &telegram);
                        out.extend(if out.is_empty() { Vec::new() } else { crc(&out).to_vec() });
                    }
                    if silent {
                        out.clear();
                    }
                }
                _ => {}
            },
        }
        out
    }

    /// Handles a request to a coupler; returns its answer.
    pub(crate) fn asked(&mut self, now: Instant, telegram: &[u8]) -> Vec<u8> {
        self.look(now);
        let Kind::Coupler(coupler, ..) = &mut self.kind else { return Vec::new() };
        let Some(answer) = coupler.hear(now, telegram) else { return Vec::new() };
        self.heard = now;
        self.written.extend(coupler.writes.drain(..).map(|words| bytes(&words)));
        let reads = coupler.reads;
        if reads != self.reads {
            self.reads = reads;
            self.sense();
        }
        answer
    }

    /// Checks the watchdog of a coupler.
    pub(crate) fn look(&mut self, now: Instant) {
        if let Kind::Coupler(coupler, ..) = &mut self.kind {
            let was = coupler.deadline();
            coupler.look(now);
            self.expired += u32::from(coupler.deadline() != was);
        }
    }
}

fn bytes(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_be_bytes()).collect()
}
