// Cases of the batch tests: scenes with their fields, poses in them, and arrays for answers.
#pragma once

#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "palpate/contact/contact.h"
#include "tests/test_util/contact_scenes.h"
#include "tests/test_util/frozen_field.h"

namespace palpate::test {

inline std::vector<FrozenField> batch_scenes() {
  constexpr int kWidth = 96, kHeight = 72;
  const auto block = [](std::uint64_t seed) {
    return stepped_wall(kWidth, kHeight, 84, 0.6, 0.12, 0.002, seed,
                        [](int u, int v) { return u > 30 && u < 60 && v > 24 && v < 51; })
        .cloud;
  };
  std::vector<FrozenField> all;
  all.emplace_back(noisy_wall(kWidth, kHeight, 84, 0.6, 0.002, 1));
  all.emplace_back(block(2));
  all.emplace_back(noisy_wall(64, 64, 60, 0.62, 0.002, 3),
                   DepthFieldOptions{.unknown = UnknownSpace::solid});
  all.emplace_back(block(4), DepthFieldOptions{.unseen = UnseenSpace::free, .thickness = 0.03});
  return all;
}
inline std::vector<SurfaceView> surfaces_of(const std::vector<FrozenField>& scenes) {
  std::vector<SurfaceView> surfaces;
  for (const FrozenField& scene : scenes) surfaces.push_back({{}, scene.field.view()});
  return surfaces;
}

/// In free space, in contact, deep inside, out of view, behind the camera.
inline Pose batch_pose(Random& random) {
  const double x = random.uniform(-0.25, 0.25), y = random.uniform(-0.2, 0.2);
  return {{x, y, random.uniform(0.3, 0.8)}, random.rotation(3.0)};
}

/// Poses with the numbers of their surfaces.
struct PoseArgument {
  std::vector<Pose> X_WT;
  std::vector<std::int32_t> surface;

  PoseArgument() = default;
  PoseArgument(int num, int num_surfaces, std::uint64_t seed) {
    Random random(seed);
    for (int i = 0; i < num; ++i) {
      X_WT.push_back(batch_pose(random));
      surface.push_back(
          static_cast<std::int32_t>(random.bits() % static_cast<std::uint64_t>(num_surfaces)));
    }
  }
  PoseBatch batch() const { return {X_WT, surface, {}}; }
};

/// Answers for `num` poses, preset to invalid values.
struct Answers {
  std::vector<double> volume, potential, force, torque, stiffness;
  std::vector<std::uint32_t> status;

  explicit Answers(std::size_t num) {
    for (std::vector<double>* values : {&volume, &potential}) values->assign(num, -7);
    for (std::vector<double>* values : {&force, &torque}) values->assign(3 * num, -7);
    stiffness.assign(36 * num, -7);
    status.assign(num, 77);
  }
  BatchAnswers all() {
    return {volume.data(), potential.data(), force.data(),
            torque.data(), stiffness.data(), status.data()};
  }
  BatchAnswers without_stiffness() {
    BatchAnswers answers = all();
    answers.stiffness = nullptr;
    return answers;
  }
  Vec3d force_of(std::size_t i) const { return {force[3 * i], force[3 * i + 1], force[3 * i + 2]}; }
  Vec3d torque_of(std::size_t i) const {
    return {torque[3 * i], torque[3 * i + 1], torque[3 * i + 2]};
  }
  /// Pose i here and pose k there are answered by the same bits.
  bool is_same(std::size_t i, const Answers& other, std::size_t k, bool with_stiffness) const {
    const auto same = [&](const std::vector<double>& a, const std::vector<double>& b,
                          std::size_t num) {
      return std::memcmp(a.data() + num * i, b.data() + num * k, num * sizeof(double)) == 0;
    };
    return same(volume, other.volume, 1) && same(potential, other.potential, 1) &&
           same(force, other.force, 3) && same(torque, other.torque, 3) &&
           (!with_stiffness || same(stiffness, other.stiffness, 36)) &&
           status[i] == other.status[k];
  }
};

}  // namespace palpate::test
