//! The pump: moves registers, parameters and times between a segment and the firmware, line events into it, and its
//! output to the line. It decides when the heart beats and when there is nothing to do; it waits for nothing itself.

use ob1_backplane::{
    ChangeMark, Channel as SegmentChannel, CpSide, CpuState, DriverState, Event, EventKind, Freshness, ModemOutputs,
};
use ob1_firmware::cp341::{Channel, ChannelBlock, Cp341, Input341};
use ob1_firmware::{
    Cp040, Cp240, CpCounter, CpEvent, CpInput, CpPort, DiagnosticRecord, IO_BYTES, Leds, LineFault, LineInput,
    LineSettings, Nanos, ParameterFault, Registers, StartReason,
};

use crate::translate::{self, EventCode, LINE_TEXT_RECORD};

/// Time between two beats of an idle driver.
pub const HEARTBEAT: Nanos = 50_000_000;

/// When the other end is found in the middle of a write, look again after this.
const LOOK_AGAIN: Nanos = 50_000;

/// [`DriverState::ParameterError`] when it is the JSON that is refused; smaller codes are the number of the parameter byte.
const CODE_CONFIGURATION: u32 = 0x100;

/// Number of the diagnostic record of a CP 040. [S3 "Diagnostic data"]
const DIAGNOSTIC_RECORD: u32 = 1;

/// The driver's configuration was refused, and why.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(pub String);

/// The parameters of a CP 341, or what is wrong with them.
pub type Parameters341 = Result<ob1_params::Cp341, ob1_params::ParamError>;

/// The line as the pump needs it: it puts things out here. What comes in goes to [`CpPump::line_event`].
pub trait LinePort {
    /// A parameter transfer brought this JSON text. It comes before [`Self::apply`].
    ///
    /// # Errors
    /// [`Refused`]: the pump shows it; the CP goes on with the line it has, or none.
    fn configure(&mut self, now: Nanos, json: &[u8]) -> Result<(), Refused> {
        let _ = (now, json);
        Ok(())
    }

    /// The parameter bytes that came with it, if it was not refused.
    fn introduce(&mut self, now: Nanos, parameters: &[u8; 16]) {
        let _ = (now, parameters);
    }

    /// Sets baud rate and character frame.
    fn apply(&mut self, now: Nanos, settings: &LineSettings);

    /// Sends characters behind those before.
    fn transmit(&mut self, now: Nanos, bytes: &[u8]);

    /// Takes back what has not begun to leave; answers how many characters.
    fn take_back(&mut self, now: Nanos) -> usize {
        let _ = now;
        0
    }

    /// How late characters that have come in may be handed over, because they come in bursts.
    fn lateness(&self) -> Nanos {
        0
    }

    /// Sets RTS and DTR.
    fn set_modem_lines(&mut self, now: Nanos, rts: bool, dtr: bool) {
        let _ = (now, rts, dtr);
    }

    /// Whether the configuration enables diagnostics; asked after [`Self::configure`].
    fn diagnostics(&self) -> bool {
        false
    }

    /// CP 341: its parameters, or what is wrong with them; asked after [`Self::configure`]. `None`: it is a CP 240.
    fn cp341(&self) -> Option<Parameters341> {
        None
    }

    /// Whether the module is a CP 040; asked after [`Self::configure`].
    fn is_cp040(&self) -> bool {
        false
    }

    /// Something for the log.
    fn trace(&mut self, now: Nanos, event: &CpEvent<'_>) {
        let _ = (now, event);
    }
}

/// A CP on the back plane.
pub struct CpPump {
    cp: Cp240,
    /// In its place, once the configuration has said that it is a CP 341.
    cp341: Option<Box<Cp341>>,
    /// In its place, once the configuration has said that it is a CP 040.
    cp040: Option<Box<Cp040>>,
    end: End,
    /// The CPU side's history up to which everything has been looked at.
    seen: Option<ChangeMark>,
    /// A register set was found in the middle of a write.
    look_again: bool,
    params_revision: u64,
    cpu_running: Option<bool>,
    due: Option<Nanos>,
    next_beat: Nanos,
}

