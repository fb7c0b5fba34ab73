//! Process I/O: the modules `di do ai ao`, backed by an image that any program can map, and by a timed stimulus.
//!
//! All such modules of a station share one image. They lie side by side in it: a module's first byte has the module's
//! logical address as its offset. Inputs written by a stimulus and by other programs mix; the last one wins.
//! (docs/process-io.md)

mod panel;
mod stimulus;

use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use ob1_backplane::{GuardPage, IoField, IoImage};
use ob1_cpu::{Module, ModuleError, ModuleEvent, ModuleStatus};
use ob1_time::Instant;

use ob1_station_file::{ModuleConfig, ModuleKind};

pub use panel::Panel;
pub use stimulus::Stimulus;

/// The process I/O of one station.
#[derive(Clone)]
pub struct ProcessIo {
    shared: Arc<Mutex<Shared>>,
    guard: GuardPage,
}

/// What the guardian of a station holds of its process I/O.
#[derive(Debug)]
pub struct Held {
    /// The image, open for the guardian too.
    pub image: OwnedFd,
    /// The page beside it.
    pub page: OwnedFd,
    /// The outputs' safe state.
    pub safe: Vec<u8>,
}

/// What the modules share. All of them live on the scan thread, so the lock is never contended there; the only other
/// thread that takes it is the monitor, when the scan has hung and will not come back.
struct Shared {
    image: IoImage,
    field: IoField,
    stimulus: Stimulus,
    scans: u64,
    /// Set when the outputs have been switched off for good.
    off: bool,
}

impl std::fmt::Debug for ProcessIo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ProcessIo").finish_non_exhaustive()
    }
}

impl ProcessIo {
    /// Over an image, shared or on the heap, with the inputs a stimulus plays.
    #[must_use]
    pub fn new(image: IoImage, stimulus: Stimulus) -> Self {
        let field = image.field();
        let guard = image.guard().clone();
        Self { guard, shared: Arc::new(Mutex::new(Shared { image, field, stimulus, scans: 0, off: false })) }
    }

    /// Where other programs map the image; `None` on the heap.
    #[must_use]
    pub fn path(&self) -> Option<PathBuf> {
        self.shared.lock().ok()?.image.path()
    }

    /// The page that says whether the outputs are still this process's.
    #[must_use]
    pub const fn guard(&self) -> &GuardPage {
        &self.guard
    }

    /// What a guardian is handed; `None` on the heap, or when no descriptor is left.
    #[must_use]
    pub fn held(&self) -> Option<Held> {
        let shared = self.shared.lock().ok()?;
        let image = shared.image.descriptor()?.try_clone_to_owned().ok()?;
        let page = self.guard.descriptor()?.try_clone_to_owned().ok()?;
        Some(Held { image, page, safe: shared.image.safe_state() })
    }

    /// The other end of the image.
    #[must_use]
    pub fn field(&self) -> Option<IoField> {
        Some(self.shared.lock().ok()?.field.clone())
    }

    /// The module a station file describes; `None` if that is no process I/O. The first module made leads: it plays the
    /// stimulus at the start of a scan and counts the scan at its end.
    #[must_use]
    pub fn module(&self, config: &ModuleConfig, leads: bool) -> Option<Box<dyn Module>> {
        let (inputs, outputs) = match &config.kind {
            ModuleKind::Inputs { bytes, .. } => (*bytes, 0),
            ModuleKind::Outputs { bytes, .. } => (0, *bytes),
            // Stands in for a coupler where a program is tried without its plant.
            ModuleKind::Remote { .. } | ModuleKind::DpMaster { .. } => (config.input_bytes(), config.output_bytes()),
            _ => return None,
        };
        let (inputs_at, outputs_at) = (config.input_address as usize, config.output_address as usize);
        if outputs > 0
            && let Ok(mut shared) = self.shared.lock()
        {
            shared.image.set_safe(outputs_at, &config.substitute);
        }
        let (shared, substitute) = (Arc::clone(&self.shared), config.substitute.clone());
        Some(Box::new(IoModule {
            shared,
            inputs_at,
            inputs,
            outputs_at,
            outputs,
            leads,
            substitute,
            disabled: true,
            driven: vec![0; usize::from(outputs)],
        }))
    }

