//! Solid regions of a scene as terms: law and shape chosen once, so that the loops over elements do not ask.

use super::SceneError;
use super::grid::Clusters;
use super::term::{Builder, Names, Term, cells_of, check, unit};
use crate::effect::solid::{LawField, Solid};
use crate::effect::{Effect, EmbeddedSolid, State, load::add_weight};
use crate::element::shape::{self, contract};
use crate::element::{Formulation, Rule, SolidElement};
use crate::material::*;
use crate::mesh::{CellBlock, CellKind, Mesh};
use crate::scene::{FibreDirection, LawSpec, SolidSpec, UserLaw};
use nalgebra::Vector3;
use std::sync::Arc;

/// The law of a region, with fibre directions and activation where it has them.
#[derive(Clone)]
struct Field {
    law: Law,
    /// One per cell for laws with fibres, otherwise empty.
    directions: Vec<Vector3<f64>>,
    activation: Option<usize>,
}

impl LawField for Field {
    type Law<'a> = Law;
    fn law<'a>(&'a self, cell: usize, s: &State<'a>) -> Law {
        match self.law {
            Law::Blemker(along) => {
                let activation = self.activation.map_or(0.0, |c| s.controls[c]);
                Law::Blemker(BlemkerFibre {
                    law: Blemker { activation, ..along.law },
                    a0: self.directions[cell],
                })
            }
            law => law,
        }
    }

    fn fibre(&self, cell: usize) -> Option<Vector3<f64>> {
        self.directions.get(cell).copied()
    }
}

/// The field on some cells of its region.
trait Restrict: LawField {
    fn restrict(&self, cells: &[u32]) -> Self;
}

impl Restrict for Field {
    fn restrict(&self, cells: &[u32]) -> Field {
        let directions = cells.iter().filter_map(|&c| self.directions.get(c as usize).copied()).collect();
        Field { directions, ..*self }
    }
}

/// The law of a user's own of a region.
struct UserField {
    law: Arc<dyn SolidLaw>,
    /// Index in the region and fibre direction of each cell.
    cells: Vec<(usize, Vector3<f64>)>,
    controls: Arc<[usize]>,
}

impl LawField for UserField {
    type Law<'a> = user::At<'a>;
    fn law<'a>(&'a self, cell: usize, s: &State<'a>) -> user::At<'a> {
        let (cell, a0) = self.cells[cell];
        user::At { law: self.law.as_ref(), site: Site::new(cell, a0, &self.controls, s.controls) }
    }
    fn fibre(&self, cell: usize) -> Option<Vector3<f64>> {
        Some(self.cells[cell].1).filter(|a0| *a0 != Vector3::zeros())
    }
}

impl Restrict for UserField {
    fn restrict(&self, cells: &[u32]) -> UserField {
        let cells = cells.iter().map(|&c| self.cells[c as usize]).collect();
        UserField { law: self.law.clone(), cells, controls: self.controls.clone() }
    }
}

/// The term of a solid region; `clusters` where it is embedded in a grid.
pub fn term(
    spec: &SolidSpec,
    mesh: &Mesh,
    clusters: Option<&Clusters>,
    names: &mut Names,
) -> Result<Term, SceneError> {
    let user = format!("solid `{}`", spec.region);
    let block = cells_of(mesh, &spec.region, &user)?;
    check(&user, "density [kg/m^3]", spec.density, spec.density >= 0.0, "at least 0")?;
    let default = if block.kind == CellKind::Hex8 { Formulation::MeanDilatation } else { Formulation::Plain };
    let formulation = spec.formulation.map_or(default, Formulation::from);
    check_scale(&user, &spec.scale, block.n_cells())?;
    let build = match &spec.law {
        LawSpec::User(law) => {
            let field = user_field(&user, law, mesh, block, names)?;
            build_for((block, clusters), &user, formulation, field, spec)?
        }
        _ => {
            let field = field(&user, &spec.law, mesh, block, names)?;
            build_for((block, clusters), &user, formulation, field, spec)?
        }
    };
    let (nodes_per_group, nodes) = match clusters {
        Some(clusters) => (clusters.nodes_per_group, clusters.nodes.clone()),
        None => (block.kind.n_nodes(), block.nodes.clone()),
    };
    Ok(Term { name: spec.region.clone(), nodes_per_group, nodes, couples: true, build })
}

