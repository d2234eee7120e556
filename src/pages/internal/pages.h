// Pages of the build of web/, in the program: the files of the viewer's page, and reports.
#pragma once

#include <span>
#include <string>
#include <string_view>

#include "palpate/core/core.h"

namespace palpate { inline namespace v0 {

struct PageFile {
  std::string_view path;  ///< as requests name it; that of the page itself is "/"
  std::string_view type;  ///< Content-Type
  std::span<const unsigned char> gzip;
};

/// None in a build without the page.
std::span<const PageFile> page_files();

/// The page of all reports without their data, HTML; empty in a build without pages.
std::string_view report_template();

/// One self-contained HTML page that shows `json`, an object whose "kind" says which report it is
/// (web/src/report/main.ts). `title` is text. The same input gives the same page. Error: this build
/// has no pages.
Result<std::string> report_page(std::string_view title, std::string_view json);

}}  // namespace palpate::v0
