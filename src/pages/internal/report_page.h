// A report: the page that web/ makes of it (web/src/report), with its data inside.
#pragma once

#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

/// One self-contained HTML page that shows `json`, an object whose "kind" says which report it is
/// (web/src/report/main.ts). `title` is text. The same input gives the same page. Error: this build
/// has no pages.
Result<std::string> report_page(std::string_view title, std::string_view json);

}}  // namespace palpate::v0
