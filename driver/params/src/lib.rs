//! Parameter records: named keys and the 16 parameter bytes, one table for both.
//!
//! The station file writes parameters as named keys or as the raw bytes of a hardware configuration; the firmware takes
//! the bytes. Both go through [`table`], which contains the manual's tables: byte, codes, range and default of each
//! parameter. [`Cp240`] is the typed form.
//!
//! ```
//! use ob1_params::{Cp240, Value};
//!
//! let cp = Cp240::from_keys([("protocol", Value::from("3964r")), ("baud", Value::Int(115_200))])?;
//! assert_eq!(cp.encode(), [0x0E, 0x04, 0x13, 0, 0, 10, 25, 100, 5, 6, 0, 0, 0, 0, 0, 0]);
//! assert_eq!(Cp240::decode(&cp.encode())?, cp);
//! # Ok::<(), ob1_params::ParamError>(())
//! ```
#![forbid(unsafe_code)]

mod convert;
pub mod cp040;
mod cp240;
pub mod cp240_table;
mod cp340;
mod cp341;
mod cp341_ascii;
mod cp341_modbus;
mod error;
mod keyed;
mod keys_3964;
mod module_types;
mod parameter_bytes;
pub mod printer;
pub mod zero;

pub use cp040::{Cp040, Duplex, Preset};
pub use cp240::{Ascii, Cp240, Interface, Modbus, ModbusKind, Priority, Protocol, S3964, StxEtx};
pub use cp340::PROTOCOLS_340;
pub use cp341::{Cp341, PROTOCOLS_341, Protocol341, S3964Of341, protocols_of};
pub use cp341_ascii::{AsciiOf341, EndOf341, SendingOf341};
pub use cp341_modbus::ModbusMaster32;
pub use error::ParamError;
pub use keyed::{Key341, Kind341, Protocols, Tables};
pub use module_types::{CpKind, CpRow};
pub use ob1_serial::{Flow, LineSettings, Parity, StopBits};
pub use parameter_bytes::Value;
