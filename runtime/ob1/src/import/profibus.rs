//! DP slaves of a project as `[[bus]]` and `[[module]]`. A project does not hold the GSD files of its slaves, and only
//! they tell a slave's ident number. So the files it was made with are given to the import; otherwise the tables stay
//! comments and the slaves' bytes are plain inputs and outputs.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use ob1_dp::gsd::{Gsd, Parameters, Wanted};
use ob1_dp::master::least_slot_bits;
use ob1_project::{Area, DpSlave, DpSystem, Module, Note, Notes};

use super::hardware::{Hardware, merged};
use super::names::{GSD, clean, line, unique};

/// Baud rates in the order in which they are tried: the project's own is not read.
const BAUDS: [u32; 7] = [500_000, 187_500, 93_750, 19_200, 9600, 45_450, 1_500_000];
/// The address of the CPU's own interface, where no slave has it.
const MASTER: u8 = 2;
/// What a slot time has beyond the slowest answer, in bits.
const SLOT_MARGIN: u16 = 15;
/// Beginning of the name of a CP that has its slaves for itself.
const CP_342_5: &str = "CP 342-5";

/// GSD files that were given.
#[derive(Default)]
pub(super) struct GsdFiles(Vec<(String, Vec<u8>, Gsd)>);

impl GsdFiles {
    /// All GSD files of a folder; those that cannot be read are reported.
    pub(super) fn read(folder: &Path, notes: &mut Notes) -> Result<Self, String> {
        let refused = |error: std::io::Error| format!("{}: {error}", folder.display());
        let mut names: Vec<std::path::PathBuf> =
            std::fs::read_dir(folder).map_err(refused)?.flatten().map(|entry| entry.path()).collect();
        names.sort();
        let mut files = Vec::new();
        for path in names {
            let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
            let is_gsd = extension.len() == 3 && extension.starts_with("gs");
            let (true, Some(name)) = (is_gsd, path.file_name().and_then(|name| name.to_str())) else { continue };
            let bytes = ob1_process::files::read(&path, ob1_process::files::LONGEST)
                .map_err(|error| format!("{}: {error}", path.display()))?;
            match Gsd::read(&bytes) {
                Ok(gsd) => files.push((name.to_owned(), bytes, gsd)),
                Err(why) => notes.push(Note::warning(name, format!("it is not a valid GSD file: {why}"))),
            }
        }
        Ok(Self(files))
    }
}

/// The slaves of a project in the station file.
#[derive(Default)]
pub(super) struct Slaves {
    /// Tables of the station file.
    pub(super) text: String,
    /// Names used in these tables; each is given once.
    pub(super) names: BTreeSet<String>,
    /// Files they need: path below the station, content.
    pub(super) files: Vec<(String, Vec<u8>)>,
    /// Modules that are not plain inputs and outputs: where they are, and their areas.
    taken: Vec<Taken>,
    /// Diagnostic addresses that are given.
    diagnostics: BTreeSet<u16>,
    /// Addresses of CPs that have tables.
    cps: Vec<u32>,
}

/// A module of a slave.
struct Taken {
    at: (i64, i64),
    inputs: Vec<Area>,
    outputs: Vec<Area>,
    /// Behind a CP they are places in its areas.
    in_cpu: bool,
}

/// A slot of a slave.
struct Slot {
    /// Its name in the GSD file; without that file, what the project calls it.
    module: String,
    inputs: Vec<Area>,
    outputs: Vec<Area>,
}

/// A slave as tables.
struct Made<'a> {
    slave: &'a DpSlave,
    slots: Vec<Slot>,
    /// Which of the GSD files.
    gsd: Option<usize>,
}

impl Slaves {
    /// The slaves of the master systems of a station.
    pub(super) fn of(hardware: &Hardware, gsds: &GsdFiles, notes: &mut Notes) -> Self {
        let mut all = Self::default();
        for system in hardware.dp.iter().filter(|system| !system.slaves.is_empty()) {
            all.system(system, hardware, gsds, notes);
        }
        all
    }