/// A law of the crate with its constants checked.
fn field(
    user: &str,
    law: &LawSpec,
    mesh: &Mesh,
    block: &CellBlock,
    names: &mut Names,
) -> Result<Field, SceneError> {
    let (mut fibres, mut activation) = (Vec::new(), None);
    let law = match law {
        LawSpec::NeoHookean { young, nu } => {
            young_and_poisson(user, *young, *nu)?;
            Law::NeoHookean(NeoHookean::from_young(*young, *nu))
        }
        LawSpec::NeoHookeanUncoupled { mu, bulk } => {
            positive(user, &[("mu [Pa]", *mu), ("bulk [Pa]", *bulk)])?;
            Law::NeoHookeanUncoupled(NeoHookeanUncoupled { mu: *mu, bulk: *bulk })
        }
        LawSpec::MooneyRivlin { c10, c01, bulk } => {
            positive(user, &[("c10 + c01 [Pa]", c10 + c01), ("bulk [Pa]", *bulk)])?;
            Law::MooneyRivlin(MooneyRivlin { c10: *c10, c01: *c01, bulk: *bulk })
        }
        LawSpec::MooneyRivlinDyna { a, b, nu } => {
            young_and_poisson(user, a + b, *nu)?;
            Law::MooneyRivlinDyna(MooneyRivlinDyna { a: *a, b: *b, nu: *nu })
        }
        LawSpec::StableNeoHookean { young, nu } => {
            young_and_poisson(user, *young, *nu)?;
            check(user, "Poisson's ratio", *nu, *nu >= 0.0, "at least 0 for this law")?;
            Law::StableNeoHookean(StableNeoHookean::from_young(*young, *nu))
        }
        LawSpec::StVenantKirchhoff { young, nu } => {
            young_and_poisson(user, *young, *nu)?;
            Law::StVenantKirchhoff(StVenantKirchhoff::from_young(*young, *nu))
        }
        LawSpec::LinearElastic { young, nu } => {
            young_and_poisson(user, *young, *nu)?;
            Law::LinearElastic(LinearElastic::from_young(*young, *nu))
        }
        LawSpec::FoldoverFree { epsilon } => {
            positive(user, &[("epsilon", *epsilon)])?;
            Law::FoldoverFree(FoldoverFree { epsilon: *epsilon })
        }
        LawSpec::Blemker { g1, g2, bulk, sigma_max, lambda_ofl, fibres: along, activation: control } => {
            positive(
                user,
                &[("g1 [Pa]", *g1), ("g2 [Pa]", *g2), ("bulk [Pa]", *bulk), ("lambda_ofl", *lambda_ofl)],
            )?;
            check(user, "sigma_max [Pa]", *sigma_max, *sigma_max >= 0.0, "at least 0")?;
            fibres = directions(user, along, mesh, block)?;
            activation = control.as_ref().map(|a| names.control(a));
            let (g1, g2, bulk, sigma_max, lambda_ofl) = (*g1, *g2, *bulk, *sigma_max, *lambda_ofl);
            let law = Blemker { g1, g2, bulk, sigma_max, lambda_ofl, ..Blemker::muscle() };
            Law::Blemker(BlemkerFibre { law, a0: Vector3::x() })
        }
        LawSpec::User(_) => unreachable!("it has a field of its own"),
    };
    Ok(Field { law, directions: fibres, activation })
}

/// A law of a user's own; refused where it has no finite energy, stress and tangent at rest.
fn user_field(
    user: &str,
    spec: &UserLaw,
    mesh: &Mesh,
    block: &CellBlock,
    names: &mut Names,
) -> Result<UserField, SceneError> {
    let along = spec.fibres.as_ref().map(|along| directions(user, along, mesh, block)).transpose()?;
    let along = along.unwrap_or_else(|| vec![Vector3::zeros(); block.n_cells()]);
    let controls: Vec<usize> = spec.controls.iter().map(|name| names.control(name)).collect();
    let law = spec.law.clone();
    let (I, at_rest) = (Matrix3::identity(), vec![0.0; names.controls.len()]);
    for (cell, &a0) in along.iter().enumerate() {
        let at = user::At { law: law.as_ref(), site: Site::new(cell, a0, &controls, &at_rest) };
        let quantities = [
            ("energy density [J/m^3] at rest", at.energy(&I)),
            ("stress [Pa] at rest, a component of it", sum(at.stress(&I).as_slice())),
            ("tangent [Pa] at rest, a component of it", sum(at.tangent(&I).as_slice())),
        ];
        for (quantity, value) in quantities {
            check(user, &format!("{quantity} in cell {cell}"), value, true, "a finite number: mend the law")?;
        }
    }
    Ok(UserField { law, cells: along.into_iter().enumerate().collect(), controls: controls.into() })
}

