//! Energies of the solid and membrane laws and forces of the laws of lines, written down from their sources.

use super::number::{Dual, Wide};
use fem::material::line::FibreStrain;
use fem::scene::{FibreLawSpec, LawSpec, MembraneLawSpec};

/// A 3×3 matrix of numbers with derivatives.
pub type Matrix = [[Dual; 3]; 3];

/// det.
pub fn determinant(f: &Matrix) -> Dual {
    let minor = |r: usize, s: usize| f[1][r] * f[2][s] - f[1][s] * f[2][r];
    f[0][0] * minor(1, 2) - f[0][1] * minor(0, 2) + f[0][2] * minor(0, 1)
}

/// FᵀF.
fn cauchy_green(f: &Matrix) -> Matrix {
    let dot = |i: usize, j: usize| f[0][i] * f[0][j] + f[1][i] * f[1][j] + f[2][i] * f[2][j];
    std::array::from_fn(|i| std::array::from_fn(|j| dot(i, j)))
}

fn trace(m: &Matrix) -> Dual {
    m[0][0] + m[1][1] + m[2][2]
}

/// Σ Aᵢⱼ².
fn square(m: &Matrix) -> Dual {
    m.iter().flatten().fold(Dual::constant(0.0), |sum, v| sum + v.squared())
}

/// Energy density \[Pa\] of a law at the deformation gradient F with the volume ratio θ that its volumetric part sees; `None` where the law
/// is not defined. `along`: unit fibre direction, `active`: activation.
pub fn density(law: &LawSpec, along: [Wide; 3], active: f64, f: &Matrix, theta: Dual) -> Option<Dual> {
    let j = determinant(f);
    let positive = j.v > Wide::ZERO && theta.v > Wide::ZERO;
    let c = cauchy_green(f);
    let i1 = trace(&c);
    let i2 = (i1.squared() - square(&c)) * 0.5;
    // F̄ = (θ/J)^⅓ F.
    let stretch = || (theta / j).cbrt();
    let lame = |young: f64, nu: f64| {
        let (e, n) = (Wide::new(young), Wide::new(nu));
        let mu = e / (Wide::new(2.0) * (Wide::ONE + n));
        (mu, e * n / ((Wide::ONE + n) * (Wide::ONE - n - n)))
    };
    let times = |a: Dual, w: Wide| Dual { v: a.v * w, d: a.d * w };
    let isochoric = || {
        let r = Dual::constant(1.0) / j.cbrt();
        (r.squared() * i1, r.squared().squared() * i2)
    };
    match law {
        LawSpec::User(_) | LawSpec::FoldoverFree { .. } => panic!("random scenes have no such laws"),
        // Bonet & Wood, §6.4.3.
        LawSpec::NeoHookean { young, nu } => positive.then(|| {
            let (mu, lambda) = lame(*young, *nu);
            let (i1, ln) = (stretch().squared() * i1, theta.ln());
            times((i1 - 3.0) * 0.5 - ln, mu) + times(ln.squared() * 0.5, lambda)
        }),
        // Holzapfel, §6.4 and §6.5.
        LawSpec::NeoHookeanUncoupled { mu, bulk } => {
            positive.then(|| (isochoric().0 - 3.0) * (0.5 * mu) + (theta - 1.0).squared() * (0.5 * bulk))
        }
        LawSpec::MooneyRivlin { c10, c01, bulk } => positive.then(|| {
            let (i1, i2) = isochoric();
            (i1 - 3.0) * *c10 + (i2 - 3.0) * *c01 + (theta - 1.0).squared() * (0.5 * bulk)
        }),
        // LS-DYNA Keyword User's Manual, *MAT_027.
        LawSpec::MooneyRivlinDyna { a, b, nu } => positive.then(|| {
            let s = stretch().squared();
            let i3 = theta.squared();
            let w = Wide::new;
            let (wa, wb, n) = (w(*a), w(*b), w(*nu));
            let d = (wa * (w(5.0) * n - w(2.0)) + wb * (w(11.0) * n - w(5.0))) / (w(2.0) * (w(1.0) - n - n));
            let c = wa * w(0.5) + wb;
            (s * i1 - 3.0) * *a
                + (s.squared() * i2 - 3.0) * *b
                + times(Dual::constant(1.0) / i3.squared() - 1.0, c)
                + times((i3 - 1.0).squared(), d)
        }),
        // Smith, de Goes & Kim 2018, eq. 14: μ and λ of the energy from Lamé's constants by their §3.4.
        LawSpec::StableNeoHookean { young, nu } => {
            let (mu_lame, lambda_lame) = lame(*young, *nu);
            let mu = mu_lame * Wide::ratio(4.0, 3.0);
            let lambda = lambda_lame + mu_lame * Wide::ratio(5.0, 6.0);
            let alpha = Wide::ONE + Wide::new(0.75) * mu / lambda;
            let away = Dual { v: theta.v - alpha, d: theta.d };
            Some(times((i1 - 3.0) * 0.5 - (i1 + 1.0).ln() * 0.5, mu) + times(away.squared() * 0.5, lambda))
        }
        // Bonet & Wood, §6.4.2.
        LawSpec::StVenantKirchhoff { young, nu } => {
            let (mu, lambda) = lame(*young, *nu);
            let e: Matrix = std::array::from_fn(|i| {
                std::array::from_fn(|k| (c[i][k] - if i == k { 1.0 } else { 0.0 }) * 0.5)
            });
            Some(times(square(&e), mu) + times(trace(&e).squared() * 0.5, lambda))
        }
        LawSpec::LinearElastic { young, nu } => {
            let (mu, lambda) = lame(*young, *nu);
            let same = theta.v == j.v && theta.d == j.d;
            let s = if same {
                Dual::constant(1.0)
            } else if positive {
                stretch()
            } else {
                return None;
            };
            let e: Matrix = std::array::from_fn(|i| {
                std::array::from_fn(|k| (f[i][k] + f[k][i]) * s * 0.5 - if i == k { 1.0 } else { 0.0 })
            });
            Some(times(square(&e), mu) + times(trace(&e).squared() * 0.5, lambda))
        }
        LawSpec::Blemker { g1, g2, bulk, sigma_max, lambda_ofl, .. } => positive.then(|| {
            let a = along.map(|v| Dual { v, d: Wide::ZERO });
            let ca: [Dual; 3] = std::array::from_fn(|i| c[i][0] * a[0] + c[i][1] * a[1] + c[i][2] * a[2]);
            let r2 = (Dual::constant(1.0) / j.cbrt()).squared();
            let (i1, i4) = (r2 * i1, r2 * (a[0] * ca[0] + a[1] * ca[1] + a[2] * ca[2]));
            let i5 = r2.squared() * (ca[0].squared() + ca[1].squared() + ca[2].squared());
            let lambda = i4.sqrt();
            let b1_squared = i5 / i4.squared() - 1.0;
            let b2_squared = acosh_squared((i1 * i4 - i5) / lambda * 0.5);
            let length = lambda.v / Wide::new(*lambda_ofl);
            let slope = Wide::new(*sigma_max) * blemker_curve(length, active) / Wide::new(*lambda_ofl);
            // Only its slope is asked for.
            let w3 = lambda.chain(Wide::ZERO, slope);
            b1_squared * *g1 + b2_squared * *g2 + w3 + theta.ln().squared() * (0.5 * bulk)
        }),
    }
}

