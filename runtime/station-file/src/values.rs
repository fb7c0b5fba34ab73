//! Values of keys: names, numbers, words, times, files.

use std::path::{Path, PathBuf};

use ob1_time::Span;

use super::duration::parse_duration;
use super::findings::{Findings, VALUE};
use super::tables::Placed;
use crate::finding::{Spot, nearest};

/// What a name is.
pub const NAME_RULE: &str = "1 to 40 letters, digits, - and _, without - in front: it also names files";

/// Whether a text is a name that can be in a path and in a list.
#[must_use]
pub fn is_name(text: &str) -> bool {
    let legal = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    // With - in front it would be an option of every command.
    !text.is_empty() && text.len() <= 40 && !text.starts_with('-') && text.chars().all(legal)
}

/// A name in the file.
pub(super) fn name(f: &mut Findings<'_>, of: &str, name: &Placed<String>) -> String {
    let text = name.get_ref();
    if !is_name(text) {
        f.error(VALUE, name.span(), format!("\"{text}\" is not a name for a {of}"), NAME_RULE);
    }
    text.clone()
}

/// A whole number within its range; the default when it is missing or wrong.
pub(super) fn number<T: TryFrom<i64> + Copy>(
    f: &mut Findings<'_>,
    key: &str,
    value: Option<&Placed<i64>>,
    range: std::ops::RangeInclusive<i64>,
    default: T,
) -> T {
    let Some(value) = value else { return default };
    match T::try_from(*value.get_ref()) {
        Ok(number) if range.contains(value.get_ref()) => number,
        _ => {
            let message = format!("{key} = {} is out of range", value.get_ref());
            f.error(VALUE, value.span(), message, format!("{} to {}", range.start(), range.end()));
            default
        }
    }
}

/// One of a few words.
pub fn choice<T: Copy>(
    f: &mut Findings<'_>,
    key: &str,
    value: Option<&Placed<String>>,
    words: &[(&str, T)],
) -> Option<T> {
    let value = value?;
    let text = value.get_ref().as_str();
    if let Some((_, meaning)) = words.iter().find(|(word, _)| *word == text) {
        return Some(*meaning);
    }
    let known = words.iter().map(|(word, _)| *word);
    let remedy = match nearest(text, known.clone()) {
        Some(near) => format!("did you mean \"{near}\"?"),
        None => format!("one of {}", known.map(|w| format!("\"{w}\"")).collect::<Vec<_>>().join(", ")),
    };
    f.error(VALUE, value.span(), format!("{key} cannot be \"{text}\""), remedy);
    None
}

pub(super) fn time(f: &mut Findings<'_>, value: Option<&Placed<String>>, default: Span) -> Span {
    let Some(value) = value else { return default };
    match parse_duration(value.get_ref()) {
        Ok(time) => time,
        Err(message) => {
            f.error(VALUE, value.span(), message, "a number and a unit, in quotes: \"250us\", \"1ms\", \"1.5s\"");
            default
        }
    }
}

/// Each file of lists, and the place that names it.
pub fn places(f: &Findings<'_>, lists: &[&Vec<Placed<String>>], folder: &Path) -> Vec<(PathBuf, Spot)> {
    let all = lists.iter().flat_map(|list| list.iter());
    all.map(|named| place(f, named, folder)).collect()
}

/// A file that is named, and the place that names it.
pub(super) fn place(f: &Findings<'_>, named: &Placed<String>, folder: &Path) -> (PathBuf, Spot) {
    (folder.join(named.get_ref()), f.spot(named.span()))
}
