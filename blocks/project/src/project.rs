//! A project: its programs, block folders, symbol tables, sources and stations.

use crate::dbf::Table;
use crate::folder::Folder;
use crate::hardware::{self, Hardware};
use crate::links::{self, Links};
use crate::note::{Note, Notes};
use crate::sources::{self, SourceText};
use crate::symbols::{self, SymbolRow};
use crate::text::CodePage;
use crate::tree::{Root, Tree};

/// An S7 program of a project.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Program {
    /// Its ID in the project.
    pub id: i64,
    /// Its name: `S7 Program(1)`.
    pub name: String,
    /// The ID of its block folder.
    pub folder: Option<u32>,
    /// The ID of its symbol list.
    pub symbols: Option<i64>,
    /// The ID of its source container.
    pub sources: Option<u32>,
    /// The CPU it belongs to, as an index into the CPUs of [`Hardware`].
    pub cpu: Option<usize>,
}

/// A block folder of a project.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BlockFolder {
    /// Its ID in the tables of the project.
    pub id: u32,
    /// Its name: `Blocks`, `Bausteine`.
    pub name: String,
    /// Its path in the tree, with a `/` at its end.
    pub path: String,
    /// Number of code blocks and data blocks the project counts in it; those there are where it counts none.
    pub blocks: u32,
}

/// A project or library.
#[derive(Debug, Default)]
pub struct Project {
    /// Name of the project or library.
    pub name: String,
    /// The code page of its texts.
    pub page: CodePage,
    /// The S7 programs that it has.
    pub programs: Vec<Program>,
    /// The block folders that it has.
    pub folders: Vec<BlockFolder>,
    /// Its stations, CPUs and modules.
    pub hardware: Hardware,
    /// What there is to say.
    pub notes: Notes,
    folder: String,
}

/// What a name chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The program; `None` for a block folder no program names.
    pub program: Option<usize>,
    /// The block folder, as an index into [`Project::folders`].
    pub folder: usize,
}

impl Project {
    /// Reads what a project says of itself. Damage is noted; what is left is read.
    pub fn read(tree: &Tree<'_>, root: &Root) -> Self {
        Self::read_as(tree, root, None)
    }

    /// The same, with the code page of its texts where somebody knows better than the project.
    pub fn read_as(tree: &Tree<'_>, root: &Root, page: Option<CodePage>) -> Self {
        let folder = root.folder.clone();
        let path = |name: &str| format!("{folder}{name}");
        let mut project = Project { folder: folder.clone(), ..Project::default() };
        let told = tree.read(&path("Global/Language")).map(|bytes| CodePage::of_language(&bytes));
        match page.map(|page| Some(Some(page))).unwrap_or(told) {
            Some(Some(page)) => project.page = page,
            Some(None) => project.notes.push(Note::warning(
                path("Global/Language"),
                "it names no ANSI code page that is known; texts are read as 1252",
            )),
            None => project.notes.push(Note::info(path("Global/Language"), "it is missing; texts are read as 1252")),
        }
        project.name = name_of(tree, root, project.page);
        project.block_folders(tree);
        project.hardware = hardware::read(tree, &folder, project.page, &mut project.notes);
        project.read_programs(tree);
        project
    }

    fn block_folders(&mut self, tree: &Tree<'_>) {
        let base = format!("{}ombstx/offline/", self.folder);
        let page = self.page;
        let mut listed = Vec::new();
        if let Some(table) = self.table(tree, "ombstx/offline/BSTCNTOF.DBF") {
            for row in table.rows() {
                let Ok(id) = u32::try_from(row.number("ID")) else { continue };
                let count = |field| u32::try_from(row.number(field)).unwrap_or(0);
                let counts = ["ANZOB", "ANZFC", "ANZFB", "ANZDB"].iter().fold(0u32, |n, f| n.saturating_add(count(f)));
                listed.push((id, page.text(row.trimmed("NAME")), counts));
            }
        }
        for part in tree.list(&base) {
            let Some(id) = (part.len() == 8).then(|| u32::from_str_radix(&part, 16).ok()).flatten() else { continue };
            let path = format!("{base}{part}/");
            if !tree.has(&format!("{path}SUBBLK.DBF")) && !tree.has(&format!("{path}BAUSTEIN.DBF")) {
                continue;
            }
            let row = listed.iter().find(|(listed, ..)| *listed == id);
            let (name, blocks) = row.map_or((String::new(), 0), |(_, name, blocks)| (name.clone(), *blocks));
            // A list that is missing, old or not up to date counts nothing.
            let blocks = if blocks == 0 { Folder::count(tree, &path) } else { blocks };
            self.folders.push(BlockFolder { id, name, path, blocks });
        }
        for (id, name, _) in listed.iter().filter(|(id, ..)| !self.folders.iter().any(|f| f.id == *id)) {
            self.notes.push(Note::warning(format!("{base}{id:08x}"), format!("the block folder {name} is missing")));
        }
    }

