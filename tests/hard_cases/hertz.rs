//! Contact with closed solutions at small strain: b07 (sphere on a rigid plane) and C10 (peak pressure and radius of that and of
//! two equal cylinders, by the force that they bear). Hertz in Johnson, Contact Mechanics (1985), §4.2.
//!
//! Guarded surfaces begin to press at the activation distance, so the plane stands that much higher than it is drawn; approach is
//! counted from there, and the row names the distance.
//!
//! A half ball whose flat face is bonded is stiffer than the half space of Hertz, which gives way at the depth of that face. So b07 is
//! judged by an independent linear solution of the same body, [`OVER_HERTZ`], with Hertz beside it. For a flat face on a roller, which is
//! the whole ball between two planes, there is a closed form: [`tatara`].

use crate::{Case, Outcome, Tier};
use fem::measure::{contact_tractions, pair_forces};
use fem::mesh::{Mesh, generate};
use fem::plan::Plan;
use fem::run::{Frame, run};
use fem::scene::{ContactMode, ContactSpec, LawSpec, Scene};
use fem::solve::Settings;
use std::f64::consts::PI;
use support::contact_scenes::{add, intersections, moved, ramp};
use support::fem_scenes::held;

pub const CASES: &[Case] = &[
    Case { id: "b07", title: "sphere on rigid plane, guarded", tier: Tier::Full, run: sphere_guarded },
    Case { id: "b07", title: "sphere on rigid plane, cheap", tier: Tier::Full, run: sphere_cheap },
    Case { id: "b07r", title: "sphere between two planes, guarded", tier: Tier::Full, run: between_guarded },
    Case { id: "b07r", title: "sphere between two planes, cheap", tier: Tier::Full, run: between_cheap },
    Case {
        id: "C10",
        title: "sphere: peak pressure and radius, guarded",
        tier: Tier::Full,
        run: peak_guarded,
    },
    Case { id: "C10", title: "sphere: peak pressure and radius, cheap", tier: Tier::Full, run: peak_cheap },
    Case { id: "C10", title: "two cylinders, guarded", tier: Tier::Full, run: cylinders_guarded },
    Case { id: "C10", title: "two cylinders, cheap", tier: Tier::Full, run: cylinders_cheap },
];

const YOUNG: f64 = 1e6;
const NU: f64 = 0.3;
/// Radius of sphere and cylinders \[m\].
const RADIUS: f64 = 0.01;
/// Plane-strain modulus \[Pa\] of one side.
const E_STAR: f64 = YOUNG / (1.0 - NU * NU);

/// Where cells end along a unit length: `n_fine` of length `fine`, then `n_coarse` that grow by a constant factor up to 1.
fn graded(fine: f64, n_fine: usize, n_coarse: usize) -> Vec<f64> {
    let rest = 1.0 - fine * n_fine as f64;
    let sum = |q: f64| (1..=n_coarse).map(|i| fine * q.powi(i as i32)).sum::<f64>();
    let (mut low, mut high) = (0.5, 10.0);
    for _ in 0..100 {
        let q = 0.5 * (low + high);
        if sum(q) < rest { low = q } else { high = q }
    }
    let mut at: Vec<f64> = (0..=n_fine).map(|i| fine * i as f64).collect();
    for i in 1..=n_coarse {
        at.push(at[at.len() - 1] + fine * low.powi(i as i32));
    }
    *at.last_mut().expect("not empty") = 1.0;
    at
}

/// A quarter of a half ball with its pole in the origin and its flat face at z = radius: a box with the cell ends `across` and
/// `up`, mapped so that its bottom is the cap about the pole.
fn half_ball(across: &[f64], up: &[f64]) -> Mesh {
    let n = [across.len() - 1, across.len() - 1, up.len() - 1];
    let at = |list: &[f64], s: f64| list[(s * (list.len() - 1) as f64).round() as usize];
    generate::mapped(n, |s| {
        let (u, v, q) = (at(across, s[0]), at(across, s[1]), at(up, s[2]) - 1.0);
        let out = |a: f64, b: f64| (1.0 - a * a / 2.0 - b * b / 2.0 + a * a * b * b / 3.0).sqrt();
        [RADIUS * u * out(v, q), RADIUS * v * out(u, q), RADIUS * (1.0 + q * out(u, v))]
    })
}

/// Half of a half cylinder about y in a slice of thickness `slice`, its line of contact on z = 0, above it or below.
fn half_cylinder(across: &[f64], up: &[f64], slice: f64, below: bool) -> Mesh {
    let n = [across.len() - 1, 1, up.len() - 1];
    let at = |list: &[f64], s: f64| list[(s * (list.len() - 1) as f64).round() as usize];
    generate::mapped(n, |s| {
        let w = if below { 1.0 - s[2] } else { s[2] };
        let (u, q) = (at(across, s[0]), at(up, w) - 1.0);
        let out = |a: f64| (1.0 - a * a / 2.0).sqrt();
        let z = RADIUS * (1.0 + q * out(u));
        [RADIUS * u * out(q), slice * s[1], if below { -z } else { z }]
    })
}

