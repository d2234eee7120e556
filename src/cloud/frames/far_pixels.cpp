#include "src/cloud/frames/far_pixels.h"

#include <algorithm>
#include <bit>
#include <cstddef>

namespace palpate { inline namespace v0 {
namespace {

constexpr int kWordBits = 64;

}  // namespace

FarGroups::FarGroups(int width, int height)
    : width_(width),
      height_(height),
      words_per_row_((width + kWordBits - 1) / kWordBits),
      bits_(static_cast<std::size_t>(words_per_row_) * static_cast<std::size_t>(height)),
      runs_(std::make_unique_for_overwrite<Run[]>(static_cast<std::size_t>((width + 1) / 2) *
                                                  static_cast<std::size_t>(height))) {}

/// Calls use(left, right) for each run of far pixels [left, right).
template <class Use>
void FarGroups::for_runs_of_row(int v, const PixelWindow& area, const Use& use) const {
  const std::uint64_t* const words = bits_.data() + std::ptrdiff_t{v} * words_per_row_;
  int left = -1;  // of the run that is open
  for (int word = area.left / kWordBits; word * kWordBits < area.right; ++word) {
    std::uint64_t changes = words[word];  // with the bit before: where runs begin and end
    if (left < 0 && changes == 0) continue;
    changes ^= changes << 1 | (left < 0 ? 0 : 1);
    for (; changes != 0; changes &= changes - 1) {
      const int u = word * kWordBits + std::countr_zero(changes);
      if (left < 0) {
        left = u;
        continue;
      }
      if (u > area.left && left < area.right)
        use(std::max(left, area.left), std::min(u, area.right));
      left = -1;
    }
  }
  if (left >= 0 && left < area.right) use(std::max(left, area.left), area.right);
}

std::int32_t FarGroups::group_of(std::int32_t run) {
  while (runs_[run].group != run) {
    runs_[run].group = runs_[runs_[run].group].group;
    run = runs_[run].group;
  }
  return run;
}

void FarGroups::find_runs(const PixelWindow& area) {
  num_runs_ = 0;
  std::int32_t above = 0, end_above = 0;  // the runs of the row before that may touch the next one
  for (int v = area.top; v < area.bottom; ++v) {
    const std::int32_t first = num_runs_;
    for_runs_of_row(v, area, [&](int left, int right) {
      const std::int32_t number = num_runs_++;
      Run& run = runs_[number];
      run.group = number;
      run.row = static_cast<std::uint16_t>(v);
      run.left = static_cast<std::uint16_t>(left);
      run.right = static_cast<std::uint16_t>(right);
      while (above < end_above && runs_[above].right < left) ++above;
      for (std::int32_t i = above; i < end_above && runs_[i].left <= right; ++i) {
        const std::int32_t a = group_of(i), b = group_of(number);
        runs_[std::max(a, b)].group = std::min(a, b);
      }
    });
    above = first;
    end_above = num_runs_;
  }
}

void FarGroups::measure_groups() {
  for (std::int32_t i = 0; i < num_runs_; ++i) {
    Run& run = runs_[i];
    run.group = group_of(i);
    Run& group = runs_[run.group];
    if (run.group == i) {
      group.num = 0;
      group.group_left = run.left;
      group.group_right = run.right;
      group.nearest = kNoDepth;
      group.farthest = 0;
    }
    group.num += run.right - run.left;
    group.group_left = std::min(group.group_left, run.left);
    group.group_right = std::max(group.group_right, run.right);
    group.group_bottom = run.row;
  }
}

void FarGroups::look_beside(const float* depth, std::ptrdiff_t stride) {
  for (std::int32_t i = 0; i < num_runs_; ++i) {
    const Run& run = runs_[i];
    Run& group = runs_[run.group];
    if (group.num < kMinFarPixels || group.side() > kFarSide) continue;  // decided already
    for (int v = run.row - 1; v <= run.row + 1; ++v) {
      const float* const row = depth + v * stride;
      for (int u = run.left - 1; u <= run.right; ++u) {  // into the margin
        if (!(row[u] < kAnyDepth)) continue;
        group.nearest = std::min(group.nearest, row[u]);
        group.farthest = std::max(group.farthest, row[u]);
      }
    }
  }
}

void FarGroups::drop_errors(float* depth, std::ptrdiff_t stride, const PixelWindow& window) {
  // A group that goes on beyond is larger than an error.
  find_runs(window.grown(kFarSide + 1).clipped(width_, height_));
  measure_groups();
  look_beside(depth, stride);
  const PixelWindow own = window.clipped(width_, height_);
  for (std::int32_t i = 0; i < num_runs_; ++i) {
    const Run& run = runs_[i];
    const Run& group = runs_[run.group];
    if (!is_far_error(group.num, group.side(), group.nearest, group.farthest)) continue;
    if (run.row < own.top || run.row >= own.bottom) continue;
    float* const row = depth + run.row * stride;
    for (int u = std::max<int>(run.left, own.left); u < std::min<int>(run.right, own.right); ++u) {
      row[u] = kNoDepth;
    }
  }
}

}}  // namespace palpate::v0
