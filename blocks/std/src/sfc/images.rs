//! SFC 26 UPDAT_PI, SFC 27 UPDAT_PO. ["Updating the Process Image"]

use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;
use crate::services::{ImageError, Images};

params!(Update { Input { PART: BYTE } Return { RET_VAL: INT } Output { FLADDR: WORD } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<Update>(26, "UPDAT_PI", |call| update(call, |images, part| images.update_inputs(part))),
    Row::coded::<Update>(27, "UPDAT_PO", |call| update(call, |images, part| images.update_outputs(part))),
];

/// Partitions are 0 to 30.
const PARTITIONS: u8 = 30;

fn update(call: &mut Call<'_>, run: fn(&mut dyn Images, u8) -> Result<(), ImageError>) -> Code {
    let part = call.byte(Update::PART);
    match if part > PARTITIONS { Err(ImageError::Partition) } else { run(call.cx.services(), part) } {
        Ok(()) => Ok(0),
        Err(ImageError::Partition) => Err(0x8090),
        Err(ImageError::NotConfigured) => Err(0x8091),
        Err(ImageError::Access(address)) => {
            call.set(Update::FLADDR, u32::from(address));
            Err(0x80A0)
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::services::ImageError;
    use crate::tests::Fake;

    #[test]
    fn updates() {
        for (key, part, error, code, address, updates) in [
            ("SYSTEM:SFC26", 0, None, 0, 9, vec![('E', 0)]),
            ("SYSTEM:SFC27", 3, None, 0, 9, vec![('A', 3)]),
            ("SYSTEM:SFC26", 31, None, 0x8090, 9, vec![]),
            ("SYSTEM:SFC27", 4, Some(ImageError::NotConfigured), 0x8091, 9, vec![('A', 4)]),
            ("SYSTEM:SFC26", 0, Some(ImageError::Access(0x100)), 0x80A0, 0x100, vec![('E', 0)]),
        ] {
            let mut fake = Fake::new(key).with("PART", [part]).with("RET_VAL", [9; 2]).with("FLADDR", [0, 9]);
            fake.station.image_error = error;
            fake.run();
            assert_eq!(
                (fake.value("RET_VAL"), fake.value("FLADDR"), fake.br),
                (code, address, code == 0),
                "{key} {part}"
            );
            assert_eq!(fake.station.updates, updates);
        }
    }
}
