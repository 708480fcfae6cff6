//! Are the blocks of the muscles what a solver needs?

use std::path::Path;
use std::sync::OnceLock;

use coupling::steps::rigid_muscles_standing;
use coupling::thigh;
use coupling::thigh::build::{ThighEffects, ThighMuscle, reaches};
use coupling::thigh::inventory::inventory;
use coupling::thigh::lines::physiological_sections;
use coupling::thigh::registration::{MeshFrames, Registration};
use fem::contact::surface::{SurfaceInput, Surfaces};
use fem::geometry::{SearchSurface, Surface};
use fem::mesh::MeshError;
use mesher::attachment::{Attachment, Role, Site};
use mesher::limb::LimbMap;
use mesher::part::{is_strands, muscle_of};
use mesher::scale::{SegmentFrame, SegmentMap, map_sections};
use mesher::smooth::{Plane, Smoother};
use mesher::{Bone, Loft, MusclePart, MuscleSections, Station, grid};
use multibody::model::{Ankle, Model};
use multibody::walker::{Knee, walker};
use nalgebra::{Matrix3, Vector3};
use support::{Random, taylor_order};

const SECTIONS: &str = include_str!("../gait-data/thigh/muscle_sections.csv");

fn sections() -> Vec<MuscleSections> {
    MuscleSections::read_csv(SECTIONS, Path::new("muscle_sections.csv")).unwrap()
}

fn bones() -> Vec<Bone> {
    let text = include_str!("../gait-data/thigh/bone_sections.csv");
    Bone::read_csv(text, Path::new("bone_sections.csv")).unwrap()
}

/// Volumes of the lofts \[cm³\], quoted from the description of the tables (read from the surfaces with 4 × subdivision).
const LOFT_CM3: [(&str, f64); 17] = [
    ("gluteus_maximus", 341.2),
    ("gluteus_medius", 191.4),
    ("gluteus_minimus", 92.4),
    ("adductor_longus", 126.5),
    ("adductor_brevis", 40.6),
    ("adductor_magnus", 430.1),
    ("pectineus", 51.0),
    ("gracilis", 97.3),
    ("sartorius", 64.0),
    ("semimembranosus", 312.8),
    ("semitendinosus", 128.6),
    ("biceps_femoris_long_head", 468.6),
    ("biceps_femoris_short_head", 54.6),
    ("rectus_femoris", 331.2),
    ("vastus_medialis", 266.7),
    ("vastus_intermedius", 231.6),
    ("vastus_lateralis", 479.1),
];

#[test]
fn lofts_have_the_published_volumes() {
    let sections = sections();
    assert_eq!(sections.len(), LOFT_CM3.len());
    for (muscle, (name, volume)) in sections.iter().zip(LOFT_CM3) {
        assert_eq!(muscle.name, name);
        let fine = grid::SectionKind::Plain { across: 40, through: 16 }.grid();
        let n = 400;
        let block =
            grid::fill(name, &Loft::new(muscle), &fine, (0..=n).map(|i| i as f64 / n as f64).collect());
        let found = block.volume() * 1e6;
        println!("{name} {found:.2} {volume}");
        assert!((found / volume - 1.0).abs() < 0.01, "{name}: {found} cm³, published {volume}");
    }
}

/// Edges \[m\] of the whole thigh that several tests look at.
const EDGE: f64 = 9e-3;

fn whole() -> &'static mesher::Built {
    static WHOLE: OnceLock<mesher::Built> = OnceLock::new();
    WHOLE.get_or_init(|| mesher::build(&sections(), &bones(), EDGE))
}

/// At 6 mm it is hard case M1.
#[test]
fn the_thigh_reaches_its_goals() {
    let missed = whole().missed(&bones());
    assert!(missed.is_empty(), "{missed:?}");
    let n: usize = whole().muscles.iter().map(|m| m.block.n_cells()).sum();
    assert!((12_000..24_000).contains(&n), "{n} cells");
}

/// A surface of a muscle and the nodes of the mesh that move each of its triangles.
type Reading = (SearchSurface, Vec<Vec<u32>>);

/// By contact's own code.
fn as_in_contact(block: &mesher::MuscleBlock) -> Reading {
    let x: Vec<f64> = block.points.iter().flatten().copied().collect();
    let input = SurfaceInput {
        name: block.name.clone(),
        faces: block.surface(),
        stiffness: vec![1e4; block.surface().len()],
        spacing: f64::INFINITY, // no samples but the corners
    };
    let all = Surfaces::new(&[input], &x);
    let nodes =
        |t: &[u32; 3]| t.iter().flat_map(|&p| all.points[p as usize].weighted_nodes().map(|w| w.0)).collect();
    let triangles = all.triangles.iter().map(nodes).collect();
    let points = all.positions(&x).into_iter().map(Into::into).collect();
    (SearchSurface::new(Surface { points, triangles: all.triangles }), triangles)
}

