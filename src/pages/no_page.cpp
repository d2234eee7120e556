// A build without pages.
#include "src/pages/internal/pages.h"

namespace palpate { inline namespace v0 {

std::span<const PageFile> page_files() { return {}; }
std::string_view report_template() { return {}; }

}}  // namespace palpate::v0
