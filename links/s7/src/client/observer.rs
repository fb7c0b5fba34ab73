//! A programming device that looks and changes nothing.

use super::jobs::{Device, Done, Wire};
use crate::codes::ItemCode;
use crate::wire::{Address, BlockType, DateTime};

/// A [`Device`] without those of its jobs that write, load, link, or change the operating state: whoever has only this
/// cannot form such a telegram.
#[derive(Debug)]
pub struct Observer<W>(Device<W>);

impl<W: Wire> Observer<W> {
    /// Of a connected device.
    #[must_use]
    pub const fn new(device: Device<W>) -> Self {
        Self(device)
    }

    /// The agreed PDU.
    #[must_use]
    pub fn pdu(&self) -> usize {
        self.0.pdu()
    }

    /// As [`Device::read`].
    ///
    /// # Errors
    /// As [`Device::read`].
    pub fn read(&mut self, addresses: &[Address]) -> Done<Vec<Result<Vec<u8>, ItemCode>>, W> {
        self.0.read(addresses)
    }

    /// As [`Device::szl`].
    ///
    /// # Errors
    /// As [`Device::szl`].
    pub fn szl(&mut self, id: u16, index: u16) -> Done<(u16, Vec<u8>), W> {
        self.0.szl(id, index)
    }

    /// As [`Device::clock`].
    ///
    /// # Errors
    /// As [`Device::clock`].
    pub fn clock(&mut self) -> Done<DateTime, W> {
        self.0.clock()
    }

    /// As [`Device::blocks`].
    ///
    /// # Errors
    /// As [`Device::blocks`].
    pub fn blocks(&mut self, ty: BlockType) -> Done<Vec<u16>, W> {
        self.0.blocks(ty)
    }

    /// As [`Device::upload`].
    ///
    /// # Errors
    /// As [`Device::upload`].
    pub fn upload(&mut self, ty: BlockType, number: u16) -> Done<Vec<u8>, W> {
        self.0.upload(ty, number)
    }
}
