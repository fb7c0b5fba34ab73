//! Did you mean: the known word that is nearest to a wrong one.

/// Longest known word that is compared, in bytes; words that are looked up may have so many.
const KNOWN: usize = 64;
const WORD: usize = 40;

/// The known word nearest to `word`, if one is near enough to be meant. Capitals do not matter.
pub fn nearest<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    if word.len() > WORD {
        return None;
    }
    let word = word.to_uppercase();
    let allowed = match word.chars().count() {
        0..=1 => 0,
        2..=4 => 1,
        5..=8 => 2,
        _ => 3,
    };
    known
        .into_iter()
        .filter(|k| k.len() <= KNOWN)
        .map(|k| (strsim::damerau_levenshtein(&word, &k.to_uppercase()), k))
        .filter(|(distance, _)| *distance <= allowed)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, k)| k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_words() {
        assert_eq!(nearest("min_cylce", ["min_cycle", "watchdog"]), Some("min_cycle"));
        assert_eq!(nearest("colour", ["min_cycle", "watchdog"]), None);
        assert_eq!(nearest("DI", ["do", "di", "ai"]), Some("di"), "capitals do not matter");
    }
}
