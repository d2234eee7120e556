// What a browser page shows: a live run, a recording, or a tool alone (thesis section 4.4).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/contact/contact_query.h"
#include "palpate/core/result.h"
#include "palpate/math/pose.h"
#include "palpate/run/pictures.h"
#include "palpate/tool/tool.h"

namespace palpate {

/// What stays the same while it is looked at.
struct ViewContent {
  std::string kind;   ///< "live", "recording" or "tool"
  std::string title;  ///< for humans, e.g. the file or device
  const Tool* tool = nullptr;
  std::vector<DepthStreamInfo> streams = {};  ///< of each camera; none: there is no scene
  /// N, the most that a page can feel that holds the tool; none: pages cannot hold it.
  std::optional<double> handle_force = std::nullopt;
  std::vector<std::shared_ptr<const Tool>> objects = {};  ///< beside what the cameras see
};

/// The depth image of a camera that is felt now, raw; with where the camera was.
struct ViewFrame {
  std::uint64_t number = 0;
  double time = 0;  ///< s since the run began
  DepthFrame frame;
  std::size_t camera = 0;  ///< index of its stream
};

/// The tool, and how each of its spheres is.
struct ViewContact {
  double time = 0;  ///< s since the run began
  std::uint64_t frame_number = 0;
  Pose X_WT;
  std::vector<SphereState> states;
  std::vector<Plane<float>> planes;  ///< in the tool frame; normal 0: none
  std::vector<Pose> objects = {};    ///< X_WB of each of the content's
};

/// Points of the first camera's surface with their normals and depth-change vectors, in its frame.
using ViewSurface = SurfacePicture;

/// One tick.
struct ViewSample {
  double time = 0;             ///< s since the run began
  Wrench F_H_B;                ///< to the hand, in the device's base; without a hand as contact_W
  Wrench contact_W;            ///< on the tool, about its centre of mass
  double volume = 0;           ///< m3
  double compute_seconds = 0;  ///< of the tick, or of the query where there is no device
  double contact_age = 0, sensor_age = 0;  ///< s
  double stretch = 0;                      ///< m, between hand and tool
  double gain = 0, energy = 0;             ///< of the safety filter; J given to the hand
  Pose X_WT, X_WT_hand;                    ///< simulated tool; where the hand holds it
};

/// All that is new since the last poll; newest wins, of frames that of each camera, but samples are
/// all there.
struct ViewUpdate {
  std::vector<std::shared_ptr<const ViewFrame>> frames;  ///< at most one of each camera
  std::shared_ptr<const ViewContact> contact;
  std::shared_ptr<const ViewSurface> surface;
  std::vector<ViewSample> samples;
};

/// What some page wants to see, beside the tool: what nobody wants is not made.
struct ViewWishes {
  bool frames = false, contacts = false, surfaces = false, samples = false;
};

/// Where the server gets from what it shows. All calls come from its one thread.
class ViewSource {
 public:
  virtual ~ViewSource() = default;

  virtual const ViewContent& content() const = 0;
  /// Some sixty times a second; must not wait. Parts that are not wished for stay empty.
  virtual void poll(const ViewWishes& wishes, ViewUpdate& update) = 0;
  /// What does not fit into numbers, as a JSON object: see docs/viewer-protocol.md, `state`. A few
  /// times a second.
  virtual std::string state() = 0;
  /// The settings that a person may turn, as a JSON array: see there, `controls`.
  virtual std::string controls() = 0;
  /// A command with its JSON object, e.g. {"command": "set", "key": "contact.method", "value":
  /// "graph"}; may take a few milliseconds. The answer is a JSON object, {} if there is nothing to
  /// say. Errors: no such command, what is wrong with it.
  virtual Result<std::string> command(std::string_view json) = 0;

  // A page as the hand, by a number that is no other page's: see PageHandle.

  virtual Status hold(std::uint64_t page);
  /// `X_WT` as the page would have the tool.
  virtual Status move(std::uint64_t page, const Pose& X_WT);
  /// Also of a page that has gone.
  virtual void let_go(std::uint64_t page);
};

}  // namespace palpate
