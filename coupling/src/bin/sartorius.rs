//! The command `sartorius`.

fn main() -> std::process::ExitCode {
    coupling::cli::main()
}
