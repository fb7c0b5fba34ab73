//! SFC 5 GADR_LGC, SFC 49 LGC_GADR, SFC 50 RD_LGADR, SFC 70 GEO_LOG, SFC 71 LOG_GEO: from the place of a module to its
//! logical addresses and back. ["Addressing Modules"]

use crate::AnyType;
use crate::call::{Call, Code, write_error};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::services::{NoPlace, Placed};

params!(GadrLgc {
    Input { SUBNETID: BYTE, RACK: WORD, SLOT: WORD, SUBSLOT: BYTE, SUBADDR: WORD }
    Return { RET_VAL: INT }
    Output { IOID: BYTE, LADDR: WORD }
});
params!(LgcGadr {
    Input { IOID: BYTE, LADDR: WORD }
    Return { RET_VAL: INT }
    Output { AREA: BYTE, RACK: WORD, SLOT: WORD, SUBADDR: WORD }
});
params!(RdLgadr {
    Input { IOID: BYTE, LADDR: WORD }
    Return { RET_VAL: INT }
    Output { PEADDR: ANY, PECOUNT: INT, PAADDR: ANY, PACOUNT: INT }
});
params!(GeoLog {
    Input { MASTER: INT, STATION: INT, SLOT: INT, SUBSLOT: INT }
    Return { RET_VAL: INT }
    Output { LADDR: WORD }
});
params!(LogGeo {
    Input { LADDR: WORD }
    Return { RET_VAL: INT }
    Output { AREA: INT, MASTER: INT, STATION: INT, SLOT: INT, SUBSLOT: INT, OFFSET: INT }
});

pub(super) const ROWS: &[Row] = &[
    Row::coded::<GadrLgc>(5, "GADR_LGC", gadr_lgc),
    Row::coded::<LgcGadr>(49, "LGC_GADR", lgc_gadr),
    Row::coded::<RdLgadr>(50, "RD_LGADR", rd_lgadr),
    Row::coded::<GeoLog>(70, "GEO_LOG", geo_log),
    Row::coded::<LogGeo>(71, "LOG_GEO", log_geo),
];

/// Identifier of the peripheral inputs.
const INPUTS: u8 = 0x54;
/// Identifier of the peripheral outputs.
const OUTPUTS: u8 = 0x55;
/// Bit of LADDR that stands for an output (SFC 70, 71).
const OUTPUT_BIT: u16 = 0x8000;

/// No module has this logical address, or the identifier of the area is wrong.
const NO_ADDRESS: u16 = 0x8090;
/// There is no such subnet.
const NO_SUBNET: u16 = 0x8094;
/// No such rack, or station.
const NO_RACK: u16 = 0x8095;
/// There is no such slot.
const NO_SLOT: u16 = 0x8096;
/// A central module has no subslots.
const NO_SUBSLOT: u16 = 0x8097;
/// No such offset in the module's addresses.
const NO_OFFSET: u16 = 0x8098;
/// Nothing is configured in the slot.
const EMPTY: u16 = 0x8099;
/// The module has no address of its own.
const NO_INTERFACE: u16 = 0x809A;

/// The highest slot of a rack.
const LAST_SLOT: u16 = 18;

/// What SFC 49 and SFC 71 call the area of a distributed module.
const DISTRIBUTED: u8 = 2;

/// Where the addresses of a module begin: the inputs, unless it has none or its outputs lie lower; of a station itself
/// its diagnostic address.
fn base(placed: &Placed) -> Option<(u8, u16, u16)> {
    let (inputs, outputs) = (placed.inputs, placed.outputs);
    match (inputs.1 > 0, outputs.1 > 0) {
        (false, false) if placed.master != 0 => Some((INPUTS, inputs.0, 1)),
        (false, false) => None,
        (true, true) if outputs.0 < inputs.0 => Some((OUTPUTS, outputs.0, outputs.1)),
        (false, true) => Some((OUTPUTS, outputs.0, outputs.1)),
        (true, _) => Some((INPUTS, inputs.0, inputs.1)),
    }
}

/// The module in a slot of the central rack, or of a station of a master system, with the codes SFC 5 and SFC 70 share.
fn module_in(call: &mut Call<'_>, master: u16, rack: u16, slot: u16) -> Result<Placed, u16> {
    let services = call.cx.services();
    if master != 0 {
        return services.module_on(master, rack, slot).map_err(|missing| match missing {
            NoPlace::Master => NO_SUBNET,
            NoPlace::Station => NO_RACK,
            NoPlace::Slot => EMPTY,
        });
    }
    if rack != 0 {
        return Err(NO_RACK);
    }
    if !(1..=LAST_SLOT).contains(&slot) {
        return Err(NO_SLOT);
    }
    services.module_in(rack, slot).ok_or(EMPTY)
}

