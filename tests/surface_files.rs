//! Do surface files survive reading, and does damage to them get a refusal that names the place?

use std::path::Path;

use fem::geometry::read::{obj, ply, stl};
use fem::geometry::{Surface, SurfaceError};
use fem::mesh::{LengthUnit, MeshError, Place};
use support::Random;
use support::allocations::{Counting, with_peak};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A tetrahedron with coordinates that are exact in 32 bits, points numbered as an STL file meets them.
fn tetrahedron() -> Surface {
    Surface {
        points: vec![[0.0, 0.0, 0.0], [0.0, 0.125, 0.0], [0.25, 0.0, 0.0], [0.0, 0.0, 0.0625]],
        triangles: vec![[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 3]],
    }
}

// ------------------------------------------------------------------------------------------------ writers

fn stl_binary(s: &Surface) -> Vec<u8> {
    let mut bytes = b"solid in name only".to_vec();
    bytes.resize(80, 0);
    bytes.extend((s.triangles.len() as u32).to_le_bytes());
    for t in 0..s.triangles.len() {
        bytes.extend([0; 12]);
        let corners = s.corners(t);
        bytes.extend(corners.iter().flatten().flat_map(|&x| (x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_text(s: &Surface) -> Vec<u8> {
    let mut text = String::from("solid a name\n");
    for t in 0..s.triangles.len() {
        text += " facet normal 0 0 0\n  outer loop\n";
        for p in s.corners(t) {
            text += &format!("   vertex {:e} {} {}\n", p.x, p.y, p.z);
        }
        text += "  endloop\n endfacet\n";
    }
    (text + "endsolid a name\n").into_bytes()
}

fn obj_text(s: &Surface) -> Vec<u8> {
    let mut text = String::from("# made by hand\nmtllib nothing.mtl\no thing\n");
    for p in &s.points {
        text += &format!("v {} {} {}\n", p[0], p[1], p[2]);
    }
    text += "v 9 9 9\nvn 0 0 1\ns off\n";
    for (i, t) in s.triangles.iter().enumerate() {
        let [a, b, c] = t.map(|p| p + 1);
        let back = |p: u32| i64::from(p) - 6;
        match i % 4 {
            0 => text += &format!("f {a} {b} {c}\n"),
            1 => text += &format!("f {a}/1 {b}/2 {c}/3\n"),
            2 => text += &format!("f {a}//1 {b}//1 {c}//1\n"),
            _ => text += &format!("f {} {} {}\n", back(a), back(b), back(c)),
        }
    }
    text.into_bytes()
}

fn ply_file(s: &Surface, format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {format} 1.0\ncomment by hand\nelement vertex {}\nproperty uchar red\nproperty float x\nproperty float y\n\
         property double z\nproperty list uchar short weights\nelement face {}\nproperty short material\n\
         property list uchar int vertex_indices\nend_header\n",
        s.points.len(),
        s.triangles.len()
    )
    .into_bytes();
    let big = format == "binary_big_endian";
    let push = |bytes: &mut Vec<u8>, le: &[u8]| {
        if big { bytes.extend(le.iter().rev()) } else { bytes.extend(le) }
    };
    for p in &s.points {
        if format == "ascii" {
            bytes.extend(format!("7 {} {} {} 2 5 -5\n", p[0], p[1], p[2]).into_bytes());
            continue;
        }
        bytes.push(7);
        push(&mut bytes, &(p[0] as f32).to_le_bytes());
        push(&mut bytes, &(p[1] as f32).to_le_bytes());
        push(&mut bytes, &p[2].to_le_bytes());
        bytes.push(2);
        push(&mut bytes, &5i16.to_le_bytes());
        push(&mut bytes, &(-5i16).to_le_bytes());
    }
    for t in &s.triangles {
        if format == "ascii" {
            bytes.extend(format!("-3 3 {} {} {}\n", t[0], t[1], t[2]).into_bytes());
            continue;
        }
        push(&mut bytes, &(-3i16).to_le_bytes());
        bytes.push(3);
        for p in t {
            push(&mut bytes, &(*p as i32).to_le_bytes());
        }
    }
    bytes
}

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let s = tetrahedron();
    vec![
        ("binary.stl", stl_binary(&s)),
        ("text.stl", stl_text(&s)),
        ("a.obj", obj_text(&s)),
        ("text.ply", ply_file(&s, "ascii")),
        ("little.ply", ply_file(&s, "binary_little_endian")),
        ("big.ply", ply_file(&s, "binary_big_endian")),
    ]
}

/// Parses within the memory bound of the readers; what comes out has whole triangles of finite points.
fn parse(name: &str, bytes: &[u8], unit: LengthUnit) -> Result<Surface, MeshError> {
    let file = Path::new(name);
    let (result, peak) = with_peak(|| match file.extension().and_then(|e| e.to_str()) {
        Some("stl") => stl::parse(bytes, file, unit),
        Some("obj") => obj::parse(bytes, file, unit),
        _ => ply::parse(bytes, file, unit),
    });
    assert!(peak < 40 * bytes.len() + (64 << 10), "{name}: {peak} bytes held for a file of {}", bytes.len());
    if let Ok(surface) = &result {
        assert!(surface.points.iter().flatten().all(|x| x.is_finite()));
        assert!(surface.triangles.iter().flatten().all(|&p| (p as usize) < surface.points.len()));
    }
    result
}

// ------------------------------------------------------------------------------------------------ tests

#[test]
fn every_format_and_unit_gives_the_same_surface() {
    let expected = tetrahedron();
    expected.check().expect("sound");
    for (name, bytes) in files() {
        let surface = parse(name, &bytes, LengthUnit::Metre).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(surface, expected, "{name}");
        let small = parse(name, &bytes, LengthUnit::Millimetre).expect("in mm");
        let mm = expected.points.iter().map(|p| p.map(|x| x / 1000.0)).collect::<Vec<_>>();
        assert_eq!(small.points, mm, "{name}");
    }
}

#[test]
fn lines_may_end_in_crlf() {
    for (name, bytes) in
        files().into_iter().filter(|(name, _)| ["text.stl", "a.obj", "text.ply"].contains(name))
    {
        let crlf = String::from_utf8(bytes).unwrap().replace('\n', "\r\n");
        assert_eq!(parse(name, crlf.as_bytes(), LengthUnit::Metre).unwrap(), tetrahedron(), "{name}");
    }
}

#[test]
fn polygons_become_triangles() {
    let prism = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 2\nf 2 3 4 1\nf 5 4 3 2 1\n";
    let surface = parse("a.obj", prism, LengthUnit::Metre).unwrap();
    let mut cut = surface.triangles[..2].to_vec();
    cut.iter_mut().for_each(|t| t.sort_unstable());
    cut.sort_unstable();
    assert_eq!(cut, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(surface.triangles[2..], [[4, 3, 2], [4, 2, 1], [4, 1, 0]]);
}

#[test]
fn zero_and_minus_zero_are_one_point() {
    let mut bytes = stl_binary(&tetrahedron());
    bytes[84 + 50 + 12..][..4].copy_from_slice(&(-0.0f32).to_le_bytes());
    assert_eq!(parse("a.stl", &bytes, LengthUnit::Metre).unwrap().points.len(), 4);
}

#[test]
fn files_cut_at_every_byte_are_refused() {
    for (name, bytes) in files() {
        for length in 0..bytes.len() {
            let result = parse(name, &bytes[..length], LengthUnit::Metre);
            let whole = result.as_ref().is_ok_and(|s| s.triangles.len() == 4);
            let rest = &bytes[length..];
            // A table of lines has no end mark: it may be cut between lines (an OBJ file) or in the last number.
            let may_be_good = match name {
                "text.stl" => rest.len() <= b" a name\n".len(), // only the name behind endsolid is lost
                "a.obj" => true,
                "text.ply" => rest.len() <= 1,
                _ => false,
            };
            assert!(result.is_err() || (may_be_good && (whole || name == "a.obj")), "{name} cut at {length}");
            if let (Ok(surface), "a.obj") = (&result, name) {
                assert!(whole || surface.check().is_err(), "{name} cut at {length}");
            }
        }
    }
}

#[test]
fn damaged_bytes_never_panic_or_take_memory() {
    let mut random = Random::new(20_261_121);
    for (name, bytes) in files() {
        let mut refused = 0;
        for round in 0..6_000 {
            let mut damaged = bytes.clone();
            for _ in 0..1 + random.bits() % 4 {
                let at = random.bits() as usize % damaged.len();
                damaged[at] = match round % 5 {
                    0 => 0,
                    1 => 0xff,
                    2 => b'9',
                    3 => b'-',
                    _ => random.bits() as u8,
                };
            }
            match parse(name, &damaged, LengthUnit::Metre) {
                Ok(surface) => drop(surface.check()), // sound or refused, but it ends
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 100, "{name}: only {refused} of 6000 damaged files were refused");
    }
}

#[test]
fn lies_name_the_place() {
    let refused =
        |name: &str, bytes: &[u8], place: Place, part: &str| match parse(name, bytes, LengthUnit::Metre) {
            Err(MeshError::Format { place: found, reason, .. }) => {
                assert!(found == place && reason.contains(part), "{name}, {found}: {reason}");
            }
            other => panic!("{name}: {other:?}"),
        };
    let good = stl_binary(&tetrahedron());
    for count in [0u32, 3, 5, u32::MAX] {
        let mut bytes = good.clone();
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        refused("a.stl", &bytes, Place::Byte(80), "200 bytes follow (4 triangles)");
    }
    let mut bytes = good;
    bytes[84 + 12 + 4..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    refused("a.stl", &bytes, Place::Byte(84 + 24), "finite");
    refused("a.stl", b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 inf 0\n", Place::Line(4), "finite");
    refused("a.stl", b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 zwei 0\n", Place::Line(4), "`zwei`");
    refused("a.stl", b"solid\nfacet normal 0 0 1\nloop\n", Place::Line(3), "`outer` expected");
    refused("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 3\n", Place::Line(3), "vertex 3 does not exist");
    refused("a.obj", b"v 0 0 0\nf 0 1 1\n", Place::Line(2), "vertex 0 does not exist");
    refused("a.obj", b"v 0 0 0\nf -2 1 1\n", Place::Line(2), "vertex -2 does not exist");
    refused("a.obj", b"v 0 0 0\nf -9223372036854775808 1 1\n", Place::Line(2), "does not exist");
    refused("a.obj", b"v 0 0 nan\n", Place::Line(1), "finite");
    refused("a.obj", b"v 0 0\n", Place::Line(1), "a coordinate expected");
    refused("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", Place::Line(3), "at least 3");
    refused("a.obj", b"curv 0 1 2\n", Place::Line(1), "`curv` is not supported");
    let head = |rest: &str| format!("ply\nformat ascii 1.0\n{rest}").into_bytes();
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let face = "property list uchar int vertex_indices\nend_header\n";
    let ply = |n: &str, m: &str, body: &str| {
        head(&format!("element vertex {n}\n{xyz}element face {m}\n{face}{body}"))
    };
    refused("a.ply", &ply("18446744073709551615", "1", "0 0 0\n"), Place::Line(11), "the file ends here");
    refused(
        "a.ply",
        &ply("1", "18446744073709551615", "0 0 0\n3 0 0 0\n"),
        Place::Line(12),
        "the file ends here",
    );
    refused("a.ply", &ply("-1", "1", ""), Place::Line(4), "`-1` is not a count");
    refused("a.ply", &ply("1", "1", "0 0 0\n3 0 0 1\n"), Place::Line(11), "vertex 1 does not exist");
    refused("a.ply", &ply("1", "1", "0 0 0\n3 0 0 -1\n"), Place::Line(11), "a vertex number");
    refused("a.ply", &ply("1", "1", "0 0 0\n2 0 0\n"), Place::Line(11), "at least 3");
    refused("a.ply", &ply("1", "1", "0 0 0\n4000000000 0 0 0\n"), Place::Line(12), "the file ends here");
    refused("a.ply", &ply("1", "1", "0 0 0\n3 0 0 0\n7\n"), Place::Line(11), "bytes follow");
    refused("a.ply", &head("element thing 99999999999\nelement vertex 1\n"), Place::Line(5), "end_header");
    let empty =
        format!("element thing 99999999999\nelement vertex 1\n{xyz}element face 1\n{face}0 0 0\n3 0 0 0\n");
    refused("a.ply", &head(&empty), Place::Line(11), "`thing` has no properties");
}

#[test]
fn whole_files_are_named_in_refusals() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, bytes: &[u8]| {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).expect("written");
        file
    };
    let mut open = tetrahedron();
    open.triangles.pop();
    let file = write("open.STL", &stl_binary(&open));
    let error = Surface::read_checked(&file, LengthUnit::Metre).unwrap_err();
    assert!(
        matches!(&error, SurfaceError::InFile { reason, .. } if matches!(**reason, SurfaceError::Open { count: 3, .. }))
    );
    assert!(
        error.to_string().contains("open.STL") && error.to_string().contains("close the hole"),
        "{error}"
    );
    let file = write("whole.stl", &stl_binary(&tetrahedron()));
    assert_eq!(Surface::read_checked(&file, LengthUnit::Metre).unwrap(), tetrahedron());
    let error = Surface::read_checked(&file, LengthUnit::Millimetre).unwrap_err();
    assert!(error.to_string().contains("read as mm"), "{error}");
    let error = Surface::read(&write("a.step", b""), LengthUnit::Metre).unwrap_err();
    assert!(matches!(error, SurfaceError::UnknownFormat { .. }));
    let error = Surface::read(&folder.path().join("none.stl"), LengthUnit::Metre).unwrap_err();
    assert!(error.to_string().contains("none.stl"), "{error}");
    let error = Surface::read(folder.path(), LengthUnit::Metre).unwrap_err();
    assert!(matches!(error, SurfaceError::UnknownFormat { .. }));
}
