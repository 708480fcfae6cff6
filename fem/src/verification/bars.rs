//! The bar with activated fibres (b04) and the hanging bar (b05).

use super::reference::{DENSITY, MATRIX, root};
use super::{Check, Solved, VerificationError, X, Y, Z, held, matrix_block, moved};
use crate::material::line::FibreStrain;
use crate::measure::{Cut, section_force};
use crate::mesh::{Mesh, generate};
use crate::scene::{Course, FibreLawSpec, FibreSpec, GravitySpec, PlaneSpec, Scene};

const FIBRES: &str = "b04 fibre bar";
const LENGTH: f64 = 0.1;
const WIDTH: f64 = 0.03;
/// Young's modulus \[Pa\], area of a bar \[m²\], number of bars, strain at full activation.
const YOUNG: f64 = 1e6;
const AREA: f64 = 4e-6;
const N_BARS: f64 = 9.0;
const CONTRACTION: f64 = 0.3;

/// How the ends of the fibre bar are held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ends {
    /// Both at a distance: the far one displaced by the control `e` times the length.
    Apart,
    /// The far one moves freely as a plane.
    Free,
}

/// The bar of b04: 100 × 30 × 30 mm, nine fibres on the grid y, z ∈ {5, 15, 25} mm, activation in the control `a`.
/// `refine` times 20 × 6 × 6 hexahedra.
pub fn fibre_bar(refine: usize, strain: FibreStrain, ends: Ends) -> (Scene, Mesh) {
    let n = [20 * refine, 6 * refine, 6 * refine];
    let mut mesh = generate::block(n, [LENGTH, WIDTH, WIDTH]);
    let lines: Vec<_> =
        [1, 3, 5].into_iter().flat_map(|k| [1, 3, 5].map(|j| [j * refine, k * refine])).collect();
    generate::add_fibres(&mut mesh, "fibres", n, &lines);
    // Against rigid motion across the bar and rotation about it; both unloaded.
    let corner = |y: f64| mesh.points.iter().position(|p| *p == [0.0, y, 0.0]).map_or(0, |i| i as u32);
    let corners = [corner(0.0), corner(WIDTH)];
    mesh.node_sets.insert("corner".into(), vec![corners[0]]);
    mesh.node_sets.insert("corners".into(), corners.to_vec());
    let mut scene = Scene {
        solids: vec![matrix_block()],
        fibres: vec![FibreSpec {
            name: "fibres".into(),
            course: Course::Region("fibres".into()),
            law: FibreLawSpec::Thermal { young: YOUNG, contraction: CONTRACTION, strain, toe: None },
            area: vec![AREA],
            activation: Some("a".into()),
        }],
        prescribed: vec![held("x_min", X), held("corner", Y), held("corners", Z)],
        ..Scene::default()
    };
    match ends {
        Ends::Apart => scene.prescribed.push(moved("x_max", X, [LENGTH, 0.0, 0.0], "e")),
        Ends::Free => scene.planes.push(PlaneSpec { nodes: "x_max".into(), axis: 0.into() }),
    }
    (scene, mesh)
}

/// Force \[N\] of matrix and bars of [`fibre_bar`] at stretch `l` and activation `a`.
pub fn fibre_bar_force(strain: FibreStrain, l: f64, a: f64) -> f64 {
    let e = match strain {
        FibreStrain::Engineering => l - 1.0,
        FibreStrain::Logarithmic => l.ln(),
    };
    WIDTH * WIDTH * MATRIX.uniaxial_nominal(l) + N_BARS * YOUNG * AREA * (e + CONTRACTION * a)
}

/// Stretch at which the bar of [`fibre_bar`] is free of force at activation `a`.
pub fn fibre_bar_free_stretch(strain: FibreStrain, a: f64) -> f64 {
    root(0.5, 1.5, |l| fibre_bar_force(strain, l, a))
}

