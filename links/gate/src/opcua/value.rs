//! Values and types of STEP 7 as those of OPC UA (docs/opcua.md, "Types").

use ob1_access::{Datum, Typed, Unfit};
use ob1_model::{CellError, DataType};
use opcua_types::{
    Array, ByteString, DataTypeId, DateTime, NodeId, StatusCode, UAString, Variant, VariantScalarTypeId,
};

/// The OPC UA form of a STEP 7 type.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Shape {
    /// The attribute DataType.
    pub(crate) data_type: DataTypeId,
    /// The encoding of a value.
    pub(crate) scalar: VariantScalarTypeId,
    /// The attribute ArrayDimensions; empty for a single value.
    pub(crate) dimensions: Vec<u32>,
}

impl Shape {
    /// The shape of a type that has a value.
    pub(crate) fn of(ty: &DataType) -> Option<Self> {
        use VariantScalarTypeId as Scalar;
        let (data_type, scalar) = match ty {
            DataType::Bool => (DataTypeId::Boolean, Scalar::Boolean),
            DataType::Byte | DataType::Char => (DataTypeId::Byte, Scalar::Byte),
            DataType::Word | DataType::Counter => (DataTypeId::UInt16, Scalar::UInt16),
            DataType::Int => (DataTypeId::Int16, Scalar::Int16),
            DataType::DWord => (DataTypeId::UInt32, Scalar::UInt32),
            DataType::DInt => (DataTypeId::Int32, Scalar::Int32),
            DataType::Real => (DataTypeId::Float, Scalar::Float),
            DataType::Time | DataType::S5Time | DataType::TimeOfDay => (DataTypeId::Duration, Scalar::Double),
            DataType::Date | DataType::DateAndTime => (DataTypeId::DateTime, Scalar::DateTime),
            DataType::String(_) => (DataTypeId::String, Scalar::String),
            DataType::Pointer | DataType::Any => (DataTypeId::ByteString, Scalar::ByteString),
            DataType::Array(dims, element) => {
                let element = Self::of(element).filter(|element| element.dimensions.is_empty())?;
                return Some(Self { dimensions: dims.iter().map(|dim| dim.len()).collect(), ..element });
            }
            _ => return None,
        };
        Some(Self { data_type, scalar, dimensions: Vec::new() })
    }

    /// The attribute ValueRank.
    pub(crate) fn rank(&self) -> i32 {
        if self.dimensions.is_empty() { -1 } else { self.dimensions.len() as i32 }
    }
}

/// The size of a value of a type, in single values: each element of an array counts as one, and so do every 16
/// characters of a text.
pub(crate) fn weight(ty: &DataType) -> usize {
    match ty {
        DataType::Array(dims, element) => {
            let elements = dims.iter().map(|dim| dim.len() as usize).fold(1_usize, usize::saturating_mul);
            elements.saturating_mul(weight(element))
        }
        DataType::String(len) => 1 + usize::from(*len) / 16,
        _ => 1,
    }
}

/// A value in OPC UA form.
pub(crate) fn variant(value: Datum, shape: &Shape) -> Variant {
    match value {
        Datum::Bool(v) => Variant::Boolean(v),
        Datum::Byte(v) => Variant::Byte(v),
        Datum::Word(v) => Variant::UInt16(v),
        Datum::DWord(v) => Variant::UInt32(v),
        Datum::Int(v) => Variant::Int16(v),
        Datum::DInt(v) => Variant::Int32(v),
        Datum::Real(v) => Variant::Float(v),
        Datum::Duration(ms) => Variant::Double(ms as f64),
        Datum::Moment(ms) => Variant::DateTime(Box::new(moment(ms))),
        Datum::Text(v) => Variant::String(UAString::from(v)),
        Datum::Bytes(v) => Variant::ByteString(ByteString::from(v)),
        Datum::List(values) => {
            let values: Vec<Variant> = values.into_iter().map(|value| variant(value, shape)).collect();
            let array = match shape.dimensions.len() {
                0 | 1 => Array::new(shape.scalar, values),
                _ => Array::new_multi(shape.scalar, values, shape.dimensions.clone()),
            };
            array.map_or(Variant::Empty, |array| Variant::Array(Box::new(array)))
        }
    }
}

/// Ticks of 100 ns from 1601-01-01, where DateTime begins, to 1970-01-01.
const TICKS_TO_1970: i64 = 116_444_736_000_000_000;

