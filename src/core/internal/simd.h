// One vector width for a kernel text that is compiled once per instruction set (see palpate_kernel
// in cmake/PalpateBuild.cmake). Plain GCC/Clang vector types; the few operations they lack are
// here. Included only by kernel files, which put their code in namespace PALPATE_ISA_NAMESPACE.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#if !defined(PALPATE_LANES) || !defined(PALPATE_ISA_NAMESPACE)
#error "simd.h is for files compiled by palpate_kernel"
#endif

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

inline constexpr int kLanes = PALPATE_LANES;

typedef float VecF __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));
typedef std::int32_t VecI
    __attribute__((vector_size(PALPATE_LANES * 4), aligned(PALPATE_LANES * 4)));

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

/// Pairs of numbers, of kLanes places that follow each other, as two columns.
struct Pairs {
  VecF first, second;
};
/// `left` and `right` hold pairs: all their first numbers, and all their second ones.
inline Pairs split_pairs(VecF left, VecF right) {
#if PALPATE_LANES == 16
  return {__builtin_shufflevector(left, right, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26,
                                  28, 30),
          __builtin_shufflevector(left, right, 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27,
                                  29, 31)};
#elif PALPATE_LANES == 8
  return {__builtin_shufflevector(left, right, 0, 2, 4, 6, 8, 10, 12, 14),
          __builtin_shufflevector(left, right, 1, 3, 5, 7, 9, 11, 13, 15)};
#else
  return {__builtin_shufflevector(left, right, 0, 2, 4, 6),
          __builtin_shufflevector(left, right, 1, 3, 5, 7)};
#endif
}
inline Pairs load_pairs(const float* from) { return split_pairs(load(from), load(from + kLanes)); }
inline void store_pairs(float* to, const Pairs& pairs) {
#if PALPATE_LANES == 16
  store(to, __builtin_shufflevector(pairs.first, pairs.second, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5,
                                    21, 6, 22, 7, 23));
  store(to + kLanes, __builtin_shufflevector(pairs.first, pairs.second, 8, 24, 9, 25, 10, 26, 11,
                                             27, 12, 28, 13, 29, 14, 30, 15, 31));
#elif PALPATE_LANES == 8
  store(to, __builtin_shufflevector(pairs.first, pairs.second, 0, 8, 1, 9, 2, 10, 3, 11));
  store(to + kLanes,
        __builtin_shufflevector(pairs.first, pairs.second, 4, 12, 5, 13, 6, 14, 7, 15));
#else
  store(to, __builtin_shufflevector(pairs.first, pairs.second, 0, 4, 1, 5));
  store(to + kLanes, __builtin_shufflevector(pairs.first, pairs.second, 2, 6, 3, 7));
#endif
}

/// Transposes the four by four numbers in each quarter of a vector of 16 lanes (half of 8, all of
/// 4) of four vectors.
inline void transpose_fours(const VecF (&rows)[4], VecF (&columns)[4]) {
#if PALPATE_LANES == 16
  const auto low = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29);
  };
  const auto high = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15,
                                   31);
  };
  const auto first = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24, 25, 12, 13, 28, 29);
  };
  const auto second = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26, 27, 14, 15, 30,
                                   31);
  };
#elif PALPATE_LANES == 8
  const auto low = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 0, 8, 1, 9, 4, 12, 5, 13);
  };
  const auto high = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 2, 10, 3, 11, 6, 14, 7, 15);
  };
  const auto first = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 0, 1, 8, 9, 4, 5, 12, 13);
  };
  const auto second = [](VecF x, VecF y) {
    return __builtin_shufflevector(x, y, 2, 3, 10, 11, 6, 7, 14, 15);
  };
#else
  const auto low = [](VecF x, VecF y) { return __builtin_shufflevector(x, y, 0, 4, 1, 5); };
  const auto high = [](VecF x, VecF y) { return __builtin_shufflevector(x, y, 2, 6, 3, 7); };
  const auto first = [](VecF x, VecF y) { return __builtin_shufflevector(x, y, 0, 1, 4, 5); };
  const auto second = [](VecF x, VecF y) { return __builtin_shufflevector(x, y, 2, 3, 6, 7); };
#endif
  const VecF low01 = low(rows[0], rows[1]), low23 = low(rows[2], rows[3]);
  const VecF high01 = high(rows[0], rows[1]), high23 = high(rows[2], rows[3]);
  columns[0] = first(low01, low23);
  columns[1] = second(low01, low23);
  columns[2] = first(high01, high23);
  columns[3] = second(high01, high23);
}

/// Four vectors as a row of four numbers per lane; the row of lane i begins at to[stride * i].
inline void store_fours(float* to, std::ptrdiff_t stride, const VecF (&columns)[4]) {
  VecF rows[4];
  transpose_fours(columns, rows);
  for (int i = 0; i < kLanes; ++i) {
    std::memcpy(to + stride * i, reinterpret_cast<const float*>(&rows[i % 4]) + i / 4 * 4,
                4 * sizeof(float));
  }
}

