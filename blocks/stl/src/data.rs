//! Data blocks: their components, and the values they begin with.

use ob1_ir::DataKind;
use ob1_model::{BitAddr, BlockId, Component, DataType, Field, Layout, Section};

use crate::elaborate::{Elaborator, LONGEST, Resolved};
use crate::fields::FieldIndex;
use crate::initial;
use crate::messages;
use crate::operand::Resolver;
use crate::parser::unquote;
use crate::path;
use crate::reader::Reader;
use crate::syntax::{Assignment, NameRef, TypeKind};
use crate::token::Kind;
use crate::world::{Data, Symbolic, World};

impl Elaborator<'_> {
    /// Makes a data block; nothing when its structure has a mistake.
    pub(crate) fn data_block(&mut self, index: usize, number: u16) {
        let Some(block) = self.blocks.get(index) else { return };
        let Some(shape) = &block.shape else {
            let message =
                "the data block has no structure: STRUCT .. END_STRUCT, a UDT, or the FB it is an instance of";
            self.sink.report(block.file, block.span, &messages::NO_STRUCTURE, message);
            return;
        };
        // A data block may have nothing yet; no other structure may.
        let empty = matches!(&shape.kind, TypeKind::Struct(declarations) if declarations.is_empty());
        let resolved = if empty { Some(Resolved::nothing()) } else { self.ty(block.file, shape, 0) };
        let Some(resolved) = resolved else {
            if let Some(of) = self.instance_of(&shape.kind) {
                self.world.unmade.insert(number, of);
            }
            return;
        };
        let data = match (resolved.fb, &resolved.ty) {
            (Some(fb), DataType::Struct(_)) => instance_data(&self.world, fb),
            (None, DataType::Array(..)) => global_data(&this(&resolved.ty)),
            (_, ty) => global_data(ty),
        };
        let Some(mut data) = data else {
            self.sink.report(block.file, shape.span, &messages::NO_STRUCTURE, "a data block needs a structure");
            return;
        };
        if data.image.len() > LONGEST as usize {
            self.sink.report(
                block.file,
                block.span,
                &messages::TOO_LONG,
                format!("the data block is longer than {LONGEST} bytes"),
            );
            return;
        }
        if !self.spend(block.file, block.span, data.image.len() as u64) {
            return;
        }
        data.name = block.shown_name();
        data.read_only = block.read_only;
        data.non_retain = block.non_retain;
        let of_fb = resolved.fb.and_then(|fb| self.world.blocks.get(&fb));
        data.optimized = block.optimized || of_fb.is_some_and(|info| info.optimized);
        let fields = FieldIndex::default();
        let mut image = std::mem::take(&mut data.image);
        for assignment in &block.assignments {
            self.assign(block.file, &data, &mut image, &fields, assignment);
        }
        data.image = image;
        self.world.data.insert(number, data);
    }

    /// The function block that a data block is made from, when it is named and not there.
    fn instance_of(&self, shape: &TypeKind) -> Option<BlockId> {
        let TypeKind::Named(name) = shape else { return None };
        let (word, number) = match name {
            NameRef::Absolute(word, number) => (*word, *number),
            NameRef::Symbol(name) | NameRef::Bare(name) => match self.world.symbol(name)? {
                Symbolic::Block(word, number) => (*word, *number),
                _ => return None,
            },
        };
        let id = BlockId::new(word.kind()?, number);
        (!self.world.own.contains(&id)).then_some(id)
    }

    /// An assignment of a start value: `name := value;`
    fn assign(
        &mut self,
        file: usize,
        data: &Data,
        image: &mut [u8],
        fields: &FieldIndex,
        assignment: &Assignment,
    ) -> Option<()> {
        let source = self.files.get(file)?;
        let whole = source.tokens.get(assignment.path.start)?.span;
        let mut reader = Reader::new(file, source, self.sink, assignment.path.clone(), whole);
        let name = match reader.peek_kind() {
            Some(Kind::Word | Kind::Symbol | Kind::Local) => reader.next().map_or("", |t| unquote(reader.text(t))),
            _ => {
                reader.report(whole, &messages::ASSIGNMENT, "the name of a component is expected here");
                return None;
            }
        };
        let Some(component) = data.find(name) else {
            let known = data.components.iter().map(|c| c.path.as_str());
            let message = format!("the data block has no component {name}");
            reader.sink.report_unknown(file, whole, &messages::COMPONENT, message, name, known);
            return None;
        };
        let resolver = Resolver::new(&self.world, self.sets.of(file), None);
        let (ty, at) = path::follow(&resolver, &mut reader, fields, &component.ty, component.at, &mut Vec::new())?;
        if !reader.finish(&messages::ASSIGNMENT) {
            return None;
        }
        let mut reader = Reader::new(file, source, self.sink, assignment.value.clone(), whole);
        let bytes = initial::read(&resolver, &mut reader, ty)?;
        initial::put(image, at, ty, &bytes);
        Some(())
    }
}

/// The structure of TIA Portal's data block that is one array: its elements are `"data".THIS[1]`.
fn this(array: &DataType) -> DataType {
    DataType::Struct(vec![Field { name: "THIS".to_owned(), ty: array.clone(), initial: None }])
}

/// A global data block of a structure.
fn global_data(ty: &DataType) -> Option<Data> {
    let DataType::Struct(fields) = ty else { return None };
    let mut image = vec![0; initial::size(ty)];
    initial::write_default(ty, BitAddr(0), &mut image);
    let mut layout = Layout::new();
    let component = |f: &Field, at| Component { path: f.name.clone(), ty: f.ty.clone(), at };
    let components = fields.iter().map(|f| component(f, layout.place(&f.ty))).collect();
    Some(Data::new(DataKind::Global, components, image))
}

/// An instance of a function block of the program or the library.
pub(crate) fn instance_data(world: &World, fb: BlockId) -> Option<Data> {
    let interface = &world.blocks.get(&fb)?.interface;
    let mut image = vec![0; interface.instance_bytes as usize];
    let mut components = Vec::new();
    for param in interface.params.iter().filter(|p| p.section != Section::Temp) {
        let ty = if param.is_pointer() { DataType::Pointer } else { param.ty.clone() };
        match &param.initial {
            Some(bytes) => initial::put(&mut image, param.at, &ty, bytes),
            None => initial::write_default(&ty, param.at, &mut image),
        }
        components.push(Component { path: param.name.clone(), ty, at: param.at });
    }
    components.sort_by_key(|c| c.at);
    Some(Data::new(DataKind::Instance(fb), components, image))
}
