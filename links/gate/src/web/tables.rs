//! Variable tables kept with the station: every browser sees the same, as the variable tables of a project.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use crate::shared::{Client, Trouble};
use hyper::StatusCode;
use hyper::body::Bytes;
use serde::Deserialize;
use serde_json::json;

use super::Page;
use super::api::{body, send, trouble, wrong};
use crate::http::{Reply, plain};

/// At most so many tables, with so many characters in a name, and lines and bytes in a table.
const TABLES: usize = 100;
const NAME: usize = 60;
const LINES: usize = 500;
const BYTES: usize = 32 << 10;
/// A file of more bytes is not one of ours.
const FILE: u64 = 16 << 20;

/// Their names, and the lines of each.
type All = BTreeMap<String, String>;

#[derive(Deserialize)]
struct Kept {
    name: String,
    /// Without lines the table goes.
    #[serde(default)]
    lines: String,
}

/// The file of the tables. Only this process writes it, one request after the other.
pub(super) struct Tables(pub(super) Option<PathBuf>);

impl Tables {
    pub(super) fn all(&self) -> io::Result<All> {
        let Some(path) = &self.0 else { return Ok(All::new()) };
        let bytes = match ob1_process::files::read(path, FILE) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(All::new()),
            bytes => bytes?,
        };
        serde_json::from_slice(&bytes).map_err(io::Error::other)
    }

    /// Keeps one table, or takes it away.
    fn keep(&self, kept: Kept) -> Result<All, String> {
        let Some(path) = &self.0 else { return Err("this station has no folder for tables; see its log".into()) };
        let name = kept.name.trim().to_owned();
        let fits = (1..=NAME).contains(&name.chars().count()) && !name.contains(char::is_control);
        if !fits {
            return Err(format!("a table has a name of 1 to {NAME} characters"));
        }
        if kept.lines.len() > BYTES || kept.lines.lines().count() > LINES {
            return Err(format!("a table has {LINES} lines and {BYTES} bytes at most"));
        }
        // A file that cannot be read is not written over: somebody may want what is in it.
        let mut all = self.all().map_err(|why| format!("{}: {why}", path.display()))?;
        if kept.lines.trim().is_empty() {
            all.remove(&name);
        } else {
            all.insert(name, kept.lines);
        }
        if all.len() > TABLES {
            return Err(format!("there are {TABLES} tables: delete one first"));
        }
        ob1_process::files::replace(path, json!(all).to_string().as_bytes())
            .map_err(|why| format!("{}: {why}", path.display()))?;
        Ok(all)
    }
}

impl Page {
    pub(super) fn tables(&self) -> Reply {
        match self.tables.all() {
            Ok(all) => send(&json!(all)),
            Err(why) => plain(StatusCode::CONFLICT, format!("the tables cannot be read: {why}")),
        }
    }

    /// Keeps a table for everybody: it changes nothing in the CPU, so whoever may look may keep one. It is logged.
    pub(super) fn keep_table(&self, client: &Client, bytes: &Bytes) -> Reply {
        let Some(kept) = body::<Kept>(None, bytes) else { return wrong() };
        let what = format!("table \"{}\"", kept.name.trim());
        let outcome = if kept.lines.trim().is_empty() { "deleted" } else { "kept" };
        // What cannot be logged is not done.
        if self.users.is_some()
            && let Err(error) = self.station.audit().ready()
        {
            return trouble(&Trouble::Audit(error.to_string()));
        }
        let all = match self.tables.keep(kept) {
            Ok(all) => all,
            Err(why) => return plain(StatusCode::UNPROCESSABLE_ENTITY, why),
        };
        let who = client.who();
        match self.station.audit().note(&who.user, &who.address, &what, outcome) {
            Ok(()) => send(&json!(all)),
            Err(error) => trouble(&Trouble::Audit(error.to_string())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(name: &str, lines: &str) -> Kept {
        Kept { name: name.into(), lines: lines.into() }
    }

    #[test]
    fn a_table_is_kept_within_bounds_and_survives() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("tables.json");
        let tables = Tables(Some(path.clone()));
        assert_eq!(tables.all().expect("none yet").len(), 0);
        tables.keep(kept(" pumps ", "MW10 // speed\nM1.0")).expect("kept");
        assert_eq!(Tables(Some(path.clone())).all().expect("there")["pumps"], "MW10 // speed\nM1.0");
        for (name, lines) in [("", "MW10"), ("a\nb", "MW10"), (&*"x".repeat(NAME + 1), "MW10")] {
            assert!(tables.keep(kept(name, lines)).is_err(), "{name:?}");
        }
        assert!(tables.keep(kept("long", &"M1.0\n".repeat(LINES + 1))).is_err());
        assert!(tables.keep(kept("wide", &"x".repeat(BYTES + 1))).is_err());
        for at in 1..TABLES {
            tables.keep(kept(&at.to_string(), "MW10")).expect("kept");
        }
        assert!(tables.keep(kept("one more", "MW10")).expect_err("full").contains("delete one first"));
        assert_eq!(tables.keep(kept("pumps", "")).expect("gone").len(), TABLES - 1);
        std::fs::write(&path, "not ours").expect("written");
        assert!(tables.keep(kept("a", "MW10")).is_err());
        assert_eq!(std::fs::read_to_string(&path).expect("there"), "not ours");
    }
}
