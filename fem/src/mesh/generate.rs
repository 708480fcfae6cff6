//! Structured meshes for tests, benchmarks and examples.
//!
//! Every mesh has node sets and surfaces of the same names: `x_min`, `x_max`, … for boxes, others where stated.
//! Lengths in m.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_4, SQRT_2, TAU};

use super::topology::face_key;
use super::{CellBlock, CellKind, Mesh, unique_nodes};

/// Corners of a hexahedron in the unit cube, in the order of VTK.
const CORNERS: [[usize; 3]; 8] =
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];

/// A box of `n` hexahedra with corners at the origin and at `size` \[m\]; block `block`, sets `x_min` … `z_max`.
///
/// Node (i, j, k) has the index i + (n₀ + 1) (j + (n₁ + 1) k).
pub fn block(n: [usize; 3], size: [f64; 3]) -> Mesh {
    mapped(n, |s| [0, 1, 2].map(|d| s[d] * size[d]))
}

/// A box of `n` hexahedra whose unit cube is carried by `map` to coordinates in m; sets as in [`block`].
pub fn mapped(n: [usize; 3], map: impl Fn([f64; 3]) -> [f64; 3]) -> Mesh {
    let mut mesh = grid(n);
    for d in 0..3 {
        name_boundary(&mut mesh, &format!("{}_min", ["x", "y", "z"][d]), |s| s[d] == 0.0);
        name_boundary(&mut mesh, &format!("{}_max", ["x", "y", "z"][d]), |s| s[d] == 1.0);
    }
    mesh.points.iter_mut().for_each(|p| *p = map(*p));
    mesh
}

/// Cook's membrane, n × n × 1 hexahedra: corners (0, 0), (48, 44), (48, 60), (0, 44) mm, thickness 1 mm.
/// `x_min` is the clamped edge, `x_max` the loaded one.
pub fn cook(n: usize) -> Mesh {
    mapped([n, n, 1], |[s, t, w]| {
        let (low, high) = (44.0 * s, 44.0 + 16.0 * s);
        [48e-3 * s, 1e-3 * (low + (high - low) * t), 1e-3 * w]
    })
}

/// One octant of a spherical shell about the origin: three patches of `n_patch` × `n_patch` cells, `n_wall` through the wall.
/// Sets `inner`, `outer` and the planes of symmetry `x_min`, `y_min`, `z_min`. Radii in m.
pub fn sphere_octant(inner: f64, outer: f64, n_patch: usize, n_wall: usize) -> Mesh {
    let patch = |turn: usize| {
        move |[s, t, w]: [f64; 3]| {
            // From the corner of one axis over the middles of two edges to the middle of the triangle.
            let (a, b, c) = ([1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5]);
            let m = [1.0 / 3.0; 3];
            let mut p = [0, 1, 2].map(|d| {
                (1.0 - s) * (1.0 - t) * a[d] + s * (1.0 - t) * b[d] + (1.0 - s) * t * c[d] + s * t * m[d]
            });
            let scale = (inner + w * (outer - inner)) / p.iter().map(|x| x * x).sum::<f64>().sqrt();
            p.rotate_right(turn);
            p.map(|x| x * scale)
        }
    };
    let n = [n_patch, n_patch, n_wall];
    let mut mesh = merged((0..3).map(|turn| moved(grid(n), patch(turn))), outer);
    let radius = |p: [f64; 3]| p.iter().map(|x| x * x).sum::<f64>().sqrt();
    name_boundary(&mut mesh, "inner", |p| radius(p) < inner * (1.0 + 1e-9));
    name_boundary(&mut mesh, "outer", |p| radius(p) > outer * (1.0 - 1e-9));
    for (d, name) in ["x_min", "y_min", "z_min"].into_iter().enumerate() {
        name_boundary(&mut mesh, name, |p| p[d].abs() < 1e-12 * outer);
    }
    mesh
}

