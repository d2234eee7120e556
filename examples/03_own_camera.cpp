// A camera of one's own: images in meters as floating-point numbers, a measurement per image.
#include <cmath>
#include <cstdio>
#include <limits>
#include <vector>

#include "palpate/palpate.h"

using namespace palpate;

/// Stands in for a driver: a wall that comes nearer, 1 cm per image. NaN where nothing is measured.
std::vector<float> read_camera(int image, int width, int height) {
  std::vector<float> depth(static_cast<std::size_t>(width * height), 0.6f - 0.01f * image);
  for (int v = 0; v < height; ++v) depth[v * width] = std::numeric_limits<float>::quiet_NaN();
  return depth;
}

int main() {
  const Tool tool = Tool::pack(make_cylinder(0.02, 0.1, 64), {.max_spheres = 2000}).value();

  // All memory is allocated here; the loop below allocates nothing but the driver's images.
  const Camera camera{640, 480, {525, 525, 319.5, 239.5}};
  Sensor sensor = Sensor::create(camera).value();
  const Contact contact = Contact::create(tool).value();
  const Pose X_WT{.translation = {0, 0, 0.5}};

  for (int image = 0; image <= 10; ++image) {
    const std::vector<float> depth = read_camera(image, camera.width, camera.height);
    const SurfaceView surface = sensor.update({camera.width, camera.height, depth.data()});
    if (!sensor.status()) return 1;  // sensor.status().error().message says why
    const Penetration measured = contact.measure(surface, X_WT).penetration;
    std::printf("wall at %.2f m, inside: %.1f %%\n", 0.6 - 0.01 * image,
                100 * contact.fraction(measured));
  }
}
