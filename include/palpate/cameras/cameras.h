// Cameras by URI, rigs of several cameras, pushed frames from your own code, and the self filter.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/cloud/depth_source.h"
#include "palpate/cloud/point_cloud.h"
#include "palpate/core/core.h"
#include "palpate/gpu/devices.h"
#include "palpate/math/geometry.h"
#include "palpate/mesh/mesh.h"
#include "palpate/settings/setting_table.h"

namespace palpate { inline namespace v0 {

// Camera URIs: KIND[:TARGET][?NAME=VALUE&...].

/// Size of an image, in pixels.
struct ImageSize {
  int width = 0, height = 0;

  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

/// A parsed URI. Parameters override what the stream reports:
///   intrinsics=fx,fy,cx,cy  distortion=k1,k2,p1,p2[,k3[,k4,k5,k6]]  size=WIDTHxHEIGHT
///   unit=METERS_PER_COUNT  rate=HZ  latency=SECONDS  sensor=KIND  crop=none|valid
///   pose=tx,ty,tz,qx,qy,qz,qw: X_WC; with poses, urdf or world: hand-eye offset
///   poses=FILE: of a moving frame, by time (TUM)  `urdf=FILE#LINK[#BASE]`: of a link
///   joints=FILE.csv|bag:FILE|ros2:[/T]: states of the joints in between
///   accelerometer=ax,ay,az: m/s2, as the camera at rest reads it, along its own axes
struct CameraUri {
  std::string text;          ///< the original text, for display
  std::string kind, target;  ///< "folder" and "frames/"
  std::optional<Intrinsics> intrinsics;
  std::optional<Distortion> distortion;
  std::optional<ImageSize> size;
  std::optional<double> unit, rate;
  std::optional<SensorKind> sensor;
  bool is_cropped = false;  ///< to the largest rectangle without pixels outside of the lens
  double latency = 0;       ///< s, from the exposure to the timestamp
  Pose X_WC;                ///< pose of the camera in the world
  std::string poses;        ///< file of poses by time; empty: it does not move
  std::string urdf, joints;
  std::optional<Vec3d> accelerometer;
  std::map<std::string, std::string> extras;  ///< parameters of single kinds

