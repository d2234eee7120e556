// Scenes on a GPU: their answers in host memory, and the same contact on a CPU.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "src/contact/scene/scene_makers.h"
#include "tests/test_util/gpu_scenes.h"
#include "tests/test_util/hull_scenes.h"

namespace palpate::test {

/// Numbers of a pose that lay_out asks for.
inline constexpr std::size_t kNumNumbers = 1 + 1 + 3 + 3 + 36 + 1 + 1 + 6;

/// Lets the answers of `num` poses have their numbers from `at` on, one kind after the other.
inline void lay_out(SceneAnswers& answers, double* at, std::size_t num) {
  const auto take = [&](std::size_t each) { return std::exchange(at, at + each * num); };
  answers.contact = {.volume = take(1),
                     .potential = take(1),
                     .force = take(3),
                     .torque = take(3),
                     .stiffness = take(36)};
  answers.unseen = take(1);
  answers.clearance = take(1);
  answers.clearance_gradient = take(6);
}

/// All answers of P poses.
struct Answered {
  Answered(std::size_t num, std::size_t num_spheres, std::size_t num_groups)
      : numbers(num * kNumNumbers),
        status(num),
        nearest(num),
        decided(num),
        sphere_depth(num * num_spheres),
        sphere_decided(num * num_spheres),
        group_clearance(num_groups),
        group_volume(num_groups),
        group_pose(num_groups) {
    lay_out(answers, numbers.data(), num);
    answers.contact.status = status.data();
    answers.nearest = nearest.data();
    answers.decided = decided.data();
    answers.sphere_depth = sphere_depth.data();
    answers.sphere_decided = sphere_decided.data();
    answers.max_spheres = num_spheres;
    answers.group_clearance = group_clearance.data();
    answers.group_volume = group_volume.data();
    answers.group_pose = group_pose.data();
  }

  std::vector<double> numbers;
  std::vector<std::uint32_t> status;
  std::vector<std::int32_t> nearest, decided;
  std::vector<float> sphere_depth;
  std::vector<std::int8_t> sphere_decided;
  std::vector<double> group_clearance, group_volume;
  std::vector<std::int32_t> group_pose;
  SceneAnswers answers;
};

/// A contact on a CPU, and one on a GPU.
struct Both {
  explicit Both(std::span<const Tool* const> tools)
      : cpu(SceneContact::create(tools, FieldMethod{}, Place::cpu(), 1).value()),
        gpu(scenes_on_gpu(tools)) {}
  SceneContact cpu, gpu;
};

inline std::vector<SurfaceView> surfaces_of(const HullScene& scene) {
  std::vector<SurfaceView> surfaces;
  for (const SurfaceBlend& view : scene.views) surfaces.push_back(view.to);
  return surfaces;
}

}  // namespace palpate::test
