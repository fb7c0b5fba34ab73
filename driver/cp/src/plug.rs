//! The firmware's port: it puts the output of a CP into the segment and onto the line, besides the driver's own data.

use ob1_backplane::{Channel as SegmentChannel, CpSide, DriverState, Event, EventKind, ModemOutputs, OrderTimes};
use ob1_firmware::cp341::{Channel, ChannelBlock};
use ob1_firmware::{
    Counter, Cp, CpEvent, CpPort, Instant, Leds, LineSettings, ModemLines, Reason, Span, StartReason, Troubles, Why,
    Wire,
};

use crate::line_port::LinePort;
use crate::times::Tracker;
use crate::translate::{self, EventCode, LINE_TEXT_RECORD};

/// Number of the diagnostic record of a CP 040 [S3 "Diagnostic data"] and a CP 341.
const DIAGNOSTIC_RECORD: u32 = 1;

/// The same number is listed again after this time.
const LIST_AGAIN: Span = Span::from_secs(1);

/// The driver's end of the segment, with the data shown there.
pub(crate) struct SegmentEnd {
    pub(crate) segment: CpSide,
    pub(crate) modem: ModemOutputs,
    pub(crate) modem_inputs: ModemLines,
    /// RTS as set by the protocol.
    rts: bool,
    /// DTR as set by the CP (FC 8).
    dtr: bool,
    pub(crate) parameters: Parameters,
    /// Error number of a line that is gone.
    pub(crate) line_error: Option<u32>,
    state: DriverState,
    /// The line gives back what is sent.
    pub(crate) echoes: bool,
    /// What has failed at the CP.
    pub(crate) troubles: Troubles,
    reason: Option<Reason>,
    /// The number listed last, and when.
    listed: Option<(u16, Instant)>,
    pub(crate) times: Tracker,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parameters {
    None,
    Refused(u32),
    Valid,
}

impl SegmentEnd {
    /// A driver just attached.
    pub(crate) fn new(segment: CpSide) -> Self {
        Self {
            segment,
            modem: ModemOutputs::default(),
            modem_inputs: ModemLines::default(),
            rts: true,
            dtr: true,
            parameters: Parameters::None,
            line_error: None,
            echoes: false,
            state: DriverState::Starting,
            troubles: Troubles::default(),
            reason: None,
            listed: None,
            times: Tracker::default(),
        }
    }

    /// A message for the diagnostic buffer.
    pub(crate) fn emit(&mut self, now: Instant, code: u32, data: &[u8]) {
        // A full ring counts the events it drops.
        self.segment.emit_event(Event::new(now.nanos(), EventKind::Message, code, data));
    }

    /// An order has ended with this number: a code of the indicator word, or a STATUS.
    fn order_ended(&mut self, now: Instant, number: u16) {
        self.segment.count_end(number);
        let bytes = number.to_be_bytes();
        let data = if number > 0xFF { &bytes[..] } else { &bytes[1..] };
        self.emit(now, EventCode::SendFailed as u32, data);
    }

    /// Something in a protocol, if it has a number.
    fn occurred(&mut self, now: Instant, number: Option<u16>) {
        if let Some(number) = number {
            self.list(now, number);
            self.emit(now, u32::from(number), &[]);
        }
    }

    /// Lists a number of a CP that has no diagnostic buffer by its manual: a noisy line repeats one for each character.
    fn list(&mut self, now: Instant, number: u16) {
        if self.listed.is_none_or(|(before, at)| before != number || now >= at + LIST_AGAIN) {
            self.listed = Some((number, now));
            self.segment.enter(number, true);
        }
    }

    /// Where the time of orders and telegrams goes: of one that has ended now.
    fn account(&mut self, now: Instant, event: &CpEvent<'_>) -> Option<OrderTimes> {
        let ended = match event {
            CpEvent::Startup { .. } => {
                self.times.forget();
                None
            }
            CpEvent::Order(telegram) => {
                self.times.taken(now, telegram.len());
                None
            }
            CpEvent::OrderDiscarded { .. } => {
                self.times.none();
                None
            }
            CpEvent::Sent | CpEvent::SendFailed(_) | CpEvent::JobFailed(_) => self.times.ended(now),
            CpEvent::Received(telegram) => {
                self.times.received(telegram.len());
                None
            }
            CpEvent::Delivered(_) => self.times.delivered(now),
            _ => None,
        };
        if let Some(times) = ended {
            self.segment.enter_times(times);
        }
        ended
    }

    /// Shows what the CP waits for, or what has failed.
    pub(crate) fn show_reason(&mut self, now: Instant, cp: &dyn Cp) {
        let told = self.troubles.reason(now, cp);
        // What fails on a line that echoes fails because of that.
        let by_echo = |told: Reason| matches!(told.why, Why::OrderFailed | Why::ReceiveError);
        let reason = if self.echoes && told.is_none_or(by_echo) { Some(Reason::state(Why::Echoes, 0)) } else { told };
        if reason != self.reason {
            self.reason = reason;
            self.segment.set_reason(reason);
        }
    }