/// Cut along a diagonal, as in files of surfaces.
fn as_in_files(block: &mesher::MuscleBlock) -> Reading {
    let (surface, nodes) = Surface::from_faces(&block.points, &block.surface());
    let triangles = surface.triangles.iter().map(|t| t.map(|p| nodes[p as usize]).to_vec()).collect();
    (SearchSurface::new(surface), triangles)
}

/// Quadrilaterals of muscles are not plane: the gap holds however they are read.
#[test]
fn muscles_keep_apart_as_contact_and_as_files_see_them() {
    let (sections, bones, built) = (sections(), bones(), whole());
    let blocks: Vec<_> = built.muscles.iter().map(|m| &m.block).collect();
    let bone_surfaces: Vec<_> = bones.iter().map(|b| SearchSurface::new(b.surface.clone())).collect();
    let read = [as_in_files, as_in_contact].map(|read| blocks.iter().map(|b| read(b)).collect::<Vec<_>>());
    for surfaces in &read {
        for (i, (a, nodes)) in surfaces.iter().enumerate() {
            let name = &blocks[i].name;
            assert!(a.self_intersections().is_empty(), "{name}");
            for (j, (b, _)) in surfaces.iter().enumerate().skip(i + 1) {
                let gap = a.least_gap(b).unwrap().closest.distance;
                assert!(gap >= 0.2e-3, "{name} and {}: {gap} m", blocks[j].name);
                // No pair comes closer than what is stated.
                assert!(built.muscles[i].gap.unwrap().0 <= gap + 1e-12, "{name}"); // to rounding
            }
            // Bones are met by the cells of the ends only, and where they are met it is stated.
            let per_layer = blocks[i].nodes_per_section as u32;
            let last = (blocks[i].n_layers() as u32 - 1) * per_layer;
            for (k, bone) in bone_surfaces.iter().enumerate() {
                for (t, _) in a.intersections(bone) {
                    let at_end = nodes[t as usize].iter().any(|&n| n < per_layer || n >= last);
                    assert!(at_end, "{name} meets {}", bones[k].name);
                    assert!(built.bone_crossings.iter().any(|c| (c.muscle, c.bone) == (i, k)), "{name}");
                }
            }
        }
    }
    // What it took: against each muscle meshed by itself.
    for (m, section) in built.muscles.iter().zip(&sections) {
        let alone = &mesher::build(std::slice::from_ref(section), &[], EDGE).muscles[0];
        let ways = m.block.points.iter().zip(&alone.block.points);
        let longest = ways.map(|(p, q)| (Vector3::from(*p) - Vector3::from(*q)).norm()).fold(0.0, f64::max);
        let name = &m.block.name;
        assert!(
            0.0 < m.moved[0] && m.moved[0] < m.moved[1] && m.moved[1] <= longest,
            "{name}: {:?}",
            m.moved
        );
        assert!((m.volume_before / alone.block.volume() - 1.0).abs() < 1e-12, "{name}");
        assert!(m.moved[1] < 6e-3 && (m.quality.volume / m.volume_before - 1.0).abs() < 0.02, "{name}");
        assert_eq!(alone.moved, [0.0; 2], "{name}");
    }
    let [two, four] = [0, 1].map(|r| read[r][0].1.len());
    assert_eq!(2 * two, four, "the same reading twice");
}

#[test]
fn a_block_is_what_its_mesh_says() {
    for muscle in sections() {
        let loft = Loft::new(&muscle);
        for kind in [grid::SectionKind::rings(&muscle, 8e-3), grid::SectionKind::plain(&muscle, 8e-3)] {
            let block = grid::fill(&muscle.name, &loft, &kind.grid(), grid::layers(&muscle, 8e-3, 1.0));
            let mesh = mesher::to_mesh(std::slice::from_ref(&block));
            let hexahedra = &mesh.blocks[0];
            assert_eq!((hexahedra.n_cells(), mesh.points.len()), (block.n_cells(), block.points.len()));
            assert!((block.volume() / mesh.volume(hexahedra) - 1.0).abs() < 1e-12, "{}", muscle.name);
            let sorted = |mut faces: Vec<[u32; 4]>| {
                faces.iter_mut().for_each(|f| {
                    let least = (0..4).min_by_key(|&i| f[i]).unwrap();
                    f.rotate_left(least);
                });
                faces.sort_unstable();
                faces
            };
            let surface = mesh.surface(&format!("{}/surface", muscle.name)).unwrap().to_vec();
            assert_eq!(sorted(surface), sorted(hexahedra.boundary().unwrap()), "{}", muscle.name);
            // The outline lies on the loft, where its parameter says.
            for layer in [0, block.n_layers() / 2] {
                for (&node, &t) in block.outline.iter().zip(&block.outline_parameter) {
                    let there = loft.point(t, block.s[layer]).position;
                    assert!((block.point(layer, node) - there).norm() < 1e-12);
                }
            }
        }
    }
}

