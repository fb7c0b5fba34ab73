//! TLS to the broker: rustls with ring, as everywhere in the gate.

use std::sync::Arc;

use ob1_access::settings::TlsFiles;
use rumqttc::tokio_rustls::rustls::crypto::ring;
use rumqttc::tokio_rustls::rustls::pki_types::pem::PemObject as _;
use rumqttc::tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rumqttc::tokio_rustls::rustls::{ClientConfig, RootCertStore};
use rumqttc::{TlsConfiguration, Transport};

/// The transport of a link. Its files are read again for each connection, as the password is: renewed certificates need
/// no restart.
pub(crate) struct Tls {
    files: TlsFiles,
    newest: Transport,
}

impl Tls {
    /// Reads the files for the first time.
    ///
    /// # Errors
    /// Which file cannot be used, and why.
    pub(crate) fn open(files: &TlsFiles) -> Result<Self, String> {
        Ok(Self { newest: transport(files)?, files: files.clone() })
    }

    /// The transport for another connection. If its files cannot be used now it is the one before, and the text says
    /// why.
    pub(crate) fn again(&mut self) -> (Transport, Option<String>) {
        let why = match transport(&self.files) {
            Ok(newest) => {
                self.newest = newest;
                None
            }
            Err(why) => Some(why),
        };
        (self.newest.clone(), why)
    }
}

/// The transport to a broker whose certificate is signed by the given one.
///
/// # Errors
/// Which file cannot be used, and why.
fn transport(files: &TlsFiles) -> Result<Transport, String> {
    let wrong = |path: &std::path::Path, why: &dyn std::fmt::Display| format!("{}: {why}", path.display());
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_file_iter(&files.ca).map_err(|error| wrong(&files.ca, &error))? {
        let added = certificate.map_err(|error| wrong(&files.ca, &error)).map(|certificate| roots.add(certificate))?;
        added.map_err(|error| wrong(&files.ca, &error))?;
    }
    if roots.is_empty() {
        return Err(wrong(&files.ca, &"there is no certificate in it"));
    }
    let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?
        .with_root_certificates(roots);
    let config = match &files.own {
        None => builder.with_no_client_auth(),
        Some((certificate, key)) => {
            let chain = CertificateDer::pem_file_iter(certificate).map_err(|error| wrong(certificate, &error))?;
            let chain = chain.collect::<Result<Vec<_>, _>>().map_err(|error| wrong(certificate, &error))?;
            let own = PrivateKeyDer::from_pem_file(key).map_err(|error| wrong(key, &error))?;
            builder.with_client_auth_cert(chain, own).map_err(|error| wrong(certificate, &error))?
        }
    };
    Ok(Transport::tls_with_config(TlsConfiguration::Rustls(Arc::new(config))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn renewed_files_are_read_for_the_next_connection() {
        let folder = tempfile::tempdir().expect("a folder");
        let ca = folder.path().join("ca.pem");
        let good = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fixtures/tls/test.crt");
        std::fs::write(&ca, "nonsense").expect("a file");
        let files = TlsFiles { ca: ca.clone(), own: None };
        assert!(Tls::open(&files).is_err_and(|why| why.contains("ca.pem")));
        std::fs::copy(good, &ca).expect("a fixture");
        let mut tls = Tls::open(&files).expect("right");
        assert_eq!(tls.again().1, None);
        std::fs::write(&ca, "").expect("a file");
        assert!(tls.again().1.is_some_and(|why| why.contains("no certificate")));
        std::fs::copy(good, &ca).expect("a fixture");
        assert_eq!(tls.again().1, None);
    }
}
