//! The variable table: what is watched, and in which form.

use ob1_access::Form;

use ob1_station::access::protocol::CellValue;

/// A line of the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Watched {
    /// The name of the cell.
    pub(super) name: String,
    pub(super) form: Form,
}

impl Watched {
    /// `NAME`, `NAME:hex`, `NAME:bin`, `NAME:anzw`, `NAME:status`.
    pub(super) fn parse(text: &str) -> Self {
        let (name, form) = Form::split(text);
        Self { name: name.to_owned(), form }
    }

    /// A value in this form.
    pub(super) fn show(&self, cell: &CellValue) -> String {
        self.form.show(&cell.text, &cell.hex)
    }
}
