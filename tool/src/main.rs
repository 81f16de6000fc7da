//! The tool `ecmsk`.

fn main() -> std::process::ExitCode {
    ecmsk_tool::main()
}
