//! Is a follower pressure that of a pressure, whatever openings its surface has?
#![allow(non_snake_case)]

use fem::measure::support_wrench;
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Drive, run};
use fem::scene::*;
use nalgebra::Vector3;
use support::fem_scenes::{held, plan, solid, solve, symmetry_planes, tolerance};

const MU: f64 = 3.75e3;
/// So stiff that the tube is incompressible to 1e-4.
const BULK: f64 = 1e4 * MU;
const INNER: f64 = 0.010;
const OUTER: f64 = 0.015;
const LENGTH: f64 = 0.012;

/// A thick incompressible neo-Hookean tube under inner pressure, stretched to `stretch` of its length.
///
/// r² = a² + (R² − A²)/λz, dp = (σθθ − σrr) dr/r, σθθ − σrr = μ (λ² − 1/(λ λz)²), λ = r/R.
struct Tube {
    stretch: f64,
}

impl Tube {
    fn radius(&self, R: f64, a: f64) -> f64 {
        (a * a + (R * R - INNER * INNER) / self.stretch).sqrt()
    }

    /// Pressure difference between radius R and the outside where the inner radius is `a`.
    fn pressure(&self, R: f64, a: f64) -> f64 {
        let z = self.stretch;
        simpson(R, OUTER, |R| {
            let l = self.radius(R, a) / R;
            MU * (l * l - 1.0 / (l * z).powi(2)) / (z * l * l * R)
        })
    }

    /// Inner radius under a pressure, by bisection.
    fn inner_radius(&self, pressure: f64) -> f64 {
        let (mut low, mut high) = (0.5 * INNER, 3.0 * INNER);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.pressure(INNER, middle) < pressure { low = middle } else { high = middle }
        }
        low
    }

    /// Force through a cross-section of the wall: ∫ σzz 2πr dr, σzz = σrr + μ (λz² − 1/(λ λz)²).
    fn axial_force(&self, a: f64) -> f64 {
        let z = self.stretch;
        simpson(INNER, OUTER, |R| {
            let l = self.radius(R, a) / R;
            let stress = -self.pressure(R, a) + MU * (z * z - 1.0 / (l * z).powi(2));
            stress * 2.0 * std::f64::consts::PI * R / z
        })
    }
}