#[test]
fn the_objective_of_smoothing_has_its_gradient() {
    let sections = sections();
    let muscle = sections.iter().find(|m| m.name == "adductor_magnus").unwrap(); // starts with inverted cells
    let loft = Loft::new(muscle);
    let mut random = Random::new(4);
    for (kind, k) in
        [(grid::SectionKind::rings(muscle, 12e-3), 3.0), (grid::SectionKind::plain(muscle, 12e-3), 20.0)]
    {
        let block = grid::fill(&muscle.name, &loft, &kind.grid(), grid::layers(muscle, 12e-3, 0.95));
        let volume = 1.02 * block.volume();
        let mut smoother = Smoother::new(block, loft.clone(), volume);
        smoother.anchored = true;
        smoother.smooth(k, 1); // sets the anchors
        let x: Vec<Vector3<f64>> = smoother.block.points.iter().map(|p| Vector3::from(*p)).collect();
        let first = smoother.block.side_faces()[7];
        let normal = Vector3::new(0.6, 0.0, 0.8);
        let nodes = first;
        let weights = [0.2, 0.4, 0.1, 0.3];
        let at: Vector3<f64> = (0..4).map(|i| x[nodes[i] as usize] * weights[i]).sum();
        smoother.planes.push(Plane { nodes, weights, normal, offset: normal.dot(&at) - 0.3e-3 });
        let moves: Vec<Vector3<f64>> = x.iter().map(|_| random.vector(1e-4)).collect();
        let there: Vec<Vector3<f64>> = x.iter().zip(&moves).map(|(x, d)| x + d * 0.5).collect();
        let mut gradient = vec![Vector3::zeros(); x.len()];
        smoother.objective(&there, k, &mut gradient);
        let slope: f64 = gradient.iter().zip(&moves).map(|(g, d)| g.dot(d)).sum();
        let smoother = std::cell::RefCell::new(smoother);
        let order = taylor_order(
            |h| {
                let moved: Vec<Vector3<f64>> = there.iter().zip(&moves).map(|(x, d)| x + d * h).collect();
                smoother.borrow_mut().objective(&moved, k, &mut vec![Vector3::zeros(); moved.len()])
            },
            slope,
            1e-3,
        );
        assert!(order > 1.9, "{kind:?}: order {order}");
    }
}