/// acosh² y, near y = 1 by its series: acosh²(1 + t) = 2t − t²/3 + 4t³/45 − t⁴/35 + 16t⁵/1575 − 8t⁶/2079 + ….
fn acosh_squared(y: Dual) -> Dual {
    let t = y.v - Wide::ONE;
    if t.value() < 1e-5 {
        let c = [(2., 1.), (-1., 3.), (4., 45.), (-1., 35.), (16., 1575.), (-8., 2079.)];
        let slope = (0..6).rev().fold(Wide::ZERO, |sum, k| {
            let (p, q) = c[k];
            sum * t + Wide::ratio(p, q) * Wide::new((k + 1) as f64)
        });
        return y.chain(Wide::ZERO, slope);
    }
    let root = (t * (t + Wide::new(2.0))).sqrt();
    y.chain(Wide::ZERO, Wide::new(2.0) * (y.v + root).ln() / root)
}

/// f_passive + a f_active of Blemker, Pinsky & Delp 2005 at L = λ/λ_ofl, table 1: λ* = 1.4, P₁ = 0.05, P₂ = 6.6.
fn blemker_curve(l: Wide, a: f64) -> Wide {
    let w = Wide::new;
    let growth = |l: Wide| (w(6.6) * (l - Wide::ONE)).exp();
    let passive = if l <= Wide::ONE {
        Wide::ZERO
    } else if l <= w(1.4) {
        w(0.05) * (growth(l) - Wide::ONE)
    } else {
        let g = growth(w(1.4));
        w(0.05) * (g - Wide::ONE) + w(0.05) * w(6.6) * g * (l - w(1.4))
    };
    let d = (l - Wide::ONE).abs();
    let active = if d <= w(0.4) {
        Wide::ONE - w(4.0) * d * d
    } else if d <= w(0.6) {
        w(9.0) * (w(0.6) - d) * (w(0.6) - d)
    } else {
        Wide::ZERO
    };
    passive + w(a) * active
}

