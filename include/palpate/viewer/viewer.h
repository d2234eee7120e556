// The viewer: data that a browser shows of a run, a recording or a tool, and its server.
#pragma once

#include <array>
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

namespace palpate { inline namespace v0 {

// Data of a browser page: a live run, a recording, or a tool alone (thesis section 4.4).

/// Constant data of a view.
struct ViewContent {
  std::string kind;   ///< "live", "recording" or "tool"
  std::string title;  ///< for display, e.g. the file or device
  const Tool* tool = nullptr;
  std::vector<DepthStreamInfo> streams = {};  ///< one per camera; empty: no scene
  /// N, maximum force of a page that holds the tool; none: pages cannot hold it.
  std::optional<double> handle_force = std::nullopt;
  std::vector<std::shared_ptr<const Tool>> objects = {};  ///< CAD objects
};

/// A raw depth image in use, with the pose of its camera.
struct ViewFrame {
  std::uint64_t number = 0;
  double time = 0;  ///< s since the start of the run
  DepthFrame frame;
  std::size_t camera = 0;  ///< index of its stream
};

/// Pose of the tool, and the state of each of its spheres.
struct ViewContact {
  double time = 0;  ///< s since the start of the run
  std::uint64_t frame_number = 0;
  Pose X_WT;
  SpherePicture spheres;
  std::vector<Pose> objects = {};  ///< X_WB of each object of the content
};

/// Points of the first camera's surface with their normals and depth-change vectors, in its frame.
using ViewSurface = SurfacePicture;

/// One tick.
struct ViewSample {
  double time = 0;             ///< s since the start of the run
  Wrench F_H_B;                ///< on the hand, in the device's base; without a hand as contact_W
  Wrench contact_W;            ///< on the tool, about its center of mass
  double volume = 0;           ///< m3
  double objects_volume = 0;   ///< m3, the share of CAD objects in it
  double compute_seconds = 0;  ///< of the tick, or of the query if there is no device
  double contact_age = 0, sensor_age = 0;  ///< s
  double stretch = 0;                      ///< m, coupling deflection
  double gain = 0, energy = 0;             ///< of the safety filter; J given to the hand
  Pose X_WT, X_WT_hand;                    ///< simulated tool; the hand's pose of the tool
  /// Covariance of contact_W's force: xx, xy, xz, yy, yz, zz in N2; zero: nobody asked for it.
  std::array<double, 6> force_covariance = {};
};

/// New data since the last poll: the newest frame of each camera, the newest contact and surface,
/// and all samples.
struct ViewUpdate {
  std::vector<std::shared_ptr<const ViewFrame>> frames;  ///< at most one per camera
  std::shared_ptr<const ViewContact> contact;
  std::shared_ptr<const ViewSurface> surface;
  std::vector<ViewSample> samples;
};

/// Subscriptions of all pages together: data without a subscriber is not computed.
struct ViewSubscription {
  bool frames = false, contacts = false, surfaces = false, samples = false;
};

/// Data source of the server. All calls come from its single thread.
class ViewSource {
 public:
  virtual ~ViewSource() = default;

  /// Returns the constant content: the tool, objects and streams.
  virtual const ViewContent& content() const = 0;
  /// Returns what is new of the parts in `subscription`. Called some sixty times per second; must
  /// not wait.
  virtual ViewUpdate poll(const ViewSubscription& subscription) = 0;
  /// The other state as a JSON object: see docs/viewer-protocol.md, `state`. Called a few times per
  /// second.
  virtual std::string state() = 0;
  /// The settings that a user may change, as a JSON array: see there, `controls`.
  virtual std::string controls() = 0;
  /// Executes a command given as a JSON object, e.g. {"command": "set", "key": "contact.method",
  /// "value": "graph"}; may take a few milliseconds. Returns a JSON object, {} if there is no
  /// result. Errors: unknown command, or what is wrong with it.
  virtual Result<std::string> command(std::string_view json) = 0;

  // A page as the hand, identified by a unique number: see PageHandle.

  virtual Status hold(std::uint64_t page);
  /// `X_WT`: the tool pose of the page.
  virtual Status move(std::uint64_t page, const Pose& X_WT);
  /// Also called for a page that has disconnected.
  virtual void release(std::uint64_t page);
};

// Data sources.

/// A tool alone.
std::unique_ptr<ViewSource> view_tool(const Tool& tool, std::string title);

/// A recording, with commands to play, pause and seek; changed settings show their effect on its
/// queries. A damaged recording is shown as far as it goes. Errors: there is no recording, or
/// nothing of it can be read.
Result<std::unique_ptr<ViewSource>> view_run(const std::filesystem::path& folder);

/// Options of a LiveView.
struct LiveViewOptions {
  /// The handle of the run's device: with it, pages can hold the tool.
  std::shared_ptr<PageHandle> handle = nullptr;
  std::vector<SceneObject> objects = {};  ///< those of the run's settings
};

/// A current run, live or on a simulated clock. It copies data from the publishing
/// thread. The server may wait for the loop during a command; the haptic thread waits for
/// nobody.
class LiveView : public ViewSource {
 public:
  /// Creates a view; `tool` must outlive it. `streams` are those of the run's cameras.
  static std::unique_ptr<LiveView> create(const Tool& tool, std::vector<DepthStreamInfo> streams,
                                          std::string title, LiveViewOptions options = {});
  static std::unique_ptr<LiveView> create(const Tool&&, std::vector<DepthStreamInfo>, std::string,
                                          LiveViewOptions = {}) = delete;
  /// For record_run. Without a recording: connect `observer` to the loop, and call `on_loop` when
  /// the loop has started and before it is stopped; this second call waits for a command that uses
  /// it.
  virtual RunMonitor& monitor() = 0;
  /// True after a command to end the run.
  virtual bool wants_end() const noexcept = 0;
};

// The server: HTTP and WebSocket on one port, in its own thread.

/// Options of the server: its address, token and limits.
struct ViewServerOptions {
  /// Address to listen on. Any address but loopback (127.0.0.0/8, ::1, localhost) needs a token,
  /// which is generated if there is none.
  std::string address = "127.0.0.1";
  std::uint16_t port = 8787;  ///< 0: any free port
  std::string token = {};     ///< 16 to 128 letters, digits, - and _; empty: none on loopback
  int max_pages = 8;          ///< at a time
};

/// Serves until it is destroyed. Pages cannot slow down or block the run: the server polls the
/// source at its own rate, and a page gets the next picture when it has drawn the last one;
/// pictures in between are dropped. Requests whose Host or Origin is not the server's own are
/// refused, so that no other web page can read or send commands.
class ViewServer {
 public:
  /// `source` must outlive it. Errors: an unusable address (port taken, not permitted), an invalid
  /// token; with what to do. A build without the page serves scripts, and a page that says so.
  static Result<std::unique_ptr<ViewServer>> start(ViewSource& source,
                                                   const ViewServerOptions& options = {});
  virtual ~ViewServer() = default;

  /// To open in a browser, including the token if there is one.
  virtual std::string url() const = 0;
  virtual int num_pages() const noexcept = 0;
};

}}  // namespace palpate::v0
