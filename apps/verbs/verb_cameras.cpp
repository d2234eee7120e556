// palpate cameras: lists and tests the depth cameras that can be used here.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/options.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/cameras/cameras.h"
#include "palpate/version.h"

namespace palpate::apps {
namespace {

std::string joined(const std::vector<std::string>& texts) {
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + text;
  return all;
}

/// Prints the form of the URI, the library, and all that was tried.
void print_details(const FoundCameras& found) {
  std::cout << "    " << found.usage << ": " << found.reason << "\n";
  if (!found.library.empty()) {
    std::cout << "    " << found.library;
    if (!found.version.empty()) std::cout << ", version " << found.version;
    std::cout << "\n";
  }
  if (!found.devices.empty()) std::cout << "    " << joined(found.devices) << "\n";
}

Status run(bool json, bool has_details) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  std::vector<FoundCameras> all = find_cameras();
  if (!json) std::ranges::stable_partition(all, &FoundCameras::is_usable);
  for (const FoundCameras& found : all) {
    if (json) {
      list.push_back({{"kind", found.kind},
                      {"usable", found.is_usable},
                      {"library", found.library},
                      {"version", found.version},
                      {"devices", found.devices},
                      {"live", found.is_live},
                      {"reason", found.reason},
                      {"usage", found.usage}});
      continue;
    }
    const bool has_cameras = found.kind != "scene" && !found.devices.empty();
    print_kind(found.is_usable, found.kind, has_cameras ? joined(found.devices) : found.reason);
    if (has_details) print_details(found);
  }
  if (!json && !has_details) std::cout << "palpate cameras -v: forms, libraries, what was tried\n";
  if (json) print_json(list);
  return Done{};
}

/// Returns the CPU time of the program, s of one core.
double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

/// Prints a report on the frames of a camera over a few seconds, for bug reports.
Status try_camera(const std::string& uri, double seconds) {
  auto source = open_camera(uri);
  if (!source) return source.error();
  const DepthStreamInfo& info = (*source)->info();
  const auto& [fx, fy, cx, cy] = info.intrinsics;
  std::printf("%s: %d x %d at %g Hz, intrinsics %.6g,%.6g,%.6g,%.6g, %g m per count, sensor %s\n",
              uri.c_str(), info.width, info.height, info.rate, fx, fy, cx, cy, info.unit,
              name_of(info.sensor).c_str());
  DepthFrame next, frame;
  int num_frames = 0;
  double first = 0, last = 0;
  std::vector<std::uint16_t> measured;
  using Clock = std::chrono::steady_clock;
  const auto since = [](Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  };
  const auto begin = Clock::now();
  const double cpu_begin = cpu_seconds();
  while (since(begin) < seconds) {
    const auto got = (*source)->next(next);
    if (!got) return got.error();
    if (!*got) break;
    std::swap(frame, next);
    if (num_frames++ == 0) first = frame.timestamp;
    last = frame.timestamp;
  }
  const double share = (cpu_seconds() - cpu_begin) / since(begin);
  for (const std::uint16_t count : frame.pixels) {
    if (count != 0 && count != 65535) measured.push_back(count);
  }
  if (num_frames == 0 || measured.empty()) {
    return Error{Errc::bad_input, uri + " has sent no measurement"};
  }
  const auto middle = measured.begin() + static_cast<std::ptrdiff_t>(measured.size() / 2);
  std::nth_element(measured.begin(), middle, measured.end());
  std::printf(
      "  %d frames in %.2f s by their time stamps; the last one: %.1f %% measured, %.3f m "
      "away in the middle\n",
      num_frames, last - first,
      100.0 * static_cast<double>(measured.size()) / static_cast<double>(frame.pixels.size()),
      *middle * frame.unit);
  if (info.is_live) std::printf("  reading it takes %.1f %% of a core\n", 100 * share);
  (*source)->cancel();
  for (const std::string& note : (*source)->take_notes()) std::printf("  %s\n", note.c_str());
  return Done{};
}

/// Tests all cameras that are connected, or those named; continues after errors.
Status self_test(std::vector<std::string> uris, double seconds) {
  const bool is_all = uris.empty();
  std::cout << "palpate " PALPATE_VERSION "\n";
  for (const FoundCameras& found : find_cameras()) {
    if (!found.library.empty()) {
      std::cout << found.kind << ": " << found.library << ", version " << found.version << "\n";
    }
    if (found.is_live && is_all) {
      uris.insert(uris.end(), found.devices.begin(), found.devices.end());
    }
  }
  std::cout.flush();
  if (uris.empty()) {
    return Error{Errc::not_found,
                 "no camera is plugged in; palpate cameras -v says what was tried"};
  }
  std::string failed;
  for (const std::string& uri : uris) {
    const Status tried = try_camera(uri, seconds);
    if (!tried) failed += (failed.empty() ? "" : "; ") + tried.error().message;
  }
  std::fflush(stdout);
  if (!failed.empty()) return Error{Errc::unavailable, failed};
  return Done{};
}

}  // namespace

void add_cameras(CLI::App& program, Action& action) {
  const auto json = std::make_shared<bool>(false);
  CLI::App& app = *program.add_subcommand(
      "cameras", "List depth cameras; '-' marks kinds that cannot be used.");
  app.alias("sensors");
  app.add_flag("--json", *json, "print the list as JSON");
  const auto has_details = add_details_flag(app);
  const auto uris = std::make_shared<std::vector<std::string>>();
  const auto tests = std::make_shared<bool>(false);
  CLI::Option* const self =
      app.add_flag("--selftest", *tests,
                   "take frames from every camera for a few seconds and report their properties");
  app.add_option("uri", *uris, "--selftest: only these")->type_name("URI")->needs(self);
  const auto seconds = std::make_shared<double>(5);
  add_number(app, "--seconds", *seconds, {0.1, 86400, "s"}, "--selftest: time per camera")
      ->type_name("SECONDS")
      ->needs(self);
  app.footer("Example: palpate cameras --selftest");
  app.callback([json, has_details, uris, tests, seconds, &action] {
    if (*tests && *json) usage_error("cameras: --json goes with the list, not with --selftest");
    action = [json, has_details, uris, tests, seconds] {
      return *tests ? self_test(*uris, *seconds) : run(*json, *has_details);
    };
  });
}

}  // namespace palpate::apps