    fn read_programs(&mut self, tree: &Tree<'_>) {
        let Some(table) = self.table(tree, "hrs/S7RESOFF.DBF") else { return };
        let links = tree.read(&format!("{}hrs/linkhrs.lnk", self.folder));
        if links.is_none() {
            let what = "it is missing: programs are matched to block folders by what is left";
            self.notes.push(Note::warning(format!("{}hrs/linkhrs.lnk", self.folder), what));
        }
        let lists = self.table(tree, "YDBs/YLNKLIST.DBF");
        for row in table.rows() {
            let id = row.number("ID");
            let link = links.as_deref().map_or_else(Links::default, |l| links::read(l, row.number("RSRVD4_L")));
            let listed = lists.as_ref().and_then(|table| symbols::list_of_program(table, id));
            self.programs.push(Program {
                id,
                name: self.page.text(row.trimmed("NAME")),
                folder: link.folder.filter(|folder| self.folders.iter().any(|f| f.id == *folder)),
                symbols: listed.or(link.symbols),
                sources: link.sources,
                cpu: self.hardware.cpus.iter().position(|cpu| cpu.program == Some(id)),
            });
        }
        self.only_way();
    }

    /// Where no link is left, one program and one folder with blocks belong together.
    fn only_way(&mut self) {
        let taken: Vec<u32> = self.programs.iter().filter_map(|p| p.folder).collect();
        let free: Vec<u32> =
            self.folders.iter().filter(|f| f.blocks > 0 && !taken.contains(&f.id)).map(|f| f.id).collect();
        let mut open: Vec<&mut Program> = self.programs.iter_mut().filter(|p| p.folder.is_none()).collect();
        if let ([folder], [program]) = (free.as_slice(), open.as_mut_slice()) {
            program.folder = Some(*folder);
            let what = "it has no link to a block folder; the one folder with blocks that is left is taken";
            self.notes.push(Note::warning(program.name.clone(), what));
        }
    }

    fn table(&mut self, tree: &Tree<'_>, name: &str) -> Option<Table> {
        let path = format!("{}{name}", self.folder);
        let Some(bytes) = tree.read(&path) else {
            let why = tree.why_not(&path);
            self.notes.push(Note::warning(path, why));
            return None;
        };
        match Table::parse(bytes) {
            Ok(table) => {
                self.notes.extend(table.cut_off().map(|what| Note::warning(path, what)));
                Some(table)
            }
            Err(damage) => {
                self.notes.push(Note::warning(path, damage.to_string()));
                None
            }
        }
    }

    /// All that can be imported: programs with a block folder, then the folders no program names.
    pub fn choices(&self) -> Vec<Choice> {
        let index = |id: u32| self.folders.iter().position(|f| f.id == id);
        let programs = self.programs.iter().enumerate();
        let mut choices: Vec<Choice> =
            programs.filter_map(|(i, p)| Some(Choice { program: Some(i), folder: index(p.folder?)? })).collect();
        for folder in 0..self.folders.len() {
            if !choices.iter().any(|choice| choice.folder == folder) {
                choices.push(Choice { program: None, folder });
            }
        }
        choices
    }

    /// The station, the CPU and the program of a choice, for people: `Plant/CPU 315-2 DP/S7 Program(1)`. Programs of
    /// the same name, as they are without their stations, have their block folders in it.
    pub fn title(&self, choice: Choice) -> String {
        let folder = &self.folders[choice.folder];
        let Some(program) = choice.program.and_then(|i| self.programs.get(i)) else {
            return format!("{:08x} ({})", folder.id, folder.name);
        };
        let title = self.title_of(program);
        let same = |other: &&Program| other.folder.is_some() && self.title_of(other) == title;
        if self.programs.iter().filter(same).count() > 1 { format!("{title} ({:08x})", folder.id) } else { title }
    }

    fn title_of(&self, program: &Program) -> String {
        match program.cpu.and_then(|i| self.hardware.cpus.get(i)) {
            Some(cpu) if !cpu.station.is_empty() => format!("{}/{}/{}", cpu.station, cpu.name, program.name),
            Some(cpu) => format!("{}/{}", cpu.name, program.name),
            None => program.name.clone(),
        }
    }

