#include "camber/scale/detail/length_measurements.h"

#include <Eigen/Cholesky>

namespace camber::detail {

GroundAtPixels::GroundAtPixels(const RoadPosterior& road, const PinholeCamera& camera,
                               std::vector<Eigen::Vector2d> at)
    : pixels(std::move(at)) {
  const auto count = static_cast<Eigen::Index>(pixels.size());
  rays.resize(3, count);
  mean.resize(count);
  by_pixel.resize(count, 2);
  const Eigen::Vector2d du(4, 0), dv(0, 2);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector2d& p = pixels[static_cast<std::size_t>(i)];
    rays.col(i) = camera.ray(p);
    mean[i] = road.inverse_depth(p);
    by_pixel(i, 0) = (road.inverse_depth(p + du) - road.inverse_depth(p - du)) / 8.0;
    by_pixel(i, 1) = (road.inverse_depth(p + dv) - road.inverse_depth(p - dv)) / 4.0;
  }
  covariance =
      road.covariance(road.of_inverse_depths(pixels, Eigen::MatrixXd::Identity(count, count)));
}

UpdatedDepths updated(const GroundAtPixels& ground,
                      const std::function<LinearisedLengths(const Eigen::VectorXd&)>& linearise) {
  UpdatedDepths out{ground.mean, ground.covariance};
  for (int iteration = 0; iteration < 5; ++iteration) {
    const LinearisedLengths l = linearise(out.mean);
    if (l.residual.size() == 0) return out;
    const Eigen::MatrixXd side = ground.covariance * l.by_inverse_depth.transpose();
    const Eigen::LDLT<Eigen::MatrixXd> spread(l.by_inverse_depth * side + l.covariance);
    const Eigen::VectorXd next =
        ground.mean +
        side * spread.solve(l.residual + l.by_inverse_depth * (out.mean - ground.mean));
    out.covariance = ground.covariance - side * spread.solve(side.transpose());
    if (!next.allFinite() || !((next.array() / ground.mean.array()).minCoeff() > 0.25)) return out;
    out.mean = next;
  }
  return out;
}

double mean_squared_innovation(const LinearisedLengths& lengths, const Eigen::MatrixXd& prior) {
  const Eigen::MatrixXd spread =
      lengths.by_inverse_depth * prior * lengths.by_inverse_depth.transpose() + lengths.covariance;
  return lengths.residual.dot(spread.ldlt().solve(lengths.residual)) /
         static_cast<double>(lengths.residual.size());
}

static double mean_squared_residual(const LinearisedLengths& lengths) {
  return lengths.residual.dot(lengths.covariance.ldlt().solve(lengths.residual)) /
         static_cast<double>(lengths.residual.size());
}

SolvedLengths solved(const GroundAtPixels& ground,
                     const std::function<LinearisedLengths(const Eigen::VectorXd&)>& linearise,
                     const Eigen::VectorXd& solution) {
  const LinearisedLengths at_solution = linearise(solution);
  SolvedLengths out;
  out.constraint.pixels = ground.pixels;
  out.constraint.by_inverse_depth = at_solution.by_inverse_depth;
  out.constraint.residual =
      at_solution.residual + at_solution.by_inverse_depth * (solution - ground.mean);
  out.constraint.covariance = at_solution.covariance;
  out.misfit_before = mean_squared_innovation(linearise(ground.mean), ground.covariance);
  out.misfit_after = mean_squared_residual(at_solution);
  return out;
}

}  // namespace camber::detail
