//! Are the blocks of the muscles what a solver needs?

use std::path::Path;

use fem::mesh::muscle::{self, Bone, Loft, MuscleSections, grid};

fn sections() -> Vec<MuscleSections> {
    let text = include_str!("../gait-data/thigh/muscle_sections.csv");
    MuscleSections::read_csv(text, Path::new("muscle_sections.csv")).unwrap()
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

#[test]
fn the_thigh_reaches_its_goals() {
    let (sections, bones) = (sections(), bones());
    for (edge, cells) in [(9e-3, 12_000..24_000), (6e-3, 30_000..40_000)] {
        let built = muscle::build(&sections, &bones, edge);
        let missed = built.missed(&bones);
        assert!(missed.is_empty(), "{edge} m: {missed:?}");
        let n: usize = built.muscles.iter().map(|m| m.block.n_cells()).sum();
        assert!(cells.contains(&n), "{edge} m: {n} cells");
    }
}

#[test]
fn a_block_is_what_its_mesh_says() {
    for muscle in sections() {
        let loft = Loft::new(&muscle);
        for kind in [grid::SectionKind::rings(&muscle, 8e-3), grid::SectionKind::plain(&muscle, 8e-3)] {
            let block = grid::fill(&muscle.name, &loft, &kind.grid(), grid::layers(&muscle, 8e-3, 1.0));
            let mesh = muscle::to_mesh(std::slice::from_ref(&block));
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
