//! LPIPS weights out of the files in which they are published: torchvision's `.pth` of AlexNet and VGG-16, and the
//! linear layers in the wheel of the package lpips.

mod collection;
mod part;
mod published;
mod torch_file;

pub use collection::{Collection, FoundPart, Weights};
pub use part::{Part, PartKind};
