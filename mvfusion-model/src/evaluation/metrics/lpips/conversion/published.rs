//! The published files, by their SHA-256.

use super::super::layout::Backbone;
use super::part::{Part, PartKind};

/// A published file.
struct Published {
    part: Part,
    /// How its SHA-256 begins. torchvision's names contain the first eight digits, which nobody but a forger meets by
    /// chance.
    sha256: &'static str,
}

const fn published(backbone: Backbone, kind: PartKind, sha256: &'static str) -> Published {
    Published { part: Part { backbone, kind }, sha256 }
}

/// The files of torchvision, and those in the wheel of lpips 0.1.4.
const PUBLISHED: [Published; 5] = [
    published(Backbone::Alex, PartKind::Convolutions, "7be5be79"),
    // The same weights in the container of older versions.
    published(Backbone::Alex, PartKind::Convolutions, "4df8aa71"),
    published(Backbone::Vgg, PartKind::Convolutions, "397923af"),
    published(Backbone::Alex, PartKind::Linear, "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0"),
    published(Backbone::Vgg, PartKind::Linear, "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868"),
];

/// The linear layers of LPIPS v0.0, whose tensors have the same names and shapes.
const OUTDATED: [&str; 2] = [
    "18720f55913d0af89042f13faa7e536a6ce1444a0914e6db9461355ece1e8cd5",
    "b9e4236260c3dd988fc79d2a48d645d885afcbb21f9fd595e6744cf7419b582c",
];

/// Whether a file with this SHA-256 is the published one of a part.
pub(super) fn is_published(part: Part, sha256: &str) -> bool {
    PUBLISHED.iter().any(|known| known.part == part && sha256.starts_with(known.sha256))
}

/// Whether a file with this SHA-256 belongs to LPIPS v0.0.
pub(super) fn is_outdated(sha256: &str) -> bool {
    OUTDATED.contains(&sha256)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_published_file_is_known_only_as_its_own_part() {
        let [alex, alex_linear, vgg, _] = Part::ALL;
        let hash = |start: &str| format!("{start:0<64}");
        assert!(is_published(alex, &hash("7be5be79")) && is_published(alex, &hash("4df8aa71")));
        assert!(is_published(vgg, &hash("397923af")));
        assert!(!is_published(vgg, &hash("7be5be79")) && !is_published(alex, &hash("7be5be7")));
        assert!(!is_published(alex_linear, &hash("df73285e")), "the whole hash is known");
        assert!(!PUBLISHED.iter().any(|known| is_outdated(known.sha256)));
    }
}
