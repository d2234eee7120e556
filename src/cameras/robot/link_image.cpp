#include "src/cameras/internal/link_image.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace palpate { inline namespace v0 {
namespace {

/// to[i] = the largest of from[i] and from[i + apart].
void join(const float* __restrict from, const float* __restrict beside, float* __restrict to,
          int num) {
  for (int i = 0; i < num; ++i) to[i] = larger(from[i], beside[i]);
}

void join_to(const float* __restrict from, float* __restrict to, int num) {
  for (int i = 0; i < num; ++i) to[i] = larger(from[i], to[i]);
}

}  // namespace

LinkImage::LinkImage(const Intrinsics& intrinsics, double padding)
    : intrinsics_(intrinsics), padding_(padding), shells_(kNumLinkShells) {}

void LinkImage::begin(int width, int height) {
  camera_ = link_camera(intrinsics_, width, height, padding_);
  if (width != width_ || height != height_) {
    front_.assign(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0);
    width_ = width;
    height_ = height;
  } else {
    for (int v = covered_.top; v < covered_.bottom; ++v) {
      float* const row = front_.data() + static_cast<std::ptrdiff_t>(v) * width_;
      std::fill(row + covered_.left, row + covered_.right, 0.0f);
    }
  }
  covered_ = {width, height, 0, 0};
  for (Shell& shell : shells_) {
    shell.triangles.clear();
    shell.nearest = 0;
  }
}

void LinkImage::add(const TriangleMesh& mesh, const Pose& X_CL) {
  const Mat3d R_CL = rotation_matrix(X_CL.rotation);
  vertices_.clear();
  for (const Vec3d& p_L : mesh.vertices) {
    vertices_.push_back(camera_.vertex_at(R_CL * p_L + X_CL.translation));
  }
  for (const auto& ids : mesh.triangles) {
    const LinkVertex &a = vertices_[ids[0]], &b = vertices_[ids[1]], &c = vertices_[ids[2]];
    if (a.corner.w > 0 && b.corner.w > 0 && c.corner.w > 0) {  // most of them
      add_triangle({{a.corner, b.corner, c.corner}});
      continue;
    }
    LinkCorner corners[4];
    const int num = cut_at_nearest(camera_, {&a, &b, &c}, corners);
    for (int i = 2; i < num; ++i) add_triangle({{corners[0], corners[i - 1], corners[i]}});
  }
}

/// Adds a triangle in pieces of which no corner is padded much wider than it needs.
void LinkImage::add_triangle(const LinkTriangle& triangle) {
  const auto add_piece = [this](const LinkTriangle& piece) {
    const float nearest = piece.nearest();
    Shell& shell = shells_[static_cast<std::size_t>(shell_of(nearest))];
    shell.triangles.push_back(piece);
    shell.nearest = larger(shell.nearest, nearest);
  };
  if (!camera_.is_padded_too_wide(triangle)) {
    add_piece(triangle);
    return;
  }
  LinkPieces pieces(triangle);
  for (LinkTriangle piece; pieces.take(piece);) {
    if (camera_.is_padded_too_wide(piece) && pieces.cut(piece)) continue;
    add_piece(piece);
  }
}

void LinkImage::draw() {
  for (const Shell& shell : shells_) {
    if (!shell.triangles.empty()) draw_shell(shell);
  }
}

void LinkImage::draw_shell(const Shell& shell) {
  const int radius = camera_.radius_of(shell.nearest);
  // Triangles beside the image reach into it by the padding.
  LinkWindow drawn{width_ + radius, height_ + radius, -radius, -radius};
  const LinkWindow all{-radius, -radius, width_ + radius, height_ + radius};
  for (const LinkTriangle& triangle : shell.triangles) {
    const LinkWindow box = LinkRaster::box_of(triangle).common(all);
    if (box.is_empty()) continue;
    drawn = {std::min(drawn.left, box.left), std::min(drawn.top, box.top),
             std::max(drawn.right, box.right), std::max(drawn.bottom, box.bottom)};
  }
  if (drawn.is_empty()) return;
  canvas_.assign(static_cast<std::size_t>(drawn.width()) * drawn.height(), 0);
  for (const LinkTriangle& triangle : shell.triangles) draw_triangle(triangle, drawn);
  widen_rows(drawn, radius);
  const int width = drawn.width() + 2 * radius, height = drawn.height() + 2 * radius;
  widen_columns(width, height, radius);

  const int first_u = drawn.left - radius, first_v = drawn.top - radius;
  const LinkWindow box = LinkWindow{first_u, first_v, first_u + width, first_v + height}.common(
      {0, 0, width_, height_});
  for (int v = box.top; v < box.bottom; ++v) {
    float* const front = front_.data() + static_cast<std::ptrdiff_t>(v) * width_ + box.left;
    const float* const from =
        wide_.data() + static_cast<std::ptrdiff_t>(v - first_v) * width + (box.left - first_u);
    for (int i = 0; i < box.width(); ++i) front[i] = larger(front[i], from[i]);
  }
  if (box.is_empty()) return;
  covered_ = {std::min(covered_.left, box.left), std::min(covered_.top, box.top),
              std::max(covered_.right, box.right), std::max(covered_.bottom, box.bottom)};
}