/// A mode and its distance \[m\].
struct Way {
    mode: ContactMode,
    distance: f64,
}

const GUARDED: Way = Way { mode: ContactMode::Guarded, distance: 1e-6 };
const CHEAP: Way = Way { mode: ContactMode::Cheap, distance: 5e-6 };

impl Way {
    /// Gap at the start: that at which guarded surfaces begin to press.
    fn gap(&self) -> f64 {
        if self.mode == ContactMode::Guarded { self.distance } else { 0.0 }
    }

    fn spec(&self, surfaces: &[&str]) -> ContactSpec {
        ContactSpec { mode: self.mode, distance: self.distance, ..ContactSpec::new(surfaces) }
    }

    /// Every frame of a drive, without intersection where guarded.
    fn frames(&self, plan: &Plan, drive: &fem::run::Drive) -> Result<Vec<Frame>, String> {
        let out = run(plan, drive, &Settings::default(), None, &mut |_| {});
        if let Some(e) = out.errors.first() {
            return Err(e.to_string());
        }
        for frame in out.frames.iter().filter(|_| self.mode == ContactMode::Guarded) {
            let bad = intersections(plan, frame.snapshot(), &[]);
            if !bad.is_empty() {
                return Err(format!("at time {}: {}", frame.time, bad.join("; ")));
            }
        }
        Ok(out.frames)
    }
}

/// Contact of the sphere at one approach.
struct Pressed {
    /// \[m\]
    approach: f64,
    /// \[N\]
    force: f64,
    /// Radius \[m\] of the area that presses.
    radius: f64,
    /// Greatest pressure \[Pa\], see [`peak_pressure`].
    peak: [f64; 2],
}

/// What the flat face of the half ball does.
#[derive(Clone, Copy, PartialEq)]
enum Face {
    Bonded,
    /// On a roller: the plane of symmetry of a ball between two planes.
    Rolls,
}

/// Approaches \[m\] of b07.
const APPROACHES: [f64; 4] = [0.05e-3, 0.1e-3, 0.15e-3, 0.2e-3];
/// Force over that of Hertz at the [`APPROACHES`] with a bonded face and with one on a roller: published with the benchmark (README of the
/// benchmarks, b07), an axisymmetric solution with linear elasticity, quadratic elements of 0.07 mm and exact unilateral contact. That on a
/// roller is within 0.25 % of the whole ball of Tatara, J Eng Mater Technol 111 (1989).
const OVER_HERTZ: [[f64; 4]; 2] = [[1.051, 1.076, 1.096, 1.113], [1.038, 1.057, 1.072, 1.085]];
/// Edge \[m\] of the cells under the contact, at most 0.15 mm.
const EDGE: f64 = 0.14e-3;

fn sphere(way: &Way, face: Face, edge: f64) -> Result<Vec<Pressed>, String> {
    let n_fine = (1.75e-3 / edge).ceil() as usize;
    let across = graded(edge / RADIUS * 2f64.sqrt(), n_fine, 8);
    let up = graded(edge / RADIUS, 4, 11);
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    let law = LawSpec::NeoHookean { young: YOUNG, nu: NU };
    add(&mut scene, &mut mesh, "sphere", half_ball(&across, &up), [0.0, 0.0, way.gap()], law);
    // The plane ends at the planes of symmetry, so that its samples there stand for what is inside only.
    let n_plane = (2.4e-3 / edge).round() as usize;
    generate::append(&mut mesh, generate::block([n_plane, n_plane, 1], [2.4e-3, 2.4e-3, 1e-3]), "plane");
    mesh.points.iter_mut().rev().take(2 * (n_plane + 1).pow(2)).for_each(|p| p[2] -= 1e-3);
    scene.prescribed = vec![
        held("sphere_x_min", [true, false, false]),
        held("sphere_y_min", [false, true, false]),
        held("plane_z_max", [true; 3]),
        held("plane_z_min", [true; 3]),
        moved("sphere_z_max", [face == Face::Bonded, face == Face::Bonded, true], [0.0, 0.0, -1.0], "down"),
    ];
    // The flat face meets the planes of symmetry in two lines: there the bond holds what the planes would.
    if face == Face::Bonded {
        let bonded = mesh.node_sets["sphere_z_max"].clone();
        for plane in ["sphere_x_min", "sphere_y_min"] {
            mesh.node_sets.get_mut(plane).expect("a side").retain(|n| bonded.binary_search(n).is_err());
        }
    }
    scene.contact = Some(way.spec(&["sphere_z_min", "plane_z_max"]));
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let drive = ramp(&plan, &[("down", APPROACHES[3])], &[], 4);
    let pressed = |(frame, approach): (&Frame, f64)| {
        let pair = &pair_forces(&plan, frame.snapshot(), [0.0; 3])[0];
        Pressed {
            approach,
            force: 4.0 * pair.wrench.force[2].abs(),
            radius: (4.0 * pair.area / PI).sqrt(),
            peak: peak_pressure(&plan, frame, "sphere_z_min"),
        }
    };
    Ok(way.frames(&plan, &drive)?.iter().zip(APPROACHES).map(pressed).collect())
}

