//! Room in main memory for what grows with pictures, volumes and fields: asked for, where `vec!` would end the process.

use crate::error::{Error, Result};
use bytemuck::Zeroable;

fn refused<T>(what: &str, len: usize) -> Error {
    Error::NoMemory {
        what: what.to_owned(),
        needs: (len as u64).saturating_mul(size_of::<T>() as u64),
        right: String::from("ask for less at a time, or allow this process more memory"),
    }
}

/// `len` zeros.
///
/// # Errors
/// [`Error::NoMemory`].
pub(crate) fn zeroed<T: Zeroable>(what: &str, len: usize) -> Result<Vec<T>> {
    bytemuck::allocation::try_zeroed_slice_box(len).map(Vec::from).map_err(|()| refused::<T>(what, len))
}

/// Nothing yet, with room for `len`.
///
/// # Errors
/// [`Error::NoMemory`].
pub(crate) fn reserved<T>(what: &str, len: usize) -> Result<Vec<T>> {
    let mut room = Vec::new();
    more(|| what.to_owned(), &mut room, len)?;
    Ok(room)
}

/// Room for `add` more.
///
/// # Errors
/// [`Error::NoMemory`] with what `what` says.
pub(crate) fn more<T>(what: impl FnOnce() -> String, room: &mut Vec<T>, add: usize) -> Result<()> {
    room.try_reserve_exact(add).map_err(|_| refused::<T>(&what(), room.len().saturating_add(add)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_there_is_is_refused() {
        // More than an address space has; asked for where nothing uses it, the compiler would leave smaller ones out.
        let refusals = [zeroed::<f32>("a picture", 1 << 61).err(), reserved::<f32>("a picture", 1 << 61).err()];
        assert!(refusals.iter().all(|r| matches!(r, Some(Error::NoMemory { .. }))), "{refusals:?}");
        let some = zeroed::<[f32; 4]>("a picture", 3);
        assert!(some.is_ok_and(|v| v == [[0.0; 4]; 3]));
        assert!(zeroed::<f32>("nothing", 0).is_ok_and(|v| v.is_empty()));
    }
}
