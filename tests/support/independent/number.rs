//! Numbers of 32 digits, and the same with a derivative.
//!
//! Dekker, A floating-point technique for extending the available precision, Numer. Math. 18 (1971); Knuth, The Art of
//! Computer Programming, vol. 2, §4.2.2.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// The unevaluated sum of two doubles: about 32 digits.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Wide {
    hi: f64,
    lo: f64,
}

impl Wide {
    /// 0.
    pub const ZERO: Wide = Wide { hi: 0.0, lo: 0.0 };
    /// 1.
    pub const ONE: Wide = Wide { hi: 1.0, lo: 0.0 };

    /// Exactly `v`.
    pub const fn new(v: f64) -> Wide {
        Wide { hi: v, lo: 0.0 }
    }

    /// `n`/`d` of two whole numbers.
    pub fn ratio(n: f64, d: f64) -> Wide {
        Wide::new(n) / Wide::new(d)
    }

    /// The nearest double.
    pub fn value(self) -> f64 {
        self.hi + self.lo
    }

    /// √.
    pub fn sqrt(self) -> Wide {
        let y = self.hi.sqrt();
        if !(y > 0.0 && y.is_finite()) {
            return Wide::new(y);
        }
        let y = Wide::new(y);
        y + (self - y * y) / (y + y)
    }

    /// Cube root.
    pub fn cbrt(self) -> Wide {
        let y = Wide::new(self.hi.cbrt());
        if y.hi == 0.0 || !y.hi.is_finite() {
            return y;
        }
        y - (y * y * y - self) / (y * y * Wide::new(3.0))
    }

    /// eˣ: Taylor's series of x less whole multiples of ln 2, over 2⁹, squared nine times.
    pub fn exp(self) -> Wide {
        if self.hi.is_nan() || self.hi.abs() >= 700.0 {
            return Wide::new(self.hi.exp());
        }
        const LN_2: Wide = Wide { hi: std::f64::consts::LN_2, lo: 2.319_046_813_846_299_6e-17 };
        let k = (self.hi / LN_2.hi).round();
        let r = (self - LN_2 * Wide::new(k)) * Wide::new(1.0 / 512.0);
        let mut sum = Wide::ZERO;
        for n in (1..=11).rev() {
            // r (1 + r/2 (1 + r/3 (…))) = eʳ − 1.
            sum = r * (Wide::ONE + sum) / Wide::new(f64::from(n));
        }
        for _ in 0..9 {
            sum = sum * (sum + Wide::new(2.0)); // (1 + s)² − 1
        }
        let scale = 2.0_f64.powi(k as i32);
        let e = sum + Wide::ONE;
        Wide { hi: e.hi * scale, lo: e.lo * scale }
    }

    /// Natural logarithm, by one step of Halley's method.
    pub fn ln(self) -> Wide {
        let y = Wide::new(self.hi.ln());
        if !y.hi.is_finite() {
            return y;
        }
        let e = y.exp();
        y + Wide::new(2.0) * (self - e) / (self + e)
    }

    /// |x|.
    pub fn abs(self) -> Wide {
        if self.hi < 0.0 { -self } else { self }
    }
}

/// a + b and its rounding error.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let bb = s - a;
    (s, (a - (s - bb)) + (b - bb))
}

/// The same where |a| ≥ |b|.
fn fast_two_sum(a: f64, b: f64) -> Wide {
    let s = a + b;
    Wide { hi: s, lo: b - (s - a) }
}

/// a b and its rounding error.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let split = |v: f64| {
        let t = 134_217_729.0 * v; // 2²⁷ + 1
        let hi = t - (t - v);
        (hi, v - hi)
    };
    let p = a * b;
    let ((ah, al), (bh, bl)) = (split(a), split(b));
    (p, ((ah * bh - p) + ah * bl + al * bh) + al * bl)
}

