//! A recording as a table: a line for each row.

use std::io::{self, Write};

use ob1_access::Item;
use ob1_record::{Head, Row, datum};

/// Writes a table, its columns separated by commas (RFC 4180).
pub(super) struct Csv<W: Write> {
    out: W,
    items: Vec<Item>,
}

/// The columns before the signals.
const COLUMNS: &str = "time_ns,point,state,lost,scan,start_ns,lateness_ns,execution_ns,inputs_ns,program_ns,outputs_ns";

impl<W: Write> Csv<W> {
    pub(super) fn new(mut out: W, head: &Head) -> io::Result<Self> {
        let items = head.items().map_err(|why| io::Error::new(io::ErrorKind::InvalidData, why))?;
        let mut line = COLUMNS.to_owned();
        for item in &items {
            line += &format!(",{}", quoted(&item.name));
        }
        writeln!(out, "{line}")?;
        Ok(Self { out, items })
    }

    pub(super) fn row(&mut self, row: &Row) -> io::Result<()> {
        let scan = &row.scan;
        write!(
            self.out,
            "{},{},{},{},{},{},{},{},{},{},{}",
            row.time.nanos(),
            row.point,
            row.state.name(),
            row.lost,
            scan.number,
            scan.start.nanos(),
            scan.lateness.nanos(),
            scan.execution.nanos(),
            scan.inputs.nanos(),
            scan.program.nanos(),
            scan.outputs.nanos()
        )?;
        for (at, item) in self.items.iter().enumerate() {
            match row.bits(at) {
                Some(bits) => write!(self.out, ",{}", quoted(&cell(item, bits)))?,
                // What was not there has no value.
                None => write!(self.out, ",")?,
            }
        }
        writeln!(self.out)
    }

    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// The value as a cell of a table: a number, or a date.
fn cell(item: &Item, bits: u32) -> String {
    match datum(item, bits).map(|datum| datum.json()) {
        Some(serde_json::Value::String(text)) => text,
        Some(value) => value.to_string(),
        None => bits.to_string(),
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use ob1_record::Signal;
    use ob1_time::Instant;

    use super::*;

    #[test]
    fn a_line_for_each_row() {
        let signal =
            |name: &str, address: &str, ty: &str| Signal { name: name.into(), address: address.into(), ty: ty.into() };
        let signals = vec![
            signal("Motor", "M1.0", "BOOL"),
            signal("a \"b\", c", "MW2", "INT"),
            signal("r", "MD4", "REAL"),
            signal("T2", "T2", "S5TIME"),
            signal("d", "MW8", "DATE"),
            signal("gone", "DB9.DBW0", "WORD"),
        ];
        let mut out = Vec::new();
        let mut csv = Csv::new(&mut out, &Head { signals, ..Head::default() }).expect("a head");
        let values = vec![1, 0xFFFE, u64::from(1.5_f32.to_bits()), 0x2005, 1, 2 << 32];
        csv.row(&Row { time: Instant::from_nanos(7), point: 3, values, ..Row::default() }).expect("written");
        let text = String::from_utf8(out).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], format!("{COLUMNS},Motor,\"a \"\"b\"\", c\",r,T2,d,gone"));
        assert_eq!(lines[1], "7,3,STOP,0,0,0,0,0,0,0,0,1,-2,1.5,5000,1990-01-02T00:00:00.000,");
    }
}
