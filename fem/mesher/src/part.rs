//! Names of what belongs to a muscle: the one place where they are put together and looked at.

/// A part of a muscle, by which blocks, node sets, surfaces and effects of a mesh and its scene are named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MusclePart<'a> {
    /// Hexahedra of its belly.
    Belly,
    /// Its surface, outward.
    Surface,
    /// Nodes of the layer where it arises.
    Origin,
    /// Nodes of the layer where it ends.
    Insertion,
    /// Nodes of its surface that are tied to a segment.
    On(&'a str),
    /// Its fibres.
    Fibres,
    /// The membrane around it.
    Shell,
    /// Hexahedra of its solid tendon.
    Tendon,
    /// Fibres of that.
    TendonFibres,
    /// Strands that stand for a tendon, counted from one.
    Strands(usize),
}

/// Begins the surface of a bone.
const BONE: &str = "bone/";
const STRANDS: &str = "/tendon_";

impl MusclePart<'_> {
    /// The name of this part of `muscle`.
    pub fn of(self, muscle: &str) -> String {
        let part = match self {
            MusclePart::Belly => return muscle.to_string(),
            MusclePart::Strands(k) => return format!("{muscle}{STRANDS}{k}"),
            MusclePart::On(segment) => return format!("{muscle}/on_{segment}"),
            MusclePart::Surface => "surface",
            MusclePart::Origin => "origin",
            MusclePart::Insertion => "insertion",
            MusclePart::Fibres => "fibres",
            MusclePart::Shell => "shell",
            MusclePart::Tendon => "tendon",
            MusclePart::TendonFibres => "tendon_fibres",
        };
        format!("{muscle}/{part}")
    }
}

/// The muscle that a name is of, where it is of one.
pub fn muscle_of(name: &str) -> &str {
    name.split_once('/').map_or(name, |(muscle, _)| muscle)
}

/// The body, muscle or bone, that the name of a surface is of.
pub fn body_of(name: &str) -> &str {
    name.strip_prefix(BONE).unwrap_or_else(|| muscle_of(name))
}

/// Whether a name is that of strands that stand for a tendon.
pub fn is_strands(name: &str) -> bool {
    let number = name.split_once(STRANDS).map(|(_, number)| number);
    number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// Surface of a bone.
pub fn bone_surface(bone: &str) -> String {
    format!("{BONE}{bone}")
}
