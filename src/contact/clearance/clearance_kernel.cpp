// The search for the nearest sphere on a processor, compiled once per instruction set.
//
// The text is that of nearest_sphere.h, which is written for vectors: their lanes are the spheres
// of a part of a cluster here (4, 8 or 16 of them), and a whole cluster on a GPU, where a warp is a
// vector (clearance_cuda.cu). All of them find the same sphere and the same pixel:
//
//   least over the spheres of (phi(c) - r)
//
// They agree because bounds of squares are lowered by more than rounding changes them, each
// distance to a pixel is computed from the same numbers in the same order, and of equal values the
// first sphere and the first pixel count. So clearances have the same bits on every processor, and
// a test compares all instruction sets with every pixel in double.
#include "src/contact/clearance/nearest_sphere.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE {

// Writes the nearest sphere of a job, or the hits of all spheres.
void find_nearest(const ClearanceJob& job, ClearanceHit& hit) { search_clusters(job, hit); }

}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
