//! The quantity and the unit of a record, as the numbers in the data block of the program. A number never changes its
//! meaning; new numbers are added at the end.

use m_bus_application_layer::value_information::{Unit as CrateUnit, UnitName, ValueLabel};

macro_rules! numbered {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $number:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(i16)]
        pub enum $name {
            $($(#[$variant_doc])* $variant = $number,)*
        }

        impl $name {
            /// All of them, by rising number.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];
        }
    };
}

numbered! {
    /// The measured quantity, from the VIF.
    Quantity {
        /// Another quantity: see the VIF.
        Other = 0,
        /// Energy: heat, cold or electricity.
        Energy = 1,
        /// Volume of what has flowed.
        Volume = 2,
        /// Mass of what has flowed.
        Mass = 3,
        /// Time the meter has been on.
        OnTime = 4,
        /// Time the meter has been operating.
        OperatingTime = 5,
        /// Power at the moment of the record.
        Power = 6,
        /// Volume flow, volume for each unit of time.
        VolumeFlow = 7,
        /// Mass flow, mass for each unit of time.
        MassFlow = 8,
        /// Flow temperature: of the medium that comes to the consumer.
        FlowTemperature = 9,
        /// Return temperature: of the medium that leaves the consumer.
        ReturnTemperature = 10,
        /// Difference of flow and return temperature.
        TemperatureDifference = 11,
        /// Temperature outside the meter's medium.
        ExternalTemperature = 12,
        /// Pressure of the medium.
        Pressure = 13,
        /// A point in time.
        TimePoint = 14,
        /// Units of a heat cost allocator.
        HeatCost = 15,
        /// Time over which the meter averages.
        AveragingDuration = 16,
        /// Age of the values.
        ActualityDuration = 17,
        /// Fabrication number of the meter.
        FabricationNumber = 18,
        /// Identification number of the meter.
        Identification = 19,
        /// Voltage of the supply that is measured.
        Voltage = 20,
        /// Current of the supply that is measured.
        Current = 21,
        /// Frequency of the supply that is measured.
        Frequency = 22,
        /// Relative humidity of the air.
        Humidity = 23,
        /// Error flags, bit by bit.
        ErrorFlags = 24,
        /// Digital inputs, bit by bit.
        DigitalInput = 25,
        /// Digital outputs, bit by bit.
        DigitalOutput = 26,
        /// Version of the firmware.
        FirmwareVersion = 27,
        /// Version of other software.
        SoftwareVersion = 28,
        /// Version of the hardware.
        HardwareVersion = 29,
        /// Model or version of the meter, as a code or text.
        Model = 30,
        /// Customer or location of the meter.
        Customer = 31,
        /// Operating time or remaining life of the battery.
        Battery = 32,
        /// A number without a unit.
        Dimensionless = 33,
        /// Reactive energy of an alternating current.
        ReactiveEnergy = 34,
        /// Apparent energy of an alternating current.
        ApparentEnergy = 35,
        /// Reactive power of an alternating current.
        ReactivePower = 36,
        /// Apparent power of an alternating current.
        ApparentPower = 37,
        /// How often the meter was reset.
        ResetCounter = 38,
        /// Manufacturer-specific: the manufacturer's documents say what.
        Manufacturer = 39,
    }
}

numbered! {
    /// The unit of the value.
    Unit {
        /// No unit, or another unit.
        None = 0,
        /// Watt-hour, Wh: unit of energy.
        WattHour = 1,
        /// Joule, J: unit of energy.
        Joule = 2,
        /// Cubic metre, m3 (volume).
        CubicMetre = 3,
        /// Kilogram, kg: unit of mass.
        Kilogram = 4,
        /// Second, s: unit of time.
        Second = 5,
        /// Minute, min: unit of time.
        Minute = 6,
        /// Hour, h: unit of time.
        Hour = 7,
        /// Day, d: unit of time.
        Day = 8,
        /// Month of the calendar: unit of time.
        Month = 9,
        /// Year of the calendar: unit of time.
        Year = 10,
        /// Watt, W: unit of power.
        Watt = 11,
        /// Joule per hour, J/h (power).
        JoulePerHour = 12,
        /// Cubic metre per hour, m3/h (volume flow).
        CubicMetrePerHour = 13,
        /// Cubic metre per minute, m3/min (volume flow).
        CubicMetrePerMinute = 14,
        /// Cubic metre per second, m3/s (volume flow).
        CubicMetrePerSecond = 15,
        /// Kilogram per hour, kg/h (mass flow).
        KilogramPerHour = 16,
        /// Degree Celsius: unit of temperature.
        Celsius = 17,
        /// Kelvin, K (temperature difference).
        Kelvin = 18,
        /// Bar, 100 000 Pa (pressure).
        Bar = 19,
        /// Volt, V: unit of voltage.
        Volt = 20,
        /// Ampere, A: unit of current.
        Ampere = 21,
        /// Hertz, Hz: unit of frequency.
        Hertz = 22,
        /// Per cent, % (relative humidity).
        Percent = 23,
        /// Degree of an angle, 1/360 of a circle.
        Degree = 24,
        /// Volt-ampere-hour reactive, varh (reactive energy).
        VarHour = 25,
        /// Volt-ampere-hour, VAh (apparent energy).
        VoltAmpereHour = 26,
        /// Volt-ampere reactive, var (reactive power).
        Var = 27,
        /// Volt-ampere, VA (apparent power).
        VoltAmpere = 28,
        /// Tonne, t, 1000 kg (mass).
        Tonne = 29,
        /// Degree Fahrenheit: unit of temperature.
        Fahrenheit = 30,
        /// Cubic feet (volume; 0.0283 m3 each).
        CubicFoot = 31,
        /// US gallons (volume; 3.785 l each).
        Gallon = 32,
    }
}

