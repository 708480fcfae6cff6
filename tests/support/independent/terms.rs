//! The effects of a scene as lists of groups of nodes, each with its own forces ∂Π/∂x.

use super::cells::{Point, cross, determinant, dot, inverse, jacobian, norm, rule, shape};
use super::laws::{self, Matrix, density, membrane_density, table_stress};
use super::number::{Dual, Wide};
use fem::mesh::{CellKind, Mesh};
use fem::scene::{
    Course, FibreDirection, FibreLawSpec, FibreSpec, FormulationSpec, LawSpec, MembraneSpec, Scene,
    SolidSpec, StrandSpec,
};

/// Three components.
pub type Vector = [Wide; 3];

/// One effect: groups of nodes.
pub struct Term<'a> {
    /// Nodes of each group.
    pub groups: Vec<Vec<u32>>,
    /// What it is.
    pub kind: Kind<'a>,
}

/// An end of a segment: nodes and weights.
type End = Vec<(u32, Wide)>;

/// What a term is, with what its forces need.
pub enum Kind<'a> {
    /// Solid cells.
    Solid { spec: &'a SolidSpec, cell: CellKind, along: Vec<Vector> },
    /// Fibres whose segments stretch on their own.
    Segments { spec: &'a FibreSpec, ends: Vec<[End; 2]>, lengths: Vec<Wide>, areas: Vec<f64> },
    /// Fibres of one tension: fibre of each segment, segments and area of each fibre.
    Whole { spec: &'a FibreSpec, of: Vec<usize>, fibres: Vec<(Vec<usize>, f64)> },
    /// Membranes.
    Membrane { spec: &'a MembraneSpec, cell: CellKind },
    /// Strands.
    Strands { spec: &'a StrandSpec },
    /// Pressure on faces.
    Pressure { control: &'a str },
    /// Dead forces at unit value of a control.
    Dead { control: &'a str, forces: Vec<Vector> },
}

/// Where nodes are and what drives them.
pub struct At<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Displacements \[m\] of all nodes.
    pub u: &'a [Vector],
    /// Value of a control.
    pub control: &'a dyn Fn(&str) -> f64,
}

impl At<'_> {
    fn reference(&self, n: u32) -> Vector {
        self.mesh.points[n as usize].map(Wide::new)
    }

    fn place(&self, n: u32) -> Vector {
        let (p, u) = (self.reference(n), self.u[n as usize]);
        std::array::from_fn(|i| p[i] + u[i])
    }
}

/// All terms of a scene, in the order solids, fibres, membranes, strands, pressures, gravity, forces.
pub fn terms<'a>(scene: &'a Scene, mesh: &Mesh) -> Vec<Term<'a>> {
    let block = |name: &str| mesh.blocks.iter().find(|b| b.name == name).expect("a block of the scene");
    let cells = |name: &str| -> (CellKind, Vec<Vec<u32>>) {
        let block = block(name);
        (block.kind, block.nodes.chunks_exact(block.kind.n_nodes()).map(<[u32]>::to_vec).collect())
    };
    let mut terms = Vec::new();
    for spec in &scene.solids {
        let (cell, groups) = cells(&spec.region);
        let along = directions(spec, mesh, &groups);
        terms.push(Term { groups, kind: Kind::Solid { spec, cell, along } });
    }
    for spec in &scene.fibres {
        terms.push(fibres(spec, scene, mesh, &cells));
    }
    for spec in &scene.membranes {
        let (cell, groups) = cells(&spec.region);
        terms.push(Term { groups, kind: Kind::Membrane { spec, cell } });
    }
    for spec in &scene.strands {
        terms.push(Term { groups: cells(&spec.region).1, kind: Kind::Strands { spec } });
    }
    for spec in &scene.pressures {
        let groups = mesh.surfaces[&spec.surface].iter().map(|f| f.to_vec()).collect();
        terms.push(Term { groups, kind: Kind::Pressure { control: &spec.control } });
    }
    if let Some(gravity) = &scene.gravity {
        let fractions = cell_fractions(scene, mesh, |_, n| n);
        let mut weight = vec![Wide::ZERO; mesh.points.len()];
        fractions.into_iter().for_each(|(n, m)| weight[n as usize] = weight[n as usize] + m);
        let loaded: Vec<u32> =
            (0..mesh.points.len() as u32).filter(|&n| weight[n as usize] != Wide::ZERO).collect();
        let force = |&n: &u32| gravity.acceleration.map(|a| Wide::new(a) * weight[n as usize]);
        let forces = loaded.iter().map(force).collect();
        let groups = loaded.iter().map(|&n| vec![n]).collect();
        terms.push(Term { groups, kind: Kind::Dead { control: &gravity.control, forces } });
    }
    for spec in &scene.forces {
        let groups = spec.loads.iter().map(|(n, _)| vec![*n]).collect();
        let forces = spec.loads.iter().map(|(_, f)| f.map(Wide::new)).collect();
        terms.push(Term { groups, kind: Kind::Dead { control: &spec.control, forces } });
    }
    terms
}

/// Lumped masses \[kg\] of the nodes: row sums, in quadratic tetrahedra in proportion to ∫N² (Hinton, Rock & Zienkiewicz 1976).
pub fn masses(scene: &Scene, mesh: &Mesh) -> Vec<Wide> {
    let fractions = cell_fractions(scene, mesh, |kind, fraction| {
        if kind != CellKind::Tet10 {
            return fraction;
        }
        let total: Wide = fraction.iter().copied().sum();
        let square = |a: usize| -> Wide { rule(kind).iter().map(|p| p.weight * p.n[a] * p.n[a]).sum() };
        let squares: Vec<Wide> = (0..10).map(square).collect();
        let all: Wide = squares.iter().copied().sum();
        squares.into_iter().map(|s| total * s / all).collect()
    });
    let mut masses = vec![Wide::ZERO; mesh.points.len()];
    fractions.into_iter().for_each(|(n, m)| masses[n as usize] = masses[n as usize] + m);
    masses
}

/// ∫ρ N_a dV of every node of every solid cell, a cell's fractions changed by `change`.
fn cell_fractions(
    scene: &Scene,
    mesh: &Mesh,
    change: impl Fn(CellKind, Vec<Wide>) -> Vec<Wide>,
) -> Vec<(u32, Wide)> {
    let mut fractions = Vec::new();
    for spec in &scene.solids {
        let block = mesh.blocks.iter().find(|b| b.name == spec.region).expect("a block of the scene");
        let points = rule(block.kind);
        for cell in block.nodes.chunks_exact(block.kind.n_nodes()) {
            let x: Vec<Vector> = cell.iter().map(|&n| mesh.points[n as usize].map(Wide::new)).collect();
            let volume = |p: &Point| p.weight * determinant(&jacobian(&x, &p.dn)) * Wide::new(spec.density);
            let volumes: Vec<Wide> = points.iter().map(volume).collect();
            let fraction = |a: usize| points.iter().zip(&volumes).map(|(p, v)| p.n[a] * *v).sum();
            let fraction = change(block.kind, (0..cell.len()).map(fraction).collect());
            fractions.extend(cell.iter().copied().zip(fraction));
        }
    }
    fractions
}

fn directions(spec: &SolidSpec, mesh: &Mesh, cells: &[Vec<u32>]) -> Vec<Vector> {
    let unit = |v: Vector| v.map(|c| c / norm(v));
    let LawSpec::Blemker { fibres, .. } = &spec.law else {
        return vec![[Wide::ONE, Wide::ZERO, Wide::ZERO]; cells.len()];
    };
    match fibres {
        FibreDirection::Uniform(d) => vec![unit(d.map(Wide::new)); cells.len()],
        FibreDirection::PerCell(list) => list.iter().map(|d| unit(d.map(Wide::new))).collect(),
        FibreDirection::CellAxis(axis) => {
            let (_, dn) = shape(CellKind::Hex8, [Wide::ZERO; 3]);
            let tangent = |cell: &Vec<u32>| {
                let x: Vec<Vector> = cell.iter().map(|&n| mesh.points[n as usize].map(Wide::new)).collect();
                let j = jacobian(&x, &dn);
                unit([j[0][*axis], j[1][*axis], j[2][*axis]])
            };
            cells.iter().map(tangent).collect()
        }
    }
}

/// Kind and nodes of the cells of a block.
type Cells<'a> = dyn Fn(&str) -> (CellKind, Vec<Vec<u32>>) + 'a;

fn fibres<'a>(spec: &'a FibreSpec, scene: &Scene, mesh: &Mesh, cells: &Cells) -> Term<'a> {
    let area = |i: usize| if spec.area.len() == 1 { spec.area[0] } else { spec.area[i] };
    let point = |n: u32| mesh.points[n as usize].map(Wide::new);
    let distance = |a: Vector, b: Vector| norm(std::array::from_fn(|i| b[i] - a[i]));
    match &spec.course {
        Course::Region(region) => {
            let groups = cells(region).1;
            if let FibreLawSpec::ForceLength { .. } = &spec.law {
                let (mut of, mut fibres) = (Vec::new(), Vec::<(Vec<usize>, f64)>::new());
                for (i, pair) in groups.iter().enumerate() {
                    if i == 0 || groups[i - 1][1] != pair[0] {
                        fibres.push((Vec::new(), area(i)));
                    }
                    of.push(fibres.len() - 1);
                    fibres.last_mut().expect("pushed").0.push(i);
                }
                return Term { groups, kind: Kind::Whole { spec, of, fibres } };
            }
            let lengths = groups.iter().map(|p| distance(point(p[0]), point(p[1]))).collect();
            let ends = groups.iter().map(|p| [p[0], p[1]].map(|n| vec![(n, Wide::ONE)])).collect();
            let areas = (0..groups.len()).map(area).collect();
            Term { groups, kind: Kind::Segments { spec, ends, lengths, areas } }
        }
        Course::Embedded(lines) => {
            let (mut ends, mut lengths, mut areas) = (Vec::new(), Vec::new(), Vec::new());
            for (i, line) in lines.iter().enumerate() {
                for pair in line.windows(2) {
                    let [a, b] = [pair[0], pair[1]].map(|p| p.map(Wide::new));
                    ends.push([a, b].map(|p| locate(scene, mesh, p).expect("a point inside a cell")));
                    lengths.push(distance(a, b));
                    areas.push(area(i));
                }
            }
            let nodes = |e: &[End; 2]| {
                let mut nodes: Vec<u32> = e.iter().flatten().map(|w| w.0).collect();
                nodes.sort_unstable();
                nodes.dedup();
                nodes
            };
            let groups = ends.iter().map(nodes).collect();
            Term { groups, kind: Kind::Segments { spec, ends, lengths, areas } }
        }
    }
}