/// b04: isometric, free and stretched contraction; section force against end force.
pub fn fibre_bar_cases(refined: bool) -> Result<Vec<Check>, VerificationError> {
    let refine = if refined { 2 } else { 1 };
    let name = format!("{} x {} x {} hex8", 20 * refine, 6 * refine, 6 * refine);
    let mut checks = Vec::new();
    for (strain, law) in [(FibreStrain::Engineering, "engineering"), (FibreStrain::Logarithmic, "log")] {
        // Activation 0 to 1 in one step, then stretched by 10 % and activated again.
        let (scene, mesh) = fibre_bar(refine, strain, Ends::Apart);
        let frames =
            [vec![("a", 1.0)], vec![("e", 0.1)], vec![("e", 0.1), ("a", 0.5)], vec![("e", 0.1), ("a", 1.0)]];
        let solved = Solved::new(FIBRES, &scene, &mesh, &frames)?;
        for (i, (e, a)) in [(0.0, 1.0), (0.1, 0.0), (0.1, 0.5), (0.1, 1.0)].into_iter().enumerate() {
            let end = solved.support(i, "x_max").force[0];
            let quantity = format!("{law}: end force [N] at stretch {}, activation {a}", 1.0 + e);
            checks.push(solved.check(
                FIBRES,
                &name,
                quantity,
                [end, fibre_bar_force(strain, 1.0 + e, a)],
                0.005,
            ));
            let cut = Cut { point: [0.5 * LENGTH; 3], normal: [1.0, 0.0, 0.0], effects: Vec::new() };
            let section = section_force(&solved.plan, solved.at(i), &cut).along(cut.normal);
            let quantity =
                format!("{law}: section force [N] against end force, stretch {}, activation {a}", 1.0 + e);
            checks.push(solved.check(FIBRES, &name, quantity, [section, end], 1e-4));
        }
        let (scene, mesh) = fibre_bar(refine, strain, Ends::Free);
        let activations = [1.0, 0.5]; // the first in one step
        let solved = Solved::new(FIBRES, &scene, &mesh, &activations.map(|a| vec![("a", a)]))?;
        for (i, a) in activations.into_iter().enumerate() {
            let far = solved.nodes("x_max")[0];
            let stretch = 1.0 + solved.displacement(i, far)[0] / LENGTH;
            let exact = fibre_bar_free_stretch(strain, a);
            let quantity = format!("{law}: free stretch at activation {a}");
            checks.push(solved.check(FIBRES, &name, quantity, [stretch, exact], 0.005));
        }
    }
    Ok(checks)
}

/// b05: a bar that hangs by its top face, free to contract there.
pub fn gravity(refined: bool) -> Result<Vec<Check>, VerificationError> {
    const CASE: &str = "b05 hanging bar";
    const STANDARD: f64 = 9.81;
    let (length, width) = (0.2, 0.02);
    let n = if refined { [8, 8, 80] } else { [4, 4, 40] };
    let mut mesh = generate::block(n, [width, width, length]);
    let corner = |y: f64| mesh.points.iter().position(|p| *p == [0.0, y, length]).map_or(0, |i| i as u32);
    let corners = [corner(0.0), corner(width)];
    mesh.node_sets.insert("corner".into(), vec![corners[0]]);
    mesh.node_sets.insert("corners".into(), corners.to_vec());
    let scene = Scene {
        solids: vec![matrix_block()],
        gravity: Some(GravitySpec { acceleration: [0.0, 0.0, -STANDARD], control: "g".into() }),
        prescribed: vec![held("z_max", Z), held("corner", Y), held("corners", X)],
        ..Scene::default()
    };
    let gravities = [1.0, 5.0];
    let solved = Solved::new(CASE, &scene, &mesh, &gravities.map(|g| vec![("g", g)]))?;
    let name = format!("{} x {} x {} hex8", n[2], n[0], n[1]);
    let mut checks = Vec::new();
    for (i, g) in gravities.into_iter().enumerate() {
        let weight = |below: f64| DENSITY * width * width * below * STANDARD * g;
        let top = solved.support(i, "z_max").force[2];
        checks.push(solved.check(
            CASE,
            &name,
            format!("force at the top [N], {g} g"),
            [top, weight(length)],
            1e-4,
        ));
        for below in [0.18, 0.1, 0.02] {
            let cut = Cut { point: [0.0, 0.0, below], normal: [0.0, 0.0, 1.0], effects: Vec::new() };
            let section = section_force(&solved.plan, solved.at(i), &cut).along(cut.normal);
            let quantity = format!("section force [N] {:.0} mm from the top, {g} g", 1e3 * (length - below));
            checks.push(solved.check(CASE, &name, quantity, [section, weight(below)], 1e-4));
        }
        let low = solved.nodes("z_min");
        let elongation = -low.iter().map(|&n| solved.displacement(i, n)[2]).sum::<f64>() / low.len() as f64;
        let exact = MATRIX.hanging_elongation(length, STANDARD * g);
        let quantity = format!("elongation [mm], {g} g");
        checks.push(solved.check(CASE, &name, quantity, [1e3 * elongation, 1e3 * exact], 0.01));
    }
    Ok(checks)
}
