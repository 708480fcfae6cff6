//! What `coupling` and the command make of both sides: a file each, in one program.

mod command;
#[path = "comparison/main.rs"]
mod comparison;
mod controller;
mod cost;
mod deep_flexion;
mod deep_flexion_input;
mod fidelity;
mod muscle_mesh;
mod muscle_surfaces;
mod output_folder;
#[path = "report/main.rs"]
mod report;
mod resume;
mod run_json;
mod session;
mod solve_command;
mod study;
mod thigh;
mod thigh_capacities;
mod two_way;
