#include "camber/geometry/lens_distortion.h"

#include <cmath>
#include <stdexcept>

namespace camber {

void LensDistortion::validate() const {
  raw.validate();
  for (const double c : coefficients) {
    if (!std::isfinite(c)) throw std::invalid_argument("coefficients are not finite");
  }
  const std::size_t count = coefficients.size();
  const bool fits = model == LensModel::kNone      ? count == 0
                    : model == LensModel::kFisheye ? count == 4
                                                   : count == 4 || count == 5 || count == 8;
  if (!fits) {
    const char* expected = model == LensModel::kNone      ? "none"
                           : model == LensModel::kFisheye ? "4"
                                                          : "4, 5 or 8";
    throw std::invalid_argument("found " + std::to_string(count) + " coefficients, expected " +
                                expected + " for the model " + to_string(model));
  }
}

std::string to_string(LensModel model) {
  switch (model) {
    case LensModel::kBrown:
      return "brown";
    case LensModel::kFisheye:
      return "fisheye";
    case LensModel::kNone:
      break;
  }
  return "none";
}

}  // namespace camber
