//! Hard cases of the fem side.

use crate::Case;

pub const CASES: &[Case] = &[];
