//! Do mesh files and meshes survive reading, writing and damage?
#![allow(non_snake_case)]

use std::path::{Path, PathBuf};

use fem::mesh::format::{abaqus, gmsh, pvd::PvdWriter, vtu};
use fem::mesh::{CellBlock, CellKind, LengthUnit, Mesh, MeshError, Place, generate};
use support::allocations::{Counting, with_peak};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("mesh_data").join(name)
}

fn read(name: &str) -> Mesh {
    Mesh::read(&data(name), LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}"))
}

/// Parses by the ending of the name.
fn parse(name: &str, bytes: &[u8]) -> Result<Mesh, MeshError> {
    let file = Path::new(name);
    match file.extension().and_then(|e| e.to_str()) {
        Some("msh") => gmsh::parse(bytes, file, LengthUnit::Metre),
        Some("inp") => abaqus::parse(bytes, file, LengthUnit::Metre),
        _ => vtu::parse(bytes, file, LengthUnit::Metre).map(|v| v.mesh),
    }
}

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * b.abs()
}

/// Area of a surface of flat faces \[m²\].
fn area(mesh: &Mesh, faces: &[[u32; 4]]) -> f64 {
    let X = |n: u32| nalgebra::Vector3::from(mesh.points[n as usize]);
    faces
        .iter()
        .map(|&[a, b, c, d]| (X(c) - X(a)).cross(&(X(d) - X(b))).norm() / 2.0 + triangle(&X, a, b, c, d))
        .sum()
}

/// The part of [`area`] that the diagonals of a triangle (last node repeated) leave out.
fn triangle(X: &impl Fn(u32) -> nalgebra::Vector3<f64>, a: u32, b: u32, c: u32, d: u32) -> f64 {
    if c == d {
        (X(b) - X(a)).cross(&(X(c) - X(a))).norm() / 2.0 - (X(c) - X(a)).cross(&(X(d) - X(b))).norm() / 2.0
    } else {
        0.0
    }
}

// ---------------------------------------------------------------- files of other programs

#[test]
fn gmsh_files_of_all_versions_hold_the_same_mesh() {
    for (shape, kind) in [("hex8", CellKind::Hex8), ("tet10", CellKind::Tet10)] {
        let reference = read(&format!("{shape}_v41_ascii.msh"));
        reference.check().expect("a good mesh");
        let block = reference.block("rectus femoris").expect("the physical volume");
        assert_eq!(block.kind, kind);
        assert!(close(reference.volume(block), 2.0, 1e-14), "{shape}: volume {}", reference.volume(block));
        let at_zero: Vec<u32> =
            (0..).zip(&reference.points).filter(|(_, p)| p[0] == 0.0).map(|(i, _)| i).collect();
        assert_eq!(reference.node_set("origin").expect("the physical surface"), at_zero);
        assert!(close(area(&reference, reference.surface("origin").unwrap()), 1.0, 1e-14));
        for variant in ["v41_binary", "v22_ascii", "v22_binary"] {
            let mut mesh = read(&format!("{shape}_{variant}.msh"));
            // Gmsh writes text with 16 digits, one too few for some doubles.
            for (p, q) in mesh.points.iter_mut().flatten().zip(reference.points.iter().flatten()) {
                assert!((*p - q).abs() < 1e-15, "{shape}_{variant}");
                *p = *q;
            }
            assert_eq!(mesh, reference, "{shape}_{variant}");
        }
    }
}

/// A wedge of volume 1/2: the triangle (0,0) (1,0) (0,1) over a height of 1, first node, then the second layer.
#[test]
fn wedges_of_all_formats_are_the_same_cell() {
    let points = "0 0 0 1 0 0 0 1 0 0 0 1 1 0 1 0 1 1";
    let numbers: Vec<&str> = points.split(' ').collect();
    let nodes = |separator: &str| -> String {
        numbers.chunks(3).zip(1..).map(|(p, i)| format!("{i}{separator}{}\n", p.join(separator))).collect()
    };
    let msh = format!(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n6\n{}$EndNodes\n$Elements\n1\n1 6 2 1 1 1 2 3 4 5 6\n$EndElements\n",
        nodes(" ")
    );
    let inp = format!("*NODE\n{}*ELEMENT, TYPE=C3D6\n1,1,2,3,4,5,6\n", nodes(","));
    let array = |kind: &str, name: &str, n: usize, text: &str| {
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{n}\" format=\"ascii\">{text}</DataArray>"
        )
    };
    let vtu = format!(
        "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\"><UnstructuredGrid>\
         <Piece NumberOfPoints=\"6\" NumberOfCells=\"1\"><Points>{}</Points><Cells>{}{}{}</Cells></Piece>\
         </UnstructuredGrid></VTKFile>",
        array("Float64", "Points", 3, points),
        array("Int64", "connectivity", 1, "0 1 2 3 4 5"),
        array("Int64", "offsets", 1, "6"),
        array("UInt8", "types", 1, "13")
    );
    for (name, text) in [("a.msh", msh), ("a.inp", inp), ("a.vtu", vtu)] {
        let mesh = parse(name, text.as_bytes()).unwrap_or_else(|e| panic!("{e}"));
        mesh.check().unwrap_or_else(|e| panic!("{name}: {e}"));
        let block = &mesh.blocks[0];
        assert_eq!((block.kind, &block.nodes[..]), (CellKind::Wedge6, &[0, 1, 2, 3, 4, 5][..]), "{name}");
        assert!(close(mesh.volume(block), 0.5, 1e-15), "{name}: volume {}", mesh.volume(block));
    }
}

