// One vector width for a kernel text that is compiled once per instruction set (see palpate_kernel
// in cmake/PalpateBuild.cmake). Plain GCC/Clang vector types; the few operations they lack are
// here and in simd_rows.h. Included only by kernel files, which put their code in namespace
// PALPATE_ISA_NAMESPACE.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#if !defined(PALPATE_LANES) || !defined(PALPATE_ISA_NAMESPACE)
#error "simd.h is for files compiled by palpate_kernel"
#endif

#if defined(__x86_64__)
#if PALPATE_LANES > 4
#include <immintrin.h>
#else
#include <xmmintrin.h>  // compiles in a tenth of the time
#endif
#elif defined(__wasm_simd128__)
#include <wasm_simd128.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

inline constexpr int kLanes = PALPATE_LANES;

typedef float VecF __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));
typedef std::int32_t VecI
    __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));

/// A bit for each lane, as mask_bits has them.
inline constexpr std::uint32_t kAllLanes = (1u << kLanes) - 1;

/// All lanes the same.
inline VecF splat(float value) { return value - VecF{}; }
inline VecI splat(std::int32_t value) { return VecI{} + value; }

/// 0, 1, 2, ...
inline VecI lane_ids() {
  VecI ids;
  for (int i = 0; i < kLanes; ++i) ids[i] = i;
  return ids;
}

/// Unaligned.
inline VecF load(const float* from) {
  VecF v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline VecI load(const std::int32_t* from) {
  VecI v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline void store(std::int32_t* to, VecI v) { std::memcpy(to, &v, sizeof v); }
inline void store(float* to, VecF v) { std::memcpy(to, &v, sizeof v); }
/// Writes the first `count` lanes, all of them if there are no more.
inline void store_first(float* to, VecF v, int count) {
  if (count >= kLanes) {
    store(to, v);
  } else {
    for (int i = 0; i < count; ++i) to[i] = v[i];
  }
}

/// Masks are 0 / -1 per lane, as comparisons give them. `mask ? a : b` selects.
using Mask = VecI;
inline VecF select(Mask mask, VecF a, VecF b) { return mask ? a : b; }
inline VecF min(VecF a, VecF b) { return a < b ? a : b; }
inline VecF max(VecF a, VecF b) { return a > b ? a : b; }

inline VecF sqrt(VecF v) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecF>(_mm512_sqrt_ps(reinterpret_cast<__m512>(v)));
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecF>(_mm256_sqrt_ps(reinterpret_cast<__m256>(v)));
#elif defined(__x86_64__)
  return reinterpret_cast<VecF>(_mm_sqrt_ps(reinterpret_cast<__m128>(v)));
#elif defined(__wasm_simd128__)
  return reinterpret_cast<VecF>(wasm_f32x4_sqrt(reinterpret_cast<v128_t>(v)));
#else
  for (int i = 0; i < kLanes; ++i) v[i] = std::sqrt(v[i]);
  return v;
#endif
}

inline VecF abs(VecF v) { return reinterpret_cast<VecF>(reinterpret_cast<VecI>(v) & 0x7fffffff); }

/// The bits of numbers, and back.
inline VecI bits_of(VecF v) { return reinterpret_cast<VecI>(v); }
inline VecF from_bits(VecI bits) { return reinterpret_cast<VecF>(bits); }

/// Bit i is set if lane i of the mask is.
inline std::uint32_t mask_bits(VecI mask) {
#if PALPATE_LANES == 16
  return _mm512_movepi32_mask(reinterpret_cast<__m512i>(mask));
#elif PALPATE_LANES == 8
  return static_cast<std::uint32_t>(_mm256_movemask_ps(reinterpret_cast<__m256>(mask)));
#elif defined(__x86_64__)
  return static_cast<std::uint32_t>(_mm_movemask_ps(reinterpret_cast<__m128>(mask)));
#elif defined(__wasm_simd128__)
  return wasm_i32x4_bitmask(reinterpret_cast<v128_t>(mask));
#else
  std::uint32_t bits = 0;
  for (int i = 0; i < kLanes; ++i) bits |= static_cast<std::uint32_t>(mask[i] & 1) << i;
  return bits;
#endif
}

inline bool is_any_set(VecI mask) { return mask_bits(mask) != 0; }

/// A sum over many values in sixteen parts, whatever the width of the vectors: so every instruction
/// set adds the same numbers in the same order and gives the same bits. Value i of a row of sixteen
/// is lane i % kLanes of part i / kLanes.
struct RowSums {
  static constexpr int kParts = 16 / kLanes;
  VecF lanes[kParts] = {};

  void add(int part, VecF values) { lanes[part] += values; }
  double total() const {
    float sum = 0;
    for (const VecF& v : lanes) {
      for (int i = 0; i < kLanes; ++i) sum += v[i];
    }
    return static_cast<double>(sum);
  }
};

/// Nearest whole number towards zero; lanes out of range give an unspecified number.
inline VecI to_int(VecF v) { return __builtin_convertvector(v, VecI); }
inline VecF to_float(VecI v) { return __builtin_convertvector(v, VecF); }

/// table[index[i]] for each lane.
inline VecI gather(const std::int32_t* table, VecI index) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecI>(_mm512_i32gather_epi32(reinterpret_cast<__m512i>(index), table, 4));
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecI>(_mm256_i32gather_epi32(table, reinterpret_cast<__m256i>(index), 4));
#else
  VecI v;
  for (int i = 0; i < kLanes; ++i) v[i] = table[index[i]];
  return v;
#endif
}

