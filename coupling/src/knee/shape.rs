//! Measures of a knee that the program makes.

/// Measures of a knee, cartilage included \[m\]; x forward, y up, z lateral, from the middle between the condyles.
///
/// Condyles are two balls, the trochlea is two larger ones in front of them, side by side, whose seam is the groove. So the groove lies on a circle,
/// as it does (Iranpour et al., Clin Orthop Relat Res 468:782, 2010: a circle of 23 ± 4 mm), and condyles are balls, as they nearly are (Monk et
/// al., Bone Joint J 96-B:1623, 2014: one circle fits both facets of the lateral condyle, the posterior facet of the medial one and the floor of the
/// groove; the inferior medial facet, a third larger, is left out here). The centre of the groove lies 12.33 ± 1.41 mm before and 7.21 ± 1.23 mm above
/// that of the condyles (Clin Anat 33:500, 2020). Of all three the abstracts were read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Radius of the balls that are the condyles.
    pub condyle_radius: f64,
    /// Their middles are so far to either side.
    pub condyle_aside: f64,
    /// Middle of the balls of the trochlea, forward and up.
    pub trochlea: [f64; 2],
    /// Their radii, medial and lateral.
    pub trochlea_radius: [f64; 2],
    /// Their middles are so far to either side.
    pub trochlea_aside: f64,
    /// Half of the width over the epicondyles.
    pub half_width: f64,
    /// Patella: half its height and half its width.
    pub patella: [f64; 2],
    /// How far it goes from its middle back to its ridge, cartilage included, and forward.
    pub patella_depth: [f64; 2],
    /// Thickness of its cartilage.
    pub patella_cartilage: f64,
    /// Angle \[rad\] by which its facets turn away from the ridge.
    pub facet_turn: f64,
    /// Radius of the ridge from above to below.
    pub ridge_radius: f64,
    /// Where the ligament of the patella holds on to the tibia, from the middle between the condyles in extension.
    pub tuberosity: [f64; 3],
}

/// What fits into the box in which the distance to a femur is known: half of the width, and how far a knee goes back, down and forward \[m\].
const LARGEST: [f64; 3] = [45e-3, 26e-3, 52e-3];

impl Shape {
    /// What is wrong with it, all at once.
    pub fn problems(&self) -> Vec<String> {
        let [medial, lateral] = self.trochlea_radius;
        let forward = self.trochlea[0] + medial.max(lateral);
        let positive = [
            ("condyle_radius", self.condyle_radius),
            ("condyle_aside", self.condyle_aside),
            ("trochlea_radius", medial.min(lateral)),
            ("trochlea_aside", self.trochlea_aside),
            ("half_width", self.half_width),
            ("patella", self.patella[0].min(self.patella[1])),
            ("patella_depth", self.patella_depth[0].min(self.patella_depth[1])),
            ("patella_cartilage", self.patella_cartilage),
            ("ridge_radius", self.ridge_radius),
        ];
        // NaN is not positive either.
        let is_positive = |v: f64| v > 0.0 && v.is_finite();
        let mut problems: Vec<String> = (positive.iter().filter(|(_, v)| !is_positive(*v)))
            .map(|(name, v)| format!("{name} is {v} m, must be positive"))
            .collect();
        let mut most = |name: &str, value: f64, most: f64| {
            if value.is_nan() || value > most {
                problems.push(format!("{name} is {value} m, must be at most {most}"));
            }
        };
        most("trochlea_aside", self.trochlea_aside, 0.9 * medial.min(lateral));
        most("half_width", self.half_width, LARGEST[0]);
        most("condyle_radius", self.condyle_radius, LARGEST[1]);
        most("the front of the trochlea", forward, LARGEST[2]);
        if self.facet_turn.is_nan() || self.facet_turn.abs() >= 1.0 {
            problems.push(format!("facet_turn is {} rad, must be between -1 and 1", self.facet_turn));
        }
        if !self.tuberosity.iter().chain(&self.trochlea).all(|v| v.abs() < 0.2) {
            problems.push("tuberosity and trochlea must be within 0.2 m".into());
        }
        problems
    }
}

impl Default for Shape {
    /// Of a man as large as the built-in thigh. Balls of the trochlea with middles 18.5 mm to either side leave a groove of 23 mm, 5 mm deep, with a
    /// sulcus angle of 150 degrees over its crests.
    fn default() -> Shape {
        Shape {
            condyle_radius: 22e-3,
            condyle_aside: 24e-3,
            trochlea: [12.3e-3, 7.2e-3],
            trochlea_radius: [27.5e-3, 28.5e-3],
            trochlea_aside: 18.5e-3,
            half_width: 40e-3,
            patella: [19e-3, 21e-3],
            patella_depth: [11e-3, 10e-3],
            patella_cartilage: 2e-3,
            facet_turn: 0.42,
            ridge_radius: 40e-3,
            tuberosity: [26e-3, -48e-3, 4e-3],
        }
    }
}
