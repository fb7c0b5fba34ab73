//! Example: an FB in Rust and an OB 1 wholly in Rust
