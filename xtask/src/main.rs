//! demo, test, bench, sim, ci: the same on a desk and in CI

fn main() {}
