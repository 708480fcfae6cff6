//! Normalised curves of a Hill-type muscle: two published sets behind one enum.
//!
//! Fibre length L = l/l_opt, fibre velocity V = v/(v_max l_opt) with lengthening positive, tendon strain
//! E = (l_t − l_ts)/l_ts; forces are multiples of f_max. With activation a and pennation α
//!
//! ```text
//! F / f_max = (a f_L(L) f_V(V) + f_P(L)) cos α = f_T(E)
//! ```
//!
//! Set A, [`Thelen2003`]: Thelen, J Biomech Eng 2003;125:70. Set B, [`DeGroote2016`]: De Groote et al.,
//! Ann Biomed Eng 2016;44:2922. Every force is finite and not negative for finite arguments of a
//! muscle's size; a fibre that shortens faster than the curve allows carries none.

#![allow(non_snake_case)]

/// A value and its derivative with respect to the argument that the function names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slope {
    /// The value.
    pub f: f64,
    /// Its derivative; at a corner the one of the side that includes the corner.
    pub df: f64,
}

/// One set of Hill curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curves {
    /// Set A.
    Thelen(Thelen2003),
    /// Set B.
    DeGroote(DeGroote2016),
}

impl Default for Curves {
    /// Set A with the parameters of the gait2392 model.
    fn default() -> Self {
        Self::Thelen(Thelen2003::GAIT2392)
    }
}

impl Curves {
    /// Active force-length curve f_L and df_L/dL.
    pub fn active_length(&self, L: f64) -> Slope {
        match self {
            Self::Thelen(c) => c.active_length(L),
            Self::DeGroote(_) => DeGroote2016::active_length(L),
        }
    }

    /// Passive force-length curve f_P and df_P/dL; zero up to optimal length.
    pub fn passive(&self, L: f64) -> Slope {
        match self {
            Self::Thelen(c) => passive(L, c.passive_shape, c.passive_strain),
            Self::DeGroote(_) => passive(L, 4.0, 0.6),
        }
    }

    /// Force-velocity curve f_V and df_V/dV. Set A widens its velocity range with activation `a`; set B ignores it.
    pub fn velocity(&self, V: f64, a: f64) -> Slope {
        match self {
            Self::Thelen(c) => c.velocity(V, a),
            Self::DeGroote(_) => DeGroote2016::velocity(V),
        }
    }

    /// The velocity V at which f_V(V) = `f` at activation `a`.
    ///
    /// Where `f` is outside the range of the curve (set A: 0 to its eccentric limit) the nearest attained
    /// value counts; 0 belongs to the fastest shortening that needs no force.
    pub fn velocity_inverse(&self, f: f64, a: f64) -> f64 {
        match self {
            Self::Thelen(c) => c.velocity_inverse(f, a),
            Self::DeGroote(_) => DeGroote2016::velocity_inverse(f),
        }
    }

    /// The activation a that solves a f_V(V, a) = `r`, where `r` = (F/(f_max cos α) − f_P)/f_L; not clipped.
    ///
    /// `r` < 0 (more passive force than the tendon carries) has no such a; `r` itself is returned, the excess in
    /// multiples of the isometric active force.
    pub fn activation(&self, r: f64, V: f64) -> f64 {
        if r <= 0.0 {
            return r;
        }
        match self {
            Self::Thelen(c) => c.activation(r, V),
            Self::DeGroote(_) => r / DeGroote2016::velocity(V).f.max(DeGroote2016::LEAST_F_V),
        }
    }

    /// Tendon force-strain curve f_T and df_T/dE; zero for a slack tendon.
    pub fn tendon(&self, E: f64) -> Slope {
        match self {
            Self::Thelen(c) => c.tendon(E),
            Self::DeGroote(c) => c.tendon(E),
        }
    }

    /// The strain E at which f_T(E) = `f`, in closed form; for `f` ≤ 0 the strain where the tendon goes slack.
    pub fn tendon_strain(&self, f: f64) -> f64 {
        match self {
            Self::Thelen(c) => c.tendon_strain(f.max(0.0)),
            Self::DeGroote(c) => c.tendon_strain(f.max(0.0)),
        }
    }
}

/// f_P = (exp(k (L − 1)/e0) − 1)/(exp(k) − 1) above L = 1, 0 below (Thelen 2003, eq. 3; De Groote 2016 uses it too).
fn passive(L: f64, k: f64, e0: f64) -> Slope {
    if L <= 1.0 {
        return Slope { f: 0.0, df: 0.0 };
    }
    let scale = k.exp_m1();
    let argument = k * (L - 1.0) / e0;
    Slope { f: argument.exp_m1() / scale, df: k / e0 * argument.exp() / scale }
}

