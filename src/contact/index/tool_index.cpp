#include "palpate/contact/contact.h"

#include "src/contact/index/tool_parts.h"

namespace palpate { inline namespace v0 {

ToolIndex::ToolIndex(const Tool& tool)
    : tool_(&tool), parts_(std::make_unique<const ToolParts>(tool)) {}

ToolIndex::~ToolIndex() = default;

std::shared_ptr<const ToolIndex> ToolIndex::create(const Tool& tool) {
  return std::shared_ptr<const ToolIndex>(new ToolIndex(tool));
}

std::size_t ToolIndex::num_bytes() const { return parts_->num_bytes(); }

}}  // namespace palpate::v0
