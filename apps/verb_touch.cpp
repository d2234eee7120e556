// palpate touch: a moving tool in a stream of depth images.

#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <sstream>

#include "apps/held_frames.h"
#include "apps/live_touch.h"
#include "apps/objects.h"
#include "apps/options.h"
#include "apps/page.h"
#include "apps/terminal.h"
#include "apps/verbs.h"
#include "palpate/io/depth_files.h"
#include "palpate/io/trajectory_file.h"
#include "palpate/session/probing_path.h"
#include "palpate/session/record_run.h"
#include "palpate/session/run_folder.h"
#include "palpate/session/settings_file.h"
#include "palpate/viewer/views.h"
#include "scenes/scene.h"

namespace palpate::apps {
namespace {

struct Options {
  std::string tool, depth_sequence, scene, path, output;
  CameraOptions camera;
  double depth_rate = 30;
  bool noise = true;
  std::uint64_t seed = 1;
  RunSettings settings;
  std::vector<ObjectOption> objects;
  std::optional<double> duration;
  ProbeAim aim;                   ///< of a path that is not given
  std::string device;             ///< empty: the tool follows a path
  HapticSettings haptic;          ///< live: beside `settings`
  Status settings_read = Done{};  ///< of --settings
  int num_spheres = 0;            ///< 0: all
  bool json = false;
  bool has_page = false;
  ViewServerOptions page;
};

/// Frames to feel, and the path that goes with them if none is given.
struct Input {
  std::unique_ptr<DepthSource> source;
  std::vector<TimedPose> path;
  std::optional<ProbeChoice> probe;  ///< if the path was made up
};

bool is_aimed(const ProbeAim& aim) { return aim.pixel || aim.point_W || aim.tip_T; }

Result<std::unique_ptr<DepthSource>> open_sequence(const Options& options) {
  DepthFolderOptions folder;
  folder.intrinsics = *options.camera.intrinsics;
  folder.unit = options.camera.unit;
  folder.rate = options.depth_rate;
  return open_depth_folder(options.depth_sequence, folder);
}

/// `duration`: of the stream, nullopt for the scene's.
Result<std::unique_ptr<DepthSource>> open_scene(const Options& options,
                                                std::optional<double> duration) {
  auto scene = scenes::make_scene(options.scene);
  if (!scene) return scene.error();
  scenes::SimulatedCameraOptions camera;
  camera.noise.enabled = options.noise;
  camera.seed = options.seed;
  camera.unit = options.noise ? 0.001 : 0.0001;
  camera.duration = duration;
  return scenes::open_simulated_camera(*std::move(scene), camera);
}

/// Makes up the path.
Status add_probing_path(const Options& options, const Tool& tool, const OpenDepthSource& open,
                        Input& input) {
  auto path = probing_path(open, tool, options.duration, options.aim);
  if (!path) return path.error();
  input.path = std::move(path->poses);
  input.probe = std::move(path->choice);
  if (!input.probe->note.empty()) std::cerr << "palpate: note: " << input.probe->note << "\n";
  return Done{};
}

Result<Input> open_input(const Options& options, const Tool& tool) {
  Input input;
  if (!options.path.empty()) {
    auto path = load_trajectory(options.path);
    if (!path) return path.error();
    input.path = *std::move(path);
  }
  if (!options.depth_sequence.empty()) {
    auto source = open_sequence(options);
    if (!source) return source.error();
    input.source = *std::move(source);
    if (!input.path.empty()) return input;
    const Status status = add_probing_path(
        options, tool, [&] { return open_sequence(options); }, input);
    if (!status) return status.error();
    if (!options.device.empty()) {
      const double duration = input.path.back().time;
      input.source = std::make_unique<HeldFrames>(std::move(input.source), duration);
    }
    return input;
  }
  if (input.path.empty() && is_aimed(options.aim)) {
    const auto open = [&] { return open_scene(options, options.duration); };
    if (const Status status = add_probing_path(options, tool, open, input); !status)
      return status.error();
  } else if (input.path.empty()) {
    const auto scene = scenes::make_scene(options.scene);
    if (!scene) return scene.error();
    for (std::size_t i = 0; i < scene->path_times.size(); ++i) {
      input.path.push_back({scene->path_times[i], scene->path_poses[i]});
    }
  }
  // A hand takes its time.
  constexpr double kLongest = 86400;
  const bool is_live = !options.device.empty();
  auto source = open_scene(
      options, is_live && !options.duration ? std::optional(kLongest) : options.duration);
  if (!source) return source.error();
  input.source = *std::move(source);
  return input;
}

/// A run must not replace what it reads.
Status check_inputs(const Options& options) {
  std::vector<std::string> inputs{options.tool, options.depth_sequence, options.path};
  for (const ObjectOption& object : options.objects) inputs.push_back(object.file);
  for (const std::string& input : inputs) {
    if (!input.empty() && lies_inside(input, options.output)) {
      return Error{Errc::io_failure, "the run would replace " + options.output +
                                         ", where its input " + input +
                                         " lies: give another folder"};
    }
  }
  return Done{};
}

/// Of a path and, beyond these, of a hand.
SettingTable all_settings(Options& options) {
  SettingTable table = settings_of(options.settings);
  for (const Setting& setting : settings_of(options.haptic)) {
    if (table.find(setting.key()) == nullptr) table.add(setting);
  }
  return table;
}

Status run(const Options& options) {
  if (!options.settings_read) return options.settings_read;
  if (const Status status = check_inputs(options); !status) return status;
  const auto tool =
      load_tool_prefix(options.tool, options.num_spheres, options.settings.num_threads);
  if (!tool) return tool.error();
  auto objects = load_objects(options.objects);
  if (!objects) return objects.error();
  auto input = open_input(options, *tool);
  if (!input) return input.error();
  const std::vector<TimedPose>& path = input->path;
  if (!options.device.empty()) {
    return touch_live(
        {options.device, options.haptic, options.settings, options.duration, options.output,
         options.json, options.has_page ? std::optional(options.page) : std::nullopt, input->probe},
        *tool, *input->source, path);
  }
  if (path.empty()) {
    return Error{Errc::bad_input,
                 "scene " + options.scene + " has no path of its own: give --path"};
  }
  const double path_start = path.front().time, path_length = path.back().time - path_start;
  const DepthStreamInfo& info = input->source->info();

  // Unless told, the run ends with path or frames, whichever end first; a path of one pose has no
  // end of its own.
  RunSettings settings = options.settings;
  settings.objects = *std::move(objects);
  // A probe of a few frames goes on at the last one.
  settings.end_with_source = !options.duration && !input->probe;
  settings.probe = input->probe;
  if (options.duration) {
    settings.duration = *options.duration;
  } else if (path_length > 0) {
    settings.duration = path_length;
  } else if (!info.num_frames) {
    return Error{Errc::bad_input,
                 "neither the path nor the frames end by themselves: give --duration"};
  }
  double expected = settings.duration;
  if (settings.end_with_source && info.num_frames) {
    expected = std::min(expected, *info.num_frames / info.rate);
  }

  const auto view = PathView::create(*tool, info, info.name);
  std::optional<OpenPage> page;
  RunCallbacks onlooker;
  if (options.has_page) {
    auto served = OpenPage::serve(*view, options.page, std::cerr);
    if (!served) return served.error();
    page = *std::move(served);
    onlooker = view->callbacks([] { return !interrupted(); });
  }
  catch_interrupts();
  Progress bar("touching");
  const auto keep_going = [&](const TickRecord& tick) {
    if (bar.due()) {
      char words[64];
      std::snprintf(words, sizeof words, "%.2f s, frame %d, %.2f cm3", tick.time, tick.frame,
                    tick.penetration.volume * 1e6);
      bar.update(tick.time / expected, words);
    }
    return !interrupted();
  };
  const PoseFunction X_WT = [&](std::size_t, double time) {
    return pose_at(path, path_start + time);
  };
  const auto outcome =
      record_run(*tool, *input->source, X_WT, settings, options.output, keep_going, onlooker);
  view->end();
  if (page) page->say_goodbye();
  if (!outcome) return outcome.error();

  if (!outcome->warning.empty()) std::cerr << "palpate: " << outcome->warning << "\n";
  const RunLog& log = outcome->log;
  note_backend(log.why_not_cuda);
  const double deepest = log.ticks[log.deepest_tick].penetration.volume;
  const bool is_complete = !log.interrupted && log.failure.empty();
  if (options.json && is_complete) {
    std::cout << outcome->summary_json;
  } else if (!options.json) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "%zu ticks, %zu frames, deepest %.4g cm3 (%.2f %% of the tool) at %.3f s\n",
                  log.ticks.size(), log.frames.size(), deepest * 1e6,
                  100 * deepest / full_volume(*tool, log.settings.contact),
                  log.ticks[log.deepest_tick].time);
    std::cout << text;
    if (!log.settings.objects.empty()) {
      double most = 0;
      for (const TickRecord& tick : log.ticks) most = std::max(most, tick.objects.volume);
      std::snprintf(text, sizeof text, "deepest in objects %.4g cm3\n", most * 1e6);
      std::cout << text;
    }
    if (log.settings.probe) {
      const ProbeChoice& probe = *log.settings.probe;
      std::snprintf(text, sizeof text, "probed the pixel %.0f,%.0f at %.3f, %.3f, %.3f m; ",
                    probe.u, probe.v, probe.p_W.x, probe.p_W.y, probe.p_W.z);
      std::cout << text << kHowToAim << "\n";
    }
    std::cout << "report: " << (std::filesystem::path(options.output) / "report.html").string()
              << "\n";
  }
  if (log.interrupted) {
    return Error{Errc::cancelled, "interrupted; the run so far is complete in " + options.output};
  }
  if (!log.failure.empty()) {
    return Error{Errc::unavailable, log.failure + "; the run so far is in " + options.output};
  }
  return Done{};
}