#[test]
fn quadratic_edges_of_gmsh_lie_between_their_corners() {
    let mesh = read("tet10_v41_ascii.msh");
    for cell in mesh.block("rectus femoris").unwrap().cells() {
        let X = |i: usize| nalgebra::Vector3::from(mesh.points[cell[i] as usize]);
        for (middle, [a, b]) in (4..).zip([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]) {
            assert!(
                (X(middle) - (X(a) + X(b)) / 2.0).norm() < 1e-12,
                "node {middle} is not between {a} and {b}"
            );
        }
    }
}

#[test]
fn vtk_files_of_all_encodings_hold_the_same_mesh_and_fields() {
    let names: Vec<String> = fixture_names("vtu");
    assert_eq!(names.len(), 13);
    let reference = vtu::read(&data("vtk_ascii.vtu"), LengthUnit::Metre).expect("readable");
    reference.mesh.check().expect("a good mesh");
    assert_eq!(
        reference.mesh.blocks.iter().map(|b| b.name.as_str()).collect::<Vec<_>>(),
        ["region_7", "region_3"]
    );
    assert!(close(reference.mesh.blocks.iter().map(|b| reference.mesh.volume(b)).sum(), 2.0, 1e-14));
    let displacement = &reference.point_data[0];
    assert_eq!((displacement.name.as_ref(), displacement.components), ("displacement", 3));
    for (i, u) in displacement.values.chunks(3).enumerate() {
        assert_eq!(u, [0.1 * i as f64, 0.0, -(i as f64)]);
    }
    assert_eq!(
        (reference.cell_data[0].name.as_ref(), &*reference.cell_data[0].values),
        ("pressure", &[0.0, 0.5][..])
    );
    for name in names {
        assert_eq!(
            vtu::read(&data(&name), LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}")),
            reference,
            "{name}"
        );
    }
}

fn fixture_names(ending: &str) -> Vec<String> {
    let folder = std::fs::read_dir(data("")).expect("the folder with the fixtures");
    let names = folder.map(|entry| entry.expect("readable").file_name().into_string().expect("plain names"));
    let mut names: Vec<String> = names.filter(|n| n.ends_with(&format!(".{ending}"))).collect();
    names.sort();
    names
}

const ABAQUS: &str = "\u{feff}** made by hand\r
*Heading\r
 anything, *even* this\r
*Part, name=Thigh\r
*Node, nset=ALL\r
 10, 0., 0., 0.\r
 20, 1.0D3, 0, 0\r
 30, 1000, 1000, 0\r
 40, 0, 1000\r
 50, 0, 0, 1000\r
 60, 1000, 0, 1000\r
 70, 1000, 1000, 1000\r
 80, 0, 1000, 1000\r
 90, 0, 0, 2e3\r
*Element, type=C3D8R\r
 1, 10, 20, 30, 40,\r
 50, 60, 70, 80\r
*Element, type=C3D4\r
 2, 50, 60, 80, 90\r
*Element, type=T3D2, elset=fibres\r
 5, 10, 20\r
 6, 50, 60\r
*Element, type=SFM3D3, elset=skin\r
 7, 10, 30, 20\r
*Nset, nset=bottom, generate\r
 10, 40, 10\r
*Nset, nset=mixed\r
 bottom, 90, 50,\r
** a comment\r
 60\r
*Elset, elset=belly\r
 1, 2\r
*Elset, elset=tip\r
 2\r
*Surface, type=ELEMENT, name=wall\r
 BELLY, s1\r
 1, S4\r
*Solid Section, elset=tip,\r
 material=tendon\r
 1.,\r
*Solid Section, elset=belly, material=muscle\r
*End Part\r
";

#[test]
fn abaqus_files_as_people_write_them() {
    let mesh =
        abaqus::parse(ABAQUS.as_bytes(), Path::new("hand.inp"), LengthUnit::Millimetre).expect("readable");
    mesh.check().expect("a good mesh");
    let kinds: Vec<_> = mesh.blocks.iter().map(|b| (b.name.as_str(), b.kind, b.n_cells())).collect();
    // The first section that holds element 2 is `tip`; element 1 is in `belly` only.
    assert_eq!(
        kinds,
        [("belly", CellKind::Hex8, 1), ("tip", CellKind::Tet4, 1), ("fibres", CellKind::Line2, 2)]
    );
    assert_eq!(mesh.points[1], [1.0, 0.0, 0.0]);
    assert!(
        close(mesh.volume(&mesh.blocks[0]), 1.0, 1e-14)
            && close(mesh.volume(&mesh.blocks[1]), 1.0 / 6.0, 1e-14)
    );
    assert_eq!(mesh.node_set("bottom").unwrap(), [0, 1, 2, 3]);
    assert_eq!(mesh.node_set("mixed").unwrap(), [0, 1, 2, 3, 4, 5, 8]);
    assert_eq!(mesh.node_set("ALL").unwrap().len(), 9);
    assert_eq!(mesh.surface("skin").unwrap(), [[0, 2, 1, 1]]);
    // S1 of the hexahedron is its bottom, of the tetrahedron 50-60-80; S4 of the hexahedron is x = 1.
    assert_eq!(mesh.surface("wall").unwrap(), [[0, 3, 2, 1], [4, 7, 5, 5], [1, 2, 6, 5]]);
}

