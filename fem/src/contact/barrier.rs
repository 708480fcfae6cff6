//! The barrier: energy per area of a layer between two surfaces that is squeezed from thickness d̂ to d.
//!
//! b(d) = κ d̂ B(d/d̂), B(s) = −(1 − s)² ln s below 1 and 0 above: no force at d̂, twice continuously differentiable there,
//! infinite at contact. κ \[Pa\] is the stiffness of the layer: at half its thickness it bears a pressure of 1.19 κ.
//! Li et al., Incremental potential contact, ACM Trans. Graph. 39 (2020), eq. 6, here of the distance and per area as in
//! Li, Kaufman & Jiang, Convergent incremental potential contact (2023), arXiv:2307.15908.

/// B, B′ and B″ at s = d/d̂ where s ≥ `softness`, which is above zero; below it their parabola from there, for penetrations (s < 0) too.
pub fn softened(s: f64, softness: f64) -> [f64; 3] {
    if s >= softness {
        return barrier(s);
    }
    let ([b, b1, b2], ahead) = (barrier(softness), s - softness);
    [b + ahead * (b1 + 0.5 * ahead * b2), b1 + ahead * b2, b2]
}

/// B, B′ and B″ at s = d/d̂; zeros where s ≥ 1, `+∞` of B where s is not positive.
pub fn barrier(s: f64) -> [f64; 3] {
    if s >= 1.0 {
        return [0.0; 3];
    }
    if !(s > 0.0) {
        return [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY];
    }
    let (log, gap) = (s.ln(), 1.0 - s);
    [-gap * gap * log, 2.0 * gap * log - gap * gap / s, -2.0 * log + 4.0 * gap / s + gap * gap / (s * s)]
}
