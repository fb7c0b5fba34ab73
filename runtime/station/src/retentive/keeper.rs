//! From the scan to the disk: the scan fills buffers it is given, a thread of its own writes them.
//!
//! The scan allocates nothing and takes no lock: buffers come and go through two rings. What comes too late for a
//! buffer waits for the next one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use ob1_cpu::{Cpu, OperatingState, ShortText};
use ob1_model::Event;
use ob1_rt::SideThread;
use ob1_time::Span;
use rtrb::{Consumer, Producer, RingBuffer};

use super::health::{Change, Health};
use super::store::Store;

/// Buffers under way between scan and thread.
const BUFFERS: usize = 3;
/// Changes under way to the diagnostic buffer.
const NOTES: usize = 16;
/// Time between two looks at the ring.
const LOOK: Duration = Duration::from_millis(20);
/// How long the last image is waited for.
const LAST: Duration = Duration::from_secs(2);

/// What the scan hands over.
enum Handed {
    Image(Vec<u8>),
    /// The buffer is too small for an image of so many bytes.
    TooSmall(Vec<u8>, usize),
}

/// An entry for the diagnostic buffer.
struct Note {
    event: Event,
    text: ShortText,
}

/// The scan's end: fills buffers, takes changes for the diagnostic buffer.
pub struct ScanEnd {
    notes: Consumer<Note>,
    empty: Consumer<Vec<u8>>,
    full: Producer<Handed>,
    wanted: Arc<AtomicBool>,
    ran: bool,
    owed: bool,
}

impl ScanEnd {
    /// Data blocks have other values or declarations now: an image of them follows at once.
    pub fn hand_over_soon(&mut self) {
        self.owed = true;
    }

    /// After each cycle: hands an image over when one is wanted, and when RUN has ended; enters what the writer has to
    /// say.
    pub fn after_cycle(&mut self, cpu: &mut Cpu) {
        while let Ok(note) = self.notes.pop() {
            cpu.diagnose(note.event, 0, note.text.as_str());
        }
        let runs = cpu.state() == OperatingState::Run;
        self.owed |= self.ran && !runs;
        self.ran = runs;
        if !self.owed && !self.wanted.load(Ordering::Relaxed) {
            return;
        }
        let Ok(mut buffer) = self.empty.pop() else { return };
        let len = cpu.retentive_len();
        let handed = if len > buffer.capacity() {
            Handed::TooSmall(buffer, len)
        } else {
            cpu.retentive_image(&mut buffer);
            self.owed = false;
            self.wanted.store(false, Ordering::Relaxed);
            Handed::Image(buffer)
        };
        // There are no more buffers than the ring has places.
        let _ = self.full.push(handed);
    }
}

/// The writing thread; it ends with its owner. Then it writes the last image, while the scan still cycles.
#[derive(Debug)]
pub struct Keeper {
    _thread: SideThread<Sender<()>>,
}

impl Keeper {
    /// Starts the thread that writes into `store`: an image every `every`, where something has changed, and one at each
    /// end of RUN and after blocks were loaded. `len` is the length of the CPU's image.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn start(store: Store, every: Span, len: usize, health: Health) -> std::io::Result<(Self, ScanEnd)> {
        let (mut to_scan, empty) = RingBuffer::new(BUFFERS);
        let (full, from_scan) = RingBuffer::new(BUFFERS);
        for _ in 0..BUFFERS {
            let _ = to_scan.push(Vec::with_capacity(len));
        }
        let wanted = Arc::new(AtomicBool::new(false));
        let (to_buffer, notes) = RingBuffer::new(NOTES);
        let scan = ScanEnd { notes, empty, full, wanted: Arc::clone(&wanted), ran: false, owed: false };
        let mut writer = Writer { store, from_scan, to_scan, written: Vec::new(), health, to_buffer };
        let thread = SideThread::looking("ob1-retentive", move |finished| {
            let mut next = Instant::now() + every.into();
            while finished.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                writer.drain();
                if Instant::now() >= next {
                    next = Instant::now() + every.into();
                    wanted.store(true, Ordering::Relaxed);
                }
            }
            // The CPU is in STOP and still cycles: one image more, of what was written since.
            wanted.store(true, Ordering::Relaxed);
            let end = Instant::now() + LAST;
            while wanted.load(Ordering::Relaxed) && !writer.from_scan.is_abandoned() && Instant::now() < end {
                writer.drain();
                std::thread::sleep(Duration::from_millis(1));
            }
            writer.drain();
        })?;
        Ok((Self { _thread: thread }, scan))
    }
}

struct Writer {
    store: Store,
    from_scan: Consumer<Handed>,
    to_scan: Producer<Vec<u8>>,
    /// The image on the disk.
    written: Vec<u8>,
    health: Health,
    to_buffer: Producer<Note>,
}

impl Writer {
    fn drain(&mut self) {
        while let Ok(handed) = self.from_scan.pop() {
            let mut buffer = match handed {
                Handed::Image(image) => {
                    self.write(&image);
                    image
                }
                Handed::TooSmall(mut buffer, len) => {
                    buffer.clear();
                    buffer.reserve(len);
                    buffer
                }
            };
            buffer.clear();
            let _ = self.to_scan.push(buffer);
        }
    }

    fn write(&mut self, image: &[u8]) {
        let change = if self.written == image {
            self.health.good(None, Instant::now())
        } else {
            match self.store.write(image) {
                Ok(generation) => {
                    self.written.clear();
                    self.written.extend_from_slice(image);
                    self.health.good(Some(generation), Instant::now())
                }
                Err(error) => self.health.bad(&error, Instant::now()),
            }
        };
        if let Some(change) = change {
            self.tell(&change);
        }
    }

    /// Each change once, to the log and to the diagnostic buffer.
    fn tell(&mut self, Change { event, text }: &Change) {
        if *event == Event::RETENTIVE_LOST {
            tracing::error!("{}: {text}; it is tried again", event.text());
            tracing::error!("  = {}", event.remedy());
        } else {
            tracing::info!("{}: {text}", event.text());
        }
        // The scan takes them after each cycle, in STOP too.
        let _ = self.to_buffer.push(Note { event: *event, text: ShortText::new(text) });
    }
}
