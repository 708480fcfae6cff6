//! The thigh as a unit: poses and activations in, forces, lever arms, wrenches and stiffness out.

use std::sync::Arc;

use coupling::session::{MuscleResult, PoseNumbers, ThighSession, ThighSide, as_pose};
use coupling::thigh::registration::BODIES;
use coupling::two_way::capacity::{BoneTwists, COORDINATES, MOVED};

use crate::error::UnitError;
use crate::side::Side;
use crate::variable::{ANY, Variable};

/// What a thigh says beyond the rest; each costs nothing where it is not asked for, and is computed when it is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Extras {
    /// Displacements of all nodes.
    pub displacements: bool,
    /// Stiffness of the tissue against every bone.
    pub stiffness: bool,
}

/// Inputs after the time: pose and twist of every bone, then these.
const ACTIVATION: usize = 1 + 2 * BODIES.len();
const KNEE_ARM: usize = ACTIVATION + 1;
/// First of the outputs, in the order of [`variables`].
const OUTPUTS: usize = KNEE_ARM + 1;

/// What an output is taken from, muscle by muscle.
type Read = fn(&MuscleResult) -> Vec<f64>;

/// Outputs per muscle, as [`variables`] lists them.
const OF_MUSCLES: [Read; 12] = [
    |m| vec![m.section.total],
    |m| vec![m.section.fibre],
    |m| vec![m.section.matrix],
    |m| vec![m.section.shell],
    |m| vec![m.stretch],
    |m| vec![m.tissue],
    |m| m.moments.to_vec(),
    |m| m.lever_arms.map(Option::unwrap_or_default).to_vec(),
    |m| m.lever_arms.map(|arm| f64::from(u8::from(arm.is_some()))).to_vec(),
    |m| vec![m.elongation],
    |m| vec![m.through_belly.unwrap_or(1.0)],
    |m| vec![f64::from(u8::from(m.through_belly.is_some()))],
];

/// An instance of the thigh.
pub struct ThighUnit {
    session: ThighSession,
    variables: Arc<Vec<Variable>>,
    extras: Extras,
    /// Values of the inputs.
    inputs: Vec<Vec<f64>>,
    /// Stiffness of the present state, once read.
    stiffness: Option<[[[f64; 6]; 6]; BODIES.len()]>,
}

/// What a master sees of a thigh.
pub fn variables(side: &ThighSide, extras: Extras) -> Vec<Variable> {
    let names: Vec<String> = side.muscles().map(str::to_string).collect();
    let (m, per_muscle) = (names.len(), format!("per muscle ({})", names.join(", ")));
    let moved = COORDINATES.join(", ");
    let mut all = vec![Variable::time()];
    for bone in BODIES {
        let rest = vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        all.push(Variable::input(format!("{bone}.pose"), &[7], "", rest, ANY, "Way of the bone from where the mesh has it, femur at rest: translation x, y, z in m, quaternion w, x, y, z"));
        all.push(Variable::input(format!("{bone}.twist"), &[MOVED, 6], "", vec![0.0; MOVED * 6], ANY, format!("Per joint coordinate ({moved}): velocity in m/rad of the point of the bone at the hip centre of the mesh, and angular velocity in rad/rad; moments and lever arms follow from it")));
    }
    all.push(Variable::input(
        "activation",
        &[m],
        "",
        vec![0.0; m],
        side.activation_range(),
        format!("Isometric activation of Hill fibres, contraction of thermal ones, {per_muscle}"),
    ));
    all.push(Variable::input("rigid_knee_arm", &[m], "m", vec![0.0; m], ANY, format!("Lever arm at the knee on the rigid leg, {per_muscle}: by it the moment of heads that are sewn together is shared out")));
    for (name, what) in [
        ("section_force", "Force through the belly"),
        ("fibre_force", "Fibres' part of section_force"),
        ("matrix_force", "Matrix's part of section_force"),
        ("shell_force", "Shell's part of section_force"),
    ] {
        all.push(Variable::output(name, &[m], "N", format!("{what}, {per_muscle}")));
    }
    all.push(Variable::output(
        "fibre_stretch",
        &[m],
        "",
        format!("Mean length of the fibres over that in the mesh, {per_muscle}"),
    ));
    all.push(Variable::output("tissue_force", &[m], "N", format!("Force of matrix and shell, {per_muscle}")));
    all.push(Variable::output("moment", &[m, MOVED], "N.m", format!("Moment, {per_muscle} about {moved}")));
    all.push(Variable::output(
        "lever_arm",
        &[m, MOVED],
        "m",
        format!("Lever arm, {per_muscle} about {moved}; 0 where lever_arm_known is false"),
    ));
    all.push(
        Variable::output(
            "lever_arm_known",
            &[m, MOVED],
            "",
            "Whether there is force enough to say a lever arm (20 N)",
        )
        .as_boolean(),
    );
    all.push(Variable::output("fibre_elongation", &[m], "m", format!("Change of length against the posture in which fibres are as long as the lines of the rigid leg, {per_muscle}; 0 without Hill fibres")));
    all.push(Variable::output("through_belly", &[m], "", format!("How much of the tension of the fibres comes through the belly, {per_muscle}; 1 where through_belly_known is false")));
    all.push(
        Variable::output(
            "through_belly_known",
            &[m],
            "",
            "Whether fibres pull hard enough to say fibre_elongation and through_belly (20 N)",
        )
        .as_boolean(),
    );
    for bone in BODIES {
        all.push(Variable::output(
            format!("{bone}.wrench"),
            &[6],
            "",
            "Force in N of the tissue on the bone, and its moment in N.m about the hip centre of the mesh",
        ));
    }
    all.push(Variable::names("muscles", names, "Names of the muscles"));
    if extras.stiffness {
        for bone in BODIES {
            all.push(Variable::output(format!("{bone}.dwrench_dtwist"), &[6, 6], "", "Derivative of the wrench (N, N.m) with respect to a small motion of the bone (m, rad about the hip centre of the mesh), all muscles in equilibrium, other bones held; computed when it is read"));
        }
    }
    if extras.displacements {
        all.push(Variable::output(
            "displacement",
            &[side.n_nodes(), 3],
            "m",
            "Displacement of every node of the mesh from where it was made",
        ));
    }
    all
}

