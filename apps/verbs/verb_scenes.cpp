// palpate scenes: lists the simulated scenes.

#include <cstdio>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/options.h"
#include "apps/tool_info.h"
#include "apps/verbs.h"
#include "scenes/scene.h"

namespace palpate::apps {
namespace {

Status run(bool as_json) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  std::string text;
  for (const std::string& name : scenes::scene_names()) {
    const auto scene = scenes::make_scene(name);
    if (!scene) return scene.error();
    list.push_back({{"name", name},
                    {"title", scene->title},
                    {"tool", {{"shape", scene->tool_shape}, {"size", scene->tool_size}}},
                    {"duration", scene->duration}});
    char line[200];
    std::snprintf(line, sizeof line, "%-15s %-11s %5.3g mm  %s\n", name.c_str(),
                  scene->tool_shape.c_str(), scene->tool_size * 1000, scene->title.c_str());
    text += line;
  }
  if (as_json) {
    print_json({{"scenes", list}});
  } else {
    std::cout << text
              << "\nEach scene has a path for the tool in its line. Make it with palpate shape and "
                 "palpate "
                 "pack, e.g.\n  palpate shape stylus --size 0.12 -o stylus.stl\n  palpate pack "
                 "stylus.stl -o stylus.palp\nOther tools work, too.\n";
  }
  return Done{};
}

}  // namespace

void add_scenes(CLI::App& program, Action& action) {
  const auto as_json = std::make_shared<bool>(false);
  CLI::App& app = *program.add_subcommand(
      "scenes", "List the simulated scenes for touch --scene, each with a tool that fits.");
  app.add_flag("--json", *as_json, "print it as JSON");
  app.footer("Example: palpate scenes");
  app.callback([as_json, &action] { action = [as_json] { return run(*as_json); }; });
}

}  // namespace palpate::apps
