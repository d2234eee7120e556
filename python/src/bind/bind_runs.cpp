// Parts of palpate.touch: opening of depth streams and devices, and the run itself.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/cameras/cameras.h"
#include "palpate/devices/devices.h"
#include "palpate/session/run.h"
#include "python/src/arrays.h"
#include "python/src/bindings.h"
#include "python/src/interruptible.h"
#include "python/src/pushed_camera.h"
#include "python/src/run_in_thread.h"
#include "scenes/scene.h"
#include "src/haptics/internal/hand.h"
#include "src/run/internal/run_inputs.h"

namespace palpate::python {
namespace {

/// Reads times and poses, (N, 8), or the trajectory of a file.
std::vector<TimedPose> path_of(nb::handle given) {
  if (given.is_none()) return {};
  if (nb::isinstance<nb::str>(given) || nb::hasattr(given, "__fspath__")) {
    const auto path = nb::cast<std::filesystem::path>(given);
    return taken(interruptible([path] { return load_trajectory(path); }));
  }
  const Doubles rows = doubles_of(given, "path");
  if (rows.ndim() != 2 || rows.shape(1) != 8 || rows.shape(0) == 0) {
    refuse_shape("path", shape_of(rows), "(N, 8): time tx ty tz qx qy qz qw");
  }
  std::vector<TimedPose> path;
  for (std::size_t i = 0; i < rows.shape(0); ++i) {
    const double* v = rows.data() + 8 * i;
    const TimedPose pose{v[0],
                         {{v[1], v[2], v[3]}, normalized(Quaternion{v[4], v[5], v[6], v[7]})}};
    const bool is_turned = v[4] != 0 || v[5] != 0 || v[6] != 0 || v[7] != 0;
    const bool is_later = path.empty() || pose.time >= path.back().time;
    if (!std::isfinite(pose.time) || !is_finite(pose.X_WT) || !is_turned || !is_later) {
      throw nb::value_error(("path: row " + std::to_string(i) +
                             " is not finite, has a zero quaternion, or goes back in time")
                                .c_str());
    }
    path.push_back(pose);
  }
  return path;
}

std::vector<TimedPose> path_of_scene(const std::string& camera) {
  const auto uri = parse_camera_uri(camera);
  if (!uri || uri->kind != "scene") return {};
  const auto scene = scenes::make_scene(uri->target);
  std::vector<TimedPose> path;
  for (std::size_t i = 0; scene && i < scene->path_times.size(); ++i) {
    path.push_back({scene->path_times[i], scene->path_poses[i]});
  }
  return path;
}

/// Returns the pose of the handle along the path, by time since its beginning.
HandTarget follow(std::vector<TimedPose> path, const CouplingOptions& coupling) {
  return [path = std::move(path), coupling](double time) {
    return handle_at(coupling, pose_at(path, path.front().time + time));
  };
}

std::unique_ptr<HapticDevice> opened_device(const std::string& uri) {
  return taken(interruptible([uri] { return open_device(uri); }));
}

std::unique_ptr<HapticDevice> simulated_hand(const std::string& uri,
                                             const std::vector<TimedPose>& path,
                                             const CouplingOptions& coupling) {
  const auto model = uri.size() > 4 ? find_device_model(uri.substr(4)) : device_models().front();
  if (!model || path.empty()) return opened_device(uri);
  SimulatedDeviceOptions simulated;
  simulated.model = *model;
  simulated.target = follow(path, coupling);
  return taken(SimulatedDevice::create(simulated));
}

struct Touch {
  RunRequest request;
  std::vector<TimedPose> path;
  double duration = std::numeric_limits<double>::infinity();
  bool was_placed = false;  // the settings place base or tool
  Pose X_WC;                // of the first camera, if static

  double path_length() const { return path.back().time - path.front().time; }

  void take_device(nb::handle device) {
    if (!was_placed && !path.empty()) {
      place_hand(X_WC, path.front().X_WT, request.settings.coupling);
    }
    if (!nb::isinstance<nb::str>(device)) {
      PythonDevice made = make_python_device(device);
      request.device = std::move(made.device);
      request.raised_by_device = std::move(made.raised);
    } else {
      const auto uri = nb::cast<std::string>(device);
      const bool is_hand = uri == "sim" || uri.starts_with("sim:");
      const CouplingOptions& coupling = request.settings.coupling;
      request.device = is_hand ? simulated_hand(uri, path, coupling) : opened_device(uri);
      if (is_hand && path.size() > 1) duration = std::min(duration, path_length());
    }
    request.options.duration = duration;
  }

  /// Sets up the path on a simulated clock.
  void take_path(bool has_duration) {
    PathDeviceOptions options;
    options.X_BH = follow(path, request.settings.coupling);
    options.duration = has_duration ? duration : path_length();
    options.rate = request.settings.contact_rate;
    options.limits = find_device_model("sigma.7")->limits;
    options.name = "a path";
    if (!(options.duration > 0)) {
      if (!request.sources.front()->info().num_frames) {
        throw PalpateError("neither the path nor the frames end: pass duration");
      }
      options.duration = std::numeric_limits<double>::infinity();
    }
    request.device = taken(make_path_device(std::move(options)));
    request.options.clock.ends_with_frames = !has_duration;
    request.options.time_origin = path.front().time;
  }

