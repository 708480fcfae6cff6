//! Hard cases of solids in coarse grids: T7, T8.

use crate::{Case, Tier};
use support::grid_cases;

pub const CASES: &[Case] = &[
    Case { id: "T7", title: "a grid that is the mesh", tier: Tier::Quick, run: grid_cases::grid_is_mesh },
    Case {
        id: "T7",
        title: "cubes that hold next to nothing",
        tier: Tier::Quick,
        run: grid_cases::hardly_filled,
    },
    Case { id: "T8", title: "two sheets in one cube", tier: Tier::Quick, run: grid_cases::two_sheets },
    Case {
        id: "T8",
        title: "vastus intermedius from 40 mm to its mesh",
        tier: Tier::Full,
        run: grid_cases::comes_down_to_its_mesh,
    },
    Case {
        id: "T8",
        title: "vastus intermedius from 20 mm to a mesh of 2.5 mm",
        tier: Tier::Full,
        run: grid_cases::comes_down_to_a_fine_mesh,
    },
    Case {
        id: "T8f",
        title: "law on the filled part against volume fractions",
        tier: Tier::Full,
        run: grid_cases::filled_part_against_fractions,
    },
    Case {
        id: "T8m",
        title: "grid beside a mesh of as many unknowns",
        tier: Tier::Full,
        run: grid_cases::grid_against_coarse_mesh,
    },
];
