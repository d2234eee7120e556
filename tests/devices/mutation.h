// Messages as hostile or broken peers send them.
#pragma once

#include <cstddef>
#include <string>

#include "tests/test_util/random.h"

namespace palpate::test {

/// A few bytes changed, left out, doubled or cut off.
inline std::string mutated(std::string text, Random& random) {
  const auto below = [&random](std::size_t n) {
    return static_cast<std::size_t>(random.bits() % n);
  };
  for (std::size_t i = below(4) + 1; i > 0 && !text.empty(); --i) {
    const std::size_t at = below(text.size());
    switch (below(6)) {
      case 0: text[at] = static_cast<char>(random.bits()); break;
      case 1: text[at] = "{}[]\",:0-e.\\tn"[below(14)]; break;
      case 2: text.erase(at, below(20) + 1); break;
      case 3: text.insert(at, text.substr(below(text.size()), below(40) + 1)); break;
      case 4: text.resize(at); break;
      default: text[at] = static_cast<char>(text[at] ^ (1 << below(8))); break;
    }
  }
  return text;
}

}  // namespace palpate::test
