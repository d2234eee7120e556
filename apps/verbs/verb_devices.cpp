// palpate devices: lists the haptic devices that can be used here.

#include <algorithm>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "palpate/devices/devices.h"

namespace palpate::apps {
namespace {

Status run(bool json, bool has_details) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  std::vector<FoundDevice> all = find_devices();
  if (!json) std::ranges::stable_partition(all, &FoundDevice::is_usable);
  for (const FoundDevice& found : all) {
    if (json) {
      list.push_back({{"uri", found.uri},
                      {"kind", found.kind},
                      {"usable", found.is_usable},
                      {"what", found.what},
                      {"hint", found.hint}});
      continue;
    }
    print_kind(found.is_usable, found.kind, found.what);
    if (!has_details) continue;
    std::cout << "    " << found.uri << ": " << found.what << "\n";
    if (!found.hint.empty()) std::cout << "    " << found.hint << "\n";
  }
  if (json) print_json({{"devices", list}});
  if (!json && !has_details) std::cout << "palpate devices -v: forms, what was tried, what to do\n";
  return Done{};
}

}  // namespace

void add_devices(CLI::App& program, Action& action) {
  const auto json = std::make_shared<bool>(false);
  CLI::App& app = *program.add_subcommand(
      "devices", "List haptic devices; '-' marks those that cannot be used.");
  app.add_flag("--json", *json, "print the list as JSON");
  const auto has_details = add_details_flag(app);
  app.footer("Example: palpate devices");
  app.callback([json, has_details, &action] {
    action = [json, has_details] { return run(*json, *has_details); };
  });
}

}  // namespace palpate::apps
