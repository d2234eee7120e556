// Which vector instructions this processor has. One binary carries all variants of a kernel.
#pragma once

namespace palpate {

/// Vector instruction levels, lowest first. `baseline` is x86-64-v2 (or NEON on 64-bit Arm).
enum class Isa { baseline, avx2, avx512 };

/// The best level this processor and operating system support, or the one named by the environment
/// variable PALPATE_ISA (baseline, avx2, avx512) if that is lower.
Isa best_isa();

/// "baseline", "avx2" or "avx512".
const char* isa_name(Isa isa);

}  // namespace palpate
