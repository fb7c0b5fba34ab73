//! The memory map of the process I/O image in numbers, as `docs/backplane.md` documents it for other programs.

use crate::layout::{Field, Writer, field};

/// The first word of an image: the bytes `OB1IOIM` and a zero.
pub const IO_MAGIC: u64 = u64::from_ne_bytes(*b"OB1IOIM\0");

/// Version of the image's memory map; the last word written when the image is created.
pub const IO_LAYOUT_VERSION: u64 = 2;

/// Input bytes, and as many output bytes, as in the largest S7-400.
pub const IO_AREA_BYTES: usize = 16 * 1024;

/// Size of the image in bytes.
pub const IO_IMAGE_BYTES: usize = 0x9000;

pub(crate) const AT_MAGIC: usize = 0x000;
pub(crate) const AT_VERSION: usize = 0x008;
pub(crate) const AT_TOTAL_BYTES: usize = 0x010;
pub(crate) const AT_INPUT_OFFSET: usize = 0x018;
pub(crate) const AT_INPUT_BYTES: usize = 0x020;
pub(crate) const AT_OUTPUT_OFFSET: usize = 0x028;
pub(crate) const AT_OUTPUT_BYTES: usize = 0x030;
pub(crate) const AT_SCAN: usize = 0x080;
pub(crate) const AT_SEQUENCE: usize = 0x088;
pub(crate) const AT_OWNER: usize = 0x090;
pub(crate) const AT_ALIVE: usize = 0x098;
pub(crate) const AT_INPUTS: usize = 0x100;
pub(crate) const AT_OUTPUTS: usize = AT_INPUTS + IO_AREA_BYTES;

/// The memory map of the image, in rising order. Bytes between two fields are reserved and zero.
pub const IO_FIELDS: &[Field] = &[
    field(AT_MAGIC, 8, "image.magic", Writer::Maker),
    field(AT_VERSION, 8, "image.version", Writer::Maker),
    field(AT_TOTAL_BYTES, 8, "image.total_bytes", Writer::Maker),
    field(AT_INPUT_OFFSET, 8, "image.input_offset", Writer::Maker),
    field(AT_INPUT_BYTES, 8, "image.input_bytes", Writer::Maker),
    field(AT_OUTPUT_OFFSET, 8, "image.output_offset", Writer::Maker),
    field(AT_OUTPUT_BYTES, 8, "image.output_bytes", Writer::Maker),
    field(AT_SCAN, 8, "image.scan", Writer::Cpu),
    field(AT_SEQUENCE, 8, "image.output_sequence", Writer::Cpu),
    field(AT_OWNER, 8, "image.owner", Writer::Cpu),
    field(AT_ALIVE, 8, "image.alive", Writer::Cpu),
    field(AT_INPUTS, IO_AREA_BYTES, "image.inputs", Writer::Anyone),
    field(AT_OUTPUTS, IO_AREA_BYTES, "image.outputs", Writer::Cpu),
];
