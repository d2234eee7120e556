// Runs slow queries of hardware concurrently.
#pragma once

#include <algorithm>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "src/core/internal/bounded_call.h"
#include "src/core/internal/monotonic_clock.h"

namespace palpate { inline namespace v0 {

/// Returns `kind.find()` for all kinds, in their order; `otherwise(kind)` for one whose driver has
/// not come back after `patience` seconds. Most of the time goes into waiting, so each is called on
/// a thread of its own while the system starts any.
template <class Kinds, class Otherwise>
auto find_all_at_once(const Kinds& kinds, double patience, const Otherwise& otherwise) {
  using Answer = decltype(std::begin(kinds)->find());
  struct Query {
    std::shared_ptr<std::optional<Answer>> answer = std::make_shared<std::optional<Answer>>();
    BoundedCall call;
    explicit Query(Answer (*find)()) : call([answer = answer, find] { answer->emplace(find()); }) {}
  };
  std::vector<Query> queries;
  for (const auto& kind : kinds) queries.emplace_back(kind.find);
  const double end = monotonic_now() + patience;
  std::vector<Answer> answers;
  auto query = queries.begin();
  for (const auto& kind : kinds) {
    const bool has_returned = query->call.returns_within(std::max(end - monotonic_now(), 0.01));
    answers.push_back(has_returned ? *std::move(*query->answer) : otherwise(kind));
    ++query;
  }
  return answers;
}

}}  // namespace palpate::v0