/// Greatest pressure at a node of a surface \[Pa\], per area as it is now and per reference area: under the middle of the contact the
/// surface is compressed by some per cent.
fn peak_pressure(plan: &Plan, frame: &Frame, surface: &str) -> [f64; 2] {
    let area = |face: &[u32; 4], x: &dyn Fn(u32) -> nalgebra::Vector3<f64>| {
        let [a, b, c, d] = face.map(x);
        0.5 * (c - a).cross(&(d - b)).norm()
    };
    let mut areas = std::collections::BTreeMap::<u32, [f64; 2]>::new();
    for face in &plan.mesh.surfaces[surface] {
        let now = area(face, &|n| nalgebra::Vector3::from_column_slice(&frame.x[3 * n as usize..][..3]));
        let rest = area(face, &|n| plan.mesh.points[n as usize].into());
        for &n in face {
            let sum = areas.entry(n).or_default();
            *sum = [sum[0] + now, sum[1] + rest];
        }
    }
    let tractions = contact_tractions(plan, frame.snapshot(), surface);
    let both = |(n, t): &(u32, [f64; 3])| [t[2].abs() * areas[n][1] / areas[n][0], t[2].abs()];
    tractions.iter().map(both).fold([0.0; 2], |m, p| [m[0].max(p[0]), m[1].max(p[1])])
}

fn percent(ours: f64, reference: f64) -> f64 {
    100.0 * (ours / reference - 1.0)
}

/// Force \[N\] of Hertz at an approach \[m\].
fn hertz(approach: f64) -> f64 {
    4.0 / 3.0 * E_STAR * RADIUS.sqrt() * approach.powf(1.5)
}

/// Force \[N\] of a ball between two planes at an approach \[m\] of each: what presses on the other side lessens the approach by
/// F f(a) / (π E). Tatara, Extensive theory of force-approach relations of elastic spheres, J. Eng. Mater. Technol. 111 (1989).
fn tatara(approach: f64) -> f64 {
    let mut force = hertz(approach);
    for _ in 0..50 {
        let a2 = (3.0 * force * RADIUS / (4.0 * E_STAR)).powf(2.0 / 3.0);
        let far = a2 + 4.0 * RADIUS * RADIUS;
        let f = 2.0 * (1.0 + NU) * RADIUS * RADIUS / far.powf(1.5) + (1.0 - NU * NU) / far.sqrt();
        force = hertz(approach + force * f / (PI * YOUNG));
    }
    force
}

/// b07: 3 % of the force, 10 % of the radius of that force. The solution with a roller must be the closed form, to 0.5 %.
fn forces(way: &Way, face: Face) -> Outcome {
    let (mut rows, mut holds) = (Vec::new(), true);
    let over_hertz = OVER_HERTZ[usize::from(face == Face::Rolls)];
    for (p, over_hertz) in sphere(way, face, EDGE)?.iter().zip(over_hertz) {
        let reference = over_hertz * hertz(p.approach);
        if face == Face::Rolls {
            holds &= percent(tatara(p.approach), reference).abs() < 0.5;
        }
        let force = percent(p.force, reference);
        let radius = percent(p.radius, (3.0 * reference * RADIUS / (4.0 * E_STAR)).cbrt());
        holds &= force.abs() < 3.0 && radius.abs() < 10.0;
        rows.push(format!(
            "{:.2} mm: {:.4} N ({force:+.1} %, from Hertz {:+.1} %), radius {:.3} mm ({radius:+.1} %)",
            p.approach * 1e3,
            p.force,
            percent(p.force, hertz(p.approach)),
            p.radius * 1e3
        ));
    }
    let text = format!("distance {:.0e} m; {}", way.distance, rows.join(", "));
    if holds { Ok(text) } else { Err(text) }
}

