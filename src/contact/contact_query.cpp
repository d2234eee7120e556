#include "palpate/contact/contact.h"

#include <algorithm>
#include <string>
#include <utility>

#include "src/contact/backends.h"
#include "src/contact/field/field_contact.h"
#include "src/contact/index/tool_parts.h"
#include "src/core/internal/num_cores.h"

namespace palpate { inline namespace v0 {

std::vector<std::string> drop_foreign_options(ContactOptions& o) {
  const ContactOptions defaults;
  std::vector<std::string> dropped;
  const auto drop = [&](const char* name, auto& option, auto plain) {
    if (std::exchange(option, plain) != plain) dropped.push_back(name);
  };
  const bool is_field = o.method == MethodKind::field, is_graph = o.method == MethodKind::graph;
  if (is_field || is_graph) drop("priority", o.priority, defaults.priority);
  if (!is_graph) drop("inside", o.inside, defaults.inside);
  if (is_field) drop("edges", o.edges, defaults.edges);
  if (is_field) drop("continuity", o.continuity, defaults.continuity);
  return dropped;
}

Result<ContactMethod> contact_method(const ContactOptions& o) {
  ContactOptions had = o;
  if (const auto foreign = drop_foreign_options(had); !foreign.empty()) {
    return Error{Errc::invalid_argument, foreign.front() + " does not go with the method " +
                                             name_of(o.method) +
                                             ": leave it out, or choose another method"};
  }
  switch (o.method) {
    case MethodKind::field: break;
    case MethodKind::weighted:
      return ContactMethod(WeightedMethod{o.priority, o.counted(), o.edges, o.continuity});
    case MethodKind::simplified:
      return ContactMethod(SimplifiedMethod{o.priority, o.counted(), o.edges, o.continuity});
    case MethodKind::graph:
      return ContactMethod(GraphMethod{o.inside, o.counted(), o.edges, o.continuity});
  }
  return ContactMethod(FieldMethod{o.counted()});
}

ContactOptions contact_options(const ContactMethod& method) {
  struct Options {
    ContactOptions operator()(const FieldMethod& m) const {
      return {.method = MethodKind::field, .volumes = m.volumes};
    }
    ContactOptions operator()(const WeightedMethod& m) const {
      return {.method = MethodKind::weighted,
              .priority = m.priority,
              .volumes = m.volumes,
              .edges = m.edges,
              .continuity = m.continuity};
    }
    ContactOptions operator()(const SimplifiedMethod& m) const {
      return {.method = MethodKind::simplified,
              .priority = m.priority,
              .volumes = m.volumes,
              .edges = m.edges,
              .continuity = m.continuity};
    }
    ContactOptions operator()(const GraphMethod& m) const {
      return {.method = MethodKind::graph,
              .inside = m.inside,
              .volumes = m.volumes,
              .edges = m.edges,
              .continuity = m.continuity};
    }
  };
  return std::visit(Options{}, method);
}

Result<std::unique_ptr<ContactQuery>> make_contact_query(const Place& place,
                                                         std::shared_ptr<const ToolIndex> index,
                                                         const ContactMethod& method,
                                                         const ExecutionOptions& execution) {
  const std::size_t num_spheres = index->tool().spheres().size();
  if (contact_options(method).priority == Priority::path && num_spheres > kMaxPathSpheres) {
    return Error{Errc::invalid_argument,
                 "the priority path keeps the ways between all spheres of a tool, at most " +
                     std::to_string(kMaxPathSpheres) + ": this one has " +
                     std::to_string(num_spheres) +
                     "; pack it with fewer, or choose another priority"};
  }
  switch (place.backend) {
    case Backend::cpu: {
      const auto* field = std::get_if<FieldMethod>(&method);
      if (field == nullptr) return make_point_contact(std::move(index), method, execution);
      return std::unique_ptr<ContactQuery>(
          std::make_unique<FieldContact>(std::move(index), *field, execution));
    }
    case Backend::cuda: break;
  }
#if defined(PALPATE_CUDA)
  return make_contact_query_cuda(std::move(index), method, place.gpu, execution.reserves_noise);
#else
  return find_gpus().error();
#endif
}

Result<std::unique_ptr<ContactQuery>> make_contact_query(const Place& place, const Tool& tool,
                                                         const ContactMethod& method,
                                                         const ExecutionOptions& execution) {
  return make_contact_query(place, ToolIndex::create(tool), method, execution);
}

Result<Contact> Contact::create(const Tool& tool, const ContactMethod& method, const Place& place,
                                int num_threads) {
  constexpr std::size_t kSpheresPerThread = 50000;
  if (num_threads == 0) {
    const auto cores = static_cast<std::size_t>(num_cores());
    num_threads = static_cast<int>(std::min(cores, 1 + tool.spheres().size() / kSpheresPerThread));
  }
  auto pool = std::make_unique<ThreadPool>(num_threads);
  auto query = make_contact_query(place, tool, method, {best_isa(), pool.get()});
  if (!query) return query.error();
  return Contact(tool, place, std::move(pool), *std::move(query));
}

ToolIndex::ToolIndex(const Tool& tool)
    : tool_(&tool), parts_(std::make_unique<const ToolParts>(tool)) {}

ToolIndex::~ToolIndex() = default;

std::shared_ptr<const ToolIndex> ToolIndex::create(const Tool& tool) {
  return std::shared_ptr<const ToolIndex>(new ToolIndex(tool));
}

std::size_t ToolIndex::num_bytes() const { return parts_->num_bytes(); }

}}  // namespace palpate::v0
