//! What masters hold pointers to. They get handles, numbers that are never used as addresses, so that a pointer that is null, foreign, or was
//! freed is found out and not followed.

use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};

/// Things by their handles.
pub struct Registry<T> {
    things: Mutex<HashMap<usize, T>>,
}

/// The first handle is an address of this library, so that those of two libraries are hardly the same.
static NEXT: LazyLock<AtomicUsize> = LazyLock::new(|| {
    static HERE: u8 = 0;
    AtomicUsize::new(std::ptr::from_ref(&HERE).addr())
});

impl<T: Clone> Default for Registry<T> {
    fn default() -> Registry<T> {
        Registry { things: Mutex::new(HashMap::new()) }
    }
}

impl<T: Clone> Registry<T> {
    fn things(&self) -> MutexGuard<'_, HashMap<usize, T>> {
        // A panic elsewhere leaves the table whole.
        self.things.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a thing; its handle, never 0.
    pub fn put(&self, thing: T) -> usize {
        let handle = NEXT.fetch_add(1, Ordering::Relaxed).max(1);
        self.things().insert(handle, thing);
        handle
    }

    /// The thing of a handle; `None` where there is none, or no more.
    pub fn get(&self, handle: usize) -> Option<T> {
        self.things().get(&handle).cloned()
    }

    /// Lets go of a thing.
    pub fn remove(&self, handle: usize) -> Option<T> {
        self.things().remove(&handle)
    }

    /// Puts a thing in the place of that of a handle; whether there was one.
    pub fn replace(&self, handle: usize, thing: T) -> bool {
        self.things().get_mut(&handle).map(|there| *there = thing).is_some()
    }

    /// Lets go of all that `keeps` says no to.
    pub fn retain(&self, keeps: impl Fn(&T) -> bool) {
        self.things().retain(|_, thing| keeps(thing));
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.things().len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::Registry;

    #[test]
    fn a_handle_is_good_until_it_is_let_go_of_and_no_other_is() {
        let registry = Registry::default();
        let (a, b) = (registry.put("a"), registry.put("b"));
        assert!(a != b && a != 0 && b != 0);
        assert_eq!(
            (registry.get(a), registry.get(0), registry.get(a.wrapping_add(7))),
            (Some("a"), None, None)
        );
        assert!(registry.replace(b, "c") && !registry.replace(0, "c"));
        assert_eq!((registry.remove(a), registry.remove(a)), (Some("a"), None));
        registry.retain(|thing| *thing != "c");
        assert!(registry.is_empty());
    }
}
