// The hint of an error about a word that is not among the known ones, for settings, scenes, verbs
// and options alike:
//
//   there is no scene 'hnad'; did you mean hand?
//
// At most every second letter may be another one: a word that is farther from all known ones is no
// typing error, and a list of what there is helps more.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace palpate { inline namespace v0 {

/// Returns "; did you mean WORD?" of the nearest word, or nothing if none is near. `words` may be
/// empty. O(letters of `word` times letters of all words).
std::string did_you_mean(std::string_view word, std::span<const std::string> words);

}}  // namespace palpate::v0
