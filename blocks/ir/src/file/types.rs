//! Types and declarations.

use ob1_model::{DataType, Dimension, Field};

use super::cursor::{Cursor, Expected};

/// A type on one line; a structure with its fields in braces.
pub(super) fn type_line(ty: &DataType) -> String {
    match ty {
        DataType::String(length) => format!("STRING[{length}]"),
        DataType::Array(dimensions, element) => {
            let bounds: Vec<_> = dimensions.iter().map(|d| format!("{}..{}", d.low, d.high)).collect();
            format!("ARRAY [{}] OF {}", bounds.join(", "), type_line(element))
        }
        DataType::Struct(fields) => {
            let field = |f: &Field| format!("{:?} {}{};", f.name, type_line(&f.ty), initial(f.initial.as_deref()));
            format!("STRUCT {{ {} }}", fields.iter().map(field).collect::<Vec<_>>().join(" "))
        }
        plain => plain.name().to_owned(),
    }
}

/// ` := 00FF`, or nothing.
pub(super) fn initial(bytes: Option<&[u8]>) -> String {
    bytes.map_or_else(String::new, |bytes| format!(" := {}", hex(bytes)))
}

/// Two digits a byte.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect()
}

impl Cursor<'_> {
    pub(super) fn ty(&mut self) -> Expected<DataType> {
        if self.eat("STRING[") {
            let length = self.number()?;
            self.need("]")?;
            return Ok(DataType::String(length));
        }
        if self.eat("ARRAY [") {
            let mut dimensions = Vec::new();
            loop {
                let low = self.number()?;
                self.need("..")?;
                dimensions.push(Dimension { low, high: self.number()? });
                if !self.eat(",") {
                    break;
                }
            }
            self.need("]")?;
            self.need("OF")?;
            return Ok(DataType::Array(dimensions, Box::new(self.ty()?)));
        }
        if self.eat("STRUCT {") {
            let mut fields = Vec::new();
            while !self.eat("}") {
                let (name, ty) = (self.quoted()?, self.ty()?);
                fields.push(Field { name, ty, initial: self.initial()? });
                self.need(";")?;
            }
            return Ok(DataType::Struct(fields));
        }
        self.choice(DataType::WORDS.iter().chain([&DataType::TimerOrWord]), |ty| ty.name(), "a type").cloned()
    }

    pub(super) fn initial(&mut self) -> Expected<Option<Vec<u8>>> {
        if self.eat(":=") { self.bytes().map(Some) } else { Ok(None) }
    }
}
