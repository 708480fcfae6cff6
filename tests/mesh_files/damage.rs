use super::other_programs::{ABAQUS, fixture_names};
use super::*;

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
