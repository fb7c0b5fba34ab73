//! The names that STEP 7 and TIA Portal give to organization blocks by themselves, German and English.

/// Names without blanks and signs, in capitals, and the number. The first group is that of the symbols in STEP 7's
/// library "Organization Blocks", the others are titles of its and TIA Portal's dialogs.
const NAMES: &[(&str, u16)] = &[
    ("CYCLEXC", 1),
    ("STATUSALARM", 55),
    ("UPDATEALARM", 56),
    ("MANUFACTUREALARM", 57),
    ("MULTIINT", 60),
    ("IOREDFLT", 70),
    ("CPUREDFLT", 72),
    ("COMREDFLT", 73),
    ("CYCLFLT", 80),
    ("PSFLT", 81),
    ("IOFLT1", 82),
    ("IOFLT2", 83),
    ("CPUFLT", 84),
    ("OBNLFLT", 85),
    ("RACKFLT", 86),
    ("COMMFLT", 87),
    ("BPREXC", 88),
    ("BACKCYC", 90),
    ("BACKGROUND", 90),
    ("COMPLETERESTART", 100),
    ("RESTART", 101),
    ("COLDRESTART", 102),
    ("PROGERR", 121),
    ("MODERR", 122),
    // English titles
    ("MAIN", 1),
    ("CYCLEEXECUTION", 1),
    ("MAINPROGRAM", 1),
    ("MAINPROGRAMSWEEP", 1),
    ("PROGRAMCYCLE", 1),
    ("TIMEOFDAY", 10),
    ("TIMEOFDAYINTERRUPT", 10),
    ("TIMEDELAYINTERRUPT", 20),
    ("CYCLICINTERRUPT", 30),
    ("HARDWAREINTERRUPT", 40),
    ("STATUS", 55),
    ("STATUSINTERRUPT", 55),
    ("UPDATE", 56),
    ("UPDATEINTERRUPT", 56),
    ("PROFILE", 57),
    ("MANUFACTURERSPECIFICINTERRUPT", 57),
    ("MULTICOMPUTINGINTERRUPT", 60),
    ("SYNCHRONOUSCYCLE", 61),
    ("IOREDUNDANCYERROR", 70),
    ("IOREDUNDANCYFAULT", 70),
    ("CPUREDUNDANCYERROR", 72),
    ("CPUREDUNDANCYFAULT", 72),
    ("COMMUNICATIONREDUNDANCYERROR", 73),
    ("TIMEERROR", 80),
    ("TIMEERRORINTERRUPT", 80),
    ("CYCLETIMEFAULT", 80),
    ("POWERSUPPLYERROR", 81),
    ("POWERSUPPLYFAULT", 81),
    ("DIAGNOSTIC", 82),
    ("DIAGNOSTICERROR", 82),
    ("DIAGNOSTICINTERRUPT", 82),
    ("DIAGNOSTICERRORINTERRUPT", 82),
    ("IOPOINTFAULT1", 82),
    ("PULLORPLUGOFMODULES", 83),
    ("PULLPLUGINTERRUPT", 83),
    ("INSERTREMOVEMODULEINTERRUPT", 83),
    ("IOPOINTFAULT2", 83),
    ("CPUFAULT", 84),
    ("CPUHARDWAREFAULT", 84),
    ("PRIORITYCLASSERROR", 85),
    ("PROGRAMEXECUTIONERROR", 85),
    ("OBNOTLOADEDFAULT", 85),
    ("RACKERROR", 86),
    ("RACKFAILURE", 86),
    ("RACKORSTATIONFAILURE", 86),
    ("LOSSOFRACKFAULT", 86),
    ("COMMUNICATIONERROR", 87),
    ("COMMUNICATIONFAULT", 87),
    ("PROCESSINGINTERRUPT", 88),
    ("BACKGROUNDCYCLE", 90),
    ("MCSERVO", 91),
    ("MCINTERPOLATOR", 92),
    ("STARTUP", 100),
    ("WARMRESTART", 100),
    ("HOTRESTART", 101),
    ("PROGRAMMINGERROR", 121),
    ("IOACCESSERROR", 122),
    ("MODULEACCESSERROR", 122),
    // German titles
    ("HAUPTPROGRAMM", 1),
    ("ZYKLUS", 1),
    ("ZYKLISCHESPROGRAMM", 1),
    ("ZYKLISCHEPROGRAMMBEARBEITUNG", 1),
    ("UHRZEITALARM", 10),
    ("VERZÖGERUNGSALARM", 20),
    ("WECKALARM", 30),
    ("PROZESSALARM", 40),
    ("STATUSALARM", 55),
    ("UPDATEALARM", 56),
    ("HERSTELLERSPEZIFISCHERALARM", 57),
    ("MULTICOMPUTINGALARM", 60),
    ("TAKTSYNCHRONALARM", 61),
    ("PERIPHERIEREDUNDANZFEHLER", 70),
    ("CPUREDUNDANZFEHLER", 72),
    ("KOMMUNIKATIONSREDUNDANZFEHLER", 73),
    ("ZEITFEHLER", 80),
    ("ZYKLUSZEITFEHLER", 80),
    ("STROMVERSORGUNGSFEHLER", 81),
    ("DIAGNOSEALARM", 82),
    ("DIAGNOSEFEHLER", 82),
    ("ZIEHENSTECKENALARM", 83),
    ("ZIEHENSTECKENVONBAUGRUPPEN", 83),
    ("CPUHARDWAREFEHLER", 84),
    ("PROGRAMMABLAUFFEHLER", 85),
    ("BAUGRUPPENTRÄGERAUSFALL", 86),
    ("BAUGRUPPENTRÄGERODERSTATIONSAUSFALL", 86),
    ("KOMMUNIKATIONSFEHLER", 87),
    ("BEARBEITUNGSABBRUCH", 88),
    ("HINTERGRUNDZYKLUS", 90),
    ("ANLAUF", 100),
    ("NEUSTART", 100),
    ("NEUSTARTWARMSTART", 100),
    ("WARMSTART", 100),
    ("WIEDERANLAUF", 101),
    ("KALTSTART", 102),
    ("PROGRAMMIERFEHLER", 121),
    ("PERIPHERIEZUGRIFFSFEHLER", 122),
    ("ZUGRIFFSFEHLER", 122),
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
    if let Some((_, number)) = NAMES.iter().find(|(known, _)| *known == plain) {
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