    /// Shows a text as the diagnostic record.
    pub(crate) fn write_text(&mut self, text: &str) {
        let mut end = text.len().min(ob1_backplane::layout::RECORD_BYTES);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        // Cut to the length of a record, so it is never too long.
        let _ = self.segment.write_diagnosis(LINE_TEXT_RECORD, &text.as_bytes()[..end]);
    }

    pub(crate) fn show_state(&mut self) {
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

    /// The levels of RTS and DTR: the CPU's if it drives them, otherwise the CP's.
    fn modem_levels(&self) -> (bool, bool) {
        let rts = if self.modem.drive_rts { self.modem.rts } else { self.rts };
        let dtr = if self.modem.drive_dtr { self.modem.dtr } else { self.dtr };
        (rts, dtr)
    }

    pub(crate) fn drive_modem<L: LinePort + ?Sized>(&mut self, now: Instant, line: &mut L) {
        let (rts, dtr) = self.modem_levels();
        line.set_modem_lines(now, rts, dtr);
        self.show_modem();
    }

    pub(crate) fn show_modem(&mut self) {
        let (rts, dtr) = self.modem_levels();
        self.segment.set_modem_inputs(translate::modem(self.modem_inputs, rts, dtr));
    }
}

/// Segment and line for the firmware during one step.
pub(crate) struct Plug<'a, L: ?Sized> {
    pub(crate) end: &'a mut SegmentEnd,
    pub(crate) line: &'a mut L,
    pub(crate) now: Instant,
}

impl<L: LinePort + ?Sized> Wire for Plug<'_, L> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.end.times.out(self.now);
        self.line.transmit(self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.take_back(self.now)
    }

    fn rts(&mut self, on: bool) {
        self.end.rts = on;
        self.end.drive_modem(self.now, self.line);
    }

    fn dtr(&mut self, on: bool) {
        self.end.dtr = on;
        self.end.drive_modem(self.now, self.line);
    }
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

    fn line_settings(&mut self, settings: &LineSettings) {
        self.line.apply(self.now, settings);
    }

    fn lateness(&self) -> Span {
        self.line.lateness()
    }

    fn record(&mut self, record: &[u8]) {
        // Always shorter than the maximum of a record.
        let _ = self.end.segment.write_diagnosis(DIAGNOSTIC_RECORD, record);
    }

    fn leds(&mut self, leds: Leds) {
        self.end.segment.set_leds(leds);
    }

    fn count(&mut self, counter: Counter, n: u64) {
        self.end.segment.count(counter, n);
    }

    fn event(&mut self, now: Instant, event: CpEvent<'_>) {
        self.end.troubles.event(now, &event);
        let times = self.end.account(now, &event);
        match &event {
            CpEvent::Startup { number, reason } => {
                let reason = u8::from(*reason == StartReason::ResetRequest);
                self.end.emit(now, EventCode::Startup as u32, &[*number, reason]);
            }
            CpEvent::Working => self.end.emit(now, EventCode::Working as u32, &[]),
            CpEvent::NoParameters(error) => {
                let byte = error.byte.map_or(0, |byte| byte as u8);
                self.end.parameters = Parameters::Refused(u32::from(byte));
                self.end.emit(now, EventCode::NoParameters as u32, &[byte]);
            }
            CpEvent::Entry(number) => self.end.segment.enter(*number, true),
            CpEvent::EntryGone(number) => self.end.segment.enter(*number, false),
            CpEvent::SendFailed(code) | CpEvent::OrderDiscarded { code: Some(code) } => {
                self.end.list(now, (*code).into());
                self.end.order_ended(now, (*code).into());
            }
            CpEvent::JobFailed(status) => self.end.order_ended(now, *status),
            CpEvent::Diagnosis { incoming, data } => {
                let kind = if *incoming { EventKind::DiagnosticIncoming } else { EventKind::DiagnosticOutgoing };
                let number = u32::from(u16::from_be_bytes([data[4], data[5]]));
                self.end.segment.emit_event(Event::new(now.nanos(), kind, number, data));
            }
            CpEvent::Record { incoming, record } => {
                let kind = if *incoming { EventKind::DiagnosticIncoming } else { EventKind::DiagnosticOutgoing };
                self.end.segment.emit_event(Event::new(now.nanos(), kind, 0, record));
            }
            CpEvent::Protocol(event) => self.end.occurred(now, event.number()),
            CpEvent::Rk512(event) => self.end.occurred(now, event.number()),
            _ => {}
        }
        self.line.trace(now, &event);
        if let Some(times) = times {
            self.line.times(now, &times);
        }
    }
}