fn sum(values: &[f64]) -> f64 {
    values.iter().map(|v| v.abs()).sum()
}

/// What makes the effect of a region of solid cells.
fn build_for<F: Restrict + 'static>(
    (block, clusters): (&CellBlock, Option<&Clusters>),
    user: &str,
    formulation: Formulation,
    field: F,
    spec: &SolidSpec,
) -> Result<Builder, SceneError> {
    let scale = spec.scale.clone();
    if let Some(clusters) = clusters {
        return Ok(embedded_builder(clusters.clone(), formulation, field, scale));
    }
    Ok(match block.kind {
        CellKind::Hex8 => builder(shape::hex8, formulation, field, scale),
        CellKind::Tet4 => builder(shape::tet4, formulation, field, scale),
        CellKind::Tet10 => builder(shape::tet10, formulation, field, scale),
        CellKind::Wedge6 => builder(shape::wedge6, formulation, field, scale),
        found => {
            let (user, block, needed) =
                (user.to_string(), block.name.clone(), "hexahedra, tetrahedra or wedges");
            return Err(SceneError::Kind { user, block, found, needed });
        }
    })
}

/// Refuses factors that are not one per cell or not positive, naming the first cell.
fn check_scale(user: &str, scale: &[f64], n_cells: usize) -> Result<(), SceneError> {
    if !scale.is_empty() && scale.len() != n_cells {
        return Err(SceneError::Count {
            user: user.to_string(),
            quantity: "scale",
            found: scale.len(),
            needed: format!("one per cell ({n_cells}) or none"),
        });
    }
    for (cell, &factor) in scale.iter().enumerate().filter(|(_, s)| !(**s > 0.0 && s.is_finite())) {
        check(user, &format!("scale of cell {cell}"), factor, false, "positive and finite")?;
    }
    Ok(())
}

fn positive(user: &str, values: &[(&str, f64)]) -> Result<(), SceneError> {
    values.iter().try_for_each(|(name, v)| check(user, name, *v, *v > 0.0, "positive"))
}

fn young_and_poisson(user: &str, young: f64, nu: f64) -> Result<(), SceneError> {
    check(user, "stiffness [Pa]", young, young > 0.0, "positive")?;
    check(user, "Poisson's ratio", nu, nu > -1.0 && nu < 0.5, "above -1 and below 0.5")
}

fn builder<L: Restrict + 'static, const N: usize, const G: usize>(
    rule: fn() -> Rule<N, G, 3>,
    formulation: Formulation,
    field: L,
    scale: Vec<f64>,
) -> Builder {
    Box::new(move |name, points, nodes, cells| {
        let (nodes, _) = nodes.as_chunks::<N>();
        let solid = Solid::new(name, field.restrict(cells), formulation, &rule(), points, nodes.to_vec());
        let scale = cells.iter().filter_map(|&c| scale.get(c as usize).copied()).collect();
        match solid {
            Ok(solid) => Ok(Box::new(solid.scaled(scale)) as Box<dyn Effect>),
            Err((at, det)) => {
                Err(SceneError::Shape { block: name.to_string(), cell: cells[at] as usize, det })
            }
        }
    })
}

fn embedded_builder<L: Restrict + 'static>(
    of: Clusters,
    formulation: Formulation,
    field: L,
    scale: Vec<f64>,
) -> Builder {
    Box::new(move |name, _, nodes, groups| {
        let pick = |g: &u32| of.clusters[*g as usize].clone();
        let cells: Vec<u32> = groups.iter().flat_map(|&g| &of.cells[g as usize]).copied().collect();
        let scale = cells.iter().filter_map(|&c| scale.get(c as usize).copied()).collect();
        Ok(Box::new(EmbeddedSolid::new(
            name,
            (field.restrict(&cells), formulation, scale),
            (of.nodes_per_group, nodes.to_vec()),
            groups.iter().map(pick).collect(),
            groups.iter().map(|&g| of.centroids[g as usize]).collect(),
            cells,
        )) as Box<dyn Effect>)
    })
}

