//! Shape functions and quadrature of the cells, written down from Hughes, The Finite Element Method, and Zienkiewicz & Taylor, vol. 1.

use super::number::Wide;
use fem::mesh::CellKind;

/// A point of a quadrature rule: weight, shape functions, their derivatives over the parameters.
pub struct Point {
    /// Weight on the parametric cell.
    pub weight: Wide,
    /// N_a.
    pub n: Vec<Wide>,
    /// ∂N_a/∂ξ; the third is zero on faces.
    pub dn: Vec<[Wide; 3]>,
}

fn w(v: f64) -> Wide {
    Wide::new(v)
}

/// The rule that the documentation names for a kind of cell.
pub fn rule(kind: CellKind) -> Vec<Point> {
    let gauss = Wide::ONE / w(3.0).sqrt();
    let pair = [-gauss, gauss];
    let (sixth, two_thirds) = (Wide::ratio(1.0, 6.0), Wide::ratio(2.0, 3.0));
    let point = |weight: Wide, xi: [Wide; 3]| {
        let (n, dn) = shape(kind, xi);
        Point { weight, n, dn }
    };
    match kind {
        CellKind::Hex8 => {
            let at = |i: usize| [pair[i % 2], pair[i / 2 % 2], pair[i / 4]];
            (0..8).map(|i| point(Wide::ONE, at(i))).collect()
        }
        CellKind::Quad4 => {
            let at = |i: usize| [pair[i % 2], pair[i / 2], Wide::ZERO];
            (0..4).map(|i| point(Wide::ONE, at(i))).collect()
        }
        CellKind::Tet4 => vec![point(sixth, [w(0.25); 3])],
        CellKind::Tri3 => vec![point(w(0.5), [Wide::ratio(1.0, 3.0), Wide::ratio(1.0, 3.0), Wide::ZERO])],
        CellKind::Tet10 => {
            let root = w(5.0).sqrt();
            let a = (w(5.0) - root) / w(20.0);
            let b = (w(5.0) + w(3.0) * root) / w(20.0);
            let at = [[a, a, a], [b, a, a], [a, b, a], [a, a, b]];
            at.map(|xi| point(Wide::ratio(1.0, 24.0), xi)).into()
        }
        CellKind::Wedge6 => {
            let triangle = [[sixth, sixth], [two_thirds, sixth], [sixth, two_thirds]];
            let points = pair.iter().flat_map(|&z| triangle.map(|[x, y]| point(sixth, [x, y, z])));
            points.collect()
        }
        CellKind::Line2 => Vec::new(),
    }
}

/// Corner a of a box: −1 or 1 along each parameter, in the order of VTK.
fn corner(a: usize) -> [f64; 3] {
    let around = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]][a % 4];
    [around[0], around[1], if a < 4 { -1.0 } else { 1.0 }]
}

/// Shape functions and their derivatives at ξ.
pub fn shape(kind: CellKind, xi: [Wide; 3]) -> (Vec<Wide>, Vec<[Wide; 3]>) {
    let zero = Wide::ZERO;
    // Barycentric coordinates of a tetrahedron, of a triangle where ζ does not count, and their slopes.
    let last = if kind == CellKind::Wedge6 || kind == CellKind::Tri3 { zero } else { xi[2] };
    let l = [Wide::ONE - xi[0] - xi[1] - last, xi[0], xi[1], last];
    let slope = |a: usize, d: usize| match a {
        0 if d == 2 && (kind == CellKind::Wedge6 || kind == CellKind::Tri3) => zero,
        0 => -Wide::ONE,
        _ if a == d + 1 => Wide::ONE,
        _ => zero,
    };
    match kind {
        CellKind::Hex8 | CellKind::Quad4 => {
            let dims = if kind == CellKind::Hex8 { 3 } else { 2 };
            let factor = |a: usize, d: usize| (Wide::ONE + w(corner(a)[d]) * xi[d]) * w(0.5);
            let product = |a: usize, but: usize| {
                (0..dims).filter(|d| *d != but).fold(Wide::ONE, |p, d| p * factor(a, d))
            };
            let count = 1 << dims;
            let dn = |a: usize| {
                std::array::from_fn(|d| if d < dims { product(a, d) * w(0.5 * corner(a)[d]) } else { zero })
            };
            ((0..count).map(|a| product(a, 9)).collect(), (0..count).map(dn).collect())
        }
        CellKind::Tet4 => (l.into(), (0..4).map(|a| std::array::from_fn(|d| slope(a, d))).collect()),
        CellKind::Tri3 => (l[..3].into(), (0..3).map(|a| std::array::from_fn(|d| slope(a, d))).collect()),
        CellKind::Tet10 => {
            let (mut n, mut dn) = (Vec::new(), Vec::new());
            for a in 0..4 {
                n.push(l[a] * (l[a] + l[a] - Wide::ONE));
                dn.push(std::array::from_fn(|d| (w(4.0) * l[a] - Wide::ONE) * slope(a, d)));
            }
            for (a, b) in [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)] {
                n.push(w(4.0) * l[a] * l[b]);
                dn.push(std::array::from_fn(|d| w(4.0) * (slope(a, d) * l[b] + l[a] * slope(b, d))));
            }
            (n, dn)
        }
        CellKind::Wedge6 => {
            let (mut n, mut dn) = (Vec::new(), Vec::new());
            for a in 0..6 {
                let z = if a < 3 { -1.0 } else { 1.0 };
                let high = (Wide::ONE + w(z) * xi[2]) * w(0.5);
                n.push(l[a % 3] * high);
                dn.push([slope(a % 3, 0) * high, slope(a % 3, 1) * high, l[a % 3] * w(0.5 * z)]);
            }
            (n, dn)
        }
        CellKind::Line2 => unreachable!("lines have no shape functions here"),
    }
}

/// ∂X/∂ξ (columns are tangents) of a cell with nodes at `x`, relative to its first node.
pub fn jacobian(x: &[[Wide; 3]], dn: &[[Wide; 3]]) -> [[Wide; 3]; 3] {
    std::array::from_fn(|i| {
        std::array::from_fn(|d| x.iter().zip(dn).map(|(p, dn)| (p[i] - x[0][i]) * dn[d]).sum())
    })
}

/// det of a 3×3 matrix.
pub fn determinant(m: &[[Wide; 3]; 3]) -> Wide {
    dot(m[0], cross(m[1], m[2]))
}

/// Inverse of a 3×3 matrix.
pub fn inverse(m: &[[Wide; 3]; 3]) -> [[Wide; 3]; 3] {
    let det = determinant(m);
    let columns = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i] / det))
}

/// a × b.
pub fn cross(a: [Wide; 3], b: [Wide; 3]) -> [Wide; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

/// a · b.
pub fn dot(a: [Wide; 3], b: [Wide; 3]) -> Wide {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// |a|.
pub fn norm(a: [Wide; 3]) -> Wide {
    dot(a, a).sqrt()
}