/// The firmware's plug into the segment, with what is shown there.
struct End {
    segment: CpSide,
    modem: ModemOutputs,
    modem_inputs: ob1_firmware::ModemLines,
    /// RTS as the protocol wants it.
    rts: bool,
    /// DTR as the CP wants it (FC 8).
    dtr: bool,
    parameters: Parameters,
    /// Error number of a line that is gone.
    line_error: Option<u32>,
    /// The place of the diagnostic record is the module's own: the text of a line error has none.
    has_record: bool,
    state: DriverState,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Parameters {
    None,
    Refused(u32),
    Valid,
}

impl CpPump {
    /// A driver just attached; it beats and looks with the first [`Self::poll`].
    pub fn new(segment: CpSide) -> Self {
        Self {
            cp: Cp240::new(segment.generation()),
            cp341: None,
            cp040: None,
            end: End {
                segment,
                modem: ModemOutputs::default(),
                modem_inputs: ob1_firmware::ModemLines::default(),
                rts: true,
                dtr: true,
                parameters: Parameters::None,
                line_error: None,
                has_record: false,
                state: DriverState::Starting,
            },
            seen: None,
            look_again: false,
            params_revision: 0,
            cpu_running: None,
            due: None,
            next_beat: 0,
        }
    }

    /// The driver's end of the segment.
    pub const fn segment(&self) -> &CpSide {
        &self.end.segment
    }

    /// The firmware.
    pub const fn cp(&self) -> &Cp240 {
        &self.cp
    }

    /// Looks at the segment and the time; the result is when to call again at the latest.
    ///
    /// With nothing to do this is a handful of comparisons.
    pub fn poll<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) -> Nanos {
        if now >= self.next_beat {
            self.end.segment.beat();
            self.next_beat = now + HEARTBEAT;
        }
        let mark = self.end.segment.changes();
        if self.look_again || self.seen != Some(mark) {
            self.seen = Some(mark);
            self.look(now, line);
        }
        if self.due.is_some_and(|due| now >= due) {
            self.step(now, CpInput::Tick, line);
        }
        self.deadline(now)
    }

    /// Hands in what happened on the line; the result is as of [`Self::poll`].
    pub fn line_event<L: LinePort + ?Sized>(&mut self, now: Nanos, input: LineInput<'_>, line: &mut L) -> Nanos {
        match input {
            LineInput::Fault(LineFault::Back) => self.line_up(now),
            LineInput::Fault(LineFault::Gone) if self.end.line_error.is_none() => self.line_error(now, 0, "gone"),
            LineInput::Modem(lines) => {
                self.end.modem_inputs = lines;
                self.end.show_modem();
            }
            _ => {}
        }
        self.step(now, CpInput::Line(input), line);
        self.deadline(now)
    }

    /// Tells why the line is gone: the operating system's error number (0: none) and a text. The firmware learns of it by
    /// [`Self::line_event`].
    pub fn line_error(&mut self, now: Nanos, errno: u32, reason: &str) {
        self.end.line_error = Some(errno);
        self.end.emit(now, EventCode::LineGone as u32, &errno.to_be_bytes());
        self.end.write_text(reason);
        self.end.show_state();
    }

    /// Announces sleep; see [`CpSide::prepare_sleep`]. False: poll again first.
    pub fn prepare_sleep(&mut self) -> bool {
        self.seen.is_some_and(|seen| self.end.segment.prepare_sleep(seen))
    }

    /// Whether the CPU side has changed anything since the last [`Self::poll`].
    pub fn has_changes(&self) -> bool {
        self.seen != Some(self.end.segment.changes())
    }

    /// Ends the sleep.
    pub fn awake(&mut self) {
        self.end.segment.awake();
    }

