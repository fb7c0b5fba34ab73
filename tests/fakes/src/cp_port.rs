//! Where a CP puts its results: everything is recorded, and what [`CpPort`] promises is checked at each call, whatever
//! CP stands on it.

use std::collections::BTreeMap;

use ob1_firmware::cp341::{Channel, ChannelBlock};
use ob1_firmware::{Counter, CpEvent, CpPort, Instant, Leds, LineSettings, Troubles, Wire};

/// The line of a CP that nobody listens to.
#[derive(Debug, Default)]
pub struct Loose {
    /// The characters sent.
    pub tx: Vec<u8>,
    /// The levels of the CP's modem lines; `None`: it has set none.
    pub rts: Option<bool>,
    /// As `rts`.
    pub dtr: Option<bool>,
}

impl Wire for Loose {
    fn transmit(&mut self, bytes: &[u8]) {
        self.tx.extend_from_slice(bytes);
    }

    fn rts(&mut self, on: bool) {
        self.rts = Some(on);
    }

    fn dtr(&mut self, on: bool) {
        self.dtr = Some(on);
    }
}

impl Plug for Loose {}

/// A line that takes on what the CP is set to.
pub trait Plug: Wire {
    /// The CP has new settings.
    fn settings(&mut self, settings: &LineSettings) {
        let _ = settings;
    }
}

/// Everything a CP has put out.
pub struct CpLog<W = Loose> {
    /// Its line.
    pub wire: W,
    /// Its input registers; empty before it has published any.
    pub inputs: Vec<u8>,
    /// The first two words of every block of input registers: RX and TX echo of a CP 240.
    pub shown: Vec<(u16, u16)>,
    /// Each of its settings.
    pub settings: Vec<LineSettings>,
    /// Its LEDs.
    pub leds: Leds,
    /// Its counters.
    pub counters: BTreeMap<Counter, u64>,
    /// Its events as `Debug` writes them.
    pub events: Vec<String>,
    /// The telegrams it has received.
    pub received: Vec<Vec<u8>>,
    /// The entries of its diagnostic buffer.
    pub entries: Vec<u16>,
    /// Diagnostic data, each time they have changed.
    pub records: Vec<Vec<u8>>,
    /// Diagnostic interrupts: whether the error comes, and the data.
    pub interrupts: Vec<(bool, Vec<u8>)>,
    /// What troubles it.
    pub troubles: Troubles,
    /// The blocks that the channels of a CP 341 show (`docs/cp341-channels.md`): send, receive.
    pub channels: [Option<ChannelBlock>; 2],
}

impl Default for CpLog {
    fn default() -> Self {
        Self::at(Loose::default())
    }
}

impl<W> CpLog<W> {
    /// The log of a CP at this line.
    pub fn at(wire: W) -> Self {
        Self {
            wire,
            inputs: Vec::new(),
            shown: Vec::new(),
            settings: Vec::new(),
            leds: Leds::default(),
            counters: BTreeMap::new(),
            events: Vec::new(),
            received: Vec::new(),
            entries: Vec::new(),
            records: Vec::new(),
            interrupts: Vec::new(),
            troubles: Troubles::default(),
            channels: [None; 2],
        }
    }

    /// A counter.
    pub fn counter(&self, counter: Counter) -> u64 {
        self.counters.get(&counter).copied().unwrap_or(0)
    }

    /// The block of a channel; zeros before the CP has shown one.
    pub fn channel_block(&self, channel: Channel) -> ChannelBlock {
        self.channels[usize::from(channel == Channel::Receive)].unwrap_or([0; 64])
    }
}

impl<W: Wire> Wire for CpLog<W> {
    fn transmit(&mut self, bytes: &[u8]) {
        assert!(!bytes.is_empty(), "nothing to send");
        self.wire.transmit(bytes);
    }

    fn take_back(&mut self) -> usize {
        self.wire.take_back()
    }

    fn rts(&mut self, on: bool) {
        self.wire.rts(on);
    }

    fn dtr(&mut self, on: bool) {
        self.wire.dtr(on);
    }
}

impl<W: Plug> CpPort for CpLog<W> {
    fn inputs(&mut self, registers: &[u8]) {
        assert_ne!(self.inputs, registers, "input registers that have not changed");
        self.inputs = registers.to_vec();
        if let [a, b, c, d, ..] = registers {
            self.shown.push((u16::from_be_bytes([*a, *b]), u16::from_be_bytes([*c, *d])));
        }
    }

    fn channel(&mut self, channel: Channel, block: &ChannelBlock) {
        let before = self.channels[usize::from(channel == Channel::Receive)].replace(*block);
        assert_ne!(before.as_ref(), Some(block), "a channel that has not changed");
    }

    fn line_settings(&mut self, settings: &LineSettings) {
        self.settings.push(*settings);
        self.wire.settings(settings);
    }

    fn record(&mut self, record: &[u8]) {
        self.records.push(record.to_vec());
    }

    fn leds(&mut self, leds: Leds) {
        assert_ne!(self.leds, leds, "LEDs that have not changed");
        self.leds = leds;
    }

    fn count(&mut self, counter: Counter, n: u64) {
        *self.counters.entry(counter).or_default() += n;
    }

    fn event(&mut self, now: Instant, event: CpEvent<'_>) {
        self.troubles.event(now, &event);
        match event {
            CpEvent::Received(telegram) => self.received.push(telegram.to_vec()),
            CpEvent::Entry(number) => self.entries.push(number),
            CpEvent::Diagnosis { incoming, data } => self.interrupts.push((incoming, data.to_vec())),
            CpEvent::Record { incoming, record } => self.interrupts.push((incoming, record.to_vec())),
            _ => {}
        }
        self.events.push(format!("{event:?}"));
    }
}