inline VecF gather(const float* table, VecI index) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecF>(_mm512_i32gather_ps(reinterpret_cast<__m512i>(index), table, 4));
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecF>(_mm256_i32gather_ps(table, reinterpret_cast<__m256i>(index), 4));
#else
  VecF v;
  for (int i = 0; i < kLanes; ++i) v[i] = table[index[i]];
  return v;
#endif
}

/// The byte table[index[i]] for each lane; three more bytes after the last one may be read.
inline VecI gather_bytes(const std::uint8_t* table, VecI index) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecI>(
             _mm512_i32gather_epi32(reinterpret_cast<__m512i>(index), table, 1)) &
         0xff;
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecI>(_mm256_i32gather_epi32(reinterpret_cast<const int*>(table),
                                                       reinterpret_cast<__m256i>(index), 1)) &
         0xff;
#else
  VecI v;
  for (int i = 0; i < kLanes; ++i) v[i] = table[index[i]];
  return v;
#endif
}

/// Is any of the bytes table[index[i]] not 0?
inline bool any_byte(const std::uint8_t* table, VecI index) {
  std::uint32_t any = 0;
  for (int i = 0; i < kLanes; ++i) any |= table[index[i]];
  return any != 0;
}

/// A few numbers to pick from, faster than from memory.
template <class Element>
struct LaneTable {
  alignas(64) Element entries[kLanes > 8 ? kLanes : 8] = {};
};

/// table.entries[index[i]] for each lane, index 0 ... 7.
inline VecF look_up(const LaneTable<float>& table, VecI index) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecF>(
      _mm512_permutexvar_ps(reinterpret_cast<__m512i>(index), _mm512_load_ps(table.entries)));
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecF>(
      _mm256_permutevar8x32_ps(_mm256_load_ps(table.entries), reinterpret_cast<__m256i>(index)));
#else
  return gather(table.entries, index);
#endif
}
inline VecI look_up(const LaneTable<std::int32_t>& table, VecI index) {
#if PALPATE_LANES == 16
  return reinterpret_cast<VecI>(
      _mm512_permutexvar_epi32(reinterpret_cast<__m512i>(index), _mm512_load_si512(table.entries)));
#elif PALPATE_LANES == 8
  return reinterpret_cast<VecI>(_mm256_permutevar8x32_epi32(
      _mm256_load_si256(reinterpret_cast<const __m256i*>(table.entries)),
      reinterpret_cast<__m256i>(index)));
#else
  return gather(table.entries, index);
#endif
}

#if PALPATE_LANES == 4
/// Bytes that bring the lanes whose bit is set to the front, and back from there; all others are
/// those of lane 0.
struct ByteOrders {
  alignas(16) std::uint8_t packing[16][16] = {}, unpacking[16][16] = {};