/// A cylinder about z from z = 0 to `length`: a core of `n_core` × `n_core` cells inside `n_ring` rings (an O-grid), `n_long` cells
/// along. Sets `z_min`, `z_max`, `side`. The outline has 4 `n_core` equal edges. Lengths in m.
pub fn cylinder(radius: f64, length: f64, n_core: usize, n_ring: usize, n_long: usize) -> Mesh {
    const BULGE: f64 = 0.5; // of the core's sides: 0 a square, 1 a circle
    // Half width of the core such that core and ring cells are equally thick on the axes.
    let width = n_core as f64 / (n_core + 2 * n_ring) as f64 / (1.0 - BULGE + BULGE * SQRT_2);
    // Point of the square of half side r in the direction (1, v), |v| ≤ 1, bulged more and more towards the rim.
    let core_point = move |r: f64, v: f64| {
        let (bulge, angle) = (BULGE * r, FRAC_PI_4 * v);
        let scale = radius * width * r;
        [
            scale * (1.0 - bulge + bulge * SQRT_2 * angle.cos()),
            scale * ((1.0 - bulge) * v + bulge * SQRT_2 * angle.sin()),
        ]
    };
    let core = move |[s, t, w]: [f64; 3]| {
        let (u, v) = (2.0 * s - 1.0, 2.0 * t - 1.0);
        let r = u.abs().max(v.abs());
        let [x, y] = if r == 0.0 {
            [0.0, 0.0]
        } else if u.abs() >= v.abs() {
            let [along, across] = core_point(r, v / r);
            [u.signum() * along, across]
        } else {
            let [along, across] = core_point(r, u / r);
            [across, v.signum() * along]
        };
        [x, y, length * w]
    };
    let side = move |turn: usize| {
        move |[s, t, w]: [f64; 3]| {
            let v = 2.0 * t - 1.0;
            let inside = core_point(1.0, v);
            let rim = [radius * (FRAC_PI_4 * v).cos(), radius * (FRAC_PI_4 * v).sin()];
            let [x, y] = [0, 1].map(|d| inside[d] + s * (rim[d] - inside[d]));
            let [x, y] = [[x, y], [-y, x], [-x, -y], [y, -x]][turn];
            [x, y, length * w]
        }
    };
    let sides = (0..4).map(|turn| moved(grid([n_ring, n_core, n_long]), side(turn)));
    let mut mesh = merged(std::iter::once(moved(grid([n_core, n_core, n_long]), core)).chain(sides), radius);
    name_boundary(&mut mesh, "z_min", |p| p[2] == 0.0);
    name_boundary(&mut mesh, "z_max", |p| p[2] == length);
    name_boundary(&mut mesh, "side", |p| p[0].hypot(p[1]) > radius * (1.0 - 1e-9));
    mesh
}

/// A tube about z from z = 0 to `length`, `n_around` cells around, `n_wall` through the wall, `n_long` along. Sets and surfaces `inner`,
/// `outer`, `z_min`, `z_max`. Lengths in m.
pub fn tube(inner: f64, outer: f64, length: f64, n_around: usize, n_wall: usize, n_long: usize) -> Mesh {
    let wall = moved(grid([n_wall, n_around, n_long]), |[s, t, w]| {
        let (r, angle) = (inner + s * (outer - inner), TAU * t);
        [r * angle.cos(), r * angle.sin(), length * w]
    });
    let mut mesh = merged(std::iter::once(wall), outer);
    name_boundary(&mut mesh, "inner", |p| p[0].hypot(p[1]) < inner * (1.0 + 1e-9));
    name_boundary(&mut mesh, "outer", |p| p[0].hypot(p[1]) > outer * (1.0 - 1e-9));
    name_boundary(&mut mesh, "z_min", |p| p[2] == 0.0);
    name_boundary(&mut mesh, "z_max", |p| p[2] == length);
    mesh
}

/// `count` separate bars of `n` hexahedra along x, side by side in y with `gap` between them, each with a truss along every line of
/// nodes in x. Blocks `muscle_00` and `muscle_00_fibres` …, sets `muscle_00_x_min` …. Lengths in m.
pub fn bars(count: usize, n: [usize; 3], size: [f64; 3], gap: f64) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..count {
        let mut bar = block(n, size);
        let lines: Vec<[usize; 2]> = (0..=n[2]).flat_map(|k| (0..=n[1]).map(move |j| [j, k])).collect();
        add_fibres(&mut bar, "fibres", n, &lines);
        bar.points.iter_mut().for_each(|p| p[1] += i as f64 * (size[1] + gap));
        bar.blocks[0].name.clear();
        append(&mut mesh, bar, &format!("muscle_{i:02}"));
    }
    mesh
}

