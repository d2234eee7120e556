#include "src/cloud/surface/adaptive/adaptive_filter.h"

#include <algorithm>

#include "src/cloud/surface/adaptive/noise_fit.h"
#include "src/core/internal/for_rows.h"

namespace palpate { inline namespace v0 {
namespace {

constexpr int kCountTasks = 8;  ///< tasks that count details, each with counts of its own

ScaleRows rows_for(Isa isa) {
#if defined(__x86_64__)
  if (isa == Isa::avx512) return isa_avx512::scale_rows();
  if (isa == Isa::avx2) return isa_avx2::scale_rows();
#endif
  (void)isa;
  return isa_baseline::scale_rows();
}

/// Returns the cells of the next wider level that hold those of a window.
PixelWindow halved(const PixelWindow& w) {
  return {w.left / 2, w.top / 2, (w.right + 1) / 2, (w.bottom + 1) / 2};
}
PixelWindow doubled(const PixelWindow& w) {
  return {2 * w.left, 2 * w.top, 2 * w.right, 2 * w.bottom};
}

/// The cells of one level that the smoothed pixels of a window depend on.
struct NeededCells {
  PixelWindow smoothed, energy, predicted;
};

/// A prediction reaches two cells far, an energy one and all finer ones of its cell, and a mean of
/// details two.
std::array<NeededCells, kNumScales> needed_cells(
    const std::array<ScaleLevel, kNumScales + 1>& levels, const PixelWindow& window) {
  std::array<NeededCells, kNumScales> needed;
  const auto clipped = [&](const PixelWindow& w, std::size_t level) {
    return w.clipped(levels[level].width, levels[level].height);
  };
  needed[0].smoothed = clipped(window, 0);
  if (needed[0].smoothed.is_empty()) needed[0].smoothed = {0, 0, 0, 0};
  for (std::size_t level = 1; level < needed.size(); ++level) {
    needed[level].smoothed = clipped(halved(needed[level - 1].smoothed).grown(2), level);
  }
  for (std::size_t level = needed.size(); level-- > 0;) {
    NeededCells& own = needed[level];
    const bool is_widest = level + 1 == needed.size();
    own.energy = is_widest ? own.smoothed : clipped(doubled(needed[level + 1].energy), level);
    own.predicted = clipped(own.energy.grown(2), level);
  }
  return needed;
}

}  // namespace

AdaptiveFilter::AdaptiveFilter(int width, int height, Isa isa)
    : rows_(rows_for(std::min(isa, best_isa()))), counts_(kCountTasks) {
  constexpr int kMargin = ScaleImage::kMargin;
  constexpr int kArrays = 4;
  std::array<std::size_t, kNumScales + 1> sizes{};
  std::size_t total = 0;
  for (std::size_t number = 0; number < levels_.size(); ++number) {
    ScaleLevel& level = levels_[number];
    level.width = width;
    level.height = height;
    level.mean.stride = width + 2 * kMargin + ScaleImage::kEnd;
    sizes[number] = static_cast<std::size_t>(level.mean.stride) *
                    static_cast<std::size_t>(height + 2 * kMargin);
    total += kArrays * sizes[number];
    width = (width + 1) / 2;
    height = (height + 1) / 2;
  }
  memory_.assign(total, 0.0f);
  float* next = memory_.data();
  for (std::size_t number = 0; number < levels_.size(); ++number) {
    ScaleLevel& level = levels_[number];
    const std::ptrdiff_t stride = level.mean.stride;
    for (ScaleImage* const image :
         {&level.mean, &level.predicted, &level.energy, &level.smoothed}) {
      *image = {next + kMargin * stride + kMargin, stride};
      next += sizes[number];
    }
  }
}

void AdaptiveFilter::count_details(ThreadPool& pool) {
  pool.parallel_for(kCountTasks, [&](int task) {
    std::array<DetailCounts, kNumScales>& counts = counts_[static_cast<std::size_t>(task)];
    for (int number = 0; number < kNumScales; ++number) {
      DetailCounts& of = counts[static_cast<std::size_t>(number)];
      of.clear();
      const ScaleLevel& level = levels_[static_cast<std::size_t>(number)];
      const int step = count_step(number);
      for (int v = task * step; v < level.height; v += kCountTasks * step) {
        const float* const mean = level.mean.row(v);
        const float* const predicted = level.predicted.row(v);
        for (int u = 0; u < level.width; u += step) {
          if (mean[u] > 0 && predicted[u] > 0) of.add(mean[u], mean[u] - predicted[u]);
        }
      }
    }
  });
  for (std::size_t task = 1; task < counts_.size(); ++task) {
    for (std::size_t level = 0; level < kNumScales; ++level) {
      counts_[0][level].add(counts_[task][level]);
    }
  }
  noise_ = noise_of(counts_[0]);
}

FrameNoise AdaptiveFilter::noise() const { return frame_noise_of(noise_.data()); }

void AdaptiveFilter::run(const FilterPass& pass, const PixelWindow& window, ThreadPool& pool) {
  const auto at = [&](int level) -> ScaleLevel& {
    return levels_[static_cast<std::size_t>(level)];
  };
  const auto noise = [&](int level) -> const ScaleNoise& {
    return noise_[static_cast<std::size_t>(level)];
  };
  const auto predict = [&](int level, const ScaleImage& from, const ScaleImage& to, Columns columns,
                           int v) {
    rows_.predict(at(level + 1), level + 1, from, at(level), to, columns, v);
  };
  const std::array<NeededCells, kNumScales> needed = needed_cells(levels_, window);

  for_rows(pool, 0, at(0).height, [&](int v) { rows_.begin(pass, at(0), v); });
  for (int level = 1; level <= kNumScales; ++level) {
    for_rows(pool, 0, at(level).height,
             [&](int v) { rows_.widen(at(level - 1), level, at(level), v); });
  }
  // Predicts the cells that are counted or needed.
  for (int level = 0; level < kNumScales; ++level) {
    const PixelWindow own = halved(needed[static_cast<std::size_t>(level)].predicted);
    const ScaleLevel& wider = at(level + 1);
    for_rows(pool, 0, wider.height, [&](int v) {
      const Columns all{0, wider.width};
      const bool is_counted = 2 * v % count_step(level) == 0;
      const bool is_needed = v >= own.top && v < own.bottom;
      const Columns columns = is_counted ? all : Columns{own.left, own.right};
      if (is_counted || is_needed) predict(level, wider.mean, at(level).predicted, columns, v);
    });
  }
  count_details(pool);
  for (int level = 0; level < kNumScales; ++level) {
    const PixelWindow own = needed[static_cast<std::size_t>(level)].energy;
    const ScaleLevel* const finer = level == 0 ? nullptr : &at(level - 1);
    for_rows(pool, own.top, own.bottom, [&](int v) {
      rows_.find_energy(finer, noise(level), at(level), {own.left, own.right}, v);
    });
  }
  for (int level = kNumScales - 1; level >= 0; --level) {
    const PixelWindow own = needed[static_cast<std::size_t>(level)].smoothed, above = halved(own);
    const bool is_widest = level == kNumScales - 1;
    const ScaleLevel* const wider = is_widest ? nullptr : &at(level + 1);
    for_rows(pool, above.top, above.bottom, [&](int v) {
      predict(level, is_widest ? at(level + 1).mean : wider->smoothed, at(level).smoothed,
              {above.left, above.right}, v);
    });
    for_rows(pool, own.top, own.bottom, [&](int v) {
      rows_.smooth(level, wider, noise(level), at(level), {own.left, own.right}, v);
    });
  }
  const PixelWindow own = needed[0].smoothed;
  for_rows(pool, own.top, own.bottom, [&](int v) {
    rows_.finish(at(0), pass, {own.left, own.right}, v);
  });
}

}}  // namespace palpate::v0