  constexpr ByteOrders() {
    for (unsigned bits = 0; bits < 16; ++bits) {
      for (unsigned byte = 0; byte < 16; ++byte) {
        packing[bits][byte] = unpacking[bits][byte] = static_cast<std::uint8_t>(byte % 4);
      }
      unsigned place = 0;
      for (unsigned lane = 0; lane < 4; ++lane) {
        if ((bits >> lane & 1) == 0) continue;
        for (unsigned byte = 0; byte < 4; ++byte) {
          packing[bits][4 * place + byte] = static_cast<std::uint8_t>(4 * lane + byte);
          unpacking[bits][4 * lane + byte] = static_cast<std::uint8_t>(4 * place + byte);
        }
        ++place;
      }
    }
  }
};
constexpr ByteOrders kByteOrders;

inline VecI pick_bytes(VecI v, const std::uint8_t (&order)[16]) {
#if defined(__x86_64__)
  typedef char Bytes __attribute__((vector_size(16)));
  Bytes at;
  std::memcpy(&at, order, sizeof at);
  return reinterpret_cast<VecI>(__builtin_ia32_pshufb128(reinterpret_cast<Bytes>(v), at));
#elif defined(__wasm_simd128__)
  return reinterpret_cast<VecI>(
      wasm_i8x16_swizzle(reinterpret_cast<v128_t>(v), wasm_v128_load(order)));
#elif defined(__aarch64__)
  return reinterpret_cast<VecI>(vqtbl1q_u8(reinterpret_cast<uint8x16_t>(v), vld1q_u8(order)));
#else
  VecI picked;
  for (int i = 0; i < kLanes; ++i) picked[i] = v[order[4 * i] / 4];
  return picked;
#endif
}
#endif

/// Writes the lanes whose bit is set to consecutive places; may also write up to kLanes values in
/// all, behind them those of lane 0, or 0.
template <class Vec, class Element>
inline void compress_store(Element* to, Vec v, std::uint32_t bits) {
  static_assert(sizeof(Element) == 4);
#if PALPATE_LANES == 16
  _mm512_storeu_si512(
      to, _mm512_maskz_compress_epi32(static_cast<__mmask16>(bits), reinterpret_cast<__m512i>(v)));
#elif PALPATE_LANES == 8
  // Spread the bits to bytes, pick the byte numbers of the set ones, widen them to lane numbers.
  const std::uint64_t bytes = _pdep_u64(bits, 0x0101010101010101u) * 0xff;
  const std::uint64_t lanes = _pext_u64(0x0706050403020100u, bytes);
  const __m256i order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(lanes)));
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(to),
                      _mm256_permutevar8x32_epi32(reinterpret_cast<__m256i>(v), order));
#else
  const VecI packed = pick_bytes(reinterpret_cast<VecI>(v), kByteOrders.packing[bits]);
  std::memcpy(to, &packed, sizeof packed);
#endif
}

/// Reads consecutive numbers into the lanes whose bit is set; the others keep theirs. kLanes
/// numbers may be read.
inline void expand_load(const float* from, std::uint32_t bits, VecF& v) {
#if PALPATE_LANES == 16
  v = reinterpret_cast<VecF>(_mm512_mask_expand_ps(
      reinterpret_cast<__m512>(v), static_cast<__mmask16>(bits), _mm512_loadu_ps(from)));
#elif PALPATE_LANES == 8
  // Spread the bits to bytes, and hand the numbers 0, 1, ... to the set ones.
  const std::uint64_t bytes = _pdep_u64(bits, 0x0101010101010101u) * 0xff;
  const std::uint64_t places = _pdep_u64(0x0706050403020100u, bytes);
  const __m256i order = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(places)));
  const __m256i is_set = _mm256_cvtepi8_epi32(_mm_cvtsi64_si128(static_cast<long long>(bytes)));
  v = reinterpret_cast<VecF>(_mm256_blendv_ps(
      reinterpret_cast<__m256>(v), _mm256_permutevar8x32_ps(_mm256_loadu_ps(from), order),
      _mm256_castsi256_ps(is_set)));
#else
  const VecI is_set = (splat(static_cast<std::int32_t>(bits)) & VecI{1, 2, 4, 8}) != 0;
  v = is_set ? from_bits(pick_bytes(bits_of(load(from)), kByteOrders.unpacking[bits])) : v;
#endif
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
