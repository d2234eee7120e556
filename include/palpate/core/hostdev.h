// One text for host and device: a function marked PALPATE_HOSTDEV is compiled by the C++ compiler
// and by nvcc from the same lines.
#pragma once

#if defined(__CUDACC__)
#define PALPATE_HOSTDEV __host__ __device__
#else
#define PALPATE_HOSTDEV
#endif
