//! Membranes and pressures of a scene as terms.

use super::error::nearest;
use super::term::{Builder, Names, Term, cells_of, check};
use super::{Motion, SceneError};
use crate::effect::{Effect, Membrane, Pressure};
use crate::element::{Rule, shape};
use crate::material::membrane::MembraneLaw;
use crate::mesh::{CellKind, Mesh};
use crate::scene::{MembraneLawSpec, MembraneSpec, PressureSpec, Scene};
use std::collections::BTreeMap;

/// The term of a membrane region.
pub fn membrane(spec: &MembraneSpec, mesh: &Mesh) -> Result<Term, SceneError> {
    let user = format!("membrane `{}`", spec.region);
    let block = cells_of(mesh, &spec.region, &user)?;
    check(&user, "thickness [m]", spec.thickness, spec.thickness > 0.0, "positive")?;
    let law = match spec.law {
        MembraneLawSpec::StVenantKirchhoff { young, nu } => {
            check(&user, "Young's modulus [Pa]", young, young > 0.0, "positive")?;
            check(&user, "Poisson's ratio", nu, nu > -1.0 && nu <= 0.5, "above -1 and at most 0.5")?;
            MembraneLaw::StVenantKirchhoff { young, nu }
        }
        MembraneLawSpec::NeoHookean { mu } => {
            check(&user, "shear modulus [Pa]", mu, mu > 0.0, "positive")?;
            MembraneLaw::NeoHookean { mu }
        }
    };
    let build = match block.kind {
        CellKind::Quad4 => builder(shape::quad4, law, spec.thickness),
        CellKind::Tri3 => builder(shape::tri3, law, spec.thickness),
        found => {
            let (block, needed) = (spec.region.clone(), "quadrilaterals or triangles");
            return Err(SceneError::Kind { user, block, found, needed });
        }
    };
    let (nodes_per_group, nodes) = (block.kind.n_nodes(), block.nodes.clone());
    Ok(Term { name: spec.region.clone(), nodes_per_group, nodes, couples: true, build })
}

fn builder<const N: usize, const G: usize>(
    rule: fn() -> Rule<N, G, 2>,
    law: MembraneLaw,
    thickness: f64,
) -> Builder {
    Box::new(move |name, points, nodes, cells| {
        let nodes = nodes.as_chunks::<N>().0.to_vec();
        match Membrane::new(name, law, thickness, &rule(), points, nodes) {
            Ok(membrane) => Ok(Box::new(membrane) as Box<dyn Effect>),
            Err(at) => Err(SceneError::Shape { block: name.to_string(), cell: cells[at] as usize, det: 0.0 }),
        }
    })
}

/// The term of a pressure.
pub fn pressure(spec: &PressureSpec, mesh: &Mesh, names: &mut Names) -> Result<Term, SceneError> {
    let faces = faces_of(spec, mesh)?;
    let control = names.control(&spec.control);
    let origin = spec.origin;
    let build: Builder = Box::new(move |name, points, nodes, _| {
        let faces = nodes.as_chunks::<4>().0.to_vec();
        Ok(Box::new(Pressure::new(name, control, origin, points, faces)) as Box<dyn Effect>)
    });
    let nodes = faces.as_flattened().to_vec();
    Ok(Term {
        name: format!("pressure on {}", spec.surface),
        nodes_per_group: 4,
        nodes,
        couples: true,
        build,
    })
}

fn faces_of<'a>(spec: &PressureSpec, mesh: &'a Mesh) -> Result<&'a [[u32; 4]], SceneError> {
    mesh.surfaces.get(&spec.surface).map(Vec::as_slice).ok_or_else(|| SceneError::Unknown {
        user: "pressure".to_string(),
        what: "surface",
        name: spec.surface.clone(),
        nearest: nearest(&spec.surface, mesh.surfaces.keys().map(String::as_str)),
    })
}

/// Refuses pressures on open surfaces with a node on the rim that is free in all directions: there the gradient of the
/// enclosed volume would not be the force of a pressure.
pub fn check_rims(scene: &Scene, mesh: &Mesh, motion: &[[Motion; 3]]) -> Result<(), SceneError> {
    for spec in &scene.pressures {
        let mut edges = BTreeMap::<(u32, u32), i32>::new();
        for f in faces_of(spec, mesh)? {
            for k in 0..4 {
                let (a, b) = (f[k], f[(k + 1) % 4]);
                if a != b {
                    *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
                }
            }
        }
        let rim = edges.iter().filter(|(_, sum)| **sum != 0).flat_map(|((a, b), _)| [*a, *b]);
        for node in rim {
            if motion[node as usize] == [Motion::Free; 3] {
                return Err(SceneError::OpenRim { user: format!("pressure on `{}`", spec.surface), node });
            }
        }
    }
    Ok(())
}