/// Nodes and weights of the first hexahedron or tetrahedron that holds a point.
fn locate(scene: &Scene, mesh: &Mesh, p: Vector) -> Option<End> {
    for spec in &scene.solids {
        let block = mesh.blocks.iter().find(|b| b.name == spec.region)?;
        if !matches!(block.kind, CellKind::Hex8 | CellKind::Tet4) {
            continue;
        }
        for cell in block.nodes.chunks_exact(block.kind.n_nodes()) {
            let x: Vec<Vector> = cell.iter().map(|&n| mesh.points[n as usize].map(Wide::new)).collect();
            let mut xi = [Wide::ZERO; 3];
            for _ in 0..30 {
                let (n, dn) = shape(block.kind, xi);
                let away: Vector = std::array::from_fn(|i| {
                    p[i] - x[0][i] - x.iter().zip(&n).map(|(q, n)| (q[i] - x[0][i]) * *n).sum()
                });
                let back = inverse(&jacobian(&x, &dn));
                xi = std::array::from_fn(|d| xi[d] + dot(back[d], away));
            }
            let n = shape(block.kind, xi).0;
            if n.iter().all(|n| n.value() >= -1e-6) {
                let some = |w: &(u32, Wide)| w.1.abs().value() > 1e-12;
                return Some(cell.iter().copied().zip(n).filter(some).collect());
            }
        }
    }
    None
}

