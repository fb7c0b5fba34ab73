//! Parts of arrays and texts by index range [OPC 10000-4, 7.27]. The library takes a range of several dimensions for
//! several ranges of one, and cuts a text between the bytes of a character, which panics.

use ob1_model::DataType;
use opcua_types::{Array, ByteString, NumericRange, StatusCode, UAString, Variant, VariantScalarTypeId};

use crate::opcua::value::Shape;

/// The range is well written, but the value has no such part.
const NOTHING: StatusCode = StatusCode::BadIndexRangeNoData;

/// The part of a value.
pub(crate) fn part(value: &Variant, range: &NumericRange) -> Result<Variant, StatusCode> {
    match value {
        Variant::String(text) => {
            let text = text.as_ref();
            let (low, high) = single(range, text.chars().count()).ok_or(NOTHING)?;
            let part: String = text.chars().take(high + 1).skip(low).collect();
            Ok(Variant::String(UAString::from(part)))
        }
        Variant::ByteString(bytes) => {
            let bytes: &[u8] = bytes.as_ref();
            let (low, high) = single(range, bytes.len()).ok_or(NOTHING)?;
            let part = bytes.get(low..=high).ok_or(NOTHING)?;
            Ok(Variant::ByteString(ByteString::from(part.to_vec())))
        }
        Variant::Array(array) => of_array(array, range),
        _ => Err(NOTHING),
    }
}

fn of_array(array: &Array, range: &NumericRange) -> Result<Variant, StatusCode> {
    let lengths: Vec<usize> = match &array.dimensions {
        Some(dimensions) => dimensions.iter().map(|length| *length as usize).collect(),
        None => vec![array.values.len()],
    };
    let bounds = bounds(range, &lengths).ok_or(NOTHING)?;
    let mut places = vec![0_usize];
    for ((low, high), length) in bounds.iter().zip(&lengths) {
        // The last index counts fastest.
        places = places.iter().flat_map(|place| (*low..=*high).map(move |index| place * length + index)).collect();
    }
    let values: Option<Vec<Variant>> = places.into_iter().map(|place| array.values.get(place).cloned()).collect();
    let values = values.ok_or(NOTHING)?;
    let part = if bounds.len() > 1 {
        let lengths: Vec<u32> = bounds.iter().map(|(low, high)| (high - low + 1) as u32).collect();
        Array::new_multi(array.value_type, values, lengths)
    } else {
        Array::new(array.value_type, values)
    };
    part.map(|part| Variant::Array(Box::new(part))).map_err(|_| NOTHING)
}

/// First and last index of each dimension, cut to its length; `None`: nothing is there, or the range has another number
/// of dimensions.
fn bounds(range: &NumericRange, lengths: &[usize]) -> Option<Vec<(usize, usize)>> {
    let ranges = match range {
        NumericRange::MultipleRanges(ranges) => ranges.as_slice(),
        one => std::slice::from_ref(one),
    };
    if ranges.len() != lengths.len() {
        return None;
    }
    let cut = |(range, length): (&NumericRange, &usize)| {
        let (low, high) = match range {
            NumericRange::Index(index) => (*index as usize, *index as usize),
            NumericRange::Range(low, high) => (*low as usize, *high as usize),
            NumericRange::None | NumericRange::MultipleRanges(_) => return None,
        };
        (low <= high && low < *length).then(|| (low, high.min(*length - 1)))
    };
    ranges.iter().zip(lengths).map(cut).collect()
}

fn single(range: &NumericRange, length: usize) -> Option<(usize, usize)> {
    bounds(range, &[length])?.first().copied()
}

