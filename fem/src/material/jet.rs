//! Second-order forward differentiation: a value with its gradient and Hessian over `N` variables.
//!
//! A law writes its energy density once, over a generic [`Real`]; stress and tangent then follow without a
//! derivation by hand that could disagree with the energy.
//! Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM 2008, chapter 13 (truncated Taylor arithmetic).

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number an energy density can be written over: `f64` or [`Jet`].
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
{
    /// The value without derivatives.
    fn value(self) -> f64;
    /// φ(self), given φ, φ′ and φ″ at the value.
    fn chain(self, phi: f64, slope: f64, curvature: f64) -> Self;
    /// self^n.
    fn powf(self, n: f64) -> Self {
        let v = self.value();
        let p = v.powf(n);
        self.chain(p, n * p / v, n * (n - 1.0) * p / (v * v))
    }
    /// Cube root.
    fn cbrt(self) -> Self {
        let v = self.value();
        let r = v.cbrt();
        let d = r / (3.0 * v);
        self.chain(r, d, -2.0 / 3.0 * d / v)
    }
    /// Square root.
    fn sqrt(self) -> Self {
        let r = self.value().sqrt();
        self.chain(r, 0.5 / r, -0.25 / (r * r * r))
    }
    /// Natural logarithm.
    fn ln(self) -> Self {
        let v = self.value();
        self.chain(v.ln(), 1.0 / v, -1.0 / (v * v))
    }
    /// Exponential.
    fn exp(self) -> Self {
        let e = self.value().exp();
        self.chain(e, e, e)
    }
    /// 1 / self.
    fn recip(self) -> Self {
        let r = 1.0 / self.value();
        self.chain(r, -r * r, 2.0 * r * r * r)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn value(self) -> f64 {
        self
    }
    #[inline(always)]
    fn chain(self, phi: f64, _: f64, _: f64) -> f64 {
        phi
    }
}

/// A value with first and second derivatives over `N` variables.
#[derive(Clone, Copy, Debug)]
pub struct Jet<const N: usize> {
    /// Value.
    pub v: f64,
    /// Gradient.
    pub g: [f64; N],
    /// Hessian, symmetric.
    pub h: [[f64; N]; N],
}

impl<const N: usize> Jet<N> {
    /// The `index`-th independent variable.
    #[inline(always)]
    pub fn variable(v: f64, index: usize) -> Self {
        let mut g = [0.0; N];
        g[index] = 1.0;
        Jet { v, g, h: [[0.0; N]; N] }
    }
}

impl<const N: usize> Real for Jet<N> {
    #[inline(always)]
    fn value(self) -> f64 {
        self.v
    }
    #[inline(always)]
    fn chain(self, phi: f64, slope: f64, curvature: f64) -> Self {
        let mut out = Jet { v: phi, g: self.g.map(|g| slope * g), h: self.h };
        for i in 0..N {
            let c = curvature * self.g[i];
            for j in 0..N {
                out.h[i][j] = slope * self.h[i][j] + c * self.g[j];
            }
        }
        out
    }
}

impl<const N: usize> Add for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, o: Self) -> Self {
        self.v += o.v;
        for i in 0..N {
            self.g[i] += o.g[i];
            for j in 0..N {
                self.h[i][j] += o.h[i][j];
            }
        }
        self
    }
}

impl<const N: usize> Neg for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self * -1.0
    }
}

impl<const N: usize> Sub for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl<const N: usize> Mul for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let mut out = self;
        out.v = self.v * o.v;
        for i in 0..N {
            out.g[i] = self.g[i] * o.v + self.v * o.g[i];
            for j in 0..N {
                out.h[i][j] =
                    self.h[i][j] * o.v + self.g[i] * o.g[j] + self.g[j] * o.g[i] + self.v * o.h[i][j];
            }
        }
        out
    }
}

impl<const N: usize> Div for Jet<N> {
    type Output = Self;
    #[inline(always)]
    #[allow(clippy::suspicious_arithmetic_impl)]
    fn div(self, o: Self) -> Self {
        self * o.recip()
    }
}

impl<const N: usize> Add<f64> for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, o: f64) -> Self {
        self.v += o;
        self
    }
}

impl<const N: usize> Sub<f64> for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, o: f64) -> Self {
        self.v -= o;
        self
    }
}

impl<const N: usize> Mul<f64> for Jet<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, o: f64) -> Self {
        self.v *= o;
        for i in 0..N {
            self.g[i] *= o;
            for j in 0..N {
                self.h[i][j] *= o;
            }
        }
        self
    }
}

/// A value with first derivatives over `N` variables: a [`Jet`] without its Hessian, and to the bit what is in one, for what asks for stress
/// alone.
#[derive(Clone, Copy, Debug)]
pub struct Slope<const N: usize> {
    /// Value.
    pub v: f64,
    /// Gradient.
    pub g: [f64; N],
}

impl<const N: usize> Slope<N> {
    /// The `index`-th independent variable.
    #[inline(always)]
    pub fn variable(v: f64, index: usize) -> Self {
        let mut g = [0.0; N];
        g[index] = 1.0;
        Slope { v, g }
    }
}

impl<const N: usize> Real for Slope<N> {
    #[inline(always)]
    fn value(self) -> f64 {
        self.v
    }
    #[inline(always)]
    fn chain(self, phi: f64, slope: f64, _: f64) -> Self {
        Slope { v: phi, g: self.g.map(|g| slope * g) }
    }
}

impl<const N: usize> Add for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, o: Self) -> Self {
        self.v += o.v;
        for i in 0..N {
            self.g[i] += o.g[i];
        }
        self
    }
}

impl<const N: usize> Neg for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self * -1.0
    }
}

impl<const N: usize> Sub for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self + -o
    }
}

impl<const N: usize> Mul for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        let mut out = self;
        out.v = self.v * o.v;
        for i in 0..N {
            out.g[i] = self.g[i] * o.v + self.v * o.g[i];
        }
        out
    }
}

impl<const N: usize> Div for Slope<N> {
    type Output = Self;
    #[inline(always)]
    #[allow(clippy::suspicious_arithmetic_impl)]
    fn div(self, o: Self) -> Self {
        self * o.recip()
    }
}

impl<const N: usize> Add<f64> for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, o: f64) -> Self {
        self.v += o;
        self
    }
}

impl<const N: usize> Sub<f64> for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, o: f64) -> Self {
        self.v -= o;
        self
    }
}

impl<const N: usize> Mul<f64> for Slope<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, o: f64) -> Self {
        self.v *= o;
        for i in 0..N {
            self.g[i] *= o;
        }
        self
    }
}