#[test]
fn abaqus_input_that_would_be_misread_is_refused() {
    let start = "*NODE\n1,0,0,0\n2,1,0,0\n";
    for (text, wanted) in [
        ("*ELEMENT, TYPE=C3D20\n1,1,2\n", "`C3D20` is not supported"),
        ("*ELEMENT, TYPE=T3D2\n1,1,3\n", "names node 3"),
        ("*ELEMENT, TYPE=T3D2\n1,1\n", "fewer than 2 nodes"),
        ("*ELEMENT, TYPE=T3D2\n1,1,2\n1,2,1\n", "element 1 is given twice"),
        ("*ELEMENT, TYPE=T3D2\n1,1,2\n*NODE\n2,0,0,0\n", "node 2 is given twice"),
        ("*ELEMENT\n1,1,2\n", "needs the parameter TYPE="),
        ("*ELEMENT, TYPE=T3D2\n1,1,2\n*NSET, NSET=a\n7\n", "`7` is no node"),
        ("*ELEMENT, TYPE=T3D2\n1,1,2\n*NSET, NSET=a, GENERATE\n1,4000000000,1\n", "only 2 of them exist"),
        ("*ELEMENT, TYPE=T3D2\n1,1,2\n*NSET, NSET=a, GENERATE\n1,2,0\n", "increment > 0"),
        ("*ELEMENT, TYPE=T3D2\n1,1,2\n*SURFACE, NAME=a\n1,S1\n", "is no face of a line2"),
        ("*INCLUDE, INPUT=../secret.inp\n", "`*INCLUDE` is not supported"),
        ("*NGEN\n1,2\n", "`*NGEN` is not supported"),
        ("*PART, NAME=a\n*PART, NAME=b\n", "a second `*PART`"),
        ("*NODE\n3,nan,0,0\n", "coordinate `nan` of node 3"),
        ("*NODE\n3,1e999,0,0\n", "coordinate `1e999` of node 3"),
        ("*NODE\n-3,0,0,0\n", "found `-3`"),
        ("", "without `*ELEMENT`"),
    ] {
        let whole = format!("{start}{text}");
        let error = parse("a.inp", whole.as_bytes()).expect_err(text).to_string();
        assert!(error.contains(wanted) && error.starts_with("a.inp, line "), "{text}: {error}");
    }
}

#[test]
fn millimetres_become_metres() {
    let text = "*NODE\n1,0.1,0,0\n2,250,0,0\n*ELEMENT, TYPE=T3D2\n1,1,2\n";
    let mesh = abaqus::parse(text.as_bytes(), Path::new("a.inp"), LengthUnit::Millimetre).expect("readable");
    assert_eq!(mesh.points, [[0.0001, 0.0, 0.0], [0.25, 0.0, 0.0]]);
    let metres = gmsh::parse(
        &std::fs::read(data("hex8_v22_binary.msh")).unwrap(),
        Path::new("a.msh"),
        LengthUnit::Metre,
    );
    let millimetres = gmsh::parse(
        &std::fs::read(data("hex8_v22_binary.msh")).unwrap(),
        Path::new("a.msh"),
        LengthUnit::Millimetre,
    );
    let (metres, millimetres) = (metres.unwrap(), millimetres.unwrap());
    assert_eq!(metres.points.iter().map(|p| p.map(|x| x / 1000.0)).collect::<Vec<_>>(), millimetres.points);
}

// ---------------------------------------------------------------- round trips

/// Meshes with every kind of cell, sets, surfaces and awkward names.
fn meshes() -> Vec<(&'static str, Mesh)> {
    let mut fibres = generate::block([3, 2, 2], [0.1, 0.07, 1.0 / 3.0]);
    generate::add_fibres(&mut fibres, "fibres", [3, 2, 2], &[[0, 0], [1, 1]]);
    let mut awkward = generate::block([2, 1, 1], [0.1, 1e-300, 1e300]);
    awkward.blocks[0].name = "Oberschenkel <links> & \"'größer\" µ".replace('"', "");
    let inside_out = [[0, 1, 4, 3], [9, 6, 7, 10], [0, 3, 1, 1], [1, 2, 5, 4]]; // no outward faces, two shapes, mixed
    awkward.surfaces.insert("skin / inside".into(), inside_out.to_vec());
    awkward.surfaces.insert("empty".into(), Vec::new());
    awkward.node_sets.insert("no nodes".into(), Vec::new());
    awkward.blocks.push(CellBlock { name: "shell".into(), kind: CellKind::Quad4, nodes: vec![0, 1, 4, 3] });
    awkward.blocks.push(CellBlock { name: "facet".into(), kind: CellKind::Tri3, nodes: vec![0, 1, 4] });
    awkward.blocks.push(CellBlock { name: "none".into(), kind: CellKind::Line2, nodes: vec![] });
    vec![
        ("fibres", fibres),
        ("awkward", awkward),
        ("tet4", generate::tetrahedra(&generate::block([2, 2, 2], [1.0; 3]), false)),
        ("tet10", generate::tetrahedra(&generate::block([2, 1, 2], [0.3, 0.2, 0.7]), true)),
        ("wedges", generate::wedges(&generate::block([2, 1, 3], [0.3, 0.2, 0.7]))),
        ("sphere", generate::sphere_octant(0.01, 0.015, 2, 2)),
        ("cylinder", generate::cylinder(0.01, 0.04, 4, 1, 3)),
        ("bars", generate::bars(3, [3, 1, 1], [0.3, 0.03, 0.03], 0.01)),
        ("gmsh", read("tet10_v41_binary.msh")),
    ]
}

