//! Laws of fibres and strands: force along a line as a function of its stretch.

use std::f64::consts::PI;

/// Energy per reference length and its first two derivatives by the stretch λ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineResponse {
    /// w \[N\] (J per m of reference length).
    pub energy: f64,
    /// Axial force N = ∂w/∂λ \[N\], tension positive.
    pub force: f64,
    /// ∂N/∂λ \[N\].
    pub stiffness: f64,
}

/// A law of a line that carries axial force only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LineLaw {
    /// [`ThermalFibre`].
    Thermal(ThermalFibre),
    /// [`HillFibre`].
    Hill(HillFibre),
    /// [`Strand`].
    Strand(Strand),
}

impl LineLaw {
    /// Response at stretch `lambda` (current over reference length, positive) and activation `a`.
    pub fn response(&self, lambda: f64, a: f64) -> LineResponse {
        match self {
            LineLaw::Thermal(law) => law.response(lambda, a),
            LineLaw::Hill(law) => law.response(lambda, a),
            LineLaw::Strand(law) => law.response(lambda),
        }
    }

    /// What ∂N/∂λ \[N\] is at most, of a law with a toe at activation `a`; 0 for others, which say all by where they are.
    pub fn taut_stiffness(&self, a: f64) -> f64 {
        match self {
            LineLaw::Thermal(ThermalFibre { toe: Some(_), stiffness, contraction, strain }) => match strain {
                FibreStrain::Engineering => *stiffness,
                FibreStrain::Logarithmic => stiffness * (contraction * a).exp(),
            },
            LineLaw::Strand(law) => law.stiffness,
            _ => 0.0,
        }
    }
}

/// Strain measure of a [`ThermalFibre`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FibreStrain {
    /// e = λ − 1.
    Engineering,
    /// e = ln λ.
    Logarithmic,
}

/// Bar that wants to shorten by a "thermal" strain: N = E A (e(λ) + c a).
///
/// c a stands for −α ΔT, the way explicit codes drive muscle bars. With a `toe` the bar carries tension only:
/// with e* = e + c a, N = 0 for e* ≤ 0, E A e*²/(2 toe) up to e* = toe, E A (e* − toe/2) above; N and ∂N/∂λ are
/// continuous.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThermalFibre {
    /// E A \[N\], Young's modulus times area.
    pub stiffness: f64,
    /// Strain c by which the bar wants to shorten at full activation.
    pub contraction: f64,
    /// Strain measure.
    pub strain: FibreStrain,
    /// Width of the toe in strain, positive; `None`: the bar resists compression as it does tension.
    pub toe: Option<f64>,
}

impl ThermalFibre {
    fn response(&self, lambda: f64, a: f64) -> LineResponse {
        let shift = self.contraction * a;
        // Strain u, du/dλ, and ∫ u dλ, ½∫ u² dλ counted from the slack length, where u = 0.
        let (u, du, int_u, int_u2, slack) = match self.strain {
            FibreStrain::Engineering => {
                let u = lambda - 1.0 + shift;
                (u, 1.0, 0.5 * u * u, u * u * u / 6.0, 1.0 - shift)
            }
            FibreStrain::Logarithmic => {
                let u = lambda.ln() + shift;
                let slack = (-shift).exp();
                let int_u = lambda * (u - 1.0) + slack;
                (u, 1.0 / lambda, int_u, 0.5 * (lambda * (u * u - 2.0 * u + 2.0) - 2.0 * slack), slack)
            }
        };
        let (energy, force, slope) = match self.toe {
            None => (int_u, u, 1.0),
            Some(_) if u <= 0.0 => (0.0, 0.0, 0.0),
            Some(toe) if u <= toe => (int_u2 / toe, 0.5 * u * u / toe, u / toe),
            Some(toe) => {
                let (end, at_end) = match self.strain {
                    FibreStrain::Engineering => (slack + toe, [0.5 * toe * toe, toe * toe * toe / 6.0]),
                    FibreStrain::Logarithmic => {
                        let end = (toe - shift).exp();
                        let int_u = end * (toe - 1.0) + slack;
                        (end, [int_u, 0.5 * (end * (toe * toe - 2.0 * toe + 2.0) - 2.0 * slack)])
                    }
                };
                let rise = int_u - at_end[0] - 0.5 * toe * (lambda - end);
                (at_end[1] / toe + rise, u - 0.5 * toe, 1.0)
            }
        };
        let k = self.stiffness;
        LineResponse { energy: k * energy, force: k * force, stiffness: k * slope * du }
    }
}