/// Parameters of set A.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thelen2003 {
    /// Width g of f_L = exp(−(L − 1)²/g).
    pub active_shape: f64,
    /// Exponent k of the passive curve.
    pub passive_shape: f64,
    /// Passive fibre strain e0 at f_max.
    pub passive_strain: f64,
    /// Tendon strain E0 at f_max.
    pub tendon_strain_at_f_max: f64,
    /// Curvature A_f of the force-velocity curve.
    pub a_f: f64,
    /// Largest force of a lengthening fibre, in multiples of its isometric force.
    pub f_len: f64,
}

/// Tendon force at the end of the toe, and the exponent of the toe (Thelen 2003, eq. 5).
const F_TOE: f64 = 0.33;
const K_TOE: f64 = 3.0;

impl Thelen2003 {
    /// Values in the file of the gait2392 model (gait2392_thelen2003muscle.osim, OpenSim models).
    pub const GAIT2392: Self = Self {
        active_shape: 0.5,
        passive_shape: 4.0,
        passive_strain: 0.6,
        tendon_strain_at_f_max: 0.033,
        a_f: 0.3,
        f_len: 1.8,
    };
    /// Young adults in the paper, as commonly quoted.
    pub const PAPER: Self = Self {
        active_shape: 0.45,
        passive_shape: 5.0,
        passive_strain: 0.6,
        tendon_strain_at_f_max: 0.04,
        a_f: 0.25,
        f_len: 1.4,
    };
    /// Defaults of OpenSim's Thelen2003Muscle.
    pub const OPENSIM: Self = Self { tendon_strain_at_f_max: 0.033, f_len: 1.8, ..Self::PAPER };

    fn active_length(&self, L: f64) -> Slope {
        let f = (-(L - 1.0).powi(2) / self.active_shape).exp();
        Slope { f, df: -2.0 * (L - 1.0) / self.active_shape * f }
    }

    /// c = (2 + 2/A_f)/(F_len − 1): slope constant of the lengthening branch.
    fn lengthening(&self) -> f64 {
        (2.0 + 2.0 / self.a_f) / (self.f_len - 1.0)
    }

    /// Thelen 2003, eqs. 6 and 7, solved for the force. With w = V/(0.25 + 0.75 a) and f = f_V:
    /// shortening w = (f − 1)/(1 + f/A_f), lengthening w = (f − 1)/(c (F_len − f)).
    fn velocity(&self, V: f64, a: f64) -> Slope {
        let s = 0.25 + 0.75 * a;
        let w = V / s;
        if w <= -1.0 {
            return Slope { f: 0.0, df: 0.0 };
        }
        if w <= 0.0 {
            let d = 1.0 - w / self.a_f;
            return Slope { f: (1.0 + w) / d, df: (1.0 + 1.0 / self.a_f) / (d * d * s) };
        }
        let c = self.lengthening();
        let d = 1.0 + c * w;
        Slope { f: (1.0 + c * self.f_len * w) / d, df: c * (self.f_len - 1.0) / (d * d * s) }
    }

    fn velocity_inverse(&self, f: f64, a: f64) -> f64 {
        let s = 0.25 + 0.75 * a;
        // The eccentric limit itself is only reached at infinite velocity.
        let f = f.clamp(0.0, self.f_len * (1.0 - 1e-12));
        let w = if f <= 1.0 {
            (f - 1.0) / (1.0 + f / self.a_f)
        } else {
            (f - 1.0) / (self.lengthening() * (self.f_len - f))
        };
        s * w
    }

    /// Both branches of a f_V(V, a) = r have the form a (s + V q) = r (s + V p), s = 0.25 + 0.75 a: a quadratic in a
    /// whose roots have opposite signs, because r > 0 and 0.25 + V p > 0. a f_V grows with a, so the positive one is it.
    fn activation(&self, r: f64, V: f64) -> f64 {
        let (q, p) = if V <= 0.0 {
            (1.0, -1.0 / self.a_f)
        } else {
            (self.lengthening() * self.f_len, self.lengthening())
        };
        let b = 0.25 + V * q - 0.75 * r;
        let c = -r * (0.25 + V * p);
        let root = (b * b - 3.0 * c).sqrt();
        // The form of the root that does not cancel.
        if b >= 0.0 { -2.0 * c / (b + root) } else { (root - b) / 1.5 }
    }

