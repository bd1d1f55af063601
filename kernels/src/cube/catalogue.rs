//! Every kernel with the compile-time parameters that a training at the paper's setting gives it, for tools that compile
//! kernels without launching them.

use std::sync::Arc;

use cubecl::ir::features::Features;
use cubecl::ir::settings::{ExecutionMode, KernelSettings};
use cubecl::ir::{
    AddressType, DeviceIdentity, DeviceProperties, HardwareProperties, MemoryDeviceProperties, TargetProperties,
};
use cubecl::prelude::*;
use cubecl::profile::TimingMethod;

use super::activation::{ShareKindCompilationArg, foreground_share, logistic, logistic_backward};
use super::adam::{AdamStepCompilationArg, adam, adam_of_three};
use super::atomic::{ExchangedSum, NativeSum};
use super::attention::{attention, attention_backward};
use super::backward_kind::{BlendBackwardKind, CountedChannels};
use super::blend::blend;
use super::blend_backward::blend_backward;
use super::grid::{GridBoxCompilationArg, look_up, look_up_backward, sum_places};
use super::maths::{PairCompilationArg, TripleCompilationArg};
use super::matrix::MatrixLayoutCompilationArg;
use super::objective::{
    Normalisation, ObjectiveKind, ObjectiveWeightsCompilationArg, objective_finish, objective_prepare,
};
use super::offsets::{EachAttributeCompilationArg, add_offsets, join_cotangents};
use super::penalties::{penalties, penalties_backward};
use super::picture::unpack;
use super::product::{ProductSizeCompilationArg, product};
use super::product_kind::{End, ProductKind, ProductPlan};
use super::project::project;
use super::project_backward::project_backward;
use super::records::sum_pieces;
use super::scales::{ScaleRuleCompilationArg, scale_cost, scale_cost_backward};
use super::scan::{scan_blocks, sum_blocks};
use super::similarity::{
    Derivatives, ImageStartsCompilationArg, SimilarityConstantsCompilationArg, SimilarityKind, similarity,
    similarity_adjoint,
};
use super::sort::{MoveKind, STAGED_BYTES, count_digits, move_keys};
use super::stage::{FOUR, GPU_MEMORY, GPU_SPAN, TileShare};
use super::sums::{SumPlan, sum_rows};
use super::tiles::{
    FramePlaceCompilationArg, begin_pairs, collect_visible, counts_by_depth, emit_pairs, find_starts, frame_keys,
    list_pairs, mark_visible,
};
use super::view::{BlendRulesCompilationArg, ProjectionKind, ViewCompilationArg};
use super::window::{PlaneSizeCompilationArg, blur_columns, blur_rows};
use super::{MOST_BUFFERS, UNITS};

/// Channels of the two branches' images: colour, three mask channels in the dynamic branch, depth.
const CHANNELS: [usize; 2] = [4, 7];

/// Columns of the networks' layers at the paper's setting: heads, hidden layers.
const COLUMNS: [usize; 2] = [4, 128];

/// Rows of these layers: the dynamic Gaussians of two views.
const ROWS: usize = 60_000;

/// Columns whose rows are summed: a background, the parameters of a network.
const SUMS: [usize; 2] = [4, 128];

/// A kernel that can be compiled.
pub struct Kernel {
    /// The name of its function.
    pub name: &'static str,
    /// What distinguishes it from others of this name; may be empty.
    pub variant: String,
    /// Units of a cube.
    pub units: usize,
    kernel: Box<dyn CubeKernel>,
}

impl Kernel {
    /// Its definition, to be compiled.
    pub fn define(&self) -> KernelDefinition {
        self.kernel.define()
    }

    /// Name and variant.
    pub fn label(&self) -> String {
        if self.variant.is_empty() { self.name.to_owned() } else { format!("{}, {}", self.name, self.variant) }
    }
}

/// A GPU that kernels are compiled for.
#[derive(Clone)]
pub struct Target {
    device: Arc<DeviceProperties>,
    runtime: Arc<TargetProperties>,
}

