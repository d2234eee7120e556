// silhouettes, on recorded frames: lengths of forces at random poses, and their stiffness.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "eval/studies/parallel.h"
#include "eval/studies/range.h"
#include "eval/studies/silhouettes.h"
#include "eval/studies/verdict_rules.h"
#include "src/math/internal/random.h"

namespace palpate::eval {
namespace {

constexpr double kStiffness = 12;  // times the section of the tool

/// Counts of step pixels in rectangles: pixels without measurement, or with a neighbor whose depth
/// differs by more than 1.5 %.
class StepCounts {
 public:
  explicit StepCounts(const DepthFrame& frame)
      : width_(frame.width), height_(frame.height), sums_(at(0, height_ + 1), 0) {
    const auto depth = [&](int u, int v) {
      const std::uint16_t z =
          frame.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
                       static_cast<std::size_t>(u)];
      return z == 65535 ? 0.0 : static_cast<double>(z);
    };
    for (int v = 0; v < height_; ++v) {
      for (int u = 0; u < width_; ++u) {
        const double z = depth(u, v);
        bool steps = z == 0;
        for (int dv = -1; dv <= 1; ++dv) {
          for (int du = -1; du <= 1; ++du) {
            const int nu = u + du, nv = v + dv;
            if (nu < 0 || nv < 0 || nu >= width_ || nv >= height_) continue;
            steps |= std::abs(depth(nu, nv) - z) > 0.015 * z;
          }
        }
        sums_[at(u + 1, v + 1)] =
            steps + sums_[at(u, v + 1)] + sums_[at(u + 1, v)] - sums_[at(u, v)];
      }
    }
  }

  /// Counts those in columns [u0, u1) and rows [v0, v1); nullopt: some are outside the image.
  std::optional<int> in(double u0, double u1, double v0, double v1) const {
    if (u0 < 0 || v0 < 0 || u1 > width_ || v1 > height_) return std::nullopt;
    const int left = static_cast<int>(u0), right = static_cast<int>(std::ceil(u1));
    const int top = static_cast<int>(v0), bottom = static_cast<int>(std::ceil(v1));
    return sums_[at(right, bottom)] - sums_[at(left, bottom)] - sums_[at(right, top)] +
           sums_[at(left, top)];
  }

 private:
  std::size_t at(int u, int v) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width_ + 1) +
           static_cast<std::size_t>(u);
  }
  int width_, height_;
  std::vector<int> sums_;
};

/// True if all pixels of the rectangle around the tool show one surface.
bool nothing_steps(const StepCounts& steps, const Intrinsics& k, const Tool& tool,
                   const Pose& X_WT) {
  Range u, v;
  for (const Sphere& sphere : tool.spheres()) {
    const Vec3d c = X_WT * to_double(sphere.center);
    const double r = sphere.radius, nearest = c.z - r;
    if (nearest <= 0) return false;
    for (const double sign : {-1.0, 1.0}) {
      u.add(k.fx * (c.x + sign * r) / nearest + k.cx + 0.5);
      v.add(k.fy * (c.y + sign * r) / nearest + k.cy + 0.5);
    }
  }
  return steps.in(u.low, u.high, v.low, v.high) == 0;
}

struct RealFrame : FirstFrame {
  FrozenFrame seen;
};
Result<std::vector<RealFrame>> real_frames(Context& context) {
  std::vector<RealFrame> frames;
  auto recorded = context.first_frames(false);
  if (!recorded) return recorded.error();
  for (FirstFrame& of_recording : *recorded) {
    auto seen = FrozenFrame::create(of_recording.stream, of_recording.frame);
    if (!seen) return seen.error();
    frames.push_back({std::move(of_recording), *std::move(seen)});
    context.progress(0.5);
  }
  return frames;
}

