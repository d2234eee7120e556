// Checks of the options of palpate touch that make no sense without, or beside, another one: each
// ends in wrong usage with the option to add or to leave out.
#include <algorithm>
#include <string>

#include "apps/touch/touch.h"

namespace palpate::apps {
namespace {

bool is_aimed(const ProbeAim& aim) { return aim.pixel || aim.point_W || aim.tip_T; }

}  // namespace

void check_view(const CLI::App& app, const TouchOptions& options) {
  for (const char* option : {"--view-port", "--view-address", "--view-token", "--view-open"}) {
    if (app.count(option) > 0 && !options.has_page) {
      usage_error(std::string("touch: ") + option + " goes with --view");
    }
  }
}

void check_motion(const CLI::App& app, const TouchOptions& options) {
  if ((!options.path.empty() || options.is_replay()) && is_aimed(options.aim)) {
    usage_error(
        "touch: --probe and --tip do not go with a path, which says where the tool moves: leave "
        "one of them out");
  }
  if (options.device.empty() && app.count("--dead-man") > 0) {
    usage_error("touch: --dead-man goes with --device");
  }
  const bool has_file = !options.path.empty() || options.is_replay();
  for (const char* const of_path : {"--path-frame", "--align"}) {
    if (app.count(of_path) == 0 || has_file) continue;
    usage_error(std::string("touch: ") + of_path + " goes with --path or --device replay:FILE");
  }
  const std::string& frame = options.frames.path;
  if (options.device.empty() && !options.frames.base.empty() && frame != "base" &&
      frame != "device" && options.frames.wrench != "device") {
    usage_error("touch: --base-frame goes with --device, or with poses in the frame of one");
  }
  const DepthAverage average = options.settings.time.average.kind;
  if (app.count("--average-frames") > 0 && average != DepthAverage::moving) {
    usage_error("touch: --average-frames goes with --average moving");
  }
  if (app.count("--average-weight") > 0 && average != DepthAverage::exponential) {
    usage_error("touch: --average-weight goes with --average exponential");
  }
  if (options.device == "replay:") {
    usage_error("--device replay: needs a file of poses: replay:FILE");
  }
  for (const char* const of_memory :
       {"--memory-horizon", "--memory-thickness", "--memory-frames"}) {
    if (app.count(of_memory) == 0) continue;
    if (options.settings.time.memory.kind != DepthMemory::off) break;
    usage_error(std::string("touch: ") + of_memory + " goes with --memory on");
  }
  if (!options.device.empty() && !options.path.empty()) {
    usage_error(
        "touch: --path and --device exclude each other; to play a path in real time use --device "
        "replay:FILE");
  }
}

void check_feel(const CLI::App& app, const TouchOptions& options) {
  const bool has_friction = options.settings.coupling.friction.coefficient > 0 ||
                            !options.materials.materials.empty() ||
                            std::ranges::any_of(options.objects, [](const ObjectOption& object) {
                              return object.friction.value_or(0) > 0;
                            });
  if (app.count("--texture") > 0 && options.settings.coupling.texture.kind != TextureKind::none &&
      !has_friction) {
    usage_error("touch: --texture goes with friction: add --friction 0.3");
  }
  for (const CLI::Option* const option : app.get_options()) {
    if (option->get_group() != "ROS 2" || option->count() == 0) continue;
    if (options.ros.is_requested || options.is_robot()) continue;
    usage_error("touch: " + option->get_name() + " goes with --ros2");
  }
}

void check_method(const TouchOptions& options) {
  if (const auto method = contact_method(options.settings.contact); !method) {
    usage_error("--" + method.error().message);
  }
}

}  // namespace palpate::apps
