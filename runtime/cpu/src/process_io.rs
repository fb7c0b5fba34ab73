//! Process inputs and outputs: the modules `di do ai ao`, over bytes that someone else holds, or over a timed stimulus.
//!
//! The CPU knows no operating system, so the shared-memory image that other programs read and write is an [`IoBacking`]
//! implemented elsewhere.

use crate::{Module, ModuleError, ModuleEvent, ModuleStatus, Nanos};

/// What lies behind a module of process inputs or outputs. Offsets count from the module's first byte.
pub trait IoBacking: Send {
    /// Time has come to `now`: once a scan, before the inputs are read.
    fn advance(&mut self, _now: Nanos) {}
    /// Reads input bytes; `false` when what lies behind is gone.
    fn read(&mut self, at: u16, into: &mut [u8]) -> bool;
    /// Writes output bytes; `false` when what lies behind is gone.
    fn write(&mut self, at: u16, from: &[u8]) -> bool;
}

/// The four kinds of modules. Digital ones count bytes of eight channels, analogue ones words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IoKind {
    /// `di`: digital inputs.
    DigitalInput,
    /// `do`: digital outputs.
    DigitalOutput,
    /// `ai`: analogue inputs, one word a channel.
    AnalogInput,
    /// `ao`: analogue outputs, one word a channel.
    AnalogOutput,
}

impl IoKind {
    /// True for outputs.
    #[must_use]
    pub const fn is_output(self) -> bool {
        matches!(self, IoKind::DigitalOutput | IoKind::AnalogOutput)
    }

    /// The kind of a station file's word.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "di" => IoKind::DigitalInput,
            "do" => IoKind::DigitalOutput,
            "ai" => IoKind::AnalogInput,
            "ao" => IoKind::AnalogOutput,
            _ => return None,
        })
    }
}

/// A module of process inputs or outputs.
pub struct IoModule {
    kind: IoKind,
    bytes: u16,
    present: bool,
    backing: Box<dyn IoBacking>,
}

impl IoModule {
    /// A module of `bytes` bytes over `backing`.
    #[must_use]
    pub fn new(kind: IoKind, bytes: u16, backing: Box<dyn IoBacking>) -> Self {
        Self { kind, bytes, present: true, backing }
    }

    fn answer(&mut self, present: bool) -> Result<(), ModuleError> {
        self.present = present;
        if present { Ok(()) } else { Err(ModuleError::Absent) }
    }
}

impl std::fmt::Debug for IoModule {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("IoModule").field("kind", &self.kind).field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl Module for IoModule {
    fn input_bytes(&self) -> u16 {
        if self.kind.is_output() { 0 } else { self.bytes }
    }

    fn output_bytes(&self) -> u16 {
        if self.kind.is_output() { self.bytes } else { 0 }
    }

    fn begin_scan(&mut self, now: Nanos) {
        self.backing.advance(now);
    }

    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        if usize::from(at) + into.len() > usize::from(self.input_bytes()) {
            return Err(ModuleError::Outside);
        }
        let present = self.backing.read(at, into);
        self.answer(present)
    }

    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        if usize::from(at) + from.len() > usize::from(self.output_bytes()) {
            return Err(ModuleError::Outside);
        }
        let present = self.backing.write(at, from);
        self.answer(present)
    }

    fn end_scan(&mut self, _now: Nanos) {}

    fn cpu_state(&mut self, _run: bool) {}

    fn poll_event(&mut self) -> Option<ModuleEvent> {
        None
    }

    fn status(&self) -> ModuleStatus {
        ModuleStatus { present: self.present, generation: 1, leds: 0 }
    }

    fn record_read(&mut self, _record: u8, _into: &mut [u8]) -> Result<usize, ModuleError> {
        Err(ModuleError::NoRecord)
    }

    fn record_write(&mut self, _record: u8, _from: &[u8]) -> Result<(), ModuleError> {
        Err(ModuleError::NoRecord)
    }
}

/// What a stimulus sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StimulusValue {
    /// Bit 0 to 7 of the byte.
    Bit(u8, bool),
    /// The byte.
    Byte(u8),
    /// The word that begins at the byte, high byte first.
    Word(u16),
    /// The double word that begins at the byte.
    DWord(u32),
}

/// One line of a stimulus: at this time these bytes change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StimulusStep {
    /// Since the runtime started. Virtual in virtual time.
    pub at: Nanos,
    /// Byte of the module, from 0.
    pub byte: u16,
    /// What it becomes.
    pub value: StimulusValue,
}

/// Inputs as a function of time. Steps of the same time apply in the order given; what no step has touched is 0.
#[derive(Clone, Debug)]
pub struct Stimulus {
    steps: Box<[StimulusStep]>,
    next: usize,
    image: Box<[u8]>,
    /// The steps begin again after this time; 0: never.
    period: Nanos,
    round_start: Nanos,
}

