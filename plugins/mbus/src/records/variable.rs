//! A record of the variable data structure (CI 72h). `m-bus-application-layer` interprets DIF and VIF.

use m_bus_application_layer::data_information::{DataInformation, DataInformationBlock};
use m_bus_application_layer::value_information::{ValueInformation, ValueInformationBlock};

use super::measure::measure;
use super::quantity::{Quantity, Unit};
use super::record::{Fault, Record, Value};
use super::value::decode;

/// The record at this position; its DIF is neither filler nor the end of the records.
pub(crate) fn record(fields: &[u8], from: usize) -> Result<Record<'_>, Fault> {
    let bytes = fields.get(from..).ok_or(Fault::Malformed)?;
    let dif = *bytes.first().ok_or(Fault::Malformed)?;
    if dif & 0xF == 0xF {
        // Reserved special functions, and the request for everything, which a meter does not send.
        return Err(Fault::Malformed);
    }
    let extent = measure(bytes).ok_or(Fault::Malformed)?;
    let (at, len) = (from + extent.head + extent.lvar, extent.data);
    let data = fields.get(at..at + len).ok_or(Fault::Malformed)?;
    let head = bytes.get(..extent.head).ok_or(Fault::Malformed)?;
    let lvar = bytes.get(extent.head).copied().unwrap_or(0);
    let block = DataInformationBlock::try_from(head).map_err(|_| Fault::Malformed)?;
    let information = DataInformation::try_from(&block).map_err(|_| Fault::Malformed)?;
    let vib = head.get(block.get_size()..).ok_or(Fault::Malformed)?;
    let vif = *vib.first().ok_or(Fault::Malformed)?;
    let vife = vib.get(1).copied().unwrap_or(0);
    let (mut quantity, mut unit, mut exponent) = (Quantity::Other, Unit::None, 0);
    // An unknown VIF gives a number without quantity and unit.
    if let Ok(meaning) = ValueInformationBlock::try_from(vib).and_then(|block| ValueInformation::try_from(&block)) {
        quantity = Quantity::of(meaning.labels());
        unit = Unit::of(meaning.units());
        exponent = i16::try_from(meaning.decimal_scale_exponent).unwrap_or(0);
    }
    Ok(Record {
        function: (dif >> 4) & 3,
        storage: information.storage_number,
        tariff: u32::try_from(information.tariff).unwrap_or(u32::MAX),
        device: u16::try_from(information.device).unwrap_or(u16::MAX),
        quantity,
        unit,
        exponent,
        value: decode(dif, vif, lvar, data),
        vif: [vif, vife],
        at,
        len,
    })
}

/// The manufacturer-specific rest after DIF 0Fh or 1Fh.
pub(crate) fn manufacturer_specific(fields: &[u8], at: usize) -> Record<'_> {
    let data = fields.get(at..).unwrap_or_default();
    Record {
        function: 0,
        storage: 0,
        tariff: 0,
        device: 0,
        quantity: Quantity::Manufacturer,
        unit: Unit::None,
        exponent: 0,
        value: Value::Bytes(data),
        vif: [0, 0],
        at,
        len: data.len(),
    }
}
