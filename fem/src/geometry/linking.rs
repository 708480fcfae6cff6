//! Who gets past whom: signed crossings of lines, and of points and sheets, that move on straight ways.
//!
//! A point a(s) of one line and a point b(s′) of another meet at a time t where F(s, s′, t) = a(s, t) − b(s′, t) is zero. The signed
//! number of such meetings is the degree of F, by which its values on the boundary of the box of (s, s′, t) wind round the origin: a sum
//! of solid angles over 4π, a whole number for any closed surface. With t alone at both ends of the time that sum is the difference of
//! the Gauss linking integrals; the other sides make it whole where lines have ends (Gauss 1833; Klenin & Langowski, Biopolymers 54
//! (2000), for lines of straight pieces). Of a point and a sheet likewise: the sheet as seen from the point sweeps a closed surface.
//! Solid angles: Van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30 (1983).

use nalgebra::Vector3;

/// Solid angle \[sr\] of a triangle as seen from the origin, positive where it turns to the left.
fn solid_angle([a, b, c]: [Vector3<f64>; 3]) -> f64 {
    let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
    let below = la * lb * lc + a.dot(&b) * lc + a.dot(&c) * lb + b.dot(&c) * la;
    2.0 * a.dot(&b.cross(&c)).atan2(below)
}

/// The same of a quadrilateral, as two triangles.
fn quad([a, b, c, d]: [Vector3<f64>; 4]) -> f64 {
    solid_angle([a, b, c]) + solid_angle([a, c, d])
}

fn whole(sum: f64) -> i64 {
    (sum / (4.0 * std::f64::consts::PI)).round() as i64
}

/// Signed crossings of the lines `a` and `b` through each other, each given by its points before and after; each point goes straight.
pub fn crossings(a: [&[Vector3<f64>]; 2], b: [&[Vector3<f64>]; 2]) -> i64 {
    let at = |i: usize, j: usize, t: usize| a[t][i] - b[t][j];
    let (n, m) = (a[0].len() - 1, b[0].len() - 1);
    let mut sum = 0.0;
    for i in 0..n {
        for j in 0..m {
            let face = |t: usize| quad([at(i, j, t), at(i + 1, j, t), at(i + 1, j + 1, t), at(i, j + 1, t)]);
            sum += face(1) - face(0);
        }
        let side = |j: usize| quad([at(i, j, 0), at(i + 1, j, 0), at(i + 1, j, 1), at(i, j, 1)]);
        sum += side(0) - side(m);
    }
    for j in 0..m {
        let side = |i: usize| quad([at(i, j, 0), at(i, j + 1, 0), at(i, j + 1, 1), at(i, j, 1)]);
        sum += side(n) - side(0);
    }
    whole(sum)
}

/// Signed passages of a point through a sheet of triangles, each given before and after; `rim`: the directed edges of its border.
pub fn passages(
    point: [Vector3<f64>; 2],
    sheet: &[[usize; 3]],
    rim: &[[usize; 2]],
    places: [&[Vector3<f64>]; 2],
) -> i64 {
    let at = |i: usize, t: usize| places[t][i] - point[t];
    let faces = sheet.iter().map(|f| {
        let face = |t: usize| solid_angle(f.map(|i| at(i, t)));
        face(1) - face(0)
    });
    let sides = rim.iter().map(|&[a, b]| quad([at(a, 0), at(b, 0), at(b, 1), at(a, 1)]));
    whole(faces.sum::<f64>() + sides.sum::<f64>())
}
