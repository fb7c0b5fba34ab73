//! The long form of the test `mutations`: so many random deletions and duplications of lines.
//!
//!     cargo run --release -p ob1-stl --example mutate -- 1000000

#![allow(clippy::disallowed_methods, reason = "it reads its command line")]

#[path = "../tests/common/mod.rs"]
mod common;

fn main() {
    let rounds = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(1_000_000);
    let messages = common::mutate::run(rounds);
    println!("{rounds} mutations, {messages} messages: no panic, no hang, never more than the limit");
}
