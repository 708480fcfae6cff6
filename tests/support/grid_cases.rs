//! T7, T8: solids in coarse grids of cubes, from a grid that is the mesh to cubes that hold next to nothing or two bodies.

#![allow(non_snake_case)]

use fem::measure::{Cut, section_force, solid_field};
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::plan::{LoadedIsland, Plan, Warning};
use fem::run::Frame;
use fem::scene::{EmbeddedSpec, ForceSpec, FormulationSpec, LawSpec, Scene};
use fem::solve::{BlockMatrix, Potential};
use mesher::grid::{self, SectionKind, mean_size};
use mesher::{Loft, MuscleSections, to_mesh};
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::fem_scenes::{displaced, held, laws, mooney_rivlin, plan, solid, solve, tolerance};

type Outcome = Result<String, String>;

fn ensure(holds: bool, otherwise: impl Fn() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(otherwise()) }
}

/// A scene of one block, pulled and sheared at its boundary or at an end.
pub fn scene_of(mesh: &Mesh, law: LawSpec, formulation: Option<FormulationSpec>) -> Scene {
    Scene { solids: vec![solid(&mesh.blocks[0].name, law, formulation)], ..Scene::default() }
}

/// The same with a region in a grid.
pub fn embedded(scene: &Scene, region: &str, cell: f64) -> Scene {
    Scene { embedded: vec![EmbeddedSpec::new(region, cell)], ..scene.clone() }
}

/// A large strain.
pub fn linear(X: [f64; 3]) -> [f64; 3] {
    (Matrix3::new(0.15, 0.1, -0.05, 0.0, -0.1, 0.08, 0.06, 0.0, 0.05) * Vector3::from(X)).into()
}

/// Greatest distance \[m\] of the nodes of a mesh between two states.
pub fn apart(mesh: &Mesh, a: &[f64], b: &[f64]) -> f64 {
    let n = 3 * mesh.points.len();
    let pairs = a[..n].chunks_exact(3).zip(b[..n].chunks_exact(3));
    pairs
        .map(|(a, b)| (Vector3::from_column_slice(a) - Vector3::from_column_slice(b)).norm())
        .fold(0.0, f64::max)
}

/// Blocks side by side as one region `block` of bodies that do not touch; the sets of each have its number before their names.
fn bodies(boxes: &[([usize; 3], [f64; 3], [f64; 3])]) -> Mesh {
    let mut all = Mesh::default();
    for (i, &(n, size, place)) in boxes.iter().enumerate() {
        let mut mesh = generate::block(n, size);
        mesh.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += place[c]));
        mesh.surfaces.clear();
        generate::append(&mut all, mesh, &i.to_string());
    }
    let rest = all.blocks.split_off(1);
    all.blocks[0].nodes.extend(rest.into_iter().flat_map(|b| b.nodes));
    all.blocks[0].name = "block".to_string();
    all
}

/// T7: cubes that are the elements of a block held and pulled at its ends.
pub fn grid_is_mesh() -> Outcome {
    let mut worst = [0.0_f64; 3];
    let mesh = generate::block([5, 3, 4], [0.1, 0.06, 0.08]);
    for (name, law) in laws() {
        for formulation in [FormulationSpec::MeanDilatation, FormulationSpec::Plain] {
            let mut scene = scene_of(&mesh, law.clone(), Some(formulation));
            let small = matches!(law, LawSpec::LinearElastic { .. });
            let field = |X: [f64; 3]| linear([X[0], X[2], X[1]]).map(|u| if small { 0.1 * u } else { u });
            scene.prescribed = vec![held("x_min", [true; 3]), displaced(&mesh, "x_max", field)];
            let (of_mesh, of_grid) = (plan(&scene, &mesh), plan(&embedded(&scene, "block", 0.02), &mesh));
            ensure(of_mesh.n_unknowns() == of_grid.n_unknowns(), || format!("{name}: other unknowns"))?;
            let [a, b] = [&of_mesh, &of_grid].map(|plan| solve(plan, &[("load", 1.0)], &tolerance(1e-12)));
            let off = apart(&mesh, &a.x, &b.x);
            let cut = Cut { point: [0.05; 3], normal: [1.0, 0.0, 0.0], effects: vec![] };
            let through = [(&of_mesh, &a), (&of_grid, &b)]
                .map(|(p, f)| section_force(p, f.snapshot(), &cut).total.force[0]);
            let stresses =
                [(&of_mesh, &a), (&of_grid, &b)].map(|(p, f)| solid_field(p, f.snapshot(), "block").unwrap());
            let scale = stresses[0].iter().map(|c| c.cauchy.amax()).fold(0.0, f64::max);
            let [s, t] = stresses;
            let stress =
                s.iter().zip(&t).map(|(s, t)| (s.cauchy - t.cauchy).amax()).fold(0.0, f64::max) / scale;
            let now = [off / 0.1, stress, (through[0] / through[1] - 1.0).abs()];
            ensure(now[0] < 1e-10 && now[1] < 1e-9 && now[2] < 1e-9, || {
                format!("{name}, {formulation:?}: off by {now:.1?}")
            })?;
            worst = std::array::from_fn(|k| worst[k].max(now[k]));
        }
    }
    let [place, stress, force] = worst;
    Ok(format!("places off by {place:.0e} of the length, stresses by {stress:.0e}, forces by {force:.0e}"))
}

