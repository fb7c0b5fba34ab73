//! The SCL sources of a project: files beside the station, and what the report says of them.

use ob1_project::{Note, SclSource};

use super::names::SCL;
use super::station::Made;

/// Lays the sources beside the station and says which of them stand, or can stand, in the place of their blocks.
pub(super) fn lay_beside(made: &mut Made, sources: &[SclSource], are_taken: bool) {
    if sources.is_empty() {
        return;
    }
    let fit = sources.iter().filter(|source| source.why_not.is_none()).count();
    let how = if are_taken { "run in the place of the machine code" } else { "can run in its place: --scl takes them" };
    let what = format!(
        "{} SCL sources of the project lie here; {fit} compile and declare the interface of their blocks, and {how}",
        sources.len()
    );
    made.notes.push(Note::info(SCL, what));
    for source in sources {
        let name = format!("{SCL}/{}", source.name);
        if let Some(why) = &source.why_not {
            made.notes.push(Note::info(&name, format!("its blocks stay as they were compiled: {why}")));
        }
        made.files.push((name, source.text.as_bytes().to_vec()));
    }
}
