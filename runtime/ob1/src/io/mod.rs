//! Process I/O: the modules `di do ai ao`, backed by an image that any program can map, and by a timed stimulus.
//!
//! All such modules of a station share one image. They lie side by side in it: a module's first byte has the module's
//! logical address as its offset. Inputs written by a stimulus and by other programs mix; the last one wins.
//! (docs/process-io.md)

mod panel;
mod stimulus;

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use ob1_backplane::{IoField, IoImage};
use ob1_cpu::{Module, ModuleError, ModuleEvent, ModuleStatus, Nanos};

use crate::station::{ModuleConfig, ModuleKind};

pub use panel::Panel;
pub use stimulus::Stimulus;

/// The process I/O of one station.
#[derive(Clone)]
pub struct ProcessIo {
    shared: Arc<Mutex<Shared>>,
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
        Self { shared: Arc::new(Mutex::new(Shared { image, field, stimulus, scans: 0, off: false })) }
    }

    /// Where other programs map the image; `None` on the heap.
    #[must_use]
    pub fn path(&self) -> Option<PathBuf> {
        self.shared.lock().ok()?.image.path()
    }

    /// The other end of the image.
    #[must_use]
    pub fn field(&self) -> Option<IoField> {
        Some(self.shared.lock().ok()?.field.clone())
    }

    /// The module a station file describes; `None` for one that is no process I/O. The first one made leads: it plays
    /// the stimulus at the start of a scan and counts the scan at its end.
    #[must_use]
    pub fn module(&self, config: &ModuleConfig, leads: bool) -> Option<Box<dyn Module>> {
        let (at, inputs, outputs) = match config.kind {
            ModuleKind::Inputs { bytes } => (config.input_address, bytes, 0),
            ModuleKind::Outputs { bytes } => (config.output_address, 0, bytes),
            ModuleKind::Cp240 { .. } | ModuleKind::Cp040 { .. } | ModuleKind::Cp341 { .. } => return None,
        };
        Some(Box::new(IoModule { shared: Arc::clone(&self.shared), at: at as usize, inputs, outputs, leads }))
    }

    /// Switches all outputs off for good. For the monitor, when the scan has hung: it does not wait for the scan.
    pub fn switch_off(&self) {
        if let Ok(mut shared) = self.shared.try_lock() {
            shared.off = true;
            shared.image.write_outputs(0, &[0; ob1_backplane::io_layout::IO_AREA_BYTES]);
        }
    }
}

/// One module: a window onto the image.
struct IoModule {
    shared: Arc<Mutex<Shared>>,
    at: usize,
    inputs: u16,
    outputs: u16,
    leads: bool,
}

impl IoModule {
    fn inside(len: u16, at: u16, count: usize) -> Result<(), ModuleError> {
        if usize::from(at) + count <= usize::from(len) { Ok(()) } else { Err(ModuleError::Outside) }
    }
}

impl Module for IoModule {
    fn input_bytes(&self) -> u16 {
        self.inputs
    }

    fn output_bytes(&self) -> u16 {
        self.outputs
    }

    fn begin_scan(&mut self, now: Nanos) {
        if let (true, Ok(mut shared)) = (self.leads, self.shared.try_lock()) {
            let Shared { image, field, stimulus, .. } = &mut *shared;
            stimulus.play(now, image, field);
        }
    }

    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        Self::inside(self.inputs, at, into.len())?;
        if let Ok(shared) = self.shared.try_lock() {
            shared.image.read_inputs(self.at + usize::from(at), into);
        }
        Ok(())
    }

    fn write(&mut self, at: u16, from: &[u8]) -> Result<(), ModuleError> {
        Self::inside(self.outputs, at, from.len())?;
        if let Ok(mut shared) = self.shared.try_lock()
            && !shared.off
        {
            shared.image.write_outputs(self.at + usize::from(at), from);
        }
        Ok(())
    }

    fn end_scan(&mut self, _now: Nanos) {
        if let (true, Ok(mut shared)) = (self.leads, self.shared.try_lock()) {
            shared.scans += 1;
            let scans = shared.scans;
            shared.image.scan_done(scans);
        }
    }

    fn cpu_state(&mut self, _run: bool) {}

    fn poll_event(&mut self) -> Option<ModuleEvent> {
        None
    }

    fn status(&self) -> ModuleStatus {
        ModuleStatus { present: true, generation: 1, leds: 0 }
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
    use crate::station::Absent;

    fn config(name: &str, address: u32, kind: ModuleKind) -> ModuleConfig {
        let name = name.to_owned();
        ModuleConfig { name, input_address: address, output_address: address, absent: Absent::Zero, kind }
    }

    #[test]
    fn modules_are_windows_onto_one_image() {
        let io = ProcessIo::new(IoImage::heap(), Stimulus::default());
        let mut input = io.module(&config("i", 4, ModuleKind::Inputs { bytes: 2 }), true).expect("process I/O");
        let mut output = io.module(&config("o", 8, ModuleKind::Outputs { bytes: 2 }), false).expect("process I/O");
        let field = io.field().expect("not poisoned");
        field.write_inputs(0, &[0, 1, 2, 3, 4, 5, 6]);
        let mut bytes = [0; 2];
        input.read(0, &mut bytes).expect("its own bytes");
        assert_eq!(bytes, [4, 5]);
        assert_eq!(input.read(1, &mut bytes), Err(ModuleError::Outside));
        output.write(1, &[9]).expect("its own byte");
        assert_eq!(output.write(0, &[1, 2, 3]), Err(ModuleError::Outside));
        input.end_scan(0);
        output.end_scan(0);
        let mut outputs = [0; 12];
        field.read_outputs(0, &mut outputs);
        assert_eq!((outputs[9], field.scan()), (9, 1));
    }

    #[test]
    fn switched_off_stays_off() {
        let io = ProcessIo::new(IoImage::heap(), Stimulus::default());
        let mut output = io.module(&config("o", 0, ModuleKind::Outputs { bytes: 1 }), true).expect("process I/O");
        output.write(0, &[7]).expect("its own byte");
        io.switch_off();
        output.write(0, &[7]).expect("accepted, without effect");
        let mut byte = [1];
        io.field().expect("not poisoned").read_outputs(0, &mut byte);
        assert_eq!(byte, [0]);
    }
}
