//! The paths of a module's parameters, which are their names in files, messages and moments.

/// Prefix of Burn's container type for enums, which are entered with the name of a variant.
const ENUM: &str = "Enum:";

/// The path of a parameter, in parts.
///
/// The name of an enum variant replaces the name of its field: the projection `query` of the variant `Attention` in the
/// field `temporal` of `refinement` is `refinement.attention.query`. A file therefore identifies its variant. Reading
/// it as another variant is an error that names the parameter.
#[derive(Clone, Debug)]
pub(crate) struct ParameterPath {
    parts: Vec<String>,
    /// The fields whose names variants have replaced.
    replaced: Vec<String>,
}

impl ParameterPath {
    /// The path of a module of the given name.
    pub fn new(module: &str) -> Self {
        Self { parts: vec![module.to_owned()], replaced: Vec::new() }
    }

    /// Enters a part; `container` is its container type in Burn.
    pub fn enter(&mut self, name: &str, container: &str) {
        if container.starts_with(ENUM) {
            self.replaced.extend(self.parts.pop());
            self.parts.push(snake_case(name));
        } else {
            self.parts.push(name.to_owned());
        }
    }

    /// Leaves the part that was entered last.
    pub fn exit(&mut self, container: &str) {
        self.parts.pop();
        if container.starts_with(ENUM) {
            self.parts.extend(self.replaced.pop());
        }
    }

    /// The parts, joined by dots.
    pub fn name(&self) -> String {
        self.parts.join(".")
    }
}

/// The name of a variant in the style of a field: `SelfAttention` to `self_attention`.
fn snake_case(name: &str) -> String {
    let mut snake = String::new();
    for (place, letter) in name.chars().enumerate() {
        if letter.is_uppercase() && place > 0 {
            snake.push('_');
        }
        snake.extend(letter.to_lowercase());
    }
    snake
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variant_stands_in_the_place_of_its_field() {
        let mut path = ParameterPath::new("refinement");
        path.enter("temporal", "Struct:MotionRefinement");
        path.enter("SelfAttention", "Enum:TemporalModule");
        path.enter("query", "Struct:TemporalAttention");
        assert_eq!(path.name(), "refinement.self_attention.query");
        path.exit("Struct:TemporalAttention");
        path.exit("Enum:TemporalModule");
        assert_eq!(path.name(), "refinement.temporal");
        path.exit("Struct:MotionRefinement");
        assert_eq!(path.name(), "refinement");
    }
}
