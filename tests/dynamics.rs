//! Are loads, lever arms and joint forces what mechanics says they are?

#![allow(non_snake_case)]

use multibody::anatomy::rotation;
use multibody::dynamics::{GRAVITY, GroundLoad, LegForce, add_wrench, leg_load};
use multibody::equilibrium::equilibrium;
use multibody::ik::joint_residual;
use multibody::joint::{Equation, Force};
use multibody::model::{Ankle, Model};
use multibody::muscle::path::knee_angle;
use multibody::natural::{Coordinates, Pose, SegmentId, block};
use multibody::tangent::Tangent;
use multibody::walker::{Knee, walker};
use nalgebra::{DMatrix, DVector, Vector3};
use support::{Random, taylor_order};

const LEG: [SegmentId; 4] = [SegmentId::Foot, SegmentId::Shank, SegmentId::Patella, SegmentId::Thigh];

fn model(ankle: Ankle) -> (Model, Vec<Coordinates>) {
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = Model::new(&trial, anatomy, ankle).unwrap();
    let frames = multibody::ik::fit(&model, &trial);
    // Eight postures over the cycle.
    let postures = (0..8).map(|k| frames[trial.report.start + 12 * k].Q).collect();
    (model, postures)
}

/// A random rigid state: poses, turn rates and accelerations, as natural coordinates and their derivatives.
struct State {
    Q: Coordinates,
    Qd: Coordinates,
    Qdd: Coordinates,
    poses: Vec<Pose>,
    /// (ω, ω̇, velocity and acceleration of rP) per segment.
    rates: Vec<[Vector3<f64>; 4]>,
}

fn random_state(model: &Model, random: &mut Random) -> State {
    let (mut Q, mut Qd, mut Qdd) = (Coordinates::zeros(), Coordinates::zeros(), Coordinates::zeros());
    let (mut poses, mut rates) = (Vec::new(), Vec::new());
    for segment in SegmentId::ALL {
        let pose = Pose { R: rotation(&random.vector(3.0)), p: random.vector(1.0) };
        let [omega, omega_dot, v, a] = [5.0, 30.0, 2.0, 20.0].map(|size| random.vector(size));
        let shape = &model.shapes[segment.index()];
        shape.write(segment, &pose, &mut Q);
        for (k, (local, origin)) in shape.local_blocks().iter().enumerate() {
            let e = pose.R * local;
            let b = 3 * segment.block(k);
            Qd.fixed_rows_mut::<3>(b).copy_from(&(omega.cross(&e) + *origin * v));
            let spin = omega_dot.cross(&e) + omega.cross(&omega.cross(&e));
            Qdd.fixed_rows_mut::<3>(b).copy_from(&(spin + *origin * a));
        }
        poses.push(pose);
        rates.push([omega, omega_dot, v, a]);
    }
    State { Q, Qd, Qdd, poses, rates }
}

#[test]
fn kinetic_energy_is_that_of_the_rigid_body() {
    let (model, _) = model(Ankle::Universal);
    let mut random = Random::new(1);
    for _ in 0..100 {
        let state = random_state(&model, &mut random);
        for (segment, inertia) in LEG.iter().zip(&model.inertia) {
            let natural: f64 = (0..4)
                .flat_map(|a| (0..4).map(move |b| (a, b)))
                .map(|(a, b)| {
                    let part = |k: usize| block(&state.Qd, segment.block(k));
                    0.5 * inertia.G[(a, b)] * part(a).dot(&part(b))
                })
                .sum();
            let [omega, _, v, _] = state.rates[segment.index()];
            let R = state.poses[segment.index()].R;
            let centre = v + omega.cross(&(R * inertia.com));
            let local = R.transpose() * omega;
            let rigid =
                0.5 * inertia.mass * centre.norm_squared() + 0.5 * local.dot(&(inertia.tensor * local));
            assert!((natural - rigid).abs() < 1e-12 * rigid.max(1e-3), "{segment:?}: {natural} {rigid}");
        }
    }
}

