// The nearest sphere of a tool: all cameras for as many spheres as a vector has lanes. Included by
// kernel files only, of processors and of GPUs.
#pragma once

#include "src/contact/clearance/search/depth_around.h"
#include "src/contact/clearance/search/sphere_sight.h"

namespace palpate { inline namespace v0 { namespace PALPATE_ISA_NAMESPACE { namespace {

// The spheres of one vector against all cameras.
class VectorSearch {
 public:
  PALPATE_LANE_CODE VectorSearch(const ClearanceJob& job, std::size_t slot, ClearanceHit& hit)
      : job_(job), slot_(slot), hit_(hit), id_(load(&job.spheres.sphere_id[slot])) {}

  PALPATE_LANE_CODE void run() {
    lanes_ = id_ >= splat(0);
    if (job_.cameras[0].seen_free != nullptr) return run_hull();
    for (int k = 0; k < job_.num_cameras; ++k) run_alone(k);
  }

 private:
  PALPATE_LANE_CODE float best() const { return hit_.value; }

  // Distances that would beat the best value, squared.
  PALPATE_LANE_CODE Found start(VecF radius) const {
    const VecF limit = max(best() + radius, VecF{});
    return {limit * limit * 1.000002f, splat(-1)};
  }
  PALPATE_LANE_CODE Found start_inside(VecF radius) const {
    const VecF limit = max(job_.deepest - radius, VecF{});
    return {limit * limit, splat(-1)};
  }

  // Keeps the least value among some lanes, of equal ones that of the first sphere; or each.
  PALPATE_LANE_CODE void keep(VecI lanes, VecF values, const Found& found, int camera,
                              bool is_of_field, bool is_inside) {
    if (job_.each == nullptr) {
      const float least = min_lane(select(lanes, values, splat(kFarAway)));
      if (!(least <= hit_.value)) return;
      lanes &= values == splat(least);
    }
    for (std::uint32_t bits = mask_bits(lanes); bits != 0; bits &= bits - 1) {
      const int i = first_lane(bits);
      const float value = lane_of(values, i);
      const std::int32_t id = lane_of(id_, i), pixel = lane_of(found.pixel, i);
      ClearanceHit hit{
          value, id, pixel, static_cast<std::int16_t>(camera), is_of_field, ClearanceKind::solid};
      if (is_inside) hit.kind = pixel == -1 ? ClearanceKind::deep : ClearanceKind::open;
      if (pixel < -1) {
        hit.kind = ClearanceKind::border;
        hit.pixel = -2 - pixel;
      }
      if (job_.each != nullptr) {
        if (value < job_.each[id].value) job_.each[id] = hit;
      } else if (value < hit_.value || id < hit_.sphere) {
        hit_ = hit;
      }
    }
  }

  // One camera by itself; what it remembers and what is in front of that are two.
  PALPATE_LANE_CODE void run_alone(int camera) {
    const Image& image = *job_.cameras[camera].field;
    const SphereLanes spheres = spheres_at(job_, job_.cameras[camera], slot_);
    Sight sight;
    const bool ends_inside = job_.enough > -1e9f;  // then one look may be enough
    if (ends_inside) {
      sight = sight_of(image, spheres);
      if (is_any_set(lanes_ & sight.is_solid & (-spheres.radius < splat(job_.enough)))) {
        hit_.value = -1e9f;
        hit_.kind = ClearanceKind::deep;
        return;
      }
    }
    const VecF bound = bound_around(image, spheres.at, spheres.radius, splat(best()));
    const VecI lanes = lanes_ & (bound < splat(best()));
    if (!is_any_set(lanes)) return;
    if (!ends_inside) sight = sight_of(image, spheres);
    const VecI inside = lanes & sight.is_solid;
    const VecI outside = lanes & ~sight.is_solid & (spheres.radius > splat(-best()));
    find_deepest(image, spheres, sight, inside, camera);
    if (!is_any_set(outside)) return;
    Found found = start(spheres.radius);
    offer<true>(image, spheres, outside & sight.is_in_image, sight.column, sight.row, sight.depth,
                found);
    float value = best();
    if (job_.each == nullptr && value > 0) {
      find_first(image, spheres, bound, outside, value, found);
    } else {
      look_outside<false>(image, spheres, outside, value, job_.enough, job_.each == nullptr, found);
    }
    keep(outside & (found.pixel != splat(-1)), sqrt(found.distance2) - spheres.radius, found,
         camera, true, false);
  }

