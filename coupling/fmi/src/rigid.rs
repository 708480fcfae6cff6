//! The rigid leg as a unit: time in, postures, forces and lever arms out, capacities of the muscles in.

use std::sync::Arc;

use coupling::session::{RigidResult, RigidSession, RigidSide};
use coupling::thigh::registration::BODIES;
use coupling::two_way::capacity::{COORDINATES, MOVED, MuscleCapacity};

use crate::error::UnitError;
use crate::side::Side;
use crate::variable::{ANY, Variable};

/// Inputs, in their order after the time.
const WITH_CAPACITY: usize = 1;
const ELONGATION: usize = 2;
const TISSUE: usize = 3;
const THROUGH_BELLY: usize = 4;
const LEVER_ARM: usize = 5;
/// First of the outputs, in the order of [`variables`].
const OUTPUTS: usize = 6;

/// An instance of the rigid leg.
pub struct RigidUnit {
    session: RigidSession,
    variables: Arc<Vec<Variable>>,
    /// Values of the inputs.
    inputs: Vec<Vec<f64>>,
}

/// What an output is taken from.
type Read = fn(&RigidResult, usize) -> Vec<f64>;

/// Outputs of every bone, then the rest, as [`variables`] lists them.
const OF_BONES: [Read; 2] = [|r, b| r.poses[b].to_vec(), |r, b| r.twists[b].as_flattened().to_vec()];
const OF_LEG: [Read; 14] = [
    |r, _| vec![r.time],
    |r, _| vec![f64::from(u8::from(r.is_feasible))],
    |r, _| r.angles.clone(),
    |r, _| r.forces.clone(),
    |r, _| r.activations.clone(),
    |r, _| r.lengths.clone(),
    |r, _| r.lever_arms.clone(),
    |r, _| r.muscle_forces.clone(),
    |r, _| r.tensions.clone(),
    |r, _| r.drives.clone(),
    |r, _| r.nominal.iter().map(|c| c.shift).collect(),
    |r, _| r.nominal.iter().map(|c| c.tissue).collect(),
    |r, _| r.nominal.iter().map(|c| c.through_belly).collect(),
    |r, _| r.nominal.iter().flat_map(|c| c.lever_arms).collect(),
];

/// What a master sees of a rigid leg.
pub fn variables(side: &RigidSide) -> Vec<Variable> {
    let (m, muscles) = (side.muscles().len(), side.muscles().join(", "));
    let n = side.lines().count();
    let coordinates = side.coordinates();
    let per_muscle = format!("per muscle of the thigh ({muscles})");
    let moved = COORDINATES.join(", ");
    let mut all = vec![Variable::time()];
    all.push(Variable::input("with_capacity", &[], "", vec![0.0], [0.0, 1.0], "Whether forces are shared among muscles of the capacity that the next inputs say; otherwise those are left alone").as_boolean());
    all.push(Variable::input(
        "fibre_elongation",
        &[m],
        "m",
        vec![0.0; m],
        ANY,
        format!("Change of length against the posture of the mesh, {per_muscle}"),
    ));
    all.push(Variable::input(
        "tissue_force",
        &[m],
        "N",
        vec![0.0; m],
        ANY,
        format!("Force of matrix and shell, {per_muscle}"),
    ));
    all.push(Variable::input(
        "through_belly",
        &[m],
        "",
        vec![1.0; m],
        [f64::MIN_POSITIVE, f64::INFINITY],
        format!("How much of the tension of the fibres comes through the belly, {per_muscle}"),
    ));
    all.push(Variable::input(
        "thigh_lever_arm",
        &[m, MOVED],
        "m",
        vec![0.0; m * MOVED],
        ANY,
        format!("Lever arms, {per_muscle} about {moved}"),
    ));
    for bone in BODIES {
        all.push(Variable::output(format!("{bone}.pose"), &[7], "", "Way of the bone from where the mesh has it, femur at rest: translation x, y, z in m, quaternion w, x, y, z"));
        all.push(Variable::output(format!("{bone}.twist"), &[MOVED, 6], "", format!("Per joint coordinate ({moved}): velocity in m/rad of the point of the bone at the hip centre of the mesh, and angular velocity in rad/rad, femur at rest")));
    }
    all.push(Variable::output(
        "frame_time",
        &[],
        "s",
        "Time of the frame of the trial that is told: the nearest one",
    ));
    all.push(
        Variable::output(
            "feasible",
            &[],
            "",
            "Whether forces within their bounds carry the load; otherwise those of least violation are told",
        )
        .as_boolean(),
    );
    all.push(Variable::output(
        "joint_angle",
        &[side.angles().len()],
        "rad",
        format!("Joint angles: {}", side.angles().join(", ")),
    ));
    all.push(Variable::output("force", &[n], "N", "Tension, per line of the leg as `lines` names them"));
    all.push(Variable::output("activation", &[n], "", "Activation, per line"));
    all.push(Variable::output(
        "length",
        &[n],
        "m",
        "Length of muscle and tendon on the generic leg at these joint angles, per line",
    ));
    all.push(Variable::output(
        "lever_arm",
        &[n, coordinates.len()],
        "m",
        format!("Lever arms, per line about {}", coordinates.join(", ")),
    ));
    all.push(Variable::output("muscle_force", &[m], "N", format!("Force along the belly, {per_muscle}")));
    all.push(Variable::output(
        "muscle_tension",
        &[m],
        "N",
        format!("Sum of the tensions of the lines, {per_muscle}"),
    ));
    all.push(Variable::output("drive", &[m], "", format!("What drives the fibres of the thigh, {per_muscle}: isometric activation of Hill fibres, contraction of thermal ones")));
    all.push(Variable::output(
        "nominal_fibre_elongation",
        &[m],
        "m",
        format!("fibre_elongation before the thigh has said anything, {per_muscle}"),
    ));
    all.push(Variable::output(
        "nominal_tissue_force",
        &[m],
        "N",
        "tissue_force before the thigh has said anything",
    ));
    all.push(Variable::output(
        "nominal_through_belly",
        &[m],
        "",
        "through_belly before the thigh has said anything",
    ));
    all.push(Variable::output("nominal_lever_arm", &[m, MOVED], "m", format!("Lever arms of the rigid leg, mean over the lines weighted with their strength, {per_muscle} about {moved}")));
    all.push(Variable::names("muscles", side.muscles().to_vec(), "Names of the muscles of the thigh"));
    all.push(Variable::names(
        "lines",
        side.lines().map(str::to_string).collect(),
        "Names of the lines of the leg",
    ));
    all
}