#[test]
fn write_and_read_gives_the_identical_mesh() {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, mesh) in meshes() {
        let file = folder.path().join(format!("{name}.inp"));
        abaqus::write(&file, &mesh).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(
            Mesh::read(&file, LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}")),
            mesh,
            "{name}.inp"
        );

        let file = folder.path().join(format!("{name}.vtu"));
        let points: Vec<f64> = (0..3 * mesh.points.len()).map(|i| (i as f64).sin() * 1e-3).collect();
        let cells: Vec<f64> =
            (0..mesh.n_cells()).map(|i| if i == 0 { f64::NEG_INFINITY } else { 1.0 / i as f64 }).collect();
        let point_data = [vtu::Field::new("displacement_m", 3, &points)];
        let cell_data = [vtu::Field::new("pressure_Pa", 1, &cells), vtu::Field::new("a<b>\"c\"&", 1, &cells)];
        vtu::write(&file, &mesh, &point_data, &cell_data).unwrap_or_else(|e| panic!("{name}: {e}"));
        let back = vtu::read(&file, LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(back.mesh, mesh, "{name}.vtu");
        assert_eq!(
            (&back.point_data[..], &back.cell_data[..]),
            (&point_data[..], &cell_data[..]),
            "{name}.vtu"
        );
        let first = std::fs::read(&file).expect("written");
        vtu::write(&file, &mesh, &point_data, &cell_data).expect("written again");
        assert_eq!(std::fs::read(&file).expect("written"), first, "same mesh, same bytes");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(left.iter().all(|n| !n.to_string_lossy().contains("part")), "temporary files are left: {left:?}");
}

#[test]
fn fields_and_names_that_cannot_be_written_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut mesh = generate::block([2, 2, 2], [1.0; 3]);
    let error = vtu::write(&folder.path().join("a.vtu"), &mesh, &[vtu::Field::new("u", 3, &[0.0; 80])], &[]);
    assert!(matches!(error, Err(MeshError::FieldLength { found: 80, expected: 81, .. })), "{error:?}");
    mesh.node_sets.insert("X_Min".into(), vec![0]);
    let error = abaqus::write(&folder.path().join("a.inp"), &mesh).expect_err("X_Min and x_min");
    assert!(error.to_string().contains("X_Min") || error.to_string().contains("x_min"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "a refused file leaves nothing");
}

#[test]
fn cells_of_a_foreign_file_are_sorted_by_region_with_their_values() {
    let text = std::fs::read_to_string(data("vtk_ascii.vtu")).expect("readable");
    // Three cells: 7, 3, 7 — a voxel with the nodes of the first hexahedron at the end.
    let text = text
        .replace("NumberOfCells=\"2\"", "NumberOfCells=\"3\"")
        .replace("7 3\n", "7 3 7\n")
        .replace("0 0.5\n", "1 2 3\n")
        .replace("7 8 11 10\n", "7 8 11 10 0 1 3 4 6 7 9 10\n")
        .replace("8 16\n", "8 16 24\n")
        .replace("12 12\n", "12 12 11\n");
    let vtu =
        vtu::parse(text.as_bytes(), Path::new("a.vtu"), LengthUnit::Metre).unwrap_or_else(|e| panic!("{e}"));
    let blocks: Vec<_> = vtu.mesh.blocks.iter().map(|b| (b.name.as_str(), b.n_cells())).collect();
    assert_eq!(blocks, [("region_7", 2), ("region_3", 1)]);
    assert_eq!(vtu.mesh.blocks[0].nodes[..8], vtu.mesh.blocks[0].nodes[8..]);
    assert_eq!(&*vtu.cell_data[0].values, [1.0, 3.0, 2.0]);
}

#[test]
fn a_series_can_be_followed_while_it_grows() {
    let folder = tempfile::tempdir().expect("a folder");
    let mesh = generate::block([1, 1, 1], [1.0; 3]);
    let out = folder.path().join("new/fields");
    let mut series = PvdWriter::create(&out, "squash").expect("writable");
    for step in 0..3 {
        let collection = std::fs::read_to_string(out.join("squash.pvd")).expect("written");
        assert_eq!(collection.matches("<DataSet").count(), step, "the collection lists what is finished");
        assert!(collection.trim_end().ends_with("</VTKFile>"));
        let values = vec![step as f64; 24];
        let file = series
            .push(0.5 * step as f64, &mesh, &[vtu::Field::new("u", 3, &values)], &[])
            .expect("writable");
        assert_eq!(&*vtu::read(&file, LengthUnit::Metre).expect("readable").point_data[0].values, values);
    }
    let collection = std::fs::read_to_string(out.join("squash.pvd")).expect("written");
    assert!(collection.contains("timestep=\"0.5\"") && collection.contains("file=\"squash_0002.vtu\""));
    assert!(PvdWriter::create(&out, "../escape").is_err());
}

// ---------------------------------------------------------------- damage

/// Small files of every format, as bytes.
fn small_files() -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<(String, Vec<u8>)> = Vec::new();
    for name in fixture_names("msh").into_iter().chain(fixture_names("vtu")) {
        let bytes = std::fs::read(data(&name)).expect("readable");
        files.push((name, bytes));
    }
    files.push(("hand.inp".into(), ABAQUS.as_bytes().to_vec()));
    let folder = tempfile::tempdir().expect("a folder");
    let mesh = generate::block([2, 1, 1], [0.2, 0.1, 0.1]);
    vtu::write(&folder.path().join("own.vtu"), &mesh, &[], &[]).expect("writable");
    abaqus::write(&folder.path().join("own.inp"), &mesh).expect("writable");
    for name in ["own.vtu", "own.inp"] {
        files.push((name.into(), std::fs::read(folder.path().join(name)).expect("written")));
    }
    files
}

