//! What `fem` computes: a file each, in one program, which is linked once and whose tests run side by side.

/// The laws of an example, which two files look at.
#[path = "../fem/examples/land_beam/laws.rs"]
mod laws;

mod conservation;
#[path = "contact/main.rs"]
mod contact;
mod convergence;
mod derivatives;
mod distance_field;
mod drive_table;
mod dynamics;
mod embedded;
#[path = "explicit/main.rs"]
mod explicit;
mod fem_benchmarks;
mod free_bodies;
mod inertia;
mod invariance;
mod nested;
mod own_terms;
mod patch;
mod pressure;
mod rollers;
mod run_files;
mod scene;
mod sides;
#[path = "solver/main.rs"]
mod solver;
mod strings;
mod surfaces;
mod user_laws;
mod verdict;