#[test]
fn a_bad_table_of_sections_is_refused_with_its_line() {
    let lines: Vec<&str> = SECTIONS.lines().collect();
    let header: Vec<&str> = lines[0].split(',').collect();
    let column = |name: &str| header.iter().position(|h| *h == name).unwrap();
    // The table with some cells of one line replaced; line 3 is the second section of the first muscle.
    let with = |line: usize, cells: &[(&str, &str)]| {
        let mut table: Vec<String> = lines.iter().map(|l| l.to_string()).collect();
        let mut row: Vec<String> = table[line - 1].split(',').map(str::to_string).collect();
        for (name, value) in cells {
            row[column(name)] = value.to_string();
        }
        table[line - 1] = row.join(",");
        table.join("\n")
    };
    let scaled = |factor: f64| {
        let rows = lines[1..].iter().map(|line| {
            let cells = line.split(',').zip(&header).map(|(cell, name)| {
                let length = matches!(name.as_bytes()[0], b'c' | b'u' | b'w')
                    || (name.starts_with('v') && name.len() <= 3);
                if length { (cell.parse::<f64>().unwrap() * factor).to_string() } else { cell.to_string() }
            });
            cells.collect::<Vec<_>>().join(",")
        });
        [lines[0].to_string()].into_iter().chain(rows).collect::<Vec<_>>().join("\n")
    };
    let swapped = {
        let mut table = lines.clone();
        table.swap(2, 3);
        table.join("\n")
    };
    let twice = [&lines[..], &lines[1..12]].concat().join("\n");
    let cases: Vec<(String, usize, &str)> = vec![
        (with(3, &[("cx", "abc")]), 3, "cx is `abc`"),
        (with(3, &[("u7", "NaN")]), 3, "u7 is `NaN`"),
        (with(3, &[("nx", "0.9"), ("ny", "0.9")]), 3, "has length"),
        (with(3, &[("ax", "0.2124"), ("ay", "-0.4980"), ("az", "0.8408")]), 3, "not orthogonal"),
        (with(3, &[("s", "0.2")]), 4, "not above that of the section before"),
        (with(2, &[("s", "0.01")]), 2, "runs from 0"),
        (with(3, &[("u1", "73.1"), ("v1", "20.1"), ("w1", "0.0")]), 3, "boundary points 0 and 1 coincide"),
        (with(3, &[("u3", "9.5"), ("v3", "-17.2"), ("u10", "-22.4"), ("v10", "10.4")]), 3, "crosses itself"),
        (with(3, &[("cx", "-75.3"), ("cy", "35.4"), ("cz", "-62.2")]), 3, "the sections cross"),
        (with(2, &[("muscle", "")]), 2, "no name"),
        (lines[0].to_string(), 1, "no sections"),
        (lines[..2].join("\n"), 2, "at least two"),
        (SECTIONS.replacen(",w13,", ",q13,", 1), 1, "column `w13` is missing"),
        (swapped, 3, "list each muscle once, its stations in order"),
        (twice, lines.len() + 1, "appears a second time"),
        (scaled(1000.0), 2, "lengths of the table are in mm"), // a thigh of 400 m
        (scaled(0.001), 2, "lengths of the table are in mm"),
        (lines[..40].join("\n") + "\nrow,with,too,few", 41, "not a row"),
    ];
    // As saved by a spreadsheet, too.
    let windows =
        cases.clone().into_iter().map(|(text, line, words)| (text.replace('\n', "\r\n"), line, words));
    for (text, line, words) in windows.chain(cases) {
        match MuscleSections::read_csv(&text, Path::new("sections.csv")) {
            Ok(_) => panic!("accepted, expected: {words}"),
            Err(error @ MeshError::Format { .. }) => {
                let message = error.to_string();
                assert!(
                    message.contains(words) && message.contains(&format!("line {line}:")),
                    "{message} ({words})"
                );
                assert!(message.contains("sections.csv"), "{message}");
            }
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn a_bad_table_of_bones_is_refused() {
    let text = include_str!("../gait-data/thigh/bone_sections.csv");
    let flipped = text.replacen("hip_bone,f,0,", "hip_bone,f,0,,", 1);
    for (text, words) in [
        (flipped, "line 262"),
        (text.replacen("hip_bone,v,1,", "hip_bone,v,7,", 1), "index 7 where 1 was expected"),
        (text.replacen("patella,v,0,", "patella,v,0,x", 1), "not a finite number"),
        (text.replacen("bone,item", "bone,itme", 1), "columns must be"),
        (
            text.lines().filter(|l| !l.starts_with("tibia,f,0,")).collect::<Vec<_>>().join("\n"),
            "index 1 where 0",
        ),
    ] {
        let message = Bone::read_csv(&text, Path::new("bones.csv")).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("bones.csv"), "{message} ({words})");
    }
    // A triangle missing at the end leaves a hole.
    let lines: Vec<&str> = text.lines().collect();
    let last = lines.iter().rposition(|l| l.starts_with("femur,f,")).unwrap();
    let open = [&lines[..last], &lines[last + 1..]].concat().join("\n");
    let message = Bone::read_csv(&open, Path::new("bones.csv")).unwrap_err().to_string();
    assert!(message.contains("`femur`"), "{message}");
}

#[test]
fn meshes_are_the_same_on_any_number_of_threads() {
    let (sections, bones) = (sections(), bones());
    let quadriceps: Vec<_> =
        sections.into_iter().filter(|m| m.name.starts_with("vastus") || m.name == "rectus_femoris").collect();
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| mesher::build(&quadriceps, &bones, 10e-3))
    };
    let (one, two) = (build(1), build(2));
    assert!(one.rounds > 0);
    for (a, b) in one.muscles.iter().zip(&two.muscles) {
        let bits = |m: &mesher::MuscleResult| -> Vec<u64> {
            m.block.points.iter().flatten().map(|x| x.to_bits()).collect()
        };
        assert!(bits(a) == bits(b), "{}", a.block.name);
    }
    assert!(one == two);
}

