//! The output of the demo: the live line, the table, the verdict.

use serde_json::Value;

use super::ledger::{LedgerA, LedgerB, lost_in_cp};

/// One line that fits into a terminal and never becomes shorter.
pub(super) fn live(a: &LedgerA, b: &LedgerB) -> String {
    format!(
        "A sent {:>6}  echoes right {:>6} wrong {} lost {} doubled {}   B received {:>6} returned {:>6}   ",
        a.started, a.good, a.wrong, a.lost, a.doubled, b.received, b.done
    )
}

/// The table at the end. Counts are telegrams; cycle times come from the reports of the two processes.
pub(super) fn print(a: &LedgerA, b: &LedgerB, report_a: &Value, report_b: &Value) {
    println!("station      scans   cycle min      mean       p99       max");
    for (name, report) in [("A", report_a), ("B", report_b)] {
        let scans =
            find(report, "scans").and_then(Value::as_u64).map_or_else(|| "?".to_owned(), |count| count.to_string());
        let time =
            |key: &str| cycle_time(report, key).map_or_else(|| "?".to_owned(), |micros| format!("{micros:.1} us"));
        let [min, mean, p99, max] = ["min", "mean", "p99", "max"].map(time);
        println!("{name:<8} {scans:>9} {min:>11} {mean:>9} {p99:>9} {max:>9}");
    }
    println!();
    println!("telegrams      done    error  aborted  lost in CP  doubled    wrong     PAFE");
    println!(
        "A -> B     {:>8} {:>8} {:>8} {:>11} {:>8} {:>8} {:>8}",
        a.done,
        a.error,
        a.aborted,
        lost_in_cp(a.done, b.received),
        "-",
        "-",
        a.pafe
    );
    println!(
        "B -> A     {:>8} {:>8} {:>8} {:>11} {:>8} {:>8} {:>8}",
        b.done,
        b.error,
        b.aborted,
        lost_in_cp(b.done, a.received()),
        a.doubled,
        a.wrong,
        b.pafe
    );
    println!("echoes    {} right, {} late, {} never came, {} refused by B", a.good, a.late, a.lost, b.refused);
}

/// Succeeds if telegrams were transferred and none was wrong or lost.
pub(super) fn verdict(a: &LedgerA, b: &LedgerB) -> Result<String, String> {
    let lost = lost_in_cp(a.done, b.received) + lost_in_cp(b.done, a.received());
    let faults = [
        (a.good == 0, "no telegram came back".to_owned()),
        (a.wrong > 0, format!("{} telegrams were wrong", a.wrong)),
        (a.lost > 0, format!("{} echoes never came", a.lost)),
        (lost > 0, format!("{lost} acknowledged telegrams were lost in a CP")),
        (b.refused > 0, format!("{} telegrams were not echoed", b.refused)),
        (a.pafe + b.pafe > 0, format!("{} scans with a parameter error", a.pafe + b.pafe)),
    ];
    let found: Vec<String> = faults.into_iter().filter(|(holds, _)| *holds).map(|(_, what)| what).collect();
    if found.is_empty() {
        Ok(format!("{} telegrams there and back, none wrong, none lost", a.good))
    } else {
        Err(found.join("; "))
    }
}

/// A cycle time of the report, in microseconds: `cycle.min_ns`, `cycle.min_us` or `cycle.min` (nanoseconds).
fn cycle_time(report: &Value, key: &str) -> Option<f64> {
    let cycle = find(report, "cycle").or_else(|| find(report, "cycle_ns")).or_else(|| find(report, "cycle_us"))?;
    let in_micros = find(report, "cycle_us").is_some();
    let nanos = |value: &Value| value.as_f64().map(|value| value / 1000.0);
    cycle
        .get(format!("{key}_us"))
        .and_then(Value::as_f64)
        .or_else(|| cycle.get(format!("{key}_ns")).and_then(nanos))
        .or_else(|| {
            let plain = cycle.get(key)?;
            if in_micros { plain.as_f64() } else { nanos(plain) }
        })
}

/// The first field of that name, at any depth.
fn find<'a>(value: &'a Value, key: &str) -> Option<&'a Value> {
    match value {
        Value::Object(fields) => fields.get(key).or_else(|| fields.values().find_map(|inner| find(inner, key))),
        Value::Array(items) => items.iter().find_map(|inner| find(inner, key)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn clean() -> (LedgerA, LedgerB) {
        let a = LedgerA { started: 9, done: 9, good: 9, ..LedgerA::default() };
        (a, LedgerB { received: 9, started: 9, done: 9, ..LedgerB::default() })
    }

    #[test]
    fn a_clean_run_is_praised() {
        let (a, b) = clean();
        assert_eq!(verdict(&a, &b), Ok("9 telegrams there and back, none wrong, none lost".to_owned()));
    }

    #[test]
    fn each_fault_spoils_the_verdict() {
        let (a, b) = clean();
        assert!(verdict(&LedgerA::default(), &LedgerB::default()).is_err());
        assert!(verdict(&LedgerA { wrong: 1, ..a }, &b).is_err());
        assert!(verdict(&LedgerA { lost: 1, ..a }, &b).is_err());
        assert!(verdict(&LedgerA { pafe: 1, ..a }, &b).is_err());
        assert!(verdict(&a, &LedgerB { received: 8, ..b }).is_err());
        assert!(verdict(&a, &LedgerB { done: 10, ..b }).is_err());
        assert!(verdict(&a, &LedgerB { refused: 1, ..b }).is_err());
        assert!(verdict(&LedgerA { doubled: 1, ..a }, &LedgerB { done: 10, ..b }).is_ok());
    }

    #[test]
    fn units_of_the_report() {
        assert_eq!(cycle_time(&json!({"scan": {"cycle": {"min_us": 1.5}}}), "min"), Some(1.5));
        assert_eq!(cycle_time(&json!({"cycle": {"min_ns": 1500}}), "min"), Some(1.5));
        assert_eq!(cycle_time(&json!({"cycle_ns": {"min": 1500}}), "min"), Some(1.5));
        assert_eq!(cycle_time(&json!({"cycle_us": {"min": 1.5}}), "min"), Some(1.5));
        assert_eq!(cycle_time(&json!({}), "min"), None);
    }
}