/// The area and the rack of a module, as SFC 49 and SFC 71 tell them.
fn area_of(call: &mut Call<'_>, placed: &Placed) -> u8 {
    if placed.master != 0 { DISTRIBUTED } else { call.cx.services().area() }
}

fn gadr_lgc(call: &mut Call<'_>) -> Code {
    let (rack, slot, offset) = (call.word(GadrLgc::RACK), call.word(GadrLgc::SLOT), call.word(GadrLgc::SUBADDR));
    let master = u16::from(call.byte(GadrLgc::SUBNETID));
    let placed = module_in(call, master, rack, slot)?;
    if call.byte(GadrLgc::SUBSLOT) != 0 {
        return Err(NO_SUBSLOT);
    }
    let (area, first, bytes) = base(&placed).ok_or(NO_INTERFACE)?;
    if offset >= bytes {
        return Err(NO_OFFSET);
    }
    call.set(GadrLgc::IOID, u32::from(area));
    call.set(GadrLgc::LADDR, u32::from(first + offset));
    Ok(0)
}

/// The module an identifier of the area and an address name.
fn with_address(call: &mut Call<'_>, area: u8, address: u16) -> Result<Placed, u16> {
    let output = match area {
        INPUTS => false,
        OUTPUTS => true,
        _ => return Err(NO_ADDRESS),
    };
    call.cx.services().module_with(address, output).ok_or(NO_ADDRESS)
}

fn lgc_gadr(call: &mut Call<'_>) -> Code {
    let (area, address) = (call.byte(LgcGadr::IOID), call.word(LgcGadr::LADDR));
    let placed = with_address(call, area, address)?;
    let kind = area_of(call, &placed);
    let first = if area == OUTPUTS { placed.outputs.0 } else { placed.inputs.0 };
    call.set(LgcGadr::AREA, u32::from(kind));
    call.set(LgcGadr::RACK, u32::from(u16::from(placed.master) << 8 | placed.rack));
    call.set(LgcGadr::SLOT, u32::from(placed.slot));
    call.set(LgcGadr::SUBADDR, u32::from(address - first));
    Ok(0)
}

fn rd_lgadr(call: &mut Call<'_>) -> Code {
    // With IOID 0 bit 15 of the address says which area is meant.
    let (area, address) = match (call.byte(RdLgadr::IOID), call.word(RdLgadr::LADDR)) {
        (0, address) if address & OUTPUT_BIT != 0 => (OUTPUTS, address & !OUTPUT_BIT),
        (0, address) => (INPUTS, address),
        given => given,
    };
    let placed = with_address(call, area, address)?;
    let inputs = addresses(call, RdLgadr::PEADDR, placed.inputs, [0x80A0, 0x80A2]);
    let outputs = addresses(call, RdLgadr::PAADDR, placed.outputs, [0x80A1, 0x80A3]);
    inputs.and(outputs)?;
    call.set(RdLgadr::PECOUNT, u32::from(placed.inputs.1));
    call.set(RdLgadr::PACOUNT, u32::from(placed.outputs.1));
    Ok(0)
}

/// Writes the addresses of a range as words. `codes`: the field is not of words, the field is too short.
fn addresses(call: &mut Call<'_>, p: impl Params, (first, bytes): (u16, u16), codes: [u16; 2]) -> Result<(), u16> {
    let Some(any) = call.any(p).filter(|any| any.ty != AnyType::Nil) else {
        return if bytes == 0 { Ok(()) } else { Err(codes[1]) };
    };
    if any.ty != AnyType::Word {
        return Err(codes[0]);
    }
    if any.count < bytes {
        return Err(codes[1]);
    }
    (0..bytes).try_for_each(|i| {
        let word = (first + i).to_be_bytes();
        call.write_at(&any, u32::from(i) * 2, &word).map_err(|e| write_error(p.index() + 1, e))
    })
}

fn geo_log(call: &mut Call<'_>) -> Code {
    // Negative numbers are no racks and no slots either.
    let (master, rack, slot) = (call.word(GeoLog::MASTER), call.word(GeoLog::STATION), call.word(GeoLog::SLOT));
    let placed = module_in(call, master, rack, slot)?;
    if call.int(GeoLog::SUBSLOT) != 0 {
        return Err(NO_SUBSLOT);
    }
    let (area, first, _) = base(&placed).ok_or(NO_INTERFACE)?;
    call.set(GeoLog::LADDR, u32::from(if area == OUTPUTS { first | OUTPUT_BIT } else { first }));
    Ok(0)
}

