// Runs slow queries of hardware concurrently.
#pragma once

#include <future>
#include <iterator>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "src/core/bounded_call.h"

namespace palpate::inline v0 {

/// The answers of `kind.find()` for all kinds, in their order; `otherwise(kind)` for one whose
/// driver has not come back after `patience` seconds. Most of the time goes into waiting, so each
/// is called on a thread of its own while there are any to be had.
template <class Kinds, class Otherwise>
auto find_all_at_once(const Kinds& kinds, double patience, const Otherwise& otherwise) {
  using Answer = decltype(std::begin(kinds)->find());
  std::vector<std::future<Answer>> answers;
  for (const auto& kind : kinds) {
    const auto find = [&kind, patience, &otherwise] {
      const auto found = std::make_shared<std::optional<Answer>>();
      const bool has_returned =
          returns_within(patience, [found, find = kind.find] { found->emplace(find()); });
      return has_returned ? *std::move(*found) : otherwise(kind);
    };
    try {
      answers.push_back(std::async(std::launch::async, find));
    } catch (const std::system_error&) {  // no thread to be had
      answers.push_back(std::async(std::launch::deferred, find));
    }
  }
  std::vector<Answer> found;
  for (auto& answer : answers) found.push_back(answer.get());
  return found;
}

}  // namespace palpate::inline v0
