//! The command `sartorius`.

fn main() -> std::process::ExitCode {
    command::cli::main()
}