/// Numbers with commas between them; none: it is not that.
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

/// What a path that is not given touches.
void add_aim_options(CLI::App& app, const std::shared_ptr<Options>& options) {
  const std::string group = "Without --path: what the tool probes";
  const std::string places = "a pixel u,v of the depth image or a point x,y,z in metres";
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
         places + "; default: the nearest place near the middle that is seen well")
      ->type_name("u,v|x,y,z")
      ->group(group);
  const std::string tips = "a point x,y,z of the tool in metres, in the frame of its mesh";
  app.add_option_function<std::string>(
         "--tip",
         [options, tips](const std::string& text) {
           const std::vector<double> tip = parse_place(text);
           if (tip.size() != 3) usage_error("--tip: must be " + tips + ", not '" + text + "'");
           options->aim.tip_T = Vec3d{tip[0], tip[1], tip[2]};
         },
         tips + ": this end leads; default: the thinnest end")
      ->type_name("x,y,z")
      ->group(group);
}

/// Of the page that is shown meanwhile.
void add_view_options(CLI::App& app, Options& options) {
  app.add_flag("--view", options.has_page,
               "show the run in a browser meanwhile; without --device at the pace of the clock");
  add_page_options(app, "--view-", options.page);
}

void check_view(const CLI::App& app, const Options& options) {
  for (const char* option : {"--view-port", "--view-address", "--view-token"}) {
    if (app.count(option) > 0 && !options.has_page) {
      usage_error(std::string("touch: ") + option + " goes with --view");
    }
  }
}