  // Searches for the sphere that seems to be the nearest, then for others that may be nearer, those
  // with the least bound first. The pixel that is nearest to one is often near to others, too.
  PALPATE_LANE_CODE void find_first(const Image& image, const SphereLanes& spheres, VecF bound,
                                    VecI lanes, float& value, Found& found) {
    VecF rank = sqrt(found.distance2) - spheres.radius;
    while (true) {
      rank = select(lanes, rank, splat(kFarAway));
      const int lane = first_lane(mask_bits(rank == splat(min_lane(rank))));
      const VecI is_it = lane_ids() == splat(lane);
      look_outside<true>(image, spheres, is_it, value, job_.enough, true, found);
      if (value < job_.enough) return;
      lanes &= ~is_it & (bound <= splat(value));
      if (!is_any_set(lanes)) return;
      rank = bound;
      const std::int32_t pixel = lane_of(found.pixel, lane);
      if (pixel < 0) continue;
      const std::int32_t column = pixel % image.width, row = pixel / image.width;
      offer<true>(image, spheres, lanes, splat(column), splat(row),
                  splat(image.nearest[0][image.place(0, column, row)]), found);
    }
  }

  // Searches for one sphere at a time, the one that may be the deepest first. The free pixel that
  // is nearest to it is often near to the others, too, which then need no search.
  PALPATE_LANE_CODE void find_deepest(const Image& image, const SphereLanes& spheres,
                                      const Sight& sight, VecI lanes, int camera) {
    if (!is_any_set(lanes)) return;
    Found found = start_inside(spheres.radius);
    offer<false>(image, spheres, lanes, sight.column, sight.row, sight.depth, found);
    while (true) {
      const VecF value = select(lanes, depth_value(found, spheres), splat(kFarAway));
      const float deepest = min_lane(value);
      if (!(deepest <= best())) return;
      const VecI is_it = lane_ids() == splat(first_lane(mask_bits(value == splat(deepest))));
      look_inside<true>(image, spheres, sight, is_it, best(), found);
      keep(is_it, depth_value(found, spheres), found, camera, true, true);
      if (best() <= -job_.deepest) return;  // none is told to be deeper
      lanes &= ~is_it;
      const std::int32_t pixel = lane_of(found.pixel, first_lane(mask_bits(is_it)));
      if (pixel < 0) continue;
      const std::int32_t column = pixel % image.width, row = pixel / image.width;
      offer<false>(image, spheres, lanes, splat(column), splat(row),
                   splat(image.nearest[0][image.place(0, column, row)]), found);
    }
  }

  // Takes the solid or free space of a pixel where it is nearer than what a lane has.
  template <bool kFront>
  PALPATE_LANE_CODE void offer(const Image& image, const SphereLanes& spheres, VecI lanes,
                               VecI column, VecI row, VecF depth, Found& found) {
    const VecF x = (to_float(column) - image.cx) * image.per_fx;
    const VecF y = (to_float(row) - image.cy) * image.per_fy;
    const VecF distance2 = pixel_distance2<kFront>(image, spheres.at, x, y, depth);
    const VecI is_nearer = lanes & (distance2 < found.distance2);
    found.distance2 = select(is_nearer, distance2, found.distance2);
    found.pixel = select(is_nearer, row * image.width + column, found.pixel);
  }

  PALPATE_LANE_CODE VecF depth_value(const Found& found, const SphereLanes& spheres) const {
    const VecF value = -(sqrt(found.distance2) + spheres.radius);
    return select(found.pixel == splat(-1), splat(-job_.deepest), value);
  }

  // Joined cameras: the greatest distance to what is not seen to be free, and no less than the
  // least one to the surfaces of `field`.
  PALPATE_LANE_CODE void run_hull();

  const ClearanceJob& job_;
  std::size_t slot_;
  ClearanceHit& hit_;
  VecI id_, lanes_;
};

// The better of two answers, lane by lane, with its camera.
struct Choice {
  Found found;
  VecI camera, is_of_field;

