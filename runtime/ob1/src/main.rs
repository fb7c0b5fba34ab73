//! The `ob1` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ob1_command::cli::main()
}
