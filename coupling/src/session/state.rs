//! States as bytes: what they are of, then their numbers as bits.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::CouplingError;

/// First bytes of every state; the last is the version of what follows.
const MARK: &[u8; 12] = b"sartorius\0s1";

/// A state of the side with this `key` as bytes.
pub(super) fn to_bytes<T: Serialize>(key: &str, state: &T) -> Vec<u8> {
    let mut bytes = MARK.to_vec();
    bytes.extend(postcard::to_stdvec(&(key, state)).expect("a state is plain data"));
    bytes
}

/// The state; refuses bytes that are none, or of another side.
pub(super) fn of_bytes<T: DeserializeOwned>(key: &str, side: &str, bytes: &[u8]) -> Result<T, CouplingError> {
    let bad = |why: &str| CouplingError::Option(format!("this is no state of this {side}: {why}"));
    let rest = bytes.strip_prefix(MARK).ok_or_else(|| bad("it does not begin as one"))?;
    let (found, rest): (String, &[u8]) =
        postcard::take_from_bytes(rest).map_err(|_| bad("it is damaged or incomplete"))?;
    if found != key {
        return Err(bad("it was saved by another scene, side or version; restore it where it was saved"));
    }
    match postcard::take_from_bytes(rest) {
        Ok((state, [])) => Ok(state),
        _ => Err(bad("it is damaged or incomplete")),
    }
}
