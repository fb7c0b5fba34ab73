//! Calls: inputs before, the call, outputs behind it.

use ob1_ir::compose;
use ob1_ir::{
    AddressRegister, Arg, BitTest, Call as IrCall, CallMode, DbRegister, Jump, Logic, Number, NumberFormat, Op,
    Operand, Place, StatusBit, Width, WordLogic,
};
use ob1_model::{Area, BitAddr, DataType, Layout, Param, Section};

use crate::code::{Code, local};
use crate::convert::implicit;
use crate::emit_copy::in_local;
use crate::tree::{Actual, Base, Call, Kind, Typed, Var};

/// What is done behind a call: a value of the local data goes to a variable.
struct Back<'b, 'w> {
    target: &'b Typed<'w>,
    at: Operand,
    formal: &'w Param,
}

impl Code {
    /// Calls a block. `into`: where a composed result goes. Gives the place of the result.
    pub(crate) fn call<'w>(&mut self, call: &Call<'w>, into: Option<Place>) -> Option<Place> {
        self.line = call.line;
        let (skip, end) = (self.label(), self.label());
        if let Some(enable) = &call.enable {
            self.bits(enable);
            self.jump(Jump::IfNotRlo, skip);
        }
        let result = match &call.place {
            Some(place) => {
                self.call_instance(call, place);
                None
            }
            None => self.call_function(call, into),
        };
        if call.enable.is_some() {
            self.jump(Jump::Always, end);
            self.set(skip);
            self.op(Op::ClearRlo);
            self.op(Op::SaveRlo);
            self.set(end);
        }
        if let Some(Typed { kind, .. }) = &call.enabled {
            let test = BitTest::Status(StatusBit::BinaryResult);
            self.op(Op::Scan { logic: Logic::And, negate: false, test });
            match (kind, self.ok) {
                (Kind::Ok | Kind::Eno, Some(ok)) => self.op(Op::Assign(ok)),
                (Kind::Var(var), _) => {
                    let bit = self.take_bit();
                    self.op(Op::Assign(bit));
                    let place = self.place(var);
                    self.op(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(bit) });
                    self.op(Op::Assign(place));
                }
                _ => self.lose(),
            }
        }
        result
    }

    fn call_function<'w>(&mut self, call: &Call<'w>, into: Option<Place>) -> Option<Place> {
        let mut args: Vec<Arg> = call.formals.iter().map(|_| Arg::Open).collect();
        let mut back = Vec::new();
        for actual in &call.actuals {
            let arg = match actual.formal.section {
                Section::Input => self.input(actual, call.copies),
                _ => self.variable(actual, call.copies, &mut back),
            };
            if let Some(slot) = args.get_mut(actual.index) {
                *slot = arg;
            }
        }
        let mut result = None;
        for (arg, formal) in args.iter_mut().zip(&call.formals) {
            if *arg != Arg::Open {
                continue;
            }
            let place = match (into, formal.section) {
                (Some(place), Section::Return) => place,
                _ => self.room(&formal.ty),
            };
            if formal.section == Section::Return {
                result = Some(place);
            }
            let width = Width::of(&formal.ty).unwrap_or(Width::Byte);
            *arg = Arg::Operand(Operand { width, place });
        }
        let target = call.target;
        // A function of STL may leave another address in AR2, by which a function block reaches its instance.
        let ar2 = (call.copies && self.has_instance).then(|| self.temp(Width::DWord));
        if let Some(kept) = ar2 {
            self.op(Op::TransferArTo(AddressRegister::Ar2, kept));
        }
        self.op(Op::Call(Box::new(IrCall { mode: CallMode::Call, target, instance: None, args })));
        if let Some(kept) = ar2 {
            self.op(Op::LoadArFrom(AddressRegister::Ar2, kept));
        }
        self.write_back(&back);
        result
    }

    /// Local data for a result that goes nowhere else.
    fn room(&mut self, ty: &DataType) -> Place {
        match ty {
            DataType::Bool => self.take_bit(),
            DataType::String(_) => {
                let at = self.take(256);
                let place = Place::Fixed(Area::Local, at);
                self.write_bytes(place, 0, &[self.options.longest_text, 0]);
                place
            }
            _ => Place::Fixed(Area::Local, self.take(Layout::bits(ty).div_ceil(8).max(1))),
        }
    }

    fn write_back(&mut self, back: &[Back<'_, '_>]) {
        for Back { target, at, formal } in back {
            let (Kind::Var(var), Place::Fixed(_, from)) = (&target.kind, at.place) else { return self.lose() };
            let value = Typed::new(Kind::Var(in_local(from)), &formal.ty, target.span);
            let value = match implicit(value, target.ty) {
                Ok(value) | Err(value) => value,
            };
            self.assign(var, target.ty, &value);
        }
    }

    /// The value of an input of a function.
    fn input(&mut self, actual: &Actual<'_>, copies: bool) -> Arg {
        let (formal, value) = (actual.formal, &actual.value);
        let ty = &formal.ty;
        if ty.is_parameter_type() {
            return match &value.kind {
                Kind::Timer(n) | Kind::Counter(n) | Kind::Block(n) => Arg::Number(*n),
                _ => Arg::Number(self.number(value)),
            };
        }
        if matches!(ty, DataType::Any | DataType::Pointer) {
            return self.pointer(value, ty);
        }
        if ty.is_composed() {
            return self.composed(value, ty);
        }
        let width = Width::of(ty).unwrap_or(Width::Word);
        match &value.kind {
            Kind::Constant(bits) => Arg::Const(*bits),
            Kind::Var(var) if !copies && var.is_direct() && value.ty == ty => {
                Arg::Operand(Operand { width, place: self.place(var) })
            }
            _ if *ty == DataType::Bool => {
                let place = self.kept_bit(value);
                Arg::Operand(Operand { width, place })
            }
            _ => {
                self.value(value);
                let kept = self.temp(width);
                self.op(Op::Transfer(kept));
                Arg::Operand(kept)
            }
        }
    }

    /// A composed input: the variable itself, or what was made for it.
    fn composed(&mut self, value: &Typed<'_>, ty: &DataType) -> Arg {
        let byte = |place| Arg::Operand(Operand { width: Width::Byte, place });
        match &value.kind {
            Kind::Bytes(bytes) => Arg::Bytes(bytes.clone().into()),
            _ if *value.ty == DataType::Char => {
                let at = self.take(4);
                self.assign(&in_local(at), &DataType::String(2), value);
                byte(Place::Fixed(Area::Local, at))
            }
            Kind::Var(var) if var.is_direct() => byte(self.place(var)),
            Kind::Var(var) if matches!(ty, DataType::String(_)) => byte(self.text_copy(var)),
            Kind::Var(var) => {
                let at = self.take(Layout::bits(ty).div_ceil(8));
                self.copy(&in_local(at), var, ty);
                byte(Place::Fixed(Area::Local, at))
            }
            Kind::Call(call) => match self.call(call, None) {
                Some(place) => byte(place),
                None => self.no_arg(),
            },
            _ => self.no_arg(),
        }
    }

    /// Nothing can be handed over.
    const fn no_arg(&mut self) -> Arg {
        self.lose();
        Arg::Open
    }

    /// The variable of an output or in/out of a function.
    fn variable<'b, 'w>(&mut self, actual: &'b Actual<'w>, copies: bool, back: &mut Vec<Back<'b, 'w>>) -> Arg {
        let (formal, target) = (actual.formal, &actual.value);
        if matches!(formal.ty, DataType::Any | DataType::Pointer) {
            return self.pointer(target, &formal.ty);
        }
        let Kind::Var(var) = &target.kind else { return self.no_arg() };
        if formal.ty.is_composed() {
            if var.is_direct() {
                let place = self.place(var);
                return Arg::Operand(Operand { width: Width::Byte, place });
            }
            let at = self.take(Layout::bits(target.ty).div_ceil(8));
            let kept = in_local(at);
            if matches!(target.ty, DataType::String(_)) {
                let value = Typed::new(target.kind.clone(), target.ty, target.span);
                self.assign(&kept, target.ty, &value);
            } else {
                self.copy(&kept, var, target.ty);
            }
            let operand = local(Width::Byte, at);
            back.push(Back { target, at: operand, formal });
            return Arg::Operand(operand);
        }
        let width = Width::of(&formal.ty).unwrap_or(Width::Word);
        let own = matches!(var.base, Base::Fixed(Area::Local));
        if var.is_direct() && (own || !copies) && *target.ty == formal.ty {
            return Arg::Operand(Operand { width, place: self.place(var) });
        }
        let operand = match formal.ty {
            DataType::Bool => Operand { width, place: self.take_bit() },
            _ => self.temp(width),
        };
        if formal.section == Section::InOut
            && let Place::Fixed(_, at) = operand.place
        {
            self.assign(&in_local(at), &formal.ty, target);
        }
        back.push(Back { target, at: operand, formal });
        Arg::Operand(operand)
    }

    /// An actual of the type POINTER or ANY.
    fn pointer(&mut self, value: &Typed<'_>, ty: &DataType) -> Arg {
        match &value.kind {
            Kind::Bytes(bytes) => Arg::Bytes(bytes.clone().into()),
            Kind::Var(var) if value.ty == ty && var.is_direct() => {
                Arg::Operand(Operand { width: Width::Byte, place: self.place(var) })
            }
            Kind::Var(var) => {
                let any = (*ty == DataType::Any).then(|| any_length(value.ty));
                self.any(var, any)
            }
            Kind::Block(Number::Fixed(db)) => {
                let [high, low] = db.to_be_bytes();
                let bytes: Vec<u8> = match ty {
                    DataType::Any => vec![0x10, 0x19, 0, 1, 0, 0, 0x19, 0, high, low],
                    _ => vec![high, low, 0x84, 0, 0, 0],
                };
                Arg::Bytes(bytes.into())
            }
            _ => self.no_arg(),
        }
    }

    /// A POINTER, or with a type and count an ANY, to a variable.
    pub(crate) fn any(&mut self, var: &Var<'_>, any: Option<(u8, u16)>) -> Arg {
        if var.terms.is_empty() {
            let known = match var.base {
                // The called block sees the local data as the area V.
                Base::Fixed(Area::Local) => Some((0, Area::PreviousLocal)),
                Base::Fixed(area) => Some((0, area)),
                Base::Db(db) => Some((db, Area::Db)),
                _ => None,
            };
            if let Some((db, area)) = known {
                let pointer = u32::from(area.pointer_code()) << 24 | var.at.0;
                let mut bytes: Vec<u8> = Vec::new();
                if let Some((code, count)) = any {
                    bytes.extend([0x10, code]);
                    bytes.extend(count.to_be_bytes());
                }
                bytes.extend(u16::to_be_bytes(db));
                bytes.extend(pointer.to_be_bytes());
                return Arg::Bytes(bytes.into());
            }
        }
        let at = self.take(10);
        self.make_pointer(var, any, &|width, byte| local(width, BitAddr(at.0 + byte * 8)));
        Arg::Operand(local(Width::Byte, at))
    }

    /// Writes a POINTER or ANY to a variable.
    fn make_pointer(&mut self, var: &Var<'_>, any: Option<(u8, u16)>, to: &dyn Fn(Width, u32) -> Operand) {
        let mut at = 0;
        if let Some((code, count)) = any {
            self.op(Op::LoadConst(0x1000_0000 | u32::from(code) << 16 | u32::from(count)));
            self.op(Op::Transfer(to(Width::DWord, 0)));
            at = 4;
        }
        let place = self.place(var);
        let ar1 = |code: &mut Self, offset: BitAddr, area: Option<Area>| {
            code.op(Op::TransferAr(AddressRegister::Ar1));
            if offset.0 > 0 {
                code.op(Op::AddConst { format: NumberFormat::DInt, value: offset.0 as i32 });
            }
            if let Some(area) = area {
                code.op(Op::DWordLogic(WordLogic::And, Some(0x00FF_FFFF)));
                code.op(Op::DWordLogic(WordLogic::Or, Some(u32::from(area.pointer_code()) << 24)));
            }
            code.op(Op::Transfer(to(Width::DWord, at + 2)));
        };
        let number = |code: &mut Self, op: Op| {
            code.op(op);
            code.op(Op::Transfer(to(Width::Word, at)));
        };
        match place {
            Place::Instance(offset) => {
                let mut ops = Vec::new();
                let from = |width, byte| to(width, byte + at);
                compose::pointer(&from, compose::Pointee::Instance(offset), None, &mut ops);
                ops.into_iter().for_each(|op| self.op(op));
            }
            Place::Register(Some(Area::Di), _, offset) => {
                number(self, Op::LoadDbNumber(DbRegister::Di));
                ar1(self, offset, Some(Area::Db));
            }
            Place::Register(Some(Area::Db), _, offset) => {
                number(self, Op::LoadDbNumber(DbRegister::Db));
                ar1(self, offset, Some(Area::Db));
            }
            Place::Register(None, _, offset) => {
                number(self, Op::LoadDbNumber(DbRegister::Db));
                ar1(self, offset, None);
            }
            Place::Register(Some(area), _, offset) => {
                let area = if area == Area::Local { Area::PreviousLocal } else { area };
                number(self, Op::LoadConst(0));
                ar1(self, offset, Some(area));
            }
            Place::Param { index, at: offset } => {
                self.param_pointer(index);
                if offset.0 > 0 {
                    self.op(Op::AddConst { format: NumberFormat::DInt, value: offset.0 as i32 });
                }
                self.op(Op::Transfer(to(Width::DWord, at + 2)));
                number(self, Op::LoadDbNumber(DbRegister::Db));
            }
            Place::Fixed(area, offset) => {
                let (number_op, area) = match area {
                    Area::Db => (Op::LoadDbNumber(DbRegister::Db), Area::Db),
                    Area::Local => (Op::LoadConst(0), Area::PreviousLocal),
                    other => (Op::LoadConst(0), other),
                };
                number(self, number_op);
                self.op(Op::LoadConst(u32::from(area.pointer_code()) << 24 | offset.0));
                self.op(Op::Transfer(to(Width::DWord, at + 2)));
            }
            Place::InDb(db, offset) => {
                number(self, Op::LoadConst(u32::from(db)));
                self.op(Op::LoadConst(u32::from(Area::Db.pointer_code()) << 24 | offset.0));
                self.op(Op::Transfer(to(Width::DWord, at + 2)));
            }
            _ => self.lose(),
        }
    }

    /// A function block: what is supplied goes into its instance before, and comes from there behind.
    fn call_instance(&mut self, call: &Call<'_>, instance: &Var<'_>) {
        let member = |formal: &Param| Var { at: BitAddr(instance.at.0 + formal.at.0), ..instance.clone() };
        for actual in call.actuals.iter().filter(|a| matches!(a.formal.section, Section::Input | Section::InOut)) {
            let to = member(actual.formal);
            self.supply(actual, &to);
        }
        let args = call.formals.iter().map(|_| Arg::Open).collect();
        let (target, number) = (call.target, call.instance);
        self.op(Op::Call(Box::new(IrCall { mode: CallMode::Call, target, instance: number, args })));
        for actual in call.actuals.iter().filter(|a| a.formal.section != Section::Input) {
            let formal = actual.formal;
            let Kind::Var(var) = &actual.value.kind else {
                // A constant pointer.
                if !matches!(formal.ty, DataType::Any | DataType::Pointer) {
                    self.lose();
                }
                continue;
            };
            if formal.is_pointer() || matches!(formal.ty, DataType::Any | DataType::Pointer) {
                continue;
            }
            let value = Typed::new(Kind::Var(member(formal)), &formal.ty, actual.value.span);
            let value = match implicit(value, actual.value.ty) {
                Ok(value) | Err(value) => value,
            };
            self.assign(var, actual.value.ty, &value);
        }
    }

    fn supply(&mut self, actual: &Actual<'_>, to: &Var<'_>) {
        let (formal, value) = (actual.formal, &actual.value);
        if formal.ty.is_parameter_type() {
            let word = Typed::new(value.kind.clone(), &crate::types::WORD, value.span);
            match &value.kind {
                Kind::Timer(Number::Fixed(n)) | Kind::Counter(Number::Fixed(n)) => {
                    self.op(Op::LoadConst(u32::from(*n)));
                }
                Kind::Timer(Number::Instance(at)) | Kind::Counter(Number::Instance(at)) => {
                    self.op(Op::Load(Operand { width: Width::Word, place: Place::Instance(*at) }));
                }
                _ => self.value(&word),
            }
            let place = self.place(to);
            self.op(Op::Transfer(Operand { width: Width::Word, place }));
            return;
        }
        let pointer = matches!(formal.ty, DataType::Any | DataType::Pointer);
        if !pointer && !formal.is_pointer() {
            self.assign(to, &formal.ty, value);
            return;
        }
        let as_it_is = pointer && (*value.ty == formal.ty || value.is_constant());
        if as_it_is {
            self.assign(to, &formal.ty, value);
            return;
        }
        let Kind::Var(var) = &value.kind else { return self.lose() };
        let any = (formal.ty == DataType::Any).then(|| any_length(value.ty));
        let place = self.place(to);
        self.make_pointer(var, any, &|width, byte| Operand { width, place: crate::emit_copy::beyond(place, byte) });
    }
}

/// Type code and count of an ANY to a variable: elements of an array, one STRING, else bytes.
fn any_length(ty: &DataType) -> (u8, u16) {
    let code = |ty: &DataType| {
        let name = if matches!(ty, DataType::String(_)) { "STRING" } else { ty.name() };
        compose::ANY_TYPES.iter().find(|(known, _)| *known == name).map(|(_, code)| *code)
    };
    if let DataType::Array(dims, element) = ty
        && element.elementary_bits().is_some()
        && let Some(code) = code(element)
    {
        let count = dims.iter().fold(1u32, |n, d| n.saturating_mul(d.len()));
        return (code, count.min(u32::from(u16::MAX)) as u16);
    }
    match ty {
        DataType::Struct(_) | DataType::Array(..) | DataType::Pointer | DataType::Any => {
            (2, (Layout::bits(ty) / 8).min(u32::from(u16::MAX)) as u16)
        }
        _ => (code(ty).unwrap_or(2), 1),
    }
}