/// Energy density \[Pa\] of a membrane law over i₁ = tr C and i₂ = det C of the in-plane C.
pub fn membrane_density(law: &MembraneLawSpec, i1: Dual, i2: Dual) -> Option<Dual> {
    match *law {
        MembraneLawSpec::StVenantKirchhoff { young, nu } => {
            let tr = (i1 - 2.0) * 0.5;
            let square = ((i1.squared() - i2 * 2.0) - i1 * 2.0 + 2.0) * 0.25; // E:E
            let w = Wide::new;
            let k = w(young) / (w(2.0) * (Wide::ONE - w(nu) * w(nu)));
            let sum = square * (1.0 - nu) + tr.squared() * nu;
            Some(Dual { v: sum.v * k, d: sum.d * k })
        }
        MembraneLawSpec::NeoHookean { mu } => {
            (i2.v > Wide::ZERO).then(|| (i1 + Dual::constant(1.0) / i2 - 3.0) * (0.5 * mu))
        }
    }
}

/// Force \[N\] of a fibre at stretch λ; laws of segments only.
pub fn fibre_force(law: &FibreLawSpec, area: f64, lambda: Wide, a: f64) -> Wide {
    let w = Wide::new;
    match law {
        FibreLawSpec::Thermal { young, contraction, strain, toe } => {
            let e = match strain {
                FibreStrain::Engineering => lambda - Wide::ONE,
                FibreStrain::Logarithmic => lambda.ln(),
            };
            let u = e + w(*contraction) * w(a);
            let fraction = match toe {
                None => u,
                Some(_) if u <= Wide::ZERO => Wide::ZERO,
                Some(toe) if u <= w(*toe) => u * u / w(2.0 * toe),
                Some(toe) => u - w(0.5 * toe),
            };
            w(*young) * w(area) * fraction
        }
        // Thelen 2003, eqs. 3 and 4: γ = 0.45, k_PE = 5, ε₀ = 0.6.
        FibreLawSpec::Hill { sigma_max, lambda_opt } => {
            let d = lambda / w(*lambda_opt) - Wide::ONE;
            let active = (-(d * d) / w(0.45)).exp();
            let passive = match d > Wide::ZERO {
                true => ((w(5.0) * d / w(0.6)).exp() - Wide::ONE) / (w(5.0).exp() - Wide::ONE),
                false => Wide::ZERO,
            };
            w(*sigma_max) * w(area) * (w(a) * active + passive)
        }
        FibreLawSpec::ForceLength { .. } => unreachable!("whole fibres have `table_stress`"),
    }
}

/// Stress \[Pa\] of a table at the stretch of a whole fibre: cubics between samples with harmonic mean slopes (Fritsch & Carlson 1980),
/// level below the first sample, straight on above the last; linear in the activation.
pub fn table_stress(stretch: &[f64], activation: &[f64], stress: &[Vec<f64>], lambda: Wide, a: f64) -> Wide {
    let row = |row: &[f64]| row_stress(stretch, row, lambda);
    let n = activation.len();
    if a <= activation[0] {
        return row(&stress[0]);
    }
    if a >= activation[n - 1] {
        return row(&stress[n - 1]);
    }
    let i = (1..n).find(|&i| a < activation[i]).expect("between the first and the last");
    let w = Wide::new;
    let t = (w(a) - w(activation[i - 1])) / (w(activation[i]) - w(activation[i - 1]));
    let low = row(&stress[i - 1]);
    low + t * (row(&stress[i]) - low)
}

fn row_stress(x: &[f64], y: &[f64], lambda: Wide) -> Wide {
    let w = Wide::new;
    let last = x.len() - 1;
    let chord = |k: usize| (w(y[k + 1]) - w(y[k])) / (w(x[k + 1]) - w(x[k]));
    let slope = |k: usize| {
        if k == 0 {
            return Wide::ZERO;
        }
        let before = chord(k - 1);
        if k == last {
            return before;
        }
        let after = chord(k);
        match (before * after).value() > 0.0 {
            true => w(2.0) * before * after / (before + after),
            false => Wide::ZERO,
        }
    };
    if lambda <= w(x[0]) {
        return w(y[0]);
    }
    if lambda >= w(x[last]) {
        return w(y[last]) + slope(last) * (lambda - w(x[last]));
    }
    let k = (0..last).find(|&k| lambda < w(x[k + 1])).expect("between the first and the last");
    let h = w(x[k + 1]) - w(x[k]);
    let t = (lambda - w(x[k])) / h;
    // Hermite's basis.
    let (u, t2) = (Wide::ONE - t, t * t);
    let h00 = (Wide::ONE + t + t) * u * u;
    h00 * w(y[k])
        + t * u * u * h * slope(k)
        + t2 * (w(3.0) - t - t) * w(y[k + 1])
        + t2 * (t - Wide::ONE) * h * slope(k + 1)
}

/// Force \[N\] of a ligament strand at strain ε (Blankevoort & Huiskes 1991, eq. 1).
pub fn strand_force(stiffness: f64, toe: f64, strain: Wide) -> Wide {
    let (k, l) = (Wide::new(stiffness), Wide::new(toe));
    if strain <= Wide::ZERO {
        Wide::ZERO
    } else if strain <= l + l {
        k * strain * strain / (Wide::new(4.0) * l)
    } else {
        k * (strain - l)
    }
}