    /// Whether a module has a table of its own here; if so, whether it has its addresses in the CPU.
    pub(super) fn has(&self, module: &Module) -> Option<bool> {
        let (rack, slot, _) = module.place;
        if module.name.starts_with(CP_342_5) && module.inputs.iter().any(|area| self.cps.contains(&area.first)) {
            return Some(true);
        }
        let is = |taken: &&Taken| {
            taken.at == (rack, slot) && taken.inputs == module.inputs && taken.outputs == module.outputs
        };
        self.taken.iter().find(is).map(|taken| taken.in_cpu)
    }

    fn system(&mut self, system: &DpSystem, hardware: &Hardware, gsds: &GsdFiles, notes: &mut Notes) {
        let behind_cp = system.master.starts_with(CP_342_5);
        let mut made = Vec::new();
        for slave in &system.slaves {
            let found = find(slave, gsds);
            let who = format!("DP slave {} ({})", slave.address, line(&slave.name));
            let gsd = match found {
                Ok(gsd) => Some(gsd),
                Err(why) => {
                    let until = match behind_cp {
                        true => "it is behind a CP 342-5: DP_RECV does not read it",
                        false => "its bytes are plain inputs and outputs, its tables are comments in station.toml",
                    };
                    notes.push(Note::warning(who, format!("{why}; {until}")));
                    None
                }
            };
            if gsd.is_some() || behind_cp {
                let of = |module: &ob1_project::DpModule| Taken {
                    at: (i64::from(slave.address), module.slot),
                    inputs: module.inputs.clone(),
                    outputs: module.outputs.clone(),
                    in_cpu: !behind_cp,
                };
                self.taken.extend(slave.modules.iter().map(of));
            }
            let slots = slots(slave, gsd.and_then(|gsd| gsds.0.get(gsd)).map(|(_, _, gsd)| gsd));
            made.push(Made { slave, slots, gsd });
        }
        let name = self.name(&system.name);
        let found: Vec<&Made<'_>> = made.iter().filter(|made| made.gsd.is_some()).collect();
        let gsd_of = |made: &&Made<'_>| made.gsd.and_then(|gsd| gsds.0.get(gsd)).map(|(_, _, gsd)| gsd);
        let can = |baud: &&u32| found.iter().filter_map(gsd_of).all(|gsd| gsd.answer_bits(**baud).is_some());
        let baud = BAUDS.iter().find(can).copied().unwrap_or(BAUDS[0]);
        let answer = found.iter().filter_map(gsd_of).filter_map(|gsd| gsd.answer_bits(baud)).max().unwrap_or(0);
        let addresses: Vec<u8> = system.slaves.iter().map(|slave| slave.address).collect();
        let free = [MASTER].into_iter().chain(0..=125).find(|address| !addresses.contains(address));
        let mut text =
            format!("# {}, master {}\n[[bus]]\nname = \"{name}\"\n", line(&system.name), line(&system.master));
        let _ = writeln!(text, "type = \"dp\"\nline = \"sim:{name}\"\nbaud = {baud}\naddress = {}", free.unwrap_or(0));
        if answer.saturating_add(SLOT_MARGIN) > least_slot_bits(baud) {
            let _ = writeln!(text, "slot_bits = {}", answer.saturating_add(SLOT_MARGIN));
        }
        let _ = writeln!(text, "\n[[simulated_line]]\nname = \"{name}\"\nduplex = \"half\"");
        let cp = behind_cp.then(|| hardware.modules.iter().find(|m| m.name == system.master)).flatten();
        if let Some(area) = cp.and_then(|cp| cp.inputs.first()) {
            let cp = self.name("cp342-5");
            let _ = writeln!(
                text,
                "\n[[module]]\ntype = \"cp342-5\"\nname = \"{cp}\"\nbus = \"{name}\"\naddress = {}",
                area.first
            );
            if !found.is_empty() {
                self.cps.push(area.first);
            }
        }
        let is_alive = !found.is_empty();
        if is_alive {
            let what = format!(
                "{} of {} slaves are on the bus {name}: its line (simulated, nobody is on it), baud rate and master address are \
                 made up; set `line`, `baud` and `address`",
                found.len(),
                made.len()
            );
            notes.push(Note::warning(name.clone(), what));
        }
        self.text.push('\n');
        self.put(&text, is_alive);
        for made in &made {
            let diagnostic = made.slave.diagnostic.filter(|address| {
                let areas = hardware.modules.iter().flat_map(|module| &module.inputs);
                let is_free = areas.clone().all(|a| !(a.first..a.first + a.bytes).contains(&u32::from(*address)));
                !behind_cp && (1..=16_383).contains(address) && is_free && self.diagnostics.insert(*address)
            });
            let table = self.table(made, &name, diagnostic, gsds);
            self.put(&format!("\n{table}"), made.gsd.is_some());
        }
    }

