//! The pump: moves registers, parameters and times between a segment and the firmware, line events into it, and its
//! output to the line. It decides when the heartbeat is due and when there is nothing to do; it never waits itself.

use ob1_backplane::{ChangeMark, Channel as SegmentChannel, Counter, CpSide, CpuState, Freshness};
use ob1_firmware::cp341::{Channel, ChannelBlock};
use ob1_firmware::{CpInput, IO_BYTES, Instant, LineFault, LineInput, Span};

use ob1_params::CpKind;

use crate::line_port::LinePort;
use crate::module::Module;
use crate::plug::{Parameters, Plug, SegmentEnd};
use crate::translate::EventCode;

/// Time between two beats of an idle driver.
pub const HEARTBEAT: Span = Span::from_millis(50);

/// Time to the next look when the other end was in the middle of a write.
const LOOK_AGAIN: Span = Span::from_micros(50);

/// [`DriverState::ParameterError`](ob1_backplane::DriverState::ParameterError) when the JSON is refused; smaller codes
/// are the number of the parameter byte.
const CODE_CONFIGURATION: u32 = 0x100;

/// A CP on the back plane.
pub struct CpPump {
    /// A CP 240, until the configuration has set the type.
    module: Module,
    end: SegmentEnd,
    /// The mark of the CPU side up to which everything has been handled.
    seen: Option<ChangeMark>,
    /// A set of registers was in the middle of a write.
    look_again: bool,
    params_revision: u64,
    /// The line has not been there since the start.
    no_line: bool,
    cpu_running: Option<bool>,
    /// The module has forgotten the start numbers of the handling blocks: what they show counts again, although it has
    /// been seen.
    forgot_channels: bool,
    next_beat: Instant,
    /// The reason may have changed.
    has_stepped: bool,
}

impl CpPump {
    /// A driver just attached; heartbeat and look begin with the first [`Self::poll`].
    pub fn new(segment: CpSide) -> Self {
        Self {
            module: Module::new(CpKind::Cp240, segment.generation(), segment.io_bytes()),
            end: SegmentEnd::new(segment),
            seen: None,
            look_again: false,
            params_revision: 0,
            no_line: false,
            cpu_running: None,
            forgot_channels: false,
            next_beat: Instant::START,
            has_stepped: false,
        }
    }

    /// Says what CLOCK_MONOTONIC shows, in nanoseconds, when the driver's clock shows 0. Without it the driver says no
    /// times of orders.
    pub fn set_origin(&mut self, monotonic: u64) {
        self.end.times.origin = Some(monotonic);
    }

    /// The driver's end of the segment.
    pub const fn segment(&self) -> &CpSide {
        &self.end.segment
    }

    /// Whether the module works: its parameters are valid, and the CPU has acknowledged its start-up where it has one.
    pub fn is_working(&self) -> bool {
        self.module.is_working()
    }

    /// Counts log lines of this driver that were dropped.
    pub fn count_lost_log(&mut self, lines: u64) {
        if lines > 0 {
            self.end.segment.count(Counter::LogLost, lines);
        }
    }

