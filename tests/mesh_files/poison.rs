use super::*;

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
