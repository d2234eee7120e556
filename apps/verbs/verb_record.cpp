// palpate record: records depth streams alone, as an MCAP file.

#include <atomic>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "apps/options.h"
#include "apps/output_files.h"
#include "apps/terminal/terminal.h"
#include "apps/tool_info.h"
#include "apps/touch/robot.h"
#include "apps/touch/sources.h"
#include "apps/verbs.h"
#include "palpate/cameras/cameras.h"
#include "palpate/field/sensor.h"
#include "src/session/internal/record_stream.h"

namespace palpate::apps {
namespace {

struct Options {
  std::vector<std::string> cameras;
  std::string output;
  RobotOptions robot;
  std::optional<double> duration;
  bool json = false;
};

/// Ends a wait for a camera that sends nothing on an interrupt.
class InterruptWatch {
 public:
  explicit InterruptWatch(const DepthSources& sources)
      : thread_([this, &sources]() noexcept {
          while (!is_over_ && !interrupted()) {
            std::this_thread::sleep_for(std::chrono::milliseconds(50));
          }
          if (!interrupted()) return;
          for (DepthSource* source : sources) source->cancel();
        }) {}
  ~InterruptWatch() {
    is_over_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> is_over_ = false;
  std::thread thread_;
};

Status run(const Options& options) {
  std::vector<std::unique_ptr<DepthSource>> opened;
  std::vector<DepthSource*> all;
  const std::vector<CameraUri> cameras = parse_camera_uris(options.cameras).value();
  if (const Status status = check_one_world(cameras); !status) return status;
  const auto filter = open_robot(options.robot, cameras);
  if (!filter) return filter.error();
  for (const CameraUri& camera : cameras) {
    std::error_code ignored;
    const bool is_file = std::filesystem::is_regular_file(camera.target, ignored);
    const std::string input = is_file ? camera.target : "";
    for (const std::string& file : {options.output, options.output + ".partial"}) {
      const Status status = check_output_file(file, OutputKind::recording, input);
      if (!status) return status;
    }
    auto source = open_camera(camera, opening(true, options.duration));
    if (source) source = without_robot(*filter, *std::move(source));
    if (!source) return source.error();
    all.push_back(source->get());
    opened.push_back(*std::move(source));
  }
  const DepthSources sources(std::move(all));
  catch_interrupts();
  Progress bar("recording");
  RecordStreamOptions recording;
  if (options.duration) recording.duration = *options.duration;
  recording.keep_going = [&](double seconds, std::uint64_t num_frames) {
    if (bar.due()) {
      char words[80];
      std::snprintf(words, sizeof words, "%.1f s, %llu frames; Ctrl-C ends it", seconds,
                    static_cast<unsigned long long>(num_frames));
      bar.update(options.duration ? std::optional(seconds / *options.duration) : std::nullopt,
                 words);
    }
    for (DepthSource* source : sources) {
      for (const std::string& note : source->take_notes()) print_beside_progress(note);
    }
    return !interrupted();
  };
  const auto done = [&] {
    const InterruptWatch watch(sources);
    return record_stream(sources, options.output, recording);
  }();
  print_kept();
  if (!done) return done.error();
  for (const std::string& note : done->notes) print_note(note);
  if (options.json) {
    print_json({{"file", options.output},
                {"frames", done->num_frames},
                {"frames_of", done->frames_of},
                {"seconds", done->seconds},
                {"bytes", done->num_bytes},
                {"notes", done->notes}});
    return Done{};
  }
  results() << done->num_frames << " frames of " << done->seconds << " s in " << options.output
            << ", " << done->num_bytes << " bytes\n";
  return Done{};
}

}  // namespace

void add_record(CLI::App& program, Action& action) {
  const auto options = std::make_shared<Options>();
  CLI::App& app = *program.add_subcommand(
      "record", "Record depth streams as an MCAP file, which --camera bag:FILE plays back.");
  app.add_option("--camera", options->cameras,
                 "depth stream; palpate cameras lists the kinds; repeat for several")
      ->required()
      ->type_name("URI");
  app.add_option("-o,--output", options->output, "the file to write")
      ->required()
      ->type_name("FILE.mcap");
  add_robot_options(app, options->robot);
  add_seconds_option(app, "--duration", options->duration,
                     "length of the recording; default: until the stream ends or Ctrl-C");
  app.add_flag("--json", options->json, "print what was recorded as JSON");
  app.footer("Example: palpate record --camera openni2 --duration 10 -o hand.mcap");
  app.callback([options, &app, &action] {
    check_robot(app, "record");
    const auto cameras = parse_camera_uris(options->cameras);
    if (!cameras) usage_error("--" + cameras.error().message);
    if (cameras->size() > kMaxCameras) {
      usage_error("record: at most " + std::to_string(kMaxCameras) + " cameras at once");
    }
    action = [options] { return run(*options); };
  });
}

}  // namespace palpate::apps