/// Force \[N\] with which an end is moved, along its way.
pub fn end_force(plan: &Plan, frame: &Frame, set: &str, along: [f64; 3]) -> f64 {
    let wrench = fem::measure::support_wrench(plan, frame.snapshot(), &plan.mesh.node_sets[set], [0.0; 3]);
    (0..3).map(|c| wrench.force[c] * along[c]).sum()
}

/// K at rest, without what is prescribed.
fn stiffness(plan: &Plan) -> DMatrix<f64> {
    let load = plan.load(&[], &[]).unwrap();
    let loaded = LoadedIsland::new(plan.islands[0].clone(), load.clone(), load);
    let x = loaded.island().free_positions(&loaded.island().gather(&plan.reference()));
    let mut k = BlockMatrix::zeros(loaded.pattern().clone());
    loaded.hessian(&x, 0.0, &mut k);
    let mut dense = DMatrix::zeros(x.len(), x.len());
    for i in 0..x.len() / 3 {
        for (&j, block) in k.pattern().row(i).iter().zip(k.row(i)) {
            (0..9).for_each(|e| dense[(3 * i + e / 3, 3 * j as usize + e % 3)] = block[e]);
        }
    }
    dense
}

/// A box that begins on a face of the grid and reaches by a fraction of a cube into another layer of cubes, both ways across. Two specks that are
/// held make the grid begin at -60 mm and end at 120 mm.
fn reaching(fraction: f64) -> (Mesh, Scene) {
    let size = [0.06, 0.04 + fraction * 0.02, 0.04 + fraction * 0.02];
    let speck = |place: f64| ([1; 3], [0.01; 3], [place; 3]);
    let mut mesh = bodies(&[([12, 10, 10], size, [0.0; 3]), speck(-0.06), speck(0.11)]);
    let far = |n: &u32| mesh.points[*n as usize].iter().any(|x| *x < -1e-3 || *x > 0.1);
    let specks = (0..mesh.points.len() as u32).filter(far).collect();
    mesh.node_sets.insert("specks".to_string(), specks);
    let mut scene = scene_of(&mesh, mooney_rivlin(), None);
    let bent = |X: [f64; 3]| [0.01, 0.01, 0.1 * X[1]];
    let pulled = displaced(&mesh, "0_x_max", bent);
    scene.prescribed = vec![held("specks", [true; 3]), held("0_x_min", [true; 3]), pulled];
    (mesh, scene)
}