impl Term<'_> {
    /// Whether a group connects its nodes.
    pub fn couples(&self) -> bool {
        !matches!(self.kind, Kind::Dead { .. })
    }

    /// ∂Π/∂x \[N\] of the nodes of a group; `None` where the state is not admissible.
    pub fn forces(&self, group: usize, at: &At) -> Option<Vec<Vector>> {
        let nodes = &self.groups[group];
        match &self.kind {
            Kind::Solid { spec, cell, along } => {
                let active = match &spec.law {
                    LawSpec::Blemker { activation: Some(control), .. } => (at.control)(control),
                    _ => 0.0,
                };
                let scale = spec.scale.get(group).copied().unwrap_or(1.0);
                let forces = solid(spec, *cell, along[group], active, nodes, at)?;
                Some(forces.into_iter().map(|f| f.map(|c| c * Wide::new(scale))).collect())
            }
            Kind::Segments { spec, ends, lengths, areas } => {
                let a = spec.activation.as_ref().map_or(0.0, |c| (at.control)(c));
                let place = |end: &End| -> Vector {
                    let o = at.place(nodes[0]);
                    let away = |n: u32, i: usize| at.place(n)[i] - o[i];
                    std::array::from_fn(|i| end.iter().map(|&(n, w)| away(n, i) * w).sum())
                };
                let [p, q] = [place(&ends[group][0]), place(&ends[group][1])];
                let d: Vector = std::array::from_fn(|i| q[i] - p[i]);
                let l = norm(d);
                let tension = laws::fibre_force(&spec.law, areas[group], l / lengths[group], a);
                let mut forces = vec![[Wide::ZERO; 3]; nodes.len()];
                for (end, sign) in ends[group].iter().zip([-1.0, 1.0]) {
                    for &(n, w) in end {
                        let k = nodes.iter().position(|&m| m == n).expect("a node of the group");
                        let pull = tension / l * w * Wide::new(sign);
                        forces[k] = std::array::from_fn(|i| forces[k][i] + pull * d[i]);
                    }
                }
                Some(forces)
            }
            Kind::Whole { spec, of, fibres } => {
                let FibreLawSpec::ForceLength { stretch, activation, stress } = &spec.law else {
                    return None;
                };
                let (segments, area) = &fibres[of[group]];
                // A segment counts as √(d² + ε² L²), ε = 0.02.
                let rounded = |e: usize| {
                    let [a, b] = [self.groups[e][0], self.groups[e][1]];
                    let (p, q) = (at.reference(a), at.reference(b));
                    let rest = norm(std::array::from_fn(|i| q[i] - p[i]));
                    let (p, q) = (at.place(a), at.place(b));
                    let d: Vector = std::array::from_fn(|i| q[i] - p[i]);
                    let round = Wide::new(0.02) * rest;
                    let at_rest = (rest * rest + round * round).sqrt();
                    (d, (dot(d, d) + round * round).sqrt(), rest, at_rest)
                };
                let rest: Wide = segments.iter().map(|&e| rounded(e).2).sum();
                let longer: Wide = segments.iter().map(|&e| rounded(e).1 - rounded(e).3).sum();
                let a = spec.activation.as_ref().map_or(0.0, |c| (at.control)(c));
                let sigma = table_stress(stretch, activation, stress, Wide::ONE + longer / rest, a);
                let (d, l, ..) = rounded(group);
                let pull = d.map(|d| d / l * sigma * Wide::new(*area));
                Some(vec![pull.map(|f| -f), pull])
            }
            Kind::Membrane { spec, cell } => membrane(spec, *cell, nodes, at),
            Kind::Strands { spec } => {
                let [a, b] = [nodes[0], nodes[1]];
                let (p, q) = (at.reference(a), at.reference(b));
                let rest = norm(std::array::from_fn(|i| q[i] - p[i]));
                let slack = rest / (Wide::ONE + Wide::new(spec.reference_strain));
                let (p, q) = (at.place(a), at.place(b));
                let d: Vector = std::array::from_fn(|i| q[i] - p[i]);
                let l = norm(d);
                let tension = laws::strand_force(spec.stiffness, spec.toe, l / slack - Wide::ONE);
                let pull = d.map(|d| d / l * tension);
                Some(vec![pull.map(|f| -f), pull])
            }
            Kind::Pressure { control } => {
                // The traction −p n on the deformed face, as a force: ∂Π/∂x = ∫ p N n da.
                let p = Wide::new((at.control)(control));
                let x: Vec<Vector> = nodes.iter().map(|&n| at.place(n)).collect();
                let mut forces = vec![[Wide::ZERO; 3]; 4];
                for point in rule(CellKind::Quad4) {
                    let j = jacobian(&x, &point.dn);
                    let normal = cross([j[0][0], j[1][0], j[2][0]], [j[0][1], j[1][1], j[2][1]]);
                    for (force, n) in forces.iter_mut().zip(&point.n) {
                        *force = std::array::from_fn(|i| force[i] + p * point.weight * *n * normal[i]);
                    }
                }
                Some(forces)
            }
            Kind::Dead { control, forces } => {
                let c = Wide::new((at.control)(control));
                Some(vec![forces[group].map(|f| -(c * f))])
            }
        }
    }

    /// Least det F over the quadrature points of a solid cell.
    pub fn least_det(&self, group: usize, at: &At) -> Option<f64> {
        let Kind::Solid { cell, .. } = &self.kind else { return None };
        let all = gradients(*cell, &self.groups[group], at);
        let det = |(_, f, _): &(Wide, [Vector; 3], Vec<Vector>)| determinant(f).value();
        all.iter().map(det).reduce(|a, b| if b < a || b.is_nan() { b } else { a })
    }
}

