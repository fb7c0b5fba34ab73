//! What the plugins of the Siemens CPs share: the memory that an ANY parameter names ([`any`], for CP 342-5 and CP
//! 343), and the blocks of a point-to-point connection ([`ptp`], for CP 340 and CP 341).
#![forbid(unsafe_code)]

pub mod any;
pub mod outputs;
pub mod ptp;
