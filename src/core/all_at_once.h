// Runs slow queries of hardware concurrently.
#pragma once

#include <future>
#include <iterator>
#include <system_error>
#include <vector>

namespace palpate::inline v0 {

/// The answers of `kind.find()` for all kinds, in their order. Most of the time goes into waiting,
/// so each is called on a thread of its own while there are any to be had.
template <class Kinds>
auto find_all_at_once(const Kinds& kinds) {
  using Answer = decltype(std::begin(kinds)->find());
  std::vector<std::future<Answer>> answers;
  for (const auto& kind : kinds) {
    try {
      answers.push_back(std::async(std::launch::async, kind.find));
    } catch (const std::system_error&) {  // no thread to be had
      answers.push_back(std::async(std::launch::deferred, kind.find));
    }
  }
  std::vector<Answer> found;
  for (auto& answer : answers) found.push_back(answer.get());
  return found;
}

}  // namespace palpate::inline v0