impl Target {
    /// A GPU with what all of them have. `register` adds what its runtime supports.
    pub fn new(register: impl FnOnce(&mut DeviceProperties)) -> Self {
        let hardware = HardwareProperties {
            load_width: 128,
            vector_register_count: None,
            plane_size_min: 32,
            plane_size_max: 32,
            max_bindings: MOST_BUFFERS,
            max_shared_memory_size: GPU_MEMORY,
            max_cube_count: (u16::MAX.into(), u16::MAX.into(), u16::MAX.into()),
            max_units_per_cube: UNITS as u32,
            max_cube_dim: (UNITS as u32, UNITS as u32, 64),
            num_streaming_multiprocessors: None,
            num_tensor_cores: None,
            min_tensor_cores_dim: None,
            num_cpu_cores: None,
            last_level_cache_size: None,
            max_vector_size: 4,
            cube_mma_reserved_shared_memory: 0,
        };
        let name = "a described GPU".to_owned();
        let identity = DeviceIdentity { fingerprint: name.clone(), name, physical: None };
        let memory = MemoryDeviceProperties::new(u64::MAX, 256);
        let mut device = DeviceProperties::new(Features::default(), memory, hardware, TimingMethod::Device, identity);
        register(&mut device);
        Self { device: Arc::new(device), runtime: Arc::new(TargetProperties::default()) }
    }
}

/// The argument that a compiled kernel depends on: no more than that it is there.
trait Argument {
    fn any() -> Self;
}

impl Argument for () {
    fn any() -> Self {}
}

impl Argument for BufferCompilationArg {
    fn any() -> Self {
        Self { inplace: None }
    }
}

/// Arguments that consist of arguments.
macro_rules! arguments {
    ($($argument:ident { $($field:ident),* $(,)? })*) => {
        $(impl Argument for $argument {
            fn any() -> Self {
                Self { $($field: Argument::any()),* }
            }
        })*
    };
}

arguments! {
    PairCompilationArg { x, y }
    TripleCompilationArg { x, y, z }
    ViewCompilationArg {
        width, height, focal, principal, right, down, forward, translation, centre, tangent_low, tangent_high, near, far,
        depth_guard, dilation, sigmas,
    }
    FramePlaceCompilationArg { gaussian, before, pair, tile }
    BlendRulesCompilationArg { alpha_clamp, gradient_clamp, stop }
    GridBoxCompilationArg { max, min, slope }
    AdamStepCompilationArg { beta1, rest1, beta2, rest2, rate, root, epsilon }
    MatrixLayoutCompilationArg { first, stride }
    EachAttributeCompilationArg { a, b, c, d, e, f }
    ShareKindCompilationArg { columns, static_, dynamic, epsilon, margin }
    ScaleRuleCompilationArg { large, large_above, spiky, spiky_above }
    ProductSizeCompilationArg { rows, columns, depth, slab }
    ImageStartsCompilationArg { a, b, v_map }
    SimilarityConstantsCompilationArg { c1, c2, c3, structure_max }
    PlaneSizeCompilationArg { planes, height, width }
    ObjectiveWeightsCompilationArg {
        composed_l1, geometry_l1, geometry_dssim, depth_back, depth_forward, smooth_right, smooth_down, likeness,
        branch_dssim, branch_l1, composed_dssim, brightness, explicit_brightness, entropy, mask_motion, mask_still,
        dynamic_above, static_above, inverse_extent,
    }
}

/// The list in the making.
struct Catalogue<'a> {
    target: &'a Target,
    kernels: Vec<Kernel>,
}

/// Adds a kernel: its function, its type, its arguments at run time (one `_` each), its compile-time parameters.
macro_rules! add {
    ($to:ident, $mode:ident, $units:expr, $variant:expr, $function:ident::$kernel:ident $(::<$sum:ty>)?,
     [$($argument:tt)*] $(, $parameter:expr)*) => {
        let kernel = $function::$kernel $(::<$sum>)?::new(
            $to.settings($units, ExecutionMode::$mode),
            $to.target.device.clone(),
            $to.target.runtime.clone(),
            $(any!($argument),)*
            $($parameter),*
        );
        $to.kernels.push(Kernel {
            name: stringify!($function),
            variant: $variant.to_string(),
            units: $units,
            kernel: Box::new(kernel),
        });
    };
}

macro_rules! any {
    (_) => {
        Argument::any()
    };
}

/// All kernels.
pub fn catalogue(target: &Target) -> Vec<Kernel> {
    let mut list = Catalogue { target, kernels: Vec::new() };
    list.add_projection();
    list.add_lists();
    list.add_blending();
    list.add_networks();
    list.add_windows();
    list.add_objective();
    list.kernels
}