/// T7: cubes filled to the last ten thousandth part.
pub fn hardly_filled() -> Outcome {
    let of = |fraction: f64| {
        let (mesh, scene) = reaching(fraction);
        let plan = plan(&embedded(&scene, "block", 0.02), &mesh);
        let eigenvalues = stiffness(&plan).symmetric_eigenvalues();
        let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-9));
        let force = end_force(&plan, &frame, "0_x_max", [1.0, 0.0, 0.0]);
        let region = &plan.embedded[0];
        let condition = eigenvalues.max() / eigenvalues.min();
        (condition, region.n_badly_filled, frame.islands[0].iterations, force)
    };
    let whole = of(0.0);
    let (mut bad, mut worst) = (0, [0.0_f64; 2]);
    for fraction in [0.5, 0.3, 0.2, 0.1, 0.05, 0.01, 1e-3, 1e-5] {
        let (condition, n_bad, iterations, force) = of(fraction);
        bad += n_bad;
        ensure(condition < 1e3 * whole.0, || {
            format!("filled by {fraction}: condition {condition:.1e} after {:.1e}", whole.0)
        })?;
        ensure(iterations <= whole.2 + 3, || {
            format!("filled by {fraction}: {iterations} iterations, {} without", whole.2)
        })?;
        // The section grows, and with it the force; corners that are not there any more make it no softer.
        let area = (1.0 + 0.5 * fraction).powi(2);
        ensure(force > whole.3 && force < 1.15 * area * whole.3, || {
            format!("filled by {fraction}: {force} N of {}", whole.3)
        })?;
        worst = [worst[0].max(condition / whole.0), worst[1].max(force / (area * whole.3))];
    }
    ensure(bad > 0, || "no cube counts as badly filled".to_string())?;
    let [condition, force] = worst;
    Ok(format!(
        "filled by 0.5 to 1e-5: condition at most {condition:.1} times that without, force at most {force:.3} times that by area"
    ))
}

/// T8: two sheets that run through the same cubes are told apart, said, and move by themselves.
pub fn two_sheets() -> Outcome {
    let sheet = |z: f64| ([8, 4, 1], [0.04, 0.02, 2e-3], [0.0, 0.0, z]);
    let mesh = bodies(&[sheet(0.0), sheet(3e-3)]);
    let mut scene = scene_of(&mesh, mooney_rivlin(), None);
    scene.prescribed = vec![held("0_x_min", [true; 3]), held("1_x_min", [true; 3])];
    let pulled = mesh.node_sets["1_x_max"].iter().map(|&n| (n, [0.0, 0.0, 1e-4])).collect();
    scene.forces.push(ForceSpec { name: "pull".to_string(), loads: pulled, control: "load".to_string() });
    let plan = plan(&embedded(&scene, "block", 0.02), &mesh);
    ensure(plan.islands.len() == 2, || format!("{} islands", plan.islands.len()))?;
    let divided = plan.embedded[0].divided.len();
    let said =
        plan.warnings.iter().any(|w| matches!(w, Warning::Divided { cubes, .. } if cubes.len() == divided));
    ensure(divided >= 2 && said, || format!("{divided} cubes hold both, said: {said}"))?;
    let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-6));
    let moved = |set: &str| {
        let up = |&n: &u32| frame.x[3 * n as usize + 2] - mesh.points[n as usize][2];
        mesh.node_sets[set].iter().map(up).fold(0.0, f64::max)
    };
    let [one, other] = ["1_x_max", "0_x_max"].map(moved);
    ensure(one > 1e-3 && other < 1e-15, || {
        format!("the one moves by {one:.1e} m, the other by {other:.1e} m")
    })?;
    Ok(format!("{divided} cubes hold both; the one moves by {:.1} mm, the other by {other:.0e} m", one * 1e3))
}

const SECTIONS: &str = include_str!("../../gait-data/thigh/muscle_sections.csv");

/// Vastus intermedius of the built-in thigh, by itself, its sets `origin` and `insertion`, and the way from the one to the other \[m\].
fn vastus_intermedius(edge: f64) -> (Mesh, Vector3<f64>) {
    let all = MuscleSections::read_csv(SECTIONS, Path::new("muscle_sections.csv")).unwrap();
    let sections = all.iter().find(|m| m.name == "vastus_intermedius").unwrap();
    let n = (mean_size(sections)[2] / edge).round() as usize;
    let layers = (0..=n).map(|i| i as f64 / n as f64).collect();
    let block =
        grid::fill("muscle", &Loft::new(sections), &SectionKind::rings(sections, edge).grid(), layers);
    let (first, last) = (0..block.nodes_per_section as u32, (n * block.nodes_per_section) as u32);
    let way = block.centre_line();
    let mut mesh = to_mesh(std::slice::from_ref(&block));
    mesh.surfaces.clear();
    mesh.node_sets.insert("origin".to_string(), first.clone().collect());
    mesh.node_sets.insert("insertion".to_string(), first.map(|i| last + i).collect());
    (mesh, way[way.len() - 1] - way[0])
}

