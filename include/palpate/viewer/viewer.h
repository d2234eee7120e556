// What a browser shows of a run, a recording or a tool, and the server it gets that from.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/contact/contact.h"
#include "palpate/core/core.h"
#include "palpate/haptics/device.h"
#include "palpate/math/geometry.h"
#include "palpate/run/run_loop.h"
#include "palpate/session/run.h"
#include "palpate/tool/tool.h"

namespace palpate::inline v0 {

// What a browser page shows: a live run, a recording, or a tool alone (thesis section 4.4).

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
  SpherePicture spheres;
  std::vector<Pose> objects = {};  ///< X_WB of each of the content's
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

// The things to look at.

/// A tool alone.
std::unique_ptr<ViewSource> view_tool(const Tool& tool, std::string title);

/// A recording, played, paused and searched by commands; the settings of its queries
/// can be changed to see what would have been. What is damaged is shown as far as it goes. Errors:
/// there is no recording, or nothing of it can be read.
Result<std::unique_ptr<ViewSource>> view_run(const std::filesystem::path& folder);

/// A run that goes on, live or on a simulated clock. What it hears from the publishing thread it
/// copies and goes; the server waits for the loop where a command does, and the haptic thread for
/// nobody.
class LiveView : public ViewSource {
 public:
  /// `tool` must outlive it; `streams` are those of the run's cameras. With the `handle` of the
  /// run's device, pages can hold the tool. `objects`: those of the run's settings.
  static std::unique_ptr<LiveView> create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                          std::string title,
                                          std::shared_ptr<PageHandle> handle = nullptr,
                                          std::vector<SceneObject> objects = {});
  static std::unique_ptr<LiveView> create(const Tool&&, std::vector<DepthStreamInfo>, std::string,
                                          std::shared_ptr<PageHandle> = nullptr,
                                          std::vector<SceneObject> = {}) = delete;
  /// For record_run. Without a recording: its `observer` for the loop, and `on_loop` when
  /// the loop has started and before it is stopped; the latter waits for a command that is using
  /// it.
  virtual RunMonitor& monitor() = 0;
  /// A command has asked to end the run.
  virtual bool wants_end() const noexcept = 0;
};

// The page in a browser: HTTP and WebSocket on one port, from a thread of its own.

struct ViewServerOptions {
  /// Where to listen. Anything but a loopback address (127.0.0.0/8, ::1, localhost) needs a token,
  /// which is made if there is none.
  std::string address = "127.0.0.1";
  std::uint16_t port = 8787;  ///< 0: any free one
  std::string token = {};     ///< 16 to 128 letters, digits, - and _; empty: none on loopback
  int max_pages = 8;          ///< at a time
  /// What the options port, address and token begin with where a user gives them: for messages.
  std::string option_prefix = "--view-";
};

/// Serves until it is destroyed. Pages can neither slow nor block whom they look at: the server
/// asks the source at its own pace, a page gets the next picture when it has drawn the last one,
/// and what it missed meanwhile is left out. Requests whose Host or Origin is not the server's own
/// are refused, so that no other web page can read along or command.
class ViewServer {
 public:
  /// `source` must outlive it. Errors: the address cannot be used (port taken, not allowed), a bad
  /// token; what to do. A build without the page serves scripts, and a page that says so.
  static Result<std::unique_ptr<ViewServer>> start(ViewSource& source,
                                                   const ViewServerOptions& options = {});
  virtual ~ViewServer() = default;

  /// To open in a browser, with the token if there is one.
  virtual std::string url() const = 0;
  virtual int num_pages() const noexcept = 0;
};

}  // namespace palpate::inline v0
