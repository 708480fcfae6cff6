//! Analytic answers, from the equations and not from the code they check: principal stretches, quadrature, bisection.
//!
//! Constants in Pa, lengths in m.

use std::f64::consts::PI;

/// Constants of the Mooney-Rivlin solid W = C₁₀ (Ī₁ − 3) + C₀₁ (Ī₂ − 3) + K/2 (J − 1)² \[Pa\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mooney {
    /// C₁₀ \[Pa\].
    pub c10: f64,
    /// C₀₁ \[Pa\].
    pub c01: f64,
    /// K \[Pa\].
    pub bulk: f64,
}

/// The muscle matrix of the benchmarks: G = 7.5 kPa, Poisson's ratio 0.495.
pub const MATRIX: Mooney = Mooney { c10: 3e3, c01: 0.75e3, bulk: 747.5e3 };
/// Its density \[kg/m³\].
pub const DENSITY: f64 = 1060.0;

impl Mooney {
    /// Principal Cauchy stresses \[Pa\] at the principal stretches `l`: σᵢ = (λᵢ/J) ∂W/∂λᵢ.
    pub fn cauchy(&self, l: [f64; 3]) -> [f64; 3] {
        let j = l[0] * l[1] * l[2];
        let squares = l.map(|x| x * x);
        let i1: f64 = squares.iter().sum();
        let i2 = squares[0] * squares[1] + squares[1] * squares[2] + squares[2] * squares[0];
        squares.map(|s| {
            let first = j.powf(-2.0 / 3.0) * (2.0 * s - 2.0 / 3.0 * i1); // λ ∂Ī₁/∂λ
            let second = j.powf(-4.0 / 3.0) * (2.0 * s * (i1 - s) - 4.0 / 3.0 * i2); // λ ∂Ī₂/∂λ
            (self.c10 * first + self.c01 * second) / j + self.bulk * (j - 1.0)
        })
    }

    /// Lateral stretch and Cauchy stress \[Pa\] of a bar at axial stretch `l`, lateral faces free.
    pub fn uniaxial(&self, l: f64) -> (f64, f64) {
        let lateral = root(0.2, 3.0, |m| self.cauchy([l, m, m])[1]);
        (lateral, self.cauchy([l, lateral, lateral])[0])
    }

    /// Nominal stress \[Pa\] of a bar.
    pub fn uniaxial_nominal(&self, l: f64) -> f64 {
        let (lateral, cauchy) = self.uniaxial(l);
        cauchy * lateral * lateral
    }

    /// Thickness stretch and Cauchy stress \[Pa\] of a sheet stretched by `l` both ways.
    pub fn equibiaxial(&self, l: f64) -> (f64, f64) {
        let thickness = root(0.1, 4.0, |t| self.cauchy([l, l, t])[2]);
        (thickness, self.cauchy([l, l, thickness])[0])
    }

    /// Cauchy stress xx, yy, zz, xy \[Pa\] of simple shear x + γ y: σ = 2 C₁₀ dev B − 2 C₀₁ dev B⁻¹, J = 1.
    pub fn simple_shear(&self, gamma: f64) -> [f64; 4] {
        let mean = (3.0 + gamma * gamma) / 3.0;
        let b = [1.0 + gamma * gamma - mean, 1.0 - mean, 1.0 - mean, gamma];
        let inverse = [1.0 - mean, 1.0 + gamma * gamma - mean, 1.0 - mean, -gamma];
        [0, 1, 2, 3].map(|i| 2.0 * self.c10 * b[i] - 2.0 * self.c01 * inverse[i])
    }

    /// Inner pressure \[Pa\] that widens an incompressible sphere of radii `inner`, `outer` by `stretch` at its inner
    /// face: p = ∫ 2 (σ_θ − σ_r)/r dr with σ_θ − σ_r = (λ/2) dŴ/dλ, Ŵ(λ) = W(λ⁻², λ, λ), λ = r/R.
    /// Holzapfel, Nonlinear Solid Mechanics, §6.3 and exercise on balloons.
    pub fn sphere_pressure(&self, inner: f64, outer: f64, stretch: f64) -> f64 {
        let shift = (inner * stretch).powi(3) - inner.powi(3);
        integral(inner, outer, |big_r| {
            let r = (big_r.powi(3) + shift).cbrt();
            let l = r / big_r;
            // I₁ = 2λ² + λ⁻⁴, I₂ = 2λ⁻² + λ⁴
            let slope =
                self.c10 * (4.0 * l - 4.0 * l.powi(-5)) + self.c01 * (4.0 * l.powi(3) - 4.0 * l.powi(-3));
            l * slope / r * (big_r / r).powi(2) // dr = (R/r)² dR
        })
    }

    /// Inner stretch of that sphere at `pressure` \[Pa\], below the stretch 2.
    pub fn sphere_stretch(&self, inner: f64, outer: f64, pressure: f64) -> f64 {
        root(1.0, 2.0, |l| self.sphere_pressure(inner, outer, l) - pressure)
    }

    /// Torque \[N·m\] and axial force \[N\] that hold an incompressible cylinder at `twist` rad per m and at its length:
    /// T = π ψ R⁴ (C₁₀ + C₀₁), N = −π ψ² R⁴ (C₁₀/2 + C₀₁). Rivlin 1949; Ogden, Non-Linear Elastic Deformations, §5.2.
    pub fn torsion(&self, radius: f64, twist: f64) -> (f64, f64) {
        let r4 = PI * radius.powi(4);
        (r4 * twist * (self.c10 + self.c01), -r4 * twist * twist * (self.c10 / 2.0 + self.c01))
    }

    /// Elongation \[m\] of a bar of `length` under its own weight at `gravity` \[m/s²\], each section in uniaxial stress.
    pub fn hanging_elongation(&self, length: f64, gravity: f64) -> f64 {
        integral(0.0, length, |below| {
            let nominal = DENSITY * gravity * below;
            root(1.0, 3.0, |l| self.uniaxial_nominal(l) - nominal) - 1.0
        })
    }
}

/// Root of an increasing or decreasing function between `low` and `high`, by bisection to the last bit.
pub fn root(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let rising = f(high) > f(low);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if (f(middle) < 0.0) == rising { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// ∫ f from `a` to `b`: Simpson's rule on 200 intervals (error below 1e-9 of these smooth functions).
fn integral(a: f64, b: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (n, h) = (200, (b - a) / 200.0);
    let inner: f64 = (1..n).map(|i| if i % 2 == 1 { 4.0 } else { 2.0 } * f(a + i as f64 * h)).sum();
    h / 3.0 * (f(a) + inner + f(b))
}