    /// End of the toe: the value that makes the curve C¹ there and 1 at E0. The paper rounds it to 0.609 E0 (and
    /// the slope of the linear part to 1.712/E0).
    fn toe_end(&self) -> f64 {
        let e3 = K_TOE.exp();
        99.0 * e3 / (166.0 * e3 - 67.0) * self.tendon_strain_at_f_max
    }

    fn linear_slope(&self) -> f64 {
        (1.0 - F_TOE) / (self.tendon_strain_at_f_max - self.toe_end())
    }

    fn tendon(&self, E: f64) -> Slope {
        let toe = self.toe_end();
        if E <= 0.0 {
            Slope { f: 0.0, df: 0.0 }
        } else if E <= toe {
            let scale = F_TOE / K_TOE.exp_m1();
            let argument = K_TOE * E / toe;
            Slope { f: scale * argument.exp_m1(), df: scale * K_TOE / toe * argument.exp() }
        } else {
            Slope { f: F_TOE + self.linear_slope() * (E - toe), df: self.linear_slope() }
        }
    }

    fn tendon_strain(&self, f: f64) -> f64 {
        if f <= F_TOE {
            self.toe_end() / K_TOE * (f * K_TOE.exp_m1() / F_TOE).ln_1p()
        } else {
            self.toe_end() + (f - F_TOE) / self.linear_slope()
        }
    }
}

/// Tendon parameters of set B; its other curves have no free parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeGroote2016 {
    /// f_T = c1 exp(k_T (1 + E − c2)) − c3.
    pub c1: f64,
    /// See `c1`.
    pub c2: f64,
    /// See `c1`.
    pub c3: f64,
    /// Tendon stiffness k_T.
    pub k_t: f64,
}

impl DeGroote2016 {
    /// Values of the paper.
    pub const PAPER: Self = Self { c1: 0.200, c2: 0.995, c3: 0.250, k_t: 35.0 };
    /// Values of OpenSim's DeGrooteFregly2016Muscle: slack exactly at zero strain.
    pub const OPENSIM: Self = Self { c1: 0.200, c2: 1.0, c3: 0.200, k_t: 35.0 };

    /// Least f_V that an activation is divided by. At V = −1 the curve passes through zero, where no activation
    /// explains a force; the bound keeps the answer finite, and far above 1, where it is reported as clipped.
    pub const LEAST_F_V: f64 = 1e-3;

    /// b1, b2, b3, b4 of the three Gaussian-like terms, unrounded (DeGrooteFregly2016Muscle.h of OpenSim).
    const B: [[f64; 4]; 3] = [
        [0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465],
        [0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188],
        [0.1, 1.0, 0.353553390593274, 0.0],
    ];
    const D: [f64; 4] = [-0.3211346127989808, -8.149, -0.374, 0.8825327733249912];

    /// f_L = Σ b1 exp(−½ ((L − b2)/(b3 + b4 L))²). The denominator is squared; published codes that forget it get
    /// f_L(1) = 1.25. The width of the second term vanishes at L = 0.15, where the term does, too.
    fn active_length(L: f64) -> Slope {
        let mut sum = Slope { f: 0.0, df: 0.0 };
        for [b1, b2, b3, b4] in Self::B {
            let width = b3 + b4 * L;
            let z = (L - b2) / width;
            let f = b1 * (-0.5 * z * z).exp();
            // A vanishing width drives z to ±∞ and the term, with its derivative, to zero.
            if f > 0.0 {
                sum.f += f;
                sum.df -= f * z * (b3 + b4 * b2) / (width * width);
            }
        }
        sum
    }

    /// f_V = d1 asinh(d2 V + d3) + d4, cut off at zero force.
    fn velocity(V: f64) -> Slope {
        let [d1, d2, d3, d4] = Self::D;
        let x = d2 * V + d3;
        let f = d1 * x.asinh() + d4;
        if f <= 0.0 {
            return Slope { f: 0.0, df: 0.0 };
        }
        Slope { f, df: d1 * d2 / (x * x + 1.0).sqrt() }
    }

    fn velocity_inverse(f: f64) -> f64 {
        let [d1, d2, d3, d4] = Self::D;
        (((f.max(0.0) - d4) / d1).sinh() - d3) / d2
    }

    fn tendon(&self, E: f64) -> Slope {
        let exponential = self.c1 * (self.k_t * (1.0 + E - self.c2)).exp();
        if exponential <= self.c3 {
            return Slope { f: 0.0, df: 0.0 };
        }
        Slope { f: exponential - self.c3, df: self.k_t * exponential }
    }

    fn tendon_strain(&self, f: f64) -> f64 {
        ((f + self.c3) / self.c1).ln() / self.k_t + self.c2 - 1.0
    }
}