#[test]
fn loads_equal_newton_and_euler() {
    let (model, _) = model(Ankle::Universal);
    let mut random = Random::new(2);
    for _ in 0..100 {
        let state = random_state(&model, &mut random);
        let ground = GroundLoad { force: random.vector(900.0), moment: random.vector(300.0) };
        let load = leg_load(&model, &state.Q, &state.Qdd, &ground);
        for (segment, inertia) in LEG.iter().zip(&model.inertia) {
            // Force and moment about rP from the blocks: virtual work of a shift and of a turn.
            let Pose { R, p } = state.poses[segment.index()];
            let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
            for (k, (local, origin)) in model.shapes[segment.index()].local_blocks().iter().enumerate() {
                let part = Vector3::from(load.fixed_rows::<3>(3 * segment.block(k)));
                force += *origin * part;
                moment += (R * local).cross(&part);
            }
            let [omega, omega_dot, _, a] = state.rates[segment.index()];
            let arm = R * inertia.com;
            let centre = a + omega_dot.cross(&arm) + omega.cross(&omega.cross(&arm));
            let tensor = R * inertia.tensor * R.transpose();
            let mut newton = inertia.mass * (centre - GRAVITY);
            let mut euler = tensor * omega_dot + omega.cross(&(tensor * omega)) + arm.cross(&newton);
            if *segment == SegmentId::Foot {
                newton -= ground.force;
                euler -= ground.moment - p.cross(&ground.force);
            }
            let scale = 1e-9 * (newton.norm() + euler.norm());
            assert!((force - newton).norm() < scale, "{segment:?} force {force} {newton}");
            assert!((moment - euler).norm() < scale, "{segment:?} moment {moment} {euler}");
        }
    }
}

/// All 42 or 43 equations of the leg as the publication has them: joints, then six rigid rows per leg segment.
fn all_equations(model: &Model, Q: &Coordinates) -> Vec<f64> {
    let mut phi = joint_residual(&model.equations, Q);
    for segment in LEG {
        let [u, rP, rD, w] = [0, 1, 2, 3].map(|k| block(Q, segment.block(k)));
        let v = rP - rD;
        phi.extend([u.dot(&u), u.dot(&v), u.dot(&w), v.dot(&v), v.dot(&w), w.dot(&w)]);
    }
    phi
}

/// Jacobian by central differences; exact to round-off because the equations are quadratic.
fn jacobian(model: &Model, Q: &Coordinates) -> DMatrix<f64> {
    let n = all_equations(model, Q).len();
    let mut K = DMatrix::zeros(n, 48);
    let h = 0.5;
    for c in 0..48 {
        let (mut a, mut b) = (*Q, *Q);
        a[c] += h;
        b[c] -= h;
        let (fa, fb) = (all_equations(model, &a), all_equations(model, &b));
        (0..n).for_each(|r| K[(r, c)] = (fa[r] - fb[r]) / (2.0 * h));
    }
    K
}

#[test]
fn joint_forces_balance_the_full_equations() {
    for ankle in [Ankle::Universal, Ankle::Parallel] {
        let (model, postures) = model(ankle);
        let mut random = Random::new(3);
        for Q in &postures {
            let load = LegForce::from_fn(|_, _| 100.0 * random.uniform());
            let reduced = equilibrium(&model, Q, &load).unwrap();
            // Any muscle forces that meet the moments: minimum-norm solution of R f = tau.
            let svd = reduced.lever_arms.clone().svd(true, true);
            let f = svd.solve(&reduced.moments, 1e-12).unwrap();
            let x = &reduced.reaction_without + &reduced.reaction_per_force * &f;

            // K^T λ = L f − load with all multipliers, in the least-squares sense.
            let mut rhs = -DVector::from_column_slice(load.as_slice());
            let fe = knee_angle(&model.shapes, Q);
            for (muscle, tension) in model.muscles.iter().zip(&f) {
                muscle.unit_force(Q, fe, |b, e| {
                    if b < 16 {
                        let mut part = rhs.fixed_rows_mut::<3>(3 * b);
                        part += *tension * e;
                    }
                });
            }
            let K_t = jacobian(&model, Q).transpose();
            let svd = K_t.clone().svd(true, true);
            let lambda = svd.solve(&rhs, 1e-13).unwrap();
            let residual = (&K_t * &lambda - &rhs).norm() / rhs.norm();
            assert!(residual < 1e-9, "{ankle:?}: the load is not balanced, {residual:.1e}");

            // Wanted multipliers, scaled and signed as in the publication's table.
            let mut wanted = Vec::new();
            let mut row = 0;
            for equation in &model.equations {
                match equation {
                    Equation::Coincide { distal, .. } => {
                        let force = Vector3::from(lambda.fixed_rows::<3>(row));
                        wanted.extend((-(model.pose(*distal, Q).R.transpose() * force)).iter());
                    }
                    Equation::Product { force: Force::Contact(_), .. } => wanted.push(-lambda[row]),
                    Equation::Product { force: Force::Tension(_, d), .. } => {
                        wanted.push(2.0 * d * lambda[row])
                    }
                    Equation::Product { force: Force::None, .. } => {}
                }
                row += equation.n_rows();
            }
            for segment in LEG {
                wanted.push(-2.0 * model.shapes[segment.index()].L * lambda[row + 3]);
                row += 6;
            }
            for (k, (got, want)) in x.iter().zip(&wanted).enumerate() {
                assert!(
                    (got - want).abs() < 1e-7 * (1.0 + want.abs()),
                    "{ankle:?} reaction {k}: {got} {want}"
                );
            }
        }
    }
}