fn moment(ms: i64) -> DateTime {
    DateTime::from(TICKS_TO_1970 + ms * 10_000)
}

/// A client's value for this place; its type must be that of the place.
pub(crate) fn datum(value: &Variant, typed: &Typed) -> Result<Datum, StatusCode> {
    let shape = Shape::of(&typed.ty).ok_or(StatusCode::BadNotWritable)?;
    if let Variant::Array(array) = value {
        // A client may omit the dimensions only of a one-dimensional array.
        let same = match &array.dimensions {
            Some(dimensions) => *dimensions == shape.dimensions,
            None => shape.dimensions.len() == 1,
        };
        let DataType::Array(_, element) = &typed.ty else { return Err(StatusCode::BadTypeMismatch) };
        if !same || array.value_type != shape.scalar {
            return Err(StatusCode::BadTypeMismatch);
        }
        return array.values.iter().map(|value| single(value, element)).collect::<Result<_, _>>().map(Datum::List);
    }
    // A string of bytes is the same as an array of them [OPC 10000-4, 5.11.4.2].
    if let (Variant::ByteString(bytes), VariantScalarTypeId::Byte, [_]) = (value, shape.scalar, &shape.dimensions[..]) {
        let bytes: &[u8] = bytes.as_ref();
        return Ok(Datum::List(bytes.iter().copied().map(Datum::Byte).collect()));
    }
    single(value, &typed.ty)
}

fn single(value: &Variant, ty: &DataType) -> Result<Datum, StatusCode> {
    Ok(match (value, ty) {
        (Variant::Boolean(v), DataType::Bool) => Datum::Bool(*v),
        (Variant::Byte(v), DataType::Byte | DataType::Char) => Datum::Byte(*v),
        (Variant::UInt16(v), DataType::Word | DataType::Counter) => Datum::Word(*v),
        (Variant::Int16(v), DataType::Int) => Datum::Int(*v),
        (Variant::UInt32(v), DataType::DWord) => Datum::DWord(*v),
        (Variant::Int32(v), DataType::DInt) => Datum::DInt(*v),
        (Variant::Float(v), DataType::Real) => Datum::Real(*v),
        (Variant::Double(v), DataType::Time | DataType::S5Time | DataType::TimeOfDay) => {
            // Beyond 2^53 a double cannot represent every millisecond; the types end far below.
            if !v.is_finite() || v.abs() > 9e15 {
                return Err(StatusCode::BadOutOfRange);
            }
            Datum::Duration(v.round() as i64)
        }
        (Variant::DateTime(v), DataType::Date | DataType::DateAndTime) => {
            Datum::Moment((v.checked_ticks() - TICKS_TO_1970).div_euclid(10_000))
        }
        (Variant::String(v), DataType::String(_)) => Datum::Text(v.as_ref().to_owned()),
        (Variant::ByteString(v), DataType::Pointer | DataType::Any) => {
            Datum::Bytes(v.value.clone().unwrap_or_default())
        }
        _ => return Err(StatusCode::BadTypeMismatch),
    })
}

/// Why a value cannot be written, as a status code.
pub(crate) const fn unfit(why: Unfit) -> StatusCode {
    match why {
        Unfit::Type => StatusCode::BadTypeMismatch,
        Unfit::Range => StatusCode::BadOutOfRange,
        Unfit::Never => StatusCode::BadNotWritable,
        Unfit::TooLong => StatusCode::BadEncodingLimitsExceeded,
    }
}

/// Why the CPU has no such cell, as a status code.
pub(crate) const fn cell_error(error: CellError) -> StatusCode {
    match error {
        CellError::Outside | CellError::NoDb | CellError::NoTimer | CellError::NoEntry => StatusCode::BadNotFound,
        CellError::ReadOnly => StatusCode::BadNotWritable,
        CellError::NoModule => StatusCode::BadNoCommunication,
        CellError::Value => StatusCode::BadOutOfRange,
        CellError::OutputsOff => StatusCode::BadInvalidState,
    }
}

/// The node of a type.
pub(crate) fn type_node(shape: &Shape) -> NodeId {
    shape.data_type.into()
}

/// Longest name and value of a refused write in the audit log.
const ATTEMPT: usize = 100;