    /// Puts a table into the file; one that cannot be used yet as a comment.
    fn put(&mut self, text: &str, is_alive: bool) {
        for line in text.lines() {
            let mark = if is_alive || line.is_empty() || line.starts_with('#') { "" } else { "# " };
            let _ = writeln!(self.text, "{mark}{line}");
        }
    }

    fn table(&mut self, made: &Made<'_>, bus: &str, diagnostic: Option<u16>, gsds: &GsdFiles) -> String {
        let slave = made.slave;
        let name = self.name(&format!("{bus}-{}", slave.address));
        let file = made.gsd.and_then(|gsd| gsds.0.get(gsd)).map(|(file, bytes, _)| (file.clone(), bytes));
        let path =
            file.as_ref().map_or_else(|| "the GSD file of its maker".to_owned(), |(file, _)| format!("{GSD}/{file}"));
        let mut text =
            format!("# {}\n[[module]]\ntype = \"coupler\"\nbus = \"{bus}\"\nname = \"{name}\"\n", line(&slave.name));
        let _ = writeln!(text, "station = {}\ngsd = \"{path}\"", slave.address);
        if let Some(diagnostic) = diagnostic {
            let _ = writeln!(text, "diagnostic = {diagnostic}");
        }
        if !slave.parameters.is_empty() {
            let _ = writeln!(text, "raw = \"{}\"", crate::units::hex(&slave.parameters));
        }
        text.push_str("slots = [\n");
        for (slot, number) in made.slots.iter().zip(1..) {
            let _ = write!(text, "    {{ slot = {number}, module = {}", quoted(&slot.module));
            for (key, word, areas) in [("inputs", "EB", &slot.inputs), ("outputs", "AB", &slot.outputs)] {
                if let Some(area) = areas.first() {
                    let _ = write!(text, ", {key} = \"{word} {}\"", area.first);
                }
            }
            text.push_str(" },\n");
        }
        text.push_str("]\n");
        if let Some((file, bytes)) = file
            && !self.files.iter().any(|(path, _)| *path == format!("{GSD}/{file}"))
        {
            self.files.push((format!("{GSD}/{file}"), bytes.clone()));
        }
        text
    }

    fn name(&mut self, wanted: &str) -> String {
        match clean(wanted, 24).as_str() {
            "" => unique(&mut self.names, "profibus"),
            wanted => unique(&mut self.names, wanted),
        }
    }
}

/// The slots of a slave, numbered from 1 as they come; a module that continues in a further slot is one.
fn slots(slave: &DpSlave, gsd: Option<&Gsd>) -> Vec<Slot> {
    let mut slots: Vec<Slot> = Vec::new();
    for module in &slave.modules {
        if let Some(last) = slots.last_mut().filter(|_| module.goes_on) {
            last.inputs = merged(last.inputs.iter().chain(&module.inputs).copied());
            last.outputs = merged(last.outputs.iter().chain(&module.outputs).copied());
            continue;
        }
        let wanted = if module.gsd.is_empty() { &module.order } else { &module.gsd };
        let known = gsd.and_then(|gsd| named(gsd, wanted, module.gsd.is_empty()));
        let said = if wanted.is_empty() { &module.name } else { wanted };
        slots.push(Slot {
            module: known.unwrap_or_else(|| line(said)),
            inputs: merged(module.inputs.iter().copied()),
            outputs: merged(module.outputs.iter().copied()),
        });
    }
    slots
}