/// Moves the leg by `step` of one joint coordinate: along the tangent, then back onto the joint equations with the pelvis
/// still and all coordinates unchanged to first order.
fn moved(
    model: &Model,
    Q: &Coordinates,
    tangent: &DMatrix<f64>,
    coordinate: usize,
    step: f64,
) -> Coordinates {
    let mut moved = *Q;
    (0..48).for_each(|r| moved[r] += step * tangent[(r, coordinate)]);
    for _ in 0..20 {
        let phi = all_equations(model, &moved);
        let reference = {
            let mut constants = vec![0.0; phi.len()];
            let joints = model.n_joint_rows();
            constants[joints..].copy_from_slice(&all_equations(model, Q)[joints..]);
            constants
        };
        let residual = DVector::from_iterator(phi.len(), phi.iter().zip(&reference).map(|(a, b)| a - b));
        if residual.norm() < 1e-15 {
            break;
        }
        let K = jacobian(model, &moved);
        let correction = K.svd(true, true).solve(&residual, 1e-13).unwrap();
        (0..48).for_each(|r| moved[r] -= correction[r]);
    }
    moved
}

#[test]
fn lever_arms_are_minus_the_change_of_length() {
    for ankle in [Ankle::Universal, Ankle::Parallel] {
        let (model, postures) = model(ankle);
        let names = model.coordinate_names();
        for Q in &postures {
            let reduced = equilibrium(&model, Q, &LegForce::zeros()).unwrap();
            for c in 0..names.len() {
                let h = 1e-4;
                let [ahead, behind] = [h, -h].map(|s| moved(&model, Q, &reduced.tangent, c, s));
                // The same conditional points on both sides.
                let fe = knee_angle(&model.shapes, Q);
                for (k, muscle) in model.muscles.iter().enumerate() {
                    let slope = (muscle.length(&ahead, fe) - muscle.length(&behind, fe)) / (2.0 * h);
                    let arm = reduced.lever_arms[(c, k)];
                    assert!((arm + slope).abs() < 1e-5, "{} {}: {arm} {slope}", muscle.name, names[c]);
                }
            }
        }
    }
}