    /// Sets all outputs to their safe state for good. For the monitor, when the scan has hung: it does not wait for the
    /// scan.
    pub fn switch_off(&self) {
        if let Ok(mut shared) = self.shared.try_lock() {
            shared.off = true;
            shared.image.let_go();
        }
    }
}

/// One module: a window onto the image.
struct IoModule {
    shared: Arc<Mutex<Shared>>,
    inputs_at: usize,
    inputs: u16,
    outputs_at: usize,
    outputs: u16,
    leads: bool,
    /// What its outputs are while the CPU does not drive them; nothing: 0.
    substitute: Vec<u8>,
    /// In STOP and in HOLD: the outputs are in their safe state.
    disabled: bool,
    /// Meanwhile: what the CPU has given them.
    driven: Vec<u8>,
}

impl IoModule {
    fn inside(len: u16, at: u16, count: usize) -> Result<(), ModuleError> {
        if usize::from(at) + count <= usize::from(len) { Ok(()) } else { Err(ModuleError::Outside) }
    }

    fn make_safe(&self, shared: &mut Shared) {
        let substitute = self.substitute.iter().copied().chain(std::iter::repeat(0));
        for (at, byte) in (self.outputs_at..).zip(substitute.take(usize::from(self.outputs))) {
            shared.image.write_outputs(at, &[byte]);
        }
    }
}

impl Module for IoModule {
    fn input_bytes(&self) -> u16 {
        self.inputs
    }

    fn output_bytes(&self) -> u16 {
        self.outputs
    }

