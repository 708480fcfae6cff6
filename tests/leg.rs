//! What `multibody` reads and computes: a file each, in one program.

mod calibration;
mod diagnoses;
mod hill;
mod inverse;
#[path = "knee/main.rs"]
mod knee;
mod opensim;
mod sharing;
mod shipped;
#[path = "trial_files/main.rs"]
mod trial_files;