/// A module of a GSD file: by its name, blanks aside; one of STEP 7's own catalogue by the order number it begins with.
fn named(gsd: &Gsd, wanted: &str, is_order: bool) -> Option<String> {
    let plain = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let wanted = plain(wanted);
    let fits = |name: &&str| if is_order { plain(name).starts_with(&wanted) } else { plain(name) == wanted };
    gsd.modules().filter(|_| !wanted.is_empty()).find(fits).map(str::to_owned)
}

/// The GSD file that a slave was made with: all its modules are in it, with the bytes that they have.
fn find(slave: &DpSlave, gsds: &GsdFiles) -> Result<usize, String> {
    if gsds.0.is_empty() {
        return Err("the project does not hold its GSD file: give the folder of GSD files with --gsd".into());
    }
    if slave.modules.is_empty() {
        return Err("it has no modules".into());
    }
    let mut why = String::new();
    for (n, (file, _, gsd)) in gsds.0.iter().enumerate() {
        let all = slots(slave, Some(gsd));
        if !all.iter().all(|slot| gsd.modules().any(|name| name == slot.module)) {
            continue;
        }
        match fits(slave, gsd, &all) {
            Ok(()) => return Ok(n),
            Err(other) => why = format!(" ({file}: {other})"),
        }
    }
    Err(format!("none of the {} GSD files has all its modules{why}", gsds.0.len()))
}

/// Whether the bytes of each slot are those that the project has for it.
fn fits(slave: &DpSlave, gsd: &Gsd, slots: &[Slot]) -> Result<(), String> {
    let wanted: Vec<Wanted> =
        slots.iter().map(|slot| Wanted { module: slot.module.clone(), ..Wanted::default() }).collect();
    let own =
        if slave.parameters.is_empty() { Parameters::default() } else { Parameters::Raw(slave.parameters.clone()) };
    let made = gsd.slave(&wanted, &own).map_err(|mistake| mistake.message)?;
    for (slot, placed) in slots.iter().zip(&made.slots) {
        for (what, areas, bytes) in
            [("inputs", &slot.inputs, placed.inputs), ("outputs", &slot.outputs, placed.outputs)]
        {
            let own: u32 = areas.iter().map(|area| area.bytes).sum();
            if areas.len() > 1 {
                return Err(format!("the {what} of \"{}\" are in more than one place", slot.module));
            }
            if own as usize != bytes {
                return Err(format!("\"{}\" has {bytes} bytes of {what}, and the project has {own}", slot.module));
            }
        }
    }
    Ok(())
}