/// A write that was not allowed, for the audit log. Strangers' input is cut to a limited length.
pub(crate) fn attempt(id: Option<&str>, value: Option<&Variant>) -> String {
    let value = match value {
        Some(Variant::Array(array)) => format!("an array of {}", array.values.len()),
        Some(Variant::ByteString(bytes)) => format!("{} bytes", bytes.as_ref().len()),
        Some(value @ (Variant::String(_) | Variant::Boolean(_))) => value.to_string(),
        Some(value) if value.is_numeric() => value.to_string(),
        _ => "?".to_owned(),
    };
    let short = |text: &str| text.get(..text.floor_char_boundary(ATTEMPT)).unwrap_or_default().to_owned();
    format!("{} = {}", short(id.unwrap_or("?")), short(&value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::{Cell, Dimension};

    fn typed(ty: DataType) -> Typed {
        Typed { name: "x".into(), cell: Cell::Db(1, 0), ty }
    }

    fn array(dims: &[(i32, i32)], element: DataType) -> DataType {
        DataType::Array(
            dims.iter().map(|(low, high)| Dimension { low: *low, high: *high }).collect(),
            Box::new(element),
        )
    }

    #[test]
    fn values_go_both_ways() {
        let list = |from: i16| Datum::List((from..from + 6).map(Datum::Int).collect());
        for (ty, value) in [
            (DataType::Bool, Datum::Bool(true)),
            (DataType::Char, Datum::Byte(65)),
            (DataType::Counter, Datum::Word(999)),
            (DataType::Int, Datum::Int(-1)),
            (DataType::DWord, Datum::DWord(u32::MAX)),
            (DataType::DInt, Datum::DInt(i32::MIN)),
            (DataType::Real, Datum::Real(-1.5)),
            (DataType::Time, Datum::Duration(-5)),
            (DataType::DateAndTime, Datum::Moment(1_800_000_000_123)),
            (DataType::String(10), Datum::Text("text".into())),
            (array(&[(1, 6)], DataType::Int), list(1)),
            (array(&[(0, 1), (-1, 1)], DataType::Int), list(-3)),
        ] {
            let typed = typed(ty);
            let shape = Shape::of(&typed.ty).expect("a value");
            let variant = variant(value.clone(), &shape);
            assert_eq!(variant.is_array(), !shape.dimensions.is_empty());
            assert_eq!(datum(&variant, &typed), Ok(value), "{typed:?}");
        }
    }

    #[test]
    fn a_string_of_bytes_is_an_array_of_bytes() {
        let bytes = Variant::ByteString(ByteString::from(vec![1_u8, 255]));
        let list = Datum::List(vec![Datum::Byte(1), Datum::Byte(255)]);
        for (ty, told) in [
            (array(&[(0, 1)], DataType::Byte), Ok(list.clone())),
            (array(&[(0, 1)], DataType::Char), Ok(list)),
            (array(&[(0, 0), (0, 1)], DataType::Byte), Err(StatusCode::BadTypeMismatch)),
            (array(&[(0, 1)], DataType::Int), Err(StatusCode::BadTypeMismatch)),
            (DataType::Byte, Err(StatusCode::BadTypeMismatch)),
        ] {
            assert_eq!(datum(&bytes, &typed(ty.clone())), told, "{ty:?}");
        }
        let long = typed(array(&[(0, 2)], DataType::Byte));
        let short = datum(&bytes, &long).expect("bytes");
        assert!(long.puts(&short).is_err(), "too few");
    }

    #[test]
    fn another_type_is_refused() {
        let matrix = array(&[(0, 1), (0, 2)], DataType::Int);
        let flat = Variant::from(vec![1i16; 6]);
        for (ty, value, why) in [
            (DataType::Int, Variant::Int32(1), StatusCode::BadTypeMismatch),
            (DataType::Int, Variant::Empty, StatusCode::BadTypeMismatch),
            (DataType::Int, Variant::from(vec![1i16]), StatusCode::BadTypeMismatch),
            (DataType::Time, Variant::Double(f64::NAN), StatusCode::BadOutOfRange),
            (array(&[(0, 1)], DataType::Int), Variant::from(vec![1i32; 2]), StatusCode::BadTypeMismatch),
            (matrix, flat, StatusCode::BadTypeMismatch),
            (DataType::Struct(Vec::new()), Variant::Int16(1), StatusCode::BadNotWritable),
        ] {
            assert_eq!(datum(&value, &typed(ty.clone())), Err(why), "{ty:?} {value:?}");
        }
    }
}
