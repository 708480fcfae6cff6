//! Triangulated surfaces: what they are, whether they are sound, and how close two of them come.
//!
//! [`Surface`] is a plain list of points and triangles; [`Surface::read`] takes STL, OBJ and PLY files and
//! [`Surface::check`] refuses what is not one closed, outward, sound body. [`intersect`] decides exactly whether two
//! triangles meet; [`distance`] measures how far apart they are. [`SearchSurface`] answers the same for whole surfaces.
//! [`closest`], [`normals`] and [`tree`] serve contact, too. What contact answers is held against exact predicates ([`intersect`]), which
//! it has no part in, and in the tests against code of their own.

mod check;
pub mod closest;
pub mod distance;
mod error;
mod field;
pub mod intersect;
pub mod linking;
pub mod normals;
pub mod overlap;
mod query;
pub mod read;
pub(crate) mod rotation;
mod signed;
mod surface;
pub mod tree;

pub use error::SurfaceError;
pub use field::{DistanceField, FieldPoint};
pub use query::{Gap, SearchSurface};
pub use signed::{Depth, SignedDistance};
pub use surface::Surface;