impl Catalogue<'_> {
    fn settings(&self, units: usize, mode: ExecutionMode) -> KernelSettings {
        KernelSettings::new(*CubeDim::new_1d(units as u32), mode, AddressType::U32)
    }

    /// Bytes of shared memory that a cube can have.
    fn memory(&self) -> usize {
        self.target.device.hardware.max_shared_memory_size
    }

    fn add_projection(&mut self) {
        let kind = ProjectionKind { square: true, compensated: false, degree: 3 };
        add!(self, Checked, UNITS, "", project::Project, [_ _ _ _ _ _ _ _ _ _ _ _ _ _], kind);
        for channels in CHANNELS {
            let variant = format!("{channels} channels");
            add!(
                self, Unchecked, UNITS, variant, project_backward::ProjectBackward,
                [_ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _], true, channels, kind
            );
            let variant = format!("{channels} channels");
            add!(self, Unchecked, UNITS, variant, sum_pieces::SumPieces, [_ _ _ _], channels);
        }
    }

    fn add_lists(&mut self) {
        add!(self, Checked, UNITS, "", mark_visible::MarkVisible, [_ _ _ _ _]);
        add!(self, Checked, UNITS, "", collect_visible::CollectVisible, [_ _ _ _ _ _ _]);
        add!(self, Checked, UNITS, "", frame_keys::FrameKeys, [_ _ _ _ _]);
        add!(self, Checked, UNITS, "", counts_by_depth::CountsByDepth, [_ _ _ _ _]);
        add!(self, Checked, UNITS, "", begin_pairs::BeginPairs, [_ _ _ _]);
        add!(self, Checked, UNITS, "", emit_pairs::EmitPairs, [_ _ _ _ _ _ _ _ _ _], true);
        add!(self, Checked, UNITS, "", list_pairs::ListPairs, [_ _ _ _ _ _ _]);
        add!(self, Checked, UNITS, "", find_starts::FindStarts, [_ _ _ _ _]);
        add!(self, Checked, UNITS, "", sum_blocks::SumBlocks, [_ _ _ _]);
        for one in [false, true] {
            let variant = if one { "last" } else { "" };
            add!(self, Checked, UNITS, variant, scan_blocks::ScanBlocks, [_ _ _ _ _ _], one);
        }
        add!(self, Unchecked, UNITS, "", count_digits::CountDigits, [_ _ _ _ _]);
        for (numbered, variant) in [(true, ""), (false, "first of the tiles")] {
            let kind = MoveKind { staged: self.memory() >= STAGED_BYTES, numbered };
            add!(self, Unchecked, UNITS, variant, move_keys::MoveKeys, [_ _ _ _ _ _ _ _], kind);
        }
    }

    fn add_blending(&mut self) {
        for channels in CHANNELS {
            let variant = format!("{channels} channels");
            // Proof: few channels fit into this much memory.
            let share = TileShare::fitting(GPU_SPAN, channels, GPU_MEMORY).expect("the channels fit");
            add!(self, Unchecked, share.units(), variant, blend::Blend, [_ _ _ _ _ _ _ _ _ _ _], share);
            for (statistic, word) in [(Some(CountedChannels::ColourAndDepth), ""), (None, " without statistic")] {
                let kind = BlendBackwardKind::fitting(GPU_SPAN, channels, statistic, GPU_MEMORY);
                let kind = kind.expect("the channels fit");
                let variant = format!("{channels} channels{word}");
                add!(
                    self, Unchecked, kind.share.units(), variant, blend_backward::BlendBackward,
                    [_ _ _ _ _ _ _ _ _ _ _ _ _], kind
                );
            }
        }
    }

    fn add_networks(&mut self) {
        add!(self, Unchecked, UNITS, "", look_up::LookUp, [_ _ _ _ _ _ _ _ _ _]);
        add!(
            self, Unchecked, UNITS, "atomic additions", look_up_backward::LookUpBackward::<NativeSum>,
            [_ _ _ _ _ _ _ _ _ _ _ _ _]
        );
        add!(
            self, Unchecked, UNITS, "atomic exchanges", look_up_backward::LookUpBackward::<ExchangedSum>,
            [_ _ _ _ _ _ _ _ _ _ _ _ _]
        );
        add!(self, Checked, UNITS, "", sum_places::SumPlaces, [_ _ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", penalties::Penalties, [_ _ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", penalties_backward::PenaltiesBackward, [_ _ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", scale_cost::ScaleCost, [_ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", scale_cost_backward::ScaleCostBackward, [_ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", add_offsets::AddOffsets, [_ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", join_cotangents::JoinCotangents, [_ _ _ _ _ _ _ _ _ _ _]);
        add!(self, Unchecked, UNITS, "", logistic::Logistic, [_ _ _]);
        add!(self, Unchecked, UNITS, "", logistic_backward::LogisticBackward, [_ _ _ _]);
        add!(self, Unchecked, UNITS, "", foreground_share::ForegroundShare, [_ _ _ _]);
        let ends = [
            ("a layer", End::Layer { rectified: true }),
            ("a last layer", End::Layer { rectified: false }),
            ("an adjoint", End::Adjoint { gated: true, added: true }),
            ("slabs", End::Slabs),
        ];
        let memory = self.memory();
        for columns in COLUMNS {
            for (name, end) in ends {
                let rows = if end == End::Slabs { columns } else { ROWS };
                let plan = ProductPlan::of_gpu([rows, columns]);
                let kind = ProductKind::new(plan, columns, end == End::Slabs, end, memory);
                let variant = format!("{name} of {columns} columns");
                add!(self, Unchecked, kind.units, variant, product::Product, [_ _ _ _ _ _ _ _ _ _ _], FOUR, FOUR, FOUR, kind);
            }
        }
        for columns in SUMS {
            let variant = format!("{columns} columns");
            let across = SumPlan::new(1, columns).across;
            add!(self, Unchecked, UNITS, variant, sum_rows::SumRows, [_ _ _ _ _ _], across);
        }
        let (heads, queries, keys) = (4, 1, 2);
        add!(self, Checked, UNITS, "", attention::Attention, [_ _ _ _ _], FOUR, heads, queries, keys);
        add!(self, Checked, UNITS, "", attention_backward::AttentionBackward, [_ _ _ _ _ _ _], FOUR, heads, queries, keys);
        add!(self, Checked, UNITS, "", adam::Adam, [_ _ _ _ _ _]);
        add!(self, Checked, UNITS, "", adam_of_three::AdamOfThree, [_ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _]);
    }

    fn add_windows(&mut self) {
        add!(self, Unchecked, UNITS, "", blur_columns::BlurColumns, [_ _ _ _]);
        add!(self, Unchecked, UNITS, "", blur_rows::BlurRows, [_ _ _ _]);
        for (variant, kind, radius) in [("SSIM", SimilarityKind::Ssim, 5), ("structure", SimilarityKind::Structure, 2)]
        {
            for (word, derivatives) in [("", Derivatives::First), (" without gradient", Derivatives::None)] {
                let variant = format!("{variant}{word}");
                add!(
                    self, Unchecked, UNITS, variant, similarity::Similarity, [_ _ _ _ _ _ _ _ _], radius, kind,
                    derivatives
                );
            }
            add!(
                self, Unchecked, UNITS, variant, similarity_adjoint::SimilarityAdjoint, [_ _ _ _ _ _ _ _ _ _], radius,
                false
            );
        }
    }

    fn add_objective(&mut self) {
        for channels in [1, 3] {
            let variant = format!("{channels} channels");
            add!(self, Checked, UNITS, variant, unpack::Unpack, [_ _ _], channels);
        }
        for (geometry, masked, variant) in
            [(true, true, "first stage"), (false, true, "later stages"), (false, false, "later stages without masks")]
        {
            let kind = ObjectiveKind {
                normalisation: if geometry { Normalisation::Geometry } else { Normalisation::Deformation },
                exposed: true,
                masked: [masked; 3],
                dynamic_region: masked,
                static_region: masked,
                geometry,
                geometry_mean: false,
                depth_back_detached: false,
                entropy: true,
                smooth: true,
                similarity: true,
                structure: true,
                wanted: true,
            };
            add!(
                self, Unchecked, UNITS, variant, objective_prepare::ObjectivePrepare, [_ _ _ _ _ _ _ _ _ _ _ _], kind
            );
            add!(
                self, Unchecked, UNITS, variant, objective_finish::ObjectiveFinish,
                [_ _ _ _ _ _ _ _ _ _ _ _ _ _ _ _], kind
            );
        }
    }
}
