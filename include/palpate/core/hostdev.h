// shared by host and device: a function marked PALPATE_HOSTDEV is compiled by the C++ compiler
// and by nvcc from the same lines.
#pragma once

#if defined(__CUDACC__)
#define PALPATE_HOSTDEV __host__ __device__
#else
#define PALPATE_HOSTDEV
#endif

// The same for formulas that vector kernels use too: always part of the caller, because a copy of
// its own would be one for all instruction sets.
#if defined(__CUDACC__)
#define PALPATE_FORMULA __host__ __device__ inline
#else
#define PALPATE_FORMULA [[gnu::always_inline]] inline
#endif
