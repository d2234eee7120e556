// Notes for humans, of which there may not be ever more.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

namespace palpate::inline v0 {

/// Adds those that are not among them, up to a hundred: settings may change thousands of times.
inline void add_notes(std::vector<std::string>& notes, std::vector<std::string> more) {
  constexpr std::size_t kMaxNotes = 100;
  for (std::string& note : more) {
    const bool is_new = std::ranges::find(notes, note) == notes.end();
    if (is_new && notes.size() < kMaxNotes) notes.push_back(std::move(note));
  }
}

}  // namespace palpate::inline v0
