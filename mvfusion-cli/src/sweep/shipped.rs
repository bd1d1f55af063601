//! The grids that ship inside the program: the paper's tables, for the full datasets and small.

use crate::config::nearest;

/// A grid by its name.
#[derive(Clone, Copy, Debug)]
pub struct Shipped {
    /// Its name, for `mvfusion sweep`.
    pub name: &'static str,
    /// The TOML.
    pub text: &'static str,
}

/// A grid with the TOML of its name.
macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        &[$(Shipped { name: $name, text: include_str!(concat!("../../sweeps/", $name, ".toml")) }),*]
    };
}

/// All of them.
pub const SHIPPED: &[Shipped] = shipped![
    "neu3d",
    "onthego",
    "robustnerf",
    "main-small",
    "methods",
    "claim",
    "claim-small",
    "claim-again",
    "claim-nearest",
    "readings",
    "convergence",
    "costs",
    "components",
    "components-small",
    "fusion-weights",
    "fusion-weights-small",
    "update-interval",
    "update-interval-small",
    "window",
    "window-small",
    "temporal",
    "temporal-small",
    "plugin",
    "plugin-small",
    "efficiency",
    "efficiency-small",
];

/// The grid of a name.
pub fn find(name: &str) -> Option<&'static Shipped> {
    SHIPPED.iter().find(|shipped| shipped.name == name)
}

/// A question with the most similar name, to be appended to a sentence; empty if none is similar.
pub fn suggestion(name: &str) -> String {
    let names = SHIPPED.iter().map(|shipped| shipped.name);
    nearest(name, names).map_or(String::new(), |near| format!(" Did you mean `{near}`?"))
}

/// Their names with commas between them.
pub fn names() -> String {
    SHIPPED.iter().map(|shipped| shipped.name).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_name_suggests_the_nearest() {
        assert_eq!(suggestion("component-small"), " Did you mean `components-small`?");
        assert_eq!(suggestion("qqqqqqqqqqqqqqqq"), "");
    }
}