/// A text of TOML.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use ob1_project::DpModule;

    use super::*;

    /// Two modules in turn, the second with two identifiers in two slots.
    const TEXT: &str = "#Profibus_DP\nGSD_Revision = 1\nVendor_Name = \"ob1\"\nModel_Name = \"Four\"\nIdent_Number = 0x7F04\n\
        93.75_supp = 1\nMaxTsdr_93.75 = 400\nModular_Station = 1\nMax_Module = 4\nMax_Diag_Data_Len = 16\nMax_Input_Len = 8\n\
        Max_Output_Len = 8\nMax_Data_Len = 16\nUser_Prm_Data_Len = 1\nUser_Prm_Data = 0x01\n\
        Module = \"4 in\" 0x13\nEndModule\nModule = \"6ES7 322-1BH01-0AA0 16DO\" 0x21\nEndModule\n\
        Module = \"par + 2 in\" 0x00,0x11\nEndModule\n";

    fn gsds() -> GsdFiles {
        GsdFiles(vec![("FOUR.GSD".into(), TEXT.as_bytes().to_vec(), Gsd::read(TEXT.as_bytes()).expect("a GSD file"))])
    }

    fn module(slot: i64, gsd: &str, order: &str, inputs: &[(u32, u32)], outputs: &[(u32, u32)]) -> DpModule {
        let areas =
            |all: &[(u32, u32)]| all.iter().map(|(first, bytes)| Area { first: *first, bytes: *bytes }).collect();
        let (gsd, order) = (gsd.to_owned(), order.to_owned());
        DpModule { slot, gsd, order, inputs: areas(inputs), outputs: areas(outputs), ..DpModule::default() }
    }

    fn slave(modules: Vec<DpModule>) -> DpSlave {
        DpSlave { name: "four".into(), address: 5, parameters: vec![0xC0, 0x01], diagnostic: Some(2046), modules }
    }

    fn good() -> Vec<DpModule> {
        vec![
            module(4, "4 in", "", &[(10, 4)], &[]),
            module(5, "", "6ES7 322-1BH01-0AA", &[], &[(20, 2)]),
            module(6, "par + 2  in", "", &[], &[]),
            DpModule { goes_on: true, ..module(7, "par + 2 in", "", &[(14, 2)], &[]) },
        ]
    }

    #[test]
    fn a_gsd_file_is_that_of_a_slave_when_all_its_modules_are_in_it_with_their_bytes() {
        assert_eq!(find(&slave(good()), &gsds()), Ok(0));
        let changed = |n: usize, module: DpModule| {
            let mut modules = good();
            modules[n] = module;
            find(&slave(modules), &gsds()).expect_err("another file")
        };
        assert!(changed(0, module(4, "5 in", "", &[(10, 4)], &[])).contains("none of the 1 GSD files"));
        assert!(
            changed(0, module(4, "4 in", "", &[(10, 3)], &[])).contains("has 4 bytes of inputs, and the project has 3")
        );
        assert!(changed(0, module(4, "4 in", "", &[(10, 2), (20, 2)], &[])).contains("in more than one place"));
        assert!(changed(1, module(5, "", "", &[], &[(20, 2)])).contains("none of the 1"));
        assert!(find(&slave(Vec::new()), &gsds()).is_err() && find(&slave(good()), &GsdFiles::default()).is_err());
    }

    fn hardware(master: &str) -> Hardware {
        let system = DpSystem {
            name: "Bus \"1\"".into(),
            master: master.into(),
            slaves: vec![slave(good())],
            ..DpSystem::default()
        };
        let cp = Module {
            name: "CP 342-5".into(),
            place: (0, 4, 0),
            inputs: vec![Area { first: 256, bytes: 16 }],
            ..Module::default()
        };
        let byte = Module { place: (5, 4, 0), inputs: vec![Area { first: 10, bytes: 4 }], ..Module::default() };
        let racks = Module { place: (5, 4, 0), inputs: vec![Area { first: 90, bytes: 4 }], ..Module::default() };
        Hardware { modules: vec![cp, byte, racks], dp: vec![system], cpu: None }
    }

    #[test]
    fn behind_a_cp_342_5_slaves_have_no_bytes_in_the_cpu() {
        let mut notes = Notes::default();
        let slaves = Slaves::of(&hardware("CP 342-5"), &gsds(), &mut notes);
        let has =
            |hardware: &Hardware, slaves: &Slaves| hardware.modules.iter().map(|m| slaves.has(m)).collect::<Vec<_>>();
        assert_eq!(has(&hardware("CP 342-5"), &slaves), [Some(true), Some(false), None]);
        for part in [
            "type = \"cp342-5\"\nname = \"cp342-5\"\nbus = \"bus-1\"\naddress = 256\n",
            // The only rate the slave has, and a slot time in which it answers.
            "baud = 93750\naddress = 2\nslot_bits = 415\n",
            "station = 5\ngsd = \"gsd/FOUR.GSD\"\nraw = \"C0 01\"\n",
            "    { slot = 2, module = \"6ES7 322-1BH01-0AA0 16DO\", outputs = \"AB 20\" },\n    { slot = 3, module = \"par + 2 in\", inputs = \"EB 14\" },\n",
        ] {
            assert!(slaves.text.contains(part), "{part}\n{}", slaves.text);
        }
        assert_eq!(slaves.files.len(), 1);
        // Without the file they are nowhere, and the CP is the plain module that it was.
        let slaves = Slaves::of(&hardware("CP 342-5"), &GsdFiles::default(), &mut notes);
        assert_eq!(has(&hardware("CP 342-5"), &slaves), [None, Some(false), None]);
        assert!(slaves.text.lines().all(|line| line.is_empty() || line.starts_with('#')), "{}", slaves.text);
        let slaves = Slaves::of(&hardware("CPU 315-2 DP"), &GsdFiles::default(), &mut notes);
        assert_eq!(has(&hardware("CPU 315-2 DP"), &slaves), [None, None, None]);
    }
}
