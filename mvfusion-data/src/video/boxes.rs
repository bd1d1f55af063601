//! The boxes of an mp4 file.

use mp4_atom::{Atom, Decode, Header};

/// The consecutive boxes in `content`, with their contents. Ends at malformed bytes.
pub(super) fn children(mut content: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let mut rest = content;
        let header = Header::decode(&mut rest).ok()?;
        let (inside, after) = rest.split_at_checked(header.size.unwrap_or(rest.len()))?;
        content = after;
        Some((header.kind.into(), inside))
    })
}

/// The content of the first box of a kind.
pub(super) fn child<'a>(content: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    children(content).find(|(k, _)| k == kind).map(|(_, inside)| inside)
}

/// The first box of a type, if there is one.
pub(super) fn optional_leaf<T: Atom>(content: &[u8]) -> Result<Option<T>, String> {
    let kind = T::KIND;
    let Some(mut inside) = child(content, kind.as_ref()) else { return Ok(None) };
    T::decode_body(&mut inside).map(Some).map_err(|e| format!("its box {kind} cannot be read ({e})"))
}

/// The first box of a type.
pub(super) fn leaf<T: Atom>(content: &[u8]) -> Result<T, String> {
    optional_leaf(content)?.ok_or_else(|| format!("it has no box {}", T::KIND))
}
