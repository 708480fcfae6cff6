//! A law of a user's own as part of a scene: a Rust type, so a scene that has one is built in Rust.

use super::{FibreDirection, LawSpec};
use crate::material::user::{Site, SolidLaw, mean_young};
use nalgebra::{Matrix3, Vector3};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::sync::Arc;

/// A law of a user's own, with its fibre directions and what drives it. Two are the same if they print the same.
#[derive(Clone, Debug)]
pub struct UserLaw {
    /// The law.
    pub law: Arc<dyn SolidLaw>,
    /// Fibre directions a₀; absent: it has none.
    pub fibres: Option<FibreDirection>,
    /// Controls that it sees, in the order of [`Site::control`].
    pub controls: Vec<String>,
}

impl LawSpec {
    /// A law of a user's own: any type that implements [`crate::material::Hyperelastic`] or [`SolidLaw`].
    ///
    /// ```
    /// use fem::material::{Hyperelastic, Real, Site, Symmetric};
    /// use fem::scene::{FibreDirection, LawSpec, SolidSpec};
    ///
    /// /// Neo-Hookean tissue whose fibres pull with a second Piola-Kirchhoff stress [Pa] that a control holds.
    /// #[derive(Debug)]
    /// struct Pulling {
    ///     mu: f64,
    ///     bulk: f64,
    /// }
    ///
    /// impl Hyperelastic for Pulling {
    ///     fn psi<S: Real>(&self, C: &Symmetric<S>, site: &Site) -> S {
    ///         let J = C.determinant().sqrt();
    ///         let matrix = (C.trace() * J.powf(-2.0 / 3.0) - 3.0) * (0.5 * self.mu) + (J - 1.0) * (J - 1.0) * (0.5 * self.bulk);
    ///         matrix + (C.along(site.a0) - 1.0) * (0.5 * site.control(0))
    ///     }
    /// }
    ///
    /// let law = LawSpec::user(Pulling { mu: 1e3, bulk: 1e5 });
    /// let law = law.along(FibreDirection::Uniform([1.0, 0.0, 0.0])).driven_by(&["tension"]);
    /// let muscle = SolidSpec::new("muscle", law);
    /// ```
    pub fn user(law: impl SolidLaw + 'static) -> UserLaw {
        UserLaw { law: Arc::new(law), fibres: None, controls: Vec::new() }
    }
}

impl UserLaw {
    /// The same with fibre directions.
    pub fn along(self, fibres: FibreDirection) -> UserLaw {
        UserLaw { fibres: Some(fibres), ..self }
    }

    /// The same with the controls that it sees.
    pub fn driven_by(self, controls: &[&str]) -> UserLaw {
        UserLaw { controls: controls.iter().map(|c| c.to_string()).collect(), ..self }
    }

    /// Young's modulus \[Pa\] at rest, mean over all directions, all controls at zero.
    pub(crate) fn mean_young(&self) -> f64 {
        let controls: Vec<usize> = (0..self.controls.len()).collect();
        let values = vec![0.0; controls.len()];
        let a0 = if self.fibres.is_some() { Vector3::x() } else { Vector3::zeros() };
        mean_young(&self.law.tangent(&Matrix3::identity(), &Site::new(0, a0, &controls, &values)))
    }
}

impl From<UserLaw> for LawSpec {
    fn from(law: UserLaw) -> LawSpec {
        LawSpec::User(law)
    }
}

impl PartialEq for UserLaw {
    fn eq(&self, other: &UserLaw) -> bool {
        let same =
            Arc::ptr_eq(&self.law, &other.law) || format!("{:?}", self.law) == format!("{:?}", other.law);
        same && self.fibres == other.fibres && self.controls == other.controls
    }
}

/// For records of a run: what the law prints as, and what it gets. It cannot be read again.
impl Serialize for UserLaw {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Written<'a> {
            law: String,
            fibres: &'a Option<FibreDirection>,
            controls: &'a [String],
        }
        let law = format!("{:?}", self.law);
        Written { law, fibres: &self.fibres, controls: &self.controls }.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for UserLaw {
    fn deserialize<D: Deserializer<'de>>(_: D) -> Result<UserLaw, D::Error> {
        Err(D::Error::custom(
            "a law of kind `user` is a Rust type and cannot be read from a file; build the scene in Rust with LawSpec::user, or choose a \
             law of another kind",
        ))
    }
}