/// What goes with a device and what with a path.
void check_motion(const CLI::App& app, const Options& options) {
  if (!options.path.empty() && is_aimed(options.aim)) {
    usage_error(
        "touch: --probe and --tip do not go with --path, which says where the tool moves: leave "
        "one of them out");
  }
  if (options.device.empty()) {
    for (const char* option : {"--settings", "--coupling", "--dead-man"}) {
      if (app.count(option) > 0) {
        usage_error(std::string("touch: ") + option + " goes with --device");
      }
    }
    for (const std::string& text : app["--set"]->results()) {
      if (text.starts_with("coupling.") || text.starts_with("safety.")) {
        usage_error("touch: --set " + text + " goes with --device");
      }
    }
    return;
  }
  if (!options.path.empty()) {
    usage_error(
        "touch: --path does not go with --device, where the hand moves the tool; to play a path "
        "give --device replay:FILE");
  }
  if (!options.objects.empty()) {
    usage_error("touch: --object does not go with --device: live, only depth images are felt");
  }
}

void check(const Options& options) {
  if (options.depth_sequence.empty() == options.scene.empty()) {
    usage_error("touch: give one of --depth-sequence and --scene");
  }
  if (!options.depth_sequence.empty() && !options.camera.intrinsics) {
    usage_error("touch: --depth-sequence needs --intrinsics fx,fy,cx,cy");
  }
  if (options.scene.empty()) {
    if (!options.noise) usage_error("touch: --no-noise goes with --scene");
    return;
  }
  std::string names;
  bool known = false;
  for (const std::string& name : scenes::scene_names()) {
    names += (names.empty() ? "" : ", ") + name;
    known = known || name == options.scene;
  }
  if (!known) {
    usage_error("touch: there is no scene '" + options.scene + "'; choose one of " + names);
  }
}

