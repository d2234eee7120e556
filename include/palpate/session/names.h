// The words by which people choose among options, on the command line and in files.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/cloud/surface_estimator.h"
#include "palpate/contact/contact_query.h"
#include "palpate/field/surface_timeline.h"
#include "palpate/haptics/coupling.h"

namespace palpate {

template <class Value>
struct Named {
  std::string_view name;
  Value value;
};

inline constexpr std::array<Named<InsideMethod>, 4> kMethodNames{{
    {"weighted", InsideMethod::weighted},
    {"simplified", InsideMethod::simplified},
    {"graph", InsideMethod::graph},
    {"field", InsideMethod::field},
}};
inline constexpr std::array<Named<Priority>, 2> kPriorityNames{{
    {"distance", Priority::distance},
    {"count", Priority::count},
}};
inline constexpr std::array<Named<InsideVolume>, 2> kInsideNames{{
    {"full", InsideVolume::full},
    {"cap", InsideVolume::cap},
}};
inline constexpr std::array<Named<std::optional<SphereVolumes>>, 3> kVolumesNames{{
    {"auto", std::nullopt},
    {"spheres", SphereVolumes::own},
    {"represented", SphereVolumes::represented},
}};
inline constexpr std::array<Named<Edges>, 4> kEdgesNames{{
    {"none", Edges::none},
    {"centre", Edges::centre},
    {"strict", Edges::strict},
    {"cut", Edges::cut},
}};
inline constexpr std::array<Named<Continuity>, 4> kContinuityNames{{
    {"none", Continuity::none},
    {"kernel", Continuity::kernel},
    {"entry", Continuity::entry},
    {"both", Continuity::both},
}};
inline constexpr std::array<Named<PlaneFit>, 2> kPlaneFitNames{{
    {"along_ray", PlaneFit::along_ray},
    {"principal", PlaneFit::principal},
}};
inline constexpr std::array<Named<UnknownSpace>, 2> kUnknownNames{{
    {"free", UnknownSpace::free},
    {"solid", UnknownSpace::solid},
}};
inline constexpr std::array<Named<TimeMode>, 3> kTimeModeNames{{
    {"latest", TimeMode::latest},
    {"interpolate", TimeMode::interpolate},
    {"predict", TimeMode::predict},
}};
inline constexpr std::array<Named<DepthAverage>, 3> kDepthAverageNames{{
    {"none", DepthAverage::none},
    {"moving", DepthAverage::moving},
    {"exponential", DepthAverage::exponential},
}};
/// No value: the fastest one that works here.
inline constexpr std::array<Named<std::optional<Backend>>, 3> kBackendNames{{
    {"cpu", Backend::cpu},
    {"cuda", Backend::cuda},
    {"auto", std::nullopt},
}};
inline constexpr std::array<Named<Backend>, 2> kUsedBackendNames{{
    {"cpu", Backend::cpu},
    {"cuda", Backend::cuda},
}};
inline constexpr std::array<Named<CouplingKind>, 4> kCouplingNames{{
    {"virtual", CouplingKind::virtual_coupling},
    {"direct", CouplingKind::direct},
    {"proxy", CouplingKind::proxy},
    {"none", CouplingKind::none},
}};
inline constexpr std::array<Named<ContactHold>, 2> kContactHoldNames{{
    {"local_model", ContactHold::local_model},
    {"interpolation", ContactHold::interpolation},
}};

template <class Table, class Value>
std::string name_of(const Table& table, const Value& value) {
  for (const auto& entry : table) {
    if (entry.value == value) return std::string(entry.name);
  }
  return "?";
}

/// The value of a name, or nullopt for an unknown name.
template <class Value, std::size_t n>
std::optional<Value> value_of(const std::array<Named<Value>, n>& table, std::string_view name) {
  for (const auto& entry : table) {
    if (entry.name == name) return entry.value;
  }
  return std::nullopt;
}

}  // namespace palpate
