//! TLS of the gate: one provider of cryptography (ring), a certificate and its key from files that may change.

use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use rustls::ServerConfig;
use rustls::crypto::ring::default_provider;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::TlsAcceptor;

/// A certificate chain and its key, for a server.
#[derive(Clone, Debug)]
pub(crate) struct Tls {
    certificate: PathBuf,
    key: PathBuf,
    loaded: Arc<Mutex<(Stamp, Arc<ServerConfig>)>>,
}

type Stamp = [(i64, u64, u64); 2];

impl Tls {
    /// From PEM files; only the station's user may read the key.
    ///
    /// # Errors
    /// Which file is wrong, and why.
    pub(crate) fn load(certificate: &Path, key: &Path) -> io::Result<Self> {
        let loaded = Arc::new(Mutex::new((stamps(certificate, key)?, config(certificate, key)?)));
        Ok(Self { certificate: certificate.to_owned(), key: key.to_owned(), loaded })
    }

    /// The acceptor for new connections.
    #[must_use]
    pub(crate) fn acceptor(&self) -> TlsAcceptor {
        let loaded = self.loaded.lock().unwrap_or_else(PoisonError::into_inner);
        TlsAcceptor::from(Arc::clone(&loaded.1))
    }

    /// Reloads the files if they have changed: a certificate is renewed without a restart.
    ///
    /// # Errors
    /// Which file is wrong, and why; the previous certificate then stays.
    pub(crate) fn refresh(&self) -> io::Result<bool> {
        let now = stamps(&self.certificate, &self.key)?;
        if self.loaded.lock().unwrap_or_else(PoisonError::into_inner).0 == now {
            return Ok(false);
        }
        let config = config(&self.certificate, &self.key)?;
        *self.loaded.lock().unwrap_or_else(PoisonError::into_inner) = (now, config);
        Ok(true)
    }
}

fn named(path: &Path, why: impl std::fmt::Display) -> io::Error {
    io::Error::other(format!("{}: {why}", path.display()))
}

fn stamps(certificate: &Path, key: &Path) -> io::Result<Stamp> {
    let stamp = |path: &Path| {
        let about = std::fs::metadata(path).map_err(|error| named(path, error))?;
        Ok::<_, io::Error>((about.mtime(), about.ino(), about.len()))
    };
    Ok([stamp(certificate)?, stamp(key)?])
}

fn config(certificate: &Path, key: &Path) -> io::Result<Arc<ServerConfig>> {
    let mode = std::fs::metadata(key).map_err(|error| named(key, error))?.mode() & 0o7777;
    if mode & 0o077 != 0 {
        return Err(named(key, format!("can be read or written by others (mode {mode:03o}): chmod 600")));
    }
    let chain = CertificateDer::pem_file_iter(certificate).map_err(|error| named(certificate, error))?;
    let chain = chain.collect::<Result<Vec<_>, _>>().map_err(|error| named(certificate, error))?;
    if chain.is_empty() {
        return Err(named(certificate, "there is no certificate in it (PEM)"));
    }
    let secret = PrivateKeyDer::from_pem_file(key).map_err(|error| named(key, error))?;
    let config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, secret))
        .map_err(|error| named(certificate, error))?;
    Ok(Arc::new(config))
}