fn simpson(from: f64, to: f64, f: impl Fn(f64) -> f64) -> f64 {
    let n = 40;
    let h = (to - from) / f64::from(n);
    let weight = |i: i32| if i == 0 || i == n { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
    (0..=n).map(|i| weight(i) * f(from + f64::from(i) * h)).sum::<f64>() * h / 3.0
}

fn wall() -> SolidSpec {
    solid("block", LawSpec::NeoHookeanUncoupled { mu: MU, bulk: BULK }, None)
}

fn inside(surface: &str) -> PressureSpec {
    PressureSpec { surface: surface.to_string(), control: "p".to_string(), ..PressureSpec::default() }
}

/// An end that slides in its plane, moved along z by the control `pull`.
fn pulled_end() -> PrescribedSpec {
    PrescribedSpec {
        nodes: "z_max".to_string(),
        components: [false, false, true],
        displacement: vec![[0.0, 0.0, 1.0]],
        control: Some("pull".to_string()),
    }
}

/// A quarter of the tube with `n` cells through the wall: its surface `x_min` has one rim in four planes, two of them parallel.
fn quarter(n: usize) -> (Scene, Mesh) {
    let mesh = generate::mapped([n, 4 * n, 1], |[s, t, w]| {
        let (r, angle) = (INNER + s * (OUTER - INNER), 0.5 * std::f64::consts::PI * t);
        let snap = |x: f64| if x.abs() < 1e-12 { 0.0 } else { x };
        [snap(r * angle.cos()), snap(r * angle.sin()), LENGTH * w]
    });
    let scene = Scene {
        solids: vec![wall()],
        pressures: vec![inside("x_min")],
        prescribed: vec![
            held("y_min", [false, true, false]),
            held("y_max", [true, false, false]),
            held("z_min", [false, false, true]),
            pulled_end(),
        ],
        ..Scene::default()
    };
    (scene, mesh)
}

/// The whole tube: two separate openings in parallel planes. Held against moving sideways where the symmetry of the solution allows.
fn whole(n: usize) -> (Scene, Mesh) {
    let mut mesh = generate::tube(INNER, OUTER, LENGTH, 16 * n, n, 1);
    for (set, d) in [("on_x", 1), ("on_y", 0)] {
        let on = |i: &u32| mesh.points[*i as usize][d].abs() < 1e-9;
        mesh.node_sets.insert(set.to_string(), (0..mesh.points.len() as u32).filter(on).collect());
    }
    let scene = Scene {
        solids: vec![wall()],
        pressures: vec![inside("inner")],
        prescribed: vec![
            held("on_x", [false, true, false]),
            held("on_y", [true, false, false]),
            held("z_min", [false, false, true]),
            pulled_end(),
        ],
        ..Scene::default()
    };
    (scene, mesh)
}

/// Relative errors of the inner radius and of the force on the end.
fn errors((scene, mesh): (Scene, Mesh), stretch: f64, pressure: f64, fraction: f64) -> [f64; 2] {
    let plan = plan(&scene, &mesh);
    let pull = (stretch - 1.0) * LENGTH;
    let frame = solve(&plan, &[("p", pressure), ("pull", pull)], &tolerance(1e-8));
    let nodes = &mesh.node_sets[&scene.pressures[0].surface];
    let radius = |n: &u32| frame.x[3 * *n as usize].hypot(frame.x[3 * *n as usize + 1]);
    let ours = nodes.iter().map(radius).sum::<f64>() / nodes.len() as f64;
    let tube = Tube { stretch };
    let exact = tube.inner_radius(pressure);
    let force = support_wrench(&plan, frame.snapshot(), &mesh.node_sets["z_max"], [0.0; 3]).force[2];
    [ours / exact - 1.0, force / (fraction * tube.axial_force(exact)) - 1.0]
}

#[test]
fn an_open_tube_inflates_as_the_closed_solution_says() {
    for stretch in [1.0, 1.2] {
        let pressure = 0.2 * MU;
        let tube = Tube { stretch };
        let a = tube.inner_radius(pressure);
        println!("stretch {stretch}: inner radius {:.4} mm, force {:.3} N", 1e3 * a, tube.axial_force(a));
        let mut last: Option<[f64; 2]> = None;
        for n in [2, 4, 8] {
            let [radius, force] = errors(quarter(n), stretch, pressure, 0.25);
            println!("  quarter, {n} cells: radius {radius:.1e}, force {force:.1e}");
            if let Some([r, f]) = last {
                // Error in h²: four times less; the rest is the finite bulk modulus.
                assert!(radius.abs() < r.abs() / 3.0 + 1e-4, "radius {radius:.1e} after {r:.1e}");
                assert!(force.abs() < f.abs() / 3.0 + 1e-3, "force {force:.1e} after {f:.1e}");
            }
            last = Some([radius, force]);
        }
        let [radius, force] = last.expect("three meshes");
        assert!(radius.abs() < 1e-3 && force.abs() < 5e-3, "radius {radius:.1e}, force {force:.1e}");
        let ours = errors(quarter(2), stretch, pressure, 0.25);
        let all = errors(whole(2), stretch, pressure, 1.0);
        println!("  whole tube, 2 cells: radius {:.1e}, force {:.1e}", all[0], all[1]);
        for (all, quarter) in all.iter().zip(ours) {
            assert!((all - quarter).abs() < 1e-5, "the whole tube is not four quarters: {all} and {quarter}");
        }
    }
}

/// The tube on a slant: the end z = 0 is cut obliquely to the axis and slides in its plane, the other one is cut square and held.
fn oblique(n: usize) -> (Scene, Mesh) {
    let mut mesh = generate::tube(INNER, OUTER, LENGTH, 8 * n, n, n);
    let (sin, cos) = 0.5f64.sin_cos();
    for p in &mut mesh.points {
        let [x, y, z] = *p;
        // Along the axis (sin, 0, cos) from the plane z = 0 to the square end.
        let (along, foot) = (z / LENGTH, x * sin / cos);
        let s = foot + along * (LENGTH - foot);
        let height = if along == 0.0 { 0.0 } else { -x * sin + s * cos };
        *p = [x * cos + s * sin, y, height];
    }
    let sideways =
        mesh.node_sets["z_min"].iter().copied().filter(|&n| mesh.points[n as usize][1].abs() < 1e-9);
    mesh.node_sets.insert("middle".to_string(), sideways.collect());
    let scene = Scene {
        solids: vec![wall()],
        pressures: vec![inside("inner")],
        prescribed: vec![
            held("z_min", [false, false, true]),
            held("middle", [false, true, false]),
            held("z_max", [true; 3]),
        ],
        ..Scene::default()
    };
    (scene, mesh)
}

/// Forces of a pressure on the nodes of faces at `x`, by summing p n over a fine raster of each.
fn by_hand(faces: &[[u32; 4]], x: &[f64], pressure: f64) -> Vec<(u32, [f64; 3])> {
    const RASTER: usize = 64;
    let mut loads = std::collections::BTreeMap::<u32, Vector3<f64>>::new();
    for face in faces {
        let [a, b, c, d] = face.map(|n| Vector3::from_row_slice(&x[3 * n as usize..3 * n as usize + 3]));
        for i in 0..RASTER * RASTER {
            let [s, t] = [i % RASTER, i / RASTER].map(|i| (i as f64 + 0.5) / RASTER as f64);
            let along = (b - a) * (1.0 - t) + (c - d) * t;
            let up = (d - a) * (1.0 - s) + (c - b) * s;
            let force = -along.cross(&up) * (pressure / (RASTER * RASTER) as f64);
            let fractions = [(1.0 - s) * (1.0 - t), s * (1.0 - t), s * t, (1.0 - s) * t];
            for (&n, fraction) in face.iter().zip(fractions) {
                *loads.entry(n).or_insert_with(Vector3::zeros) += force * fraction;
            }
        }
    }
    loads.into_iter().map(|(n, f)| (n, f.into())).collect()
}

/// Dead forces that equal those of the pressure at its solution hold the same solution, and the supports carry nothing else.
#[test]
fn a_tube_with_an_oblique_end_is_in_equilibrium_with_the_pressure_on_its_wall_alone() {
    for n in [2, 3] {
        let (scene, mesh) = oblique(n);
        let pressured = plan(&scene, &mesh);
        let pressure = 0.2 * MU;
        let frame = solve(&pressured, &[("p", pressure)], &tolerance(1e-9));
        let loads = by_hand(&mesh.surfaces["inner"], &frame.x, pressure);
        let total: Vector3<f64> = loads.iter().map(|l| Vector3::from(l.1)).sum();
        let dead = ForceSpec { name: "by hand".to_string(), loads, control: "f".to_string() };
        let dead = plan(&Scene { pressures: vec![], forces: vec![dead], ..scene }, &mesh);
        let drive = Drive::once(dead.load(&[("f", 1.0)], &[]).expect("a control"));
        let held = run(&dead, &drive, &tolerance(1e-9), Some(&frame.x), &mut |_| {});
        assert!(held.is_solved(), "{}", held.errors[0]);
        let moved = |x: &[f64]| x.iter().zip(&frame.x).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let inflated = moved(&pressured.reference());
        let off = moved(&held.frames[0].x);
        println!("{n} cells: inflated by {:.2} mm, off by {:.1e} mm", 1e3 * inflated, 1e3 * off);
        assert!(inflated > 1e-3 && off < 1e-4 * inflated, "off by {off:.1e} of {inflated:.1e} m");
        let all: Vec<u32> = (0..mesh.points.len() as u32).collect();
        let supports = support_wrench(&pressured, frame.snapshot(), &all, [0.0; 3]).force;
        let left = (Vector3::from(supports) + total).norm();
        assert!(left < 1e-3 * total.norm(), "supports {supports:?} do not balance {total:?}");
    }
}

/// On a patch whose rim slides in planes of any direction the force is the derivative of the energy, and the stiffness of the force.
#[test]
fn on_every_rim_that_slides_in_planes_the_force_is_the_derivative_of_the_energy() {
    use fem::effect::{Effect, Pressure, State};
    use nalgebra::{Matrix3, Rotation3};
    // A quarter of the wall of a tube, turned anyhow, nothing else.
    let n = 3;
    let mesh = quarter(n).1;
    let faces = mesh.surfaces["x_min"].clone();
    let turn = Rotation3::from_euler_angles(0.4, -0.7, 1.1);
    let X: Vec<[f64; 3]> = mesh.points.iter().map(|p| (turn * Vector3::from(*p)).into()).collect();
    let mut rim = std::collections::BTreeMap::new();
    for (set, axis) in [("y_min", 1), ("y_max", 0), ("z_min", 2), ("z_max", 2)] {
        for &node in mesh.node_sets[set].iter().filter(|n| faces.iter().flatten().any(|m| m == *n)) {
            let normal = turn * Vector3::ith(axis, 1.0);
            let free = rim.entry(node).or_insert_with(Matrix3::identity);
            *free -= normal * normal.transpose();
        }
    }
    let effect = Pressure::new("p", 0, &X, faces.clone(), rim.clone());
    let mut random = support::Random::new(1);
    // Displacements of the nodes that the rim allows; the ends besides are moved along the axis as by a control.
    let axis = turn * Vector3::z();
    let mut allowed = |size: f64| -> Vec<f64> {
        let mut u = Vec::new();
        for n in 0..X.len() as u32 {
            let free = rim.get(&n).copied().unwrap_or_else(Matrix3::identity);
            u.extend_from_slice((free * random.vector(size)).as_slice());
        }
        u
    };
    let controls = [0.6];
    let dense = |x: &[f64], dy: &[f64], dx: &[f64]| -> [f64; 2] {
        let s = State { x, controls: &controls };
        let (mut f, mut k) = (vec![0.0; 12 * faces.len()], vec![0.0; 144 * faces.len()]);
        effect.forces(&s, 0, &mut f);
        effect.stiffness(&s, 0.0, 0, &mut k);
        let at = |u: &[f64], face: usize, i: usize| u[3 * faces[face][i / 3] as usize + i % 3];
        let force = f.iter().enumerate().map(|(i, f)| f * at(dy, i / 12, i % 12)).sum();
        let k = k.iter().enumerate();
        let curve = k.map(|(i, k)| k * at(dy, i / 144, i / 12 % 12) * at(dx, i / 144, i % 12)).sum();
        [force, curve]
    };
    for sample in 0..10 {
        let (u, dx, dy) = (allowed(4e-3), allowed(1e-3), allowed(1e-3));
        let pulled = |n: usize| if mesh.points[n][2] == LENGTH { axis * 3e-3 } else { Vector3::zeros() };
        let start: Vec<f64> =
            (0..3 * X.len()).map(|i| X[i / 3][i % 3] + u[i] + pulled(i / 3)[i % 3]).collect();
        let at = |h: f64| -> Vec<f64> { start.iter().zip(&dx).map(|(x, d)| x + h * d).collect() };
        let [slope, curve] = dense(&start, &dx, &dx);
        let energy = |h: f64| effect.energy(&State { x: &at(h), controls: &controls });
        // Cubic along a line: central differences of width 2 and 4 give the slope exactly.
        let difference = |f: &dyn Fn(f64) -> f64| (8.0 * (f(0.5) - f(-0.5)) - (f(1.0) - f(-1.0))) / 6.0;
        let exact = difference(&energy);
        assert!((slope / exact - 1.0).abs() < 1e-9, "sample {sample}: {slope} is not {exact}");
        let [_, across] = dense(&start, &dy, &dx);
        let force = |h: f64| dense(&at(h), &dy, &dx)[0];
        let exact = difference(&force);
        assert!(
            (across - exact).abs() < 1e-9 * curve.abs().max(exact.abs()),
            "{sample}: {across} is not {exact}"
        );
    }
}

/// What a scene of the quarter with a change of its says.
/// The octant of a sphere stands on three symmetry planes. What their rollers push back is the resultant of the stress in the wall, and that is
/// the pressure on a quarter of the inner circle, p π a²/4, which itself is no part of it.
#[test]
fn the_reaction_of_an_octant_is_the_stress_in_its_wall_without_the_pressure_on_the_opening() {
    let (inner, outer, pressure) = (0.010, 0.015, 1e3);
    let mesh = fem::mesh::generate::sphere_octant(inner, outer, 4, 3);
    let scene = Scene {
        solids: vec![wall()],
        pressures: vec![inside("inner")],
        prescribed: symmetry_planes(),
        ..Scene::default()
    };
    let plan = plan(&scene, &mesh);
    let frame = solve(&plan, &[("p", pressure)], &tolerance(1e-9));
    let at = frame.snapshot();
    let place = |n: u32| Vector3::from_row_slice(&frame.x[3 * n as usize..3 * n as usize + 3]);
    let nodes = fem::mesh::unique_nodes(mesh.surfaces["inner"].iter().flatten().copied());
    let radius = nodes.iter().map(|&n| place(n).norm()).sum::<f64>() / nodes.len() as f64;
    assert!(radius > 1.03 * inner, "it has grown to {radius} m");
    let pushed = fem::measure::pressure_wrench(&plan, at, "inner", [0.0; 3]).expect("a pressure");
    for (c, set) in ["x_min", "y_min", "z_min"].into_iter().enumerate() {
        let reaction = support_wrench(&plan, at, &mesh.node_sets[set], [0.0; 3]).force;
        let exact = pressure * std::f64::consts::PI * radius * radius / 4.0;
        println!("{set}: reaction {:.6} N, p pi a^2/4 = {exact:.6} N", -reaction[c]);
        // The inner circle is a polygon of 8 edges per quarter, whose area is less by 0.6 %.
        assert!((-reaction[c] / exact - 1.0).abs() < 0.03, "{set}: {} N, wanted {exact} N", -reaction[c]);
        assert!(
            (reaction[c] + pushed.force[c]).abs() < 1e-7 * exact,
            "{set}: {} and {} N",
            reaction[c],
            pushed.force[c]
        );
        // The wall itself: mean stress across the plane over the cells that stand on it, times their area there.
        let cells = fem::measure::solid_field(&plan, at, &mesh.blocks[0].name).expect("a solid");
        let on_plane = |cell: &[u32]| -> Option<[u32; 4]> {
            let faces = fem::mesh::CellKind::Hex8.faces().iter().map(|f| f.map(|n| cell[n]));
            faces.into_iter().find(|f| f.iter().all(|n| mesh.node_sets[set].contains(n)))
        };
        let wall: f64 = mesh.blocks[0]
            .cells()
            .zip(&cells)
            .filter_map(|(cell, field)| {
                let [a, b, e, f] = on_plane(cell)?.map(place);
                Some(0.5 * (e - a).cross(&(f - b)).norm() * field.cauchy[(c, c)])
            })
            .sum();
        println!("stress in the wall {wall:.6} N");
        assert!(
            (wall / -reaction[c] - 1.0).abs() < 0.05,
            "{set}: stress {wall} N, reaction {} N",
            reaction[c]
        );
    }
}

fn refusal(change: impl Fn(&mut Scene, &mut Mesh)) -> Option<String> {
    let (mut scene, mut mesh) = quarter(2);
    change(&mut scene, &mut mesh);
    Plan::new(&scene, mesh).err().map(|e| e.to_string())
}

#[test]
fn a_rim_on_which_pressure_has_no_potential_is_refused() {
    assert_eq!(refusal(|_, _| {}), None);
    for (what, says, change) in [
        (
            "a free end",
            "moves freely",
            &(|s: &mut Scene, _: &mut Mesh| drop(s.prescribed.pop())) as &dyn Fn(&mut Scene, &mut Mesh),
        ),
        ("an end that moves as one plane", "moves freely", &|s, _| {
            s.prescribed.pop();
            s.planes.push(PlaneSpec { nodes: "z_max".to_string(), axis: 2.into() });
        }),
        (
            "an oblique end on a roller along the axis",
            "slides in a plane in which it does not lie",
            &|_, m| m.points.iter_mut().for_each(|p| p[2] += 0.2 * p[2] / LENGTH * p[0]),
        ),
        ("an end that is warped", "is taken out of its plane by what is prescribed", &|s, m| {
            let end = s.prescribed.last_mut().expect("the end");
            let z = |n: &u32| [0.0, 0.0, m.points[*n as usize][0]];
            end.displacement = m.node_sets["z_max"].iter().map(z).collect();
        }),
        ("a face that is turned over", "turn opposite ways", &|_, m| {
            m.surfaces.get_mut("x_min").expect("a surface")[3].reverse()
        }),
    ] {
        let message = refusal(change).unwrap_or_else(|| panic!("{what} is accepted"));
        println!("{what}: {message}");
        assert!(message.contains("pressure on `x_min`") && message.contains(says), "{what}: {message}");
    }
    // A warped end that is held in its plane has no unknowns that feel it.
    let held_end = refusal(|s, m| {
        let end = s.prescribed.last_mut().expect("the end");
        end.components = [true; 3];
        let z = |n: &u32| [0.0, 0.0, m.points[*n as usize][0]];
        end.displacement = m.node_sets["z_max"].iter().map(z).collect();
    });
    assert_eq!(held_end, None);
}