/// The muscle held at its origin, its insertion pulled by `stretch` and moved aside by `aside` of the length: force along the muscle and aside
/// \[N\], and unknowns.
fn pulled(mesh: &Mesh, way: Vector3<f64>, cell: Option<f64>, load: [f64; 2]) -> ([f64; 2], usize) {
    scaled_and_pulled(mesh, &[], way, cell, load)
}

/// The same with the law of every cell scaled; not, where `scale` is empty.
fn scaled_and_pulled(
    mesh: &Mesh,
    scale: &[f64],
    way: Vector3<f64>,
    cell: Option<f64>,
    [stretch, aside]: [f64; 2],
) -> ([f64; 2], usize) {
    let along = way.normalize();
    let across = along.cross(&Vector3::z()).normalize();
    let mut scene = scene_of(mesh, mooney_rivlin(), None);
    scene.solids[0].scale = scale.to_vec();
    let moved = way * stretch + across * (aside * way.norm());
    scene.prescribed = vec![held("origin", [true; 3]), displaced(mesh, "insertion", |_| moved.into())];
    if let Some(cell) = cell {
        scene = embedded(&scene, &mesh.blocks[0].name, cell);
    }
    let plan = plan(&scene, mesh);
    let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-6));
    let force = |d: Vector3<f64>| end_force(&plan, &frame, "insertion", d.into());
    ([force(along), force(across)], plan.n_unknowns())
}

/// T8: vastus intermedius pulled and bent in ever smaller cubes. The largest of them hold whole sections of the muscle: too few volumes to be a bound.
pub fn comes_down_to_its_mesh() -> Outcome {
    comes_down(5e-3, [40e-3, 20e-3, 10e-3], 1)
}

/// T8: the same from 20 mm to a mesh of 2.5 mm.
pub fn comes_down_to_a_fine_mesh() -> Outcome {
    comes_down(2.5e-3, [20e-3, 10e-3, 5e-3], 0)
}

/// Force of a mesh with edges of `edge` \[m\] in cubes of `cells` \[m\]: from the cubes number `from` on it falls, and stays above that of the mesh.
fn comes_down(edge: f64, cells: [f64; 3], from: usize) -> Outcome {
    let (mesh, way) = vastus_intermedius(edge);
    let mut text = Vec::new();
    for (at, (what, load)) in LOADS.into_iter().enumerate() {
        let (exact, n) = pulled(&mesh, way, None, load);
        let all = cells.map(|cell| {
            let (found, n) = pulled(&mesh, way, Some(cell), load);
            (found[at] / exact[at], n)
        });
        let of = all.map(|(ratio, n)| format!("{ratio:.3} ({n})"));
        text.push(format!("{what} {} times the force of its mesh ({n} unknowns)", of.join(", ")));
        let falls = all[from..].windows(2).all(|pair| pair[0].0 > pair[1].0) && all[2].0 > 1.0;
        ensure(falls, || text.join("; "))?;
    }
    let cells = cells.map(|cell| format!("{:.0}", 1e3 * cell));
    Ok(format!("cubes of {} mm: {}", cells.join(", "), text.join("; ")))
}

/// Vastus intermedius pulled, and bent, by this part of its length.
const LOADS: [(&str, [f64; 2]); 2] = [("pulled", [0.15, 0.0]), ("bent", [0.0, 0.15])];