fn directions(
    user: &str,
    spec: &FibreDirection,
    mesh: &Mesh,
    block: &CellBlock,
) -> Result<Vec<Vector3<f64>>, SceneError> {
    let n = block.nodes.len() / block.kind.n_nodes();
    match spec {
        FibreDirection::Uniform(d) => Ok(vec![unit(user, *d)?; n]),
        FibreDirection::PerCell(list) if list.len() == n => list.iter().map(|d| unit(user, *d)).collect(),
        FibreDirection::PerCell(list) => Err(SceneError::Count {
            user: user.to_string(),
            quantity: "fibre directions",
            found: list.len(),
            needed: format!("one per cell: {n}"),
        }),
        FibreDirection::CellAxis(axis) => {
            check(user, "cell axis", *axis as f64, *axis < 3, "0, 1 or 2")?;
            if block.kind != CellKind::Hex8 {
                let (user, block, found) = (user.to_string(), block.name.clone(), block.kind);
                return Err(SceneError::Kind { user, block, found, needed: "hexahedra for a cell axis" });
            }
            let (_, dn) = shape::hex8_at([0.0; 3]);
            let tangent = |nodes: &[u32]| {
                let X: [[f64; 3]; 8] = std::array::from_fn(|a| mesh.points[nodes[a] as usize]);
                unit(user, contract(&X, &dn).column(*axis).into())
            };
            block.nodes.chunks_exact(8).map(tangent).collect()
        }
    }
}

/// Weights of the cells of a solid region, at unit value of the control of gravity.
pub struct Weights {
    /// The region.
    pub region: String,
    /// Control that scales them.
    pub control: usize,
    /// Nodes of each cell.
    pub nodes_per_cell: usize,
    /// Nodes of all cells, in the numbering of the mesh.
    pub nodes: Vec<u32>,
    /// The part of the weight of a cell \[N\] on each of its nodes: ∫ρ g N_a dV.
    pub forces: Vec<[f64; 3]>,
}

/// The weights of all cells of a solid under `acceleration` \[m/s²\].
pub fn weights(
    spec: &SolidSpec,
    mesh: &Mesh,
    acceleration: [f64; 3],
    control: usize,
) -> Result<Weights, SceneError> {
    let block = cells_of(mesh, &spec.region, &format!("solid `{}`", spec.region))?;
    let force = acceleration.map(|a| a * spec.density);
    let forces = match block.kind {
        CellKind::Hex8 => cell_weights(&shape::hex8(), block, mesh, force)?,
        CellKind::Tet4 => cell_weights(&shape::tet4(), block, mesh, force)?,
        CellKind::Tet10 => cell_weights(&shape::tet10(), block, mesh, force)?,
        CellKind::Wedge6 => cell_weights(&shape::wedge6(), block, mesh, force)?,
        _ => vec![[0.0; 3]; block.nodes.len()],
    };
    let nodes_per_cell = block.kind.n_nodes();
    Ok(Weights { region: spec.region.clone(), control, nodes_per_cell, nodes: block.nodes.clone(), forces })
}

/// Mass \[kg\] of a solid at its nodes, cell by cell: row sums ∫ρ N_a dV, and where those are not positive (tet10) in proportion to
/// ∫N_a² dV (Hinton, Rock & Zienkiewicz, Earthq. Eng. Struct. Dyn. 4 (1976)).
pub fn masses(spec: &SolidSpec, mesh: &Mesh) -> Result<Vec<(u32, f64)>, SceneError> {
    // A weight along x under unit acceleration is a mass.
    let weights = weights(spec, mesh, [1.0, 0.0, 0.0], 0)?;
    let mut masses: Vec<f64> = weights.forces.iter().map(|f| f[0]).collect();
    if weights.nodes_per_cell == 10 {
        let rule = shape::tet10();
        let square = |a: usize| rule.n.iter().zip(&rule.w).map(|(n, w)| w * n[a] * n[a]).sum::<f64>();
        let squares: Vec<f64> = (0..10).map(square).collect();
        let sum: f64 = squares.iter().sum();
        for cell in masses.chunks_exact_mut(10) {
            let mass: f64 = cell.iter().sum();
            cell.iter_mut().zip(&squares).for_each(|(m, s)| *m = mass * s / sum);
        }
    }
    Ok(weights.nodes.into_iter().zip(masses).collect())
}

fn cell_weights<const N: usize, const G: usize>(
    rule: &Rule<N, G, 3>,
    block: &CellBlock,
    mesh: &Mesh,
    force: [f64; 3],
) -> Result<Vec<[f64; 3]>, SceneError> {
    let mut forces = Vec::with_capacity(block.nodes.len());
    for (cell, nodes) in block.nodes.as_chunks::<N>().0.iter().enumerate() {
        let element = SolidElement::new(rule, &nodes.map(|n| mesh.points[n as usize]))
            .map_err(|det| SceneError::Shape { block: block.name.clone(), cell, det })?;
        let mut forces_of_cell = [[0.0; 3]; N];
        add_weight(&element, &rule.n, force, &mut forces_of_cell);
        forces.extend(forces_of_cell);
    }
    Ok(forces)
}
