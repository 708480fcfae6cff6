//! Cross-sections of a muscle from its closed surface.
//!
//! A harmonic function on the surface, 0 on the origin patch and 1 on the insertion patch, has closed level lines that do not
//! cross: the outlines of the sections. The thin borders of every outline are found smoothly along the muscle and fourteen
//! points placed between them, so that the loft through them ([`super::Loft`]) lies on the surface.
//! [`Anatomy::read`] does this for a folder of muscles and a folder of bones.

mod ends;
mod error;
mod fit;
mod folder;
mod harmonic;
mod outline;
mod trace;

use crate::MuscleSections;
use fem::geometry::SearchSurface;

pub use error::SectionError;
pub use fit::Fit;
pub use folder::{Anatomy, MuscleEnds};

/// Where one end of a muscle is.
#[derive(Clone, Copy, Debug)]
pub enum End<'a> {
    /// At the end of the surface, as far along it as possible from the other end.
    Tip,
    /// Where the surface is closer than 3 mm to this bone, or the part of that at the end of the muscle, or the tip: the first
    /// of these that gives a good fit, else the best.
    Bone(&'a SearchSurface),
    /// At these points of the surface.
    Points(&'a [u32]),
}

/// How sections are cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Largest distance of sections along the muscle \[m\].
    pub spacing: f64,
    /// Where the loft between two sections is farther than this from the surface, for 5 % of its points, sections are added \[m\].
    pub deviation: f64,
    /// Ends thinner than this are left to tendons \[m²\].
    pub least_area: f64,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { spacing: 20e-3, deviation: 1e-3, least_area: 30e-6 }
    }
}

/// Sections of a muscle from its surface, from origin to insertion, and how well their loft fits.
///
/// `surface`: checked ([`fem::geometry::Surface::check`]), in m. Without bones or points the origin is the upper tip (larger y).
pub fn sections_from_surface(
    muscle: &str,
    surface: &SearchSurface,
    ends: [End; 2],
    settings: &Settings,
) -> Result<(MuscleSections, Fit), SectionError> {
    let [origins, insertions] = ends::candidates(muscle, surface.surface(), ends)?;
    let mut best: Option<(MuscleSections, Fit)> = None;
    let mut failure = None;
    for zero in &origins {
        for one in &insertions {
            match trace::sections(muscle, surface, zero, one, settings) {
                Ok(sections) => {
                    let fit = fit::measure(&sections, surface, &ends);
                    if fit.is_good() {
                        return Ok((sections, fit));
                    }
                    if best.as_ref().is_none_or(|b| fit.score() > b.1.score()) {
                        best = Some((sections, fit));
                    }
                }
                Err(error) => failure = failure.or(Some(error)),
            }
        }
    }
    best.ok_or_else(|| failure.expect("every end has a candidate"))
}
