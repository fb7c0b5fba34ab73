//! The quantity and the unit of a record, as the numbers in the data block of the program. A number never changes its
//! meaning; new numbers are added at the end.

use m_bus_application_layer::value_information::{Unit as CrateUnit, UnitName, ValueLabel};

/// Declares an enum from a row for each value: its number, and what the library calls so.
macro_rules! numbered {
    ($(#[$doc:meta])* $name:ident of $from:ty, by $library:ident {
        $($(#[$variant_doc:meta])* $variant:ident = $number:literal $(: $pattern:pat)?,)*
    }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(i16)]
        pub enum $name {
            $($(#[$variant_doc])* $variant = $number,)*
        }

        impl $name {
            /// All of them, by rising number.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            fn named(from: $from) -> Option<Self> {
                use $library::*;
                match from {
                    $($($pattern => Some(Self::$variant),)?)*
                    _ => None,
                }
            }
        }
    };
}

numbered! {
    /// The measured quantity, from the VIF.
    Quantity of ValueLabel, by ValueLabel {
        /// Another quantity: see the VIF.
        Other = 0,
        /// Energy: heat, cold or electricity.
        Energy = 1: Energy,
        /// Volume of what has flowed.
        Volume = 2: Volume,
        /// Mass of what has flowed.
        Mass = 3: Mass,
        /// Time the meter has been on.
        OnTime = 4: OnTime,
        /// Time the meter has been operating.
        OperatingTime = 5: OperatingTime,
        /// Power at the moment of the record.
        Power = 6: Power,
        /// Volume flow, volume for each unit of time.
        VolumeFlow = 7: VolumeFlow,
        /// Mass flow, mass for each unit of time.
        MassFlow = 8: MassFlow,
        /// Flow temperature: of the medium that comes to the consumer.
        FlowTemperature = 9: FlowTemperature,
        /// Return temperature: of the medium that leaves the consumer.
        ReturnTemperature = 10: ReturnTemperature,
        /// Difference of flow and return temperature.
        TemperatureDifference = 11: TemperatureDifference,
        /// Temperature outside the meter's medium.
        ExternalTemperature = 12: ExternalTemperature,
        /// Pressure of the medium.
        Pressure = 13: Pressure,
        /// A point in time.
        TimePoint = 14: Date | DateTime | DateTimeWithSeconds | Time,
        /// Units of a heat cost allocator.
        HeatCost = 15: DimensionlessHCA,
        /// Time over which the meter averages.
        AveragingDuration = 16: AveragingDuration,
        /// Age of the values.
        ActualityDuration = 17: ActualityDuration,
        /// Fabrication number of the meter.
        FabricationNumber = 18: FabricationNumber,
        /// Identification number of the meter.
        Identification = 19: EnhancedIdentification,
        /// Voltage of the supply that is measured.
        Voltage = 20: Voltage,
        /// Current of the supply that is measured.
        Current = 21: Current,
        /// Frequency of the supply that is measured.
        Frequency = 22: Frequency,
        /// Relative humidity of the air.
        Humidity = 23: RelativeHumidity,
        /// Error flags, bit by bit.
        ErrorFlags = 24: ErrorFlags,
        /// Digital inputs, bit by bit.
        DigitalInput = 25: DigitalInput,
        /// Digital outputs, bit by bit.
        DigitalOutput = 26: DigitalOutput,
        /// Version of the firmware.
        FirmwareVersion = 27: MetrologyFirmwareVersion,
        /// Version of other software.
        SoftwareVersion = 28: OtherSoftwareVersion,
        /// Version of the hardware.
        HardwareVersion = 29: HardwareVersion,
        /// Model or version of the meter, as a code or text.
        Model = 30: ModelOrVersion,
        /// Customer or location of the meter.
        Customer = 31: Customer | CustomerLocation,
        /// Operating time or remaining life of the battery.
        Battery = 32: OperatingTimeBattery | RemainingBatteryLifeTime,
        /// A number without a unit.
        Dimensionless = 33: Dimensionless,
        /// Reactive energy of an alternating current.
        ReactiveEnergy = 34: ReactiveEnergy,
        /// Apparent energy of an alternating current.
        ApparentEnergy = 35: ApparentEnergy,
        /// Reactive power of an alternating current.
        ReactivePower = 36: ReactivePower,
        /// Apparent power of an alternating current.
        ApparentPower = 37: ApparentPower,
        /// How often the meter was reset.
        ResetCounter = 38: ResetCounter,
        /// Manufacturer-specific: the manufacturer's documents say what.
        Manufacturer = 39: ManufacturerSpecific,
    }
}

numbered! {
    /// The unit of the value.
    Unit of &[(UnitName, i32)], by UnitName {
        /// No unit, or another unit.
        None = 0,
        /// Watt-hour, Wh: unit of energy.
        WattHour = 1: [(Watt, 1), (Hour, 1)],
        /// Joule, J: unit of energy.
        Joule = 2: [(Joul, 1)],
        /// Cubic metre, m3 (volume).
        CubicMetre = 3: [(Meter, 3)],
        /// Kilogram, kg: unit of mass.
        Kilogram = 4: [(Kilogram, 1)],
        /// Second, s: unit of time.
        Second = 5: [(Second, 1)],
        /// Minute, min: unit of time.
        Minute = 6: [(Minute, 1)],
        /// Hour, h: unit of time.
        Hour = 7: [(Hour, 1)],
        /// Day, d: unit of time.
        Day = 8: [(Day, 1)],
        /// Month of the calendar: unit of time.
        Month = 9: [(Month, 1)],
        /// Year of the calendar: unit of time.
        Year = 10: [(Year, 1)],
        /// Watt, W: unit of power.
        Watt = 11: [(Watt, 1)],
        /// Joule per hour, J/h (power).
        JoulePerHour = 12: [(Joul, 1), (Hour, -1)],
        /// Cubic metre per hour, m3/h (volume flow).
        CubicMetrePerHour = 13: [(Meter, 3), (Hour, -1)],
        /// Cubic metre per minute, m3/min (volume flow).
        CubicMetrePerMinute = 14: [(Meter, 3), (Minute, -1)],
        /// Cubic metre per second, m3/s (volume flow).
        CubicMetrePerSecond = 15: [(Meter, 3), (Second, -1)],
        /// Kilogram per hour, kg/h (mass flow).
        KilogramPerHour = 16: [(Kilogram, 1), (Hour, -1)],
        /// Degree Celsius: unit of temperature.
        Celsius = 17: [(Celsius, 1)],
        /// Kelvin, K (temperature difference).
        Kelvin = 18: [(Kelvin, 1)],
        /// Bar, 100 000 Pa (pressure).
        Bar = 19: [(Bar, 1)],
        /// Volt, V: unit of voltage.
        Volt = 20: [(Volt, 1)],
        /// Ampere, A: unit of current.
        Ampere = 21: [(Ampere, 1)],
        /// Hertz, Hz: unit of frequency.
        Hertz = 22: [(Hertz, 1)],
        /// Per cent, % (relative humidity).
        Percent = 23: [(Percent, 1)],
        /// Degree of an angle, 1/360 of a circle.
        Degree = 24: [(Degree, 1)],
        /// Volt-ampere-hour reactive, varh (reactive energy).
        VarHour = 25: [(ReactiveWatt, 1), (Hour, 1)],
        /// Volt-ampere-hour, VAh (apparent energy).
        VoltAmpereHour = 26: [(ApparentWatt, 1), (Hour, 1)],
        /// Volt-ampere reactive, var (reactive power).
        Var = 27: [(ReactiveWatt, 1)],
        /// Volt-ampere, VA (apparent power).
        VoltAmpere = 28: [(ApparentWatt, 1)],
        /// Tonne, t, 1000 kg (mass).
        Tonne = 29: [(Tonne, 1)],
        /// Degree Fahrenheit: unit of temperature.
        Fahrenheit = 30: [(Fahrenheit, 1)],
        /// Cubic feet (volume; 0.0283 m3 each).
        CubicFoot = 31: [(Feet, 3)],
        /// US gallons (volume; 3.785 l each).
        Gallon = 32: [(AmericanGallon, 1)],
    }
}

impl Quantity {
    /// The first label that has a number in this list.
    pub(crate) fn of(mut labels: impl Iterator<Item = ValueLabel>) -> Self {
        labels.find_map(Self::named).unwrap_or(Self::Other)
    }
}

impl Unit {
    /// The unit for a product of powers.
    pub(crate) fn of(units: impl Iterator<Item = CrateUnit>) -> Self {
        let mut powers = units.map(|unit| (unit.name, unit.exponent));
        match (powers.next(), powers.next()) {
            (Some(first), Some(second)) => Self::named(&[first, second]),
            (Some(only), None) => Self::named(&[only]),
            _ => None,
        }
        .unwrap_or(Self::None)
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
