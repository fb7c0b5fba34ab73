//! The ob1 command.
fn main() {}
