//! The description of one parameter, as the table of the plugin holds it.

use crate::abi;

use crate::text::text;

/// The declaration section of a parameter or an instance variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Section {
    /// `VAR_INPUT`: the block reads it.
    In = abi::SECTION_IN,
    /// `VAR_OUTPUT`: the block writes it.
    Out = abi::SECTION_OUT,
    /// `VAR_IN_OUT`: the block reads and writes it.
    InOut = abi::SECTION_IN_OUT,
    /// Instance data that is not a parameter.
    Static = abi::SECTION_STATIC,
    /// The function value `RET_VAL`.
    Return = abi::SECTION_RETURN,
}

/// A parameter or an instance variable of a block. Made by [`crate::interface!`].
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct Param(pub(crate) abi::ParamDesc);

impl Param {
    /// A description. `aliases` are other spellings, separated by `|`; `initial` is the number of an initial value.
    #[must_use]
    pub const fn new(
        name: &'static str,
        aliases: &'static str,
        section: Section,
        ty: u8,
        length: u16,
        initial: u32,
    ) -> Self {
        Self(abi::ParamDesc {
            size: size_of::<abi::ParamDesc>() as u32,
            name: text(name),
            aliases: text(aliases),
            section: section as u8,
            ty,
            length,
            initial,
        })
    }

    pub(crate) const fn is_static(&self) -> bool {
        self.0.section == abi::SECTION_STATIC
    }
}

/// Refuses at compile time what the host would refuse at loading.
pub(crate) const fn check(params: &[Param], is_fb: bool) {
    let (mut i, mut statics, mut returns) = (0, false, false);
    while i < params.len() {
        let section = params[i].0.section;
        assert!(is_fb || !params[i].is_static(), "only an FB has instance data");
        assert!(!statics || params[i].is_static(), "instance variables come after the parameters");
        assert!(!(returns && section == abi::SECTION_RETURN), "a block has one function value");
        assert!(!(is_fb && section == abi::SECTION_RETURN), "an FB has no function value");
        assert!(params[i].0.ty != abi::ty::BYTES || params[i].is_static(), "opaque bytes are instance data only");
        statics |= params[i].is_static();
        returns |= section == abi::SECTION_RETURN;
        i += 1;
    }
}