impl Quantity {
    /// The first label that has a number in this list.
    pub(crate) fn of(mut labels: impl Iterator<Item = ValueLabel>) -> Self {
        labels.find_map(Self::from_label).unwrap_or(Self::Other)
    }

    fn from_label(label: ValueLabel) -> Option<Self> {
        use ValueLabel as L;
        Some(match label {
            L::Energy => Self::Energy,
            L::Volume => Self::Volume,
            L::Mass => Self::Mass,
            L::OnTime => Self::OnTime,
            L::OperatingTime => Self::OperatingTime,
            L::Power => Self::Power,
            L::VolumeFlow => Self::VolumeFlow,
            L::MassFlow => Self::MassFlow,
            L::FlowTemperature => Self::FlowTemperature,
            L::ReturnTemperature => Self::ReturnTemperature,
            L::TemperatureDifference => Self::TemperatureDifference,
            L::ExternalTemperature => Self::ExternalTemperature,
            L::Pressure => Self::Pressure,
            L::Date | L::DateTime | L::DateTimeWithSeconds | L::Time => Self::TimePoint,
            L::DimensionlessHCA => Self::HeatCost,
            L::AveragingDuration => Self::AveragingDuration,
            L::ActualityDuration => Self::ActualityDuration,
            L::FabricationNumber => Self::FabricationNumber,
            L::EnhancedIdentification => Self::Identification,
            L::Voltage => Self::Voltage,
            L::Current => Self::Current,
            L::Frequency => Self::Frequency,
            L::RelativeHumidity => Self::Humidity,
            L::ErrorFlags => Self::ErrorFlags,
            L::DigitalInput => Self::DigitalInput,
            L::DigitalOutput => Self::DigitalOutput,
            L::MetrologyFirmwareVersion => Self::FirmwareVersion,
            L::OtherSoftwareVersion => Self::SoftwareVersion,
            L::HardwareVersion => Self::HardwareVersion,
            L::ModelOrVersion => Self::Model,
            L::Customer | L::CustomerLocation => Self::Customer,
            L::OperatingTimeBattery | L::RemainingBatteryLifeTime => Self::Battery,
            L::Dimensionless => Self::Dimensionless,
            L::ReactiveEnergy => Self::ReactiveEnergy,
            L::ApparentEnergy => Self::ApparentEnergy,
            L::ReactivePower => Self::ReactivePower,
            L::ApparentPower => Self::ApparentPower,
            L::ResetCounter => Self::ResetCounter,
            L::ManufacturerSpecific => Self::Manufacturer,
            _ => return None,
        })
    }
}

impl Unit {
    /// The unit for a product of powers.
    pub(crate) fn of(mut units: impl Iterator<Item = CrateUnit>) -> Self {
        use UnitName as N;
        let power = |unit: Option<CrateUnit>| unit.map(|unit| (unit.name, unit.exponent));
        match (power(units.next()), power(units.next())) {
            (Some((N::Watt, 1)), Some((N::Hour, 1))) => Self::WattHour,
            (Some((N::ReactiveWatt, 1)), Some((N::Hour, 1))) => Self::VarHour,
            (Some((N::ApparentWatt, 1)), Some((N::Hour, 1))) => Self::VoltAmpereHour,
            (Some((N::Joul, 1)), Some((N::Hour, -1))) => Self::JoulePerHour,
            (Some((N::Meter, 3)), Some((N::Hour, -1))) => Self::CubicMetrePerHour,
            (Some((N::Meter, 3)), Some((N::Minute, -1))) => Self::CubicMetrePerMinute,
            (Some((N::Meter, 3)), Some((N::Second, -1))) => Self::CubicMetrePerSecond,
            (Some((N::Kilogram, 1)), Some((N::Hour, -1))) => Self::KilogramPerHour,
            (Some((N::Watt, 1)), None) => Self::Watt,
            (Some((N::ReactiveWatt, 1)), None) => Self::Var,
            (Some((N::ApparentWatt, 1)), None) => Self::VoltAmpere,
            (Some((N::Joul, 1)), None) => Self::Joule,
            (Some((N::Meter, 3)), None) => Self::CubicMetre,
            (Some((N::Feet, 3)), None) => Self::CubicFoot,
            (Some((N::Kilogram, 1)), None) => Self::Kilogram,
            (Some((N::Tonne, 1)), None) => Self::Tonne,
            (Some((N::Second, 1)), None) => Self::Second,
            (Some((N::Minute, 1)), None) => Self::Minute,
            (Some((N::Hour, 1)), None) => Self::Hour,
            (Some((N::Day, 1)), None) => Self::Day,
            (Some((N::Month, 1)), None) => Self::Month,
            (Some((N::Year, 1)), None) => Self::Year,
            (Some((N::Celsius, 1)), None) => Self::Celsius,
            (Some((N::Kelvin, 1)), None) => Self::Kelvin,
            (Some((N::Fahrenheit, 1)), None) => Self::Fahrenheit,
            (Some((N::Bar, 1)), None) => Self::Bar,
            (Some((N::Volt, 1)), None) => Self::Volt,
            (Some((N::Ampere, 1)), None) => Self::Ampere,
            (Some((N::Hertz, 1)), None) => Self::Hertz,
            (Some((N::Percent, 1)), None) => Self::Percent,
            (Some((N::Degree, 1)), None) => Self::Degree,
            (Some((N::AmericanGallon, 1)), None) => Self::Gallon,
            _ => Self::None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_in_a_row() {
        assert!(Quantity::ALL.iter().enumerate().all(|(n, quantity)| *quantity as usize == n));
        assert!(Unit::ALL.iter().enumerate().all(|(n, unit)| *unit as usize == n));
    }
}