/// Adds a block `name` of trusses along x to a mesh of [`block`] or [`mapped`] with the same `n`: one chain for each line of nodes
/// (j, k) in `lines`.
pub fn add_fibres(mesh: &mut Mesh, name: &str, n: [usize; 3], lines: &[[usize; 2]]) {
    let node = |i: usize, [j, k]: [usize; 2]| (i + (n[0] + 1) * (j + (n[1] + 1) * k)) as u32;
    let nodes =
        lines.iter().flat_map(|&line| (0..n[0]).flat_map(move |i| [node(i, line), node(i + 1, line)]));
    mesh.blocks.push(CellBlock { name: name.into(), kind: CellKind::Line2, nodes: nodes.collect() });
}

/// Moves every node that is not on the boundary of its block by up to `fraction` of the shortest edge at it, per direction.
/// The same `seed` gives the same mesh.
pub fn distort(mesh: &mut Mesh, fraction: f64, seed: u64) {
    let mut reach = vec![f64::INFINITY; mesh.points.len()];
    for block in &mesh.blocks {
        for cell in block.cells() {
            for (&a, &b) in cell.iter().flat_map(|a| cell.iter().map(move |b| (a, b))).filter(|(a, b)| a != b)
            {
                let (p, q) = (mesh.points[a as usize], mesh.points[b as usize]);
                let length = [0, 1, 2].map(|d| (p[d] - q[d]).powi(2)).iter().sum::<f64>().sqrt();
                reach[a as usize] = reach[a as usize].min(length);
            }
        }
        for node in block.boundary().unwrap_or_default().into_iter().flatten() {
            reach[node as usize] = 0.0;
        }
    }
    let mut state = seed;
    for (point, reach) in mesh.points.iter_mut().zip(reach) {
        for x in point {
            *x += fraction * reach * (2.0 * random(&mut state) - 1.0);
        }
    }
}

/// Next number in [0, 1) of the generator SplitMix64 (Steele, Lea & Flood 2014).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// The mesh of one box ([`block`], [`mapped`]) with every hexahedron cut into six tetrahedra about one diagonal (Kuhn), as tet4 or
/// tet10 with straight edges. Sets and surfaces follow, other blocks stay.
///
/// The cut fits across cells only where all of them are turned alike, as in a box; other meshes get gaps between cells.
pub fn tetrahedra(mesh: &Mesh, quadratic: bool) -> Mesh {
    const CUT: [[usize; 4]; 6] =
        [[0, 1, 2, 6], [0, 5, 1, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 4, 5, 6], [0, 7, 4, 6]];
    let mut out = mesh.clone();
    let mut middle: HashMap<[u32; 2], u32> = HashMap::new();
    for block in out.blocks.iter_mut().filter(|b| b.kind == CellKind::Hex8) {
        let mut nodes = Vec::new();
        for cell in block.cells() {
            for tet in CUT.map(|tet| tet.map(|i| cell[i])) {
                nodes.extend(tet);
                if quadratic {
                    for [a, b] in [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]] {
                        let edge = [tet[a].min(tet[b]), tet[a].max(tet[b])];
                        nodes.push(*middle.entry(edge).or_insert_with(|| {
                            let [p, q] = edge.map(|n| out.points[n as usize]);
                            out.points.push([0, 1, 2].map(|d| (p[d] + q[d]) / 2.0));
                            out.points.len() as u32 - 1
                        }));
                    }
                }
            }
        }
        block.kind = if quadratic { CellKind::Tet10 } else { CellKind::Tet4 };
        block.nodes = nodes;
    }
    recut_surfaces(&mut out);
    let mut middle: Vec<_> = middle.into_iter().collect();
    middle.sort_unstable();
    for (name, set) in &mut out.node_sets {
        // A middle node belongs to the set of a face where both ends of its edge do: the faces of a box are flat.
        let within = |n: &u32| mesh.node_sets[name].binary_search(n).is_ok();
        set.extend(middle.iter().filter(|(edge, _)| edge.iter().all(within)).map(|(_, node)| *node));
        *set = unique_nodes(set.iter().copied());
    }
    out
}

/// Every hexahedron cut into two wedges through the diagonals of its first and last face. Sets and surfaces follow, other
/// blocks stay. The cut fits across cells as in [`tetrahedra`].
pub fn wedges(mesh: &Mesh) -> Mesh {
    const CUT: [[usize; 6]; 2] = [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]];
    let mut out = mesh.clone();
    for block in out.blocks.iter_mut().filter(|b| b.kind == CellKind::Hex8) {
        let nodes =
            block.cells().flat_map(|cell| CUT.map(|wedge| wedge.map(|i| cell[i]))).flatten().collect();
        (block.kind, block.nodes) = (CellKind::Wedge6, nodes);
    }
    recut_surfaces(&mut out);
    out
}

