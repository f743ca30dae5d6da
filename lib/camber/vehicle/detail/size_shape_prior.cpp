#include "camber/vehicle/detail/size_shape_prior.h"

#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

SizeShapePrior::SizeShapePrior(const VehiclePrior& prior, const std::string& vehicle_class,
                               int num_coefficients) {
  const ShapePrior& shape = prior.shape(vehicle_class);
  const int known = kSizeParameters + num_coefficients;
  mean_ = shape.parameters_mean.head(known);
  Eigen::MatrixXd covariance = shape.parameters_covariance.topLeftCorner(known, known);
  if (!prior.has_shape(vehicle_class)) {
    const SizePrior size = prior.size(vehicle_class);
    mean_.head<kSizeParameters>() = size.mean;
    covariance.setIdentity(known, known);
    covariance.topLeftCorner<kSizeParameters, kSizeParameters>() = size.covariance;
  }
  information_ = SymmetricFactors(covariance).inverse();
}

Form SizeShapePrior::mean() const {
  Form out;
  out.size = mean_size();
  out.shape = Eigen::VectorXd::Zero(num_coefficients());
  return out;
}

double SizeShapePrior::add(const Form& form, Eigen::Index first, NormalEquations* equations) const {
  const Eigen::Index known = mean_.size();
  Eigen::VectorXd difference(known);
  difference << form.size, form.shape;
  difference -= mean_;
  const Eigen::VectorXd gradient = information_ * difference;
  if (equations) {
    equations->hessian.block(first, first, known, known) += information_;
    equations->gradient.segment(first, known) += gradient;
  }
  return 0.5 * difference.dot(gradient);
}

}  // namespace camber::internal