  PALPATE_LANE_CODE void take(VecI lanes, const Found& other, int number, bool from_field) {
    found.distance2 = select(lanes, other.distance2, found.distance2);
    found.pixel = select(lanes, other.pixel, found.pixel);
    camera = select(lanes, splat(number), camera);
    is_of_field = select(lanes, splat(from_field ? -1 : 0), is_of_field);
  }
};

PALPATE_LANE_CODE inline void VectorSearch::run_hull() {
  VecI may_win = lanes_, is_free{};
  VecF radius = load(&job_.spheres.radius[slot_]);
  Choice nearest{{splat(-1.0f), splat(-1)}, VecI{}, VecI{}};
  for (int k = 0; k < job_.num_cameras; ++k) {
    const Image& image = *job_.cameras[k].seen_free;
    const SphereLanes spheres = spheres_at(job_, job_.cameras[k], slot_);
    const Sight sight = sight_of(image, spheres);
    const VecI here = may_win & ~sight.is_solid;
    if (!is_any_set(here)) continue;
    Found found = start(radius);
    float value = best();
    look_outside<false>(image, spheres, here, value, job_.enough, false, found);
    is_free |= here;
    may_win &= ~(here & (found.pixel == splat(-1)));
    nearest.take(here & (found.distance2 > nearest.found.distance2), found, k, false);
  }
  if (!is_any_set(may_win)) return;
  // The fields: outside of all of them, the least distance.
  VecI is_in_some{};
  Choice of_fields{start(radius), VecI{}, VecI{}};
  const VecI open = may_win & (is_free | lanes_);
  for (int k = 0; k < job_.num_cameras; ++k) {
    const Image& image = *job_.cameras[k].field;
    const SphereLanes spheres = spheres_at(job_, job_.cameras[k], slot_);
    const Sight sight = sight_of(image, spheres);
    is_in_some |= open & sight.is_solid;
    const VecI here = open & ~sight.is_solid & ~is_in_some;
    if (!is_any_set(here)) continue;
    Found found = of_fields.found;
    float value = best();
    look_outside<false>(image, spheres, here, value, job_.enough, false, found);
    of_fields.take(here & (found.distance2 < of_fields.found.distance2), found, k, true);
  }
  const VecI outside = may_win & (is_free | ~is_in_some);
  const VecI by_field =
      outside & ~is_in_some & ((of_fields.found.distance2 > nearest.found.distance2) | ~is_free);
  may_win &= ~(by_field & (of_fields.found.pixel == splat(-1)));
  const auto keep_each = [&](VecI lanes, const Choice& from, VecF values, bool is_inside) {
    for (int k = 0; k < job_.num_cameras; ++k) {
      const VecI of_camera = lanes & (from.camera == splat(k));
      keep(of_camera & ~from.is_of_field, values, from.found, k, false, is_inside);
      keep(of_camera & from.is_of_field, values, from.found, k, true, is_inside);
    }
  };
  keep_each(may_win & by_field, of_fields, sqrt(of_fields.found.distance2) - radius, false);
  keep_each(may_win & outside & ~by_field, nearest, sqrt(nearest.found.distance2) - radius, false);
  // Seen to be free by none, and inside of a surface: the least way to what one has seen to be
  // free, or out of all surfaces.
  const VecI inside = may_win & ~outside;
  if (!is_any_set(inside)) return;
  Choice to_free{start_inside(radius), VecI{}, VecI{}};
  Choice out_of_fields{{splat(-1.0f), splat(-1)}, VecI{}, VecI{}};
  for (int k = 0; k < job_.num_cameras; ++k) {
    const SphereLanes spheres = spheres_at(job_, job_.cameras[k], slot_);
    const Image& seen_free = *job_.cameras[k].seen_free;
    Found found = to_free.found;
    look_inside<false>(seen_free, spheres, sight_of(seen_free, spheres), inside, best(), found);
    to_free.take(inside & (found.distance2 < to_free.found.distance2), found, k, false);
    const Image& field = *job_.cameras[k].field;
    const Sight sight = sight_of(field, spheres);
    const VecI here = inside & sight.is_solid;
    found = start_inside(radius);
    look_inside<false>(field, spheres, sight, here, best(), found);
    out_of_fields.take(here & (found.distance2 > out_of_fields.found.distance2), found, k, true);
  }
  to_free.take(inside & (out_of_fields.found.distance2 < to_free.found.distance2) &
                   (out_of_fields.found.distance2 >= VecF{}),
               out_of_fields.found, 0, true);
  const VecI was_out = inside & (to_free.is_of_field != splat(0));
  to_free.camera = select(was_out, out_of_fields.camera, to_free.camera);
  const VecF values = select(to_free.found.pixel == splat(-1), splat(-job_.deepest),
                             -(sqrt(to_free.found.distance2) + radius));
  keep_each(inside, to_free, values, true);
}

// Bounds of the clearance of up to sixteen clusters, by the balls around them, before cameras by
// themselves. kFarAway of clusters that are not there.
struct ClusterBounds {
  static constexpr int kNum = SphereClusters::kClustersPerGroup;
  static constexpr int kVectors = kLanes < kNum ? kNum / kLanes : 1;
  VecF vectors[kVectors];

