//! Segments of `f32` as AVX2 registers.
//!
//! Registers and arrays are converted with `transmute`. With debug assertions, safe casts go through memory, which
//! halves the speed of the hot loops.

#[cfg(target_arch = "x86")]
use std::arch::x86::{__m256, __m256i, _CMP_LE_OQ, _CMP_LT_OQ};
#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::{__m256, __m256i, _CMP_LE_OQ, _CMP_LT_OQ};

use std::mem::transmute;

use pulp::NullaryFnOnce;
use pulp::x86::V3;

use super::{Lanes, VectorJob, Vectors, exp_single};

/// Runs a job on AVX2 registers.
pub(super) struct OnAvx2<J>(pub J, pub V3);

impl<J: VectorJob<f32>> NullaryFnOnce for OnAvx2<J> {
    type Output = J::Output;

    #[inline(always)]
    fn call(self) -> J::Output {
        self.0.run(self.1)
    }
}

impl Vectors<f32> for V3 {
    type V = __m256;
    type M = __m256;
    type I = __m256i;

    #[inline(always)]
    fn load(self, lanes: &Lanes<f32>) -> __m256 {
        // SAFETY: both are eight floats, and all bit patterns are valid floats.
        unsafe { transmute::<Lanes<f32>, __m256>(*lanes) }
    }
    #[inline(always)]
    fn store(self, v: __m256) -> Lanes<f32> {
        // SAFETY: as for `load`.
        unsafe { transmute::<__m256, Lanes<f32>>(v) }
    }
    #[inline(always)]
    fn splat(self, value: f32) -> __m256 {
        self.avx._mm256_set1_ps(value)
    }
    #[inline(always)]
    fn add(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_add_ps(a, b)
    }
    #[inline(always)]
    fn sub(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_sub_ps(a, b)
    }
    #[inline(always)]
    fn mul(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_mul_ps(a, b)
    }
    #[inline(always)]
    fn div(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_div_ps(a, b)
    }
    #[inline(always)]
    fn fma(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        self.fma._mm256_fmadd_ps(a, b, c)
    }
    #[inline(always)]
    fn sub_product(self, c: __m256, a: __m256, b: __m256) -> __m256 {
        self.fma._mm256_fnmadd_ps(a, b, c)
    }
    #[inline(always)]
    fn min(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_min_ps(a, b)
    }
    #[inline(always)]
    fn max(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_max_ps(a, b)
    }
    #[inline(always)]
    fn exp(self, a: __m256) -> __m256 {
        exp_single(self, a, |p, shifted| {
            let exponent = self.avx2._mm256_slli_epi32::<23>(self.avx._mm256_castps_si256(shifted));
            self.avx._mm256_castsi256_ps(self.avx2._mm256_add_epi32(self.avx._mm256_castps_si256(p), exponent))
        })
    }
    #[inline(always)]
    fn less(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_cmp_ps::<_CMP_LT_OQ>(a, b)
    }
    #[inline(always)]
    fn at_most(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(a, b)
    }
    #[inline(always)]
    fn both(self, a: __m256, b: __m256) -> __m256 {
        self.avx._mm256_and_ps(a, b)
    }
    #[inline(always)]
    fn bits(self, mask: __m256) -> u32 {
        self.avx._mm256_movemask_ps(mask) as u32
    }
    #[inline(always)]
    fn select(self, mask: __m256, yes: __m256, no: __m256) -> __m256 {
        self.avx._mm256_blendv_ps(no, yes, mask)
    }
    #[inline(always)]
    fn load_index(self, lanes: &Lanes<i32>) -> __m256i {
        // SAFETY: both have 256 bits, and all bit patterns are valid integers.
        unsafe { transmute::<Lanes<i32>, __m256i>(*lanes) }
    }
    #[inline(always)]
    fn store_index(self, v: __m256i) -> Lanes<i32> {
        // SAFETY: as for `load_index`.
        unsafe { transmute::<__m256i, Lanes<i32>>(v) }
    }
    #[inline(always)]
    fn splat_index(self, value: i32) -> __m256i {
        self.avx._mm256_set1_epi32(value)
    }
    #[inline(always)]
    fn index_less(self, a: __m256i, b: __m256i) -> __m256 {
        self.avx._mm256_castsi256_ps(self.avx2._mm256_cmpgt_epi32(b, a))
    }
    #[inline(always)]
    fn select_index(self, mask: __m256, yes: __m256i, no: __m256i) -> __m256i {
        let (yes, no) = (self.avx._mm256_castsi256_ps(yes), self.avx._mm256_castsi256_ps(no));
        self.avx._mm256_castps_si256(self.avx._mm256_blendv_ps(no, yes, mask))
    }
}