impl RigidUnit {
    /// At the first frame of the trial.
    pub fn new(side: Arc<RigidSide>) -> RigidUnit {
        let variables = Arc::new(variables(&side));
        let inputs = variables[..OUTPUTS].iter().map(|v| v.start.clone()).collect();
        RigidUnit { session: RigidSession::new(side), variables, inputs }
    }

    /// What the muscles can do, as the inputs say.
    fn capacities(&self) -> Option<Vec<MuscleCapacity>> {
        let of = |m: usize| MuscleCapacity {
            shift: self.inputs[ELONGATION][m],
            tissue: self.inputs[TISSUE][m],
            through_belly: self.inputs[THROUGH_BELLY][m],
            lever_arms: std::array::from_fn(|c| self.inputs[LEVER_ARM][MOVED * m + c]),
        };
        (self.inputs[WITH_CAPACITY][0] != 0.0).then(|| (0..self.inputs[TISSUE].len()).map(of).collect())
    }
}

impl Side for RigidUnit {
    fn variables(&self) -> &Arc<Vec<Variable>> {
        &self.variables
    }

    fn get(&mut self, variable: usize) -> Result<Vec<f64>, UnitError> {
        if variable < OUTPUTS {
            return Ok(self.inputs[variable].clone());
        }
        let (k, bones) = (variable - OUTPUTS, OF_BONES.len() * BODIES.len());
        let result = self.session.result()?;
        Ok(match k.checked_sub(bones) {
            None => OF_BONES[k % OF_BONES.len()](result, k / OF_BONES.len()),
            Some(k) => OF_LEG[k](result, 0),
        })
    }

    fn set(&mut self, variable: usize, values: &[f64]) -> Result<(), UnitError> {
        self.inputs[variable] = values.to_vec();
        Ok(())
    }

    fn start(&mut self, time: f64) -> Result<(), UnitError> {
        self.step(time)
    }

    fn step(&mut self, to: f64) -> Result<(), UnitError> {
        self.session.set_capacities(self.capacities().as_deref())?;
        Ok(self.session.go_to(to)?)
    }

    fn next_between(&self, from: f64, to: f64) -> Option<f64> {
        self.session.side().times().iter().copied().find(|t| *t > from && *t < to)
    }

    fn reset(&mut self) {
        *self = RigidUnit::new(self.session.side().clone());
    }

    fn save(&self) -> Vec<u8> {
        crate::side::with_inputs(&self.inputs, &self.session.save())
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), UnitError> {
        let (inputs, rest) = crate::side::inputs_of(state, &self.inputs, &self.variables)?;
        self.session.restore(rest)?;
        self.inputs = inputs;
        Ok(())
    }

    fn key(&self) -> &str {
        self.session.side().key()
    }
}