  /// Checks `extras`. Error: an extra parameter that is not in `known`.
  Status check_extras(std::initializer_list<std::string_view> known = {}) const;
};

/// Parses a URI, except its kind. Errors: an invalid parameter, with its name.
Result<CameraUri> parse_camera_uri(std::string_view text);
/// Parses a list. `look=round`, of clouds of scanners that see all round, stands for four cameras
/// of 90 degrees: they look along x, y, -x and -y of the cloud's frame. Errors: of the first bad
/// one.
Result<std::vector<CameraUri>> parse_camera_uris(std::span<const std::string> texts);
/// Checks that all cameras have the same world. Error: different worlds (`world=`).
Status check_one_world(std::span<const CameraUri> cameras);

// Finding and opening depth cameras by URI.

/// One kind of camera, and its devices on this machine.
struct FoundCameras {
  std::string kind;
  std::string usage;  ///< "folder:DIR"
  bool is_usable = false;
  std::string library, version;      ///< of the vendor library, if found
  std::vector<std::string> devices;  ///< URIs for open_camera
  std::string reason;                ///< what it is, or every path that was tried and what to do
  /// The devices are plugged-in cameras that can be opened by name alone.
  bool is_live = false;
};
/// Probes every kind at once; a driver that hangs is given up after 30 s. Starts no camera.
std::vector<FoundCameras> find_cameras();

/// Options of opening a camera.
struct CameraOpening {
  /// The run follows this computer's clock: frames that were not taken in time are dropped.
  /// Otherwise every frame counts, except from devices.
  bool in_real_time = true;
  std::optional<double> duration = {};  ///< s, for simulated cameras; none: the scene's
  /// Called, before the camera is open, with the reason why it sends nothing yet.
  std::function<void(const std::string&)> on_wait = {};
};

/// Opens a stream of undistorted pinhole images with fixed size and intrinsics, even
/// if the camera changes its own. A separate thread reads a live camera, which is
/// reconnected after a loss. Kinds: see `find_cameras`. Errors: unknown kind or
/// target; a missing vendor library, with every path that was tried; unknown
/// intrinsics.
Result<std::unique_ptr<DepthSource>> open_camera(std::string_view uri,
                                                 const CameraOpening& opening = {});
Result<std::unique_ptr<DepthSource>> open_camera(const CameraUri& uri,
                                                 const CameraOpening& opening = {});
/// Returns the pose of the images' camera C in the frame F of clouds that are projected, whose pose
/// the URI says, of a stream of open_camera: C has no lens and no sensor. None: C is that of a
/// camera.
std::optional<Pose> projection_of(const DepthSource& camera);
/// X_WC of a static camera, from its pose or URDF. None: it moves, or tf defines it; does not read
/// joint states. Errors: of its files.
Result<std::optional<Pose>> standing_pose(const CameraUri& uri);
/// Gravity in W, m/s2, from the first static camera with an accelerometer. None: there is none.
std::optional<Vec3d> gravity_seen(std::span<const CameraUri> cameras);
/// Returns a sentence for each static camera whose accelerometer contradicts `gravity`, m/s2, in W,
/// by more than 10 degrees or 10 %. None without gravity.
std::vector<std::string> gravity_doubts(std::span<const CameraUri> cameras, const Vec3d& gravity);

// Rigs: several cameras in one file, with their poses.

/// A file, TOML:
///
///   [world]
///   frame = "table"          # name of the world frame
///   gravity = [0, 9.81, 0]   # m/s2, in W
///
///   [[camera]]
///   name = "front"
///   uri = "openni2"                          # see open_camera
///   intrinsics = [525, 525, 319.5, 239.5]    # overrides the URI
///   distortion = [0.1, -0.2, 0, 0]
///   unit = 0.001
///   pose = [0, 0, 0, 0, 0, 0, 1]             # X_WC: tx ty tz qx qy qz qw
///   # or: pose_from = "front.tum"            # poses of a moving camera, beside this file
///   # or: pose_from = "tf:front_optical"     # its frame in the tf of a recording (bag:)
///   # or: pose_from = "urdf:cell.urdf#front_optical"   # a link, in the link named [world] frame
///   #     with pose, too: the hand-eye offset
///   joints = "joints.csv"                    # or bag:FILE: states of the joints in between
///   accelerometer = [0, -9.81, 0]            # m/s2, of the camera at rest, along its axes
///
///   [frames]                                 # your own frames, in W
///   bench = [1, 0, 0, 0, 0, 0, 1]            # or "urdf:cell.urdf#bench"
struct CameraRig {
  /// One camera of the rig: its name, and its URI with its pose.
  struct Camera {
    std::string name;
    CameraUri uri;
  };
  std::string frame = "world";
  /// m/s2, in W; by default from the first static camera with an accelerometer. None:
  /// unknown.
  std::optional<Vec3d> gravity;
  std::vector<Camera> cameras;
  std::map<std::string, Pose> frames;  ///< X_WF
};

/// Relative targets and pose files are relative to the rig's file. Errors: no such file, not TOML,
/// an unknown key or a value of the wrong kind, two cameras of one name, no camera or more than
/// kMaxCameras; all with the file and the camera.
Result<CameraRig> load_rig(const std::filesystem::path& path);
/// The text of the file with new camera poses: relative to the link of a URDF or the poses of a
/// file if the camera has one. Everything else is unchanged.
Result<std::string> rig_text_with_poses(const std::filesystem::path& path,
                                        const std::vector<Pose>& X_WC);

// Depth frames from your own code.

/// A source whose frames your program pushes. The newest frame wins: frames that were not taken in
/// time are dropped and counted.
///
///   auto camera = PushedSource::create(info).value();
///   auto loop = RunLoop::create(tool, *camera, device, settings).value();   // one thread
///   camera->push(frame);                                                    // any other one
class PushedSource : public DepthSource {
 public:
  /// The clock of the frames.
  struct Options {
    /// Timestamps are the camera's own, s on its own clock: capture times on this computer's clock
    /// are estimated from them. Otherwise a frame counts as captured when it is pushed.
    bool has_time_stamps = false;
    double latency = 0;  ///< s, from the exposure to the timestamp, 0 to 1
  };
  /// `info` describes the frames; they are undistorted by `info.distortion`. Each frame has the
  /// pose of its camera (DepthFrame::X_WC), and `info.is_moving` says whether it changes. Errors:
  /// an invalid size, focal length or latency, an optical flow of a camera with distortion.
  static Result<std::unique_ptr<PushedSource>> create(const DepthStreamInfo& info,
                                                      const Options& options);
  static Result<std::unique_ptr<PushedSource>> create(const DepthStreamInfo& info);