#[test]
fn scaling_carries_a_muscle_with_its_segments() {
    let text = include_str!("../gait-data/thigh/limb_frames.csv");
    let frames = SegmentFrame::read_csv(text, Path::new("limb_frames.csv")).unwrap();
    let frame = |name: &str| frames.iter().find(|f| f.segment == name).unwrap();
    let sections = sections();
    let muscle = sections.iter().find(|m| m.name == "rectus_femoris").unwrap();
    let (hip, knee) = (frame("thigh").origin, frame("shank").origin);
    let chain = |factors: [Vector3<f64>; 3], knee_to: Vector3<f64>| {
        let map = |name: &str, to: Vector3<f64>, k| SegmentMap::new(frame(name), to, frame(name).axes, k);
        [
            map("pelvis", frame("pelvis").origin, factors[0]),
            map("thigh", hip, factors[1]),
            map("shank_knee_aligned", knee_to, factors[2]),
        ]
    };
    let one = Vector3::repeat(1.0);
    // Nothing scaled: the same muscle.
    let same = map_sections(muscle, &chain([one; 3], knee), &[hip, knee]);
    for (a, b) in same.stations.iter().zip(&muscle.stations) {
        // s of the table is rounded to four decimals, centres to 0.1 mm.
        assert!((a.centre - b.centre).norm() < 1e-6 && (a.s - b.s).abs() < 5e-4, "{} {}", a.s, b.s);
        assert!(a.normal.dot(&b.normal) > 0.99, "{}", a.normal.dot(&b.normal));
    }
    // All scaled by 1.1 about the hip: volume by 1.1³.
    let all = SegmentMap { linear: nalgebra::Matrix3::identity() * 1.1, from: hip, to: hip };
    let large = map_sections(muscle, &[all.clone(), all.clone(), all], &[hip, knee]);
    large.check().unwrap();
    let volume = |m: &MuscleSections| mesher::loft_volume(&Loft::new(m), 1.0);
    assert!((volume(&large) / volume(muscle) - 1.331).abs() < 1e-3);
    // A longer thigh: the origin stays on the pelvis, the end follows the knee, the belly is stretched.
    let k = 1.08;
    let axes = frame("thigh").axes;
    let long = Vector3::new(1.0, k, 1.0);
    let knee_to = hip + axes * (axes.transpose() * (knee - hip)).component_mul(&long);
    let longer = map_sections(muscle, &chain([one, long, one], knee_to), &[hip, knee]);
    longer.check().unwrap();
    let (first, last) = (&longer.stations[0], longer.stations.last().unwrap());
    assert!((first.centre - muscle.stations[0].centre).norm() < 1e-6);
    let end = muscle.stations.last().unwrap().centre;
    assert!((last.centre - (end + knee_to - knee)).norm() < 1e-4);
    assert!(volume(&longer) / volume(muscle) > 1.05);
    // A muscle that arises below the hip centre still begins on the pelvis.
    let adductor = sections.iter().find(|m| m.name == "adductor_longus").unwrap();
    let maps = &chain([one, long, one], knee_to)[..2];
    let moved = map_sections(adductor, maps, &[hip]);
    assert!((moved.stations[0].centre - adductor.stations[0].centre).norm() < 1e-6);
}

/// Between two segments a muscle follows w p″ + (1 − w) p′ with w = x² (3 − 2 x) over 60 mm of its length.
#[test]
fn a_muscle_passes_smoothly_from_one_segment_to_the_next() {
    let station = |i: usize| {
        let centre = Vector3::new(0.0, -5e-3 * i as f64, 0.0);
        let corner = |k: usize| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / 14.0).sin_cos();
            centre + Vector3::new(0.01 * cos, 0.0, 0.01 * sin)
        };
        let (normal, axis) = (-Vector3::y(), Vector3::z());
        Station { s: i as f64 / 40.0, centre, normal, axis, outline: std::array::from_fn(corner) }
    };
    let column = MuscleSections { name: "column".into(), stations: (0..=40).map(station).collect() };
    let still =
        |to: Vector3<f64>| SegmentMap { linear: nalgebra::Matrix3::identity(), from: Vector3::zeros(), to };
    let aside = Vector3::new(0.01, 0.0, 0.0);
    let joint = Vector3::new(0.0, -0.1, 0.0);
    let moved = map_sections(&column, &[still(Vector3::zeros()), still(aside)], &[joint]);
    for (before, after) in column.stations.iter().zip(&moved.stations) {
        let x = ((joint.y - before.centre.y) / 0.06 + 0.5).clamp(0.0, 1.0);
        let w = x * x * (3.0 - 2.0 * x);
        assert!((after.centre - before.centre - aside * w).norm() < 1e-12, "{x}: {:?}", after.centre);
        let corners = after.outline.iter().zip(&before.outline);
        corners.for_each(|(a, b)| assert!((a - b - aside * w).norm() < 1e-12));
    }
}

