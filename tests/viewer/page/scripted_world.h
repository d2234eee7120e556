// World of the browser tests, in which a test sets the state and place of everything, and hears the
// commands of the page.
#pragma once

#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "palpate/viewer/viewer.h"

namespace palpate {

/// Begins still and empty; `apply` changes it while pages look. Same input, same pictures.
class ScriptedWorld : public ViewSource {
 public:
  using Json = nlohmann::json;

  /// `script`: {"kind", "title", "spheres": [[x, y, z, r], ...], "shape": {"name", "size"},
  /// "stream": {"width", "height", "focal"} or null, "cameras": [[x, y, z, qx, qy, qz, qw], ...]
  /// where that many such cameras are (one at the origin if it is left out), "controls": [...]}.
  /// `heard` gets every command of a page. Error: the tool cannot be built.
  static Result<std::unique_ptr<ScriptedWorld>> create(const Json& script,
                                                       std::function<void(std::string_view)> heard);

  /// Any of: "contact" {"position", "quaternion", "states", "planes": [[x, y, z, d] per sphere]},
  /// "unit" (m, of all frames from now on), "depth" [[first column, meters], ...] (0 m: no
  /// measurement) of all cameras, or "depths" of each, "cameras" as at first, "sample" {"force",
  /// "torque", "contact_force", "contact_torque", "volume", "hand": position}, "state" {members
  /// that replace those of `state`}, "frozen" (nothing new is seen), "moving" (tool and wall go to
  /// and fro).
  void apply(const Json& change);

  const ViewContent& content() const override { return content_; }
  ViewUpdate poll(const ViewSubscription& subscription) override;
  std::string state() override;
  std::string controls() override;
  Result<std::string> command(std::string_view json) override;

 private:
  ScriptedWorld(const Json& script, Tool tool, std::function<void(std::string_view)> heard);

  void place(const Json& cameras);
  Pose tool_pose(double time) const;
  std::shared_ptr<const ViewFrame> make_frame(std::size_t camera) const;
  std::shared_ptr<const ViewContact> make_contact() const;
  std::shared_ptr<const ViewSurface> make_surface() const;
  ViewSample make_sample(double time) const;
  /// Meters at each column, of the frame that is shown now.
  std::vector<double> depths(std::size_t camera) const;
  Result<std::string> set(const Json& command);
  Json current_state() const;

  const Tool tool_;
  const std::function<void(std::string_view)> received_;
  ViewContent content_;

  std::mutex mutex_;  // guards all below: tests change what the server reads
  Json controls_, state_ = Json::object();
  std::vector<Pose> X_WC_;    // of each camera
  std::vector<Json> depths_;  // likewise
  Json sample_ = Json::object();
  std::optional<ViewContact> contact_;
  bool is_frozen_ = false, is_moving_ = false, is_paused_ = false;
  std::uint64_t num_polls_ = 0, num_ticks_ = 0, frame_number_ = 0, num_contacts_ = 0;
  int revision_ = 0;
  double time_ = 0, speed_ = 1, unit_ = 0.001;
  Json marks_ = Json::array();
};

}  // namespace palpate
