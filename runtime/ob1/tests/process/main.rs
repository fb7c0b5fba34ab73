//! `ob1` as a real process.

mod bench;
mod command;
mod new;
mod output;
mod person;
mod retentive_files;