  /// From any threads. Never waits. Swaps the pixels, so a caller that keeps `frame` allocates
  /// nothing. A frame of another size than `info` is resampled, as after a mode change of the
  /// camera. Ignored after `end`.
  virtual void push(DepthFrame& frame) = 0;
  /// The same with points in the camera's frame C: they become the image that `info` describes, its
  /// distortion aside. Points organized like it on its rays give their z; others are projected,
  /// without those whose normals point away. `timestamp`: see DepthFrame. Waits for other threads
  /// that push points; O(points + pixels).
  virtual void push_points(const PointsView& points, const Pose& X_WC, double timestamp) = 0;
  /// Ends the stream.
  virtual void end() = 0;
};

// The self filter: removes a robot from the depth images.

/// The meshes of a URDF that represent its links.
enum class RobotGeometry { collision, visual };
constexpr auto names_of(RobotGeometry) { return std::array{"collision", "visual"}; }

/// Options of the self filter; padding in m, max_age in s.
struct SelfFilterOptions {
  double padding = 0.02;
  double scale = 1;
  double max_age = 0.1;
  RobotGeometry geometry = RobotGeometry::collision;
};
inline void add_settings(SettingTable& t, SelfFilterOptions& o) {
  t.section("robot");
  t.add("padding", o.padding, {0, 0.1, "m"}, "pixels this near to the robot are removed");
  t.add("scale", o.scale, {0.5, 2, ""}, "of the link meshes, about their centers");
  t.add("max_age", o.max_age, {1e-3, 10, "s"},
        "depth images are dropped if the newest robot state is older");
  t.add("geometry", o.geometry,
        "meshes of the URDF for a link; a link without them uses the others");
}

/// A rigid part to remove, in its own frame L, m.
struct RobotLink {
  std::string name;
  TriangleMesh mesh;
};

/// Source of link poses.
class LinkPoses {
 public:
  virtual ~LinkPoses() = default;
  /// X_WL of all links at a time (s) on the clock of the frames. From any thread. Error: unknown
  /// poses, with a message for the user.
  virtual Status at(double time, std::span<Pose> X_WL) const = 0;
  /// The same at the capture of a frame; by default at its timestamp. May wait until it is known,
  /// for at most a second.
  virtual Status at_frame(const DepthFrame& frame, std::span<Pose> X_WL) const {
    return at(frame.timestamp, X_WL);
  }
  /// True: times are on this computer's clock, like live frames. None: works with both.
  virtual std::optional<bool> is_live() const { return std::nullopt; }
};

/// Removes links from depth images: pixels that show a link, with padding, and everything behind
/// it, become no measurement (0). Frames without known poses are dropped, with a note. Recordings
/// contain the filtered frames, so replay needs no robot. Runs in the thread that reads the camera,
/// on a CPU or a GPU, with the same bits.
class SelfFilter {
 public:
  /// Creates a filter. `notes` are among those of every source. Error: an option out of its range.
  static Result<SelfFilter> create(std::vector<RobotLink> links,
                                   std::shared_ptr<const LinkPoses> poses,
                                   const SelfFilterOptions& options = {},
                                   std::vector<std::string> notes = {});

  /// The frames without the links. Without the GPU of `place`, or once it is lost, the CPU removes
  /// them, with a note. Error: live frames with poses that are not live, or the reverse.
  Result<std::unique_ptr<DepthSource>> applied_to(std::unique_ptr<DepthSource> source,
                                                  const Place& place = Place::cpu()) const;

 private:
  struct Robot;
  explicit SelfFilter(std::shared_ptr<const Robot> robot) : robot_(std::move(robot)) {}
  std::shared_ptr<const Robot> robot_;
};

/// Files and sources that describe a robot.
struct RobotFiles {
  std::string robot;   ///< FILE.urdf, or a mesh: a robot of one link
  std::string joints;  ///< FILE.csv, bag:FILE[?topic=/T], ros2:[/T]; with ?world=FRAME by tf
  std::string pose;    ///< X_WB of its base: "tx ty tz qx qy qz qw" or a TUM file; empty: identity
  std::string packages;                ///< folders for package://, separated by ':'
  std::vector<std::string> skip = {};  ///< links of a URDF that stay in the images
};
/// Opens the files. Errors: an unreadable file, with its path; a missing mesh, with the paths that
/// were tried; joints without a state in the source; a link to skip that is not there.
Result<SelfFilter> open_self_filter(const RobotFiles& files, const SelfFilterOptions& options = {});
/// Checks the worlds. Error: tf places the robot in another world than one of the cameras.
Status check_one_world(std::span<const CameraUri> cameras, const RobotFiles& robot);

}}  // namespace palpate::v0