/// Bar with the isometric Hill curves of Thelen: N = F₀ (a f_L(L) + f_P(L)), L = λ/λ_opt.
///
/// f_L = exp(−(L − 1)²/γ);   f_P = (exp(k (L − 1)/e₀) − 1)/(exp(k) − 1) above L = 1, zero below.
/// Thelen, J Biomech Eng 2003;125:70, eqs. (3) and (4), young adults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HillFibre {
    /// F₀ \[N\], force at full activation and optimal length.
    pub f_max: f64,
    /// Fibre stretch λ_opt at which the fibre has its optimal length.
    pub lambda_opt: f64,
}

impl HillFibre {
    const GAMMA: f64 = 0.45;
    const K_PE: f64 = 5.0;
    const E_0: f64 = 0.6;

    fn response(&self, lambda: f64, a: f64) -> LineResponse {
        let d = lambda / self.lambda_opt - 1.0;
        let f_l = (-d * d / Self::GAMMA).exp();
        let w_l = 0.5 * (PI * Self::GAMMA).sqrt() * libm::erf(d / Self::GAMMA.sqrt());
        let (w_p, f_p, k_p) = if d > 0.0 {
            let (rate, scale) = (Self::K_PE / Self::E_0, Self::K_PE.exp_m1());
            let e = (rate * d).exp_m1();
            ((e / rate - d) / scale, e / scale, rate * (e + 1.0) / scale)
        } else {
            (0.0, 0.0, 0.0)
        };
        LineResponse {
            energy: self.f_max * self.lambda_opt * (a * w_l + w_p),
            force: self.f_max * (a * f_l + f_p),
            stiffness: self.f_max / self.lambda_opt * (-2.0 * a * d / Self::GAMMA * f_l + k_p),
        }
    }
}

/// Ligament strand: slack in compression, quadratic toe, then linear. The reference length of the line is the slack
/// length.
///
/// With ε = λ − 1: N = 0 for ε ≤ 0, ¼ k ε²/ε_l up to 2 ε_l, k (ε − ε_l) above.
/// Blankevoort & Huiskes, J Biomech Eng 1991;113:263, eq. (1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strand {
    /// k \[N\], force per unit strain.
    pub stiffness: f64,
    /// Half the strain at which the toe ends ε_l, 0.03 for knee ligaments.
    pub toe: f64,
}

impl Strand {
    /// Slack length \[m\] of a strand that is `l_ref` \[m\] long at reference strain `e_ref`.
    pub fn slack_length(l_ref: f64, e_ref: f64) -> f64 {
        l_ref / (1.0 + e_ref)
    }

    fn response(&self, lambda: f64) -> LineResponse {
        let (e, l, k) = (lambda - 1.0, self.toe, self.stiffness);
        if e <= 0.0 {
            LineResponse { energy: 0.0, force: 0.0, stiffness: 0.0 }
        } else if e <= 2.0 * l {
            LineResponse {
                energy: k * e * e * e / (12.0 * l),
                force: 0.25 * k * e * e / l,
                stiffness: 0.5 * k * e / l,
            }
        } else {
            let d = e - 2.0 * l;
            LineResponse {
                energy: k * (2.0 / 3.0 * l * l + l * d + 0.5 * d * d),
                force: k * (e - l),
                stiffness: k,
            }
        }
    }
}
