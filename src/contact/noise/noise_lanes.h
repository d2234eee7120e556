// Adds up what vectors of elements tell of the noise to patches (noise_patch.h). Included by kernel
// files only.
#pragma once

#include "src/contact/field/field_answers.h"
#include "src/contact/noise/noise_patch.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

/// Places of a vector of elements in the cameras that decide them.
struct NoisePlace {
  VecF u, v;  // pixels from the principal point
  VecF depth, inverse_depth;
  VecF pixels;  // of a meter
  VecF ray[3];  // from the eye, with a depth of 1, in W
  VecI camera;
};

/// Returns the places in a camera whose axes are those of W.
[[gnu::always_inline]] inline NoisePlace noise_place(const FieldFrame& frame, const Lanes& e,
                                                     int camera) {
  return {e.from_u,
          e.from_v,
          e.depth,
          e.inverse_depth,
          frame.fx * e.inverse_depth,
          {e.from_u * (1.0f / frame.fx), e.from_v * (1.0f / frame.fy), splat(1.0f)},
          splat(camera)};
}
/// Returns the places in a camera whose frame has the rotation R_WC.
[[gnu::always_inline]] inline NoisePlace noise_place(const FieldFrame& frame, const Lanes& e,
                                                     int camera, const float (&R_WC)[3][3]) {
  NoisePlace at = noise_place(frame, e, camera);
  const VecF x = at.ray[0], y = at.ray[1];
  for (int axis = 0; axis < 3; ++axis) {
    at.ray[axis] = R_WC[axis][0] * x + R_WC[axis][1] * y + R_WC[axis][2];
  }
  return at;
}

[[gnu::always_inline]] inline NoisePlace chosen(VecI which, const NoisePlace& a,
                                                const NoisePlace& b) {
  return {select(which, a.u, b.u),
          select(which, a.v, b.v),
          select(which, a.depth, b.depth),
          select(which, a.inverse_depth, b.inverse_depth),
          select(which, a.pixels, b.pixels),
          {select(which, a.ray[0], b.ray[0]), select(which, a.ray[1], b.ray[1]),
           select(which, a.ray[2], b.ray[2])},
          which ? a.camera : b.camera};
}

/// Sums of one cluster by one camera, sixteen elements beside each other.
struct NoiseLanes {
  VecF lanes[kNumNoiseSums][RowSums::kParts];
};

/// Adds the sixteen lanes of sixteen sums, halves first: the same bits for any width of vectors.
inline void add_lanes(const NoiseLanes& sums, float (&totals)[kNumNoiseSums]) {
  typedef float Row __attribute__((vector_size(64)));
  Row rows[kNumNoiseSums];
  std::memcpy(rows, sums.lanes, sizeof rows);
  for (int k = 0; k < 8; ++k) {
    rows[k] = __builtin_shufflevector(rows[k], rows[k + 8], 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19,
                                      20, 21, 22, 23) +
              __builtin_shufflevector(rows[k], rows[k + 8], 8, 9, 10, 11, 12, 13, 14, 15, 24, 25,
                                      26, 27, 28, 29, 30, 31);
  }
  for (int k = 0; k < 4; ++k) {
    rows[k] = __builtin_shufflevector(rows[k], rows[k + 4], 0, 1, 2, 3, 16, 17, 18, 19, 8, 9, 10,
                                      11, 24, 25, 26, 27) +
              __builtin_shufflevector(rows[k], rows[k + 4], 4, 5, 6, 7, 20, 21, 22, 23, 12, 13, 14,
                                      15, 28, 29, 30, 31);
  }
  for (int k = 0; k < 2; ++k) {
    rows[k] = __builtin_shufflevector(rows[k], rows[k + 2], 0, 1, 16, 17, 4, 5, 20, 21, 8, 9, 24,
                                      25, 12, 13, 28, 29) +
              __builtin_shufflevector(rows[k], rows[k + 2], 2, 3, 18, 19, 6, 7, 22, 23, 10, 11, 26,
                                      27, 14, 15, 30, 31);
  }
  rows[0] = __builtin_shufflevector(rows[0], rows[1], 0, 16, 2, 18, 4, 20, 6, 22, 8, 24, 10, 26, 12,
                                    28, 14, 30) +
            __builtin_shufflevector(rows[0], rows[1], 1, 17, 3, 19, 5, 21, 7, 23, 9, 25, 11, 27, 13,
                                    29, 15, 31);
  // Lane 8 a + 4 b + 2 c + d is sum 8 a + 4 b + 2 c + d.
  std::memcpy(totals, &rows[0], sizeof totals);
}

