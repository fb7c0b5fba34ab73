//! The names that STEP 7 and TIA Portal give to organization blocks by themselves, German and English.

/// The organization blocks, each with its names without blanks and signs, in capitals: the symbols of STEP 7's library
/// "Organization Blocks", the English titles of its and TIA Portal's dialogs, the German ones.
const NAMES: &[(u16, &[&str])] = &[
    (
        1,
        &[
            "CYCLEXC",
            "MAIN",
            "CYCLEEXECUTION",
            "MAINPROGRAM",
            "MAINPROGRAMSWEEP",
            "PROGRAMCYCLE",
            "HAUPTPROGRAMM",
            "ZYKLUS",
            "ZYKLISCHESPROGRAMM",
            "ZYKLISCHEPROGRAMMBEARBEITUNG",
        ],
    ),
    (10, &["TIMEOFDAY", "TIMEOFDAYINTERRUPT", "UHRZEITALARM"]),
    (20, &["TIMEDELAYINTERRUPT", "VERZÖGERUNGSALARM"]),
    (30, &["CYCLICINTERRUPT", "WECKALARM"]),
    (40, &["HARDWAREINTERRUPT", "PROZESSALARM"]),
    (55, &["STATUSALARM", "STATUS", "STATUSINTERRUPT"]),
    (56, &["UPDATEALARM", "UPDATE", "UPDATEINTERRUPT"]),
    (57, &["MANUFACTUREALARM", "PROFILE", "MANUFACTURERSPECIFICINTERRUPT", "HERSTELLERSPEZIFISCHERALARM"]),
    (60, &["MULTIINT", "MULTICOMPUTINGINTERRUPT", "MULTICOMPUTINGALARM"]),
    (61, &["SYNCHRONOUSCYCLE", "TAKTSYNCHRONALARM"]),
    (70, &["IOREDFLT", "IOREDUNDANCYERROR", "IOREDUNDANCYFAULT", "PERIPHERIEREDUNDANZFEHLER"]),
    (72, &["CPUREDFLT", "CPUREDUNDANCYERROR", "CPUREDUNDANCYFAULT", "CPUREDUNDANZFEHLER"]),
    (73, &["COMREDFLT", "COMMUNICATIONREDUNDANCYERROR", "KOMMUNIKATIONSREDUNDANZFEHLER"]),
    (80, &["CYCLFLT", "TIMEERROR", "TIMEERRORINTERRUPT", "CYCLETIMEFAULT", "ZEITFEHLER", "ZYKLUSZEITFEHLER"]),
    (81, &["PSFLT", "POWERSUPPLYERROR", "POWERSUPPLYFAULT", "STROMVERSORGUNGSFEHLER"]),
    (
        82,
        &[
            "IOFLT1",
            "DIAGNOSTIC",
            "DIAGNOSTICERROR",
            "DIAGNOSTICINTERRUPT",
            "DIAGNOSTICERRORINTERRUPT",
            "IOPOINTFAULT1",
            "DIAGNOSEALARM",
            "DIAGNOSEFEHLER",
        ],
    ),
    (
        83,
        &[
            "IOFLT2",
            "PULLORPLUGOFMODULES",
            "PULLPLUGINTERRUPT",
            "INSERTREMOVEMODULEINTERRUPT",
            "IOPOINTFAULT2",
            "ZIEHENSTECKENALARM",
            "ZIEHENSTECKENVONBAUGRUPPEN",
        ],
    ),
    (84, &["CPUFLT", "CPUFAULT", "CPUHARDWAREFAULT", "CPUHARDWAREFEHLER"]),
    (85, &["OBNLFLT", "PRIORITYCLASSERROR", "PROGRAMEXECUTIONERROR", "OBNOTLOADEDFAULT", "PROGRAMMABLAUFFEHLER"]),
    (
        86,
        &[
            "RACKFLT",
            "RACKERROR",
            "RACKFAILURE",
            "RACKORSTATIONFAILURE",
            "LOSSOFRACKFAULT",
            "BAUGRUPPENTRÄGERAUSFALL",
            "BAUGRUPPENTRÄGERODERSTATIONSAUSFALL",
        ],
    ),
    (87, &["COMMFLT", "COMMUNICATIONERROR", "COMMUNICATIONFAULT", "KOMMUNIKATIONSFEHLER"]),
    (88, &["BPREXC", "PROCESSINGINTERRUPT", "BEARBEITUNGSABBRUCH"]),
    (90, &["BACKCYC", "BACKGROUND", "BACKGROUNDCYCLE", "HINTERGRUNDZYKLUS"]),
    (91, &["MCSERVO"]),
    (92, &["MCINTERPOLATOR"]),
    (100, &["COMPLETERESTART", "STARTUP", "WARMRESTART", "ANLAUF", "NEUSTART", "NEUSTARTWARMSTART", "WARMSTART"]),
    (101, &["RESTART", "HOTRESTART", "WIEDERANLAUF"]),
    (102, &["COLDRESTART", "KALTSTART"]),
    (121, &["PROGERR", "PROGRAMMINGERROR", "PROGRAMMIERFEHLER"]),
    (122, &["MODERR", "IOACCESSERROR", "MODULEACCESSERROR", "PERIPHERIEZUGRIFFSFEHLER", "ZUGRIFFSFEHLER"]),
];

