//! The process's line: a real one, once the configuration has named it, and the log.

use ob1_backplane::OrderTimes;
use ob1_cp::{CpType, LinePort, Refused};
use ob1_firmware::{CpEvent, Instant, LineSettings, Span};
use ob1_line::RealLine;
use ob1_process::tap::Tap;
use ob1_serial::tap_record::Kind;
use tracing::{debug, info, trace, warn};

use crate::config::Config;
use crate::tap;

/// How late a real line may hand over characters: the FIFO of a UART, the latency timer of a USB adapter (16 ms), a
/// busy machine.
const LATENESS: Span = Span::from_millis(50);

/// A real line, or none yet.
#[derive(Default)]
pub(crate) struct ProcessLine {
    pub(crate) line: Option<RealLine>,
    config: Option<Config>,
    pub(crate) tap: Tap,
}

impl LinePort for ProcessLine {
    fn configure(&mut self, _now: Instant, json: &[u8]) -> Result<(), Refused> {
        let config = Config::parse(json).inspect_err(|refused| warn!("{refused}"))?;
        // Each STOP -> RUN of the CPU transfers everything again: a line that stays the same stays open.
        if self.config.as_ref() != Some(&config) {
            info!(station = config.station, name = config.name, line = %config.line, "configured");
            if self.line.as_ref().is_none_or(|line| *line.spec() != config.line) {
                // The old one first: it may hold the same device or path.
                self.line = None;
                self.line = Some(RealLine::new(&config.line));
            }
            self.tap.open(config.trace.as_deref());
            self.config = Some(config);
        }
        Ok(())
    }

    fn diagnostics(&self) -> bool {
        self.config.as_ref().is_some_and(|config| config.diagnostics)
    }

    fn cp_type(&self) -> CpType {
        self.config.as_ref().map_or(CpType::CP240, |config| config.cp_type.clone())
    }

    fn introduce(&mut self, now: Instant, parameters: &[u8; 16]) {
        if let Some(config) = &self.config {
            tap::introduce(&mut self.tap, now, config, parameters);
        }
    }

    fn apply(&mut self, _now: Instant, settings: &LineSettings) {
        if let Some(line) = &mut self.line {
            info!(%settings, "line settings");
            // Refused settings also come as an event of the line, with their reason.
            let _ = line.apply(settings);
        }
    }

    fn transmit(&mut self, now: Instant, bytes: &[u8]) {
        trace!(tx = ?bytes);
        self.tap.tell(now, Kind::Out, bytes);
        if let Some(line) = &mut self.line {
            let taken = line.write(now, bytes);
            if taken < bytes.len() {
                warn!(lost = bytes.len() - taken, "the line's send buffer is full");
            }
        }
    }

    fn take_back(&mut self, now: Instant) -> usize {
        let taken = self.line.as_mut().map_or(0, |line| line.take_back(now));
        self.tap.tell(now, Kind::TakenBack, &u32::try_from(taken).unwrap_or(u32::MAX).to_le_bytes());
        taken
    }

    fn lateness(&self) -> Span {
        LATENESS
    }

    fn set_modem_lines(&mut self, _now: Instant, rts: bool, dtr: bool) {
        if let Some(line) = &mut self.line {
            line.set_modem_lines(rts, dtr);
        }
    }

    fn times(&mut self, now: Instant, times: &OrderTimes) {
        if !self.tap.is_alone() {
            self.tap.tell(now, Kind::Note, tap::stages(times).as_bytes());
        }
    }

    fn trace(&mut self, now: Instant, event: &CpEvent<'_>) {
        tap::note(&mut self.tap, now, event, self.config.as_ref().map(|config| &config.cp_type));
        match event {
            CpEvent::Startup { .. } | CpEvent::Working => info!("{}", tap::words(event)),
            CpEvent::NoParameters(_) => warn!("{}", tap::words(event)),
            _ => debug!("{}", tap::words(event)),
        }
    }
}
