//! Arguments of commands that run some or all files of a folder: `cargo xtask fuzz stl ir --each 10m`.

use std::fs;

use crate::cargo;
use crate::failure::{Failure, Outcome, step};

/// The names of the files `PREFIX*` in a folder of the checkout, without prefix and extension, sorted.
pub(crate) fn stems(folder: &str, prefix: &str) -> Outcome<Vec<String>> {
    let folder = cargo::root().join(folder);
    let entries = fs::read_dir(&folder).map_err(|why| step(format!("{}: {why}", folder.display())))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut names: Vec<String> =
        paths.filter_map(|path| Some(path.file_stem()?.to_str()?.strip_prefix(prefix)?.to_owned())).collect();
    names.sort();
    Ok(names)
}

/// The names on the command line of `command`, and the value of its option, if given; `wants` describes that value.
pub(crate) fn names_and_option<T>(
    args: &[String],
    command: &str,
    option: &str,
    wants: &str,
    value: impl Fn(&str) -> Option<T>,
) -> Outcome<(Vec<String>, Option<T>)> {
    let (mut names, mut found) = (Vec::new(), None);
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        if arg == option {
            let given = args.next().and_then(|text| value(text));
            found = Some(given.ok_or_else(|| Failure::Usage(format!("{option} wants {wants}")))?);
        } else if arg.starts_with('-') {
            return Err(Failure::Usage(format!("{command} knows no `{arg}`")));
        } else {
            names.push(arg.clone());
        }
    }
    Ok((names, found))
}

/// The selected names of `known`: all, unless names are given.
pub(crate) fn some_or_all(wanted: Vec<String>, known: Vec<String>, what: &str) -> Outcome<Vec<String>> {
    if let Some(wrong) = wanted.iter().find(|name| !known.contains(name)) {
        return Err(Failure::Usage(format!("no {what} `{wrong}`; there are: {}", known.join(", "))));
    }
    Ok(if wanted.is_empty() { known } else { wanted })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_unless_there_are_names() {
        let known = || vec!["ir".to_owned(), "stl".to_owned()];
        assert_eq!(some_or_all(Vec::new(), known(), "target").expect("all"), known());
        assert_eq!(some_or_all(vec!["stl".into()], known(), "target").expect("one"), ["stl"]);
        let Err(Failure::Usage(why)) = some_or_all(vec!["stl".into(), "lad".into()], known(), "target") else {
            panic!("there is no lad")
        };
        assert_eq!(why, "no target `lad`; there are: ir, stl");
    }

    #[test]
    fn files_by_what_follows_the_prefix() {
        let names = stems("xtask/src", "fa").expect("this folder");
        assert_eq!(names, ["ilure", "ults"]);
        assert!(matches!(stems("xtask/no-such-folder", ""), Err(Failure::Step(_))));
    }
}
