#include "camber/vehicle/paper/terms.h"

#include <fmt/format.h>

#include <stdexcept>

namespace camber::paper {

std::string to_string(Terms terms) { return terms == Terms::kMeant ? "meant" : "printed"; }

Terms terms_from_string(const std::string& name) {
  if (name == "meant") return Terms::kMeant;
  if (name == "printed") return Terms::kPrinted;
  throw std::invalid_argument(fmt::format("terms: \"{}\", must be meant or printed", name));
}

void Weights::validate() const {
  const auto positive = [](const char* name, double value) {
    if (!(value > 0.0)) {
      throw std::invalid_argument(fmt::format("{}: {}, must be > 0", name, value));
    }
  };
  positive("keypoint_seen", keypoint_seen);
  positive("keypoint_hidden", keypoint_hidden);
  positive("keypoint_place", keypoint_place);
  positive("ground", ground);
  positive("normal", normal);
  positive("disambiguation", disambiguation);
  positive("base_point", base_point);
  positive("consistency_normal", consistency_normal);
  positive("consistency_offset", consistency_offset);
  positive("continuity", continuity);
  positive("dimensions", dimensions);
  positive("shape", shape);
  positive("huber", huber);
  if (!(seen_confidence >= 0.0 && seen_confidence <= 1.0)) {
    throw std::invalid_argument(
        fmt::format("seen_confidence: {}, must be in [0, 1]", seen_confidence));
  }
}

}  // namespace camber::paper
