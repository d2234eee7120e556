// Selection of figures by words of the command line.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "eval/figure.h"

namespace palpate::eval {

/// Returns the thesis figures of an id: "5.1, 5.3-5.5" is 5.1, 5.3, 5.4 and 5.5; "noise" has none.
std::vector<std::string> figure_numbers(const std::string& id);

/// Returns the figures that the words name, in the order of `all`; no words: all of them. A word is
/// an id, a thesis figure of an id, or a section, in any case. Error: an unknown word, with similar
/// ones.
Result<std::vector<FigureSpec>> choose_figures(std::span<const FigureSpec> all,
                                               std::span<const std::string> words);

}  // namespace palpate::eval
