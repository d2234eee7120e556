// Every setting of every table through every way in: both ends of its range are taken, what lies
// just beyond is refused with a sentence that says name, value, range and unit. And the tables in
// the documentation are those of the program.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apps/options.h"
#include "palpate/cameras/cameras.h"
#include "palpate/packing/packing.h"
#include "palpate/run/run_loop.h"
#include "palpate/session/run.h"
#include "src/bodies/internal/moving_bodies.h"
#include "src/run/internal/pipeline.h"
#include "src/session/internal/settings_json.h"
#include "src/viewer/protocol/controls.h"
#include "tests/run/live_loop_fixtures.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
inline namespace v0 {

/// Sets numbers as a user of the library can: without a check.
struct UncheckedSetting {
  static void set(Setting& setting, double value) {
    if (setting.kind == SettingKind::whole) {
      *static_cast<int*>(setting.value_) = static_cast<int>(value);
    } else {
      *static_cast<double*>(setting.value_) = value;
    }
  }
};

}  // namespace v0
}  // namespace palpate

namespace palpate {
namespace {

using Json = nlohmann::ordered_json;

struct Probe {
  SettingValue value;
  bool is_good = true;
};

/// Both ends and just beyond; of words all, and one that is none.
std::vector<Probe> probes_of(const Setting& setting) {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  const auto& [low, high, unit] = setting.range;
  std::vector<Probe> probes;
  const auto add = [&](const auto& value, bool is_good) { probes.push_back({value, is_good}); };
  switch (setting.kind) {
    case SettingKind::flag:
      for (const bool flag : {true, false}) add(flag, true);
      break;
    case SettingKind::whole:
      for (const double good : {low, high}) add(good, true);
      for (const double bad : {low - 1, high + 1}) add(bad, false);
      break;
    case SettingKind::number:
      for (const double good : {low, high}) add(good, true);
      for (const double bad :
           {std::nextafter(low, -kFar), std::nextafter(high, kFar), -kFar, kFar, std::nan("")}) {
        add(bad, false);
      }
      break;
    case SettingKind::word:
      for (const char* word : setting.words) add(std::string(word), true);
      for (const char* word : {"no-such-word", ""}) add(std::string(word), false);
      break;
    case SettingKind::pose:
      add(Pose{{1000, -1000, 0}, {0, 0, 1, 0}}, true);
      add(Pose{{1000.1, 0, 0}, {}}, false);
      add(Pose{{}, {0, 0, 0, 1.1}}, false);
      break;
  }
  return probes;
}

bool is_number(const Setting& setting) {
  return setting.kind == SettingKind::whole || setting.kind == SettingKind::number;
}

std::string text_of(const SettingValue& value) {
  if (const bool* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  if (const double* number = std::get_if<double>(&value)) return shortest_decimal(*number);
  if (const auto* word = std::get_if<std::string>(&value)) return *word;
  std::string text;
  for (const double v : seven_numbers(std::get<Pose>(value))) {
    text += (text.empty() ? "" : ",") + shortest_decimal(v);
  }
  return text;
}

/// The sentence says what the setting is, what it takes and what it got.
void expect_sentence(const std::string& message, const std::string& name, const Setting& setting,
                     const Probe& probe) {
  EXPECT_NE(message.find(name), std::string::npos) << message;
  EXPECT_NE(message.find(setting.accepted()), std::string::npos) << message;
  if (std::holds_alternative<Pose>(probe.value)) return;
  EXPECT_NE(message.find(text_of(probe.value)), std::string::npos) << message;
}

/// Calls way(key, value) -> Result<RunSettings> for all probes of the settings that it has.
template <class Way>
void walk(
    Way way, bool (*has)(const Setting&) = [](const Setting&) { return true; }) {
  const RunSettings defaults;
  int num = 0;
  for (const Setting& setting : settings_of(defaults)) {
    if (!has(setting)) continue;
    for (const Probe& probe : probes_of(setting)) {
      SCOPED_TRACE(setting.key() + " = " + text_of(probe.value));
      const Result<RunSettings> result = way(setting, probe.value);
      ASSERT_EQ(result.has_value(), probe.is_good)
          << (result ? "taken" : result.error().message.c_str());
      if (!result) {
        expect_sentence(result.error().message, setting.key(), setting, probe);
      } else {
        EXPECT_EQ(settings_of(*result).find(setting.key())->get(), probe.value);
      }
      ++num;
    }
  }
  EXPECT_GT(num, 40);
}

TEST(Settings, DefaultsAreInTheirRanges) { EXPECT_TRUE(check_settings(RunSettings{})); }

TEST(Settings, ThroughTheLibrary) {
  const test::ScriptedDevice device({});
  test::WallSource source({});
  const auto index = ToolIndex::create(test::box_tool());
  const auto make = [&](const Setting& which, const SettingValue& value) -> Result<RunSettings> {
    RunSettings settings;
    SettingTable table = settings_of(settings);
    // One has to give way to the other.
    if (which.key() == "surface.min_depth") settings.surface.max_depth = 1000;
    if (which.key() == "surface.max_depth") settings.surface.min_depth = 1e-3;
    if (which.key() == "field.thickness") settings.field.unseen = UnseenSpace::free;
    UncheckedSetting::set(*table.find(which.key()), std::get<double>(value));
    auto parts = make_run_parts(index, source.info(), device.info(), settings);
    if (!parts) return parts.error();
    if (auto filter = SafetyFilter::create(device.info().limits, settings.safety); !filter) {
      return filter.error();
    }
    return settings;
  };
  walk(make, is_number);
}

/// The parts of a run check their options without the rest, too.
TEST(Settings, ThroughThePartsOfTheLibrary) {
  const RunSettings defaults;
  const test::ScriptedDevice device({});
  const Intrinsics camera{100, 100, 20, 15};
  test::WallSource source({});
  for (const Setting& setting : settings_of(defaults)) {
    if (!is_number(setting)) continue;
    for (const Probe& probe : probes_of(setting)) {
      if (probe.is_good) continue;
      RunSettings s;
      SettingTable table = settings_of(s);
      UncheckedSetting::set(*table.find(setting.key()), std::get<double>(probe.value));
      std::optional<Error> error;
      const auto note = [&](const auto& result) {
        if (!result) error = result.error();
      };
      if (setting.section == "surface") note(SurfaceEstimator::create(40, 30, camera, s.surface));
      if (setting.section == "field") note(DepthField::create(40, 30, s.field));
      if (setting.section == "time") {
        note(SurfaceTimeline::create(source.info(), {.field = std::nullopt, .time = s.time}));
      }
      if (setting.section == "coupling" || setting.section == "friction" ||
          setting.section == "texture") {
        note(
            check_coupling(s.coupling, device.info().limits, 1e-3, test::box_tool().sphere_mass()));
      }
      if (setting.section == "bodies") {
        note(MovingBodies::create({}, s.bodies, Place::cpu(), nullptr));
      }
      if (setting.section == "safety") note(SafetyFilter::create(device.info().limits, s.safety));
      if (setting.section == "loop" || setting.section == "window") continue;
      ASSERT_TRUE(error) << setting.key() << " = " << text_of(probe.value);
      expect_sentence(error->message, setting.key(), setting, probe);
    }
  }
}

TEST(Settings, ThroughAFile) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "settings.toml";
  walk([&](const Setting& setting, const SettingValue& value) {
    std::string text = text_of(value);
    if (std::holds_alternative<std::string>(value)) text = '"' + text + '"';
    if (std::holds_alternative<Pose>(value)) text = '[' + text + ']';
    std::ofstream(path) << "[" << setting.section << "]\n" << setting.name << " = " << text << "\n";
    auto loaded = load_settings<RunSettings>(path);
    if (!loaded) {
      EXPECT_NE(loaded.error().message.find("settings.toml line 2: "), std::string::npos);
    }
    return loaded;
  });
}

TEST(Settings, ThroughARecording) {
  const RunSettings defaults;
  walk([&](const Setting& setting, const SettingValue& value) -> Result<RunSettings> {
    Json json = to_json(settings_of(defaults));
    Json& node = json[std::string(setting.section)][std::string(setting.name)];
    if (const double* number = std::get_if<double>(&value)) {
      node = *number;
    } else if (const Pose* X = std::get_if<Pose>(&value)) {
      node = seven_numbers(*X);
    } else if (const bool* flag = std::get_if<bool>(&value)) {
      node = *flag;
    } else {
      node = std::get<std::string>(value);
    }
    RunSettings read;
    const Status status = read_json(settings_of(read), json);
    if (!status) return status.error();
    return read;
  });
  for (const char* pointer : {"/coupling/stiffness", "/safety"}) {
    Json json = to_json(settings_of(defaults));
    const Json::json_pointer where(pointer);
    json.at(where.parent_pointer()).erase(where.back());
    RunSettings read;
    EXPECT_NE(read_json(settings_of(read), json).error().message.find("lack"), std::string::npos);
    json = to_json(settings_of(defaults));
    json[where.parent_pointer()]["surprise"] = 7;
    EXPECT_NE(read_json(settings_of(read), json).error().message.find("surprise"),
              std::string::npos);
  }
}

TEST(Settings, ThroughThePage) {
  walk(
      [](const Setting& setting, const SettingValue& value) -> Result<RunSettings> {
        RunSettings settings;
        Json json;
        std::visit(
            [&](const auto& plain) {
              if constexpr (!std::same_as<std::decay_t<decltype(plain)>, Pose>) json = plain;
            },
            value);
        const auto taken = set_control(settings_of(settings), is_live_control, setting.key(), json);
        if (!taken) return taken.error();
        return settings;
      },
      [](const Setting& setting) { return is_live_control(setting); });
  RunSettings settings;
  const auto refused = set_control(settings_of(settings), is_live_control, "safety.max_slew", 5);
  EXPECT_NE(refused.error().message.find("safety.max_slew cannot change"), std::string::npos);
}

/// Parses settings from a command line; an error is the text that the user reads.
Result<RunSettings> parse(std::vector<std::string> words) {
  RunSettings settings;
  const SettingTable table = settings_of(settings);
  CLI::App app;
  apps::add_set_option(app, table);
  for (const auto& options : {std::span<const apps::SettingOption>(apps::kContactOptions),
                              {apps::kSurfaceOptions},
                              {apps::kTimeOptions},
                              {apps::kLoopOptions},
                              {apps::kHandOptions}}) {
    apps::add_setting_options(app, "", table, options);
  }
  std::reverse(words.begin(), words.end());
  try {
    app.parse(words);
  } catch (const CLI::ParseError& error) {
    return Error{Errc::invalid_argument, error.what()};
  }
  return settings;
}

TEST(Settings, ThroughSetOnTheCommandLine) {
  walk([](const Setting& setting, const SettingValue& value) {
    return parse({"--set", setting.key() + "=" + text_of(value)});
  });
  EXPECT_NE(parse({"--set", "coupling.stifness=3"}).error().message.find("'coupling.stiffness'"),
            std::string::npos);
  EXPECT_FALSE(parse({"--set", "coupling.stiffness"}));
  EXPECT_FALSE(parse({"--set", "surface.filter=yes"}));
  EXPECT_FALSE(parse({"--set", "surface.filter_radius=2.0"}));
  EXPECT_FALSE(parse({"--set", "surface.min_depth=0.1 0.2"}));
  EXPECT_EQ(parse({"--set", "coupling.stiffness=800", "--set", "time.mode=predict"})->time.mode,
            TimeMode::predict);
}

TEST(Settings, ThroughTheirOwnOptionsOnTheCommandLine) {
  const RunSettings defaults;
  const SettingTable table = settings_of(defaults);
  for (const auto& options : {std::span<const apps::SettingOption>(apps::kContactOptions),
                              {apps::kSurfaceOptions},
                              {apps::kTimeOptions},
                              {apps::kLoopOptions},
                              {apps::kHandOptions}}) {
    for (const auto& [flag, key] : options) {
      SCOPED_TRACE(flag);
      const Setting* const setting = table.find(key);
      ASSERT_NE(setting, nullptr);
      if (setting->kind == SettingKind::flag) {
        const auto parsed = parse({flag});
        ASSERT_TRUE(parsed) << parsed.error().message;
        EXPECT_EQ(settings_of(*parsed).find(key)->get(),
                  SettingValue(!std::get<bool>(setting->get())));
        continue;
      }
      for (const Probe& probe : probes_of(*setting)) {
        const auto parsed = parse({flag, text_of(probe.value)});
        ASSERT_EQ(parsed.has_value(), probe.is_good) << text_of(probe.value);
        if (parsed) {
          EXPECT_EQ(settings_of(*parsed).find(key)->get(), probe.value);
        } else {
          expect_sentence(parsed.error().message, std::string(flag) + ": must be ", *setting,
                          probe);
        }
      }
    }
  }
}

// Limits of a packing

TriangleMesh tetrahedron() {
  return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
          {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
}

TEST(PackingLimits, ThroughTheLibrary) {
  const PackOptions defaults;
  EXPECT_TRUE(check_settings(defaults));
  for (const Setting& limit : settings_of(defaults)) {
    for (const Probe& probe : probes_of(limit)) {
      SCOPED_TRACE(limit.key() + " = " + text_of(probe.value));
      PackOptions options;
      options.progress = [](const PackProgress&) { return false; };
      UncheckedSetting::set(*settings_of(options).find(limit.key()), std::get<double>(probe.value));
      const auto packing = pack_spheres(tetrahedron(), options);
      if (probe.is_good) {  // and cancelled, or already at an end
        EXPECT_TRUE(packing || packing.error().code != Errc::invalid_argument);
      } else {
        ASSERT_FALSE(packing);
        expect_sentence(packing.error().message, limit.key(), limit, probe);
      }
    }
  }
}

TEST(PackingLimits, ThroughTheirOptionsOnTheCommandLine) {
  for (const auto& [flag, key] : apps::kPackLimits) {
    PackOptions options;
    const SettingTable table = settings_of(options);
    const Setting* const limit = table.find(key);
    ASSERT_NE(limit, nullptr) << key;
    for (const Probe& probe : probes_of(*limit)) {
      SCOPED_TRACE(flag + (" " + text_of(probe.value)));
      CLI::App app;
      apps::add_setting_options(app, "", table, apps::kPackLimits);
      std::vector<std::string> words{text_of(probe.value), flag};
      try {
        app.parse(words);
        EXPECT_TRUE(probe.is_good);
        EXPECT_EQ(limit->get(), probe.value);
      } catch (const CLI::ParseError& error) {
        EXPECT_FALSE(probe.is_good) << error.what();
        expect_sentence(error.what(), std::string(flag) + ": must be ", *limit, probe);
      }
    }
  }
}

// Files that are no settings

std::string file_error(const std::string& text) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "settings.toml";
  std::ofstream(path, std::ios::binary) << text;
  const auto loaded = load_settings<RunSettings>(path);
  return loaded ? "" : loaded.error().message;
}

std::string repeated(const std::string& part, int num) {
  std::string text;
  for (int i = 0; i < num; ++i) text += part;
  return text;
}

// As people write "no limit".
TEST(SettingsFile, WholeNumbersBeyondThoseOfADoubleAreNumbers) {
  EXPECT_NE(file_error("[surface]\nmax_depth = 9007199254740993\n").find("max_depth must be"),
            std::string::npos)
      << file_error("[surface]\nmax_depth = 9007199254740993\n");
}

TEST(SettingsFile, KeysThatNestWithoutEndAreRefused) {
  // The parser builds and frees tables by recursion.
  for (const int num : {600, 20000, 200000}) {
    EXPECT_NE(file_error("[a" + repeated(".a", num) + "]\n"), "") << num;
    EXPECT_NE(file_error("a" + repeated(".a", num) + " = 1\n"), "") << num;
    EXPECT_NE(file_error("x = " + repeated("[", num) + repeated("]", num) + "\n"), "") << num;
    EXPECT_NE(file_error("x = {a" + repeated(".a", num) + " = 1}\n"), "") << num;
  }
  EXPECT_NE(file_error("\n[a" + repeated(".a", 600) + "]\n").find("line 2"), std::string::npos);
}

TEST(SettingsFile, LettersBeyondAsciiAreFineInCommentsOnly) {
  EXPECT_EQ(
      file_error("\xEF\xBB\xBF# \xC3\xBC\xCF\xA0 \xFF\n[coupling]\nstiffness = 8 # \xC3\xBC\n"),
      "");
  for (const char* text :
       {"\xCF\xA0 = 1\n", "\xCF\xA0", "[\xCF\xA0]\n", "[coupling]\n\xC3\xBC = 1\n",
        "[coupling]\nkind = \"\xC3\xBC\"\n", "\xFF\xFE\n"}) {
    EXPECT_NE(file_error(text), "") << text;
  }
}

// The documentation

std::string option_of(const std::string& key) {
  for (const auto& options : {std::span<const apps::SettingOption>(apps::kContactOptions),
                              {apps::kSurfaceOptions},
                              {apps::kTimeOptions},
                              {apps::kLoopOptions},
                              {apps::kHandOptions},
                              {apps::kRobotOptions},
                              {apps::kPackLimits}}) {
    for (const auto& [flag, name] : options) {
      if (key == name) return std::string("`") + flag + "`";
    }
  }
  return key == "loop.threads"      ? "`--threads`"
         : key == "packing.spheres" ? "`--spheres`, also `auto`"
                                    : "";
}

std::string documented_value(const Setting& setting) {
  return setting.kind == SettingKind::pose ? "identity" : "`" + text_of(setting.get()) + "`";
}

std::string documentation() {
  RunSettings of_runs;
  of_runs.objects.resize(1);
  of_runs.objects[0].name = "NAME";
  const SelfFilterOptions of_robots;
  const PackOptions of_packings;
  std::string text;
  std::string_view section;
  const auto describe = [&](const Setting& setting, const char* last_title, const char* last) {
    if (setting.section != section) {
      section = setting.section;
      text += "\n## [" + std::string(section) + "]\n\n" +
              "| key | default | can be | means | option | " + last_title +
              " |\n|---|---|---|---|---|---|\n";
    }
    text += "| `" + std::string(setting.name) + "` | " + documented_value(setting) + " | " +
            setting.range_text() + " | " + std::string(setting.help) + " | " +
            option_of(setting.key()) + " | " + last + " |\n";
  };
  for (const Setting& setting : settings_of(of_runs)) {
    describe(setting, "while a hand is on it",
             is_fixed_while_running(setting) ? "fixed" : "can change");
  }
  for (const Setting& setting : settings_of(of_robots)) describe(setting, "of", "`--robot`");
  for (const Setting& setting : settings_of(of_packings)) describe(setting, "of", "`pack`");
  return text + "\n";
}

TEST(Settings, AreInTheDocumentation) {
  const std::string path = PALPATE_SOURCE_DIR "/docs/settings.md";
  const std::string begin = "<!-- settings: begin -->\n", end = "<!-- settings: end -->";
  std::stringstream content;
  content << std::ifstream(path).rdbuf();
  std::string page = content.str();
  const std::size_t from = page.find(begin), to = page.find(end);
  ASSERT_TRUE(from < to && to != std::string::npos) << path << " lacks the marks of the tables";
  const std::size_t start = from + begin.size();
  if (std::getenv("PALPATE_WRITE_DOCS") != nullptr) {
    page.replace(start, to - start, documentation());
    ASSERT_TRUE(std::ofstream(path) << page);
  } else {
    EXPECT_EQ(page.substr(start, to - start), documentation())
        << path << " is not what the tables say: rewrite it with\n"
        << "  PALPATE_WRITE_DOCS=1 build/release/bin/test_settings_ways_in";
  }
}

}  // namespace
}  // namespace palpate