/// Volume \[m³\] of a region in every cube of a grid from the corner of its box, by points: 6³ in every cell.
fn filled(mesh: &Mesh, cell: f64) -> (Vector3<f64>, BTreeMap<[i32; 3], f64>) {
    const N: usize = 6;
    let place = |n: u32| Vector3::from(mesh.points[n as usize]);
    let block = &mesh.blocks[0];
    let lo = block.nodes.iter().map(|n| place(*n)).reduce(|a, b| a.inf(&b)).unwrap();
    let mut volumes = BTreeMap::new();
    for nodes in block.nodes.chunks(8) {
        for point in 0..N * N * N {
            let [r, s, t] =
                [point / (N * N), point / N % N, point % N].map(|k| (2 * k + 1) as f64 / N as f64 - 1.0);
            let signs = |c: usize| {
                // Corners of a hexahedron: around the bottom, then around the top.
                let x = if matches!(c % 4, 1 | 2) { 1.0 } else { -1.0 };
                let y = if c % 4 >= 2 { 1.0 } else { -1.0 };
                [x, y, if c >= 4 { 1.0 } else { -1.0 }]
            };
            let (mut at, mut J) = (Vector3::zeros(), Matrix3::zeros());
            for (c, n) in nodes.iter().enumerate() {
                let [x, y, z] = signs(c);
                let [p, q, o] = [1.0 + x * r, 1.0 + y * s, 1.0 + z * t];
                at += 0.125 * p * q * o * place(*n);
                J += 0.125 * place(*n) * Vector3::new(x * q * o, y * p * o, z * p * q).transpose();
            }
            let cube: Vector3<f64> = (at - lo) / cell;
            *volumes.entry([cube.x as i32, cube.y as i32, cube.z as i32]).or_default() +=
                J.determinant().abs() * 8.0 / (N * N * N) as f64;
        }
    }
    (lo, volumes)
}

