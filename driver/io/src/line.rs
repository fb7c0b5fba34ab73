//! One line of the bus: its device, its master, and its events.

use std::io;

use ob1_coupler::{Image, Input, LineConfig, LineFault, LineInput, MasterInput, State};
use ob1_io::Master;
use ob1_line::{ECHOES, Instant, LineEvent, LineSettings, LineSpec, Parity, RealLine, SILENT};
use ob1_process::tap::Tap;
use ob1_serial::tap_record::Kind;
use serde_json::json;
use tracing::{info, warn};

use crate::reopening::Reopening;

/// Events in one pass: then come the heartbeat and the other lines.
const EVENTS: u32 = 32;
/// Received bytes handed over at a time.
const BUFFER: usize = 512;

/// The device or connection, and its master.
pub(crate) struct Line {
    spec: LineSpec,
    pub(crate) real: RealLine,
    pub(crate) master: Master,
    /// Who listens to the line (`ob1 trace`).
    pub(crate) tap: Tap,
    /// When it is due without any event.
    pub(crate) deadline: Instant,
    /// Whether it was up in the last report.
    up: bool,
    reopening: Reopening,
    /// Its stations in the list of the image.
    stations: std::ops::Range<usize>,
}

impl Line {
    pub(crate) fn new(config: &LineConfig, first: usize, input_bytes: usize) -> io::Result<Self> {
        let spec: LineSpec = config.line.parse().map_err(|error| io::Error::other(format!("{error}")))?;
        let real = open(&spec, &settings(config))?;
        let master = Master::new(config, first, input_bytes, Instant::START).map_err(io::Error::other)?;
        Ok(Self {
            spec,
            real,
            master,
            tap: Tap::default(),
            deadline: Instant::START,
            up: false,
            reopening: Reopening::new(),
            stations: first..first + config.stations().count(),
        })
    }

    /// Opens the tap at this path.
    pub(crate) fn open_tap(&mut self, path: &std::path::Path, name: &str, config: &LineConfig) {
        self.tap.open(Some(path));
        let baud = config.serial.map(|serial| serial.baud).or(config.dp.as_ref().map(|dp| dp.baud));
        let about = json!({
            "module": "bus", "name": name, "line": config.line, "protocol": config.protocol(), "baud": baud,
        });
        self.tap.introduce(Instant::START, std::time::SystemTime::now(), about);
    }

    /// Takes the events of the line; true if there may be more.
    pub(crate) fn events(&mut self, now: Instant, image: &mut Image) -> bool {
        let mut buffer = [0; BUFFER];
        for _ in 0..EVENTS {
            let Some(event) = self.real.next_event(now, &mut buffer) else {
                return false;
            };
            match event {
                LineEvent::Input(input) => {
                    self.tap.hear(now, input);
                    self.step(now, Input::Line(input), image);
                }
                LineEvent::Up(warnings) => {
                    if self.tells(image, "up") {
                        info!(line = %self.spec, "the line is up");
                    }
                    warnings.iter().for_each(|warning| warn!("{warning}"));
                    self.up = true;
                    self.tap.tell(now, Kind::Up, &[]);
                    self.step(now, Input::Line(LineInput::Fault(LineFault::Back)), image);
                }
                LineEvent::Gone(reason) => {
                    if self.tells(image, &reason) {
                        warn!(line = %self.spec, "the line is gone: {reason}");
                    }
                    self.tap.tell(now, Kind::Gone, reason.as_bytes());
                    self.gone(now, image);
                }
                LineEvent::Echo(true) => warn!(line = %self.spec, "{ECHOES}"),
                LineEvent::Echo(false) => info!(line = %self.spec, "{SILENT}"),
            }
        }
        true
    }

    fn gone(&mut self, now: Instant, image: &mut Image) {
        if std::mem::take(&mut self.up) {
            self.step(now, Input::Line(LineInput::Fault(LineFault::Gone)), image);
        }
    }

    pub(crate) fn step(&mut self, now: Instant, input: MasterInput<'_>, image: &mut Image) {
        let mut out = Vec::new();
        self.deadline = self.master.step(now, input, image, &mut out);
        if !out.is_empty() {
            tracing::trace!(tx = ?out);
            self.tap.tell(now, Kind::Out, &out);
            // One request at a time: there is always room for it.
            self.real.write(now, &out);
        }
        if self.master.wants_reconnect() {
            if self.tells(image, "no answer") {
                warn!(line = %self.spec, "no usable answer on this connection: it is opened again");
            }
            self.up = false;
            self.real.reopen(self.reopening.next(now));
            self.step(now, Input::Line(LineInput::Fault(LineFault::Gone)), image);
        }
    }

    /// Whether this is to be reported.
    fn tells(&mut self, image: &Image, what: &str) -> bool {
        let mut stations = image.status.get(self.stations.clone()).unwrap_or_default().iter();
        self.reopening.tells(stations.any(|status| status.state == State::Running), what)
    }
}

pub(crate) fn open(spec: &LineSpec, settings: &LineSettings) -> io::Result<RealLine> {
    let mut real = RealLine::new(spec);
    real.apply(settings).map_err(|error| io::Error::other(format!("{error}")))?;
    Ok(real)
}

pub(crate) fn settings(config: &LineConfig) -> LineSettings {
    if let Some(dp) = &config.dp {
        return LineSettings { baud: dp.baud, parity: Parity::Even, ..LineSettings::default() };
    }
    match &config.serial {
        Some(serial) => serial.settings(),
        // TCP: the times of the line settings are not used.
        None => LineSettings { baud: 4_000_000, ..LineSettings::default() },
    }
}
