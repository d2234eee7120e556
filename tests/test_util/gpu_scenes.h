// Tools in scenes on GPU 0, or by the emulator in a build without CUDA.
#pragma once

#include <cstddef>
#include <span>

#include "src/contact/scene/scene_makers.h"

namespace palpate::test {

/// `kAtOnce`: poses in a launch.
template <std::size_t kAtOnce = std::size_t{1} << 15>
SceneContact scenes_on_gpu(std::span<const Tool* const> tools) {
  return SceneContactMaker::make(tools, FieldMethod{}, Place::cuda(0), 1, cuda_makers<kAtOnce>())
      .value();
}

}  // namespace palpate::test