#[test]
fn a_limb_of_another_size_is_carried_by_its_segments() {
    let limb = thigh::limb().unwrap();
    let MeshFrames { hip, knee, thigh: axes, .. } = MeshFrames::built_in();
    let k = 1.1;
    // Everything alike: the whole limb grows as a body.
    let grown = limb.mapped(&LimbMap::sized(hip, knee, k, k, k)).unwrap();
    let volume = |m: &MuscleSections| mesher::loft_volume(&Loft::new(m), 1.0);
    for (a, b) in limb.sections.iter().zip(&grown.sections) {
        b.check().unwrap();
        let ratio = volume(b) / volume(a);
        assert!((ratio - k.powi(3)).abs() < 1e-3, "{}: {ratio}", a.name); // s of the table is rounded
    }
    for (a, b) in limb.bones.iter().zip(&grown.bones) {
        assert!((b.surface.volume() / a.surface.volume() - k.powi(3)).abs() < 1e-9, "{}", a.name);
    }
    // Only along the thigh: what lies in the thigh follows its map exactly, the patella moves with the knee.
    let longer = axes * Matrix3::from_diagonal(&Vector3::new(1.0, k, 1.0)) * axes.transpose();
    let mut map = LimbMap::sized(hip, knee, 1.0, 1.0, 1.0);
    map.thigh.linear = longer;
    let shift = map.thigh.apply(&knee) - knee;
    map.patella.to += shift;
    map.shank.to += shift;
    let long = limb.mapped(&map).unwrap();
    for (before, after) in limb.sections.iter().zip(&long.sections) {
        let name = before.name.as_str();
        let on = |role: Role| {
            &limb.attachments.iter().find(|a| a.muscle == name && a.role == role).unwrap().segment
        };
        let ends = [on(Role::Origin), on(Role::Insertion)];
        let (n, mut within) = (before.stations.len() - 1, 0);
        for (i, (a, b)) in before.stations.iter().zip(&after.stations).enumerate() {
            let moved = |m: &SegmentMap| {
                a.outline.iter().zip(&b.outline).map(|(p, q)| (m.apply(p) - q).norm()).fold(0.0, f64::max)
            };
            if i == 0 || i == n {
                assert!(moved(map.of(ends[i / n]).unwrap()) < 1e-12, "{name}, end {}", i / n);
            }
            within += usize::from(moved(&map.thigh) < 1e-12);
        }
        assert!(ends.iter().all(|e| *e != "thigh") || within > 0, "{name}");
        let ratio = volume(after) / volume(before);
        // The step at a joint also takes up what the two ends shift against each other: a little less or more than both segments.
        assert!((0.98..k + 0.02).contains(&ratio), "{name}: {ratio}");
        if name == "vastus_intermedius" {
            assert!(within > n * 3 / 4, "{within} of {n}");
            // Its part in the thigh: volume by the determinant of the map.
            let part = |m: &MuscleSections| {
                let mut m = m.clone();
                m.stations.truncate(within);
                let end = m.stations[within - 1].s;
                m.stations.iter_mut().for_each(|station| station.s /= end);
                volume(&m)
            };
            let ratio = part(after) / part(before);
            assert!((ratio - k).abs() < 2e-3, "{ratio}");
        }
    }
    let volume = |bones: &[Bone], name: &str| bones.iter().find(|b| b.name == name).unwrap().surface.volume();
    assert!((volume(&long.bones, "femur") / volume(&limb.bones, "femur") - k).abs() < 1e-9);
    assert!((volume(&long.bones, "tibia") / volume(&limb.bones, "tibia") - 1.0).abs() < 1e-9);
    for (a, b) in limb.attachments.iter().zip(&long.attachments).filter(|(a, _)| a.segment == "shank") {
        for (p, q) in a.tendon.iter().chain(&a.reference_point).zip(b.tendon.iter().chain(&b.reference_point))
        {
            assert!((p + shift - q).norm() < 1e-12, "{}", a.muscle);
        }
    }
    // A patch stays between the same sections: of short head and vasti, whose lines are stretched unevenly.
    let patch = |attachments: &[Attachment], name: &str| {
        let of = |a: &Attachment| match a.site {
            Site::SidePatch { s, .. } if a.muscle == name && a.role == Role::Origin => Some(s),
            _ => None,
        };
        attachments.iter().find_map(of).unwrap()
    };
    let name = "biceps_femoris_short_head";
    let (before, after) = (patch(&limb.attachments, name), patch(&long.attachments, name));
    let height = |sections: &[MuscleSections], s: f64| {
        Loft::new(sections.iter().find(|m| m.name == name).unwrap()).point(3.0, s).position
    };
    for (s, t) in before.into_iter().zip(after) {
        let (p, q) = (height(&limb.sections, s), height(&long.sections, t));
        assert!((map.thigh.apply(&p) - q).norm() < 2e-3, "{s} {t}");
    }
    // What is attached to nothing cannot be carried along.
    let mut loose = limb.clone();
    loose.attachments.retain(|a| a.muscle != "gracilis");
    let message = loose.mapped(&map).unwrap_err().to_string();
    assert!(message.contains("`gracilis`") && message.contains("origin"), "{message}");
}