/// C10: 3 % of the peak pressure, radius to one cell.
fn peaks(way: &Way) -> Outcome {
    let (mut rows, mut holds) = (Vec::new(), true);
    for p in sphere(way, Face::Bonded, EDGE)? {
        let a = (3.0 * p.force * RADIUS / (4.0 * E_STAR)).cbrt();
        let [peak, at_rest] = p.peak.map(|p0| percent(p0, 1.5 * p.force / (PI * a * a)));
        let cells = (p.radius - a) / EDGE;
        holds &= peak.abs() < 3.0 && cells.abs() < 1.0;
        rows.push(format!(
            "{:.4} N: {:.2} kPa ({peak:+.1} %, per reference area {at_rest:+.1} %), radius of {:.3} mm {cells:+.2} cells off",
            p.force,
            p.peak[0] * 1e-3,
            a * 1e3
        ));
    }
    let text = format!("distance {:.0e} m; {}", way.distance, rows.join(", "));
    if holds { Ok(text) } else { Err(text) }
}

fn sphere_guarded() -> Outcome {
    forces(&GUARDED, Face::Bonded)
}

fn sphere_cheap() -> Outcome {
    forces(&CHEAP, Face::Bonded)
}

fn between_guarded() -> Outcome {
    forces(&GUARDED, Face::Rolls)
}

fn between_cheap() -> Outcome {
    forces(&CHEAP, Face::Rolls)
}

fn peak_guarded() -> Outcome {
    peaks(&GUARDED)
}

fn peak_cheap() -> Outcome {
    peaks(&CHEAP)
}

/// Two equal cylinders in plane strain with cells of different size, judged by the force that they bear. Loads are small, as Hertz has it:
/// at a half width of a tenth of the radius strain is finite, and the peak 3.8 % high per current and 1.2 % per reference area.
fn cylinders(way: &Way) -> Outcome {
    let (slice, edges) = (0.2e-3, [0.05e-3, 0.065e-3]);
    let (mut scene, mut mesh) = (Scene::default(), Mesh::default());
    for (name, edge, below) in [("upper", edges[0], false), ("lower", edges[1], true)] {
        let across = graded(edge / RADIUS * 2f64.sqrt(), (1.4e-3 / edge).ceil() as usize, 10);
        let part = half_cylinder(&across, &graded(edge / RADIUS, 5, 14), slice, below);
        let law = LawSpec::NeoHookean { young: YOUNG, nu: NU };
        add(&mut scene, &mut mesh, name, part, [0.0, 0.0, if below { 0.0 } else { way.gap() }], law);
        let flat = mesh.node_sets[&format!("{name}_z_{}", if below { "min" } else { "max" })].clone();
        let free = |set: &mut Vec<u32>| set.retain(|n| flat.binary_search(n).is_err());
        for (side, rolls) in [
            ("x_min", [true, false, false]),
            ("y_min", [false, true, false]),
            ("y_max", [false, true, false]),
        ] {
            let set = format!("{name}_{side}");
            free(mesh.node_sets.get_mut(&set).expect("a side"));
            scene.prescribed.push(held(&set, rolls));
        }
    }
    // Along y no cell may give way, at the corner of two planes both hold.
    scene.prescribed.push(held("lower_z_min", [true; 3]));
    scene.prescribed.push(moved("upper_z_max", [true; 3], [0.0, 0.0, -1.0], "down"));
    scene.contact = Some(way.spec(&["upper_z_min", "lower_z_max"]));
    let plan = Plan::new(&scene, mesh).map_err(|e| e.to_string())?;
    let drive = ramp(&plan, &[("down", 0.12e-3)], &[], 2);
    let (mut rows, mut holds) = (Vec::new(), true);
    for frame in way.frames(&plan, &drive)? {
        let pair = &pair_forces(&plan, frame.snapshot(), [0.0; 3])[0];
        let force = 2.0 * pair.wrench.force[2].abs() / slice; // N/m, both halves
        let (modulus, radius) = (E_STAR / 2.0, RADIUS / 2.0);
        let half_width = (4.0 * force * radius / (PI * modulus)).sqrt();
        let wanted = (force * modulus / (PI * radius)).sqrt();
        let [peak, at_rest] = peak_pressure(&plan, &frame, "upper_z_min").map(|p0| percent(p0, wanted));
        let cells = (pair.area / slice - half_width) / edges[1];
        holds &= peak.abs() < 3.0 && cells.abs() < 1.0;
        rows.push(format!(
            "{force:.1} N/m: peak {peak:+.1} % (per reference area {at_rest:+.1} %), half width of {:.3} mm {cells:+.2} cells off",
            half_width * 1e3
        ));
    }
    let text = format!("distance {:.0e} m; {}", way.distance, rows.join(", "));
    if holds { Ok(text) } else { Err(text) }
}

fn cylinders_guarded() -> Outcome {
    cylinders(&GUARDED)
}

fn cylinders_cheap() -> Outcome {
    cylinders(&CHEAP)
}
