//! What crosses two crates: the whole-station simulation and the end-to-end tests
