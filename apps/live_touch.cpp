#include "apps/live_touch.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <utility>

#include "apps/options.h"
#include "apps/page.h"
#include "apps/terminal.h"
#include "palpate/devices/open_device.h"
#include "palpate/devices/simulated_device.h"
#include "palpate/viewer/views.h"

namespace palpate::apps {
namespace {

/// Devices have x to the right, y up and z towards the hand; cameras look along z with y down.
const Quaternion kDeviceInCamera{1, 0, 0, 0};

/// Puts the middle of the device where the path begins, and the tool into the hand as it is there.
void place(CouplingOptions& coupling, const std::vector<TimedPose>& path) {
  if (path.empty() || coupling.X_WB != Pose{} || coupling.X_HT != Pose{}) return;
  const Pose& X_WT = path.front().X_WT;
  coupling.X_WB = {X_WT.translation, kDeviceInCamera};
  coupling.X_HT.rotation = normalized(conjugate(kDeviceInCamera) * X_WT.rotation);
}

/// The hand that holds the tool at the poses of a path.
HandTarget follow(const std::vector<TimedPose>& path, const CouplingOptions& coupling) {
  const Pose X_BW = inverse(coupling.X_WB), X_TH = inverse(coupling.X_HT);
  return [&path, X_BW, X_TH, scale = coupling.motion_scale](double time) {
    Pose X_BH = X_BW * (pose_at(path, path.front().time + time) * X_TH);
    X_BH.translation = X_BH.translation / scale;
    return X_BH;
  };
}

bool is_simulated(const std::string& uri) { return uri == "sim" || uri.starts_with("sim:"); }

Result<std::unique_ptr<HapticDevice>> open(const std::string& uri,
                                           const std::vector<TimedPose>& path,
                                           const CouplingOptions& coupling) {
  const std::string model_name = is_simulated(uri) && uri.size() > 4 ? uri.substr(4) : "";
  const auto model = model_name.empty() ? device_models().front() : find_device_model(model_name);
  if (!is_simulated(uri) || path.empty() || !model) return open_device(uri);
  SimulatedDeviceOptions options;
  options.model = *model;
  options.target = follow(path, coupling);
  auto device = SimulatedDevice::create(options);
  if (!device) return device.error();
  return std::unique_ptr<HapticDevice>(*std::move(device));
}

/// The settings of the file with those of the command line.
Result<HapticSettings> joined(const LiveOptions& options, const Tool& tool) {
  HapticSettings settings = options.settings;
  copy_settings(settings_of(options.run), settings_of(settings));
  ThreadPool pool(1);
  const auto chosen = choose_contact_query(options.run, tool, pool);
  if (!chosen) return chosen.error();
  note_backend(chosen->why_not_cuda);
  settings.backend = chosen->backend;
  return settings;
}

}  // namespace

Status touch_live(const LiveOptions& options, const Tool& tool, DepthSource& source,
                  const std::vector<TimedPose>& path) {
  auto settings = joined(options, tool);
  if (!settings) return settings.error();
  place(settings->coupling, path);
  const auto device = open(options.device, path, settings->coupling);
  if (!device) return device.error();

  double duration = options.duration.value_or(std::numeric_limits<double>::infinity());
  if (!options.duration && is_simulated(options.device) && path.size() > 1) {
    duration = path.back().time - path.front().time;
  }
  if (!(*device)->info().senses_orientation) {
    std::cerr << "palpate: note: " << (*device)->info().name
              << " senses no orientation: the tool does not turn\n";
  }
  const auto view = LiveView::create(tool, source.info(), source.info().name);
  std::optional<OpenPage> page;
  if (options.page) {
    auto served = OpenPage::serve(*view, *options.page, std::cerr);
    if (!served) return served.error();
    page = *std::move(served);
  }
  catch_interrupts();
  Progress bar("touching");
  const auto start = std::chrono::steady_clock::now();
  const auto keep_going = [&] {
    if (bar.due()) {
      const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
      char words[64];
      std::snprintf(words, sizeof words, "%.1f s; Ctrl-C ends the run", elapsed.count());
      bar.update(std::isfinite(duration) ? elapsed.count() / duration : 0, words);
    }
    return !interrupted() && !view->wants_end();
  };
  const auto outcome =
      record_haptic_run(tool, source, **device, *settings, duration, options.output, keep_going,
                        page ? &view->onlooker() : nullptr, options.probe);
  if (page) page->say_goodbye();
  if (!outcome) return outcome.error();

  for (const std::string& text : outcome->warnings) std::cerr << "palpate: note: " << text << '\n';
  if (!outcome->failure.empty()) {
    return Error{Errc::unavailable, outcome->failure + "; the run so far is in " + options.output};
  }
  if (options.json) {
    std::cout << outcome->summary_json;
    return Done{};
  }
  const LoopReport& loop = outcome->loop;
  char text[160];
  std::snprintf(text, sizeof text,
                "%llu ticks, %llu queries, %llu frames in %.2f s; %llu ticks "
                "took too long\n",
                static_cast<unsigned long long>(loop.num_ticks),
                static_cast<unsigned long long>(loop.num_contacts),
                static_cast<unsigned long long>(loop.num_frames), loop.seconds,
                static_cast<unsigned long long>(loop.num_missed));
  std::cout << text
            << "report: " << (std::filesystem::path(options.output) / "report.html").string()
            << "\n";
  return Done{};
}

}  // namespace palpate::apps
