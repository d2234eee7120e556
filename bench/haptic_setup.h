// Scenes and tools of a simulated hand.
#pragma once

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/mesh/mesh.h"
#include "palpate/packing/packing.h"
#include "palpate/tool/tool.h"
#include "scenes/scene.h"

namespace palpate::bench {

/// Packs the tool of a scene.
inline Result<Tool> tool_for(const scenes::Scene& scene, int num_spheres) {
  auto mesh = make_shape(scene.tool_shape, scene.tool_size);
  if (!mesh) return mesh.error();
  return Tool::pack(*std::move(mesh), {.max_spheres = num_spheres}, {.source = scene.tool_shape});
}

/// Renders all frames of a scene.
inline Result<std::vector<DepthFrame>> frames_of(const scenes::Scene& scene,
                                                 const scenes::SimulatedCameraOptions& camera,
                                                 DepthStreamInfo& info) {
  auto source = scenes::open_simulated_camera(scene, camera);
  if (!source) return source.error();
  info = (*source)->info();
  std::vector<DepthFrame> frames;
  for (DepthFrame frame;;) {
    const auto got = (*source)->next(frame);
    if (!got) return got.error();
    if (!*got) return frames;
    frames.push_back(frame);
  }
}

/// A camera without cost during measurements: plays its frames back and forth, endlessly.
class LoopedSource final : public DepthSource {
 public:
  LoopedSource(DepthStreamInfo info, std::vector<DepthFrame> frames)
      : info_(std::move(info)), frames_(std::move(frames)) {
    info_.num_frames.reset();
  }
  const DepthStreamInfo& info() const override { return info_; }
  Result<bool> next(DepthFrame& frame) override {
    const std::size_t num = frames_.size(), turn = number_ % (2 * num);
    frame = frames_[turn < num ? turn : 2 * num - 1 - turn];
    frame.timestamp = static_cast<double>(number_++) / info_.rate;
    return true;
  }

 private:
  DepthStreamInfo info_;
  std::vector<DepthFrame> frames_;
  std::size_t number_ = 0;
};

}  // namespace palpate::bench