/// A muscle whose ends are all of it that lies in the cubes of its end faces, and beside it all of its cubes, in cells of an `n`-th of their edge,
/// with the part of its cube that the muscle fills for each cell: what a law that is scaled by volume fractions sees. Its ends are the same cubes, so
/// both are held alike: where faces alone are held, what is thinned out gives way beside them, which hides how stiff it is.
fn fractions(mesh: &Mesh, cell: f64, n: i32) -> (Mesh, Mesh, Vec<f64>) {
    let (lo, volumes) = filled(mesh, cell);
    let mut own = mesh.clone();
    let cube_of = |p: &[f64; 3]| -> [i32; 3] { ((Vector3::from(*p) - lo) / cell).map(|v| v as i32).into() };
    let ends = ["origin", "insertion"].map(|set| {
        let cubes: BTreeSet<[i32; 3]> =
            mesh.node_sets[set].iter().map(|k| cube_of(&mesh.points[*k as usize])).collect();
        let inside =
            (0..mesh.points.len() as u32).filter(|k| cubes.contains(&cube_of(&mesh.points[*k as usize])));
        own.node_sets.insert(set.to_string(), inside.collect());
        (set, cubes)
    });
    let mut all = Mesh::default();
    let (mut nodes, mut scale, mut number) = (Vec::new(), Vec::new(), BTreeMap::<[i32; 3], u32>::new());
    for (cube, volume) in &volumes {
        for part in 0..n * n * n {
            let first: [i32; 3] =
                std::array::from_fn(|c| n * cube[c] + [part / (n * n), part / n % n, part % n][c]);
            for [x, y, z] in
                [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
            {
                let at = [first[0] + x, first[1] + y, first[2] + z];
                nodes.push(*number.entry(at).or_insert_with(|| {
                    let place = lo + Vector3::from(at.map(f64::from)) * (cell / f64::from(n));
                    all.points.push(place.into());
                    all.points.len() as u32 - 1
                }));
            }
            scale.push(volume / cell.powi(3));
        }
    }
    all.blocks.push(CellBlock { name: mesh.blocks[0].name.clone(), kind: CellKind::Hex8, nodes });
    for (set, cubes) in ends {
        let is_of = |at: &[i32; 3], cube: &[i32; 3]| (0..3).all(|c| (0..=n).contains(&(at[c] - n * cube[c])));
        let inside = number.iter().filter(|(at, _)| cubes.iter().any(|cube| is_of(at, cube)));
        let inside: BTreeSet<u32> = inside.map(|(_, k)| *k).collect();
        all.node_sets.insert(set.to_string(), inside.into_iter().collect());
    }
    (own, all, scale)
}

/// Weight of a newton per volume of 1e-4 m³ across a muscle held at both ends: how far its volume moves in the mean \[m\].
fn sag(mesh: &Mesh, scale: &[f64], way: Vector3<f64>, cell: Option<f64>) -> f64 {
    let down = way.normalize().cross(&Vector3::z()).normalize();
    let volume = |nodes: &[u32]| mesh.volume(&CellBlock { nodes: nodes.to_vec(), ..mesh.blocks[0].clone() });
    let mut loads = BTreeMap::<u32, f64>::new();
    for (k, nodes) in mesh.blocks[0].nodes.chunks(8).enumerate() {
        let share = scale.get(k).copied().unwrap_or(1.0) * volume(nodes) / 8.0;
        nodes.iter().for_each(|n| *loads.entry(*n).or_default() += 1e4 * share);
    }
    let held_nodes: BTreeSet<u32> =
        ["origin", "insertion"].iter().flat_map(|set| mesh.node_sets[*set].iter().copied()).collect();
    let mut scene = scene_of(mesh, mooney_rivlin(), None);
    scene.solids[0].scale = scale.to_vec();
    scene.prescribed = ["origin", "insertion"].map(|set| held(set, [true; 3])).into();
    let free = || loads.iter().filter(|(n, _)| !held_nodes.contains(n));
    let on_nodes = free().map(|(n, w)| (*n, (down * *w).into())).collect();
    scene.forces.push(ForceSpec { name: "weight".into(), loads: on_nodes, control: "load".into() });
    if let Some(cell) = cell {
        scene = embedded(&scene, &mesh.blocks[0].name, cell);
    }
    let plan = plan(&scene, mesh);
    let frame = solve(&plan, &[("load", 1.0)], &tolerance(1e-6));
    let moved = |n: &u32| {
        let at = Vector3::from_column_slice(&frame.x[3 * *n as usize..][..3]);
        (at - Vector3::from(mesh.points[*n as usize])).dot(&down)
    };
    free().map(|(n, w)| w * moved(n)).sum::<f64>() / free().map(|(_, w)| w).sum::<f64>()
}

/// T8: a law on the part of a cube that is filled against one on all of it, scaled by the volume fraction.
pub fn filled_part_against_fractions() -> Outcome {
    let (mesh, way) = vastus_intermedius(5e-3);
    let mut rows = Vec::new();
    let mut good = true;
    for (cell, n) in [(20e-3, 4), (10e-3, 2)] {
        let (own, cubes, scale) = fractions(&mesh, cell, n);
        let both = [(&own, &[][..]), (&cubes, &scale[..])];
        let mut row = |what: &str, [on_filled, by_fractions]: [f64; 2]| {
            good &= (on_filled - 1.0).abs() < (by_fractions - 1.0).abs();
            rows.push(format!("{:.0} mm {what} {on_filled:.2} and {by_fractions:.2}", 1e3 * cell));
        };
        for (at, (what, load)) in LOADS.into_iter().enumerate() {
            let exact = pulled(&own, way, None, load).0[at];
            row(
                what,
                both.map(|(m, scale)| scaled_and_pulled(m, scale, way, Some(cell), load).0[at] / exact),
            );
        }
        let exact = sag(&own, &[], way, None);
        row("sag", both.map(|(m, scale)| sag(m, scale, way, Some(cell)) / exact));
    }
    let text = format!("on the filled part and by fractions, over the mesh: {}", rows.join("; "));
    if good { Ok(text) } else { Err(text) }
}

/// T8: a mesh that fits the muscle beside a grid of about as many unknowns.
pub fn grid_against_coarse_mesh() -> Outcome {
    let (mesh, way) = vastus_intermedius(5e-3);
    // The coarsest that the mesher makes: 36 cells a section.
    let (coarse, _) = vastus_intermedius(30e-3);
    let mut rows = Vec::new();
    for (at, (what, load)) in LOADS.into_iter().enumerate() {
        let (exact, _) = pulled(&mesh, way, None, load);
        let ([grid, fitted], n): ([f64; 2], _) = {
            let [(a, n), (b, m)] =
                [(&mesh, Some(10e-3)), (&coarse, None)].map(|(m, cell)| pulled(m, way, cell, load));
            ([a, b].map(|f| f[at] / exact[at]), [n, m])
        };
        rows.push(format!("{what} {grid:.2} ({}) in cubes of 10 mm, {fitted:.2} ({}) in a mesh", n[0], n[1]));
        ensure(n[1].abs_diff(n[0]) < n[0] / 5 && (grid - 1.0).abs() < (fitted - 1.0).abs(), || {
            rows.join("; ")
        })?;
    }
    Ok(format!("over a mesh of 5 mm: {}", rows.join("; ")))
}