/// Whether a part of the values of this type can be watched. There the library itself cuts, at each change, in the task
/// that samples for all clients: only parts that it cuts rightly are accepted.
pub(crate) fn watchable(ty: &DataType, range: &NumericRange) -> StatusCode {
    let Some(shape) = Shape::of(ty) else { return StatusCode::BadNotReadable };
    let lengths: Vec<usize> = shape.dimensions.iter().map(|length| *length as usize).collect();
    let text = matches!(shape.scalar, VariantScalarTypeId::String | VariantScalarTypeId::ByteString);
    match lengths.len() {
        _ if range.is_none() => StatusCode::Good,
        0 if text => StatusCode::BadNotSupported,
        0 => NOTHING,
        _ if bounds(range, &lengths).is_none() => NOTHING,
        1 => StatusCode::Good,
        _ => StatusCode::BadNotSupported,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::Dimension;

    fn range(text: &str) -> NumericRange {
        NumericRange::new(text).expect("a range")
    }

    fn array(lengths: &[u32]) -> Variant {
        let count: u32 = lengths.iter().product();
        let values: Vec<Variant> = (0..count as i16).map(Variant::Int16).collect();
        let array = match lengths.len() {
            1 => Array::new(VariantScalarTypeId::Int16, values),
            _ => Array::new_multi(VariantScalarTypeId::Int16, values, lengths.to_vec()),
        };
        Variant::Array(Box::new(array.expect("an array")))
    }

    #[test]
    fn a_part_of_an_array_has_its_dimensions() {
        for (lengths, text, values, dimensions) in [
            (&[5_u32][..], "1", &[1_i16][..], None),
            (&[5], "1:2", &[1, 2], None),
            (&[5], "3:9", &[3, 4], None),
            (&[2, 3], "0:1,1", &[1, 4], Some(vec![2_u32, 1])),
            (&[2, 3], "1,0:1", &[3, 4], Some(vec![1, 2])),
            (&[2, 3], "0:9,1:9", &[1, 2, 4, 5], Some(vec![2, 2])),
            (&[2, 2, 2], "1,0,0:1", &[4, 5], Some(vec![1, 1, 2])),
        ] {
            let found = part(&array(lengths), &range(text)).expect("a part");
            let Variant::Array(found) = found else { panic!("{text}: {found:?}") };
            let wanted: Vec<Variant> = values.iter().copied().map(Variant::Int16).collect();
            assert_eq!((found.values, found.dimensions), (wanted, dimensions), "{lengths:?} {text}");
        }
    }

    #[test]
    fn a_part_of_a_text_is_characters() {
        for (value, text, wanted) in [
            (Variant::from("öäü"), "0", Variant::from("ö")),
            (Variant::from("öäü"), "1:5", Variant::from("äü")),
            (Variant::ByteString(vec![1_u8, 2, 3].into()), "1:2", Variant::ByteString(vec![2_u8, 3].into())),
        ] {
            assert_eq!(part(&value, &range(text)), Ok(wanted), "{value:?} {text}");
        }
    }

    #[test]
    fn what_is_not_there_is_no_data() {
        for (value, text) in [
            (array(&[5]), "5"),
            (array(&[5]), "0,0"),
            (array(&[2, 3]), "0"),
            (array(&[2, 3]), "2,0"),
            (array(&[2, 3]), "0,0,0"),
            (Variant::from("öäü"), "3"),
            (Variant::from(""), "0"),
            (Variant::from("öäü"), "0,1"),
            (Variant::Int16(1), "0"),
            (Variant::Empty, "0"),
        ] {
            assert_eq!(part(&value, &range(text)), Err(NOTHING), "{value:?} {text}");
        }
    }

    #[test]
    fn only_what_the_library_cuts_rightly_is_watched() {
        let list = |highs: &[i32]| {
            let dimensions = highs.iter().map(|high| Dimension { low: 0, high: *high }).collect();
            DataType::Array(dimensions, Box::new(DataType::Int))
        };
        for (ty, text, status) in [
            (list(&[4]), "1:2", StatusCode::Good),
            (list(&[4]), "5", NOTHING),
            (list(&[4]), "0,1", NOTHING),
            (list(&[1, 2]), "0,1", StatusCode::BadNotSupported),
            (list(&[1, 2]), "0", NOTHING),
            (DataType::Int, "0", NOTHING),
            (DataType::String(10), "0", StatusCode::BadNotSupported),
        ] {
            assert_eq!(watchable(&ty, &range(text)), status, "{ty:?} {text}");
            assert_eq!(watchable(&ty, &NumericRange::None), StatusCode::Good);
        }
    }
}
