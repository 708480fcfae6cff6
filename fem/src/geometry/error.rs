//! What can be wrong with a surface or a surface file, with the place and the remedy.

use std::path::PathBuf;

use thiserror::Error;

use crate::mesh::MeshError;

/// A surface that cannot be used, or a surface file that cannot be read. Triangles and points are counted from 0.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The file could not be read, or does not follow its format.
    #[error(transparent)]
    File(#[from] MeshError),
    /// The name of the file does not say what format it has.
    #[error("{}: unknown surface format; known endings: .stl, .obj, .ply", file.display())]
    UnknownFormat {
        /// The file.
        file: PathBuf,
    },
    /// The surface in a file is not sound.
    #[error("{}: {reason}", file.display())]
    InFile {
        /// The file.
        file: PathBuf,
        /// What is wrong with its surface.
        #[source]
        reason: Box<SurfaceError>,
    },
    /// No triangles.
    #[error("the surface has no triangles; export it as a triangle mesh")]
    Empty,
    /// A coordinate that is NaN or infinite.
    #[error("point {point} has the coordinates {at:.6?} m; all must be finite")]
    NotFinite {
        /// Number of the point.
        point: usize,
        /// Its coordinates \[m\].
        at: [f64; 3],
    },
    /// A triangle that names a point the surface lacks.
    #[error(
        "triangle {triangle}: point {point} does not exist (the surface has {n_points} points); export it again"
    )]
    PointOutOfRange {
        /// Number of the triangle.
        triangle: usize,
        /// The point it names.
        point: u32,
        /// Number of points.
        n_points: usize,
    },
    /// A triangle that uses one point twice.
    #[error("triangle {triangle} uses point {point} twice, near {at:.6?} m; remove collapsed triangles")]
    RepeatedPoint {
        /// Number of the triangle.
        triangle: usize,
        /// The point.
        point: u32,
        /// Its coordinates \[m\].
        at: [f64; 3],
    },
    /// Two points at one place: the surface is cut open there.
    #[error("points {first} and {second} are both at {at:.6?} m; merge vertices that coincide")]
    CoincidentPoints {
        /// Number of one point.
        first: usize,
        /// Number of the other.
        second: usize,
        /// Their coordinates \[m\].
        at: [f64; 3],
    },
    /// A triangle whose corners are exactly in line.
    #[error("triangle {triangle} near {at:.6?} m has no area: its corners are in line; remove or remesh it")]
    NoArea {
        /// Number of the triangle.
        triangle: usize,
        /// Its first corner \[m\].
        at: [f64; 3],
    },
    /// A size that no part of a leg has.
    #[error(
        "the surface is {size:.3e} m across, which no muscle or bone is; {}",
        if *size > 3.0 { "coordinates in mm need the length unit mm" } else { "coordinates in m were read as mm" }
    )]
    Units {
        /// Longest side of the bounding box \[m\].
        size: f64,
    },
    /// An edge of one triangle only.
    #[error(
        "the surface is open: {count} edges belong to one triangle only, the first to triangle {triangle} at {at:.6?} m; \
         close the hole, or merge vertices that should coincide"
    )]
    Open {
        /// How many such edges.
        count: usize,
        /// Triangle of the first.
        triangle: usize,
        /// One end of it \[m\].
        at: [f64; 3],
    },
    /// A sheet that is closed, or has holes.
    #[error(
        "the surface has {count} borders{}; a sheet has one: {}",
        at.map_or(String::new(), |at| format!(", the shortest at {at:.6?} m")),
        if *count == 0 { "leave its back side out" } else { "close its holes" }
    )]
    Rims {
        /// How many.
        count: usize,
        /// A point of the shortest \[m\]; `None`: there is none.
        at: Option<[f64; 3]>,
    },
    /// An edge of more than two triangles.
    #[error(
        "triangles {triangles:?} share one edge at {at:.6?} m; a surface has two sides, so at most two may"
    )]
    CrowdedEdge {
        /// The triangles.
        triangles: Vec<usize>,
        /// One end of the edge \[m\].
        at: [f64; 3],
    },
    /// Parts of the surface touch in a point only.
    #[error(
        "point {point} at {at:.6?} m: the triangles around it do not form one fan; separate the parts that touch here"
    )]
    PinchedPoint {
        /// Number of the point.
        point: usize,
        /// Its coordinates \[m\].
        at: [f64; 3],
    },
    /// Neighbours that look to different sides.
    #[error(
        "triangles {first} and {second} are turned differently, at {at:.6?} m; orient all triangles outward"
    )]
    MixedOrientation {
        /// Number of one triangle.
        first: usize,
        /// Number of its neighbour.
        second: usize,
        /// One end of their edge \[m\].
        at: [f64; 3],
    },
    /// All triangles look inward.
    #[error(
        "the surface is inside out: its volume is {volume:.3e} m³, first triangle at {at:.6?} m; turn all triangles round"
    )]
    InsideOut {
        /// The signed volume \[m³\].
        volume: f64,
        /// A corner of the first triangle \[m\].
        at: [f64; 3],
    },
    /// More than one body.
    #[error(
        "the surface has {count} separate parts; part 1 begins with triangle {triangle} at {at:.6?} m and has {n_triangles} \
         triangles; keep one part per file"
    )]
    SeveralComponents {
        /// How many.
        count: usize,
        /// First triangle that is not of part 0.
        triangle: usize,
        /// One of its corners \[m\].
        at: [f64; 3],
        /// Size of part 1.
        n_triangles: usize,
    },
    /// The surface passes through itself.
    #[error(
        "the surface passes through itself: {count} pairs of triangles meet, the first are {first} and {second} at {at:.6?} m; \
         repair it, e.g. by remeshing"
    )]
    SelfIntersection {
        /// How many pairs.
        count: usize,
        /// Number of one triangle.
        first: usize,
        /// Number of the other.
        second: usize,
        /// A corner of the first \[m\].
        at: [f64; 3],
    },
}
