// Cameras by name, several of them in a rig, and one whose frames the program itself gives.
#pragma once

#include <array>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/core/core.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "palpate/settings/setting_table.h"

namespace palpate::inline v0 {

// The words that name a depth camera: KIND[:TARGET][?NAME=VALUE&...].

struct ImageSize {
  int width = 0, height = 0;

  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

/// What such a text says. Parameters win over what the stream says of itself:
///   intrinsics=fx,fy,cx,cy  distortion=k1,k2,p1,p2[,k3[,k4,k5,k6]]  size=WIDTHxHEIGHT
///   unit=METRES_PER_COUNT  rate=HZ  latency=SECONDS  sensor=KIND  crop=none|valid
///   pose=tx,ty,tz,qx,qy,qz,qw: X_WC; with poses, urdf or world: where the camera is in what these
///   tell of (hand-eye)  poses=FILE: of what moves, by time (TUM)  urdf=FILE#LINK[#BASE]: a link,
///   in the base or the root  joints=FILE.csv|bag:FILE|ros2:[/T]: who tells of joints in between
///   accelerometer=ax,ay,az: m/s2, as the camera at rest reads it, along its own axes
struct CameraUri {
  std::string text;          ///< as it was given, for humans
  std::string kind, target;  ///< "folder" and "frames/"
  std::optional<Intrinsics> intrinsics;
  std::optional<Distortion> distortion;
  std::optional<ImageSize> size;
  std::optional<double> unit, rate;
  std::optional<SensorKind> sensor;
  bool is_cropped = false;  ///< to the largest rectangle whose every pixel the lens can see
  double latency = 0;       ///< s, from the exposure to the time stamp
  Pose X_WC;                ///< of the camera in the world
  std::string poses;        ///< file, by time; empty: it stands still
  std::string urdf, joints;
  std::optional<Vec3d> accelerometer;
  std::map<std::string, std::string> extras;  ///< parameters that only some kinds know

