// Features of both backends, each with a check that their results agree.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace palpate::test {

struct Feature {
  std::string name;
  /// Largest relative difference between the results of the two; 0: the same bits.
  double allowed = 0;
  /// Runs both and expects no greater difference.
  std::function<void(double allowed)> check;
  std::string on_cpu = "yes", on_cuda = "yes";
};

struct FeatureGroup {
  std::string title;
  std::vector<Feature> features;
};

/// From depth frames to surfaces.
std::vector<FeatureGroup> sensing_features();
/// From surfaces and poses to wrenches.
std::vector<FeatureGroup> contact_features();

}  // namespace palpate::test
