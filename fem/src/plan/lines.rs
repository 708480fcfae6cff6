//! Fibres and strands of a scene as terms; fibres that do not follow mesh edges are embedded in the solid cells.

use super::SceneError;
use super::embed::Embedding;
use super::term::{Builder, Names, Term, cells_of, check};
use crate::effect::chain::{Chain, Chains};
use crate::effect::line::{End, Lines, Segment};
use crate::effect::{Effect, NO_NODE};
use crate::material::force_length::ForceLength;
use crate::material::line::{HillFibre, LineLaw, Strand, ThermalFibre};
use crate::mesh::{CellKind, Mesh};
use crate::scene::{Course, FibreLawSpec, FibreSpec, StrandSpec};

/// Nodes of a segment between two points embedded in hexahedra.
const EMBEDDED: usize = 16;

/// The term of a set of fibres.
pub fn fibres(
    spec: &FibreSpec,
    mesh: &Mesh,
    embedding: &Embedding,
    names: &mut Names,
) -> Result<Term, SceneError> {
    let user = format!("fibre `{}`", spec.name);
    for &a in &spec.area {
        check(&user, "area [m^2]", a, a > 0.0, "positive")?;
    }
    let activation = spec.activation.as_ref().map(|a| names.control(a));
    let law = |area: f64| law(&user, &spec.law, area);
    let area_of = |i: usize, n: usize| match spec.area.len() {
        1 => Ok(spec.area[0]),
        m if m == n => Ok(spec.area[i]),
        found => Err(SceneError::Count {
            user: user.clone(),
            quantity: "areas",
            found,
            needed: format!("1 or {n}"),
        }),
    };
    match &spec.course {
        Course::Region(region) => {
            let block = lines_of(mesh, region, &user)?;
            if let FibreLawSpec::ForceLength { stretch, activation: samples, stress } = &spec.law {
                let law = force_length(&user, stretch, samples, stress)?;
                return chains(&spec.name, &user, mesh, block, law, activation, area_of);
            }
            let n = block.len() / 2;
            let segments = block
                .chunks_exact(2)
                .enumerate()
                .map(|(i, pair)| {
                    let length = distance(mesh.points[pair[0] as usize], mesh.points[pair[1] as usize]);
                    check(&user, "length of a segment [m]", length, length > 0.0, "positive")?;
                    Ok(Segment {
                        ends: [vec![(pair[0], 1.0)], vec![(pair[1], 1.0)]],
                        length,
                        law: law(area_of(i, n)?)?,
                    })
                })
                .collect::<Result<Vec<_>, SceneError>>()?;
            Ok(term::<2>(&spec.name, activation, segments))
        }
        Course::Embedded(polylines) => {
            let mut segments = Vec::new();
            for (line, points) in polylines.iter().enumerate() {
                let ends = points
                    .iter()
                    .map(|p| {
                        embedding.locate(*p).ok_or_else(|| SceneError::Outside {
                            user: user.clone(),
                            line,
                            x: p[0],
                            y: p[1],
                            z: p[2],
                        })
                    })
                    .collect::<Result<Vec<End>, _>>()?;
                let law = law(area_of(line, polylines.len())?)?;
                for (pair, p) in ends.windows(2).zip(points.windows(2)) {
                    let length = distance(p[0], p[1]);
                    check(&user, "length of a segment [m]", length, length > 0.0, "positive")?;
                    segments.push(Segment { ends: [pair[0].clone(), pair[1].clone()], length, law });
                }
            }
            Ok(term::<EMBEDDED>(&spec.name, activation, segments))
        }
    }
}

/// The term of a set of strands.
pub fn strands(spec: &StrandSpec, mesh: &Mesh) -> Result<Term, SceneError> {
    let user = format!("strand `{}`", spec.region);
    check(&user, "stiffness [N]", spec.stiffness, spec.stiffness > 0.0, "positive")?;
    check(&user, "toe", spec.toe, spec.toe > 0.0, "positive")?;
    check(&user, "reference strain", spec.reference_strain, spec.reference_strain > -1.0, "above -1")?;
    let law = LineLaw::Strand(Strand { stiffness: spec.stiffness, toe: spec.toe });
    let block = lines_of(mesh, &spec.region, &user)?;
    let segments = block
        .chunks_exact(2)
        .map(|pair| {
            let l_ref = distance(mesh.points[pair[0] as usize], mesh.points[pair[1] as usize]);
            check(&user, "length of a strand [m]", l_ref, l_ref > 0.0, "positive")?;
            let length = Strand::slack_length(l_ref, spec.reference_strain);
            Ok(Segment { ends: [vec![(pair[0], 1.0)], vec![(pair[1], 1.0)]], length, law })
        })
        .collect::<Result<Vec<_>, SceneError>>()?;
    Ok(term::<2>(&spec.region, None, segments))
}

fn law(user: &str, spec: &FibreLawSpec, area: f64) -> Result<LineLaw, SceneError> {
    match *spec {
        FibreLawSpec::Thermal { young, contraction, strain, toe } => {
            check(user, "Young's modulus [Pa]", young, young > 0.0, "positive")?;
            check(user, "contraction", contraction, contraction >= 0.0, "at least 0")?;
            if let Some(toe) = toe {
                check(user, "toe", toe, toe > 0.0, "positive")?;
            }
            Ok(LineLaw::Thermal(ThermalFibre { stiffness: young * area, contraction, strain, toe }))
        }
        FibreLawSpec::ForceLength { .. } => Err(SceneError::NotEmbedded { user: user.to_string() }),
        FibreLawSpec::Hill { sigma_max, lambda_opt } => {
            check(user, "sigma_max [Pa]", sigma_max, sigma_max > 0.0, "positive")?;
            check(user, "lambda_opt", lambda_opt, lambda_opt > 0.0, "positive")?;
            Ok(LineLaw::Hill(HillFibre { f_max: sigma_max * area, lambda_opt }))
        }
    }
}