/// Names that a digit follows, with the number of the first and of how many there are.
const SERIES: &[(&str, u16, u16)] = &[
    ("TODINT", 10, 8),
    ("TIMEOFDAYINTERRUPT", 10, 8),
    ("UHRZEITALARM", 10, 8),
    ("DELINT", 20, 4),
    ("TIMEDELAYINTERRUPT", 20, 4),
    ("VERZÖGERUNGSALARM", 20, 4),
    ("CYCINT", 30, 9),
    ("CYCLICINTERRUPT", 30, 9),
    ("WECKALARM", 30, 9),
    ("HWINT", 40, 8),
    ("HARDWAREINTERRUPT", 40, 8),
    ("PROZESSALARM", 40, 8),
];

/// The number of an organization block by its name.
pub(super) fn number(name: &str) -> Option<u16> {
    let plain: String = name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_uppercase).collect();
    // An organization block may be called by its own address: OB1, OB_35.
    if let Some(digits) = plain.strip_prefix("OB")
        && let Ok(number) = digits.parse::<u16>()
        && number <= 122
    {
        return Some(number);
    }
    if let Some((number, _)) = NAMES.iter().find(|(_, names)| names.contains(&plain.as_str())) {
        return Some(*number);
    }
    // TIA Portal numbers those of SYNC_1 from 1.
    if let Some(n) = plain.strip_prefix("SYNC").and_then(|d| d.parse::<u16>().ok()) {
        return (1..=4).contains(&n).then(|| 60 + n);
    }
    let digits = plain.trim_start_matches(|c: char| !c.is_ascii_digit());
    let word = plain.get(..plain.len() - digits.len())?;
    let at: u16 = digits.parse().ok()?;
    let (_, first, count) = SERIES.iter().find(|(known, ..)| *known == word)?;
    (at < *count).then(|| first + at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_names_tell_their_number() {
        for (name, expected) in [
            ("Main", 1),
            ("Cycle Execution", 1),
            ("CYCL_EXC", 1),
            ("Startup", 100),
            ("COMPLETE RESTART", 100),
            ("Complete Restart", 100),
            ("Cyclic interrupt", 30),
            ("CYC_INT5", 35),
            ("Weckalarm 5", 35),
            ("OBNL_FLT", 85),
            ("I/O_FLT1", 82),
            ("Diagnostic error interrupt", 82),
            ("Rack or station failure", 86),
            ("PROG_ERR", 121),
            ("MOD_ERR", 122),
            ("I/O access error", 122),
            ("HW_INT0", 40),
            ("OB_35", 35),
            ("SYNC_1", 61),
            ("Verzögerungsalarm", 20),
        ] {
            assert_eq!(number(name), Some(expected), "{name}");
        }
        for name in ["Main_1", "Pump", "CYC_INT9", "OB999", "", "7"] {
            assert_eq!(number(name), None, "{name}");
        }
    }
}
