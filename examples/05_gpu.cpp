// The same measurement on an NVIDIA GPU, if there is one that this build of Palpate can use.
#include <cstdio>
#include <vector>

#include "palpate/palpate.h"

using namespace palpate;

int main() {
  const auto gpus = find_gpus();
  const Place place = gpus ? Place::cuda(gpus->front().index) : Place::cpu();
  if (gpus) {
    std::printf("on %s\n", gpus->front().name.c_str());
  } else {
    std::printf("on the processor: %s\n", gpus.error().message.c_str());
  }

  const Tool tool = Tool::pack(make_cylinder(0.02, 0.1, 64), {.max_spheres = 20000}).value();

  // Surfaces are made and queried where they are: images go to the GPU, or are there already
  // (DepthImageView::gpu), and wrenches come back.
  const std::vector<std::uint16_t> counts(640 * 480, 500);
  Sensor sensor = Sensor::create({640, 480, {525, 525, 319.5, 239.5}}, place).value();
  const Contact contact = Contact::create(tool, FieldMethod{}, place).value();
  const Pose X_WT{.translation = {0, 0, 0.5}};
  const ContactResult result =
      contact.measure(sensor.update({640, 480, counts.data(), 0.001}), X_WT);
  if (result.penetration.status.is_unmeasured()) return 1;
  std::printf("inside: %.1f %%\n", 100 * contact.fraction(result.penetration));
}