  PALPATE_LANE_CODE ClusterBounds(const ClearanceJob& job, int first, int num, float best) {
    for (int k = 0; k < kVectors; ++k) {
      const VecI id = lane_ids() + k * kLanes;
      const VecI is_there = id < splat(num);
      VecF bound = splat(-kFarAway);
      if (num > 1 && job.cameras[0].seen_free == nullptr) {
        bound = splat(best);
        const VecI at = select(is_there, id, VecI{}) + first;
        for (int camera = 0; camera < job.num_cameras; ++camera) {
          bound = min(bound, before_camera(job, job.cameras[camera], at, best));
        }
      }
      vectors[k] = select(is_there, bound, splat(kFarAway));
    }
  }

  // Returns the number of the cluster that seems to be the nearest, once; -1 if none is below
  // `best`.
  PALPATE_LANE_CODE int take_nearest(float best) {
    VecF least = vectors[0];
    for (int k = 1; k < kVectors; ++k) least = min(least, vectors[k]);
    const float nearest = min_lane(least);
    if (!(nearest < best)) return -1;
    for (int k = 0; k < kVectors; ++k) {
      const std::uint32_t bits = mask_bits(vectors[k] == splat(nearest));
      if (bits == 0) continue;
      const int lane = first_lane(bits);
      vectors[k] = select(lane_ids() == splat(lane), splat(kFarAway), vectors[k]);
      return k * kLanes + lane;
    }
    return -1;
  }

 private:
  PALPATE_LANE_CODE static VecF before_camera(const ClearanceJob& job,
                                              const ClearanceCamera& camera, VecI cluster,
                                              float best) {
    const float* const balls = &job.spheres.clusters->center.x;
    const VecI at = cluster * static_cast<int>(sizeof(Cluster) / sizeof(float));
    const VecF x = gather(balls, at), y = gather(balls + 1, at), z = gather(balls + 2, at);
    const auto row = [&](int k) {
      const float(&r)[3] = camera.R_CT[k];
      return r[0] * x + r[1] * y + r[2] * z + camera.p_CT[k];
    };
    const VecF reach = gather(&job.spheres.clusters->reach, at);
    return bound_around(*camera.field, {row(0), row(1), row(2)}, reach, splat(best));
  }
};

// Searches all spheres, cluster by cluster, those that seem to be the nearest first.
PALPATE_LANE_CODE inline void search_clusters(const ClearanceJob& job, ClearanceHit& hit) {
  constexpr int kSize = SphereClusters::kSize, kPerGroup = SphereClusters::kClustersPerGroup;
  hit = {};
  hit.value = job.limit;
  const ClusterView& spheres = job.spheres;
  for (int first = 0; first < spheres.num_clusters; first += kPerGroup) {
    const int num = lesser(kPerGroup, spheres.num_clusters - first);
    ClusterBounds bounds(job, first, num, hit.value);
    for (int k = bounds.take_nearest(hit.value); k >= 0; k = bounds.take_nearest(hit.value)) {
      const int from = (first + k) * kSize;
      const int num_spheres = lesser(kSize, spheres.num_spheres - from);
      for (int i = 0; i < num_spheres; i += kLanes) {
        VectorSearch(job, static_cast<std::size_t>(from + i), hit).run();
        if (hit.value < job.enough || hit.value <= -job.deepest) return;
      }
    }
  }
}

}}}}  // namespace palpate::v0::PALPATE_ISA_NAMESPACE