    fn begin_scan(&mut self, now: Instant) {
        if let (true, Ok(mut shared)) = (self.leads, self.shared.try_lock()) {
            let Shared { image, field, stimulus, .. } = &mut *shared;
            stimulus.play(now, image, field);
        }
    }

    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        Self::inside(self.inputs, at, into.len())?;
        if let Ok(shared) = self.shared.try_lock() {
            shared.image.read_inputs(self.inputs_at + usize::from(at), into);
        }
        Ok(())
    }

    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        Self::inside(self.outputs, at, from.len())?;
        if self.disabled {
            self.driven[usize::from(at)..][..from.len()].copy_from_slice(from);
        } else if let Ok(mut shared) = self.shared.try_lock()
            && !shared.off
        {
            shared.image.write_outputs(self.outputs_at + usize::from(at), from);
        }
        Ok(())
    }

    fn end_scan(&mut self, _now: Instant) {
        if let (true, Ok(mut shared)) = (self.leads, self.shared.try_lock()) {
            shared.scans += 1;
            let scans = shared.scans;
            shared.image.scan_done(scans);
            if !shared.off {
                shared.image.refresh();
            }
        }
    }

    fn output_disable(&mut self, on: bool) {
        let was = std::mem::replace(&mut self.disabled, on);
        let Ok(mut shared) = self.shared.try_lock() else { return };
        if shared.off || was == on {
            return;
        }
        if !on {
            shared.image.write_outputs(self.outputs_at, &self.driven);
            return;
        }
        shared.field.read_outputs(self.outputs_at, &mut self.driven);
        self.make_safe(&mut shared);
    }

    fn cpu_state(&mut self, run: bool) {
        self.disabled = !run;
        self.driven.fill(0);
        if let (false, Ok(mut shared)) = (run, self.shared.try_lock())
            && !shared.off
        {
            self.make_safe(&mut shared);
        }
    }

    fn poll_event(&mut self) -> Option<ModuleEvent> {
        None
    }

    fn status(&self) -> ModuleStatus {
        ModuleStatus { present: true, generation: 1 }
    }

    fn record_read(&mut self, _record: u8, _into: &mut [u8]) -> Result<usize, ModuleError> {
        Err(ModuleError::NoRecord)
    }

    fn record_write(&mut self, _record: u8, _from: &[u8]) -> Result<(), ModuleError> {
        Err(ModuleError::NoRecord)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_station_file::Absent;

    fn config(name: &str, address: u32, kind: ModuleKind) -> ModuleConfig {
        let name = name.to_owned();
        ModuleConfig {
            name,
            input_address: address,
            output_address: address,
            absent: Absent::Zero,
            kind,
            substitute: Vec::new(),
            driver: None,
        }
    }

    #[test]
    fn modules_are_windows_onto_one_image() {
        let io = ProcessIo::new(IoImage::heap(), Stimulus::default());
        let mut input =
            io.module(&config("i", 4, ModuleKind::Inputs { bytes: 2, analog: false }), true).expect("process I/O");
        let mut output =
            io.module(&config("o", 8, ModuleKind::Outputs { bytes: 2, analog: false }), false).expect("process I/O");
        let field = io.field().expect("not poisoned");
        output.cpu_state(true);
        field.write_inputs(0, &[0, 1, 2, 3, 4, 5, 6]);
        let mut bytes = [0; 2];
        input.read(0, &mut bytes).expect("its own bytes");
        assert_eq!(bytes, [4, 5]);
        assert_eq!(input.read(1, &mut bytes), Err(ModuleError::Outside));
        output.write(1, &[9]).expect("its own byte");
        assert_eq!(output.write(0, &[1, 2, 3]), Err(ModuleError::Outside));
        input.end_scan(Instant::START);
        output.end_scan(Instant::START);
        let mut outputs = [0; 12];
        field.read_outputs(0, &mut outputs);
        assert_eq!((outputs[9], field.scan()), (9, 1));
    }

    #[test]
    fn a_substitute_is_what_stands_there_while_nobody_drives_the_outputs() {
        let io = ProcessIo::new(IoImage::heap(), Stimulus::default());
        let mut valve = config("valve", 4, ModuleKind::Outputs { bytes: 2, analog: false });
        valve.substitute = vec![0x80, 1];
        let mut lamp =
            io.module(&config("lamp", 0, ModuleKind::Outputs { bytes: 1, analog: false }), true).expect("process I/O");
        let mut valve = io.module(&valve, false).expect("process I/O");
        let field = io.field().expect("not poisoned");
        let outputs = || {
            let mut bytes = [0; 6];
            field.read_outputs(0, &mut bytes);
            bytes
        };
        assert_eq!(outputs(), [0, 0, 0, 0, 0x80, 1], "before the first start");
        for module in [&mut lamp, &mut valve] {
            module.cpu_state(true);
            let bytes = vec![7; usize::from(module.output_bytes())];
            module.write(0, &bytes).expect("its own bytes");
        }
        assert_eq!(outputs(), [7, 0, 0, 0, 7, 7]);
        for module in [&mut lamp, &mut valve] {
            let zeros = vec![0; usize::from(module.output_bytes())];
            module.write(0, &zeros).expect("its own bytes");
            module.cpu_state(false);
            module.write(0, &zeros).expect("its own bytes");
        }
        assert_eq!(outputs(), [0, 0, 0, 0, 0x80, 1], "in STOP");
        valve.output_disable(false);
        assert_eq!(outputs(), [0; 6], "enabled");
        valve.write(1, &[3]).expect("its own byte");
        assert_eq!(outputs(), [0, 0, 0, 0, 0, 3], "enabled in STOP");
        valve.output_disable(true);
        assert_eq!(outputs(), [0, 0, 0, 0, 0x80, 1], "disabled again");
        valve.cpu_state(true);
        valve.write(0, &[7, 7]).expect("its own bytes");
        ob1_backplane::Guardian::beside(&io.shared.lock().expect("not poisoned").image).take_over();
        assert_eq!(outputs(), [0, 0, 0, 0, 0x80, 1], "taken over");
        assert!(io.guard().is_taken());
    }

    #[test]
    fn switched_off_stays_off() {
        let io = ProcessIo::new(IoImage::heap(), Stimulus::default());
        let mut output =
            io.module(&config("o", 0, ModuleKind::Outputs { bytes: 1, analog: false }), true).expect("process I/O");
        output.cpu_state(true);
        output.write(0, &[7]).expect("its own byte");
        io.switch_off();
        output.write(0, &[7]).expect("accepted, without effect");
        let mut byte = [1];
        io.field().expect("not poisoned").read_outputs(0, &mut byte);
        assert_eq!(byte, [0]);
    }
}
