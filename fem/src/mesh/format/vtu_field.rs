//! What VTU files hold, as it is written and read: named values, and the kinds of cells.

use std::borrow::Cow;

use crate::mesh::CellKind;

/// A named array with the same number of values for every point or cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Field<'a> {
    /// Name with unit, e.g. `displacement_m`.
    pub name: Cow<'a, str>,
    /// Values per point or cell: 1 scalar, 3 vector, 9 tensor by rows.
    pub components: usize,
    /// `components` values per point, or per cell in the order of the blocks.
    pub values: Cow<'a, [f64]>,
}

impl<'a> Field<'a> {
    /// A field that borrows its values.
    pub fn new(name: &'a str, components: usize, values: &'a [f64]) -> Field<'a> {
        Field { name: name.into(), components, values: values.into() }
    }
}

pub(super) const VOXEL: u8 = 11;
/// VTK numbers of the cell types.
pub(super) const CELL_TYPES: [(u32, CellKind); 8] = [
    (12, CellKind::Hex8),
    (10, CellKind::Tet4),
    (24, CellKind::Tet10),
    (13, CellKind::Wedge6),
    (9, CellKind::Quad4),
    (5, CellKind::Tri3),
    (3, CellKind::Line2),
    (VOXEL as u32, CellKind::Hex8),
];
