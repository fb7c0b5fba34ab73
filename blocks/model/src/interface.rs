//! What a block takes and gives.

use crate::{BitAddr, DataType, Field, Layout};

/// The declaration section of a parameter or variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Section {
    /// `VAR_INPUT`: given by the caller.
    Input,
    /// `VAR_OUTPUT`: given to the caller.
    Output,
    /// `VAR_IN_OUT`: given by the caller and changed.
    InOut,
    /// `VAR`: kept in the instance data block.
    Static,
    /// `VAR_TEMP`: local data, undefined at the begin of a call.
    Temp,
    /// The function value, `RET_VAL`.
    Return,
}

impl Section {
    /// Every section, in the order in which an instance lays them out, the local data last.
    pub const ALL: [Self; 6] = [Self::Input, Self::Output, Self::InOut, Self::Return, Self::Static, Self::Temp];

    /// The sections a source declares, each with the word that opens it. The function value is in the block's head.
    pub const WORDS: [(Self, &'static str); 5] = [
        (Self::Input, "VAR_INPUT"),
        (Self::Output, "VAR_OUTPUT"),
        (Self::InOut, "VAR_IN_OUT"),
        (Self::Static, "VAR"),
        (Self::Temp, "VAR_TEMP"),
    ];

    /// The section that a word opens.
    pub fn opened_by(word: &str) -> Option<Self> {
        Self::WORDS.into_iter().find(|(_, opens)| opens.eq_ignore_ascii_case(word)).map(|(section, _)| section)
    }
}

/// One declared parameter or variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Param {
    /// The name as declared; names compare without regard to case.
    pub name: String,
    /// Other spellings the manuals print for the same parameter (`ENDE_KOM`, `ENDE_KOMM`).
    pub aliases: Vec<String>,
    /// Where it is declared.
    pub section: Section,
    /// Its S7 data type.
    pub ty: DataType,
    /// Where it lies: in the instance data block (inputs to statics of an FB), in the local data (temps). Zero for the
    /// parameters of an FC, which are references.
    pub at: BitAddr,
    /// Initial value as laid-out bytes.
    pub initial: Option<Vec<u8>>,
}

impl Param {
    /// A parameter without aliases and initial value.
    pub fn new(name: &str, section: Section, ty: DataType) -> Self {
        Self { name: name.to_owned(), aliases: Vec::new(), section, ty, at: BitAddr(0), initial: None }
    }

    /// True for an in/out parameter of a composed type: a function block keeps a POINTER to the actual in its instance.
    /// What is declared POINTER or ANY is one already, and lies there as it is.
    pub const fn is_pointer(&self) -> bool {
        matches!(self.section, Section::InOut)
            && self.ty.is_composed()
            && !matches!(self.ty, DataType::Pointer | DataType::Any)
    }

    /// Bits of the parameter as a call hands it over: those of a POINTER for a composed in/out of a block with an
    /// instance, else those of its type.
    pub fn passed_bits(&self, has_instance: bool) -> u32 {
        Layout::bits(if has_instance && self.is_pointer() { &DataType::Pointer } else { &self.ty })
    }

    /// True when `name` is this parameter's name or one of its other spellings.
    pub fn is_called(&self, name: &str) -> bool {
        self.name.eq_ignore_ascii_case(name) || self.aliases.iter().any(|a| a.eq_ignore_ascii_case(name))
    }
}

/// A block's interface: parameters in declaration order, then statics and temps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Interface {
    /// All declarations, in their order.
    pub params: Vec<Param>,
    /// Bytes of the instance data block (FB), 0 for others.
    pub instance_bytes: u32,
    /// Bytes of declared local data.
    pub temp_bytes: u32,
}

impl Interface {
    /// The parameters a caller supplies or receives, in order: inputs, outputs, in/outs and the return value.
    /// Their position in this iterator is the parameter index of a call.
    pub fn formals(&self) -> impl Iterator<Item = &Param> {
        self.params.iter().filter(|p| !matches!(p.section, Section::Static | Section::Temp))
    }

    /// The place of each formal, in the order of [`formals`](Self::formals), in the list of pointers after a call of
    /// an FC or SFC in machine code: inputs, return value, outputs, in/outs.
    pub fn list_places(&self) -> Vec<u16> {
        const IN_LIST: [Section; 4] = [Section::Input, Section::Return, Section::Output, Section::InOut];
        let rank = |p: &Param| IN_LIST.iter().position(|s| *s == p.section);
        let mut order: Vec<(Option<usize>, usize)> = self.formals().map(rank).zip(0..).collect();
        order.sort_unstable();
        let mut places = vec![0; order.len()];
        for (place, (_, formal)) in (0u16..).zip(order) {
            if let Some(slot) = places.get_mut(formal) {
                *slot = place;
            }
        }
        places
    }

