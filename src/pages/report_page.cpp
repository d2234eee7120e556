// A report: the template that web/make_page.mjs made, filled.

#include "src/core/internal/assert.h"
#include "src/pages/internal/pages.h"

namespace palpate { inline namespace v0 {
namespace {

// Marks where title and data belong (web/report_template.html).
constexpr std::string_view kTitleMark = "{{title}}", kDataMark = "{{data}}";

void append_escaped(std::string& html, std::string_view text) {
  for (const char c : text) {
    switch (c) {
      case '&': html += "&amp;"; break;
      case '<': html += "&lt;"; break;
      case '>': html += "&gt;"; break;
      default: html += c;
    }
  }
}

/// JSON that cannot end the script element it stands in: only strings hold "<".
void append_json(std::string& html, std::string_view json) {
  for (const char c : json) {
    if (c == '<') {
      html += "\\u003c";
    } else {
      html += c;
    }
  }
}

}  // namespace

Result<std::string> report_page(std::string_view title, std::string_view json) {
  const std::string_view page = report_template();
  if (page.empty()) {
    return Error{Errc::unavailable,
                 "this build has no pages, so there is no report: configure with PALPATE_PAGE=ON "
                 "where Node.js 18 and npm are ('make setup' installs them)"};
  }
  const std::size_t title_at = page.find(kTitleMark), data_at = page.find(kDataMark);
  PALPATE_ASSERT(title_at < data_at && data_at != std::string_view::npos);
  std::string html;
  html.reserve(page.size() + title.size() + json.size() + json.size() / 50);
  html += page.substr(0, title_at);
  append_escaped(html, title);
  html += page.substr(title_at + kTitleMark.size(), data_at - title_at - kTitleMark.size());
  append_json(html, json);
  html += page.substr(data_at + kDataMark.size());
  return html;
}

}}  // namespace palpate::v0
