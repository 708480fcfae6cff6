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

mod damage;
mod generators;
mod other_programs;
mod poison;
mod round_trips;