/// A step that does not lie inside the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StimulusOutside {
    /// Index of the step in the list given.
    pub step: usize,
}

impl std::fmt::Display for StimulusOutside {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "stimulus step {} lies outside the module, or its bit is above 7, or its time is after the period",
            self.step + 1
        )
    }
}

impl std::error::Error for StimulusOutside {}

impl Stimulus {
    /// A stimulus for a module of `bytes` bytes; the steps need not be sorted. With a `period` above 0 the steps are
    /// repeated, and none may lie at or after it.
    ///
    /// # Errors
    /// A step outside the module.
    pub fn new(bytes: u16, mut steps: Vec<StimulusStep>, period: Nanos) -> Result<Self, StimulusOutside> {
        for (i, step) in steps.iter().enumerate() {
            let len = match step.value {
                StimulusValue::Bit(bit, _) if bit > 7 => return Err(StimulusOutside { step: i }),
                StimulusValue::Bit(..) | StimulusValue::Byte(_) => 1,
                StimulusValue::Word(_) => 2,
                StimulusValue::DWord(_) => 4,
            };
            if u32::from(step.byte) + len > u32::from(bytes) || period > 0 && step.at >= period {
                return Err(StimulusOutside { step: i });
            }
        }
        steps.sort_by_key(|step| step.at);
        let image = vec![0; usize::from(bytes)].into_boxed_slice();
        Ok(Self { steps: steps.into_boxed_slice(), next: 0, image, period, round_start: 0 })
    }

    fn apply(&mut self, step: StimulusStep) {
        let at = usize::from(step.byte);
        match step.value {
            StimulusValue::Bit(bit, value) => {
                self.image[at] = self.image[at] & !(1 << bit) | u8::from(value) << bit;
            }
            StimulusValue::Byte(value) => self.image[at] = value,
            StimulusValue::Word(value) => self.image[at..at + 2].copy_from_slice(&value.to_be_bytes()),
            StimulusValue::DWord(value) => self.image[at..at + 4].copy_from_slice(&value.to_be_bytes()),
        }
    }
}

impl IoBacking for Stimulus {
    fn advance(&mut self, now: Nanos) {
        if self.period > 0 && now >= self.round_start + self.period {
            // Whole rounds that passed between two scans leave no trace but their last state.
            while let Some(step) = self.steps.get(self.next).copied() {
                self.apply(step);
                self.next += 1;
            }
            self.round_start += (now - self.round_start) / self.period * self.period;
            self.next = 0;
        }
        while let Some(step) = self.steps.get(self.next).copied() {
            if self.round_start + step.at > now {
                break;
            }
            self.apply(step);
            self.next += 1;
        }
    }

    fn read(&mut self, at: u16, into: &mut [u8]) -> bool {
        let at = usize::from(at);
        match self.image.get(at..at + into.len()) {
            Some(bytes) => into.copy_from_slice(bytes),
            None => into.fill(0),
        }
        true
    }

    fn write(&mut self, _at: u16, _from: &[u8]) -> bool {
        // A stimulus drives inputs only.
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(at: Nanos, byte: u16, value: StimulusValue) -> StimulusStep {
        StimulusStep { at, byte, value }
    }

    #[test]
    fn a_stimulus_is_a_function_of_time() {
        let steps = vec![
            step(200, 1, StimulusValue::Word(0x1234)),
            step(100, 0, StimulusValue::Bit(3, true)),
            step(300, 0, StimulusValue::Bit(3, false)),
        ];
        let stimulus = Stimulus::new(3, steps, 1000).unwrap();
        let mut module = IoModule::new(IoKind::DigitalInput, 3, Box::new(stimulus));
        let mut bytes = [0; 3];
        for (now, image) in [
            (0, [0, 0, 0]),
            (100, [8, 0, 0]),
            (250, [8, 0x12, 0x34]),
            (999, [0, 0x12, 0x34]),
            (1100, [8, 0x12, 0x34]),
            (5050, [0, 0x12, 0x34]),
            (5100, [8, 0x12, 0x34]),
        ] {
            module.begin_scan(now);
            module.read(0, &mut bytes).unwrap();
            assert_eq!(bytes, image, "at {now}");
        }
        assert_eq!(module.read(2, &mut [0; 2]), Err(ModuleError::Outside));
        assert_eq!(module.write(0, &[1]), Err(ModuleError::Outside), "inputs have no outputs");
    }

    #[test]
    fn steps_outside_are_refused_by_number() {
        let inside = step(0, 0, StimulusValue::Byte(1));
        for (wrong, period) in [
            (step(0, 1, StimulusValue::Word(1)), 0),
            (step(0, 0, StimulusValue::Bit(8, true)), 0),
            (step(50, 0, StimulusValue::Byte(1)), 50),
        ] {
            assert_eq!(Stimulus::new(2, vec![inside, wrong], period).unwrap_err(), StimulusOutside { step: 1 });
        }
    }
}