    fn line_up(&mut self, now: Nanos) {
        self.end.line_error = None;
        self.end.emit(now, EventCode::LineUp as u32, &[]);
        self.end.write_text("");
        self.end.show_state();
    }

    fn deadline(&self, now: Nanos) -> Nanos {
        let again = self.look_again.then_some(now + LOOK_AGAIN);
        self.due.into_iter().chain(again).fold(self.next_beat, Nanos::min)
    }

    fn step<L: LinePort + ?Sized>(&mut self, now: Nanos, input: CpInput<'_>, line: &mut L) {
        let mut plug = Plug { end: &mut self.end, line, now };
        if let Some(cp) = &mut self.cp040 {
            self.due = cp.step(now, input, &mut plug);
            return;
        }
        let Some(cp) = &mut self.cp341 else {
            self.due = self.cp.step(now, input, &mut plug);
            return;
        };
        let input = match input {
            CpInput::Tick => Input341::Tick,
            CpInput::Line(input) => Input341::Line(input),
            CpInput::CpuRun(run) => Input341::CpuRun(run),
            CpInput::Outputs(outputs) => match outputs.first_chunk() {
                Some(outputs) => Input341::Outputs(outputs),
                // Fewer bytes than a CP 341 has: the segment is another module's.
                None => return,
            },
            // The parameters of a CP 341 are keys.
            CpInput::Parameters(_) => return,
        };
        self.due = cp.step(now, input, &mut plug);
    }

    fn step_341<L: LinePort + ?Sized>(&mut self, now: Nanos, input: Input341<'_>, line: &mut L) {
        if let Some(cp) = &mut self.cp341 {
            self.due = cp.step(now, input, &mut Plug { end: &mut self.end, line, now });
        }
    }

