//! Parts of a campaign (`--part 3/20`), the result of each as a line of JSON, and what all of them together say.
//!
//! The programs of the tests crate write such lines as well as the verbs here: the file is compiled into both. What
//! was run is counted, failures have the name of their seed, and the digest is a sum over what each seed has shown: it
//! is the same for the same campaign, in one part or in many, in any order.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde_json::{Value, json};

/// Which part of a campaign this is: `3/20`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// From 1.
    pub number: u64,
    /// Into how many the campaign is divided.
    pub of: u64,
}

impl Part {
    /// All of it.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    /// The seeds of this part: the first, and how many. Each seed of the whole is in one part.
    #[must_use]
    pub fn slice(self, first: u64, count: u64) -> (u64, u64) {
        let until = |parts: u64| (u128::from(count) * u128::from(parts) / u128::from(self.of)) as u64;
        let before = until(self.number - 1);
        (first + before, until(self.number) - before)
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
        match numbers {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err(format!("`{text}` is no part; parts are counted from 1, the last of 20 is 20/20")),
        }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

/// What a part has done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tally {
    /// The campaign: its verb with its options, and the version of the project. Parts of one campaign agree.
    pub campaign: String,
    /// Which part.
    pub part: Part,
    /// The machine, as it is called there.
    pub host: String,
    /// How many seeds or tests ran.
    pub done: u64,
    /// Those that failed, by name, and why.
    pub failed: BTreeMap<String, String>,
    /// What was counted besides.
    pub counts: BTreeMap<String, u64>,
    /// Sum of the digests of all seeds.
    pub digest: u64,
}

impl Tally {
    /// Of a part that begins.
    #[must_use]
    pub fn new(verb: &str, options: &str, part: Part) -> Self {
        // A batch engine may run many nodes on one machine.
        let node = std::env::var("SLURMD_NODENAME").ok();
        let of_kernel = || std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned();
        Self {
            campaign: format!("{} {}", [verb, options].join(" ").trim(), env!("CARGO_PKG_VERSION")),
            part,
            host: node.unwrap_or_else(of_kernel),
            done: 0,
            failed: BTreeMap::new(),
            counts: BTreeMap::new(),
            digest: 0,
        }
    }

    /// A seed or test has ended: with what it has shown, or with what it failed by.
    pub fn enter(&mut self, name: &str, shown: Result<&str, &str>) {
        let (text, passed) = match shown {
            Ok(text) => (text, "passed"),
            Err(why) => (why, "failed"),
        };
        self.done += 1;
        // FNV-1a. Whoever wants to deceive a campaign needs no collision.
        let bytes = [name, "\n", passed, "\n", text].into_iter().flat_map(str::bytes);
        let hash = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        self.digest = self.digest.wrapping_add(bytes.fold(0xcbf2_9ce4_8422_2325, hash));
        if shown.is_err() {
            let first = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
            self.failed.insert(name.to_owned(), first.trim().to_owned());
        }
    }

    /// Something counted besides.
    pub fn count(&mut self, what: &str, number: u64) {
        *self.counts.entry(what.to_owned()).or_default() += number;
    }

    /// As a line of JSON.
    #[must_use]
    pub fn line(&self) -> String {
        json!({
            "campaign": self.campaign, "part": self.part.number, "of": self.part.of, "host": self.host, "done": self.done,
            "failed": self.failed, "counts": self.counts, "digest": format!("{:016x}", self.digest),
        })
        .to_string()
    }

    /// From such a line; none of any other line.
    #[must_use]
    pub fn read(line: &str) -> Option<Self> {
        let value: Value = serde_json::from_str(line.strip_prefix('{').map(|_| line)?).ok()?;
        let text = |name: &str| value[name].as_str();
        let number = |name: &str| value[name].as_u64();
        Some(Self {
            campaign: text("campaign")?.to_owned(),
            part: format!("{}/{}", number("part")?, number("of")?).parse().ok()?,
            host: text("host")?.to_owned(),
            done: number("done")?,
            failed: serde_json::from_value(value["failed"].clone()).ok()?,
            counts: serde_json::from_value(value["counts"].clone()).ok()?,
            digest: u64::from_str_radix(text("digest")?, 16).ok()?,
        })
    }

    /// What must be the same when the same part runs again.
    #[must_use]
    pub fn says_the_same(&self, other: &Self) -> bool {
        *self == Self { host: self.host.clone(), ..other.clone() }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} done, {} failed", self.campaign, self.done, self.failed.len())?;
        self.counts.iter().try_for_each(|(what, count)| write!(f, ", {count} {what}"))?;
        write!(f, "; digest {:016x}", self.digest)?;
        self.failed.iter().try_for_each(|(name, why)| write!(f, "\nFAILED {name}: {why}"))
    }
}

/// What all parts of a campaign say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Collected {
    /// All parts that are here, as one.
    pub all: Tally,
    /// Parts that are not here.
    pub lost: Vec<u64>,
    /// Parts that are here more than once, with the same result; counted once.
    pub repeated: Vec<u64>,
}