fn force_length(
    user: &str,
    stretch: &[f64],
    activation: &[f64],
    stress: &[Vec<f64>],
) -> Result<ForceLength, SceneError> {
    for (samples, quantity, least) in [(stretch, "stretch", 2), (activation, "activation", 1)] {
        let count = samples.len() as f64;
        check(user, &format!("number of samples of {quantity}"), count, samples.len() >= least, "larger")?;
        let first = samples[0];
        check(user, &format!("first {quantity}"), first, first >= 0.0, "at least 0")?;
        for pair in samples.windows(2) {
            check(user, &format!("{quantity} after {}", pair[0]), pair[1], pair[1] > pair[0], "larger")?;
        }
    }
    let rows = stress.iter().map(|row| (row.len(), stretch.len(), "stretches"));
    for (found, wanted, per) in rows.chain([(stress.len(), activation.len(), "activations")]) {
        if found != wanted {
            let needed = format!("{wanted}, as many as {per}");
            return Err(SceneError::Count { user: user.to_string(), quantity: "stresses", found, needed });
        }
    }
    for &s in stress.iter().flatten() {
        check(user, "stress [Pa]", s, s >= 0.0, "at least 0")?;
    }
    Ok(ForceLength::new(stretch.to_vec(), activation.to_vec(), stress))
}

/// The term of fibres that have one tension each.
fn chains(
    name: &str,
    user: &str,
    mesh: &Mesh,
    block: &[u32],
    law: ForceLength,
    activation: Option<usize>,
    area_of: impl Fn(usize, usize) -> Result<f64, SceneError>,
) -> Result<Term, SceneError> {
    let pairs: Vec<[u32; 2]> = block.as_chunks::<2>().0.to_vec();
    let mut fibre_of = Vec::with_capacity(pairs.len());
    let mut fibres: Vec<Chain> = Vec::new();
    for (i, &[a, b]) in pairs.iter().enumerate() {
        let length = distance(mesh.points[a as usize], mesh.points[b as usize]);
        check(user, "length of a segment [m]", length, length > 0.0, "positive")?;
        if i == 0 || pairs[i - 1][1] != a {
            fibres.push(Chain { segments: Vec::new(), length: 0.0, area: area_of(i, pairs.len())? });
        }
        let fibre = fibres.last_mut().expect("the first line starts a fibre");
        let area = area_of(i, pairs.len())?;
        check(user, "area [m^2] within a fibre", area, area == fibre.area, "the same from end to end")?;
        fibre.length += length;
        fibre_of.push(fibres.len() - 1);
    }
    let build: Builder = Box::new(move |name, points, nodes, groups| {
        let mut chains: Vec<Chain> = Vec::new();
        let mut last = None;
        for (pair, &group) in nodes.as_chunks::<2>().0.iter().zip(groups) {
            let fibre = fibre_of[group as usize];
            if last != Some(fibre) {
                chains.push(fibres[fibre].clone());
                last = Some(fibre);
            }
            chains.last_mut().expect("pushed").segments.push(*pair);
        }
        Ok(Box::new(Chains::new(name, activation, law.clone(), points, &chains)) as Box<dyn Effect>)
    });
    Ok(Term { name: name.to_string(), nodes_per_group: 2, nodes: block.to_vec(), couples: true, build })
}

fn lines_of<'a>(mesh: &'a Mesh, region: &str, user: &str) -> Result<&'a [u32], SceneError> {
    let block = cells_of(mesh, region, user)?;
    if block.kind == CellKind::Line2 {
        return Ok(&block.nodes);
    }
    Err(SceneError::Kind {
        user: user.to_string(),
        block: region.to_string(),
        found: block.kind,
        needed: "lines of two nodes",
    })
}

fn term<const M: usize>(name: &str, activation: Option<usize>, segments: Vec<Segment>) -> Term {
    let mut nodes = Vec::with_capacity(M * segments.len());
    for s in &segments {
        let mut group: Vec<u32> = s.ends.iter().flatten().map(|e| e.0).collect();
        group.sort_unstable();
        group.dedup();
        group.resize(M, NO_NODE);
        nodes.extend(group);
    }
    let build: Builder = {
        let all = nodes.clone();
        Box::new(move |name, points, nodes, groups| {
            let renumbered = |(place, &group): (usize, &u32)| {
                let (old, new) = (&all[M * group as usize..][..M], &nodes[M * place..][..M]);
                let at = |n: u32| new[old.iter().position(|&o| o == n).expect("node of the group")];
                let s = &segments[group as usize];
                let ends = s.ends.clone().map(|end| end.iter().map(|&(n, w)| (at(n), w)).collect());
                Segment { ends, ..s.clone() }
            };
            let segments: Vec<Segment> = groups.iter().enumerate().map(renumbered).collect();
            Ok(Box::new(Lines::<M>::new(name, activation, points, &segments)) as Box<dyn Effect>)
        })
    };
    Term { name: name.to_string(), nodes_per_group: M, nodes, couples: true, build }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}
