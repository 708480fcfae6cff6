//! Shape functions and quadrature of the solid and surface elements.
//!
//! Hughes, The Finite Element Method, Dover 2000, §3.2-3.9; Zienkiewicz & Taylor, The Finite Element Method, 6th ed.,
//! vol. 1, §5.11 (tetrahedra) and §5.12 (wedges). Node order as in [`crate::mesh::CellKind`].

/// Shape functions at the points of a quadrature rule: `N` nodes, `G` points, `D` parametric directions.
pub struct Rule<const N: usize, const G: usize, const D: usize> {
    /// Weights on the parametric cell.
    pub w: [f64; G],
    /// Shape functions N_a at each point.
    pub n: [[f64; N]; G],
    /// ∂N_a/∂ξ at each point.
    pub dn: [[[f64; D]; N]; G],
}

/// Parametric corners of the hexahedron, in node order.
pub const HEX_CORNERS: [[f64; 3]; 8] = [
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

/// Trilinear shape functions and their derivatives at ξ in \[-1, 1\]³.
pub fn hex8_at(xi: [f64; 3]) -> ([f64; 8], [[f64; 3]; 8]) {
    let (mut n, mut dn) = ([0.0; 8], [[0.0; 3]; 8]);
    for (a, c) in HEX_CORNERS.iter().enumerate() {
        let f = [1.0 + c[0] * xi[0], 1.0 + c[1] * xi[1], 1.0 + c[2] * xi[2]];
        n[a] = 0.125 * f[0] * f[1] * f[2];
        dn[a] = [0.125 * c[0] * f[1] * f[2], 0.125 * c[1] * f[0] * f[2], 0.125 * c[2] * f[0] * f[1]];
    }
    (n, dn)
}

/// Hexahedron with 2×2×2 Gauss points.
pub fn hex8() -> Rule<8, 8, 3> {
    let r = 1.0 / 3.0_f64.sqrt();
    let at = HEX_CORNERS.map(|c| hex8_at(c.map(|x| x * r)));
    Rule { w: [1.0; 8], n: at.map(|a| a.0), dn: at.map(|a| a.1) }
}

/// Linear tetrahedron with one point.
pub fn tet4() -> Rule<4, 1, 3> {
    let dn = [[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Rule { w: [1.0 / 6.0], n: [[0.25; 4]], dn: [dn] }
}

/// Quadratic tetrahedron shape functions and derivatives at ξ (ξ, η, ζ ≥ 0, sum ≤ 1).
pub fn tet10_at(xi: [f64; 3]) -> ([f64; 10], [[f64; 3]; 10]) {
    let l = [1.0 - xi[0] - xi[1] - xi[2], xi[0], xi[1], xi[2]];
    let dl = [[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)];
    let (mut n, mut dn) = ([0.0; 10], [[0.0; 3]; 10]);
    for a in 0..4 {
        n[a] = l[a] * (2.0 * l[a] - 1.0);
        dn[a] = dl[a].map(|d| d * (4.0 * l[a] - 1.0));
    }
    for (e, &(a, b)) in edges.iter().enumerate() {
        n[4 + e] = 4.0 * l[a] * l[b];
        dn[4 + e] = std::array::from_fn(|d| 4.0 * (dl[a][d] * l[b] + l[a] * dl[b][d]));
    }
    (n, dn)
}

/// Quadratic tetrahedron with four points (exact to degree 2).
pub fn tet10() -> Rule<10, 4, 3> {
    let (a, b) = (0.138_196_601_125_010_5, 0.585_410_196_624_968_5);
    let at = [[a, a, a], [b, a, a], [a, b, a], [a, a, b]].map(tet10_at);
    Rule { w: [1.0 / 24.0; 4], n: at.map(|p| p.0), dn: at.map(|p| p.1) }
}

/// Wedge shape functions and derivatives at ξ (ξ, η ≥ 0, ξ + η ≤ 1, ζ in \[-1, 1\]).
pub fn wedge6_at(xi: [f64; 3]) -> ([f64; 6], [[f64; 3]; 6]) {
    let l = [1.0 - xi[0] - xi[1], xi[0], xi[1]];
    let dl = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
    let (mut n, mut dn) = ([0.0; 6], [[0.0; 3]; 6]);
    for (a, z) in [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0].into_iter().enumerate() {
        let (l, [dx, dy]) = (l[a % 3], dl[a % 3]);
        let h = 0.5 * (1.0 + z * xi[2]);
        n[a] = l * h;
        dn[a] = [dx * h, dy * h, 0.5 * z * l];
    }
    (n, dn)
}

/// Wedge with three points in the triangle (exact to degree 2) at each of two Gauss points along the axis.
pub fn wedge6() -> Rule<6, 6, 3> {
    let (a, b, r) = (1.0 / 6.0, 2.0 / 3.0, 1.0 / 3.0_f64.sqrt());
    let at = [[a, a, -r], [b, a, -r], [a, b, -r], [a, a, r], [b, a, r], [a, b, r]].map(wedge6_at);
    Rule { w: [1.0 / 6.0; 6], n: at.map(|p| p.0), dn: at.map(|p| p.1) }
}

/// Bilinear shape functions and derivatives at ξ in \[-1, 1\]².
pub fn quad4_at(xi: [f64; 2]) -> ([f64; 4], [[f64; 2]; 4]) {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let (mut n, mut dn) = ([0.0; 4], [[0.0; 2]; 4]);
    for (a, c) in corners.iter().enumerate() {
        let f: [f64; 2] = [1.0 + c[0] * xi[0], 1.0 + c[1] * xi[1]];
        n[a] = 0.25 * f[0] * f[1];
        dn[a] = [0.25 * c[0] * f[1], 0.25 * c[1] * f[0]];
    }
    (n, dn)
}

/// Quadrilateral with 2×2 Gauss points.
pub fn quad4() -> Rule<4, 4, 2> {
    let r = 1.0 / 3.0_f64.sqrt();
    let at = [[-r, -r], [r, -r], [r, r], [-r, r]].map(quad4_at);
    Rule { w: [1.0; 4], n: at.map(|a| a.0), dn: at.map(|a| a.1) }
}

/// Linear triangle with one point.
pub fn tri3() -> Rule<3, 1, 2> {
    Rule { w: [0.5], n: [[1.0 / 3.0; 3]], dn: [[[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]]] }
}

/// Σ_a x_a ⊗ d_a, for d_a whose sum is zero as that of derivatives of shape functions is. Computed as Σ_{a>0} (x_a − x_0) ⊗ d_a: its
/// round-off grows with the size of the element and not with its distance from the origin.
#[inline(always)]
pub(crate) fn contract<const N: usize, const D: usize>(
    x: &[[f64; 3]; N],
    d: &[[f64; D]; N],
) -> nalgebra::SMatrix<f64, 3, D> {
    let mut F = [[0.0; 3]; D];
    for a in 1..N {
        let side: [f64; 3] = std::array::from_fn(|i| x[a][i] - x[0][i]);
        for j in 0..D {
            for i in 0..3 {
                F[j][i] += side[i] * d[a][j];
            }
        }
    }
    F.into()
}
