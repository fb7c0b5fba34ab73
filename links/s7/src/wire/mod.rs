//! The telegrams of S7 communication, as a codec that server and client share.

mod address;
mod block;
mod clock;
mod data;
mod items;
mod password;
pub mod pbc;
mod pdu;
mod userdata;

pub use address::{Address, Area, BadItem, DataType};
pub use block::{BlockInfo, BlockName, BlockType, FileSystem, INFO_BYTES, values_mut};
pub use clock::{CLOCK_BYTES, DateTime};
pub(crate) use data::OCTET;
pub use data::{DataItem, DataItems, bytes_of, transport_of, write_areas, write_item, write_refused};
pub use items::{Item, Items};
pub use password::{PASSWORD_BYTES, decode as decode_password, encode as encode_password};
pub use pdu::{ANSWER_HEAD, JOB_HEAD, Kind, MAX_TELEGRAM, Pdu, function, write};
pub use userdata::{Group, Telegram, USERDATA_HEAD, UserData, sub};