  /// Sets up the path in real time, for live frames.
  void play_path() {
    const HandTarget target = follow(path, request.settings.coupling);
    std::vector<TimedPose> X_BH;
    for (const TimedPose& pose : path) {
      X_BH.push_back({pose.time - path.front().time, target(pose.time - path.front().time)});
    }
    request.device = make_replay_device("a path", std::move(X_BH));
    request.options.duration = std::min(duration, path_length());
  }
};

/// Opens a camera; with a live device, sources that are not live are read ahead. `X_FC`: that of
/// clouds that are projected.
std::shared_ptr<DepthSource> opened_camera(const CameraUri& uri, const CameraOpening& opening,
                                           bool is_live, Pose& X_FC) {
  auto source = taken(interruptible([=] { return open_camera(uri, opening); }));
  X_FC = projection_of(*source).value_or(Pose{});
  if (!is_live || source->info().is_live) return source;
  return taken(read_ahead(std::move(source)));
}

/// Starts a run. `cameras`: a list of URIs for open_camera and of PyPushedCameras.
std::unique_ptr<RunInThread> start_run(const PyTool& tool, const nb::list& cameras, nb::handle path,
                                       nb::handle device, std::optional<double> duration,
                                       nb::object on_tick, const std::filesystem::path& folder,
                                       const std::optional<std::filesystem::path>& settings_file,
                                       const nb::dict& settings) {
  Touch touch;
  RunRequest& request = touch.request;
  request.tool = tool;
  request.on_tick = std::move(on_tick);
  request.folder = folder;
  if (duration && !(*duration > 0)) throw nb::value_error("duration: has to be more than 0 s");
  touch.duration = duration.value_or(touch.duration);
  const bool is_live = !device.is_none();
  touch.path = path_of(path);
  std::vector<PyPushedCamera*> all_pushed;
  std::vector<CameraUri> uris;
  for (const nb::handle camera : cameras) {
    PyPushedCamera* pushed = nullptr;
    if (nb::try_cast<PyPushedCamera*>(camera, pushed, false) && pushed != nullptr) {
      if (std::ranges::find(all_pushed, pushed) != all_pushed.end()) {
        throw nb::value_error("cameras: the same PushedCamera is there twice");
      }
      all_pushed.push_back(pushed);
      if (request.sources.empty()) touch.X_WC = pushed->X_WC();
      request.sources.push_back(pushed->source());
      continue;
    }
    const auto uri = nb::cast<std::string>(camera);
    constexpr double kLongest = 86400;  // a hand takes its time
    for (CameraUri& each : taken(parse_camera_uris({&uri, 1}))) {
      uris.push_back(std::move(each));
      taken(check_one_world(uris));
      Pose X_FC;
      request.sources.push_back(opened_camera(
          uris.back(), {is_live, is_live ? std::optional(kLongest) : duration}, is_live, X_FC));
      if (const auto stands = standing_pose(uris.back()); stands && request.sources.size() == 1) {
        touch.X_WC = *stands ? **stands * X_FC : Pose{};
      }
    }
    if (touch.path.empty()) touch.path = path_of_scene(uri);
  }
  if (request.sources.empty()) throw nb::value_error("cameras: give one, or several");
  const DepthStreamInfo& stream = request.sources.front()->info();
  request.settings.coupling.kind = is_live ? CouplingKind::virtual_coupling : CouplingKind::none;
  request.settings.surface = surface_options_for(stream.sensor);
  std::vector<DepthStreamInfo> streams;
  for (const auto& source : request.sources) streams.push_back(source->info());
  request.settings.time.average.kind = usual_average(streams);
  SettingTable table = settings_of(request.settings);
  const auto take_settings = [&] {
    if (settings_file) taken(read_settings_file(*settings_file, table));
    apply(settings, table);
  };
  take_settings();
  request.settings.surface.filter.smoothing = usual_smoothing(request.settings.contact.method);
  take_settings();
  if (DepthAverageOptions& average = request.settings.time.average;
      average.kind == DepthAverage::kalman) {
    average = depth_average_options_for(stream.sensor);
    average.kind = DepthAverage::kalman;
    take_settings();  // given settings override the file
  }
  const CouplingOptions& coupling = request.settings.coupling;
  touch.was_placed = !(coupling.X_WB == Pose{}) || !(coupling.X_HT == Pose{});
  if (is_live) {
    touch.take_device(device);
  } else if (touch.path.empty()) {
    throw PalpateError("these frames have no path of their own: give a path, or a device");
  } else if (stream.is_live) {
    touch.play_path();
  } else {
    touch.take_path(duration.has_value());
  }
  for (PyPushedCamera* pushed : all_pushed) {
    if (pushed->has_run()) throw PalpateError("a PushedCamera is for one run; create another one");
  }
  for (PyPushedCamera* pushed : all_pushed) pushed->begin_run();
  auto run = std::make_unique<RunInThread>(std::move(request));
  if (all_pushed.empty()) run->wait_for_ticks();  // else the first image is pushed after this
  return run;
}

std::vector<double> six_of(const Wrench& F) {
  return {F.force.x, F.force.y, F.force.z, F.torque.x, F.torque.y, F.torque.z};
}

void bind_tick(nb::module_& m) {
  const auto array = [](const char* name) {
    return std::string("def ") + name + "(self) -> numpy.typing.NDArray[numpy.float64]";
  };
  nb::class_<PyTick>(m, "Tick", "One tick of a run.")
      .def_prop_ro(
          "number", [](const PyTick& t) { return t.record.number; }, "From 0.")
      .def_prop_ro(
          "time", [](const PyTick& t) { return t.record.time; }, "s since the start of the run.")
      .def_prop_ro(
          "pose", [](const PyTick& t) { return seven_of(t.record.step.X_WT); },
          nb::sig(array("pose").c_str()), "X_WT of the tool: (7,) tx ty tz qx qy qz qw, m.")
      .def_prop_ro(
          "hand_pose", [](const PyTick& t) { return seven_of(t.record.device.X_BH); },
          nb::sig(array("hand_pose").c_str()), "X_BH of the device's handle: (7,), m.")
      .def_prop_ro(
          "wrench", [](const PyTick& t) { return array_of(six_of(t.record.step.contact_W), {6}); },
          nb::sig(array("wrench").c_str()),
          "(6,) N and N m on the tool, in W about its center of mass.")
      .def_prop_ro(
          "hand_wrench", [](const PyTick& t) { return array_of(six_of(t.record.F_H_B), {6}); },
          nb::sig(array("hand_wrench").c_str()),
          "(6,) N and N m sent to the device, at the handle in B.")
      .def_prop_ro(
          "volume", [](const PyTick& t) { return t.record.penetration.volume; },
          "Penetration volume of the tool, m3.")
      .def_prop_ro(
          "buttons", [](const PyTick& t) { return t.record.device.buttons; }, "One bit per button.")
      .def_prop_ro(
          "status",
          [](const PyTick& t) { return static_cast<StepStatus>(t.record.penetration.status.bits); },
          "Unusual conditions of the measurement.")
      .def_prop_ro(
          "contact_age", [](const PyTick& t) { return t.record.contact_age; },
          "s, age of the contact in use.")
      .def_prop_ro(
          "sensor_age", [](const PyTick& t) { return t.record.sensor_age; },
          "s, from the depth frame to this force.")
      .def_prop_ro(
          "frame", [](const PyTick& t) { return t.record.frame_number; },
          "Number of the depth frame, from 0.");
}

}  // namespace

void bind_runs(nb::module_& m) {
  bind_tick(m);
  bind_pushed_camera(m);
  nb::class_<RunInThread>(m, "RunInThread", "A run whose loop is in C++, inside of palpate.Run.")
      .def("stop", &RunInThread::stop, "Fades the force out and ends the run.")
      .def("wait", &RunInThread::wait, nb::arg("seconds") = nb::none(),
           "Waits for the end, at most `seconds`. True if it has ended. Ctrl-C ends it.")
      .def(
          "leave", [](nb::handle self) { self.inc_ref(); },
          "In a child of os.fork: the run and its threads are the parent's, and never end here.")
      .def("mark", &RunInThread::mark, nb::arg("text"), "Adds a note to the recording.")
      .def_prop_ro("is_running", &RunInThread::is_running)
      .def_prop_ro("notes", &RunInThread::notes)
      .def_prop_ro("latest", [](const RunInThread& self) -> std::optional<PyTick> {
        const auto tick = self.latest();
        return tick ? std::optional(PyTick{*tick}) : std::nullopt;
      });

  m.def("start_run", start_run, nb::arg("tool"), nb::arg("cameras"), nb::arg("path").none(),
        nb::arg("device").none(), nb::arg("duration").none(), nb::arg("on_tick").none(),
        nb::arg("folder"), nb::arg("settings_file").none(), nb::arg("settings"),
        nb::sig("def start_run(tool: Tool, cameras: list[typing.Any], "
                "path: palpate._types.Array | str | os.PathLike[str] | None, "
                "device: str | palpate._types.Device | None, duration: float | None, "
                "on_tick: collections.abc.Callable[[Tick], bool | None] | None, "
                "folder: str | os.PathLike[str], "
                "settings_file: str | os.PathLike[str] | None, "
                "settings: dict[str, typing.Any]) -> RunInThread"),
        "Starts a run, for palpate.touch.");
  m.def("device_kinds", device_kinds, "The names that a device's text can begin with.");
  m.def("wait_for_interrupted_work", wait_for_interrupted_work,
        "Waits for cameras and devices that are still being opened after Ctrl-C.");
}

}  // namespace palpate::python