  /// Error: an extra parameter other than these, which this kind knows.
  Status check_extras(std::initializer_list<std::string_view> known = {}) const;
};

/// Errors: a parameter that is not what it should be, with its name. Kinds are not checked here.
Result<CameraUri> parse_camera_uri(std::string_view text);
/// Error: cameras that are felt together are told in different worlds (`world=`).
Status check_one_world(std::span<const CameraUri> cameras);

// Finding and opening depth cameras by the words of the command line.

/// One kind of camera, and what of it can be used here.
struct FoundCameras {
  std::string kind;
  std::string usage;  ///< "folder:DIR"
  bool is_usable = false;
  std::string library, version;      ///< of the vendor, if there is one and it was found
  std::vector<std::string> devices;  ///< what to give to open_camera
  std::string reason;                ///< what it is, or every place that was tried and what to do
  /// Its devices are cameras that are plugged in and can be opened by their names alone.
  bool is_live = false;
};
/// Asks every kind; takes a few seconds at most. Never fails, starts no camera.
std::vector<FoundCameras> find_cameras();

struct CameraOpening {
  /// The run goes by the clock of this computer: frames that nobody took in time are left out.
  /// Else every frame counts that does not come from a device.
  bool in_real_time = true;
  std::optional<double> duration = {};  ///< s, of simulated ones; none: the scene's
};

/// A stream as surfaces are made of it: a pinhole image without distortion, whose size and
/// intrinsics stay the same even if the camera changes its own. Live cameras are read by a thread
/// of their own and come back when they were unplugged. Kinds: see `find_cameras`. Errors: no such
/// kind or target; the library of the vendor is missing, with every place that was tried; nothing
/// says what the intrinsics are.
Result<std::unique_ptr<DepthSource>> open_camera(std::string_view uri,
                                                 const CameraOpening& opening = {});
Result<std::unique_ptr<DepthSource>> open_camera(const CameraUri& uri,
                                                 const CameraOpening& opening = {});
/// X_WC of a camera that stands still, by its pose or URDF. None: it moves, or tf tells; who tells
/// of joints is not asked. Errors: of its files.
Result<std::optional<Pose>> standing_pose(const CameraUri& uri);
/// m/s2, in W, by the first camera that stands still and has an accelerometer. None: no such one.
std::optional<Vec3d> gravity_seen(std::span<const CameraUri> cameras);

// Several cameras in one file: where each of them is, and how it is opened.

/// A file, TOML:
///
///   [world]
///   frame = "table"          # of coordinates, as people call it
///   gravity = [0, 9.81, 0]   # m/s2, in W
///
///   [[camera]]
///   name = "front"
///   uri = "openni2"                          # as of open_camera
///   intrinsics = [525, 525, 319.5, 239.5]    # these win over the URI
///   distortion = [0.1, -0.2, 0, 0]
///   unit = 0.001
///   pose = [0, 0, 0, 0, 0, 0, 1]             # X_WC: tx ty tz qx qy qz qw
///   # or: pose_from = "front.tum"            # of a camera that moves, beside this file
///   # or: pose_from = "tf:front_optical"     # as the tf of a recording (bag:) tells of that frame
///   # or: pose_from = "urdf:cell.urdf#front_optical"    # a link, in the link that W is called
///   like # with pose, too: where the camera is in what these tell of (hand-eye) joints =
///   "joints.csv"                    # or bag:FILE: of joints that move it accelerometer = [0,
///   -9.81, 0]            # m/s2, of the camera at rest, along its axes
///
///   [frames]                                 # of yours, in W
///   bench = [1, 0, 0, 0, 0, 0, 1]            # or "urdf:cell.urdf#bench"
struct CameraRig {
  struct Camera {
    std::string name;
    CameraUri uri;
  };
  std::string frame = "world";
  /// m/s2, in W; where the file does not say: by the first camera that stands still and has an
  /// accelerometer. None: nobody knows.
  std::optional<Vec3d> gravity;
  std::vector<Camera> cameras;
  std::map<std::string, Pose> frames;  ///< X_WF
};

/// Targets and files of poses that are relative are beside the rig's file. Errors: no such file,
/// not TOML, a key that is not known or has another kind of value, two cameras of one name, no
/// camera or more than kMostCameras; all with the file, and the camera.
Result<CameraRig> load_rig(const std::filesystem::path& path);
/// As text of such a file: of each camera its pose is written anew, in the link of a URDF or the
/// pose of a file if it hangs on one, everything else as it was read.
Result<std::string> rig_text_with_poses(const std::filesystem::path& path,
                                        const std::vector<Pose>& X_WC);

// Depth frames from your own code.

/// Frames are pushed at one end and felt at the other. The newest one wins: what nobody took in
/// time is left out and counted.
///
///   auto camera = PushedSource::create(info).value();
///   auto loop = RunLoop::create(tool, *camera, device, settings).value();   // one thread
///   camera->push(frame);                                                    // any other one
class PushedSource : public DepthSource {
 public:
  struct Options {
    /// Time stamps are the camera's own, s on a clock of its own: capture times on this computer's
    /// clock are estimated from them. Else a frame is captured when it is pushed.
    bool has_time_stamps = false;
    double latency = 0;  ///< s, from the exposure to the time stamp
  };
  /// `info`: of the frames; `info.distortion` is removed from them. Where the camera is, each frame
  /// says (DepthFrame::X_WC), and `info.is_moving` whether that changes. Errors: a size or focal
  /// length that no image has.
  static Result<std::unique_ptr<PushedSource>> create(const DepthStreamInfo& info,
                                                      const Options& options);
  static Result<std::unique_ptr<PushedSource>> create(const DepthStreamInfo& info);

