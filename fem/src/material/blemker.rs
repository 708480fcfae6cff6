//! Transversely isotropic active muscle and tendon of Blemker, Pinsky & Delp.

use super::{FibreReinforced, Real, fibre_reinforced::AlongFibre};

/// Transversely isotropic skeletal muscle.
///
/// ψ = G₁ B₁² + G₂ B₂² + W₃(λ) + K/2 (ln J)²,
/// B₁ = √(Ī₅/Ī₄² − 1),   B₂ = acosh((Ī₁Ī₄ − Ī₅) / (2√Ī₄)),   λ = √Ī₄,
/// λ ∂W₃/∂λ = σ_max (f_passive(λ) + a f_active(λ)) λ/λ_ofl.
///
/// With L = λ/λ_ofl: f_active = 9 (L − 0.4)² for L ≤ 0.6, 1 − 4 (1 − L)² up to 1.4, 9 (L − 1.6)² above, 0 outside
/// \[0.4, 1.6\]; f_passive = 0 for L ≤ 1, P₁ (exp(P₂ (L − 1)) − 1) up to λ*, linear with the same slope above.
/// Blemker, Pinsky & Delp, J Biomech 2005;38:657, eqs. (3)-(12) and table 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blemker {
    /// Along-fibre shear modulus G₁ \[Pa\].
    pub g1: f64,
    /// Cross-fibre shear modulus G₂ \[Pa\].
    pub g2: f64,
    /// Bulk modulus K \[Pa\].
    pub bulk: f64,
    /// Peak isometric stress σ_max \[Pa\].
    pub sigma_max: f64,
    /// Fibre stretch of greatest active stress λ_ofl.
    pub lambda_ofl: f64,
    /// Fibre stretch from which the passive curve is linear, λ*, as a multiple of λ_ofl.
    pub l_star: f64,
    /// P₁ of the passive curve.
    pub p1: f64,
    /// P₂ of the passive curve.
    pub p2: f64,
    /// Activation a in \[0, 1\].
    pub activation: f64,
}

/// [`Blemker`] with the fibre direction of a place.
pub type BlemkerFibre = AlongFibre<Blemker>;

impl Blemker {
    /// Muscle constants of table 1 (the biceps brachii), passive.
    pub fn muscle() -> Self {
        Blemker {
            g1: 500.0,
            g2: 500.0,
            bulk: 1e7,
            sigma_max: 3e5,
            lambda_ofl: 1.4,
            l_star: 1.4,
            p1: 0.05,
            p2: 6.6,
            activation: 0.0,
        }
    }

    /// ∫f dL from L = 1, f and f′ of f = f_passive + a f_active at L = λ/λ_ofl.
    fn fibre_curve(&self, l: f64) -> (f64, f64, f64) {
        let (p1, p2, l_star) = (self.p1, self.p2, self.l_star);
        let below = |l: f64| {
            let e = (p2 * (l - 1.0)).exp();
            (p1 * ((e - 1.0) / p2 - (l - 1.0)), p1 * (e - 1.0), p1 * p2 * e)
        };
        let passive = if l <= 1.0 {
            (0.0, 0.0, 0.0)
        } else if l <= l_star {
            below(l)
        } else {
            let (w, f, slope) = below(l_star);
            let d = l - l_star;
            (w + f * d + 0.5 * slope * d * d, f + slope * d, slope)
        };
        let d = l - 1.0;
        // Integral of 1 − 4 d² over the half width 0.4, then of 9 (0.6 − |d|)².
        let active = if d.abs() <= 0.4 {
            (d - 4.0 / 3.0 * d * d * d, 1.0 - 4.0 * d * d, -8.0 * d)
        } else if d.abs() <= 0.6 {
            let r = 0.6 - d.abs();
            let plateau = 0.4 - 4.0 / 3.0 * 0.064;
            ((plateau + 3.0 * (0.008 - r * r * r)) * d.signum(), 9.0 * r * r, -18.0 * r * d.signum())
        } else {
            ((0.4 - 4.0 / 3.0 * 0.064 + 0.024) * d.signum(), 0.0, 0.0)
        };
        let a = self.activation;
        (passive.0 + a * active.0, passive.1 + a * active.1, passive.2 + a * active.2)
    }
}

impl FibreReinforced for Blemker {
    fn psi<S: Real>(&self, I1: S, J: S, theta: S, I4: S, I5: S) -> S {
        let r = J.cbrt().recip();
        let r2 = r * r;
        let r4 = r2 * r2;
        let (I1, I4, I5) = (r2 * I1, r2 * I4, r4 * I5);
        let lambda = I4.sqrt();
        let B1_squared = I5 / (I4 * I4) - 1.0;
        let B2_squared = acosh_squared((I1 * I4 - I5) / lambda * 0.5);
        let (w, f, slope) = self.fibre_curve(lambda.value() / self.lambda_ofl);
        let W3 = (lambda * (1.0 / self.lambda_ofl)).chain(w, f, slope) * self.sigma_max;
        let ln = theta.ln();
        B1_squared * self.g1 + B2_squared * self.g2 + W3 + ln * ln * (0.5 * self.bulk)
    }
}

/// acosh²(y), smooth at y = 1 where acosh alone is not:
/// acosh²(1 + t) = 2t − t²/3 + 4t³/45 − t⁴/35 + 16t⁵/1575 − 8t⁶/2079 + O(t⁷).
fn acosh_squared<S: Real>(y: S) -> S {
    let t = y.value() - 1.0;
    if t < 1e-2 {
        const C: [f64; 6] = [2.0, -1.0 / 3.0, 4.0 / 45.0, -1.0 / 35.0, 16.0 / 1575.0, -8.0 / 2079.0];
        let (mut phi, mut d, mut dd) = (0.0, 0.0, 0.0);
        for n in (1..=6).rev() {
            // Horner on the value and both derivatives together.
            dd = dd * t + 2.0 * d;
            d = d * t + phi;
            phi = phi * t + C[n - 1];
        }
        // One more factor t: φ = t q(t).
        return y.chain(phi * t, phi + t * d, 2.0 * d + t * dd);
    }
    let (y0, root) = (y.value(), (t * (t + 2.0)).sqrt());
    let a = (y0 + root).ln();
    let slope = 2.0 * a / root;
    y.chain(a * a, slope, (2.0 - y0 * slope) / (root * root))
}