#[test]
fn semimembranosus_inserts_at_the_back_of_the_condyle() {
    let drawn = sections().into_iter().find(|m| m.name == "semimembranosus").unwrap();
    let limb = thigh::limb().unwrap();
    let ended = limb.sections.iter().find(|m| m.name == "semimembranosus").unwrap();
    ended.check().unwrap();
    let rows: Vec<_> = limb
        .attachments
        .iter()
        .filter(|a| a.muscle == "semimembranosus" && a.role == Role::Insertion)
        .collect();
    let [row] = rows[..] else { panic!("{rows:?}") };
    let point = Vector3::new(-23.1, -456.6, -29.6) * 1e-3;
    assert_eq!((&row.site, row.tendon.as_slice()), (&Site::EndFace, &[point][..]));
    let end = ended.stations.last().unwrap();
    let degrees = |d: Vector3<f64>| end.normal.angle(&d).to_degrees();
    assert!(degrees(point - end.centre) < 45.0);
    // The drawn one turns away from it.
    let last = drawn.stations.last().unwrap();
    assert!(last.normal.angle(&(point - last.centre)).to_degrees() > 90.0);
    let volume = |m: &MuscleSections| mesher::loft_volume(&Loft::new(m), 1.0);
    assert!((0.95..1.0).contains(&(volume(ended) / volume(&drawn))));
    // The others are as drawn.
    let others = |m: &&MuscleSections| m.name != "semimembranosus";
    assert!(limb.sections.iter().filter(others).eq(sections().iter().filter(others)));
}

#[test]
fn every_muscle_has_its_fibres_attachments_and_line() {
    let limb = thigh::limb().unwrap();
    let built = mesher::build(&limb.sections, &[], 8e-3);
    let blocks: Vec<_> = built.muscles.iter().map(|m| &m.block).collect();
    let (trial, anatomy) = walker(Knee::Hinge);
    let model = Model::new(&trial, anatomy, Ankle::Universal).unwrap();
    let registration = Registration::new(MeshFrames::built_in(), &model).unwrap();
    let rigid = rigid_muscles_standing(&model, &registration);
    let areas = physiological_sections();
    let stock = inventory(
        &blocks,
        &limb.attachments,
        &|m| areas.get(m).copied(),
        &reaches(&limb.bones, Default::default()),
        &rigid,
    );
    assert_eq!(stock.len(), 17);
    // Areas as measured on the surfaces, from the table.
    let text = include_str!("../gait-data/thigh/attachments.csv");
    let mut table = csv::Reader::from_reader(text.as_bytes());
    let mut measured = std::collections::BTreeMap::<[String; 3], f64>::new();
    for row in table.records().map(Result::unwrap).filter(|row| !row[11].is_empty()) {
        *measured.entry([0, 1, 2].map(|i| row[i].to_string())).or_default() +=
            row[11].parse::<f64>().unwrap();
    }
    for m in &stock {
        let name = &m.name;
        assert!((m.fibre_area_mm2 / m.section_mm2 - 1.0).abs() < 1e-12, "{name}");
        assert!((m.section_mm2 / (1e6 * areas[name]) - 1.0).abs() < 1e-12, "{name}");
        for (hold, end) in [(&m.origin, "origin"), (&m.insertion, "insertion")] {
            let of = |kind: &str| measured.get(&[name.clone(), end.to_string(), kind.to_string()]);
            // Adductor magnus ends at s = 0.95 and semimembranosus at 0.81 of what was measured.
            let cut = end == "insertion" && ["adductor_magnus", "semimembranosus"].contains(&name.as_str());
            if let (Some(&area), false) = (of("end_face"), cut) {
                let ratio = hold.face_mm2 / area;
                assert!((0.8..1.15).contains(&ratio), "{name}, {end}: {} of {area} mm²", hold.face_mm2);
            }
            // Small patches are smaller than a cell.
            if let Some(&area) = of("side_patch").filter(|a| **a > 2000.0) {
                let ratio = hold.side_mm2 / area;
                assert!((0.8..1.2).contains(&ratio), "{name}, {end}: {} of {area} mm²", hold.side_mm2);
            }
        }
        let line = m.line.as_ref().unwrap();
        assert_eq!(line.explanation.is_empty(), line.angle_deg <= 15.0, "{name}");
        let degrees = |d: Vector3<f64>| Vector3::from(line.mesh).angle(&d).to_degrees();
        assert!((degrees(line.rigid.into()) - line.angle_deg).abs() < 1e-9, "{name}");
        let lines = &rigid.iter().find(|r| r.name == *name).unwrap().lines;
        let least = lines.iter().map(|l| degrees(l.direction())).fold(f64::INFINITY, f64::min);
        assert!((least - line.nearest_line_deg).abs() < 1e-9, "{name}");
        assert!(line.nearest_fibre_deg + line.spread_deg >= line.angle_deg - 1e-9, "{name}");
        assert!(line.angle_deg <= 30.0, "{name}: {}", line.angle_deg);
    }
    let off: Vec<_> = stock.iter().filter(|m| m.line.as_ref().unwrap().angle_deg > 15.0).collect();
    assert!(off.len() <= 4, "{:?}", off.iter().map(|m| &m.name).collect::<Vec<_>>());
}

