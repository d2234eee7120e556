// Files of settings of a run.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "palpate/session/run.h"
#include "src/session/internal/settings_json.h"
#include "tests/test_util/temporary_folder.h"

namespace palpate {
namespace {

using test::TemporaryFolder;

class RunSettingsFile : public testing::Test {
 protected:
  Result<RunSettings> load(const std::string& text) {
    const auto path = folder_.path() / "settings.toml";
    std::ofstream(path) << text;
    return load_settings<RunSettings>(path);
  }
  void expect_error(const std::string& text, std::initializer_list<const char*> mentions) {
    const auto loaded = load(text);
    ASSERT_FALSE(loaded) << text;
    for (const char* words : mentions) {
      EXPECT_NE(loaded.error().message.find(words), std::string::npos) << loaded.error().message;
    }
  }

  TemporaryFolder folder_;
};

TEST_F(RunSettingsFile, PrintedDefaultsReadBackToTheSame) {
  RunSettings settings;
  settings.coupling.tool_mass = 0.1 + 0.2;
  settings.coupling.kind = CouplingKind::proxy;
  settings.coupling.X_WB = {{1, -2, 0.125}, {0, 0, 1, 0}};
  settings.safety.dead_man = true;
  settings.contact.volumes = SphereVolumes::own;
  for (const RunSettings& some : {RunSettings{}, settings}) {
    const auto loaded = load(settings_toml(settings_of(some)));
    ASSERT_TRUE(loaded) << loaded.error().message;
    EXPECT_TRUE(has_same_settings(*loaded, some));
    RunSettings from_json;
    const Status read = read_json(settings_of(from_json), to_json(settings_of(some)));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_TRUE(has_same_settings(from_json, some));
  }
}

TEST_F(RunSettingsFile, SetsWhatItNames) {
  const auto loaded = load(
      "[coupling]\nkind = \"direct\"\nstiffness = 800  # whole numbers are numbers\n"
      "[safety]\nengage_ticks = 20\n[loop]\nreal_time = false\n");
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->coupling.kind, CouplingKind::direct);
  EXPECT_EQ(loaded->coupling.stiffness, 800);
  EXPECT_EQ(loaded->safety.engage_ticks, 20);
  EXPECT_FALSE(loaded->wants_real_time);
  EXPECT_EQ(loaded->safety.max_slew, SafetyOptions{}.max_slew);
}

TEST_F(RunSettingsFile, ErrorsNameLineAndRemedy) {
  expect_error("[safety]\n\nmax_slow = 3\n", {"line 3", "'max_slow'", "'max_slew'"});
  expect_error("[safty]\nmax_slew = 3\n", {"line 1", "[safty]", "[safety]"});
  expect_error("stiffness = 3\n", {"line 1", "stiffness"});
  expect_error("[coupling]\nstiffness = -1\n", {"line 2", "from 0 to"});
  expect_error("[coupling]\nstiffness = nan\n", {"line 2", "from 0 to"});
  expect_error("[coupling]\nstiffness = \"much\"\n", {"line 2", "number"});
  expect_error("[coupling]\nkind = \"rigid\"\n", {"line 2", "virtual, direct, proxy, none"});
  expect_error("[safety]\nengage_ticks = 1.5\n", {"line 2", "whole number"});
  expect_error("[safety]\ndead_man = 1\n", {"line 2", "true or false"});
  expect_error("[coupling]\nbase_in_scene = [0, 0, 0]\n", {"line 2", "seven numbers"});
  expect_error("[coupling]\nbase_in_scene = [0, 0, 0, 0, 0, 0, 2]\n", {"quaternion"});
  expect_error("[coupling\n", {"line 1", "not TOML"});
  for (const char* text : {"\n[#oupling]\n", "\n [ .a]\n", "\n[[?]]\n", "\n[ \r\n", "\n[\n"}) {
    expect_error(text, {"line 2", "must be followed by a name"});
  }
  EXPECT_FALSE(load_settings<RunSettings>(folder_.path() / "absent.toml"));
}

}  // namespace
}  // namespace palpate
