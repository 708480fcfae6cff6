//! Tabulated force-length law of muscle fibres: stress as a function of the stretch of a whole fibre and of its activation.

/// Stress σ(λ, a) between samples: in λ a monotone cubic (Fritsch & Carlson, SIAM J Numer Anal 1980;17:238; slopes are harmonic
/// means), so σ is continuous with its slope and never below its samples; linear in a.
///
/// Below the first sample σ stays what it is there; above the last it goes on with its slope. Activations are limited to the range of
/// the table. The energy is the exact integral of σ, zero at the first sample.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceLength {
    stretch: Vec<f64>,
    activation: Vec<f64>,
    /// Per activation and stretch: σ, ∂σ/∂λ, and ∫σ dλ from the first stretch.
    rows: Vec<Vec<[f64; 3]>>,
}

/// What a fibre says at a stretch and an activation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FibreStress {
    /// ∫σ dλ \[Pa\] (J per m³ of fibre).
    pub energy: f64,
    /// σ \[Pa\] of the reference area.
    pub stress: f64,
    /// ∂σ/∂λ \[Pa\].
    pub slope: f64,
}

impl ForceLength {
    /// `stress[i][k]` \[Pa\] at `activation[i]` and `stretch[k]`. Panics where the sizes differ or the samples do not increase; see
    /// [`crate::scene::FibreLawSpec::ForceLength`] for what a scene is asked.
    pub fn new(stretch: Vec<f64>, activation: Vec<f64>, stress: &[Vec<f64>]) -> ForceLength {
        let increases = |v: &[f64]| v.windows(2).all(|w| w[0] < w[1]);
        assert!(stretch.len() > 1 && increases(&stretch) && increases(&activation));
        assert!(stress.len() == activation.len() && stress.iter().all(|r| r.len() == stretch.len()));
        let rows = stress.iter().map(|row| samples(&stretch, row)).collect();
        ForceLength { stretch, activation, rows }
    }

    /// Stress, its slope and energy at stretch `lambda` and activation `a`.
    pub fn at(&self, lambda: f64, a: f64) -> FibreStress {
        let n = self.activation.len();
        let above = self.activation.partition_point(|&s| s <= a).clamp(1, n.max(2) - 1);
        let low = self.row(above - 1, lambda);
        let Some(&next) = self.activation.get(above) else { return low };
        let from = self.activation[above - 1];
        let t = ((a - from) / (next - from)).clamp(0.0, 1.0);
        let high = self.row(above, lambda);
        let mix = |a: f64, b: f64| a + t * (b - a);
        FibreStress {
            energy: mix(low.energy, high.energy),
            stress: mix(low.stress, high.stress),
            slope: mix(low.slope, high.slope),
        }
    }

    fn row(&self, row: usize, lambda: f64) -> FibreStress {
        let (x, row) = (&self.stretch, &self.rows[row]);
        let last = x.len() - 1;
        // What has no length has no energy either: NaN goes this way.
        if !(lambda > x[0]) {
            let stress = row[0][0];
            return FibreStress { energy: stress * (lambda - x[0]), stress, slope: 0.0 };
        }
        if lambda >= x[last] {
            let ([stress, slope, energy], d) = (row[last], lambda - x[last]);
            return FibreStress {
                energy: energy + d * (stress + 0.5 * slope * d),
                stress: stress + slope * d,
                slope,
            };
        }
        let k = x.partition_point(|&s| s <= lambda) - 1;
        let h = x[k + 1] - x[k];
        let t = (lambda - x[k]) / h;
        let [c0, c1, c2, c3] = cubic(h, row[k], row[k + 1]);
        FibreStress {
            energy: row[k][2] + h * t * (c0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0))),
            stress: c0 + t * (c1 + t * (c2 + t * c3)),
            slope: (c1 + t * (2.0 * c2 + t * 3.0 * c3)) / h,
        }
    }
}

/// Coefficients in t = (x − x₀)/h of the cubic with values and slopes at both ends.
fn cubic(h: f64, [a, ma, _]: [f64; 3], [b, mb, _]: [f64; 3]) -> [f64; 4] {
    let (ma, mb, rise) = (h * ma, h * mb, b - a);
    [a, ma, 3.0 * rise - 2.0 * ma - mb, ma + mb - 2.0 * rise]
}

fn samples(x: &[f64], y: &[f64]) -> Vec<[f64; 3]> {
    let chord: Vec<f64> = (0..x.len() - 1).map(|k| (y[k + 1] - y[k]) / (x[k + 1] - x[k])).collect();
    let slope = |k: usize| match (k.checked_sub(1).map(|k| chord[k]), chord.get(k)) {
        (None, _) => 0.0, // level, as it is below
        (Some(before), None) => before,
        (Some(before), Some(after)) if before * after > 0.0 => 2.0 * before * after / (before + after),
        _ => 0.0,
    };
    let mut rows: Vec<[f64; 3]> = (0..x.len()).map(|k| [y[k], slope(k), 0.0]).collect();
    for k in 1..x.len() {
        let h = x[k] - x[k - 1];
        let [c0, c1, c2, c3] = cubic(h, rows[k - 1], rows[k]);
        rows[k][2] = rows[k - 1][2] + h * (c0 + c1 / 2.0 + c2 / 3.0 + c3 / 4.0);
    }
    rows
}
