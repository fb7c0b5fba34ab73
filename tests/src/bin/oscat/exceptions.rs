//! The list of what differs from Siemens' compiler, each with its reason: `exceptions.txt`.

/// One row: a block or source, the releases it is about, and why.
struct Row {
    name: &'static str,
    /// A source that does not compile, not a block that differs.
    source: bool,
    releases: Vec<&'static str>,
    reason: &'static str,
    /// Releases in which it was looked for, and seen.
    looked: bool,
    seen: bool,
}

pub struct Exceptions(Vec<Row>);

impl Exceptions {
    /// The list of the repository: `NAME RELEASES: reason`, a source as `NAME.scl`; `# ` begins a comment.
    pub fn read() -> Self {
        let mut rows = Vec::new();
        let lines = include_str!("exceptions.txt").lines().map(str::trim);
        for line in lines.filter(|l| !l.is_empty() && !l.starts_with("# ")) {
            let (head, reason) = line.split_once(": ").expect("exceptions.txt: NAME RELEASES: reason");
            let mut words = head.split_whitespace();
            let name = words.next().unwrap_or_default();
            let source = name.ends_with(".scl");
            rows.push(Row { name, source, releases: words.collect(), reason, looked: false, seen: false });
        }
        Self(rows)
    }

    fn find(&self, name: &str, release: &str, source: bool) -> Option<usize> {
        let is =
            |row: &Row| row.source == source && row.name.eq_ignore_ascii_case(name) && row.releases.contains(&release);
        self.0.iter().position(is)
    }

    /// Whether this source may not compile in a program of this release; `seen`: it does not.
    pub fn source(&mut self, name: &str, release: &str, seen: bool) -> bool {
        let Some(row) = self.find(name, release, true).and_then(|at| self.0.get_mut(at)) else { return false };
        row.looked = true;
        row.seen |= seen;
        true
    }

    /// Why a block differs in a release, if it does.
    pub fn reason(&mut self, name: &str, release: &str) -> Option<&'static str> {
        let row = self.find(name, release, false).and_then(|at| self.0.get_mut(at))?;
        row.looked = true;
        Some(row.reason)
    }

    /// It differs indeed.
    pub fn seen(&mut self, name: &str, release: &str) {
        if let Some(row) = self.find(name, release, false).and_then(|at| self.0.get_mut(at)) {
            row.seen = true;
        }
    }

    /// Reports rows that have no cause any more, and gives their number.
    pub fn check(&self) -> usize {
        let idle = |row: &&Row| row.looked && !row.seen;
        self.0
            .iter()
            .filter(idle)
            .inspect(|row| println!("{} is on the list of exceptions and is equal", row.name))
            .count()
    }
}
