//! SFC 26 UPDAT_PI, SFC 27 UPDAT_PO. ["Updating the Process Image"]

use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::Row;
use crate::services::{ImageError, Images};

params!(Update { Input { PART: BYTE } Return { RET_VAL: INT } Output { FLADDR: WORD } });

pub(super) const ROWS: &[Row] = &[
    Row::sfc::<Update>(26, "UPDAT_PI", |call| update(call, |images, part| images.update_inputs(part))),
    Row::sfc::<Update>(27, "UPDAT_PO", |call| update(call, |images, part| images.update_outputs(part))),
];

/// Partitions are 0 to 30.
const PARTITIONS: u8 = 30;

fn update(call: &mut Call<'_>, run: fn(&mut dyn Images, u8) -> Result<(), ImageError>) -> Done {
    let part = call.byte(Update::PART);
    let images = call.cx.images();
    let result = if part > PARTITIONS { Err(ImageError::Partition) } else { run(images, part) };
    if let Err(ImageError::Access(address)) = result {
        call.set(Update::FLADDR, u32::from(address));
    }
    let code = match result {
        Ok(()) => 0,
        Err(ImageError::Partition) => 0x8090,
        Err(ImageError::NotConfigured) => 0x8091,
        Err(ImageError::Access(_)) => 0x80A0,
    };
    call.end(Update::RET_VAL, code)
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
