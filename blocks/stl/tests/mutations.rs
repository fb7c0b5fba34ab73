//! Lines of good sources are deleted and doubled at random, some hundred times here;
//! `cargo run --release -p ob1-stl --example mutate -- 1000000` is the long form.

mod common;

#[test]
fn deleted_and_doubled_lines() {
    assert!(common::mutate::run(500) > 100);
}
