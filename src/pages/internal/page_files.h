// The files of the viewer's page, as the build of web/ left them in the program.
#pragma once

#include <span>
#include <string_view>

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

}}  // namespace palpate::v0
