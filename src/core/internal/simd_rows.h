// Rows of numbers in memory, one for each lane, as vectors of their columns, and back: pairs,
// threes and fours. Whole rows are loaded and transposed in registers, which is faster than
// gathering each column. Included only by kernel files, as simd.h.
#pragma once

#include <cstddef>

#include "src/core/internal/simd.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

/// Pairs of numbers that follow each other in memory, one for each lane, as two columns.
struct Pairs {
  VecF first, second;
};
/// Separates pairs into their first and their second numbers. `left` holds the pairs of the first
/// half of the lanes, `right` those of the second half, as they lie in memory.
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

/// Writes four vectors as a row of four numbers for each lane; the row of lane i begins at
/// to[stride * i].
inline void store_fours(float* to, std::ptrdiff_t stride, const VecF (&columns)[4]) {
  VecF rows[4];
  transpose_fours(columns, rows);
  for (int i = 0; i < kLanes; ++i) {
    std::memcpy(to + stride * i, reinterpret_cast<const float*>(&rows[i % 4]) + i / 4 * 4,
                4 * sizeof(float));
  }
}

/// Reads numbers k = 0, 1, 2 from table[index[i]] on, for each lane i, into columns[k]; the number
/// behind them is read, too.
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

/// Reads numbers k = 0 ... 5 from table[2 * index[i]] on, for each lane i, into columns[k]; eight
/// may be read.
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

/// Reads numbers k = 0 ... 3 from table[4 * index[i]] on, for each lane i, into columns[k].
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

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
