//! Write a block in Rust: one safe trait, one export macro
