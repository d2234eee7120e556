// palpate cameras: which depth cameras can be used here.

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/cameras/open_camera.h"

namespace palpate::apps {
namespace {

Status run(bool json) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const FoundCameras& found : find_cameras()) {
    if (json) {
      list.push_back({{"kind", found.kind},
                      {"usable", found.is_usable},
                      {"library", found.library},
                      {"version", found.version},
                      {"devices", found.devices},
                      {"reason", found.reason},
                      {"usage", found.usage}});
      continue;
    }
    std::cout << (found.is_usable ? "  " : "- ") << found.usage << ": " << found.reason << "\n";
    if (!found.library.empty()) {
      std::cout << "    " << found.library;
      if (!found.version.empty()) std::cout << ", version " << found.version;
      std::cout << "\n";
    }
    std::string devices;
    for (const std::string& device : found.devices) {
      devices += (devices.empty() ? "" : ", ") + device;
    }
    if (!devices.empty()) std::cout << "    " << devices << "\n";
  }
  if (json) print_json(list);
  return Done{};
}

}  // namespace

void add_cameras(CLI::App& program, Action& action) {
  const auto json = std::make_shared<bool>(false);
  CLI::App& app = *program.add_subcommand(
      "cameras", "List depth cameras; '-' marks kinds that cannot be used, and says why.");
  app.alias("sensors");
  app.add_flag("--json", *json, "print the list as JSON");
  app.footer("Example: palpate cameras");
  app.callback([json, &action] { action = [json] { return run(*json); }; });
}

}  // namespace palpate::apps
