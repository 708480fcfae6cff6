use super::*;

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