/// Puts the parts in these outputs together.
///
/// # Errors
/// There is none, they are of different campaigns, or a part that ran twice has shown two things.
pub fn collect<'a>(outputs: impl IntoIterator<Item = &'a str>) -> Result<Collected, String> {
    let mut parts: BTreeMap<u64, Tally> = BTreeMap::new();
    let mut repeated = Vec::new();
    let mut first: Option<Tally> = None;
    for tally in outputs.into_iter().flat_map(str::lines).filter_map(Tally::read) {
        let first = first.get_or_insert_with(|| tally.clone());
        if (&first.campaign, first.part.of) != (&tally.campaign, tally.part.of) {
            let (a, b) = ((&first.campaign, first.part.of), (&tally.campaign, tally.part.of));
            return Err(format!("two campaigns: `{}` in {} parts, and `{}` in {}", a.0, a.1, b.0, b.1));
        }
        let number = tally.part.number;
        match parts.get(&number) {
            Some(known) if !known.says_the_same(&tally) => {
                let hosts = format!("on {} and on {}", known.host, tally.host);
                return Err(format!("part {number} ran twice, {hosts}, and has shown two things:\n{known}\n{tally}"));
            }
            Some(_) => repeated.push(number),
            None => drop(parts.insert(number, tally)),
        }
    }
    let mut all = first.ok_or("no part of a campaign is here; each ends with a line of JSON (--json)")?;
    let lost = (1..=all.part.of).filter(|number| !parts.contains_key(number)).collect();
    all = Tally { part: Part::WHOLE, host: String::new(), done: 0, digest: 0, ..all };
    all.failed.clear();
    all.counts.clear();
    for tally in parts.into_values() {
        all.done += tally.done;
        all.failed.extend(tally.failed);
        tally.counts.iter().for_each(|(what, count)| all.count(what, *count));
        all.digest = all.digest.wrapping_add(tally.digest);
    }
    repeated.sort_unstable();
    Ok(Collected { all, lost, repeated })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_all_seeds_once() {
        for (first, count, of) in [(1, 1_000, 20), (7, 3, 5), (1, 1_000, 7), (0, u64::MAX / 4, 1_000), (5, 0, 3)] {
            let mut next = first;
            for number in 1..=of {
                let (begin, len) = Part { number, of }.slice(first, count);
                assert_eq!(begin, next, "part {number} of {of}");
                assert!(len <= count / of + 1 && len >= count / of);
                next = begin + len;
            }
            assert_eq!(next, first + count);
        }
        assert_eq!("3/20".parse(), Ok(Part { number: 3, of: 20 }));
        for wrong in ["0/20", "21/20", "3", "3/", "a/b", "-1/2", "1/0"] {
            assert!(wrong.parse::<Part>().is_err(), "{wrong}");
        }
    }

    /// The campaign of 100 seeds, of which each 17th fails, in so many parts.
    fn campaign(of: u64) -> Vec<String> {
        let part = |number| {
            let part = Part { number, of };
            let mut tally = Tally::new("sim", "--seeds 100", part);
            let (first, count) = part.slice(1, 100);
            for seed in first..first + count {
                let shown = format!("log of {seed}");
                tally.enter(&format!("seed {seed}"), if seed % 17 == 0 { Err(&shown) } else { Ok(&shown) });
                tally.count("telegrams", seed);
            }
            format!("a line of the program\n{}\nanother", tally.line())
        };
        (1..=of).map(part).collect()
    }

    fn collected(parts: &[String]) -> Result<Collected, String> {
        collect(parts.iter().map(String::as_str))
    }

    #[test]
    fn parts_say_what_the_whole_says_to_the_seed() {
        let whole = collected(&campaign(1)).expect("one part");
        assert_eq!(
            whole.all.failed.keys().collect::<Vec<_>>(),
            ["seed 17", "seed 34", "seed 51", "seed 68", "seed 85"]
        );
        assert_eq!((whole.all.done, whole.all.counts["telegrams"]), (100, 5050));
        for of in [2, 7, 20, 100, 130] {
            let mut parts = campaign(of);
            parts.reverse();
            assert_eq!(collected(&parts).expect("all parts"), whole, "{of}");
        }
        // A seed that shows another thing is seen, though it passes.
        let other = campaign(7)[3].replace("\"digest\":\"", "\"digest\":\"1");
        assert_ne!(
            Tally::read(other.lines().nth(1).expect("there")),
            Tally::read(campaign(7)[3].lines().nth(1).expect(""))
        );
    }

    #[test]
    fn lost_and_repeated_parts_are_seen() {
        let mut parts = campaign(20);
        parts.remove(6);
        // Cut off while it was written.
        let len = parts[11].len();
        parts[11].truncate(len - 20);
        let again =
            parts[2].replace(&format!("\"host\":\"{}\"", Tally::new("", "", Part::WHOLE).host), "\"host\":\"other\"");
        assert_ne!(again, parts[2]);
        parts.push(again);
        let found = collected(&parts).expect("they belong together");
        assert_eq!((found.lost, found.repeated, found.all.done), (vec![7, 13], vec![3], 90));
        parts[0] = parts[0].replace("\"done\":5", "\"done\":4");
        parts.push(campaign(20).remove(0));
        assert!(collected(&parts).is_err_and(|why| why.starts_with("part 1 ran twice, on ")));
        let two = [campaign(20), campaign(7)].concat();
        assert!(collected(&two).is_err_and(|why| why.starts_with("two campaigns: ")));
        assert!(collected(&[]).is_err());
    }
}
