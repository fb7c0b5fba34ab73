//! Inputs written through the socket. An input that a module feeds is read again at the start of each scan, so a write
//! has to reach the module: it goes into the image, as if somebody had moved the switch.

use std::fmt;
use std::ops::Range;

use ob1_backplane::IoField;
use ob1_cpu::{Cell, Width};
use ob1_model::Area;

use ob1_station_file::{ModuleConfig, ModuleKind};

/// The inputs of a station's process I/O modules.
#[derive(Clone)]
pub struct Panel {
    field: IoField,
    /// Input bytes of each module.
    modules: Vec<Range<u32>>,
}

impl fmt::Debug for Panel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Panel").field("modules", &self.modules).finish_non_exhaustive()
    }
}

impl Panel {
    /// The inputs among `modules`, which live in this image.
    #[must_use]
    pub fn new(field: IoField, modules: &[ModuleConfig]) -> Self {
        Self { field, modules: inputs(modules) }
    }

    /// Writes an input if all of it belongs to modules. False: it does not, and the CPU's memory has to take the value.
    #[must_use]
    pub fn write(&self, cell: Cell, width: Width, bits: u32) -> bool {
        let Cell::Area(Area::Input, at) = cell else { return false };
        let (first, count) = (at / 8, u32::from(width.bits()).div_ceil(8));
        if !(first..first.saturating_add(count)).all(|byte| self.modules.iter().any(|module| module.contains(&byte))) {
            return false;
        }
        let offset = first as usize;
        if width == Width::Bit {
            let mut byte = [0];
            self.field.read_inputs(offset, &mut byte);
            let mask = 1 << (at % 8);
            let [byte] = byte;
            self.field.write_inputs(offset, &[if bits & 1 == 1 { byte | mask } else { byte & !mask }]);
        } else {
            let bytes = bits.to_be_bytes();
            self.field.write_inputs(offset, bytes.get(bytes.len() - count as usize..).unwrap_or_default());
        }
        true
    }
}

/// The input bytes of each module of process I/O.
pub(super) fn inputs(modules: &[ModuleConfig]) -> Vec<Range<u32>> {
    let bytes = |module: &ModuleConfig| match module.kind {
        ModuleKind::Inputs { bytes, .. } => {
            Some(module.input_address..module.input_address.saturating_add(u32::from(bytes)))
        }
        _ => None,
    };
    modules.iter().filter_map(bytes).collect()
}

#[cfg(test)]
mod tests {
    use ob1_backplane::IoImage;

    use super::*;
    use crate::io::{ProcessIo, Stimulus};
    use ob1_station_file::Absent;

    #[test]
    fn an_input_of_a_module_is_written_into_the_image() {
        let module = |name: &str, address, kind| ModuleConfig {
            name: name.to_owned(),
            input_address: address,
            output_address: address,
            absent: Absent::Zero,
            substitute: Vec::new(),
            driver: None,
            kind,
        };
        let modules = [
            module("a", 4, ModuleKind::Inputs { bytes: 2, analog: false }),
            module("b", 6, ModuleKind::Inputs { bytes: 1, analog: false }),
            module("c", 8, ModuleKind::Outputs { bytes: 2, analog: false }),
        ];
        let image = IoImage::heap();
        let field = image.field();
        let io = ProcessIo::new(image, Stimulus::default());
        let panel = Panel::new(io.field().expect("not poisoned"), &modules);
        let input = |byte: u32, bit: u32| Cell::Area(Area::Input, byte * 8 + bit);
        let inputs = || {
            let mut bytes = [0; 5];
            field.read_inputs(3, &mut bytes);
            bytes
        };
        assert!(panel.write(input(4, 0), Width::Byte, 0x81));
        assert!(panel.write(input(4, 1), Width::Bit, 1));
        assert!(panel.write(input(4, 7), Width::Bit, 0));
        // Over the border of two modules.
        assert!(panel.write(input(5, 0), Width::Word, 0x1234));
        assert_eq!(inputs(), [0, 3, 0x12, 0x34, 0]);
        // Half outside, wholly outside, no input.
        assert!(!panel.write(input(6, 0), Width::Word, 0x5678));
        assert!(!panel.write(input(4, 0), Width::DWord, 0x5678));
        assert!(!panel.write(input(3, 0), Width::Bit, 1));
        assert!(!panel.write(Cell::Area(Area::Output, 32), Width::Byte, 1));
        assert!(!panel.write(Cell::Peripheral(4), Width::Byte, 1));
        assert_eq!(inputs(), [0, 3, 0x12, 0x34, 0]);
    }
}
