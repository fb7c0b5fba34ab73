//! Addresses, S7 data types, big-endian cells, block interfaces and faults
