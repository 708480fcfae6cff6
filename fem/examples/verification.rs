//! Prints the verification table of the deformable side in Markdown: every case on its stated mesh and on a refinement.
//!
//! `cargo run --release -p sartorius-fem --example verification`            all cases (a few minutes)
//! `cargo run --release -p sartorius-fem --example verification -- b03`     those whose name begins so
//! `… -- --quick`                                                           stated meshes only
//!
//! Ends with an error where a check fails.

use fem::verification::{TABLE_HEADER, cases, table_row};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let quick = arguments.iter().any(|a| a == "--quick");
    let names: Vec<&String> = arguments.iter().filter(|a| !a.starts_with("--")).collect();
    let mut failed = 0;
    print!("{TABLE_HEADER}");
    for (name, case) in cases() {
        if !names.is_empty() && !names.iter().any(|n| name.starts_with(n.as_str())) {
            continue;
        }
        for refined in if quick { &[false][..] } else { &[false, true] } {
            for check in case(*refined)? {
                println!("{}", table_row(&check));
                failed += usize::from(!check.holds());
            }
        }
    }
    if failed > 0 { Err(format!("{failed} checks fail").into()) } else { Ok(()) }
}
