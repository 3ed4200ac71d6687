//! Arguments in, exit code out.

fn main() -> std::process::ExitCode {
    whitewater::cli::run(std::env::args_os())
}
