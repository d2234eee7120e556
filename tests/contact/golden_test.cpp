// Bits of a few fixed measurements, by all methods: a change of the arithmetic is seen here, wanted
// or not. `make golden` writes golden.txt anew and says what moved.
#include <cstdio>
#include <cstring>
#include <fstream>
#include <map>
#include <string>

#include <gtest/gtest.h>

#include "tests/contact/golden_cases.h"

namespace palpate::golden {
namespace {

bool is_renewed = false;
const std::string kFile = PALPATE_SOURCE_DIR "/tests/contact/golden.txt";

std::map<std::string, Result> read_file() {
  std::map<std::string, Result> all;
  std::ifstream file(kFile);
  for (std::string name, hash, volume, force; file >> name >> hash >> volume >> force;) {
    all[name] = {hash, std::strtod(volume.c_str(), nullptr), std::strtod(force.c_str(), nullptr)};
  }
  return all;
}

void write_file(const std::vector<std::pair<std::string, Result>>& all) {
  std::ofstream file(kFile);
  for (const auto& [name, result] : all) {
    char line[128];
    std::snprintf(line, sizeof line, "%-26s %s %.9e %.9e\n", name.c_str(), result.hash.c_str(),
                  result.volume, result.force);
    file << line;
  }
}

TEST(Golden, MeasurementsHaveTheBitsThatWereWrittenDown) {
  const std::map<std::string, Result> before = read_file();
  std::vector<std::pair<std::string, Result>> now;
  for (const Case& c : cases()) {
    now.push_back({c.name, run(c)});
    const Result& got = now.back().second;
    EXPECT_GT(got.volume, 0) << c.name;
    const auto it = before.find(c.name);
    if (it != before.end() && it->second.hash == got.hash) continue;
    char text[160] = "is new";
    if (it != before.end()) {
      std::snprintf(text, sizeof text,
                    "has other bits: volume changes by %.1e, force by %.1e of it",
                    got.volume / it->second.volume - 1, got.force / it->second.force - 1);
    }
    if (is_renewed) {
      std::printf("%s %s\n", c.name.c_str(), text);
    } else {
      ADD_FAILURE() << c.name << ' ' << text << "; if that is wanted: make golden";
    }
  }
  if (is_renewed) write_file(now);
}

}  // namespace
}  // namespace palpate::golden

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  palpate::golden::is_renewed = argc > 1 && std::strcmp(argv[1], "--renew") == 0;
  return RUN_ALL_TESTS();
}
