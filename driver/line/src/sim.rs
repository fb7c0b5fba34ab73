//! The simulated line: two partners, virtual time, faults.
