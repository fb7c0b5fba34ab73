//! The driver process that is the CP

fn main() {}
