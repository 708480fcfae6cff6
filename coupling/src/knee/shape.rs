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
    /// Angle \[rad\] by which its facets turn away from the ridge, and radius of the ridge from above to below.
    pub facets: [f64; 2],
    /// Where the ligament of the patella holds on to the tibia, from the middle between the condyles in extension.
    pub tuberosity: [f64; 3],
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
            facets: [0.42, 40e-3],
            tuberosity: [26e-3, -48e-3, 4e-3],
        }
    }
}
