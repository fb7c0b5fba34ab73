//! Logins and rights: anonymous clients read, where that is allowed; users are those of the gate.

use std::collections::HashMap;

use crate::shared::{Audit, Source, Users};
use async_trait::async_trait;
use ob1_access::Right;
use opcua_crypto::SecurityPolicy;
use opcua_server::ServerEndpoint;
use opcua_server::authenticator::{AuthManager, Password, UserToken, user_pass_security_policy_id};
use opcua_types::{Error, StatusCode, UAString, UserTokenPolicy, UserTokenType};
use parking_lot::Mutex;

/// The token that the server gives all anonymous clients.
const ANONYMOUS: &str = "ANONYMOUS";
/// Maximum of users remembered with their rights; the file has fewer.
const REMEMBERED: usize = 10_000;

/// Whether this is an anonymous client.
pub(crate) fn is_anonymous(token: &UserToken) -> bool {
    token.0 == ANONYMOUS
}

/// See [the module](self).
pub(crate) struct Auth {
    users: Option<Users>,
    anonymous: bool,
    audit: Audit,
    /// The rights of users who have logged in.
    known: Mutex<HashMap<String, Right>>,
}

impl Auth {
    pub(crate) fn new(users: Option<Users>, anonymous: bool, audit: Audit) -> Self {
        Self { users, anonymous, audit, known: Mutex::default() }
    }

    /// The present right of a session: a user removed from the file has none.
    pub(crate) fn right(&self, token: &UserToken) -> Right {
        if is_anonymous(token) {
            return Right::Read;
        }
        let known = self.known.lock().get(&token.0).copied();
        let now = self.users.as_ref().and_then(|users| users.right(&token.0));
        known.zip(now).map_or(Right::Read, |(known, now)| known.min(now))
    }

    /// The name for the audit log.
    pub(crate) fn user(&self, token: &UserToken) -> String {
        if is_anonymous(token) { "-".to_owned() } else { token.0.clone() }
    }
}

fn rejected(why: impl std::fmt::Display) -> Error {
    Error::new(StatusCode::BadIdentityTokenRejected, why.to_string())
}

#[async_trait]
impl AuthManager for Auth {
    async fn authenticate_anonymous_token(&self, _endpoint: &ServerEndpoint) -> Result<(), Error> {
        if self.anonymous { Ok(()) } else { Err(rejected("anonymous clients are not allowed")) }
    }

    async fn authenticate_username_identity_token(
        &self,
        endpoint: &ServerEndpoint,
        username: &str,
        password: &Password,
    ) -> Result<UserToken, Error> {
        let users = self.users.as_ref().ok_or_else(|| rejected("this link has no users"))?;
        // The library does not tell the address of a client.
        let outcome = users.login(username, password.get(), &Source::unknown()).await;
        let login = outcome.map_err(|why| {
            self.audit.refused(username, &endpoint.security_policy, "login", &why.to_string());
            rejected(why)
        })?;
        let noted = self.audit.note(username, &endpoint.security_policy, "login", "done");
        if login.right > Right::Read {
            noted.map_err(rejected)?;
        }
        let mut known = self.known.lock();
        if known.len() >= REMEMBERED {
            known.clear();
        }
        known.insert(login.user.clone(), login.right);
        Ok(UserToken(login.user))
    }

    fn user_token_policies(&self, endpoint: &ServerEndpoint) -> Vec<UserTokenPolicy> {
        let policy = |id: UAString, token_type, security_policy_uri: UAString| UserTokenPolicy {
            policy_id: id,
            token_type,
            issued_token_type: UAString::null(),
            issuer_endpoint_url: UAString::null(),
            security_policy_uri,
        };
        let mut policies = Vec::new();
        if self.anonymous {
            policies.push(policy("anonymous".into(), UserTokenType::Anonymous, UAString::null()));
        }
        if self.users.is_some() {
            // Over a channel without security only the password is encrypted, with the server's key.
            let own = match endpoint.security_policy() {
                SecurityPolicy::None => endpoint.password_security_policy().to_uri().into(),
                _ => UAString::null(),
            };
            policies.push(policy(user_pass_security_policy_id(endpoint), UserTokenType::UserName, own));
        }
        policies
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{Permissions, set_permissions, write};
    use std::os::unix::fs::PermissionsExt as _;

    #[tokio::test]
    async fn wrong_passwords_keep_nobody_else_out() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.users");
        write(&path, format!("anna:write:{}\n", crate::shared::hash("a secret"))).expect("a file");
        set_permissions(&path, Permissions::from_mode(0o600)).expect("a mode");
        let auth = Auth::new(Some(Users::read(&path).expect("right")), false, Audit::none("ua"));
        let (_, endpoint) = crate::opcua::endpoints(true).pop().expect("endpoints");
        let (wrong, right) = (Password::new("wrong".to_owned()), Password::new("a secret".to_owned()));
        // More than one address may guess before it has to wait.
        for number in 0..15 {
            let stranger = format!("panel{number}");
            let told = auth.authenticate_username_identity_token(&endpoint, &stranger, &wrong).await;
            assert!(told.is_err(), "{stranger}");
        }
        let anna = auth.authenticate_username_identity_token(&endpoint, "anna", &right).await;
        assert_eq!(anna.map(|token| token.0).map_err(|error| error.to_string()), Ok("anna".to_owned()));
        // Nor do wrong passwords for her own name.
        assert!(auth.authenticate_username_identity_token(&endpoint, "anna", &wrong).await.is_err());
        assert!(auth.authenticate_username_identity_token(&endpoint, "anna", &right).await.is_ok());
    }
}