/// A surface that moves inwards by a little sweeps its area times the way; one that moves far leaves a muscle that can be meshed.
#[test]
fn muscles_inset_lose_a_layer_of_that_thickness() {
    for muscle in sections() {
        let name = &muscle.name;
        let volume = |m: &MuscleSections| mesher::loft_volume(&Loft::new(m), 1.0);
        let block = mesher::sampled(&Loft::new(&muscle), [20, 8], 1.0);
        let (surface, _) = Surface::from_faces(&block.points, &block.side_faces());
        let side: f64 = (0..surface.triangles.len()).map(|t| surface.area_vector(t).norm()).sum();
        let by = 0.2e-3;
        let inset = |by: f64| muscle.inset(by).unwrap_or_else(|e| panic!("{e}"));
        let layer = (volume(&muscle) - volume(&inset(by))) / (side * by);
        assert!((layer - 1.0).abs() < 0.12, "{name}: {layer} times the layer of {by} m");
        let mut before = volume(&muscle);
        for by in [1e-3, 2.5e-3, 5e-3] {
            let thin = inset(by);
            assert!(volume(&thin) < before, "{name} inset by {by} m");
            before = volume(&thin);
        }
        // A third of width and thickness is left of a strap, a ninth of its section.
        assert!(before > 0.11 * volume(&muscle), "{name}: {before} m³ are left");
    }
}

/// As in the publication's reading, where muscles lie some millimetres apart.
#[test]
fn a_thigh_inset_has_wide_gaps() {
    let effects = ThighEffects { fibres: None, shells: false };
    let [as_drawn, wide] = [0.0, 5e-3].map(|by| {
        thigh::from_limb(thigh::limb().unwrap(), 12e-3, by, &[], effects).expect("built-in sections")
    });
    for made in [&as_drawn, &wide] {
        assert!(made.built.muscles.iter().all(|m| m.quality.least_scaled_jacobian > 0.3));
    }
    for (before, after) in as_drawn.built.muscles.iter().zip(&wide.built.muscles) {
        let ([before, after], name) =
            ([before, after].map(|m| m.gap.expect("17 muscles").0), &before.block.name);
        assert!(after > before + 1.5e-3, "{name}: {after} m from its neighbours, {before} m before");
    }
    // What grows from bone still does, and not much more.
    for (before, after) in as_drawn.thigh.muscles.iter().zip(&wide.thigh.muscles) {
        let tied = |m: &ThighMuscle| m.tied.values().map(Vec::len).sum::<usize>() as f64;
        let (name, before, after) = (&before.name, tied(before), tied(after));
        assert!(
            0.5 * before <= after && after <= 1.25 * before,
            "{name}: {after} nodes are tied, {before} before"
        );
    }
}

#[test]
fn names_say_of_which_muscle_they_are() {
    let parts = [
        MusclePart::Belly,
        MusclePart::Surface,
        MusclePart::On("thigh"),
        MusclePart::TendonFibres,
        MusclePart::Strands(2),
    ];
    for part in parts {
        assert_eq!(muscle_of(&part.of("gracilis")), "gracilis", "{part:?}");
        assert_eq!(is_strands(&part.of("gracilis")), matches!(part, MusclePart::Strands(_)), "{part:?}");
    }
}
