//! Lets the program of unit tests be linked without Python, whose symbols a module gets from the interpreter that loads it.
//! `cargo test --workspace --lib` links that program although it has no tests.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux") {
        println!("cargo::rustc-link-arg=-Wl,--unresolved-symbols=ignore-all");
    }
}
