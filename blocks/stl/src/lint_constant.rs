//! Constants that are legal here, and another thing than meant: a TIME for a timer, whose bits are no BCD number or
//! that of another time; a long number without `L#`, which STEP 7 refuses.

use ob1_ir::Op;

use crate::diagnostic::Sink;
use crate::inspect::Inspected;
use crate::messages;
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
            sink.report_with(i.block.file, i.span(at), &messages::TIME_FOR_TIMER, message, remedy);
        }
    }
}

/// Reports `L 70000`.
pub(crate) fn long_without_sign(i: &Inspected<'_>, file: &File<'_>, sink: &mut Sink) {
    for (at, stmt) in i.code.iter().enumerate() {
        let Op::LoadConst(value) = stmt.op else { continue };
        let tokens = i.block.statements.get(at).and_then(|s| file.tokens.get(s.operand.clone())).unwrap_or_default();
        let number = tokens.iter().find(|token| token.kind == Kind::Number).map(|token| file.of(*token));
        let is_whole = number.is_some_and(|text| text.bytes().all(|byte| byte.is_ascii_digit()));
        let is_negative = tokens.iter().any(|token| file.of(*token) == "-");
        // Of a negative INT the upper half is 0.
        let value = if is_negative && value <= 0xFFFF { i32::from(value as i16) } else { value as i32 };
        if is_whole && i16::try_from(value).is_err() {
            let message = format!("{value} is no INT");
            sink.report_with(i.block.file, i.span(at), &messages::LONG_CONSTANT, message, format!("Write L#{value}."));
        }
    }
}