/// Adds up the patches of one group. `sums`: one for each camera.
class NoiseWriter {
 public:
  NoiseWriter(const NoisePatches& to, int group, NoiseLanes* sums)
      : to_(to), group_(group), sums_(sums) {}

  bool wants() const { return to_.num != nullptr; }

  /// Adds a vector of elements of the current cluster. Those that do not touch have no volume and
  /// no disc, the decrease of the volume by the field.
  template <class Element>
  [[gnu::always_inline]] void add(int part, const Element& e, const NoisePlace& at, VecF volume,
                                  VecF disc, const Gradient3<VecF>& n) {
    const VecF extent = 0.4f * e.radius * e.radius;  // of a ball: about an axis
    VecF numbers[kNumUsed];
    set_numbers(at, volume, disc, n, e.radius, extent, numbers);
    if (to_.num_cameras == 1) return add(0, part, numbers);
    for (VecI left = at.camera >= VecI{}; mask_bits(left) != 0;) {
      const int camera = at.camera[__builtin_ctz(mask_bits(left))];
      const VecI mine = at.camera == splat(camera);
      VecF own[kNumUsed];
      for (int k = 0; k < kNumUsed; ++k) own[k] = select(mine, numbers[k], VecF{});
      add(camera, part, own);
      left &= ~mine;
    }
  }

  /// Makes patches of the sums, and begins with the next cluster.
  void finish_cluster() {
    for (; used_ != 0; used_ &= used_ - 1) {
      const int camera = __builtin_ctz(used_);
      float totals[kNumNoiseSums];
      add_lanes(sums_[camera], totals);
      put(totals, camera);
    }
  }

  /// Adds balls that stand for a cluster each; those that do not count have no volume. `polar`:
  /// their second moments about an axis, m5.
  void add_wholes(const VecF& radius, const NoisePlace& at, VecF volume, VecF all, VecF polar,
                  const Gradient3<VecF>& n) {
    VecF numbers[kNumUsed];
    set_numbers(at, volume, VecF{}, n, radius, polar / all, numbers);
    float lanes[kNumUsed][kLanes];
    for (int k = 0; k < kNumUsed; ++k) store(lanes[k], numbers[k]);
    for (std::uint32_t bits = mask_bits(volume > VecF{}); bits != 0; bits &= bits - 1) {
      const int lane = __builtin_ctz(bits);
      float totals[kNumNoiseSums] = {};
      for (int k = 0; k < kNumUsed; ++k) totals[k] = lanes[k][lane];
      put(totals, at.camera[lane]);
    }
  }

  void finish() const {
    if (wants()) to_.num[group_] = num_;
  }

 private:
  static constexpr int kNumUsed = 10;  // of a patch: sums

  /// Writes the sums' numbers in the order of a NoisePatch.
  [[gnu::always_inline]] static void set_numbers(const NoisePlace& at, VecF volume, VecF disc,
                                                 const Gradient3<VecF>& n, VecF radius, VecF extent,
                                                 VecF (&to)[kNumUsed]) {
    constexpr float comparable = 0.25f;  // disc of a ball, over its volume by its radius
    const VecF along = n.x * at.ray[0] + n.y * at.ray[1] + n.z * at.ray[2];
    const VecF swept = -along * volume, own = along * disc;
    const VecF weight = abs(own) + comparable * abs(swept) / radius;
    to[0] = own;
    to[1] = swept * at.inverse_depth;
    to[2] = weight;
    to[3] = weight * n.x;
    to[4] = weight * n.y;
    to[5] = weight * n.z;
    to[6] = weight * at.u;
    to[7] = weight * at.v;
    to[8] = weight * (at.u * at.u + at.v * at.v + extent * at.pixels * at.pixels);
    to[9] = weight * at.depth;
  }

  [[gnu::always_inline]] void add(int camera, int part, const VecF (&numbers)[kNumUsed]) {
    NoiseLanes& sums = sums_[camera];
    if ((used_ >> camera & 1) == 0) {
      used_ |= 1u << camera;
      sums = NoiseLanes{};
    }
    for (int k = 0; k < kNumUsed; ++k) sums.lanes[k][part] += numbers[k];
  }

  void put(const float (&totals)[kNumNoiseSums], int camera) {
    NoisePatch& patch = to_.of_group(group_)[num_];
    std::memcpy(&patch, totals, sizeof patch);
    if (!(patch.weight > 1e-30f)) return;
    const float share = 1.0f / patch.weight;
    patch.at_u = patch.u * share;
    patch.at_v = patch.v * share;
    patch.camera = static_cast<float>(camera);
    ++num_;
  }

  NoisePatches to_;
  int group_ = 0, num_ = 0;
  NoiseLanes* sums_;
  std::uint32_t used_ = 0;  // cameras with sums
};

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
