//! The program `instgs-isa`: see [`instgs_isa`].

use std::process::ExitCode;

fn main() -> ExitCode {
    instgs_isa::main()
}