/// Parses within the bound on memory; a mesh that is returned can be checked and measured without panic.
fn parse_bounded(name: &str, bytes: &[u8], what: &str) -> Result<Mesh, MeshError> {
    let (result, peak) = with_peak(|| parse(name, bytes));
    assert!(
        peak < 10 * bytes.len() + (64 << 20),
        "{name}, {what}: {peak} bytes for a file of {}",
        bytes.len()
    );
    match &result {
        Ok(mesh) if mesh.check().is_ok() => {
            mesh.blocks.iter().for_each(|b| assert!(mesh.volume(b).is_finite()))
        }
        Ok(_) => {}
        Err(error) => {
            assert!(matches!(error, MeshError::Format { .. }) && error.to_string().contains(name), "{error}")
        }
    }
    result
}

#[test]
fn files_cut_off_at_any_byte_are_refused_with_a_place() {
    for (name, bytes) in small_files() {
        for length in 0..bytes.trim_ascii_end().len() {
            let result = parse_bounded(&name, &bytes[..length], &format!("cut at {length}"));
            // The format of Abaqus has no end: a file cut between two lines is a shorter good file.
            assert!(
                result.is_err() || name.ends_with(".inp"),
                "{name}: cut at {length} of {} passes",
                bytes.len()
            );
        }
    }
}

#[test]
fn files_with_changed_bytes_never_panic_nor_fill_the_memory() {
    let mut refused = 0;
    for (name, bytes) in small_files() {
        let mut bytes = bytes;
        for at in 0..bytes.len() {
            let kept = bytes[at];
            for new in [0, 0xff, b'9', b'-', b' ', b'<', kept ^ 1] {
                bytes[at] = new;
                refused += usize::from(parse_bounded(&name, &bytes, &format!("byte {at} = {new}")).is_err());
            }
            bytes[at] = kept;
        }
    }
    assert!(refused > 10_000, "only {refused} damaged files were refused");
}

#[test]
fn counts_that_lie_are_refused_without_filling_the_memory() {
    for (name, bytes) in small_files() {
        // Every run of digits of the text parts becomes a huge, a negative and an overflowing number.
        let mut at = 0;
        while at < bytes.len() {
            let length = bytes[at..].iter().take_while(|b| b.is_ascii_digit()).count();
            for lie in ["4294967295", "-1", "18446744073709551615", "99999999999999999999999", "1e308", "nan"]
            {
                if length > 0 {
                    let lied = [&bytes[..at], lie.as_bytes(), &bytes[at + length..]].concat();
                    let _ = parse_bounded(&name, &lied, &format!("{lie} at {at}"));
                }
            }
            at += length.max(1);
        }
        // And every 8 bytes of the binary parts.
        for at in 0..bytes.len().saturating_sub(8) {
            for lie in [u64::from(u32::MAX), u64::MAX, 1 << 40] {
                let mut lied = bytes.clone();
                lied[at..at + 8].copy_from_slice(&lie.to_le_bytes());
                let _ = parse_bounded(&name, &lied, &format!("{lie} at byte {at}"));
            }
        }
    }
}

#[test]
fn small_files_cannot_ask_for_large_meshes() {
    // Sets of sets, each twice the one before: 2⁶⁰ members.
    let mut doubling = String::from("*NODE\n1,0,0,0\n2,1,0,0\n*ELEMENT, TYPE=T3D2, ELSET=e0\n1,1,2\n");
    for i in 0..60 {
        doubling += &format!("*ELSET, ELSET=e{}\ne{i}, e{i}\n*SURFACE, TYPE=NODE, NAME=s{i}\n1\n", i + 1);
    }
    let error = parse_bounded("a.inp", doubling.as_bytes(), "doubling").expect_err("2⁶⁰ members");
    assert!(error.to_string().contains("MiB"), "{error}");

    // A zlib block of a gigabyte of zeros in a file of a few kilobytes.
    let bomb = generate::block([1, 1, 1], [1.0; 3]);
    let zeros = vec![0.0; 8 << 20];
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("bomb.vtu");
    vtu::write(&file, &bomb, &[vtu::Field::new("u", 1 << 20, &zeros)], &[]).expect("writable");
    let mut bytes = std::fs::read(&file).expect("written");
    assert!(bytes.len() < 1 << 20);
    assert!(
        parse_bounded("bomb.vtu", &bytes, "64 MiB of zeros").expect_err("a bomb").to_string().contains("MiB")
    );
    // The mesh itself can still be had: its arrays are small.
    bytes.truncate(0);

    // Tags nested a hundred thousand deep; entities that name each other.
    let deep = format!("<VTKFile type=\"UnstructuredGrid\">{}</VTKFile>", "<a>".repeat(100_000));
    assert!(parse_bounded("deep.vtu", deep.as_bytes(), "deep").is_err());
    let entities = "<?xml version=\"1.0\"?><!DOCTYPE x [<!ENTITY a \"aaaaaaaa\"><!ENTITY b \"&a;&a;&a;\">]>\
                    <VTKFile type=\"&b;\"></VTKFile>";
    assert!(parse_bounded("bomb.vtu", entities.as_bytes(), "entities").is_err());
    // UTF-16.
    for name in ["a.inp", "a.vtu", "a.msh"] {
        let utf16: Vec<u8> = ABAQUS.encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert!(parse_bounded(name, &utf16, "UTF-16").is_err());
    }
}

