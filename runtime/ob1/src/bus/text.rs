//! Buses in text: of `ob1 bus watch` and of the page of `ob1 top`.

use std::fmt::Write as _;

use ob1_station::access::protocol::{BusStationStatus, BusStatus, Piece};

use crate::units::time;

/// The looks before, and the seconds since.
pub(crate) type Before<'a> = Option<(&'a [BusStatus], f64)>;

/// All buses, or the one with this name.
pub(crate) fn text(now: &[BusStatus], before: Before<'_>) -> String {
    let mut out = String::new();
    for bus in now {
        let old = before.and_then(|(all, seconds)| Some((all.iter().find(|old| old.name == bus.name)?, seconds)));
        out += &one(bus, old);
    }
    out
}

fn one(bus: &BusStatus, before: Option<(&BusStatus, f64)>) -> String {
    let process = if bus.pid == 0 { "no process".to_owned() } else { format!("process {}, {}", bus.pid, bus.process) };
    let driven = if bus.driven { "driven" } else { "off" };
    let exchange = bus.stations.iter().filter(|station| station.state == "exchange").count();
    let mut out = format!(
        "{}  {}  {process}, lost {}  outputs {driven}  {exchange} of {} exchange\n",
        bus.name,
        bus.kind,
        bus.losses,
        bus.stations.len()
    );
    let _ = writeln!(
        out,
        "{:>5} {:<16} {:<9} {:>11} {:>9} {:>7} {:>10}  inputs, outputs",
        "", "", "", "exchanges/s", "failures", "losses", "round"
    );
    for station in &bus.stations {
        let old = before.and_then(|(old, seconds)| {
            Some((old.stations.iter().find(|old| old.name == station.name)?, seconds)).filter(|_| seconds > 0.0)
        });
        out += &line(station, old);
    }
    out
}

fn line(station: &BusStationStatus, before: Option<(&BusStationStatus, f64)>) -> String {
    let rate = before.map_or_else(
        || "-".to_owned(),
        // Another process counts from 0.
        |(old, seconds)| format!("{:.1}", station.exchanges.saturating_sub(old.exchanges) as f64 / seconds),
    );
    let pieces = |letter: char, all: &[Piece]| -> String {
        all.iter().map(|piece| format!("  {letter} {}: {}", piece.address, piece.hex)).collect()
    };
    let mut out = format!(
        "{:>5} {:<16} {:<9} {rate:>11} {:>9} {:>7} {:>10}{}{}",
        station.number,
        station.name,
        station.state,
        station.failures,
        station.losses,
        time(station.round_ns as f64),
        pieces('E', &station.inputs),
        pieces('A', &station.outputs),
    );
    out.truncate(out.trim_end().len());
    out.push('\n');
    if !station.says.is_empty() {
        let _ = writeln!(out, "{:>22} {}", "", station.says);
    }
    out
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A bus with a coupler that exchanges and a slave that refuses.
    pub(crate) fn bus(exchanges: u64) -> BusStatus {
        let piece = |address, hex: &str| Piece { address, hex: hex.into() };
        let rio = BusStationStatus {
            name: "rio".into(),
            number: 1,
            state: "exchange".into(),
            exchanges,
            round_ns: 410_000,
            inputs: vec![piece(0, "1234"), piece(8, "FF")],
            outputs: vec![piece(4, "00")],
            ..BusStationStatus::default()
        };
        let scale = BusStationStatus {
            name: "scale".into(),
            number: 2,
            state: "refuses".into(),
            says: "configuration fault".into(),
            failures: 3,
            losses: 1,
            ..BusStationStatus::default()
        };
        BusStatus {
            name: "field".into(),
            kind: "dp".into(),
            pid: 77,
            process: "ready".into(),
            driven: true,
            stations: vec![rio, scale],
            ..BusStatus::default()
        }
    }

    #[test]
    fn a_bus_in_lines() {
        let (old, new) = ([bus(100)], [bus(300)]);
        let said = text(&new, Some((&old, 2.0)));
        let expected = "field  dp  process 77, ready, lost 0  outputs driven  1 of 2 exchange\n\
            \u{20}                                exchanges/s  failures  losses      round  inputs, outputs\n\
            \u{20}   1 rio              exchange        100.0         0       0     410 µs  E 0: 1234  E 8: FF  A 4: 00\n\
            \u{20}   2 scale            refuses           0.0         3       1       0 ns\n\
            \u{20}                      configuration fault\n";
        assert_eq!(said, expected, "\n{said}");
        // Another process counts from 0.
        assert!(text(&[bus(1)], Some((&old, 2.0))).contains("exchange          0.0"));
        let dead = BusStatus { pid: 0, ..bus(1) };
        assert!(text(&[dead], None).contains("no process, lost 0"));
    }
}