/// Contacts of one tool with one frame.
struct RealContacts {
  Ratios all, calm;  ///< calm: without steps around the tool
  Ratios stiffness;  ///< largest eigenvalues over the tool's section
};
RealContacts contacts_of(const RealFrame& real, const Tool& tool, ContactProbe& probe,
                         int num_poses, std::uint64_t seed, Work& work) {
  constexpr double kNearest = 0.3, kFarthest = 3, kBefore = -0.02, kBeyond = 0.03;  // m
  const Intrinsics& k = real.stream.intrinsics;
  std::vector<std::size_t> measured;
  for (std::size_t i = 0; i < real.frame.pixels.size(); ++i) {
    const double z = real.frame.pixels[i] * real.frame.unit;
    if (real.frame.pixels[i] != 65535 && z > kNearest && z < kFarthest) measured.push_back(i);
  }
  RealContacts contacts;
  if (measured.empty()) return contacts;
  const StepCounts steps(real.frame);
  Random random(seed);
  const auto width = static_cast<std::size_t>(real.frame.width);
  for (int i = 0; i < num_poses; ++i) {
    const std::size_t pixel = measured[random.bits() % measured.size()];
    const double z = real.frame.pixels[pixel] * real.frame.unit + random.uniform(kBefore, kBeyond);
    const auto u = static_cast<double>(pixel % width), v = static_cast<double>(pixel / width);
    const double a = random.normal(), b = random.normal(), c = random.normal(), d = random.normal();
    const Pose X_WT{{(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z},
                    normalized(Quaternion{a, b, c, d})};
    const auto contact = probe(X_WT);
    if (contact) {
      contacts.all.values.push_back(contact->ratio());
      contacts.stiffness.values.push_back(probe.stiffness());
      if (nothing_steps(steps, k, tool, X_WT)) contacts.calm.values.push_back(contact->ratio());
    }
    if (i % 100 == 0) work.step();
  }
  return contacts;
}

constexpr std::pair<const char*, double> kTools[] = {
    {kSilhouetteTool, kSilhouetteToolSize}, {"stylus", 0.15}, {"finger", 0.1}};  // m

Verdict verdict_of_calm(double share, double worst) {
  constexpr double kFew = 0.01;
  return holds_with({holds_up_to(share, kFew, 10 * kFew), holds_up_to(worst, kLong)});
}

constexpr const char* kClaimOfBound =
    "On recorded frames no force of the field is longer than 1.05 V.";
constexpr const char* kClaimOfStiffness =
    "On recorded frames no eigenvalue of the force's stiffness is larger than 12 sections of the "
    "tool "
    "(the largest face of its box), with 2,000 spheres.";
constexpr const char* kClaimOfCalm =
    "Where nothing steps under the tool the force is at most 1.05 times the volume.";

std::vector<std::string> row_of(const std::string& name, const RealContacts& contacts) {
  return {name,
          words("%zu", contacts.all.values.size()),
          words("%.2f", 100 * contacts.all.share_above(kLong)),
          words("%.2f", 100 * contacts.all.share_above(kBound)),
          words("%.3f", contacts.all.worst()),
          words("%zu", contacts.calm.values.size()),
          words("%.2f", 100 * contacts.calm.share_above(kCalm)),
          words("%.3f", contacts.calm.worst()),
          words("%.2f", contacts.stiffness.worst())};
}

/// Makes the table over tools or frames, and the numbers.
Table table_of(FigureResult& result, const char* title, const char* column,
               const std::vector<std::pair<std::string, RealContacts>>& rows) {
  Table table{title,
              {column, "contacts", "above 1.1 V, %", "above 1.05 V, %", "worst, V", "nothing steps",
               "above 1.05 V, %", "worst, V", "stiffness over section"},
              {}};
  for (const auto& [name, contacts] : rows) {
    table.rows.push_back(row_of(name, contacts));
    const std::string key = "real." + name + ".";
    result.numbers.push_back({key + "above_1.1", 100 * contacts.all.share_above(kLong), "%"});
    result.numbers.push_back({key + "above_bound", 100 * contacts.all.share_above(kBound), "%"});
    result.numbers.push_back({key + "worst", contacts.all.worst(), "1"});
    result.numbers.push_back(
        {key + "calm.above_1.05", 100 * contacts.calm.share_above(kCalm), "%"});
    result.numbers.push_back({key + "calm.worst", contacts.calm.worst(), "1"});
    result.numbers.push_back({key + "stiffness", contacts.stiffness.worst(), "1"});
  }
  return table;
}

}  // namespace