#[test]
fn long_files_stay_within_the_bound_on_memory() {
    let mesh = generate::tetrahedra(&generate::block([40, 40, 40], [1.0; 3]), false);
    let folder = tempfile::tempdir().expect("a folder");
    vtu::write(&folder.path().join("a.vtu"), &mesh, &[], &[]).expect("writable");
    abaqus::write(&folder.path().join("a.inp"), &mesh).expect("writable");
    let mut msh = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", mesh.points.len());
    mesh.points.iter().enumerate().for_each(|(i, _)| msh += &format!("{} 0 0 0\n", i + 1));
    msh += &format!("$EndNodes\n$Elements\n{}\n", mesh.points.len());
    mesh.points.iter().enumerate().for_each(|(i, _)| msh += &format!("{} 15 0 {}\n", i + 1, i + 1));
    msh += "$EndElements\n";
    for name in ["a.vtu", "a.inp"] {
        let bytes = std::fs::read(folder.path().join(name)).expect("written");
        assert_eq!(parse_bounded(name, &bytes, "long").expect("good"), mesh);
    }
    // Each point in a group of its own.
    parse_bounded("a.msh", msh.as_bytes(), "long").expect("good");
    let own_groups = msh.replace(" 15 0 ", " 15 2 0 ");
    assert!(parse_bounded("a.msh", own_groups.as_bytes(), "cut elements").is_err());
}

#[test]
fn errors_name_file_line_and_remedy() {
    let ascii = std::fs::read_to_string(data("hex8_v41_ascii.msh")).expect("readable");
    let line = 1 + ascii.lines().position(|l| l.starts_with("$Elements")).expect("elements") + 3;
    let broken: Vec<&str> =
        ascii.lines().enumerate().map(|(i, l)| if i + 1 == line { "1 1 2 3 77 4" } else { l }).collect();
    let error = parse("leg.msh", broken.join("\n").as_bytes()).expect_err("node 77");
    assert_eq!(
        error.to_string(),
        format!(
            "leg.msh, line {line}: an element names node 77, which `$Nodes` lacks; repair the file there, or export it again"
        )
    );
    let MeshError::Format { place, .. } = error else { panic!("a format error") };
    assert_eq!(place, Place::Line(line));

    let old = ascii.replace("4.1 0 8", "4.0 0 8");
    assert!(
        parse("leg.msh", old.as_bytes())
            .expect_err("4.0")
            .to_string()
            .contains("gmsh in.msh -save -format msh41")
    );
    let missing = Mesh::read(Path::new("nowhere/leg.msh"), LengthUnit::Metre).expect_err("no file");
    assert!(matches!(missing, MeshError::Io { .. }) && missing.to_string().contains("nowhere/leg.msh"));
    let unknown = Mesh::read(Path::new("leg.stl"), LengthUnit::Metre).expect_err("not a mesh format");
    assert!(unknown.to_string().contains(".msh (Gmsh 2.2, 4.1)"));
    let mesh = read("hex8_v22_ascii.msh");
    assert_eq!(
        mesh.block("rectus").expect_err("no such block").to_string(),
        "the mesh has no block `rectus`; it has: `rectus femoris`, `origin`"
    );
}

// ---------------------------------------------------------------- poison

