//! Constants of the tissues of the thigh, where a scene does not say otherwise.

use fem::scene::LawSpec;

/// Muscle matrix of the publication: Mooney-Rivlin in the LS-DYNA form, A = 3 kPa, B = 0.75 kPa, with a Poisson's
/// ratio that is near-incompressible enough; sources of all constants: `docs/theory.md`, *The thigh*.
pub const MATRIX: LawSpec = LawSpec::MooneyRivlinDyna { a: 3e3, b: 750.0, nu: 0.495 };
/// Young's modulus of the fibres \[Pa\], of the same publication.
pub const FIBRE_YOUNG: f64 = 1e6;
/// Strain over which the tension of a fibre sets in.
pub(super) const FIBRE_TOE: f64 = 0.05;
/// Thickness of the shell around a muscle \[m\]; the publication does not state one.
pub const SHELL_THICKNESS: f64 = 0.5e-3;
/// Shear modulus of the shells \[Pa\]: the constants of the matrix, 2 (A + B).
pub const SHELL_SHEAR: f64 = 7.5e3;
/// Layers between surfaces in guarded contact are this many times as stiff as the matrix behind them: fibres that pull with 300 kPa around a
/// bend of some thicknesses press with some 100 kPa (an estimate), five times Young's modulus of the matrix. With 1 the walker at 14 and 20 mm
/// takes more than 110 s; with 5 it takes 35 to 37 s at 12, 14, 16 and 20 mm.
pub const CONTACT_LAYER: f64 = 5.0;
/// The end layers are this many times stiffer, fading over three layers.
pub(super) const END_STIFFNESS: f64 = 40.0;
pub(super) const END_LAYERS: usize = 3;
/// Young's modulus of a tendon of strands \[Pa\] (Zajac 1989).
pub const TENDON_MODULUS: f64 = 1.2e9;
/// Its section, per attachment \[m²\].
pub const TENDON_SECTION: f64 = 30e-6;
