//! Types in words.

/// `an INT`, `a WORD`.
pub fn with_article(name: &str) -> String {
    let vowel = name.starts_with(['A', 'E', 'I', 'O', 'S']) && !matches!(name, "STRING" | "STRUCT");
    format!("{} {name}", if vowel { "an" } else { "a" })
}
