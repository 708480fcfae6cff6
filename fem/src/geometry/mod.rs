//! Triangulated surfaces: what they are, whether they are sound, and how close two of them come.
//!
//! [`Surface`] is a plain list of points and triangles; [`Surface::read`] takes STL, OBJ and PLY files and
//! [`Surface::check`] refuses what is not one closed, outward, sound body. [`intersect`] decides exactly whether two
//! triangles meet; [`distance`] measures how far apart they are. [`SearchSurface`] answers the same for whole surfaces.
//! Nothing here is used by the contact law, so that the one can be held against the other.

mod check;
pub mod distance;
mod error;
pub mod intersect;
pub mod linking;
pub mod overlap;
mod query;
pub mod read;
mod signed;
mod surface;
mod tree;

pub use error::SurfaceError;
pub use query::{Gap, SearchSurface};
pub use signed::{Depth, SignedDistance};
pub use surface::Surface;