fn log_geo(call: &mut Call<'_>) -> Code {
    let given = call.word(LogGeo::LADDR);
    let (address, output) = (given & !OUTPUT_BIT, given & OUTPUT_BIT != 0);
    let placed = with_address(call, if output { OUTPUTS } else { INPUTS }, address)?;
    let kind = area_of(call, &placed);
    let first = if output { placed.outputs.0 } else { placed.inputs.0 };
    for (p, value) in [
        (LogGeo::AREA, u16::from(kind)),
        (LogGeo::MASTER, u16::from(placed.master)),
        (LogGeo::STATION, placed.rack),
        (LogGeo::SLOT, placed.slot),
        (LogGeo::SUBSLOT, 0),
        (LogGeo::OFFSET, address - first),
    ] {
        call.set(p, u32::from(value));
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::Placed;
    use crate::tests::{Fake, any};

    /// Slot 4: inputs alone; 5: outputs alone; 6: both, the outputs lower; 7: no addresses. On master system 1
    /// station 8: itself, at 2046, and slot 3.
    fn fake(key: &str) -> Fake {
        let mut fake = Fake::new(key).with("RET_VAL", [9; 2]);
        for (slot, inputs, outputs) in
            [(4, (0, 4), (0, 0)), (5, (0, 0), (4, 2)), (6, (272, 16), (256, 16)), (7, (0, 0), (0, 0))]
        {
            fake.station.placed.push(Placed { master: 0, rack: 0, slot, inputs, outputs });
        }
        for (slot, inputs, outputs) in [(0, (2046, 0), (2046, 0)), (3, (512, 4), (512, 0))] {
            fake.station.placed.push(Placed { master: 1, rack: 8, slot, inputs, outputs });
        }
        fake
    }

    #[test]
    fn from_the_place() {
        // subnet, rack, slot, subslot, offset; code, area, address
        for (place, code, area, address) in [
            ([0u16, 0, 4, 0, 3], 0, 0x54, 3),
            ([0, 0, 5, 0, 0], 0, 0x55, 4),
            ([0, 0, 6, 0, 15], 0, 0x55, 271),
            ([1, 8, 3, 0, 3], 0, 0x54, 515),
            ([1, 8, 0, 0, 0], 0, 0x54, 2046),
            ([2, 8, 3, 0, 0], 0x8094, 7, 7),
            ([1, 9, 3, 0, 0], 0x8095, 7, 7),
            ([1, 8, 4, 0, 0], 0x8099, 7, 7),
            ([0, 1, 4, 0, 0], 0x8095, 7, 7),
            ([0, 0, 0, 0, 0], 0x8096, 7, 7),
            ([0, 0, 19, 0, 0], 0x8096, 7, 7),
            ([0, 0, 4, 1, 0], 0x8097, 7, 7),
            ([0, 0, 4, 0, 4], 0x8098, 7, 7),
            ([0, 0, 8, 0, 0], 0x8099, 7, 7),
            ([0, 0, 7, 0, 0], 0x809A, 7, 7),
        ] {
            let [subnet, rack, slot, subslot, offset] = place;
            let mut fake = fake("SYSTEM:SFC5").with("SUBNETID", [subnet as u8]).with("SUBSLOT", [subslot as u8]);
            fake = fake.with("RACK", rack.to_be_bytes()).with("SLOT", slot.to_be_bytes());
            fake = fake.with("SUBADDR", offset.to_be_bytes()).with("IOID", [7]).with("LADDR", [0, 7]);
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("IOID"), fake.value("LADDR"));
            assert_eq!(result, (code, area, address), "{place:?}");
            assert_eq!(fake.br, code == 0);
        }
        for (place, code, address) in [
            ([0i16, 0, 4, 0], 0, 0u32),
            ([0, 0, 5, 0], 0, 0x8004),
            ([0, 0, 6, 0], 0, 0x8100),
            ([1, 8, 3, 0], 0, 512),
            ([1, 8, 0, 0], 0, 2046),
            ([2, 8, 3, 0], 0x8094, 7),
            ([-1, 0, 4, 0], 0x8094, 7),
            ([1, 9, 3, 0], 0x8095, 7),
            ([1, 8, 5, 0], 0x8099, 7),
            ([0, -1, 4, 0], 0x8095, 7),
            ([0, 0, -1, 0], 0x8096, 7),
            ([0, 0, 4, 1], 0x8097, 7),
            ([0, 0, 9, 0], 0x8099, 7),
        ] {
            let [master, station, slot, subslot] = place.map(i16::to_be_bytes);
            let mut fake = fake("SYSTEM:SFC70").with("MASTER", master).with("STATION", station);
            fake = fake.with("SLOT", slot).with("SUBSLOT", subslot).with("LADDR", [0, 7]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("LADDR")), (code, address), "{place:?}");
        }
    }

    #[test]
    fn from_the_address() {
        for (area, address, code, slot, offset) in [
            (0x54u8, 2u16, 0, 4, 2),
            (0x55, 5, 0, 5, 1),
            (0x54, 272, 0, 6, 0),
            (0x55, 271, 0, 6, 15),
            (0x55, 2, 0x8090, 7, 7),
            (0x54, 4, 0x8090, 7, 7),
            (0x56, 2, 0x8090, 7, 7),
        ] {
            let mut fake = fake("SYSTEM:SFC49").with("IOID", [area]).with("LADDR", address.to_be_bytes());
            for name in ["RACK", "SLOT", "SUBADDR"] {
                fake = fake.with(name, [0, 7]);
            }
            fake = fake.with("AREA", [7]);
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("SLOT"), fake.value("SUBADDR"));
            assert_eq!(result, (code, slot, offset), "{area:X} {address}");
            assert_eq!(fake.value("AREA"), if code == 0 { 1 } else { 7 });
        }
        for (address, code, slot, offset) in
            [(2u16, 0, 4, 2), (0x8005, 0, 5, 1), (0x810F, 0, 6, 15), (0x8002, 0x8090, 7, 7)]
        {
            let mut fake = fake("SYSTEM:SFC71").with("LADDR", address.to_be_bytes());
            for name in ["AREA", "MASTER", "STATION", "SLOT", "SUBSLOT", "OFFSET"] {
                fake = fake.with(name, [0, 7]);
            }
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("SLOT"), fake.value("OFFSET"));
            assert_eq!(result, (code, slot, offset), "{address:X}");
        }
    }

    #[test]
    fn from_the_address_of_a_distributed_module() {
        for (address, slot, offset) in [(514u16, 3, 2), (2046, 0, 0)] {
            let mut one = fake("SYSTEM:SFC49").with("IOID", [0x54]).with("LADDR", address.to_be_bytes());
            for name in ["RACK", "SLOT", "SUBADDR"] {
                one = one.with(name, [0, 7]);
            }
            one = one.with("AREA", [7]);
            one.run();
            let result = ["RET_VAL", "AREA", "RACK", "SLOT", "SUBADDR"].map(|name| one.value(name));
            assert_eq!(result, [0, 2, 0x0108, slot, offset], "{address}");
            let mut other = fake("SYSTEM:SFC71").with("LADDR", address.to_be_bytes());
            for name in ["AREA", "MASTER", "STATION", "SLOT", "SUBSLOT", "OFFSET"] {
                other = other.with(name, [0, 7]);
            }
            other.run();
            let result = ["RET_VAL", "AREA", "MASTER", "STATION", "SLOT", "OFFSET"].map(|name| other.value(name));
            assert_eq!(result, [0, 2, 1, 8, slot, offset], "{address}");
        }
    }

    #[test]
    fn all_addresses_of_a_module() {
        for (inputs, outputs, code) in [
            (any(4, 16, 0), any(4, 16, 100), 0),
            (any(2, 32, 0), any(4, 16, 100), 0x80A0),
            (any(4, 16, 0), any(6, 16, 100), 0x80A1),
            (any(4, 15, 0), any(4, 16, 100), 0x80A2),
            (any(4, 16, 0), any(4, 15, 100), 0x80A3),
            (any(4, 16, 240), any(4, 16, 100), 0x8423),
        ] {
            let mut fake = fake("SYSTEM:SFC50").with("IOID", [0x54]).with("LADDR", 280u16.to_be_bytes());
            fake = fake.with("PEADDR", inputs).with("PAADDR", outputs).with("PECOUNT", [0; 2]).with("PACOUNT", [0; 2]);
            fake.run();
            assert_eq!(fake.value("RET_VAL"), code);
            if code == 0 {
                assert_eq!((fake.value("PECOUNT"), fake.value("PACOUNT")), (16, 16));
                assert_eq!((fake.memory_at(0, 4), fake.memory_at(130, 2)), (&[1, 16, 1, 17][..], &[1, 15][..]));
            }
        }
        // A field for what the module does not have may be NIL.
        let mut fake = fake("SYSTEM:SFC50").with("IOID", [0]).with("LADDR", 0x8004u16.to_be_bytes());
        fake = fake.with("PEADDR", any(0, 0, 0)).with("PAADDR", any(4, 2, 100)).with("PECOUNT", [9; 2]);
        fake = fake.with("PACOUNT", [9; 2]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.value("PECOUNT"), fake.value("PACOUNT")), (0, 0, 2));
    }
}