/// Numbers k = 0, 1, 2 from table[index[i]] on, for each lane, as columns[k]; four are read. Loads
/// rows and transposes them, which is faster than gathering.
inline void gather_three(const float* table, VecI index, VecF (&columns)[3]) {
  VecF rows[4], all[4];
  // Row i holds the numbers of lanes i, i + 4, ..., four for each.
  for (int i = 0; i < 4; ++i) {
    float* const row = reinterpret_cast<float*>(&rows[i]);
    for (int k = 0; k < kLanes / 4; ++k) {
      std::memcpy(row + 4 * k, table + std::ptrdiff_t{index[i + 4 * k]}, 4 * sizeof(float));
    }
  }
  transpose_fours(rows, all);
  for (int k = 0; k < 3; ++k) columns[k] = all[k];
}

/// Numbers k = 0 ... 5 from table[2 * index[i]] on, for each lane, as columns[k]; eight may be
/// read. Loads whole rows and transposes them, which is faster than gathering.
inline void gather_three_pairs(const float* table, VecI index, VecF (&columns)[6]) {
#if PALPATE_LANES == 16
  alignas(64) std::int32_t at[kLanes];
  store(at, index);
  // Each vector holds eight numbers of lane `lane` and eight of lane + 4.
  const auto rows = [&](int lane) {
    const auto row = [&](int i) {
      return _mm256_loadu_pd(reinterpret_cast<const double*>(table + 2 * std::ptrdiff_t{at[i]}));
    };
    return reinterpret_cast<VecF>(
        _mm512_insertf64x4(_mm512_castpd256_pd512(row(lane)), row(lane + 4), 1));
  };
  VecF halves[2][4];  // of lanes 0 to 7 and 8 to 15: numbers k, 4 + k, k, 4 + k of four lanes each
  for (int i = 0; i < 2; ++i) {
    const VecF four[4] = {rows(8 * i), rows(8 * i + 1), rows(8 * i + 2), rows(8 * i + 3)};
    transpose_fours(four, halves[i]);
  }
  for (int k = 0; k < 4; ++k) {
    const __m512 low = reinterpret_cast<__m512>(halves[0][k]),
                 high = reinterpret_cast<__m512>(halves[1][k]);
    columns[k] = reinterpret_cast<VecF>(_mm512_shuffle_f32x4(low, high, 0x88));
    if (k < 2) columns[4 + k] = reinterpret_cast<VecF>(_mm512_shuffle_f32x4(low, high, 0xdd));
  }
#elif PALPATE_LANES == 8
  const auto row = [&](int lane) { return table + 2 * std::ptrdiff_t{index[lane]}; };
  VecF low[4], high[4];  // two rows woven into each other
  for (int i = 0; i < 4; ++i) {
    const VecF a = load(row(2 * i)), b = load(row(2 * i + 1));
    low[i] = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
    high[i] = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
  }
  const auto first = [](VecF a, VecF b) {
    return __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13);
  };
  const auto second = [](VecF a, VecF b) {
    return __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
  };
  const auto left = [](VecF a, VecF b) {
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 8, 9, 10, 11);
  };
  const auto right = [](VecF a, VecF b) {
    return __builtin_shufflevector(a, b, 4, 5, 6, 7, 12, 13, 14, 15);
  };
  const VecF a04 = first(low[0], low[1]), b04 = first(low[2], low[3]);
  const VecF a15 = second(low[0], low[1]), b15 = second(low[2], low[3]);
  columns[0] = left(a04, b04);
  columns[1] = left(a15, b15);
  columns[2] = left(first(high[0], high[1]), first(high[2], high[3]));
  columns[3] = left(second(high[0], high[1]), second(high[2], high[3]));
  columns[4] = right(a04, b04);
  columns[5] = right(a15, b15);
#else
  const auto row = [&](int lane, int first) {
    return load(table + 2 * std::ptrdiff_t{index[lane]} + first);
  };
  VecF front[4], back[4];
  transpose_fours({row(0, 0), row(1, 0), row(2, 0), row(3, 0)}, front);
  transpose_fours({row(0, 4), row(1, 4), row(2, 4), row(3, 4)}, back);
  for (int k = 0; k < 4; ++k) columns[k] = front[k];
  columns[4] = back[0];
  columns[5] = back[1];
#endif
}

/// Numbers k = 0 ... 3 from table[4 * index[i]] on, for each lane, as columns[k].
inline void gather_fours(const float* table, VecI index, VecF (&columns)[4]) {
  alignas(64) std::int32_t at[kLanes];
  store(at, index);
  VecF rows[4];
  for (int i = 0; i < 4; ++i) {
#if PALPATE_LANES == 4
    rows[i] = load(table + 4 * std::ptrdiff_t{at[i]});
#else
    const auto row = [&](int lane) { return _mm_loadu_ps(table + 4 * std::ptrdiff_t{at[lane]}); };
    const auto two = [&](int lane) {
      return _mm256_insertf128_ps(_mm256_castps128_ps256(row(lane)), row(lane + 4), 1);
    };
#if PALPATE_LANES == 8
    rows[i] = reinterpret_cast<VecF>(two(i));
#else
    rows[i] =
        reinterpret_cast<VecF>(_mm512_insertf32x8(_mm512_castps256_ps512(two(i)), two(i + 8), 1));
#endif
#endif
  }
  transpose_fours(rows, columns);
}

/// Writes the lanes whose bit is set to consecutive places; may also write up to kLanes values in
/// all.
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
  for (; bits != 0; bits &= bits - 1) *to++ = v[__builtin_ctz(bits)];
#endif
}

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
