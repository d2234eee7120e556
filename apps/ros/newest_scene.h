// The newest surfaces of several cameras, each of which a thread keeps.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "apps/touch/touch.h"
#include "palpate/contact/scene.h"
#include "palpate/field/sensor.h"

namespace palpate::apps {

class NewestScene {
 public:
  /// Ends the threads.
  ~NewestScene();

  /// Opens the cameras of the options, without what the filter removes, and begins to follow them.
  /// Errors: those of the cameras.
  Status open(const TouchOptions& touch, const SelfFilter& filter);

  /// Frame id of the images of the first camera.
  const std::string& frame() const { return cameras_.front().source->info().frame; }

  /// Calls `measure`, while the surfaces stay, with those of all cameras, or none as long as one
  /// has sent no image; when the oldest image was captured, s; and why a camera has ended, or
  /// empty.
  void with_newest(const std::function<void(const Scene& scene, double captured,
                                            const std::string& ending)>& measure);

  /// Prints what cameras have to say.
  void print_notes();

 private:
  struct Camera {
    std::unique_ptr<DepthSource> source;
    Sensor sensor;
    std::thread thread = {};
    std::optional<SurfaceView> surface = {};
    double captured = 0;      // s, monotonic
    std::string ending = {};  // why there are no more images; empty: there are
  };
  void follow(Camera& camera);
  void end(Camera& camera, const std::string& why);

  std::mutex mutex_;  // guards what threads of cameras write
  std::vector<Camera> cameras_;
};

}  // namespace palpate::apps