Status add_recorded_contacts(FigureResult& result, Context& context) {
  const auto frames = real_frames(context);
  if (!frames) return frames.error();
  if (frames->empty()) {
    for (const char* claim : {kClaimOfBound, kClaimOfStiffness, kClaimOfCalm}) {
      result.claims.push_back({claim,
                               "The recorded frames are not here: give their folder with --data.",
                               Verdict::not_measured, Source::docs});
    }
    return Done{};
  }
  std::vector<std::shared_ptr<const Tool>> tools;
  std::vector<ContactProbe> feelers;  // [frame][tool]
  for (const auto& [shape, size] : kTools) {
    auto tool = context.tool(shape, size, kSilhouetteSpheres);
    if (!tool) return tool.error();
    tools.push_back(*std::move(tool));
  }
  for (const RealFrame& frame : *frames) {
    for (const auto& tool : tools) {
      auto feeler = probe_on(frame.seen, *tool);
      if (!feeler) return feeler.error();
      feelers.push_back(*std::move(feeler));
    }
  }
  const int num_poses = context.choose(1500, 300);
  std::vector<RealContacts> contacts(feelers.size());
  run_tasks(context, static_cast<int>(feelers.size()),
            static_cast<double>(feelers.size()) * num_poses / 100, [&](int task, Work& work) {
              const auto i = static_cast<std::size_t>(task);
              contacts[i] = contacts_of((*frames)[i / tools.size()], *tools[i % tools.size()],
                                        feelers[i], num_poses, 100 + i, work);
            });
  std::vector<std::pair<std::string, RealContacts>> by_tool, by_frame;
  for (const auto& [shape, size] : kTools) by_tool.push_back({shape, {}});
  for (const RealFrame& frame : *frames) by_frame.push_back({frame.name, {}});
  RealContacts all;
  for (std::size_t i = 0; i < contacts.size(); ++i) {
    for (RealContacts* sum :
         {&by_tool[i % tools.size()].second, &by_frame[i / tools.size()].second, &all}) {
      sum->all.add(contacts[i].all);
      sum->calm.add(contacts[i].calm);
      sum->stiffness.add(contacts[i].stiffness);
    }
  }
  by_tool.push_back({"all", all});
  result.tables.push_back(table_of(result, "|F| / V on recorded frames, by tool", "tool", by_tool));
  result.tables.push_back(
      table_of(result, "|F| / V on recorded frames, by frame", "frame", by_frame));
  result.claims.push_back(
      {kClaimOfBound,
       words("At most %.3f V at %zu contacts with %zu frames; %.2f %% are above 1.1 V.",
             all.all.worst(), all.all.values.size(), frames->size(),
             100 * all.all.share_above(kLong)),
       holds_up_to(all.all.worst(), kBound + kRounding), Source::docs});
  result.claims.push_back({kClaimOfStiffness,
                           words("At most %.1f sections.", all.stiffness.worst()),
                           holds_up_to(all.stiffness.worst(), kStiffness), Source::docs});
  const double calm = all.calm.share_above(kCalm);
  result.claims.push_back({kClaimOfCalm,
                           words("%.2f %% of %zu such contacts are above 1.05 V, at most %.3f V.",
                                 100 * calm, all.calm.values.size(), all.calm.worst()),
                           verdict_of_calm(calm, all.calm.worst())});
  result.notes.push_back(words(
      "Recorded frames: %d random poses a frame and tool, the center 2 cm in front of to 3 cm "
      "behind a measured pixel at 0.3 to 3 m; cube 6 cm, stylus 15 cm, finger of a gripper 10 cm "
      "of %d spheres "
      "each; contacts above 2 %% of the tool. Nothing steps: all pixels of the rectangle around "
      "the tool are valid, and no neighbor is more than 1.5 %% of the depth away.",
      num_poses, kSilhouetteSpheres));
  return Done{};
}

}  // namespace palpate::eval
