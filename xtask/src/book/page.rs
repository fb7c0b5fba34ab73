//! The parts of a Markdown page that the rules of the book need: headings with their anchors, links, spans of code.

use std::collections::BTreeMap;

use pulldown_cmark::{Event, HeadingLevel, Options, Parser, Tag, TagEnd};

/// Something on a page, and its line from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Placed {
    pub(super) line: usize,
    pub(super) text: String,
}

/// A page, as far as the rules ask for it.
#[derive(Debug, Default)]
pub(super) struct Page {
    /// The heading of the first level, if the page begins with one.
    pub(super) title: Option<String>,
    /// The anchors a link may use after `#`.
    pub(super) anchors: Vec<String>,
    /// Targets of links and images, as written.
    pub(super) links: Vec<Placed>,
    /// Spans of code in the text.
    pub(super) spans: Vec<Placed>,
    /// Lines of code blocks.
    pub(super) code: Vec<Placed>,
}

impl Page {
    pub(super) fn of(text: &str) -> Self {
        let mut page = Self::default();
        let mut starts = vec![0];
        starts.extend(text.match_indices('\n').map(|(at, _)| at + 1));
        let line_of = |at: usize| starts.partition_point(|start| *start <= at);
        let mut ids = BTreeMap::new();
        let mut heading: Option<(HeadingLevel, String)> = None;
        let (mut in_code, mut events) = (false, 0);
        for (event, range) in Parser::new_ext(text, Options::ENABLE_TABLES).into_offset_iter() {
            let line = line_of(range.start);
            match event {
                Event::Start(Tag::Heading { level, .. }) => heading = Some((level, String::new())),
                Event::End(TagEnd::Heading(_)) => {
                    if let Some((level, words)) = heading.take() {
                        page.anchors.push(unique(&anchor(&words), &mut ids));
                        if level == HeadingLevel::H1 && page.anchors.len() == 1 && page.title.is_none() && events == 0 {
                            page.title = Some(words);
                        }
                    }
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    page.links.push(Placed { line, text: dest_url.into_string() });
                }
                Event::Start(Tag::CodeBlock(_)) => in_code = true,
                Event::End(TagEnd::CodeBlock) => in_code = false,
                Event::Text(words) => {
                    if let Some((_, heading)) = &mut heading {
                        heading.push_str(&words);
                    } else if in_code {
                        let lines = words.lines().enumerate();
                        page.code.extend(lines.map(|(n, text)| Placed { line: line + n, text: text.to_owned() }));
                    }
                }
                Event::Code(words) => {
                    if let Some((_, heading)) = &mut heading {
                        heading.push_str(&words);
                    }
                    page.spans.push(Placed { line, text: words.into_string() });
                }
                _ => {}
            }
            if heading.is_none() && page.anchors.is_empty() {
                events += 1;
            }
        }
        page
    }
}

/// The anchor that mdBook and forges derive from a heading: lower-case letters, `-` for blanks, other characters
/// removed.
fn anchor(heading: &str) -> String {
    let keep = |c: char| match c {
        c if c.is_alphanumeric() || c == '_' || c == '-' => Some(c.to_ascii_lowercase()),
        c if c.is_whitespace() => Some('-'),
        _ => None,
    };
    heading.trim().chars().filter_map(keep).collect()
}

/// The second anchor with the same name gets `-1`, and so on.
fn unique(name: &str, ids: &mut BTreeMap<String, usize>) -> String {
    let count = ids.entry(name.to_owned()).or_default();
    *count += 1;
    if *count == 1 { name.to_owned() } else { format!("{name}-{}", *count - 1) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_read() {
        let page = Page::of(
            "# The `ob1` book\n\nSee [a](a.md#x) and `docs/a.md`.\n\n## What's new?\n\n    ob1 run a.toml\n    ob1 get a MB1\n\n\
             ## What's new?\n\n| a |\n|---|\n| [b](b.md) |\n",
        );
        assert_eq!(page.title.as_deref(), Some("The ob1 book"));
        assert_eq!(page.anchors, ["the-ob1-book", "whats-new", "whats-new-1"]);
        let flat = |list: &[Placed]| list.iter().map(|p| format!("{}:{}", p.line, p.text)).collect::<Vec<_>>();
        assert_eq!(flat(&page.links), ["3:a.md#x", "14:b.md"]);
        assert_eq!(flat(&page.spans), ["1:ob1", "3:docs/a.md"]);
        assert_eq!(flat(&page.code), ["7:ob1 run a.toml", "8:ob1 get a MB1"]);
    }

    #[test]
    fn a_title_stands_first() {
        assert_eq!(Page::of("Text.\n\n# Title\n").title, None);
        assert_eq!(Page::of("## Section\n\n# Title\n").title, None);
    }
}