    /// Places everything: the parameters and statics of a function block in its instance, each section from an even
    /// byte; the temps in the local data. Sets the `at` of each declaration and both sizes. A composed in/out of a
    /// function block lies in the instance as a POINTER of 6 bytes, as STEP 7 does it. The parameters of other blocks
    /// are references and keep the address 0.
    pub fn lay_out(&mut self, has_instance: bool) {
        let mut instance = Layout::new();
        let mut temps = Layout::new();
        for section in Section::ALL.into_iter().filter(|s| has_instance && *s != Section::Temp) {
            for param in self.params.iter_mut().filter(|p| p.section == section) {
                param.at = instance.place(if param.is_pointer() { &DataType::Pointer } else { &param.ty });
            }
            instance.end_section();
        }
        for param in self.params.iter_mut().filter(|p| p.section == Section::Temp) {
            param.at = temps.place(&param.ty);
        }
        self.instance_bytes = if has_instance { instance.bytes() } else { 0 };
        self.temp_bytes = temps.bytes();
    }

    /// Bytes of local data that the declared temporaries reach into, without the filling to an even number.
    pub fn declared_temps(&self) -> u32 {
        let mut temps = Layout::new();
        let declared = self.params.iter().filter(|p| p.section == Section::Temp);
        declared.map(|p| (temps.place(&p.ty).0 + Layout::bits(&p.ty)).div_ceil(8)).max().unwrap_or(0)
    }

    /// Places the declarations of an instance at given addresses, in their order: system types of TIA Portal lie in
    /// another order than they are declared in.
    pub fn place_at(&mut self, addresses: &[BitAddr], bytes: u32) {
        for (param, at) in self.params.iter_mut().zip(addresses) {
            param.at = *at;
        }
        self.instance_bytes = bytes;
    }

    /// An instance as a structure, its components in the order of their addresses. Each section begins on an even byte:
    /// an empty structure between them, which takes no room of its own, makes the layout do that.
    pub fn instance_type(&self) -> DataType {
        let mut placed: Vec<&Param> = self.params.iter().filter(|p| p.section != Section::Temp).collect();
        let in_order = placed.is_sorted_by_key(|p| p.at);
        placed.sort_by_key(|p| p.at);
        let mut fields: Vec<Field> = Vec::new();
        let mut last = None;
        let mut layout = Layout::new();
        for param in placed {
            let ty = if param.is_pointer() { DataType::Pointer } else { param.ty.clone() };
            let goes_on = !in_order && layout.clone().place(&ty) == param.at;
            if last.is_some_and(|section| section != param.section) && !goes_on {
                fields.push(Field { name: String::new(), ty: DataType::Struct(Vec::new()), initial: None });
                layout.end_section();
            }
            layout.place(&ty);
            last = Some(param.section);
            fields.push(Field { name: param.name.clone(), ty, initial: param.initial.clone() });
        }
        DataType::Struct(fields)
    }

    /// A formal parameter by any of its names, with its index.
    pub fn formal(&self, name: &str) -> Option<(usize, &Param)> {
        self.formals().enumerate().find(|(_, p)| p.is_called(name))
    }

    /// The declaration that an address of the instance lies in, and how many bits into it.
    pub fn in_instance(&self, at: BitAddr) -> Option<(&Param, u32)> {
        last_before(self.params.iter().filter(|p| p.section != Section::Temp), at)
    }

    /// The temporary that an address of the local data lies in or after, and how many bits after its beginning.
    pub fn in_local(&self, at: BitAddr) -> Option<(&Param, u32)> {
        last_before(self.params.iter().filter(|p| p.section == Section::Temp), at)
    }

    /// Any declaration by name.
    pub fn find(&self, name: &str) -> Option<&Param> {
        self.params.iter().find(|p| p.is_called(name))
    }
}

/// The last of these that begins at or before an address, and the bits between.
fn last_before<'p>(params: impl Iterator<Item = &'p Param>, at: BitAddr) -> Option<(&'p Param, u32)> {
    let param = params.filter(|p| p.at.0 <= at.0).max_by_key(|p| p.at.0)?;
    Some((param, at.0 - param.at.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_return_value_stands_before_the_outputs_in_the_list() {
        let param = |section| Param::new("p", section, DataType::Int);
        let sections = [Section::Input, Section::Output, Section::InOut, Section::Return, Section::Temp];
        let interface = Interface { params: sections.map(param).to_vec(), ..Interface::default() };
        assert_eq!(interface.list_places(), [0, 2, 3, 1]);
    }

    #[test]
    fn sections_begin_on_even_bytes() {
        let param = |name, section, ty| Param::new(name, section, ty);
        let mut interface = Interface {
            params: vec![
                param("a", Section::Input, DataType::Bool),
                param("b", Section::Output, DataType::Bool),
                param("c", Section::InOut, DataType::DateAndTime),
                param("p", Section::InOut, DataType::Any),
                param("d", Section::Static, DataType::Byte),
                param("t", Section::Temp, DataType::Word),
            ],
            ..Interface::default()
        };
        interface.lay_out(true);
        let places: Vec<_> = interface.params.iter().map(|p| p.at.to_string()).collect();
        assert_eq!(places, ["0.0", "2.0", "4.0", "10.0", "20.0", "0.0"]);
        assert_eq!((interface.instance_bytes, interface.temp_bytes), (22, 2));
        interface.lay_out(false);
        assert_eq!((interface.instance_bytes, interface.temp_bytes), (0, 2));
    }
}
