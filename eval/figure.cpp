#include "eval/figure.h"

namespace palpate::eval {

std::vector<FigureSpec> all_figures() {
  std::vector<FigureSpec> all;
  for (const auto group : {speed_figures, recorded_figures, protocol_figures, synthetic_figures,
                           accuracy_figures, option_figures, edge_figures, silhouette_figures,
                           time_figures, frame_figures, robustness_figures, rig_figures,
                           response_figures, cube_figures, flat_figures, peer_figures, drawings}) {
    for (const FigureSpec& figure : group()) all.push_back(figure);
  }
  return all;
}

}  // namespace palpate::eval
