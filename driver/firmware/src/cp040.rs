//! The SLIO CP 040: the module around the host protocol.

mod exchange;
#[cfg(test)]
mod model;
mod receive;
mod send;
mod wire;