/// Volume, F and ∂N/∂X at each quadrature point of a cell.
fn gradients(cell: CellKind, nodes: &[u32], at: &At) -> Vec<(Wide, [Vector; 3], Vec<Vector>)> {
    let x: Vec<Vector> = nodes.iter().map(|&n| at.reference(n)).collect();
    let point = |p: Point| {
        let j = jacobian(&x, &p.dn);
        let back = inverse(&j);
        let slope =
            |dn: &Vector| -> Vector { std::array::from_fn(|k| (0..3).map(|d| dn[d] * back[d][k]).sum()) };
        let dn: Vec<Vector> = p.dn.iter().map(slope).collect();
        let u = |n: &u32| at.u[*n as usize];
        let entry = |i: usize, k: usize| -> Wide {
            let sum: Wide = nodes.iter().zip(&dn).map(|(n, dn)| u(n)[i] * dn[k]).sum();
            if i == k { Wide::ONE + sum } else { sum }
        };
        let f = std::array::from_fn(|i| std::array::from_fn(|k| entry(i, k)));
        (p.weight * determinant(&j), f, dn)
    };
    rule(cell).into_iter().map(point).collect()
}

fn solid(
    spec: &SolidSpec,
    cell: CellKind,
    along: Vector,
    active: f64,
    nodes: &[u32],
    at: &At,
) -> Option<Vec<Vector>> {
    let points = gradients(cell, nodes, at);
    let mean = match spec.formulation {
        Some(formulation) => formulation == FormulationSpec::MeanDilatation,
        None => cell == CellKind::Hex8,
    };
    let volume: Wide = points.iter().map(|p| p.0).sum();
    let theta = points.iter().map(|p| p.0 * determinant(&p.1)).sum::<Wide>() / volume;
    let (mut stress, mut pressure) = (Vec::new(), Wide::ZERO);
    for (w, f, _) in &points {
        let dual = |direction: Option<(usize, usize)>, d_theta: Wide| -> Option<Wide> {
            let m: Matrix = std::array::from_fn(|i| {
                std::array::from_fn(|k| {
                    let d = if direction == Some((i, k)) { Wide::ONE } else { Wide::ZERO };
                    Dual { v: f[i][k], d }
                })
            });
            let theta = if mean { Dual { v: theta, d: d_theta } } else { laws::determinant(&m) };
            Some(density(&spec.law, along, active, &m, theta)?.d)
        };
        let mut p = [[Wide::ZERO; 3]; 3];
        for i in 0..3 {
            for k in 0..3 {
                p[i][k] = *w * dual(Some((i, k)), Wide::ZERO)?;
            }
        }
        stress.push(p);
        if mean {
            pressure = pressure + *w * dual(None, Wide::ONE)? / volume;
        }
    }
    let mut forces = vec![[Wide::ZERO; 3]; nodes.len()];
    for ((w, f, dn), p) in points.iter().zip(&stress) {
        // ∂ det F/∂F: rows are cross products of the other two.
        let cofactor = [cross(f[1], f[2]), cross(f[2], f[0]), cross(f[0], f[1])];
        for (force, dn) in forces.iter_mut().zip(dn) {
            for i in 0..3 {
                let row: Vector = std::array::from_fn(|k| p[i][k] + *w * pressure * cofactor[i][k]);
                force[i] = force[i] + dot(row, *dn);
            }
        }
    }
    Some(forces)
}