void LinkImage::draw_triangle(const LinkTriangle& triangle, const LinkWindow& canvas) {
  draw_rows(triangle, canvas, [&](int v, const LinkRaster::Row& row, const LinkRaster& raster) {
    float* const to =
        canvas_.data() + static_cast<std::ptrdiff_t>(v - canvas.top) * canvas.width() - canvas.left;
    for (int u = row.first; u < row.end; ++u) to[u] = larger(to[u], raster.at(row, u));
  });
}

/// From `canvas_` into `wide_`, which has `radius` more pixels on all sides: the largest number
/// within `radius` columns.
void LinkImage::widen_rows(const LinkWindow& drawn, int radius) {
  const int span = 2 * radius + 1, width = drawn.width() + 2 * radius;
  const auto length = static_cast<std::size_t>(width + span);
  wide_.assign(static_cast<std::size_t>(width) * (drawn.height() + 2 * radius), 0);
  row_.assign(length, 0);
  other_row_.assign(length, 0);
  for (int v = 0; v < drawn.height(); ++v) {
    const float* const from = canvas_.data() + static_cast<std::ptrdiff_t>(v) * drawn.width();
    std::fill(row_.begin(), row_.end(), 0.0f);
    // A number is in the windows of the `span` columns from here on.
    std::copy(from, from + drawn.width(), row_.begin() + 2 * radius);
    int reach = 1;  // row_[i] is the largest of so many from i on
    for (; 2 * reach <= span; reach *= 2) {
      join(row_.data(), row_.data() + reach, other_row_.data(), width + span - (2 * reach - 1));
      std::swap(row_, other_row_);
    }
    float* const to = wide_.data() + static_cast<std::ptrdiff_t>(v + 2 * radius) * width;
    join(row_.data(), row_.data() + (span - reach), to, width);
  }
}

/// In place: the largest number within `radius` rows, of rows of which the first 2 * radius are
/// empty.
void LinkImage::widen_columns(int width, int height, int radius) {
  const int span = 2 * radius + 1;
  // Row v becomes the largest of those from v to v + span - 1; beyond the last one they are empty.
  const auto join_rows = [&](int apart) {
    for (int v = 0; v + apart < height; ++v) {
      float* const row = wide_.data() + static_cast<std::ptrdiff_t>(v) * width;
      join_to(row + static_cast<std::ptrdiff_t>(apart) * width, row, width);
    }
  };
  int reach = 1;
  for (; 2 * reach <= span; reach *= 2) join_rows(reach);
  join_rows(span - reach);
}

int LinkImage::remove_from(DepthFrame& frame) const {
  int num = 0;
  const auto padding = static_cast<float>(padding_), unit = static_cast<float>(frame.unit);
  for (int v = covered_.top; v < covered_.bottom; ++v) {
    const std::ptrdiff_t begin = static_cast<std::ptrdiff_t>(v) * width_ + covered_.left;
    std::uint16_t* const pixels = frame.pixels.data() + begin;
    const float* const front = front_.data() + begin;
    for (int i = 0; i < covered_.width(); ++i) {
      const bool is_removed = shows_link(pixels[i], unit, padding, front[i]);
      num += is_removed;
      pixels[i] = is_removed ? std::uint16_t(0) : pixels[i];
    }
  }
  return num;
}

double LinkImage::limit_at(int u, int v) const {
  const double front =
      double(front_[static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) + u]);
  return front > 0 ? 1 / front - padding_ : std::numeric_limits<double>::infinity();
}

}}  // namespace palpate::v0
