// palpate devices: lists the haptic devices that can be used here.

#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/devices/devices.h"

namespace palpate::apps {
namespace {

Status run(bool json) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const FoundDevice& found : find_devices()) {
    if (json) {
      list.push_back({{"uri", found.uri},
                      {"kind", found.kind},
                      {"usable", found.is_usable},
                      {"what", found.what},
                      {"hint", found.hint}});
      continue;
    }
    std::cout << (found.is_usable ? "  " : "- ") << found.uri << ": " << found.what << "\n";
    if (!found.hint.empty()) std::cout << "    " << found.hint << "\n";
  }
  if (json) print_json({{"devices", list}});
  return Done{};
}

}  // namespace

void add_devices(CLI::App& program, Action& action) {
  const auto json = std::make_shared<bool>(false);
  CLI::App& app = *program.add_subcommand(
      "devices", "List haptic devices; '-' marks those that cannot be used, with the reason.");
  app.add_flag("--json", *json, "print the list as JSON");
  app.footer("Example: palpate devices");
  app.callback([json, &action] { action = [json] { return run(*json); }; });
}

}  // namespace palpate::apps