impl ThighUnit {
    /// The mesh as it was made.
    pub fn new(side: Arc<ThighSide>, extras: Extras) -> ThighUnit {
        let variables = Arc::new(variables(&side, extras));
        let inputs = variables[..OUTPUTS].iter().map(|v| v.start.clone()).collect();
        ThighUnit { session: ThighSession::new(side), variables, extras, inputs, stiffness: None }
    }

    /// Hands inputs on that change what is measured, not what is solved.
    fn tell(&mut self) -> Result<(), UnitError> {
        let mut twists = BoneTwists::default();
        for (b, twist) in twists.iter_mut().enumerate() {
            twist.as_flattened_mut().copy_from_slice(&self.inputs[2 + 2 * b]);
        }
        self.session.set_twists(&twists)?;
        Ok(self.session.set_rigid_knee_arms(&self.inputs[KNEE_ARM])?)
    }
}

impl Side for ThighUnit {
    fn variables(&self) -> &Arc<Vec<Variable>> {
        &self.variables
    }

    fn get(&mut self, variable: usize) -> Result<Vec<f64>, UnitError> {
        if variable < OUTPUTS {
            return Ok(self.inputs[variable].clone());
        }
        let k = variable - OUTPUTS;
        if let Some(read) = OF_MUSCLES.get(k) {
            return Ok(self.session.result().muscles.iter().flat_map(read).collect());
        }
        let k = k - OF_MUSCLES.len();
        if k < BODIES.len() {
            return Ok(self.session.result().wrenches[k].to_vec());
        }
        // After the names.
        let k = k - BODIES.len() - 1;
        if self.extras.stiffness && k < BODIES.len() {
            let stiffness = match &self.stiffness {
                Some(known) => known,
                None => self.stiffness.insert(self.session.stiffness()?),
            };
            return Ok(stiffness[k].as_flattened().to_vec());
        }
        Ok(self.session.displacements())
    }

    fn set(&mut self, variable: usize, values: &[f64]) -> Result<(), UnitError> {
        let is_pose = variable % 2 == 1 && variable < ACTIVATION;
        if let (true, Ok(pose)) = (is_pose, PoseNumbers::try_from(values)) {
            as_pose(&pose)
                .map_err(|why| UnitError::Wrong(format!("{}: {why}", self.variables[variable].name)))?;
        }
        self.inputs[variable] = values.to_vec();
        Ok(())
    }

    fn start(&mut self, time: f64) -> Result<(), UnitError> {
        self.tell()?;
        Ok(self.session.set_time(time)?)
    }

    fn step(&mut self, to: f64) -> Result<(), UnitError> {
        let pose =
            |b: usize| PoseNumbers::try_from(self.inputs[1 + 2 * b].as_slice()).expect("seven numbers");
        let poses: Vec<PoseNumbers> = (0..BODIES.len()).map(pose).collect();
        self.session.set_poses(&poses)?;
        self.session.set_activations(&self.inputs[ACTIVATION])?;
        self.session.solve()?;
        self.stiffness = None;
        self.tell()?;
        Ok(self.session.set_time(to)?)
    }

    fn next_between(&self, _from: f64, _to: f64) -> Option<f64> {
        None
    }

    fn reset(&mut self) {
        *self = ThighUnit::new(self.session.side().clone(), self.extras);
    }

    fn save(&self) -> Vec<u8> {
        crate::side::with_inputs(&self.inputs, &self.session.save())
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), UnitError> {
        let (inputs, rest) = crate::side::inputs_of(state, &self.inputs, &self.variables)?;
        self.session.restore(rest)?;
        (self.inputs, self.stiffness) = (inputs, None);
        Ok(())
    }

    fn key(&self) -> &str {
        self.session.side().key()
    }
}