  /// From any threads. Never waits for whoever feels them; takes the pixels and gives others back,
  /// so that a caller who keeps `frame` allocates nothing. A frame of another size than `info` is
  /// mapped to that, as of a camera that has changed its mode. Pushed after `end`: ignored.
  virtual void push(DepthFrame& frame) = 0;
  /// No more frames come.
  virtual void end() = 0;
};

// A robot that cameras see, taken out of their images before anything is felt.

/// Which meshes of a URDF stand for its links.
enum class RobotGeometry { collision, visual };
constexpr auto names_of(RobotGeometry) { return std::array{"collision", "visual"}; }

struct SelfFilterOptions {
  double padding = 0.02;
  double scale = 1;
  double max_age = 0.1;
  RobotGeometry geometry = RobotGeometry::collision;
};
inline void add_settings(SettingTable& t, SelfFilterOptions& o) {
  t.section("robot");
  t.add("padding", o.padding, {0, 0.1, "m"},
        "what a camera sees this near to the robot is not felt");
  t.add("scale", o.scale, {0.5, 2, ""}, "of the meshes of its links, about their middles");
  t.add("max_age", o.max_age, {1e-3, 10, "s"},
        "depth images are left out when nothing newer than this tells where the robot is");
  t.add("geometry", o.geometry,
        "which meshes of a URDF stand for a link; one that has none of these takes the others");
}

/// A rigid part of what is not to be felt, in its own frame L, m.
struct RobotLink {
  std::string name;
  TriangleMesh mesh;
};

/// Where links are.
class LinkPoses {
 public:
  virtual ~LinkPoses() = default;
  /// X_WL of all links at a time on the clock of the frames, s. Any threads. Error: they are not
  /// known, in words that people are told.
  virtual Status at(double time, std::span<Pose> X_WL) const = 0;
  /// The same when a frame was captured: who goes by its stamp looks at that. May wait until it is
  /// known, a second at most.
  virtual Status at_frame(const DepthFrame& frame, std::span<Pose> X_WL) const {
    return at(frame.timestamp, X_WL);
  }
  /// Whether times are on the clock of this computer, as those of live frames. None: go with both.
  virtual std::optional<bool> is_live() const { return std::nullopt; }
};

/// Takes links out of depth images: what a pixel shows of them, with a padding around, and what
/// lies behind them is no measurement any more (0). Frames for whose time the poses are not known
/// are left out, and a note says so. Frames are recorded as they come out, so that a repetition
/// needs no robot. On the CPU, in the thread that reads the camera, for all backends.
class SelfFilter {
 public:
  /// Error: an option out of its range.
  static Result<SelfFilter> create(std::vector<RobotLink> links,
                                   std::shared_ptr<const LinkPoses> poses,
                                   const SelfFilterOptions& options = {});

  /// The same frames without the links. Error: frames are live and poses are not, or the reverse.
  Result<std::unique_ptr<DepthSource>> applied_to(std::unique_ptr<DepthSource> source) const;

 private:
  struct Robot;
  explicit SelfFilter(std::shared_ptr<const Robot> robot) : robot_(std::move(robot)) {}
  std::shared_ptr<const Robot> robot_;
};

/// As people name a robot.
struct RobotFiles {
  std::string robot;   ///< FILE.urdf, or a mesh: a robot of one link
  std::string joints;  ///< FILE.csv, bag:FILE[?topic=/T], ros2:[/T]; with ?world=FRAME by tf
  std::string pose;  ///< X_WB of its base, "tx ty tz qx qy qz qw" or a file (TUM); empty: that of W
  std::string packages;  ///< where package:// leads: folders, with ':' between them
};
/// Errors: a file that cannot be read, with the place; a mesh that is not found, with the places
/// that were tried; joints of the robot of which the source tells nothing.
Result<SelfFilter> open_self_filter(const RobotFiles& files, const SelfFilterOptions& options = {});
/// Error: tf places the robot in another world than one of the cameras.
Status check_one_world(std::span<const CameraUri> cameras, const RobotFiles& robot);

}  // namespace palpate::inline v0
