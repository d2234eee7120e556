// Which figures a person means.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "eval/figure.h"

namespace palpate::eval {

/// The figures of the thesis that an id stands for: "5.1, 5.3-5.5" is 5.1, 5.3, 5.4 and 5.5;
/// "noise" is none.
std::vector<std::string> figure_numbers(const std::string& id);

/// The figures that the words name, in the order of `all`; no words: all of them. A word is an id,
/// a number that an id stands for, or a section, in any case. Error: a word that is neither, with
/// those that look like it.
Result<std::vector<FigureSpec>> choose_figures(std::span<const FigureSpec> all,
                                               std::span<const std::string> words);

}  // namespace palpate::eval