/// Live: a device instead of a path.
void add_device_options(CLI::App& app, const std::shared_ptr<Options>& options) {
  const std::string group = "Live, with a haptic device";
  app.add_option("--device", options->device,
                 "run live with the tool in the hand: sim[:MODEL], replay:FILE, spacenav, "
                 "haply[:URL], forcedimension, openhaptics, vrpn:NAME@HOST; palpate devices tells "
                 "what is there")
      ->type_name("DEVICE")
      ->group(group);
  // Read when it is met, so that all other options win over the file.
  app.add_option_function<std::string>(
         "--settings",
         [options](const std::string& path) {
           options->settings_read = read_settings_file(path, all_settings(*options));
         },
         "settings of surfaces, contact, loop, coupling and safety; other options win over it")
      ->trigger_on_parse()
      ->type_name("FILE.toml")
      ->group(group);
  add_setting_options(app, group, all_settings(*options), kHandOptions);
  app.add_flag_callback(
         "--print-settings",
         [] {
           Options defaults;
           throw CLI::CallForVersion(settings_toml(all_settings(defaults)), 0);  // ends well
         },
         "print a settings file with the defaults, each explained, and do nothing else")
      ->group(group);
}

}  // namespace

void add_touch(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand(
      "touch", "Move a tool through a stream of depth images and record what it feels.");
  app.add_option("tool", options->tool, "tool file")->required()->type_name("TOOL.palp");
  app.add_option("-o,--output", options->output, "folder of the run: new, empty or an earlier run")
      ->required()
      ->type_name("RUN");
  app.add_option("--depth-sequence", options->depth_sequence,
                 "folder of 16-bit PNGs, with depth.txt of time stamps or in name order")
      ->type_name("DIR");
  add_camera_options(app, options->camera);
  add_number(app, "--depth-rate", options->depth_rate, {0.01, 10000, "Hz"},
             "frames per second without time stamps");
  std::string names;
  for (const std::string& name : scenes::scene_names()) names += (names.empty() ? "" : ", ") + name;
  app.add_option("--scene", options->scene,
                 "simulated camera: " + names + "; palpate scenes tells more")
      ->type_name("NAME");
  app.add_flag_callback(
      "--no-noise", [options] { options->noise = false; }, "a perfect simulated camera");
  add_seed_option(app, options->seed, "of the simulated noise");
  app.add_option(
         "--path", options->path,
         "poses of the tool: lines 't tx ty tz qx qy qz qw'; default: the scene's, or a probe "
         "at one place, see --probe")
      ->type_name("FILE");
  app.add_option("--duration", options->duration, "seconds; default: until path or frames end")
      ->check(CLI::Range(1e-3, 86400.0));
  const SettingTable table = all_settings(*options);
  add_setting_options(app, "", table, kLoopOptions);
  add_prefix_option(app, options->num_spheres);
  add_object_option(app, options->objects);
  add_setting_options(app, "", table, kContactOptions);
  add_threads_option(app, options->settings.num_threads, kThreadsHelp);
  add_setting_options(app, "From depth to surface", table, kSurfaceOptions);
  add_setting_options(app, "Between depth images", table, kTimeOptions);
  add_set_option(app, table);
  add_aim_options(app, options);
  add_device_options(app, options);
  add_view_options(app, *options);
  app.add_flag("--json", options->json, "print the summary as JSON");
  app.footer(
      "Example: palpate touch drill.palp --depth-sequence frames/ --intrinsics "
      "525,525,319.5,239.5 -o run1\n"
      "Example: palpate touch drill.palp --scene sphere-out-480 --device sim --duration 4 -o "
      "live1\n"
      "Example: palpate touch --print-settings > haptics.toml");
  app.callback([options, &app, &action] {
    check_motion(app, *options);
    check_view(app, *options);
    check(*options);
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
