//! The components of structures, by name.

use std::cell::RefCell;
use std::collections::BTreeMap;

use ob1_model::{BitAddr, DataType, Field, Layout};

/// Names in capitals, to the index of the component and its place.
type Places = BTreeMap<String, (usize, BitAddr)>;

/// The components of structures by name, each structure indexed when first used. Valid as long as the types it has
/// seen are neither changed nor dropped: structures are distinguished by their address.
#[derive(Debug, Default)]
pub struct FieldIndex {
    known: RefCell<BTreeMap<*const Field, Places>>,
}

impl FieldIndex {
    /// A component: its type and its place in the structure.
    pub fn find<'t>(&self, fields: &'t [Field], name: &str) -> Option<(&'t DataType, BitAddr)> {
        let mut known = self.known.borrow_mut();
        let index = known.entry(fields.as_ptr()).or_insert_with(|| index(fields));
        let (at, address) = index.get(&name.to_uppercase())?;
        fields.get(*at).map(|f| (&f.ty, *address))
    }
}

fn index(fields: &[Field]) -> Places {
    let mut layout = Layout::new();
    fields.iter().enumerate().map(|(i, f)| (f.name.to_uppercase(), (i, layout.place(&f.ty)))).collect()
}
