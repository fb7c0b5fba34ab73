//! The modules and the peripheral area: which module answers at which byte.

use ob1_std::services::Placed;
use ob1_time::Instant;

use crate::{BusPlace, LoadError, Memory, Module, ModuleError, ModuleSlot, ModuleStatus};

/// Bytes of the peripheral area.
const PERIPHERAL_BYTES: u32 = 65_536;

/// The slot of the first module: after power supply, CPU and interface module, as on an S7-300.
pub(crate) const SLOT: u16 = 4;

/// A module in its place.
pub(crate) struct Plugged {
    pub(crate) slot: ModuleSlot,
    pub(crate) input_bytes: u32,
    pub(crate) output_bytes: u32,
    pub(crate) module: Box<dyn Module>,
    /// Its driver is lost.
    pub(crate) lost: bool,
    /// The transfer of its inputs and outputs failed, and the diagnostic buffer says so.
    pub(crate) image_error: [bool; 2],
}

/// Why a peripheral access failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum IoError {
    /// No module has all of these bytes.
    NoModule,
    /// The module answers with this error.
    Module(ModuleError),
}

/// All modules of a CPU, in the order given at load.
pub(crate) struct Modules {
    pub(crate) list: Vec<Plugged>,
}

impl Modules {
    /// Puts the modules into their places; overlaps and addresses outside the peripheral area are refused.
    pub(crate) fn new(modules: Vec<(ModuleSlot, Box<dyn Module>)>, errors: &mut Vec<LoadError>) -> Self {
        let list: Vec<_> = modules
            .into_iter()
            .map(|(slot, module)| Plugged {
                slot,
                input_bytes: u32::from(module.input_bytes()),
                output_bytes: u32::from(module.output_bytes()),
                module,
                lost: false,
                image_error: [false; 2],
            })
            .collect();
        // Whose each byte is; the lowest of two owners stays.
        let mut owners = [(); 2].map(|()| vec![None; PERIPHERAL_BYTES as usize]);
        for (i, a) in list.iter().enumerate() {
            for (address, len) in [(a.slot.input_address, a.input_bytes), (a.slot.output_address, a.output_bytes)] {
                if u64::from(address) + u64::from(len) > u64::from(PERIPHERAL_BYTES) {
                    errors.push(LoadError::ModuleAddress { name: a.slot.name.clone(), address });
                }
            }
            for (outputs, owners) in [false, true].into_iter().zip(&mut owners) {
                let (address, len) = a.range(outputs);
                let mut told = None;
                for (address, owner) in (address..).zip(owners.iter_mut().skip(address as usize).take(len as usize)) {
                    let first: usize = *owner.get_or_insert(i);
                    if first != i && told.replace(first) != Some(first) {
                        let (first, second) = (list[first].slot.name.clone(), a.slot.name.clone());
                        errors.push(LoadError::ModuleOverlap { first, second, address, outputs });
                    }
                }
            }
        }
        Self { list }
    }

    /// Reads peripheral bytes that one module has.
    pub(crate) fn read(&mut self, address: u32, into: &mut [u8]) -> Result<(), IoError> {
        for plugged in &mut self.list {
            if let Some(at) = plugged.offset(address, into.len(), false) {
                return plugged.module.read(at, into).map_err(IoError::Module);
            }
        }
        Err(IoError::NoModule)
    }

    /// Writes peripheral bytes that one module has.
    pub(crate) fn write(&mut self, address: u32, from: &[u8]) -> Result<(), IoError> {
        for plugged in &mut self.list {
            if let Some(at) = plugged.offset(address, from.len(), true) {
                return plugged.module.write(at, from).map_err(IoError::Module);
            }
        }
        Err(IoError::NoModule)
    }

    /// Whether a module has these peripheral outputs.
    pub(crate) fn has_outputs(&self, address: u32, bytes: usize) -> bool {
        self.has(address, bytes, true)
    }

    /// Whether a module has these peripheral bytes.
    pub(crate) fn has(&self, address: u32, bytes: usize, outputs: bool) -> bool {
        self.list.iter().any(|plugged| plugged.offset(address, bytes, outputs).is_some())
    }

    /// The module whose registers begin at exactly this logical address.
    pub(crate) fn at(&mut self, address: u32) -> Option<&mut Plugged> {
        self.list.iter_mut().find(|p| p.slot.input_address == address || p.slot.output_address == address)
    }

