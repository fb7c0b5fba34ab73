//! A table whose `type` decides which keys it has. They are asked for one by one; what nobody asked for is told.

use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};
use std::time::Duration;

use ob1_time::Span;
use serde::de::DeserializeOwned;

use super::findings::{Findings, MISSING, VALUE};
use super::tables::{Placed, Table};
use super::values::{choice, number, time};

/// Reads such a table.
pub(super) struct Keys<'k, 'f> {
    pub(super) f: &'k mut Findings<'f>,
    table: &'k Placed<Table>,
    /// What relative paths start from.
    folder: &'k Path,
    asked: Vec<&'static str>,
    /// The files that nobody else may read.
    pub(super) secrets: Vec<PathBuf>,
}

impl<'k, 'f> Keys<'k, 'f> {
    pub(super) fn new(f: &'k mut Findings<'f>, table: &'k Placed<Table>, folder: &'k Path) -> Self {
        Self { f, table, folder, asked: Vec::new(), secrets: Vec::new() }
    }

    /// The keys that the table may have: all that were asked for.
    pub(super) fn known(&self) -> &[&'static str] {
        &self.asked
    }

    /// The keys that nobody asked for, with their places.
    pub(super) fn left(&self) -> Vec<(&'k str, Range<usize>)> {
        let left = self.table.get_ref().keys().filter(|key| !self.asked.contains(&key.get_ref().as_str()));
        left.map(|key| (key.get_ref().as_str(), key.span())).collect()
    }

    /// The place of the value of a key, if it is there.
    pub(super) fn at(&self, key: &str) -> Option<Range<usize>> {
        self.table.get_ref().get(key).map(Placed::span)
    }

    /// The value of a key, with its place.
    pub(super) fn value<T: DeserializeOwned>(&mut self, key: &'static str) -> Option<Placed<T>> {
        self.asked.push(key);
        let value = self.table.get_ref().get(key)?;
        match T::deserialize(value.get_ref().clone()) {
            Ok(typed) => Some(Placed::new(value.span(), typed)),
            Err(error) => {
                self.f.mistyped(value.span(), error.message());
                None
            }
        }
    }

    /// The same of a key that must be there.
    pub(super) fn needed<T: DeserializeOwned>(&mut self, key: &'static str, remedy: &str) -> Option<Placed<T>> {
        if self.at(key).is_none() {
            let start = self.table.span().start;
            let at = self.at("type").unwrap_or(start..start);
            self.f.error(MISSING, at, format!("the key `{key}` is missing"), remedy);
        }
        self.value(key)
    }

    /// The value of a key.
    pub(super) fn plain<T: DeserializeOwned>(&mut self, key: &'static str) -> Option<T> {
        self.value(key).map(Placed::into_inner)
    }

    pub(super) fn number<T>(&mut self, key: &'static str, range: RangeInclusive<i64>) -> Option<T>
    where
        T: TryFrom<i64> + Copy + Default,
    {
        self.value(key).map(|value| number(self.f, key, Some(&value), range, T::default()))
    }

    /// One of a few words.
    pub(super) fn choice<T: Copy>(&mut self, key: &'static str, words: &[(&str, T)]) -> Option<T> {
        self.value(key).and_then(|word| choice(self.f, key, Some(&word), words))
    }

    /// A time, in a range of milliseconds.
    pub(super) fn time(&mut self, key: &'static str, range: RangeInclusive<u64>) -> Option<Duration> {
        let text = self.value::<String>(key)?;
        let time = time(self.f, Some(&text), Span::ZERO);
        // A malformed time has been reported already.
        if !time.is_zero() && !range.contains(&time.millis()) {
            let message = format!("`{key}` is {}; it can be {}ms to {}ms", text.get_ref(), range.start(), range.end());
            self.f.error(VALUE, text.span(), message, "a time within that range: \"500ms\"");
        }
        Some(time.into())
    }

    /// A file or a folder, with its whole path.
    pub(super) fn path(&mut self, key: &'static str) -> Option<PathBuf> {
        self.plain::<String>(key).map(|path| absolute(self.folder, &path))
    }

    /// A file that nobody else may read.
    pub(super) fn secret(&mut self, key: &'static str) -> Option<PathBuf> {
        let path = self.path(key);
        self.secrets.extend(path.clone());
        path
    }
}

/// The whole path of a file, from a folder on.
pub(super) fn absolute(folder: &Path, path: &str) -> PathBuf {
    let whole = folder.join(path);
    std::path::absolute(&whole).unwrap_or(whole)
}
