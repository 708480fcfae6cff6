//! The command `sartorius`.

fn main() {}