    /// Checks the segment and the time; returns when to call again at the latest.
    ///
    /// With nothing to do this is a handful of comparisons.
    pub fn poll<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) -> Instant {
        if now >= self.next_beat {
            self.end.segment.beat();
            self.next_beat = now + HEARTBEAT;
            self.has_stepped = true;
        }
        let mark = self.end.segment.changes();
        if self.look_again || self.seen != Some(mark) {
            self.seen = Some(mark);
            self.look(now, line);
        }
        if self.module.due().is_some_and(|due| now >= due) {
            self.step(now, CpInput::Tick, line);
        }
        self.show_reason(now);
        self.deadline(now)
    }

    /// The line has not been there since the start, which is no fault yet; returns the same as [`Self::poll`].
    pub fn no_line<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) -> Instant {
        self.no_line = true;
        self.step(now, CpInput::NoLine, line);
        self.deadline(now)
    }

    /// Passes in an event of the line; returns the same as [`Self::poll`].
    pub fn line_event<L: LinePort + ?Sized>(&mut self, now: Instant, input: LineInput<'_>, line: &mut L) -> Instant {
        match input {
            LineInput::Rx(_) => self.end.times.heard(now),
            LineInput::TxDone => self.end.times.left(now),
            LineInput::Fault(LineFault::Back) => {
                self.no_line = false;
                self.line_up(now);
            }
            LineInput::Fault(LineFault::Gone) => {
                self.no_line = false;
                if self.end.line_error.is_none() {
                    self.line_error(now, 0, "gone");
                }
            }
            LineInput::Modem(lines) => {
                self.end.modem_inputs = lines;
                self.end.show_modem();
            }
            _ => {}
        }
        self.step(now, CpInput::Line(input), line);
        self.show_reason(now);
        self.deadline(now)
    }

    /// Reports why the line is gone: the operating system's error number (0: none) and a text. The firmware gets the
    /// event itself by [`Self::line_event`].
    pub fn line_error(&mut self, now: Instant, errno: u32, reason: &str) {
        self.end.line_error = Some(errno);
        self.end.emit(now, EventCode::LineGone as u32, &errno.to_be_bytes());
        self.write_text(reason);
        self.end.show_state();
    }

    /// Reports that the line has begun to give back what is sent, with a text for the user, or has ceased to.
    pub fn line_echo(&mut self, now: Instant, text: Option<&str>) {
        self.end.echoes = text.is_some();
        self.end.emit(now, EventCode::LineEcho as u32, &[u8::from(text.is_some())]);
        self.write_text(text.unwrap_or_default());
        self.end.show_reason(now, self.module.cp());
    }

    /// Announces sleep; see [`CpSide::prepare_sleep`]. False: poll again first.
    pub fn prepare_sleep(&mut self) -> bool {
        self.seen.is_some_and(|seen| self.end.segment.prepare_sleep(seen))
    }

    /// Whether the CPU side has changed anything since the last [`Self::poll`].
    pub fn has_changes(&self) -> bool {
        self.seen != Some(self.end.segment.changes())
    }

    /// Ends the sleep: the CPU side need not ring the doorbell any more.
    pub fn awake(&mut self) {
        self.end.segment.awake();
    }

    fn line_up(&mut self, now: Instant) {
        self.end.line_error = None;
        self.end.emit(now, EventCode::LineUp as u32, &[]);
        self.write_text("");
        self.end.show_state();
    }

    /// After a step, and with each beat.
    fn show_reason(&mut self, now: Instant) {
        if std::mem::take(&mut self.has_stepped) {
            self.end.show_reason(now, self.module.cp());
        }
    }

    fn deadline(&self, now: Instant) -> Instant {
        let again = self.look_again.then_some(now + LOOK_AGAIN);
        self.module.due().into_iter().chain(again).fold(self.next_beat, Instant::min)
    }

    /// Writes a text about the line, if the module does not use the record itself.
    fn write_text(&mut self, text: &str) {
        if !self.module.kind().row().has_record {
            self.end.write_text(text);
        }
    }

    fn step<L: LinePort + ?Sized>(&mut self, now: Instant, input: CpInput<'_>, line: &mut L) {
        self.has_stepped = true;
        self.module.step(now, input, &mut Plug { end: &mut self.end, line, now });
    }

    /// Reads the blocks of the handling blocks in the channels.
    fn look_channels<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) {
        let all = std::mem::take(&mut self.forgot_channels);
        for (channel, name) in [(SegmentChannel::Send, Channel::Send), (SegmentChannel::Receive, Channel::Receive)] {
            if !all && !self.end.segment.channel_changed(channel) {
                continue;
            }
            if channel == SegmentChannel::Send {
                self.end.times.posted(self.end.segment.posted());
            }
            let mut block: ChannelBlock = [0; 64];
            if self.end.segment.read_channel(channel, &mut block) == Freshness::Stale {
                self.look_again = true;
            }
            self.module.step(now, CpInput::Channel(name, &block), &mut Plug { end: &mut self.end, line, now });
        }
    }

    fn look<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) {
        self.look_again = false;
        self.look_cpu(now, line);
        let modem = self.end.segment.modem_outputs();
        if modem != self.end.modem {
            self.end.modem = modem;
            self.end.drive_modem(now, line);
        }
        // The registers first: their content at the arrival of parameters is from before the start.
        if self.end.segment.outputs_changed() {
            self.look_outputs(now, line);
        }
        if self.end.segment.params_changed() {
            self.look_params(now, line);
        }
        if self.module.kind().row().has_channels {
            self.look_channels(now, line);
        }
        self.end.show_state();
    }

    fn look_outputs<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) {
        let mut outputs = [0; *IO_BYTES.end()];
        let outputs = &mut outputs[..self.end.segment.io_bytes().min(*IO_BYTES.end())];
        if self.end.segment.read_outputs(outputs) == Freshness::Stale {
            self.look_again = true;
        }
        if outputs.get(2..4).is_some_and(|count| count[0] & 0x80 == 0 && count != [0, 0]) {
            self.end.times.posted(self.end.segment.posted());
        }
        self.step(now, CpInput::Outputs(outputs), line);
    }

    /// Adopts the configured type: if it has changed, a new module of that type takes over the present state of CPU and
    /// line.
    fn adopt<L: LinePort + ?Sized>(&mut self, now: Instant, kind: CpKind, line: &mut L) {
        if self.module.kind() == kind {
            return;
        }
        self.module = Module::new(kind, self.end.segment.generation(), self.end.segment.io_bytes());
        self.forgot_channels = true;
        if self.no_line {
            self.step(now, CpInput::NoLine, line);
        } else if self.end.line_error.is_some() {
            self.step(now, CpInput::Line(LineInput::Fault(LineFault::Gone)), line);
        }
        if let Some(running) = self.cpu_running {
            self.step(now, CpInput::CpuRun(running), line);
        }
        if self.module.kind().row().outputs_first {
            self.look_outputs(now, line);
        }
    }

    fn look_cpu<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) {
        let running = match self.end.segment.cpu_state() {
            Ok(CpuState::Stop) => false,
            Ok(CpuState::Startup | CpuState::Run) => true,
            Err(_) => return self.end.emit(now, EventCode::Segment as u32, &[]),
        };
        if self.cpu_running != Some(running) {
            if !running && self.module.kind().row().has_channels {
                // What the blocks wrote before the STOP still counts: a telegram that they have told the program must
                // not come again.
                self.look_channels(now, line);
            }
            self.cpu_running = Some(running);
            // A block that starts with the number from before the STOP writes the same bytes, which is no change; and
            // a CPU that is in RUN again at once may have written before its STOP was seen.
            self.forgot_channels = running;
            self.step(now, CpInput::CpuRun(running), line);
        }
    }

    fn look_params<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) {
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
        if configured.is_ok() {
            line.introduce(now, &bytes);
        }
        let kind = line.cp_type();
        self.adopt(now, kind.kind, line);
        self.module.enable_diagnostics(line.diagnostics());
        self.end.parameters = Parameters::Valid;
        self.module.parametrise(now, &bytes, &kind, &mut Plug { end: &mut self.end, line, now });
        if !self.module.kind().row().outputs_first {
            self.look_outputs(now, line);
        }
        if let Err(refused) = configured {
            self.end.parameters = Parameters::Refused(CODE_CONFIGURATION);
            self.end.emit(now, EventCode::Configuration as u32, &[]);
            self.write_text(&refused.0);
        }
    }
}