#[test]
fn poisoned_meshes_are_refused_naming_block_and_cell() {
    let poison = |what: &str, edit: &dyn Fn(&mut Mesh), wanted: &str| {
        let mut mesh = generate::block([2, 2, 2], [1.0; 3]);
        generate::add_fibres(&mut mesh, "fibres", [2, 2, 2], &[[1, 1]]);
        mesh.check().expect("good before");
        edit(&mut mesh);
        let error = mesh.check().expect_err(what).to_string();
        assert!(error.contains(wanted), "{what}: {error}");
    };
    poison(
        "index out of range",
        &|m| m.blocks[0].nodes[8 * 3 + 2] = 27,
        "`block`, cell 3: node 27 does not exist",
    );
    poison("largest index", &|m| m.blocks[1].nodes[2] = u32::MAX, "`fibres`, cell 1: node 4294967295");
    poison("repeated node", &|m| m.blocks[0].nodes[8 * 5] = m.blocks[0].nodes[8 * 5 + 6], "`block`, cell 5");
    poison("inverted", &|m| m.blocks[0].nodes[8..16].rotate_left(4), "`block`, cell 1: det");
    poison("flat", &|m| m.points.iter_mut().for_each(|p| p[2] = 0.0), "`block`, cell 0: det");
    poison("one corner through the cell", &|m| m.points[0] = [0.9, 0.9, 0.9], "`block`, cell 0: det");
    poison("NaN", &|m| m.points[13][1] = f64::NAN, "node 13");
    poison("infinite", &|m| m.points[13][1] = f64::INFINITY, "node 13");
    poison("overflow", &|m| m.points.iter_mut().flatten().for_each(|x| *x *= 1e200), "`block`, cell 0");
    poison("unused node", &|m| m.points.push([9.0; 3]), "1 nodes belong to no cell, the first is node 27");
    poison("ragged", &|m| m.blocks[0].nodes.truncate(63), "63 node indices");
    poison("names", &|m| m.blocks[1].name = "block".into(), "two blocks are named `block`");
    poison("no cells", &|m| m.blocks.clear(), "no cells");
    poison("fibre without length", &|m| m.points[13] = m.points[12], "`fibres`, cell 0: length");
    poison("set", &|m| m.node_sets.get_mut("x_min").unwrap()[0] = 99, "`x_min`: entry 0");
    poison("set order", &|m| m.node_sets.get_mut("x_min").unwrap().swap(0, 1), "`x_min`: entry 1");
    poison("surface", &|m| m.surfaces.get_mut("y_max").unwrap()[2][1] = 27, "`y_max`, face 2");
    poison("surface", &|m| m.surfaces.get_mut("y_max").unwrap()[1] = [3; 4], "`y_max`, face 1");

    let mut line = generate::block([2, 1, 1], [1.0; 3]);
    generate::add_fibres(&mut line, "fibres", [2, 1, 1], &[[0, 0]]);
    line.blocks.remove(0);
    line.remove_unused_nodes();
    line.points[1] = line.points[0];
    assert!(matches!(line.check(), Err(MeshError::Degenerate { cell: 0, .. })));

    let mut three = generate::block([1, 1, 1], [1.0; 3]);
    let again = three.blocks[0].nodes.clone();
    three.blocks[0].nodes.extend(again.iter().chain(&again).copied());
    assert!(matches!(three.blocks[0].boundary(), Err(MeshError::NonManifold { .. })));
}

#[test]
fn unused_nodes_can_be_removed() {
    let mut mesh = generate::block([2, 2, 2], [1.0; 3]);
    let good = mesh.clone();
    mesh.points.insert(0, [5.0; 3]);
    mesh.blocks[0].nodes.iter_mut().for_each(|n| *n += 1);
    mesh.node_sets.values_mut().flatten().for_each(|n| *n += 1);
    mesh.surfaces.values_mut().flatten().flatten().for_each(|n| *n += 1);
    mesh.node_sets.get_mut("x_min").unwrap().insert(0, 0);
    mesh.surfaces.get_mut("x_min").unwrap().push([0, 1, 2, 3]);
    assert_eq!(mesh.remove_unused_nodes(), 1);
    assert_eq!(mesh, good);
}

// ---------------------------------------------------------------- generators

#[test]
fn generated_meshes_have_the_shape_they_claim() {
    use std::f64::consts::PI;
    let regular = |m: f64| m / 2.0 * (2.0 * PI / m).sin(); // area of the m-gon in the unit circle
    let cases = [
        ("block", generate::block([3, 4, 5], [0.3, 0.2, 0.1]), 0.006, 1e-13, 0.999_999),
        (
            "tet4",
            generate::tetrahedra(&generate::block([3, 2, 2], [0.3, 0.2, 0.1]), false),
            0.006,
            1e-13,
            0.3,
        ),
        (
            "tet10",
            generate::tetrahedra(&generate::block([3, 2, 2], [0.3, 0.2, 0.1]), true),
            0.006,
            1e-13,
            0.3,
        ),
        ("wedges", generate::wedges(&generate::block([3, 2, 2], [0.3, 0.2, 0.1])), 0.006, 1e-13, 0.8),
        ("cook", generate::cook(8), 48e-3 * 30e-3 * 1e-3, 1e-13, 0.6),
        // Chords of h = 5.6° (0.098) lie h²/6 = 0.0016 radii inside the sphere on average: three times that in volume.
        (
            "sphere",
            generate::sphere_octant(0.01, 0.015, 8, 8),
            PI / 6.0 * (0.015f64.powi(3) - 0.01f64.powi(3)),
            0.006,
            0.6,
        ),
        (
            "cylinder",
            generate::cylinder(0.01, 0.04, 8, 2, 20),
            0.04 * 0.01 * 0.01 * regular(32.0),
            1e-12,
            0.3,
        ),
    ];
    for (name, mesh, volume, tolerance, least) in cases {
        mesh.check().unwrap_or_else(|e| panic!("{name}: {e}"));
        let quality = mesh.quality(&mesh.blocks[0]).expect("solids");
        assert!(
            close(quality.volume, volume, tolerance),
            "{name}: volume {:e}, {volume:e} expected",
            quality.volume
        );
        assert!(quality.least_scaled_jacobian >= least, "{name}: {quality:?}");
        // Closed: the outward area vectors of the boundary add up to zero and its flux of x to three volumes.
        let (mut sum, mut flux) = (nalgebra::Vector3::zeros(), 0.0);
        for face in mesh.blocks[0].boundary().expect("manifold") {
            let [a, b, c, d] = face.map(|n| nalgebra::Vector3::from(mesh.points[n as usize]));
            let vector = if c == d { (b - a).cross(&(c - a)) / 2.0 } else { (c - a).cross(&(d - b)) / 2.0 };
            let centre = if c == d { (a + b + c) / 3.0 } else { (a + b + c + d) / 4.0 };
            sum += vector;
            flux += centre.dot(&vector);
        }
        assert!(sum.norm() < 1e-12 * volume.powf(2.0 / 3.0), "{name}: the boundary has holes, {sum}");
        assert!(
            close(flux, 3.0 * quality.volume, 1e-3),
            "{name}: flux {flux:e}, {:e} expected",
            3.0 * quality.volume
        );
        // Every face of the boundary is in exactly one named surface.
        let named: usize = mesh.surfaces.values().map(Vec::len).sum();
        assert_eq!(named, mesh.blocks[0].boundary().unwrap().len(), "{name}");
    }
}

