//! Mistakes of a station file, as rows: what is written instead of what, in which line it is found, what is reported,
//! and what helps.

use ob1_station_file::Station;
use ob1_station_file::finding::Finding;

pub(crate) type Row<'a> = (&'a str, &'a str, u32, &'a str, &'a str);

/// Each mistake is found, in its line, with its words.
pub(crate) fn check(good: &str, read: fn(&str) -> Result<Station, Vec<Finding>>, rows: &[Row<'_>]) {
    let mut wrong = Vec::new();
    for &(from, to, line, says, helps) in rows {
        assert!(good.contains(from), "{from}");
        match read(&good.replacen(from, to, 1)) {
            Ok(_) => wrong.push(format!("{from} -> {to}: nothing is said")),
            Err(findings) => {
                // A wrong range is a range nevertheless.
                if findings.iter().any(|f| f.message.contains("neither inputs nor outputs")) {
                    wrong.push(format!("{from} -> {to}: said of a module that has ranges"));
                }
                let fits = |f: &Finding| f.line == line && f.message.contains(says) && f.remedy.contains(helps);
                if !findings.iter().any(fits) {
                    wrong.push(format!("{from} -> {to}: line {line}: {findings:#?}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
