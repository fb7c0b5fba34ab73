//! The files of the page: they are part of the program, and nothing is loaded from elsewhere.

use std::sync::LazyLock;

use hyper::StatusCode;
use hyper::header::{CACHE_CONTROL, ETAG, HeaderMap, HeaderValue, IF_NONE_MATCH};

use crate::http::{Body, Reply, list, reply};

/// A file.
pub(super) struct File {
    path: &'static str,
    kind: &'static str,
    text: &'static str,
}

/// A script of the page.
macro_rules! script {
    ($name:literal) => {
        File {
            path: concat!("/", $name),
            kind: "text/javascript; charset=utf-8",
            text: include_str!(concat!("../../page/", $name)),
        }
    };
}

static FILES: &[File] = &[
    File { path: "/", kind: "text/html; charset=utf-8", text: include_str!("../../page/index.html") },
    File { path: "/style.css", kind: "text/css; charset=utf-8", text: include_str!("../../page/style.css") },
    File { path: "/icon.svg", kind: "image/svg+xml", text: include_str!("../../page/icon.svg") },
    script!("app.js"),
    script!("kit.js"),
    script!("session.js"),
    script!("stream.js"),
    script!("hub.js"),
    script!("words.js"),
    script!("german.js"),
    script!("views.js"),
    script!("table.js"),
    script!("stop.js"),
    script!("trend.js"),
    script!("recording.js"),
    script!("program.js"),
    script!("why.js"),
    script!("io.js"),
    script!("alarms.js"),
];

/// The tag of all files together; it changes with the build.
static TAG: LazyLock<String> = LazyLock::new(|| {
    let mut all = ring::digest::Context::new(&ring::digest::SHA256);
    FILES.iter().for_each(|file| all.update(file.text.as_bytes()));
    let hex: String = all.finish().as_ref().iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    format!("\"{hex}\"")
});

/// The file at this path.
pub(super) fn find(path: &str) -> Option<&'static File> {
    FILES.iter().find(|file| file.path == path)
}

/// Whether the browser has the files of this tag. There may be several, and a proxy that compresses makes them weak
/// [RFC 9110, 13.1.2].
fn has(headers: &HeaderMap, tag: &str) -> bool {
    list(headers, IF_NONE_MATCH).any(|one| one == "*" || one.trim_start_matches("W/") == tag)
}

impl File {
    /// The file, or "not modified".
    pub(super) fn reply(&self, headers: &HeaderMap) -> Reply {
        let known = has(headers, &TAG);
        let mut answer = reply(StatusCode::OK, self.kind, self.text);
        if known {
            *answer.status_mut() = StatusCode::NOT_MODIFIED;
            *answer.body_mut() = Body::Whole(None);
        }
        answer.headers_mut().insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        if let Ok(tag) = HeaderValue::from_str(&TAG) {
            answer.headers_mut().insert(ETAG, tag);
        }
        answer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_the_same_when_a_proxy_has_made_it_weak() {
        let known = |lines: &[&str]| {
            let mut headers = HeaderMap::new();
            for line in lines {
                headers.append(IF_NONE_MATCH, line.parse().expect("a value"));
            }
            has(&headers, "\"12ab\"")
        };
        for lines in [&["\"12ab\""][..], &["W/\"12ab\""], &["*"], &["\"0\", W/\"12ab\""], &["\"0\"", "\"12ab\""]] {
            assert!(known(lines), "{lines:?}");
        }
        for lines in [&[][..], &["\"12abc\""], &["12ab"], &["\"0\", \"1\""]] {
            assert!(!known(lines), "{lines:?}");
        }
    }

    /// The page is small, and makes requests only to the station.
    #[test]
    fn the_page_is_small_and_alone() {
        let bytes: usize = FILES.iter().map(|file| file.text.len()).sum();
        assert!(bytes <= 250 * 1024, "{bytes} bytes");
        for file in FILES {
            for far in ["http:", "https:", "ws://", "wss:", "//cdn", "@import", "eval(", "innerHTML", " style=\""] {
                let found = file.text.replace("http://www.w3.org/2000/svg", "").contains(far);
                assert!(!found, "{}: {far}", file.path);
            }
            // A proxy may show the page below another path.
            for whole in ["=\"/", "from \"/", "(\"/", "(`/", "url(/"] {
                assert!(!file.text.contains(whole), "{}: {whole}", file.path);
            }
        }
    }

    fn text(path: &str) -> &'static str {
        find(path).expect("a file").text
    }

    /// The event texts and remedies of the CPU are there in German.
    #[test]
    fn what_the_cpu_says_is_there_in_german() {
        let german = text("/german.js");
        let all = ob1_model::Event::ALL.into_iter().chain(ob1_model::FaultKind::ALL.map(ob1_model::Event::from));
        for event in all {
            for said in [event.text(), event.remedy()] {
                let key = format!("\"{}\": \"", said.replace('"', "\\\""));
                assert!(said.is_empty() || german.contains(&key), "{:04X}h: {said}", event.0);
            }
        }
    }

    /// Each word that a script says is in the table, with two texts, and each word of the table is said.
    #[test]
    fn each_word_is_there_in_both_languages() {
        let words = text("/words.js");
        let scripts: Vec<&str> = FILES.iter().filter(|file| file.path.ends_with(".js")).map(|file| file.text).collect();
        let keys: Vec<&str> = scripts.iter().flat_map(|script| script.split("say(\"").skip(1)).collect();
        assert!(keys.len() > 100, "{}", keys.len());
        for key in keys.iter().filter_map(|rest| rest.split('"').next()) {
            let entry = words.split_once(&format!(" {key}: [\"")).map(|(_, rest)| rest);
            let entry = entry.unwrap_or_else(|| panic!("no word {key}")).split("],").next().unwrap_or_default();
            // Two texts in quotes.
            assert!(entry.split("\",").count() == 2, "{key}: {entry}");
        }
    }
}
