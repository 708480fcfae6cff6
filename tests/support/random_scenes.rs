//! Small finite-element scenes with wild inputs, the same for the same seed.

use crate::Random;
use fem::body::Pose;
use fem::material::line::FibreStrain;
use fem::mesh::{CellBlock, CellKind, Mesh, generate};
use fem::scene::*;
use fem::solve::{Settings, Stability};
use nalgebra::{Translation3, UnitQuaternion, Vector3};

/// A scene with what drives it.
pub struct RandomScene {
    /// The scene.
    pub scene: Scene,
    /// Its mesh.
    pub mesh: Mesh,
    /// Times \[s\], controls and poses of the frames.
    pub frames: Vec<Target>,
    /// Settings of the solver.
    pub settings: Settings,
    /// What it is made of, in a few words.
    pub what: String,
}

/// A frame to go to.
pub struct Target {
    /// Time \[s\].
    pub time: f64,
    /// Values of controls.
    pub controls: Vec<(&'static str, f64)>,
    /// Poses of bodies.
    pub poses: Vec<(&'static str, Pose)>,
}

/// One of `list`.
fn pick<T: Clone>(random: &mut Random, list: &[T]) -> T {
    list[random.below(list.len())].clone()
}

/// What is known while a scene is being made.
struct Maker {
    random: Random,
    out: RandomScene,
    /// A typical Young's modulus \[Pa\] and the length of the mesh \[m\].
    young: f64,
    size: f64,
    /// Least and greatest value of each control.
    ranges: Vec<(&'static str, f64, f64)>,
    bodies: Vec<(&'static str, Vector3<f64>)>,
}

/// The scene of a seed.
pub fn random_scene(seed: u64) -> RandomScene {
    let mut random = Random::new(seed);
    let size = if random.chance(0.7) { random.power(-2.5, 0.0) } else { random.power(-7.0, 5.0) };
    let young = if random.chance(0.7) { random.power(3.0, 6.0) } else { random.power(-4.0, 12.0) };
    let out = RandomScene {
        scene: Scene::default(),
        mesh: Mesh::default(),
        frames: Vec::new(),
        settings: Settings::default(),
        what: String::new(),
    };
    let mut maker = Maker { random, out, young, size, ranges: Vec::new(), bodies: Vec::new() };
    if maker.random.chance(0.15) {
        maker.two_blocks();
    } else {
        maker.one_body();
    }
    maker.drive();
    maker.settings();
    if maker.random.chance(0.06) {
        maker.nonsense();
    }
    maker.out
}

impl Maker {
    fn say(&mut self, text: impl AsRef<str>) {
        if !self.out.what.is_empty() {
            self.out.what.push_str(", ");
        }
        self.out.what.push_str(text.as_ref());
    }

    /// A vector of as many lengths of the mesh as 10 to a power in `low`..`high` says.
    fn vector(&mut self, low: f64, high: f64) -> Vector3<f64> {
        let reach = self.size * self.random.power(low, high);
        self.random.vector(reach)
    }

    /// A control with its range of values; the same name twice keeps the first range.
    fn control(&mut self, name: &'static str, low: f64, high: f64) -> String {
        if !self.ranges.iter().any(|r| r.0 == name) {
            self.ranges.push((name, low, high));
        }
        name.to_string()
    }

    fn law(&mut self) -> LawSpec {
        let young = self.young * self.random.power(-0.5, 0.5);
        let nu = pick(&mut self.random, &[0.0, 0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999, -0.4]);
        let mu = young / (2.0 * (1.0 + nu));
        let bulk = young / (3.0 * (1.0 - 2.0 * nu));
        match self.random.below(8) {
            0 => LawSpec::NeoHookean { young, nu },
            1 => LawSpec::NeoHookeanUncoupled { mu, bulk },
            2 => {
                let fraction = self.random.between(-0.3, 1.0);
                LawSpec::MooneyRivlin { c10: 0.5 * mu * fraction, c01: 0.5 * mu * (1.0 - fraction), bulk }
            }
            3 => LawSpec::MooneyRivlinDyna { a: 0.4 * mu, b: 0.1 * mu, nu: nu.abs() },
            4 => LawSpec::StableNeoHookean { young, nu: nu.abs() },
            5 => LawSpec::StVenantKirchhoff { young, nu },
            6 => LawSpec::LinearElastic { young, nu },
            _ => {
                let uniform = self.random.vector(1.0).into();
                let hexahedra = self.out.mesh.blocks[0].kind == CellKind::Hex8;
                let axis = self.random.below(3);
                let fibres = match hexahedra && self.random.chance(0.4) {
                    true => FibreDirection::CellAxis(axis),
                    false => FibreDirection::Uniform(uniform),
                };
                LawSpec::Blemker {
                    g1: mu,
                    g2: mu * self.random.power(-1.0, 1.0),
                    bulk,
                    sigma_max: young * self.random.power(-2.0, 1.0),
                    lambda_ofl: self.random.between(0.8, 1.4),
                    fibres,
                    activation: Some(self.control("activation", 0.0, 1.0)),
                }
            }
        }
    }

    fn solid(&mut self, region: &str) {
        let law = self.law();
        let mut spec = SolidSpec::new(region, law);
        spec.formulation = pick(
            &mut self.random,
            &[None, Some(FormulationSpec::Plain), Some(FormulationSpec::MeanDilatation)],
        );
        spec.density = if self.random.chance(0.8) { 1060.0 } else { self.random.power(-3.0, 6.0) };
        let n_cells = self.out.mesh.blocks.iter().find(|b| b.name == region).map_or(0, CellBlock::n_cells);
        if self.random.chance(0.15) {
            spec.scale = (0..n_cells).map(|_| self.random.power(-2.0, 2.0)).collect();
        }
        let debug = format!("{:?}", spec.law);
        let name = debug.split([' ', '{']).next().unwrap_or_default().to_string();
        let kind = self.out.mesh.blocks.iter().find(|b| b.name == region).map(|b| b.kind);
        let formulation =
            spec.formulation.map_or("", |f| if f == FormulationSpec::Plain { " plain" } else { " mean" });
        self.say(format!("{name} {:?}{formulation}", kind.expect("a block")));
        self.out.scene.solids.push(spec);
    }

    /// A box of cells of some kind, sheared and jittered.
    fn block(&mut self) -> ([usize; 3], Mesh) {
        let kind = self.random.below(5);
        let most = if kind > 1 { 2 } else { 3 };
        let n = [2, 1, 1].map(|least| self.random.integer(least, most));
        let size: [f64; 3] =
            std::array::from_fn(|d| self.size * n[d] as f64 / 3.0 * self.random.power(-0.3, 0.3));
        let mut mesh = generate::block(n, size);
        mesh = match kind {
            0 | 1 => mesh,
            2 => generate::tetrahedra(&mesh, false),
            3 => generate::tetrahedra(&mesh, true),
            _ => generate::wedges(&mesh),
        };
        (n, mesh)
    }

    /// Jitter, turn and shift of the whole mesh.
    fn place(&mut self) {
        if self.random.chance(0.5) {
            let edges: Vec<f64> = self.shortest_edges();
            let fraction = self.random.between(0.0, 0.2);
            for (p, edge) in self.out.mesh.points.iter_mut().zip(edges) {
                let by = self.random.vector(fraction * edge);
                (0..3).for_each(|c| p[c] += by[c]);
            }
        }
        if self.random.chance(0.3) && self.out.scene.planes.is_empty() {
            let turn = UnitQuaternion::from_scaled_axis(self.random.vector(3.0));
            self.out.mesh.points.iter_mut().for_each(|p| *p = (turn * Vector3::from(*p)).into());
        }
        if self.random.chance(0.3) {
            let reach = (self.size * self.random.power(0.0, 10.0)).min(1e9);
            let far = self.random.vector(reach);
            self.out.mesh.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += far[c]));
            self.say(format!("{:.0e} lengths away", far.norm() / self.size));
        }
    }

    fn shortest_edges(&self) -> Vec<f64> {
        let mesh = &self.out.mesh;
        let mut shortest = vec![f64::INFINITY; mesh.points.len()];
        for cell in mesh.blocks.iter().filter(|b| b.kind.is_solid()).flat_map(|b| b.cells()) {
            for (&a, &b) in cell.iter().flat_map(|a| cell.iter().map(move |b| (a, b))).filter(|(a, b)| a != b)
            {
                let (p, q) = (Vector3::from(mesh.points[a as usize]), Vector3::from(mesh.points[b as usize]));
                shortest[a as usize] = shortest[a as usize].min((p - q).norm());
            }
        }
        // Nodes between the corners of quadratic cells stay in the middle.
        let quadratic = mesh.blocks.iter().any(|b| b.kind == CellKind::Tet10);
        shortest.iter().map(|s| if quadratic || !s.is_finite() { 0.0 } else { *s }).collect()
    }

    fn held(&self, nodes: &str, components: [bool; 3]) -> PrescribedSpec {
        PrescribedSpec { nodes: nodes.into(), components, displacement: Vec::new(), control: None }
    }

    fn one_body(&mut self) {
        let octant = self.random.chance(0.12);
        let n = if octant {
            let thick = self.random.between(0.1, 1.0);
            let (patch, wall) = (1 + self.random.below(2), 1 + self.random.below(2));
            self.out.mesh = generate::sphere_octant(self.size, self.size * (1.0 + thick), patch, wall);
            [0; 3]
        } else {
            let (n, mesh) = self.block();
            self.out.mesh = mesh;
            n
        };
        let region = self.out.mesh.blocks[0].name.clone();
        self.solid(&region);
        if octant {
            self.octant();
        } else {
            self.supports();
            self.extras(n);
        }
        if self.random.chance(0.3) {
            let g = self.young / (1060.0 * self.size) * self.random.power(-6.0, 0.5);
            let acceleration = (self.random.vector(1.0).normalize() * g).into();
            let control = self.control("load", -1.0, 1.0);
            self.out.scene.gravity = Some(GravitySpec { acceleration, control });
            self.say("gravity");
        }
        if !octant && self.random.chance(0.12) {
            let speed = (self.young / 1060.0).sqrt() * self.random.power(-4.0, 0.0);
            let velocity = self.random.vector(speed).into();
            self.out.scene.inertia =
                Some(InertiaSpec { velocities: vec![VelocitySpec { region, velocity }] });
            self.say("inertia");
        }
        if !octant {
            self.place();
        }
    }

    /// An octant of a hollow sphere under pressure inside.
    fn octant(&mut self) {
        for (d, set) in ["x_min", "y_min", "z_min"].into_iter().enumerate() {
            let held = self.held(set, std::array::from_fn(|c| c == d));
            self.out.scene.prescribed.push(held);
        }
        let top = self.young * self.random.power(-4.0, 0.5);
        let control = self.control("pressure", -0.3 * top, top);
        let surface = pick(&mut self.random, &["inner", "outer"]).to_string();
        self.out.scene.pressures.push(PressureSpec { surface, origin: Some([0.0; 3]), control });
        self.say(format!("octant, pressure to {:.0e} E", top / self.young));
    }

    fn supports(&mut self) {
        let low = "x_min";
        let way = self.random.below(10);
        match way {
            0 => self.say("no support"),
            1 => {
                let held = self.held(low, [true, false, false]);
                self.out.scene.prescribed.push(held);
                self.say("rollers only");
            }
            2 => {
                for (d, set) in ["x_min", "y_min", "z_min"].into_iter().enumerate() {
                    let held = self.held(set, std::array::from_fn(|c| c == d));
                    self.out.scene.prescribed.push(held);
                }
                self.say("three rollers");
            }
            _ => {
                let held = self.held(low, [true; 3]);
                self.out.scene.prescribed.push(held);
            }
        }
        let high = "x_max";
        let end = self.random.below(6);
        match if way == 2 { 4 + end % 2 } else { end } {
            0 | 1 => {
                let nodes = self.out.mesh.node_sets[high].len();
                let reach = self.size * self.random.power(-5.0, 0.3);
                let displacement = match self.random.chance(0.3) {
                    true => (0..nodes).map(|_| self.random.vector(reach).into()).collect(),
                    false => vec![self.random.vector(reach).into()],
                };
                let control = Some(self.control("load", -1.0, 1.0));
                let spec = PrescribedSpec { displacement, control, ..self.held(high, [true; 3]) };
                self.out.scene.prescribed.push(spec);
                self.say(format!("moved by {:.0e} lengths", reach / self.size));
            }
            2 | 3 => {
                self.out.scene.ties.push(TieSpec { nodes: high.into(), body: "bone".into() });
                let set = &self.out.mesh.node_sets[high];
                let sum: Vector3<f64> =
                    set.iter().map(|&n| Vector3::from(self.out.mesh.points[n as usize])).sum();
                let centre = sum / set.len() as f64;
                self.bodies.push(("bone", centre));
                self.say("body");
            }
            4 if self.random.chance(0.5) => {
                self.out.scene.planes.push(PlaneSpec { nodes: high.into(), axis: 0.into() });
                self.say("plane");
            }
            _ => {}
        }
    }

    fn extras(&mut self, n: [usize; 3]) {
        let kind = self.out.mesh.blocks[0].kind;
        let area = self.size * self.size;
        // Where nothing else moves there is a force.
        if self.random.chance(0.35) || self.ranges.is_empty() && self.bodies.is_empty() {
            let top = self.young * area * self.random.power(-7.0, 0.0);
            let count = 1 + self.random.below(4);
            let mut loads = Vec::new();
            for _ in 0..count {
                let node = self.random.below(self.out.mesh.points.len()) as u32;
                loads.push((node, self.random.vector(top).into()));
            }
            let control = self.control("load", -1.0, 1.0);
            self.out.scene.forces.push(ForceSpec { name: "push".into(), loads, control });
            self.say(format!("forces to {:.0e} E A", top / (self.young * area)));
        }
        if self.random.chance(0.25) && kind != CellKind::Tet10 {
            let top = self.young * self.random.power(-5.0, 0.3);
            let control = self.control("pressure", -top, top);
            // The whole boundary is closed; of one face the rim may be held or not, and the plan has to say so.
            let surface = if self.random.chance(0.6) { "all" } else { "x_min" };
            if surface == "all" {
                let mut faces = self.out.mesh.blocks[0].boundary().expect("a box");
                if self.random.chance(0.3) {
                    faces.iter_mut().for_each(|f| {
                        if f[2] != f[3] {
                            f.swap(1, 3)
                        }
                    });
                }
                self.out.mesh.surfaces.insert("all".into(), faces);
            }
            let origin = match self.random.chance(0.5) {
                true => [0.0; 3],
                false => self.vector(-1.0, 6.0).into(),
            };
            self.out.scene.pressures.push(PressureSpec {
                surface: surface.into(),
                origin: Some(origin),
                control,
            });
            self.say(format!("pressure to {:.0e} E on {surface}", top / self.young));
        }
        if self.random.chance(0.3) {
            self.fibres(n);
        }
        if self.random.chance(0.15) && kind == CellKind::Hex8 {
            let faces = self.out.mesh.surfaces["z_max"].clone();
            let nodes = faces.into_iter().flatten().collect();
            self.out.mesh.blocks.push(CellBlock { name: "skin".into(), kind: CellKind::Quad4, nodes });
            let young = self.young * self.random.power(-1.0, 2.0);
            let law = match self.random.chance(0.5) {
                true => MembraneLawSpec::NeoHookean { mu: young / 3.0 },
                false => MembraneLawSpec::StVenantKirchhoff { young, nu: self.random.between(0.0, 0.5) },
            };
            let thickness = self.size * self.random.power(-3.0, -1.0);
            self.out.scene.membranes.push(MembraneSpec { region: "skin".into(), thickness, law });
            self.say("membrane");
        }
        if self.random.chance(0.2) {
            let last = self.out.mesh.points.len() as u32 - 1;
            self.out.mesh.blocks.push(CellBlock {
                name: "strand".into(),
                kind: CellKind::Line2,
                nodes: vec![0, last],
            });
            let stiffness = self.young * area * self.random.power(-2.0, 2.0);
            let (toe, reference_strain) = (self.random.power(-2.5, -1.0), self.random.between(-0.1, 0.1));
            self.out.scene.strands.push(StrandSpec {
                region: "strand".into(),
                stiffness,
                toe,
                reference_strain,
            });
            self.say("strand");
        }
    }

    fn fibres(&mut self, n: [usize; 3]) {
        let kind = self.out.mesh.blocks[0].kind;
        let embedded = matches!(kind, CellKind::Hex8 | CellKind::Tet4) && self.random.chance(0.3);
        let stress = self.young * self.random.power(-2.0, 1.0);
        let law = match self.random.below(3) {
            0 => FibreLawSpec::Thermal {
                young: stress,
                contraction: self.random.between(0.0, 0.5),
                strain: pick(&mut self.random, &[FibreStrain::Engineering, FibreStrain::Logarithmic]),
                toe: pick(&mut self.random, &[None, Some(0.05)]),
            },
            1 => FibreLawSpec::Hill { sigma_max: stress, lambda_opt: self.random.between(0.8, 1.3) },
            _ if embedded => FibreLawSpec::Hill { sigma_max: stress, lambda_opt: 1.0 },
            _ => FibreLawSpec::ForceLength {
                stretch: vec![0.5, 0.8, 1.0, 1.2, 1.5],
                activation: vec![0.0, 0.4, 1.0],
                stress: [0.0, 0.4, 1.0]
                    .map(|a| [0.0, 0.6 * a, a, 0.7 * a + 0.1, 0.8].map(|s| s * stress).to_vec())
                    .to_vec(),
            },
        };
        let course = if embedded {
            // Between points inside of cells, as the mesh is before it is jittered: the jitter moves them a little in their cells.
            let cells: Vec<Vec<u32>> = self.out.mesh.blocks[0].cells().map(<[u32]>::to_vec).collect();
            let mut line = Vec::new();
            for _ in 0..2 + self.random.below(2) {
                let cell = pick(&mut self.random, &cells);
                let weights: Vec<f64> = cell.iter().map(|_| self.random.between(0.3, 1.0)).collect();
                let sum: f64 = weights.iter().sum();
                let at = |c: usize| {
                    let points = cell.iter().zip(&weights);
                    points.map(|(&n, w)| w / sum * self.out.mesh.points[n as usize][c]).sum()
                };
                line.push(std::array::from_fn(at));
            }
            Course::Embedded(vec![line])
        } else {
            let mut lines = vec![[0, 0]];
            if self.random.chance(0.5) {
                lines.push([n[1], n[2]]);
            }
            generate::add_fibres(&mut self.out.mesh, "lines", n, &lines);
            Course::Region("lines".into())
        };
        let area = vec![self.size * self.size * self.random.power(-3.0, 0.0)];
        let activation = Some(self.control("activation", 0.0, 1.0));
        let debug = format!("{law:?}");
        let name = debug.split([' ', '{']).next().unwrap_or_default().to_string();
        self.say(format!("fibres {name}{}", if embedded { " embedded" } else { "" }));
        self.out.scene.fibres.push(FibreSpec { name: "fibres".into(), course, law, area, activation });
    }

    /// Two boxes, one above the other, pressed together.
    fn two_blocks(&mut self) {
        let gap = self.size * self.random.power(-3.0, -1.0);
        let mut mesh = Mesh::default();
        let mut top = 0.0;
        for name in ["low", "high"] {
            let n = [self.random.integer(1, 2), self.random.integer(1, 2), 2];
            let width = self.size * self.random.between(0.5, 1.0);
            let mut block = generate::block(n, [width, width, 0.5 * self.size]);
            if self.random.chance(0.3) {
                block = generate::tetrahedra(&block, false);
            }
            block.blocks[0].name = String::new();
            block.points.iter_mut().for_each(|p| p[2] += top);
            top += 0.5 * self.size + gap;
            generate::append(&mut mesh, block, name);
        }
        self.out.mesh = mesh;
        self.solid("low");
        self.solid("high");
        let held = self.held("low_z_min", [true; 3]);
        self.out.scene.prescribed.push(held);
        let press = gap + self.size * self.random.power(-4.0, -0.5);
        if self.random.chance(0.6) {
            let aside = self.random.vector(0.3 * press);
            let displacement = vec![[aside[0], aside[1], -press]];
            let control = Some(self.control("load", 0.0, 1.0));
            let spec = PrescribedSpec { displacement, control, ..self.held("high_z_max", [true; 3]) };
            self.out.scene.prescribed.push(spec);
        } else {
            self.out.scene.ties.push(TieSpec { nodes: "high_z_max".into(), body: "plate".into() });
            self.bodies.push(("plate", Vector3::new(0.0, 0.0, top - gap)));
        }
        let mut spec = ContactSpec::new(&["low_z_max", "high_z_min"]);
        spec.mode = pick(&mut self.random, &[ContactMode::Guarded, ContactMode::Cheap]);
        spec.distance = gap * self.random.power(-1.0, 0.3);
        if self.random.chance(0.3) {
            spec.stiffness = Some(self.young * self.random.power(-2.0, 2.0));
        }
        self.say(format!("contact {:?}", spec.mode));
        self.out.scene.contact = Some(spec);
        if self.random.chance(0.3) {
            let far = self.vector(0.0, 8.0);
            self.out.mesh.points.iter_mut().for_each(|p| (0..3).for_each(|c| p[c] += far[c]));
            self.say(format!("{:.0e} lengths away", far.norm() / self.size));
        }
    }

    fn drive(&mut self) {
        let step = self.random.power(-3.0, 0.0) * self.size / (self.young / 1060.0).sqrt() * 10.0;
        let mut time = 0.0;
        for _ in 0..1 + self.random.below(4) {
            time += step;
            let controls = self.ranges.clone().into_iter();
            let controls = controls.map(|(name, low, high)| (name, self.random.between(low, high))).collect();
            let mut poses = Vec::new();
            for (name, centre) in self.bodies.clone() {
                let angle = if self.random.chance(0.5) { 0.2 } else { 2.0 };
                let turn = UnitQuaternion::from_scaled_axis(self.random.vector(angle));
                let shift = self.vector(-4.0, 0.2);
                let place = centre + shift - turn * centre;
                poses.push((name, Pose::from_parts(Translation3::from(place), turn)));
            }
            self.out.frames.push(Target { time, controls, poses });
        }
    }

    /// One number that cannot be.
    fn nonsense(&mut self) {
        let random = &mut self.random;
        let wrong = pick(random, &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0]);
        let settings = &mut self.out.settings;
        let what = match random.below(9) {
            0 => {
                settings.tolerance = wrong;
                "tolerance"
            }
            1 => {
                settings.first_step = wrong;
                "first step"
            }
            2 => {
                settings.least_step = wrong;
                "least step"
            }
            3 => {
                settings.least_force = wrong;
                "least force"
            }
            4 => {
                settings.max_iterations = 0;
                "iterations"
            }
            5 => {
                settings.max_work = random.below(4);
                "work"
            }
            6 if self.out.scene.gravity.is_some() => {
                self.out.scene.gravity = self.out.scene.gravity.take().map(|mut gravity| {
                    gravity.acceleration[1] = wrong;
                    gravity
                });
                "gravity"
            }
            7 if !self.out.scene.pressures.is_empty() => {
                self.out.scene.pressures[0].origin = Some([wrong; 3]);
                "origin"
            }
            _ => {
                let poses = self.out.frames.iter_mut().flat_map(|frame| &mut frame.poses);
                poses.for_each(|(_, pose)| pose.translation.x = wrong);
                "pose"
            }
        };
        self.say(format!("{what} = {wrong}"));
    }

    fn settings(&mut self) {
        let random = &mut self.random;
        let tolerance = if random.chance(0.4) { 1e-6 } else { random.power(-12.0, -1.0) };
        let least_force = match random.chance(0.2) {
            true => self.young * self.size * self.size * random.power(-9.0, -2.0),
            false => 0.0,
        };
        self.out.settings = Settings {
            tolerance,
            least_force,
            max_iterations: pick(random, &[60, 60, 60, 1, 3, 20, 300]),
            first_step: pick(random, &[1.0, 1.0, 1.0, 0.3, 0.01, 1e-3]),
            least_step: pick(random, &[1e-4, 1e-4, 1e-2, 1.0, 1e-8]),
            double_precision_factor: random.chance(0.2),
            stability: pick(random, &[Stability::WhereDoubtful, Stability::Always, Stability::Never]),
            ..Settings::default()
        };
        let Settings { tolerance, max_iterations, first_step, .. } = self.out.settings;
        self.say(format!("tolerance {tolerance:.0e}, {max_iterations} iterations, first step {first_step}"));
    }
}
