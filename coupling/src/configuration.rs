//! With or without contact: the two configurations that a comparison sets beside each other.

use std::ops::{Index, IndexMut};

/// Whether bodies of the thigh take notice of each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Configuration {
    /// They go through each other.
    WithoutContact,
    /// They press on each other.
    WithContact,
}

use Configuration::{WithContact, WithoutContact};

impl Configuration {
    /// Both, in the order in which they are computed and shown.
    pub const ALL: [Configuration; 2] = [WithoutContact, WithContact];

    /// Its name in pages and tables.
    pub const fn name(self) -> &'static str {
        match self {
            WithoutContact => "without contact",
            WithContact => "with contact",
        }
    }

    /// Folder of its frames, and its name in `explanation.csv`.
    pub fn folder(self) -> &'static str {
        match self {
            WithoutContact => "no_contact",
            WithContact => "contact",
        }
    }
}

/// One thing for each configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PerConfiguration<T> {
    /// Without contact.
    pub without: T,
    /// With contact.
    pub with: T,
}

impl<T> PerConfiguration<T> {
    /// What `of` says of each.
    pub fn of(mut of: impl FnMut(Configuration) -> T) -> PerConfiguration<T> {
        PerConfiguration { without: of(WithoutContact), with: of(WithContact) }
    }

    /// Each with its configuration.
    pub fn iter(&self) -> impl Iterator<Item = (Configuration, &T)> {
        Configuration::ALL.into_iter().zip([&self.without, &self.with])
    }
}

impl<T> PerConfiguration<Option<T>> {
    /// Those that there are, each with its configuration.
    pub fn present(&self) -> impl Iterator<Item = (Configuration, &T)> {
        self.iter().filter_map(|(configuration, value)| Some((configuration, value.as_ref()?)))
    }
}

impl<T> Index<Configuration> for PerConfiguration<T> {
    type Output = T;

    fn index(&self, configuration: Configuration) -> &T {
        match configuration {
            WithoutContact => &self.without,
            WithContact => &self.with,
        }
    }
}

impl<T> IndexMut<Configuration> for PerConfiguration<T> {
    fn index_mut(&mut self, configuration: Configuration) -> &mut T {
        match configuration {
            WithoutContact => &mut self.without,
            WithContact => &mut self.with,
        }
    }
}