#[test]
fn named_surfaces_have_their_areas_and_nodes() {
    use std::f64::consts::PI;
    let block = generate::block([3, 4, 5], [0.3, 0.2, 0.1]);
    for (name, expected) in
        [("x_min", 0.02), ("x_max", 0.02), ("y_min", 0.03), ("y_max", 0.03), ("z_max", 0.06)]
    {
        assert!(close(area(&block, block.surface(name).unwrap()), expected, 1e-13), "{name}");
    }
    let tets = generate::tetrahedra(&block, true);
    assert!(close(area(&tets, tets.surface("z_max").unwrap()), 0.06, 1e-13));
    let on_top: Vec<u32> = (0..).zip(&tets.points).filter(|(_, p)| p[2] == 0.1).map(|(i, _)| i).collect();
    assert_eq!(tets.node_set("z_max").unwrap(), on_top);
    assert_eq!(on_top.len(), 7 * 9, "corners and middles");
    let sphere = generate::sphere_octant(0.01, 0.015, 8, 8);
    assert!(close(area(&sphere, sphere.surface("inner").unwrap()), PI / 2.0 * 1e-4, 0.004));
    assert!(close(
        area(&sphere, sphere.surface("x_min").unwrap()),
        PI / 4.0 * (0.015f64.powi(2) - 1e-4),
        0.004
    ));
    // Three patches of 8 × 8: 3·64 + 3·8 + 1 = 217 nodes per layer.
    assert_eq!(sphere.points.len(), 217 * 9);
    let cylinder = generate::cylinder(0.01, 0.04, 8, 2, 20);
    assert_eq!(cylinder.points.len(), (81 + 2 * 32) * 21);
    assert_eq!(cylinder.surface("side").unwrap().len(), 32 * 20);
    assert_eq!(cylinder.surface("z_min").unwrap().len(), 64 + 2 * 32);
    let bars = generate::bars(17, [79, 9, 9], [0.3, 0.03, 0.03], 0.01);
    assert_eq!(bars.points.len(), 17 * 8000);
    assert_eq!(bars.blocks.len(), 34);
    assert_eq!(bars.node_set("muscle_16_x_max").unwrap().len(), 100);
    bars.check().expect("a good mesh");
}

#[test]
fn distortion_moves_interior_nodes_only_and_keeps_its_seed() {
    let plain = generate::block([3, 3, 3], [0.03; 3]);
    let mut distorted = plain.clone();
    generate::distort(&mut distorted, 0.15, 7);
    distorted.check().expect("still good");
    let moved: Vec<f64> = plain
        .points
        .iter()
        .zip(&distorted.points)
        .map(|(p, q)| [0, 1, 2].map(|d| (p[d] - q[d]).abs()).into_iter().fold(0.0, f64::max))
        .collect();
    assert_eq!(moved.iter().filter(|m| **m > 0.0).count(), 8);
    assert!(moved.iter().all(|m| *m <= 0.15 * 0.01));
    let mut again = plain.clone();
    generate::distort(&mut again, 0.15, 7);
    assert_eq!(again, distorted);
    assert!(distorted.quality(&distorted.blocks[0]).unwrap().least_scaled_jacobian < 0.99);
}

#[test]
fn scaled_jacobian_of_known_shapes() {
    use fem::mesh::quality::scaled_jacobian;
    let v = |p: &[[f64; 3]]| p.iter().map(|p| nalgebra::Vector3::from(*p)).collect::<Vec<_>>();
    let regular = v(&[[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]]);
    let turned = scaled_jacobian(CellKind::Tet4, &regular);
    assert!(close(turned.abs(), 1.0, 1e-14), "{turned}");
    let h = 3f64.sqrt() / 2.0;
    let wedge = [[0.0, 0.0], [1.0, 0.0], [0.5, h]];
    let wedge: Vec<_> = [0.0, 1.0].iter().flat_map(|z| wedge.map(|[x, y]| [x, y, *z])).collect();
    assert!(close(scaled_jacobian(CellKind::Wedge6, &v(&wedge)), 1.0, 1e-14));
    assert!(close(scaled_jacobian(CellKind::Wedge6, &v(&[3, 4, 5, 0, 1, 2].map(|i| wedge[i]))), -1.0, 1e-14));
    // A cube sheared by 45°: all corners have det 1 and one edge of length √2.
    let sheared: Vec<_> = generate::mapped([1, 1, 1], |[x, y, z]| [x + y, y, z]).points;
    let order = [0, 1, 3, 2, 4, 5, 7, 6].map(|i| sheared[i]);
    assert!(close(scaled_jacobian(CellKind::Hex8, &v(&order)), 0.5f64.sqrt(), 1e-14));
}
