//! Hard cases of the rigid side.

use crate::Case;

pub const CASES: &[Case] = &[];
