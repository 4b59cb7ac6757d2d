//! The `genmanip` command.
fn main() {}
