//! A timer that is started with a TIME: its bits are no BCD number, or that of another time.

use ob1_ir::Op;

use crate::codes;
use crate::diagnostic::Sink;
use crate::inspect::Inspected;
use crate::token::{File, Kind};

/// Reports `L T#200MS` in front of a statement that starts a timer.
pub(crate) fn started_with_a_time(i: &Inspected<'_>, file: &File<'_>, sink: &mut Sink) {
    for (at, pair) in i.code.windows(2).enumerate() {
        let [load, start] = pair else { continue };
        if !matches!((&load.op, &start.op), (Op::LoadConst(_), Op::StartTimer(..))) || i.is_target(at + 1) {
            continue;
        }
        let tokens = i.block.statements.get(at).and_then(|s| file.tokens.get(s.operand.clone()));
        let constant = tokens.unwrap_or_default().iter().find(|token| token.kind == Kind::Typed);
        let Some(text) = constant.map(|token| file.of(*token)) else { continue };
        let Some((prefix, time)) = text.split_once('#') else { continue };
        if prefix.eq_ignore_ascii_case("T") || prefix.eq_ignore_ascii_case("TIME") {
            let shown: String = time.chars().take(32).collect();
            let message = format!("T#{shown} is no S5TIME, which the timer takes");
            let remedy = format!("Write S5T#{shown}; TIME is for SFB 3 to 5.");
            sink.report_with(i.block.file, i.span(at), &codes::TIME_FOR_TIMER, message, remedy);
        }
    }
}
