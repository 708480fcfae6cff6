use super::*;

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