    /// What the handling blocks of a CP 341 show.
    fn look_channels<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        for (channel, name) in [(SegmentChannel::Send, Channel::Send), (SegmentChannel::Receive, Channel::Receive)] {
            if !self.end.segment.channel_changed(channel) {
                continue;
            }
            let mut block: ChannelBlock = [0; 64];
            if self.end.segment.read_channel(channel, &mut block) == Freshness::Stale {
                self.look_again = true;
            }
            self.step_341(now, Input341::Channel(name, &block), line);
        }
    }

    /// The configuration says that this is a CP 341.
    fn parametrise_341<L: LinePort + ?Sized>(&mut self, now: Nanos, parameters: &Parameters341, line: &mut L) {
        if self.cp341.is_none() {
            self.cp341 = Some(Box::new(Cp341::new()));
            if self.end.line_error.is_some() {
                self.step(now, CpInput::Line(LineInput::Fault(LineFault::Gone)), line);
            }
            if let Some(run) = self.cpu_running {
                self.step(now, CpInput::CpuRun(run), line);
            }
        }
        if let Some(cp) = &mut self.cp341 {
            cp.enable_diagnostics(line.diagnostics());
        }
        self.step_341(now, Input341::Parameters(parameters.as_ref()), line);
        // What V24_SET has written before there was a CP 341.
        let mut outputs = Registers::default();
        let _stale_ones_come_again = self.end.segment.read_outputs(&mut outputs);
        self.step_341(now, Input341::Outputs(&outputs), line);
    }

    fn look<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        self.look_again = false;
        self.look_cpu(now, line);
        let modem = self.end.segment.modem_outputs();
        if modem != self.end.modem {
            self.end.modem = modem;
            self.end.drive_modem(now, line);
        }
        // The registers first: what stands in them when parameters arrive is of an earlier life.
        if self.end.segment.outputs_changed() {
            self.look_outputs(now, line);
        }
        if self.end.segment.params_changed() {
            self.look_params(now, line);
        }
        if self.cp341.is_some() {
            self.look_channels(now, line);
        }
        self.end.show_state();
    }

    fn look_outputs<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        let mut outputs = [0; *IO_BYTES.end()];
        let outputs = &mut outputs[..self.end.segment.io_bytes().min(*IO_BYTES.end())];
        if self.end.segment.read_outputs(outputs) == Freshness::Stale {
            self.look_again = true;
        }
        self.step(now, CpInput::Outputs(outputs), line);
    }

    /// The configuration says whether this is a CP 040: then it is one from now on, with the world as it stands.
    fn become_cp040<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        if self.cp040.is_some() || !line.is_cp040() {
            return;
        }
        self.cp040 = Some(Box::new(Cp040::new(self.end.segment.io_bytes())));
        self.end.has_record = true;
        if self.end.line_error.is_some() {
            self.step(now, CpInput::Line(LineInput::Fault(LineFault::Gone)), line);
        }
        if let Some(running) = self.cpu_running {
            self.step(now, CpInput::CpuRun(running), line);
        }
        self.look_outputs(now, line);
    }

    fn look_cpu<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        let running = match self.end.segment.cpu_state() {
            Ok(CpuState::Stop) => false,
            Ok(CpuState::Startup | CpuState::Run) => true,
            Err(_) => return self.end.emit(now, EventCode::Segment as u32, &[]),
        };
        if self.cpu_running != Some(running) {
            self.cpu_running = Some(running);
            self.step(now, CpInput::CpuRun(running), line);
        }
    }

    fn look_params<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        let Ok(params) = self.end.segment.read_params() else {
            return self.end.emit(now, EventCode::Segment as u32, &[]);
        };
        if params.freshness == Freshness::Stale {
            self.look_again = true;
            return;
        }
        if params.revision == self.params_revision {
            return;
        }
        self.params_revision = params.revision;
        let bytes = params.bytes;
        let configured = line.configure(now, params.json);
        self.become_cp040(now, line);
        match &mut self.cp040 {
            Some(cp) => cp.enable_diagnostics(line.diagnostics()),
            None => self.cp.enable_diagnostics(line.diagnostics()),
        }
        if configured.is_ok() {
            line.introduce(now, &bytes);
        }
        self.end.parameters = Parameters::Valid;
        match line.cp341() {
            Some(parameters) => self.parametrise_341(now, &parameters, line),
            None => self.step(now, CpInput::Parameters(&bytes), line),
        }
        if let Err(refused) = configured {
            self.end.parameters = Parameters::Refused(CODE_CONFIGURATION);
            self.end.emit(now, EventCode::Configuration as u32, &[]);
            self.end.write_text(&refused.0);
        }
    }
}

impl End {
    fn emit(&mut self, now: Nanos, code: u32, data: &[u8]) {
        // A full ring counts what it could not take.
        self.segment.emit_event(Event::new(now, EventKind::Message, code, data));
    }

    fn write_text(&mut self, text: &str) {
        if self.has_record {
            return;
        }
        let mut end = text.len().min(ob1_backplane::layout::RECORD_BYTES);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        // Cut to what a record holds, so it is never too long.
        let _ = self.segment.write_diagnosis(LINE_TEXT_RECORD, &text.as_bytes()[..end]);
    }

    fn show_state(&mut self) {
        let state = match (self.parameters, self.line_error) {
            (Parameters::None, _) => DriverState::NoParameters,
            (Parameters::Refused(code), _) => DriverState::ParameterError(code),
            (Parameters::Valid, Some(errno)) => DriverState::LineError(errno),
            (Parameters::Valid, None) => DriverState::Ready,
        };
        if state != self.state {
            self.state = state;
            self.segment.set_state(state);
        }
    }

    /// RTS and DTR as they are: the CPU's where it drives them, otherwise the CP's.
    fn modem_levels(&self) -> (bool, bool) {
        let rts = if self.modem.drive_rts { self.modem.rts } else { self.rts };
        let dtr = if self.modem.drive_dtr { self.modem.dtr } else { self.dtr };
        (rts, dtr)
    }

    fn drive_modem<L: LinePort + ?Sized>(&mut self, now: Nanos, line: &mut L) {
        let (rts, dtr) = self.modem_levels();
        line.set_modem_lines(now, rts, dtr);
        self.show_modem();
    }

