//! The handling blocks in a CPU, with their plugins and simulated CPs.

mod cp040_blocks;
mod cp343_blocks;
mod handling_blocks;
mod handling_blocks_cp341;
mod handling_blocks_instances;
mod plugins;
mod support;
