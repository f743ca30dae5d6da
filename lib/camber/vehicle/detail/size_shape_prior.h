#pragma once

// Prior of a vehicle's size and shape: a normal distribution, learnt (shape_prior.h).

#include "camber/vehicle/detail/body.h"
#include "camber/vehicle/detail/normal_equations.h"

namespace camber::internal {

class SizeShapePrior {
 public:
  /// @param vehicle_class  one without keypoint shapes has the size prior of its class.
  SizeShapePrior(const VehiclePrior& prior, const std::string& vehicle_class, int num_coefficients);

  int num_coefficients() const { return static_cast<int>(mean_.size()) - kSizeParameters; }
  Eigen::Vector3d mean_size() const { return mean_.head<kSizeParameters>(); }
  Form mean() const;

  /// Adds its minus log density, optionally with its normal equations.
  /// @param first  of size and coefficients among the parameters.
  double add(const Form& form, Eigen::Index first, NormalEquations* equations) const;

 private:
  Eigen::VectorXd mean_;  // size, coefficients
  Eigen::MatrixXd information_;
};

}  // namespace camber::internal
