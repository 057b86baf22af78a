//! The `halflight` command; all of it is in `cli`.
#![deny(unsafe_code, clippy::unwrap_used)]

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