/// Replaces the quadrilaterals of surfaces by the triangles into which the cells behind them were cut.
fn recut_surfaces(mesh: &mut Mesh) {
    let boundary =
        mesh.blocks.iter().filter(|b| b.kind.is_solid()).filter_map(|b| b.boundary().ok()).flatten();
    let boundary: HashMap<[u32; 4], [u32; 4]> = boundary.map(|f| (face_key(f), f)).collect();
    for faces in mesh.surfaces.values_mut() {
        let parts = |&[a, b, c, d]: &[u32; 4]| {
            [[a, b, c, d], [a, b, c, c], [a, c, d, d], [a, b, d, d], [b, c, d, d]].map(face_key)
        };
        *faces = faces.iter().flat_map(parts).filter_map(|key| boundary.get(&key).copied()).collect();
    }
}

/// Adds `other` to `mesh` under a prefix: blocks, sets and surfaces get the names `prefix_name` (`prefix` where the name is empty).
pub fn append(mesh: &mut Mesh, other: Mesh, prefix: &str) {
    let shift = mesh.points.len() as u32;
    let rename = |name: &str| if name.is_empty() { prefix.to_owned() } else { format!("{prefix}_{name}") };
    mesh.points.extend(other.points);
    for block in other.blocks {
        let nodes = block.nodes.iter().map(|n| n + shift).collect();
        mesh.blocks.push(CellBlock { name: rename(&block.name), kind: block.kind, nodes });
    }
    for (name, set) in other.node_sets {
        mesh.node_sets.insert(rename(&name), set.iter().map(|n| n + shift).collect());
    }
    for (name, faces) in other.surfaces {
        mesh.surfaces.insert(rename(&name), faces.iter().map(|f| f.map(|n| n + shift)).collect());
    }
}

/// The unit cube as `n` hexahedra, block `block`.
fn grid(n: [usize; 3]) -> Mesh {
    let mut mesh = Mesh::default();
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            for i in 0..=n[0] {
                mesh.points.push([i as f64 / n[0] as f64, j as f64 / n[1] as f64, k as f64 / n[2] as f64]);
            }
        }
    }
    let mut nodes = Vec::with_capacity(8 * n[0] * n[1] * n[2]);
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                nodes.extend(
                    CORNERS.map(|[a, b, c]| (i + a + (n[0] + 1) * (j + b + (n[1] + 1) * (k + c))) as u32),
                );
            }
        }
    }
    mesh.blocks.push(CellBlock { name: "block".into(), kind: CellKind::Hex8, nodes });
    mesh
}

fn moved(mut mesh: Mesh, map: impl Fn([f64; 3]) -> [f64; 3]) -> Mesh {
    mesh.points.iter_mut().for_each(|p| *p = map(*p));
    mesh
}

/// The patches as one block, nodes closer than about 1e-8 `size` made one.
fn merged(patches: impl Iterator<Item = Mesh>, size: f64) -> Mesh {
    // Not a round number: points of a patch are multiples of round numbers and would fall on the edges of the raster.
    let raster = 1.234_567_891e-8 * size;
    let mut known: HashMap<[i64; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    let mut nodes = Vec::new();
    for patch in patches {
        let index: Vec<u32> = patch
            .points
            .iter()
            .map(|p| {
                *known.entry(p.map(|x| (x / raster).round() as i64)).or_insert_with(|| {
                    mesh.points.push(*p);
                    mesh.points.len() as u32 - 1
                })
            })
            .collect();
        nodes.extend(patch.blocks[0].nodes.iter().map(|&n| index[n as usize]));
    }
    mesh.blocks.push(CellBlock { name: "block".into(), kind: CellKind::Hex8, nodes });
    mesh
}

/// Names the faces of the boundary all of whose nodes satisfy `on` as a surface, and their nodes as a set.
fn name_boundary(mesh: &mut Mesh, name: &str, on: impl Fn([f64; 3]) -> bool) {
    let faces = mesh.blocks[0].boundary().expect("a grid is manifold");
    let inside = |face: &[u32; 4]| face.iter().all(|&n| on(mesh.points[n as usize]));
    let faces: Vec<[u32; 4]> = faces.into_iter().filter(inside).collect();
    mesh.node_sets.insert(name.into(), unique_nodes(faces.iter().flatten().copied()));
    mesh.surfaces.insert(name.into(), faces);
}
