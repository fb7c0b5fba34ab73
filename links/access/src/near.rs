//! Did you mean: the known word that is nearest to a wrong one.

/// The known word nearest to `word`, if one is near enough to be meant.
#[must_use]
pub fn nearest<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    let (allowed, word) = ((word.chars().count() / 3).clamp(1, 3), word.to_lowercase());
    known
        .into_iter()
        .map(|k| (strsim::damerau_levenshtein(&word, &k.to_lowercase()), k))
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