impl Add for Wide {
    type Output = Wide;
    fn add(self, b: Wide) -> Wide {
        let (s, e) = two_sum(self.hi, b.hi);
        let (t, f) = two_sum(self.lo, b.lo);
        let v = fast_two_sum(s, e + t);
        fast_two_sum(v.hi, v.lo + f)
    }
}

impl Neg for Wide {
    type Output = Wide;
    fn neg(self) -> Wide {
        Wide { hi: -self.hi, lo: -self.lo }
    }
}

impl Sub for Wide {
    type Output = Wide;
    fn sub(self, b: Wide) -> Wide {
        self + -b
    }
}

impl Mul for Wide {
    type Output = Wide;
    fn mul(self, b: Wide) -> Wide {
        let (p, e) = two_product(self.hi, b.hi);
        fast_two_sum(p, e + (self.hi * b.lo + self.lo * b.hi))
    }
}

impl Div for Wide {
    type Output = Wide;
    fn div(self, b: Wide) -> Wide {
        let q = self.hi / b.hi;
        let rest = self - b * Wide::new(q);
        let q2 = rest.hi / b.hi;
        let rest = rest - b * Wide::new(q2);
        let v = fast_two_sum(q, q2);
        fast_two_sum(v.hi, v.lo + rest.hi / b.hi)
    }
}

impl std::iter::Sum for Wide {
    fn sum<I: Iterator<Item = Wide>>(iter: I) -> Wide {
        iter.fold(Wide::ZERO, |a, b| a + b)
    }
}

/// A value with its derivative along one direction.
#[derive(Clone, Copy, Debug)]
pub struct Dual {
    /// Value.
    pub v: Wide,
    /// Derivative.
    pub d: Wide,
}

impl Dual {
    /// A constant.
    pub fn constant(v: f64) -> Dual {
        Dual { v: Wide::new(v), d: Wide::ZERO }
    }

    /// A function of it, of value `v` and slope `slope`.
    pub fn chain(self, v: Wide, slope: Wide) -> Dual {
        Dual { v, d: slope * self.d }
    }

    /// √.
    pub fn sqrt(self) -> Dual {
        let r = self.v.sqrt();
        self.chain(r, Wide::new(0.5) / r)
    }

    /// Cube root.
    pub fn cbrt(self) -> Dual {
        let r = self.v.cbrt();
        self.chain(r, r / (Wide::new(3.0) * self.v))
    }

    /// Natural logarithm.
    pub fn ln(self) -> Dual {
        self.chain(self.v.ln(), Wide::ONE / self.v)
    }

    /// x².
    pub fn squared(self) -> Dual {
        self * self
    }
}

impl From<f64> for Dual {
    fn from(v: f64) -> Dual {
        Dual::constant(v)
    }
}

impl Add for Dual {
    type Output = Dual;
    fn add(self, b: Dual) -> Dual {
        Dual { v: self.v + b.v, d: self.d + b.d }
    }
}

impl Sub for Dual {
    type Output = Dual;
    fn sub(self, b: Dual) -> Dual {
        Dual { v: self.v - b.v, d: self.d - b.d }
    }
}

impl Mul for Dual {
    type Output = Dual;
    fn mul(self, b: Dual) -> Dual {
        Dual { v: self.v * b.v, d: self.d * b.v + self.v * b.d }
    }
}

impl Div for Dual {
    type Output = Dual;
    fn div(self, b: Dual) -> Dual {
        let q = self.v / b.v;
        Dual { v: q, d: (self.d - q * b.d) / b.v }
    }
}

impl Add<f64> for Dual {
    type Output = Dual;
    fn add(self, b: f64) -> Dual {
        self + Dual::constant(b)
    }
}

impl Sub<f64> for Dual {
    type Output = Dual;
    fn sub(self, b: f64) -> Dual {
        self - Dual::constant(b)
    }
}

impl Mul<f64> for Dual {
    type Output = Dual;
    fn mul(self, b: f64) -> Dual {
        Dual { v: self.v * Wide::new(b), d: self.d * Wide::new(b) }
    }
}
