// Changes of settings while a run went on: a list that weeks of changes do not make long.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "palpate/run/run_loop.h"

namespace palpate { inline namespace v0 {

/// List of the first and the last of many changes; a recording has all.
class ChangeList {
 public:
  static constexpr std::size_t kNumKept = 200;  ///< first ones, and as many last ones

  explicit ChangeList(const RunSettings& first) : before_(first) {}

  void add(const RunSettings& settings);
  /// Number of all changes, also those that are not kept.
  std::uint64_t num() const { return num_; }
  /// Returns the changed settings of each change: [{"section": {"key": value}}, ...].
  nlohmann::ordered_json json() const;

 private:
  RunSettings before_;
  std::uint64_t num_ = 0;
  std::vector<std::string> first_;  // as text, which is small
  std::deque<std::string> last_;
};

}}  // namespace palpate::v0