fn membrane(spec: &MembraneSpec, cell: CellKind, nodes: &[u32], at: &At) -> Option<Vec<Vector>> {
    let x: Vec<Vector> = nodes.iter().map(|&n| at.reference(n)).collect();
    let now: Vec<Vector> = nodes.iter().map(|&n| at.place(n)).collect();
    let mut forces = vec![[Wide::ZERO; 3]; nodes.len()];
    for p in rule(cell) {
        let column = |j: &[[Wide; 3]; 3], d: usize| [j[0][d], j[1][d], j[2][d]];
        let j = jacobian(&x, &p.dn);
        let (a, b) = (column(&j, 0), column(&j, 1));
        let area = norm(cross(a, b));
        // Metric of the reference and of the present surface: i₁ = tr(G⁻¹ g), i₂ = det g / det G, on any basis.
        let (aa, ab, bb) = (dot(a, a), dot(a, b), dot(b, b));
        let det = aa * bb - ab * ab;
        let j = jacobian(&now, &p.dn);
        let tangents = [column(&j, 0), column(&j, 1)];
        let w = p.weight * area * Wide::new(spec.thickness);
        let mut slope = [[Wide::ZERO; 3]; 2];
        for t in 0..2 {
            for i in 0..3 {
                let dual = |s: usize, k: usize| Dual {
                    v: tangents[s][k],
                    d: if (s, k) == (t, i) { Wide::ONE } else { Wide::ZERO },
                };
                let product = |r: usize, s: usize| {
                    dual(r, 0) * dual(s, 0) + dual(r, 1) * dual(s, 1) + dual(r, 2) * dual(s, 2)
                };
                let (g00, g01, g11) = (product(0, 0), product(0, 1), product(1, 1));
                let times = |d: Dual, w: Wide| Dual { v: d.v * w, d: d.d * w };
                let i1 = times(g00, bb / det) + times(g11, aa / det) - times(g01, (ab + ab) / det);
                let i2 = times(g00 * g11 - g01 * g01, Wide::ONE / det);
                slope[t][i] = w * membrane_density(&spec.law, i1, i2)?.d;
            }
        }
        for (force, dn) in forces.iter_mut().zip(&p.dn) {
            *force = std::array::from_fn(|i| force[i] + slope[0][i] * dn[0] + slope[1][i] * dn[1]);
        }
    }
    Some(forces)
}
