use super::*;

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

pub(super) fn fixture_names(ending: &str) -> Vec<String> {
    let folder = std::fs::read_dir(data("")).expect("the folder with the fixtures");
    let names = folder.map(|entry| entry.expect("readable").file_name().into_string().expect("plain names"));
    let mut names: Vec<String> = names.filter(|n| n.ends_with(&format!(".{ending}"))).collect();
    names.sort();
    names
}

pub(super) const ABAQUS: &str = "\u{feff}** made by hand\r
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