    pub(crate) fn status(&self, index: usize) -> Option<ModuleStatus> {
        Some(self.list.get(index)?.module.status())
    }

    pub(crate) fn begin_scan(&mut self, now: Instant) {
        for plugged in &mut self.list {
            plugged.module.begin_scan(now);
        }
    }

    pub(crate) fn end_scan(&mut self, now: Instant) {
        for plugged in &mut self.list {
            plugged.module.end_scan(now);
        }
    }

    pub(crate) fn cpu_state(&mut self, run: bool) {
        for plugged in &mut self.list {
            plugged.module.cpu_state(run);
        }
    }

    /// Output modules show their safe state, and again what they were given.
    pub(crate) fn output_disable(&mut self, on: bool) {
        for plugged in &mut self.list {
            plugged.module.output_disable(on);
        }
    }

    /// One module's part of the process image of the inputs. A module that does not answer decides what the image gets.
    pub(crate) fn read_image(&mut self, index: usize, memory: &mut Memory) -> Result<(), ModuleError> {
        let image = memory.inputs;
        let plugged = &mut self.list[index];
        let (first, len) = plugged.range(false);
        let inside = image.len.saturating_sub(first).min(len);
        if inside == 0 {
            return Ok(());
        }
        let at = image.at.plus(first).index();
        let bytes = &mut memory.bytes[at..at + inside as usize];
        plugged.module.read_image(bytes)
    }

    /// One module's part of the process image of the outputs. A module that does not answer gets the image again in the
    /// next scan.
    pub(crate) fn write_image(&mut self, index: usize, memory: &Memory) -> Result<(), ModuleError> {
        let image = memory.outputs;
        let plugged = &mut self.list[index];
        let (first, len) = plugged.range(true);
        let inside = image.len.saturating_sub(first).min(len);
        if inside == 0 {
            return Ok(());
        }
        let at = image.at.plus(first).index();
        plugged.module.write(0, &memory.bytes[at..at + inside as usize])
    }

    /// STOP: every output register of every module becomes 0.
    pub(crate) fn outputs_off(&mut self) {
        const ZEROS: [u8; 64] = [0; 64];
        for plugged in &mut self.list {
            let mut at = 0;
            while at < plugged.output_bytes {
                let len = (plugged.output_bytes - at).min(ZEROS.len() as u32);
                // A module that does not answer has no outputs left to drive.
                let _ = plugged.module.write(at as u16, &ZEROS[..len as usize]);
                at += len;
            }
        }
    }
}

impl Modules {
    /// The module at this place of [`Modules::list`], as the blocks that ask for addresses see it.
    pub(crate) fn placed(&self, index: usize) -> Option<Placed> {
        let plugged = self.list.get(index)?;
        // Modules lie inside the peripheral area of 64 KiB ([`Modules::new`]); one without bytes has no address.
        let range = |outputs| {
            let (first, bytes) = plugged.range(outputs);
            (first as u16, bytes as u16)
        };
        let (inputs, outputs) = (range(false), range(true));
        Some(match plugged.slot.bus {
            None => Placed { master: 0, rack: 0, slot: index as u16 + SLOT, inputs, outputs },
            Some(BusPlace { master, station, slot }) => {
                Placed { master, rack: u16::from(station), slot: u16::from(slot), inputs, outputs }
            }
        })
    }
}

impl Plugged {
    /// The address is one of the module's input or output bytes, or where it begins.
    pub(crate) fn has(&self, address: u32, output: bool) -> bool {
        let (first, len) = self.range(output);
        address == first || address > first && address - first < len
    }

    /// Where these peripheral bytes lie in the module, if it has all of them.
    #[inline]
    fn offset(&self, address: u32, bytes: usize, outputs: bool) -> Option<u16> {
        let (first, len) = self.range(outputs);
        let end = u64::from(address) + bytes as u64;
        (address >= first && end <= u64::from(first) + u64::from(len)).then(|| (address - first) as u16)
    }

    pub(crate) fn range(&self, outputs: bool) -> (u32, u32) {
        if outputs {
            (self.slot.output_address, self.output_bytes)
        } else {
            (self.slot.input_address, self.input_bytes)
        }
    }
}
