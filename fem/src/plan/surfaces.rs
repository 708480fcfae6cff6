//! Membranes and pressures of a scene as terms.

use super::error::nearest;
use super::rim::rim;
use super::term::{Builder, Names, Term, cells_of, check};
use super::{Motion, SceneError, Slide};
use crate::effect::{Effect, Membrane, PatchPressure, Pressure};
use crate::element::{Rule, shape};
use crate::material::membrane::MembraneLaw;
use crate::mesh::{CellKind, Mesh};
use crate::scene::{MembraneLawSpec, MembraneSpec, PatchPressureSpec, PressureSpec};

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

/// The term of a pressure. `motion`: what the nodes do; absent where that is not known for mistakes in it, and then the plan fails anyway.
pub fn pressure(
    spec: &PressureSpec,
    mesh: &Mesh,
    motion: Option<(&[[Motion; 3]], &[Slide])>,
    names: &mut Names,
) -> Result<Term, SceneError> {
    let control = names.control(&spec.control);
    let faces = faces_of(spec, mesh)?.to_vec();
    let user = format!("pressure on `{}`", spec.surface);
    for o in spec.origin.iter().flatten() {
        check(&user, "origin [m]", *o, true, "a finite number")?;
    }
    check(&user, "number of faces", faces.len() as f64, !faces.is_empty(), "positive")?;
    let rim = motion.map(|motion| rim(&user, &faces, mesh, motion)).transpose()?.unwrap_or_default();
    let nodes = faces.as_flattened().to_vec();
    let build: Builder = Box::new(move |name, points, nodes, groups| {
        let local = nodes.as_chunks::<4>().0.to_vec();
        let pairs = groups.iter().zip(&local).flat_map(|(&g, local)| faces[g as usize].iter().zip(local));
        let rim = pairs.filter_map(|(n, &local)| Some((local, *rim.get(n)?))).collect();
        Ok(Box::new(Pressure::new(name, control, points, local, rim)) as Box<dyn Effect>)
    });
    Ok(Term {
        name: format!("{}{}", Pressure::NAME, spec.surface),
        nodes_per_group: 4,
        nodes,
        couples: true,
        build,
    })
}

/// The term of a pressure on a patch with a free rim.
pub fn patch_pressure(spec: &PatchPressureSpec, mesh: &Mesh, names: &mut Names) -> Result<Term, SceneError> {
    let user = "patch pressure";
    let faces = mesh.surfaces.get(&spec.surface).ok_or_else(|| SceneError::Unknown {
        user: user.to_string(),
        what: "surface",
        name: spec.surface.clone(),
        nearest: nearest(&spec.surface, mesh.surfaces.keys().map(String::as_str)),
    })?;
    let control = names.control(&spec.control);
    let build: Builder = Box::new(move |name, points, nodes, _| {
        Ok(Box::new(PatchPressure::new(name, control, points, nodes.as_chunks::<4>().0)) as Box<dyn Effect>)
    });
    let (name, nodes) = (format!("{}{}", PatchPressure::NAME, spec.surface), faces.as_flattened().to_vec());
    Ok(Term { name, nodes_per_group: 4, nodes, couples: true, build })
}

fn faces_of<'a>(spec: &PressureSpec, mesh: &'a Mesh) -> Result<&'a [[u32; 4]], SceneError> {
    mesh.surfaces.get(&spec.surface).map(Vec::as_slice).ok_or_else(|| SceneError::Unknown {
        user: "pressure".to_string(),
        what: "surface",
        name: spec.surface.clone(),
        nearest: nearest(&spec.surface, mesh.surfaces.keys().map(String::as_str)),
    })
}
