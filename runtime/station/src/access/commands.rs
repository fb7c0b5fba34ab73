//! A command of an operator, by its word.

use ob1_model::Command;
use serde::de::Error as _;
use serde::{Deserialize as _, Deserializer, Serializer};

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
pub(super) fn serialize<S: Serializer>(command: &Command, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(command.name())
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Command, D::Error> {
    let word = String::deserialize(from)?;
    let known = || Command::ALL.map(Command::name).join(", ");
    Command::of_word(&word)
        .ok_or_else(|| D::Error::custom(format_args!("unknown command `{word}`, expected one of {}", known())))
}
