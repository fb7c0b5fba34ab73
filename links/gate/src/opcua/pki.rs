//! The server's own key and certificate, created once, and the folders of clients' certificates.

use std::fs::{self, DirBuilder, OpenOptions};
use std::net::IpAddr;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use opcua_crypto::{CertificateStore, X509Data};

/// Bits of a new key.
const KEY_BITS: u32 = 2048;
/// Validity of a new certificate: plants are not visited every year.
const DAYS: u32 = 3650;

/// Maximum of unknown certificates kept.
const REJECTED: usize = 100;

/// The places of the server's certificates.
#[derive(Clone, Debug)]
pub(crate) struct Pki {
    pub(crate) folder: PathBuf,
    pub(crate) certificate: PathBuf,
    pub(crate) key: PathBuf,
}

/// The folders below the state folder of the link, with a key and a certificate, which are created if missing.
///
/// # Errors
/// The system's error, or that others can read the key.
pub(crate) fn open(state: &Path, name: &str, uri: &str, address: IpAddr) -> Result<Pki, String> {
    let folder = state.join("pki");
    for part in ["own", "private", "trusted", "rejected"] {
        let path = folder.join(part);
        let made = DirBuilder::new().recursive(true).mode(0o700).create(&path);
        made.map_err(|error| format!("{}: {error}", path.display()))?;
    }
    let pki = Pki { certificate: folder.join("own/cert.der"), key: folder.join("private/private.pem"), folder };
    if !pki.certificate.exists() || !pki.key.exists() {
        make(&pki, name, uri, address)?;
    }
    let about = fs::metadata(&pki.key).map_err(|error| format!("{}: {error}", pki.key.display()))?;
    let mode = about.permissions().mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(format!("{0} can be read by others (mode {mode:03o}): chmod 600 {0}", pki.key.display()));
    }
    Ok(pki)
}

/// Created under other names first, so that an interrupted start leaves no incomplete pair.
fn make(pki: &Pki, name: &str, uri: &str, address: IpAddr) -> Result<(), String> {
    let (certificate, key) = (pki.certificate.with_extension("new"), pki.key.with_extension("new"));
    let own = (!address.is_unspecified()).then(|| vec![address.to_string()]);
    let names = X509Data::alt_host_names(uri, own, true, true, false);
    let data = X509Data {
        key_size: KEY_BITS,
        common_name: name.to_owned(),
        organization: "ob1".to_owned(),
        organizational_unit: "ob1".to_owned(),
        country: "XX".to_owned(),
        state: "-".to_owned(),
        alt_host_names: names,
        certificate_duration_days: DAYS,
    };
    let told = |path: &Path| {
        let path = path.display().to_string();
        move |error: std::io::Error| format!("{path}: {error}")
    };
    // The library writes into the existing file, which nobody else has ever been able to read.
    let _ = fs::remove_file(&key);
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(&key).map_err(told(&key))?;
    CertificateStore::create_certificate_and_key(&data, true, &certificate, &key)?;
    fs::rename(&key, &pki.key).map_err(told(&key))?;
    fs::rename(&certificate, &pki.certificate).map_err(told(&certificate))
}

/// Keeps only the newest certificates of unknown clients for inspection: strangers can send any number.
pub(crate) fn prune(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder.join("rejected")) else { return };
    let mut found: Vec<_> = entries
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            Some((fs::metadata(&path).ok()?.modified().ok()?, path))
        })
        .collect();
    found.sort_unstable();
    for (_, path) in found.iter().take(found.len().saturating_sub(REJECTED)) {
        let _ = fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::Permissions;

    #[test]
    fn a_key_is_made_once_and_is_nobody_elses() {
        let folder = tempfile::tempdir().expect("a folder");
        let here = IpAddr::from([127, 0, 0, 1]);
        let pki = open(folder.path(), "ob1 press", "urn:ob1:press", here).expect("made");
        let mode = |path: &Path| fs::metadata(path).expect("there").permissions().mode() & 0o777;
        assert_eq!((mode(&pki.key), mode(&pki.folder.join("private"))), (0o600, 0o700));
        let first = fs::read(&pki.certificate).expect("there");
        open(folder.path(), "ob1 press", "urn:ob1:press", here).expect("there");
        assert_eq!(fs::read(&pki.certificate).expect("there"), first);
        fs::set_permissions(&pki.key, Permissions::from_mode(0o640)).expect("a mode");
        let told = open(folder.path(), "ob1 press", "urn:ob1:press", here).expect_err("others can read it");
        assert!(told.contains("chmod 600"), "{told}");
    }

    #[test]
    fn strangers_do_not_fill_the_disk() {
        let folder = tempfile::tempdir().expect("a folder");
        let rejected = folder.path().join("rejected");
        prune(folder.path());
        fs::create_dir(&rejected).expect("a folder");
        for number in 0..REJECTED + 20 {
            fs::write(rejected.join(format!("{number}.der")), "x").expect("a file");
        }
        prune(folder.path());
        assert_eq!(fs::read_dir(&rejected).expect("a folder").count(), REJECTED);
    }
}
