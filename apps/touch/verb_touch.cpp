// palpate touch: a moving tool in a stream of depth images.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <sstream>

#include "apps/page.h"
#include "apps/terminal/terminal.h"
#include "apps/touch/sources.h"
#include "apps/touch/touch.h"
#include "apps/verbs.h"
#include "palpate/session/run.h"
#include "src/session/internal/run_folder.h"

namespace palpate::apps {
namespace {

using Options = TouchOptions;

/// Checks that the run does not overwrite its inputs.
Status check_inputs(const Options& options) {
  std::vector<std::string> inputs{options.tool, options.path, options.rig};
  std::error_code ignored;
  for (const CameraUri& camera : options.cameras) {
    if (std::filesystem::exists(camera.target, ignored)) inputs.push_back(camera.target);
    inputs.push_back(camera.poses);
    inputs.push_back(camera.urdf.substr(0, camera.urdf.find('#')));
    inputs.push_back(camera.joints);
  }
  if (options.is_replay()) inputs.push_back(options.device.substr(7));
  for (const ObjectOption& object : options.objects) inputs.push_back(object.file);
  for (const std::string& file : options.materials.labels) inputs.push_back(file);
  const RobotFiles& robot = options.robot.files;
  for (const std::string& file : {robot.robot, robot.joints, robot.pose}) {
    if (std::filesystem::exists(file, ignored)) inputs.push_back(file);
  }
  for (const std::string& input : inputs) {
    if (!input.empty() && lies_inside(input, options.output)) {
      return Error{Errc::io_failure, "the run would replace " + options.output +
                                         ", where its input " + input +
                                         " lies: give another folder"};
    }
  }
  return Done{};
}

Status read_settings(const std::string& path, Options& options) {
  const auto read = read_settings_file(path, settings_of(options.settings));
  if (!read) return read.error();
  options.given.insert(options.given.end(), read->begin(), read->end());
  return Done{};
}

}  // namespace

Status run_touch(const TouchOptions& given) {
  if (!interrupted()) end_at_interrupts();
  if (!given.settings_read) return given.settings_read;
  Options options = given;
  if (const Status status = find_connected(options); !status) return status;
  if (const Status status = know_frames(options); !status) return status;
  if (const Status status = check_inputs(options); !status) return status;
  const auto tool =
      load_tool_prefix(options.tool, options.num_spheres, options.settings.num_threads);
  if (!tool) return tool.error();
  auto objects = load_objects(options.objects);
  if (!objects) return objects.error();
  options.settings.objects = *std::move(objects);
  auto regions = load_regions(options.materials);
  if (!regions) return regions.error();
  options.settings.regions = *std::move(regions);
  auto input = open_touch_input(options, *tool);
  if (!input) return input.error();
  return touch(options, *tool, *std::move(input));
}

namespace {

/// Parses numbers separated by commas; returns none if the text is invalid.
std::vector<double> parse_place(const std::string& text) {
  std::vector<double> numbers;
  std::string part;
  std::istringstream parts(text + ",");
  while (std::getline(parts, part, ',')) {
    std::istringstream number(part);
    if (!(number >> numbers.emplace_back()) || !std::isfinite(numbers.back()) ||
        !(number >> std::ws).eof()) {
      return {};
    }
  }
  return numbers;
}

/// Adds options for the target of a generated path.
void add_aim_options(CLI::App& app, const std::shared_ptr<Options>& options) {
  const std::string group = "Without --path: target of the probing";
  const std::string places = "a pixel u,v of the depth image or a point x,y,z in meters";
  app.add_option_function<std::string>(
         "--probe",
         [options, places](const std::string& text) {
           const std::vector<double> place = parse_place(text);
           if (place.size() == 2) {
             options->aim.pixel = {place[0], place[1]};
           } else if (place.size() == 3) {
             options->aim.point_W = Vec3d{place[0], place[1], place[2]};
           } else {
             usage_error("--probe: must be " + places + ", not '" + text + "'");
           }
         },
         "target: " + places +
             "; default: a well-measured place near the camera and the image center")
      ->type_name("u,v|x,y,z")
      ->group(group);
  const std::string tips = "a point x,y,z of the tool in meters, in the frame of its mesh";
  app.add_option_function<std::string>(
         "--tip",
         [options, tips](const std::string& text) {
           const std::vector<double> tip = parse_place(text);
           if (tip.size() != 3) usage_error("--tip: must be " + tips + ", not '" + text + "'");
           options->aim.tip_T = Vec3d{tip[0], tip[1], tip[2]};
         },
         "leading end: " + tips + "; default: the thinnest end")
      ->type_name("x,y,z")
      ->group(group);
}

/// Parses "10min" or "1.5 GB", in the first unit; returns 0 if invalid. Units: name and factor.
double parse_amount(const std::string& text,
                    std::initializer_list<std::pair<std::string_view, double>> units) {
  std::istringstream stream(text);
  double number = 0;
  std::string unit;
  if (!(stream >> number) || !std::isfinite(number) || number <= 0) return 0;
  stream >> unit;
  if (!(stream >> std::ws).eof()) return 0;
  for (const auto& [name, factor] : units) {
    if (unit == name) return number * factor;
  }
  return 0;
}

/// Adds options that limit the recording of a long run.
void add_record_options(CLI::App& app, const std::shared_ptr<Options>& options) {
  const std::string group = "Recording";
  const auto refuse = [](const char* option, const std::string& text, const char* desired) {
    usage_error(std::string("touch: ") + option + ": " + desired + ", not '" + text + "'");
  };
  app.add_option_function<std::string>(
         "--record-keep",
         [options, refuse](const std::string& text) {
           const double seconds = parse_amount(text, {{"", 1}, {"s", 1}, {"min", 60}, {"h", 3600}});
           if (seconds < 1)
             refuse("--record-keep", text, "a time of 1s or more, as 90s, 10min, 2h");
           options->recording.keep_seconds = seconds;
         },
         "keep only the last part of the run, e.g. 10min: splits the recording and "
         "removes older parts")
      ->type_name("TIME")
      ->group(group);
  app.add_option_function<std::string>(
         "--record-split",
         [options, refuse](const std::string& text) {
           const double bytes = parse_amount(
               text, {{"", 1}, {"B", 1}, {"kB", 1e3}, {"MB", 1e6}, {"GB", 1e9}, {"TB", 1e12}});
           if (bytes < 1e6) refuse("--record-split", text, "a size of 1MB or more, as 500MB, 1GB");
           options->recording.split_bytes = bytes;
         },
         "split the recording into files of this size, e.g. 1GB; each can be viewed alone")
      ->type_name("SIZE")
      ->group(group);
}

/// Adds options of the page that shows the run.
void add_view_options(CLI::App& app, Options& options) {
  app.add_flag("--view", options.has_page,
               "show the run in a browser; without --device it then runs in real time")
      ->group("Options");
  add_page_options(app, "--view-", options.page);
  app.add_flag("--view-open", options.page.opens_browser, "also open the browser of this computer");
}

/// Returns the default settings of runs.
RunSettings settings_of_runs() {
  RunSettings settings;
  settings.time.average.kind = usual_average({});
  return settings;
}

/// Returns the default settings with every key commented out: a key in a file counts as given, and
/// would override choices by camera or device.
std::string commented_settings() {
  const RunSettings defaults = settings_of_runs();
  std::istringstream lines(settings_toml(settings_of(defaults)));
  std::string text;
  for (std::string line; std::getline(lines, line);) {
    const bool is_key = !line.empty() && line.front() != '[' && line.front() != '#';
    text += (is_key ? "# " : "") + line + "\n";
  }
  return text;
}

/// Adds options of the device and its coupling to the tool.
void add_hand_options(CLI::App& app, const std::shared_ptr<Options>& options) {
  const std::string group = "Hand";
  app.add_option("--device", options->device,
                 "run live with a haptic device: sim[:MODEL], replay:FILE, spacenav, haply[:URL], "
                 "forcedimension, openhaptics, vrpn:NAME@HOST, ros2:/POSE_TOPIC, page (mouse, "
                 "finger or gamepad in the page of --view); palpate devices lists them; --device "
                 "alone uses the one that is connected; default: the tool follows a path on a "
                 "simulated clock")
      ->type_name("DEVICE")
      ->expected(0, 1);
  // Read while parsing, so that all other options override the file.
  app.add_option_function<std::string>(
         "--settings",
         [options](const std::string& path) {
           options->settings_read = read_settings(path, *options);
         },
         "settings file; for surfaces, contact, loop, coupling and safety; other options "
         "override it")
      ->trigger_on_parse()
      ->type_name("FILE.toml")
      ->group("Options");
  add_setting_options(app, group, settings_of(options->settings), kHandOptions);
  app.add_flag_callback(
         "--print-settings",
         [] { throw CLI::CallForVersion(commented_settings(), 0); },  // ends well
         "print a settings file with all defaults as comments, and exit")
      ->group("Options");
}

void add_path_options(CLI::App& app, Options& options) {
  app.add_option("--path", options.path,
                 "file of tool poses: lines 't tx ty tz qx qy qz qw'; default: the scene's path, "
                 "or automatic probing, see --probe")
      ->type_name("FILE");
  app.add_option("--path-frame", options.frames.path,
                 "frame of the tool poses of --path and of --device replay:FILE. world: the camera "
                 "frame, unless cameras have poses; camera, camera_2, ... or another frame of the "
                 "rig; device: the base at coupling.base_in_scene; base: the file has poses of "
                 "the handle in the device base")
      ->type_name("FRAME")
      ->capture_default_str();
  app.add_option("--base-frame", options.frames.base,
                 "frame of coupling.base_in_scene: camera, camera_2, ... or another frame of the "
                 "rig; default: the world")
      ->type_name("FRAME");
  add_word(app, "--align", options.align,
           "align path and depth frames by timestamps, or start both together; auto: by "
           "timestamps if both count from 1970");
}

}  // namespace

void add_touch(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  options->settings = settings_of_runs();
  CLI::App& app = *program.add_subcommand(
      "touch", "Move a tool through a stream of depth images and record the contact forces.");
  app.add_option("tool", options->tool, "tool file")->required()->type_name("TOOL.palp");
  app.add_option("-o,--output", options->output, "folder of the run: new, empty or an earlier run")
      ->required()
      ->type_name("RUN");
  add_seconds_option(app, "--duration", options->duration,
                     "length of the run; default: until the path or the frames end");
  const SettingTable table = settings_of(options->settings);
  add_prefix_option(app, options->num_spheres);
  add_set_option(app, table);
  app.add_flag("--json", options->json, "print the summary as JSON");
  const auto source = std::make_shared<SourceOptions>();
  app.option_defaults()->group("Depth images");
  add_source_options(app, *source);
  app.option_defaults()->group("Motion of the tool");
  add_path_options(app, *options);
  add_aim_options(app, options);
  add_hand_options(app, options);
  app.option_defaults()->group("Contact");
  add_object_option(app, options->objects, true);
  add_setting_options(app, "", table, kContactOptions);
  app.option_defaults()->group("Speed");
  add_setting_options(app, "", table, kLoopOptions);
  add_threads_option(app, options->settings.num_threads, kThreadsHelp);
  add_robot_options(app, options->robot);
  add_output_options(app, options->frames, options->settings);
  add_material_options(app, options->materials);
  add_setting_options(app, "From depth to surface", table, kSurfaceOptions);
  add_setting_options(app, "Between depth images", table, kTimeOptions);
  add_record_options(app, options);
  app.option_defaults()->group("Page in a browser");
  add_view_options(app, *options);
  app.option_defaults()->group("Options");
  app.add_flag("--ros2", options->ros.is_requested,
               "also publish wrench, contact, tool pose and points over ROS 2")
      ->group("ROS 2");
  add_ros_options(app, options->ros);
  app.footer(
      "Example: palpate touch drill.palp --scene hand -o run1\n"
      "Example: palpate touch drill.palp --scene hand --device sim --duration 4 -o run2\n"
      "Example: palpate touch --print-settings > haptics.toml");
  app.callback([options, source, &app, &action] {
    options->cameras = cameras_of(*source, "touch");
    check_robot(app, "touch");
    options->rig = source->rig;
    options->sensor = source->sensor;
    if (app.count("--device") > 0 && options->device.empty()) options->device = "auto";
    for (std::string& key : given_settings(app, {kSurfaceOptions, kTimeOptions, kHandOptions})) {
      options->given.push_back(std::move(key));
    }
    // A frame alone also places the base.
    if (!options->frames.base.empty()) options->given.push_back("coupling.base_in_scene");
    check_motion(app, *options);
    check_use(app, options->settings);
    check_feel(app, *options);
    check_materials(options->materials);
    options->has_page = options->has_page || options->is_page();
    check_view(app, *options);
    if (options->ros.is_requested && options->device.empty()) {
      usage_error("touch: --ros2 goes with --device: what is published is of a live run");
    }
    check_ros_output(options->ros, options->frames.wrench, options->settings.output, "touch");
    const bool has_poses = std::ranges::any_of(options->cameras, [](const CameraUri& camera) {
      return !(camera.X_WC == Pose{}) || !camera.poses.empty() || !camera.urdf.empty();
    });
    const bool know_world = std::ranges::all_of(
        options->cameras, [](const CameraUri& camera) { return camera.extras.contains("world"); });
    if (options->ros.is_requested && options->ros.camera_frame.empty() &&
        (has_poses || !options->rig.empty() || (options->cameras.size() > 1 && !know_world))) {
      usage_error(
          "touch: --ros2 with several cameras or with camera poses needs the name of the world "
          "frame: pass --ros2-camera-frame FRAME, or ?world=FRAME (of tf) for each camera");
    }
    check_method(*options);
    action = [options] { return run_touch(*options); };
  });
}

}  // namespace palpate::apps