    fn show_modem(&mut self) {
        let (rts, dtr) = self.modem_levels();
        self.segment.set_modem_inputs(translate::modem(self.modem_inputs, rts, dtr));
    }
}

/// Segment and line as the firmware sees them, during one step.
struct Plug<'a, L: ?Sized> {
    end: &'a mut End,
    line: &'a mut L,
    now: Nanos,
}

impl<L: LinePort + ?Sized> CpPort for Plug<'_, L> {
    fn inputs(&mut self, registers: &[u8]) {
        self.end.segment.write_inputs(registers);
    }

    fn channel(&mut self, channel: Channel, block: &ChannelBlock) {
        let channel = match channel {
            Channel::Send => SegmentChannel::Send,
            Channel::Receive => SegmentChannel::Receive,
        };
        self.end.segment.write_channel(channel, block);
    }

    fn transmit(&mut self, bytes: &[u8]) {
        self.line.transmit(self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.take_back(self.now)
    }

    fn line_settings(&mut self, settings: &LineSettings) {
        self.line.apply(self.now, settings);
    }

    fn lateness(&self) -> Nanos {
        self.line.lateness()
    }

    fn rts(&mut self, on: bool) {
        self.end.rts = on;
        self.end.drive_modem(self.now, self.line);
    }

    fn dtr(&mut self, on: bool) {
        self.end.dtr = on;
        self.end.drive_modem(self.now, self.line);
    }

    fn record(&mut self, record: &DiagnosticRecord) {
        // Shorter than a record may be.
        let _ = self.end.segment.write_diagnosis(DIAGNOSTIC_RECORD, record);
    }

    fn leds(&mut self, leds: Leds) {
        self.end.segment.set_leds(translate::leds(leds));
    }

    fn count(&mut self, counter: CpCounter, n: u64) {
        self.end.segment.count(translate::counter(counter), n);
    }

    fn event(&mut self, now: Nanos, event: CpEvent<'_>) {
        match &event {
            CpEvent::Startup { number, reason } => {
                let reason = u8::from(*reason == StartReason::ResetRequest);
                self.end.emit(now, EventCode::Startup as u32, &[*number, reason]);
            }
            CpEvent::Working => self.end.emit(now, EventCode::Working as u32, &[]),
            CpEvent::NoParameters(fault) => {
                let byte = match fault {
                    ParameterFault::Value(error) => error.byte.map_or(0, |byte| byte as u8),
                    ParameterFault::Protocol(_) => 1,
                };
                self.end.parameters = Parameters::Refused(u32::from(byte));
                self.end.emit(now, EventCode::NoParameters as u32, &[byte]);
            }
            CpEvent::Entry(number) => self.end.emit(now, EventCode::Entry as u32, &number.to_be_bytes()),
            CpEvent::SendFailed(code) => self.end.emit(now, EventCode::SendFailed as u32, &[*code]),
            CpEvent::Diagnosis { incoming, data } => {
                let kind = if *incoming { EventKind::DiagnosticIncoming } else { EventKind::DiagnosticOutgoing };
                let number = u32::from(u16::from_be_bytes([data[4], data[5]]));
                self.end.segment.emit_event(Event::new(now, kind, number, data));
            }
            CpEvent::Record { incoming, record } => {
                let kind = if *incoming { EventKind::DiagnosticIncoming } else { EventKind::DiagnosticOutgoing };
                self.end.segment.emit_event(Event::new(now, kind, 0, record));
            }
            CpEvent::Protocol(event) => {
                if let Some(number) = event.number() {
                    self.end.emit(now, u32::from(number), &[]);
                }
            }
            CpEvent::Rk512(event) => {
                if let Some(number) = event.number() {
                    self.end.emit(now, u32::from(number), &[]);
                }
            }
            _ => {}
        }
        self.line.trace(now, &event);
    }
}