#[test]
fn lever_arms_on_both_sides_of_every_conditional_point() {
    let (model, postures) = model(Ankle::Universal);
    // Flex the knee in the model along its own path, posture by posture, through every switch.
    let mut Q = postures[0];
    let knee = 3;
    let mut switches: Vec<f64> = model
        .muscles
        .iter()
        .flat_map(|m| &m.path)
        .flat_map(|p| [p.active.start, p.active.end])
        .filter(|v| v.is_finite())
        .collect();
    switches.sort_by(f64::total_cmp);
    switches.dedup();
    assert_eq!(switches.len(), 6, "{switches:?}");
    let mut crossed = 0;
    while knee_angle(&model.shapes, &Q) > -2.0 {
        let before = knee_angle(&model.shapes, &Q);
        let reduced = equilibrium(&model, &Q, &LegForce::zeros()).unwrap();
        let next = moved(&model, &Q, &reduced.tangent, knee, 0.01);
        let after = knee_angle(&model.shapes, &next);
        if switches.iter().any(|&s| after < s && s <= before) {
            crossed += 1;
            for at in [&Q, &next] {
                let reduced = equilibrium(&model, at, &LegForce::zeros()).unwrap();
                let h = 1e-4;
                let fe = knee_angle(&model.shapes, at);
                let [ahead, behind] = [h, -h].map(|s| moved(&model, at, &reduced.tangent, knee, s));
                for (k, muscle) in model.muscles.iter().enumerate() {
                    let slope = (muscle.length(&ahead, fe) - muscle.length(&behind, fe)) / (2.0 * h);
                    let arm = reduced.lever_arms[(knee, k)];
                    assert!((arm + slope).abs() < 1e-5, "{}: {arm} {slope}", muscle.name);
                }
            }
        }
        Q = next;
    }
    assert_eq!(crossed, switches.len());
}

#[test]
fn projected_rates_satisfy_the_equations_and_change_little_else() {
    let (model, postures) = model(Ankle::Universal);
    let mut random = Random::new(4);
    for Q in &postures {
        let rough = Coordinates::from_fn(|_, _| random.uniform());
        let tangent = Tangent::new(&model, Q);
        let (Qd, twists) = tangent.project_velocity(&rough).unwrap();
        let Qdd = tangent.project_acceleration(&(10.0 * rough), &twists).unwrap();
        // Along the curve Q + t Qd + t²/2 Qdd all equations stay zero to third order.
        let drift = |t: f64| {
            let at = Q + t * Qd + 0.5 * t * t * Qdd;
            let (a, b) = (all_equations(&model, &at), all_equations(&model, Q));
            a.iter().zip(&b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
        };
        let order = (drift(2e-3) / drift(1e-3)).log2();
        assert!(order > 2.9, "order {order}");
        // Orthogonal: what was removed is perpendicular to what stays.
        assert!((rough - Qd).dot(&Qd).abs() < 1e-10 * rough.norm_squared());
    }
}

#[test]
fn a_wrench_does_the_work_of_its_force_and_moment() {
    let (model, _) = model(Ankle::Universal);
    let mut random = Random::new(5);
    for _ in 0..50 {
        let state = random_state(&model, &mut random);
        let (force, moment) = (random.vector(100.0), random.vector(100.0));
        let mut load = LegForce::zeros();
        add_wrench(&mut load, &state.Q, SegmentId::Shank, &force, &moment);
        let power: f64 = (0..48).map(|k| load[k] * state.Qd[k]).sum();
        let [omega, _, v, _] = state.rates[SegmentId::Shank.index()];
        let want = force.dot(&v) + moment.dot(&omega);
        assert!((power - want).abs() < 1e-9 * (force.norm() + moment.norm()), "{power} {want}");
    }
}

#[test]
fn joint_jacobians_are_derivatives() {
    for ankle in [Ankle::Universal, Ankle::Parallel] {
        let (model, postures) = model(ankle);
        let mut random = Random::new(6);
        for Q in &postures {
            let direction = Coordinates::from_fn(|_, _| random.uniform());
            let mut row = 0;
            for equation in &model.equations {
                let mut slopes = vec![0.0; equation.n_rows()];
                equation.jacobian(Q, &mut |k, b, d| slopes[k] += d.dot(&block(&direction, b)));
                for (k, slope) in slopes.into_iter().enumerate() {
                    let along = |h: f64| {
                        let mut phi = Vec::new();
                        equation.residual(&(Q + h * direction), &mut phi);
                        phi[k]
                    };
                    assert!(taylor_order(along, slope, 1e-2) > 1.9, "{ankle:?} row {}", row + k);
                }
                row += equation.n_rows();
            }
        }
    }
}

#[test]
fn inertia_tensors_are_physical() {
    let (model, _) = model(Ankle::Universal);
    for inertia in &model.inertia {
        let principal = inertia.tensor.symmetric_eigenvalues();
        let (least, largest, sum) = (principal.min(), principal.max(), principal.sum());
        assert!(least >= 0.0 && 2.0 * largest <= sum + 1e-12, "{principal}");
    }
}