    /// The choices a name stands for: a program's name, its CPU's or its station's, `STATION/CPU/PROGRAM`, the ID of
    /// the block folder.
    pub fn named(&self, name: &str) -> Vec<Choice> {
        let wanted = name.trim();
        let same = |text: &str| text.to_lowercase() == wanted.to_lowercase();
        let id = u32::from_str_radix(wanted, 16).ok();
        let choices = self.choices();
        let by = |test: &dyn Fn(&Choice) -> bool| choices.iter().copied().filter(|c| test(c)).collect::<Vec<_>>();
        let program = |c: &Choice| c.program.and_then(|i| self.programs.get(i));
        let cpu = |c: &Choice| program(c).and_then(|p| self.hardware.cpus.get(p.cpu?));
        for found in [
            by(&|c| same(&self.title(*c))),
            by(&|c| program(c).is_some_and(|p| same(&p.name))),
            by(&|c| cpu(c).is_some_and(|cpu| same(&cpu.name) || same(&cpu.station))),
            by(&|c| self.folders.get(c.folder).is_some_and(|f| Some(f.id) == id)),
        ] {
            if !found.is_empty() {
                return found;
            }
        }
        Vec::new()
    }

    /// What is taken when no name is given: the program with blocks that belongs to a CPU; else the one that has
    /// blocks; else the block folder that has some. If there are several, all of them come back.
    pub fn default_choice(&self) -> Vec<Choice> {
        let with_blocks = |c: &Choice| self.folders.get(c.folder).is_some_and(|f| f.blocks > 0);
        let of_cpu = |c: &Choice| with_blocks(c) && c.program.and_then(|i| self.programs.get(i)?.cpu).is_some();
        let of_program = |c: &Choice| with_blocks(c) && c.program.is_some();
        let choices = self.choices();
        let of = |test: &dyn Fn(&Choice) -> bool| choices.iter().copied().filter(|c| test(c)).collect::<Vec<_>>();
        let kinds = [of(&of_cpu), of(&of_program), of(&with_blocks)];
        let found = kinds.into_iter().find(|found| !found.is_empty());
        // Where nothing has blocks, the reason is told of the first.
        found.unwrap_or_else(|| choices.first().copied().into_iter().collect())
    }

    /// Reads the blocks of a choice.
    ///
    /// # Errors
    /// Why nothing can be read, in one sentence.
    pub fn blocks(&self, tree: &Tree<'_>, choice: Choice) -> Result<Folder, String> {
        Folder::read(tree, &self.folders[choice.folder].path, self.page)
    }

    /// Reads the symbols of a choice.
    #[must_use]
    pub fn symbols(&self, tree: &Tree<'_>, choice: Choice, notes: &mut Notes) -> Vec<SymbolRow> {
        let list = choice.program.and_then(|i| self.programs.get(i)?.symbols);
        let list = list.or_else(|| self.only_list(tree, notes));
        list.map(|list| symbols::read(tree, &self.folder, list, self.page, notes)).unwrap_or_default()
    }

    /// The only symbol table, where no program has a link to one.
    fn only_list(&self, tree: &Tree<'_>, notes: &mut Notes) -> Option<i64> {
        if self.programs.iter().any(|program| program.symbols.is_some()) {
            return None;
        }
        let (list, what) = match symbols::all(tree, &self.folder, self.page).as_slice() {
            [] => return None,
            [list] => (Some(*list), "no program has a link to it; the only symbol table is taken".to_owned()),
            lists => (None, format!("{} symbol tables, and no link names their programs: none is taken", lists.len())),
        };
        notes.push(Note::warning(format!("{}YDBs", self.folder), what));
        list
    }

    /// Reads the source texts of a choice.
    pub fn sources(&self, tree: &Tree<'_>, choice: Choice) -> Vec<SourceText> {
        let container = choice.program.and_then(|i| self.programs.get(i)?.sources);
        container.map(|id| sources::read(tree, &self.folder, id, self.page)).unwrap_or_default()
    }
}

/// The name in a `.s7p`: after four NULs and a length. Where that gives nothing, the name of the file.
fn name_of(tree: &Tree<'_>, root: &Root, page: CodePage) -> String {
    let bytes = root.file.as_ref().and_then(|file| tree.read(file)).unwrap_or_default();
    let length = bytes.get(4).map_or(0, |length| usize::from(*length));
    let name = bytes.get(5..5 + length).filter(|name| !name.is_empty() && bytes[..4] == [0; 4]);
    let name = name.map(|name| page.text(name)).filter(|name| !name.chars().any(char::is_control));
    let stem = |path: &str| {
        let file = path.rsplit('/').next().unwrap_or(path);
        file.rsplit_once('.').map_or(file, |(stem, _)| stem).to_owned()
    };
    name.or_else(|| root.file.as_deref().map(stem)).unwrap_or_else(|| stem(root.folder.trim_end_matches('/')))
}
