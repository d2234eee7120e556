// Patches of a surface against the closed form of a disc in white noise, whatever their size and
// number behind each other.
#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "src/contact/noise/noise_sums.h"
#include "src/core/internal/select_isa.h"

namespace palpate {
namespace {

constexpr double kDepth = 0.6, kFocal = 300, kSd = 0.0005;  // m, pixels, m
constexpr double kPixel = kDepth / kFocal;                  // m

/// Square patches of `side` pixels that face the camera and tile a disc, in layers.
std::vector<NoisePatch> disc(double radius, double side, int num_layers) {
  std::vector<NoisePatch> patches;
  for (int layer = 0; layer < num_layers; ++layer) {
    for (double y = -radius; y < radius; y += side) {
      for (double x = -radius; x < radius; x += side) {
        if (std::hypot(x + side / 2, y + side / 2) > radius) continue;
        const double u = x + side / 2 + 7.3, v = y + side / 2 - 3.1;
        const double area = side * side * kPixel * kPixel / num_layers;
        NoisePatch patch{};
        patch.disc = patch.weight = static_cast<float>(area);
        patch.n[2] = static_cast<float>(-area);
        patch.u = static_cast<float>(area * u);
        patch.v = static_cast<float>(area * v);
        patch.square = static_cast<float>(area * (u * u + v * v + side * side / 6));
        patch.depth = static_cast<float>(area * kDepth);
        patch.at_u = static_cast<float>(u);
        patch.at_v = static_cast<float>(v);
        patches.push_back(patch);
      }
    }
  }
  return patches;
}

MeasureNoise noise_of(const std::vector<NoisePatch>& patches, const FrameNoise& noise, Isa isa) {
  const std::size_t size = NoisePatches::kPerGroup;
  const std::size_t num_groups = (patches.size() + size - 1) / size;
  NoiseMemory memory(static_cast<int>(num_groups), isa);
  const NoisePatches to = memory.patches();
  for (std::size_t group = 0; group < num_groups; ++group) {
    const std::size_t num = std::min(size, patches.size() - group * size);
    to.num[group] = static_cast<int>(num);
    std::copy_n(&patches[group * size], num, to.of_group(static_cast<int>(group)));
  }
  DepthFieldView field;
  field.noise = &noise;
  NoiseCamera camera{.fx = kFocal, .fy = kFocal, .cx = 159.5f, .cy = 119.5f};
  camera.p_WC[2] = static_cast<float>(kDepth);
  MeasureNoise result;
  memory.add(0, 1, camera, field, result);
  return result;
}

// Independent pixels move the volume by sd times the area of a pixel each, and the force along z by
// as much.
TEST(NoisePatches, OfADiscHaveItsClosedForm) {
  const FrameNoise noise = frame_noise({kSd, 0, 0});
  for (const double side : {4.0, 8.0, 12.0}) {
    for (const int num_layers : {1, 8}) {
      for (const double radius : {25.0, 50.0}) {
        const std::vector<NoisePatch> patches = disc(radius, side, num_layers);
        double area = 0;
        for (const NoisePatch& patch : patches) area += static_cast<double>(patch.disc);
        const double want = kSd * kPixel * std::sqrt(area);
        const MeasureNoise said = noise_of(patches, noise, Isa::baseline);
        // Splines blur the edge of the disc.
        EXPECT_NEAR(said.volume_std() / want, 0.96, 0.06) << side << " " << radius;
        EXPECT_NEAR(said.force_std().z, said.volume_std(), 1e-4 * want);
        for (const Isa isa : {Isa::avx2, Isa::avx512}) {
          if (isa > best_isa()) continue;
          const MeasureNoise wide = noise_of(patches, noise, isa);
          EXPECT_EQ(wide.volume, said.volume);
          EXPECT_EQ(wide.torque.m[0][1], said.torque.m[0][1]);
        }
      }
    }
  }
}

// Noise that the whole image shares moves all of a disc, by its area.
TEST(NoisePatches, OfNoiseThatTheWholeImageShares) {
  FrameNoise noise;
  noise.is_whole = true;
  noise.base[kNumNoiseLevels - 1] = static_cast<float>(kSd * std::sqrt(kDetailShare));
  const std::vector<NoisePatch> patches = disc(12, 4, 1);
  double area = 0;
  for (const NoisePatch& patch : patches) area += static_cast<double>(patch.disc);
  const double said = noise_of(patches, noise, Isa::baseline).volume_std();
  EXPECT_GT(said, 0.6 * kSd * area);
  EXPECT_LT(said, 1.05 * kSd * area);
}

}  // namespace
}  // namespace palpate
