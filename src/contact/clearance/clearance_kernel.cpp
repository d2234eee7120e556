// The search for the nearest sphere, compiled once per instruction set.
#include "src/contact/clearance/nearest_sphere.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

void find_nearest(const ClearanceJob& job, ClearanceHit& hit) { search_clusters(job, hit); }

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
