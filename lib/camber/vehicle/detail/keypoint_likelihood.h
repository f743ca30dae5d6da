#pragma once

// Likelihood of one view's keypoints: a mixture of what the network saw, guessed, and got grossly
// wrong; which of them it saw, by the side that the vehicle shows and by the confidences. Where the
// network states a sigma for each keypoint, that takes the place of all but the gross errors.
//
// Where the image's border cuts the box, a network puts what lies beyond it inside the box. Of a
// keypoint that it did not see the pixel is then compared with the point of the border nearest to
// the projection (a censored measurement: how far beyond the point lies leaves no trace).

#include <array>
#include <limits>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/vehicle/detail/body.h"
#include "camber/vehicle/detail/normal_equations.h"
#include "camber/vehicle/fit_vehicle.h"

namespace camber::internal {

/// Density of a keypoint's error under the mixture, with the posterior of its components.
struct ErrorDensity {
  double total = 0.0;             ///< 1 / cells^2
  double seen = 0.0, near = 0.0;  ///< parts of it: of the seen component; of all but far and gross
  double by_precision = 0.0, by_squared_precision = 0.0;  ///< sums of density / variance^1, ^2
  double seen_by_precision = 0.0;                         ///< part of by_precision

  /// Mean precision given the error: the weight of a least-squares step, 1 / cells^2.
  double weight() const { return by_precision / total; }
  /// The part of it that holds where the guesses are censored.
  double seen_weight() const { return seen_by_precision / total; }
  /// The share of the weight that holds along the error's own direction, as its component is not
  /// known: 1 - Var(precision) r^2 / E(precision), not below 0.
  double share_along(double squared_error) const;
};

/// One normal component of an error's density.
struct ErrorComponent {
  double share = 0.0;  ///< prior probability
  double sigma = 0.0;  ///< cells, each axis, without the shape's error
};
/// Seen, guessed or off, and far off; the rest of the probability is gross.
using ErrorComponents = std::array<ErrorComponent, 3>;

/// Squared distance of a pixel from the projection, cells^2.
struct SquaredError {
  double seen = 0.0;     ///< of a seen keypoint
  double guessed = 0.0;  ///< of any other; smaller where the image's border cuts the vehicle
};

/// @param gross_share  prior probability of an error anywhere in the crop.
ErrorDensity error_density(const KeypointNoise& noise, double gross_share,
                           const SquaredError& error, const ErrorComponents& components,
                           double shape_variance);

/// Of a keypoint whose sigma is not stated.
/// @param seen_share      prior probability that the network saw the keypoint
/// @param seen_scale      on the standard deviation of seen keypoints
/// @param shape_variance  cells^2, of its place by the shape error, each axis
ErrorDensity error_density(const KeypointNoise& noise, const SquaredError& error, double seen_share,
                           double seen_scale, double shape_variance);

/// A keypoint that the detection has, for the paper's joint problem.
struct ObservedKeypoint {
  int point = 0;  ///< of the body
  Eigen::Vector2d pixel;
  bool seen = false;         ///< likelier seen by the network than guessed
  Eigen::Vector2d sigma_px;  ///< u, v; with what the coefficients leave of the shape
};

class KeypointLikelihood {
 public:
  /// @param shape_variance  of each keypoint's shape error, m^2, each axis.
  /// @param mean_size       length, width and height of the prior's mean.
  /// @param cuts            where the image's border cuts the detection's box, px; else infinite.
  KeypointLikelihood(const PinholeCamera& camera, const VehicleDetection& detection,
                     KeypointSet keypoint_set, const KeypointNoise& noise,
                     const std::array<double, kNumKeypoints>& shape_variance,
                     const Eigen::Vector3d& mean_size, const Box2& cuts);

  /// Leaves the keypoints out.
  void clear();

  /// Probability that each keypoint was seen, from the side that the vehicle shows at this state
  /// (and from the confidences once they are trusted), and how large shape errors look. These stay
  /// as they are while a state is refined: were the spread of a keypoint to follow the state, its
  /// normaliser would favour small, far vehicles, the more so the more views share the errors.
  void update_visibility(const BodyView& at);

  /// Visibility; whether the confidences are used; the spread of seen keypoints: as a state shows
  /// them.
  void prepare(const BodyView& at);
  /// Uses the confidences if the likelihood of the residuals is clearly greater with them.
  void decide_on_confidence(const BodyView& at);
  /// Widens the noise of seen keypoints to what the residuals show (a weak prior on 1).
  void adapt_noise(const BodyView& at);

  /// Adds its minus log density; optionally its normal equations (a weighted least-squares step for
  /// the mixture).
  /// @param observed  its own second derivatives in place of the step's, which takes the components
  ///                  for known and so is a little too sure.
  /// @param errors    shape errors, if they are solved for too: their terms (without prior) go to
  ///                  *error_equations. nullptr: they are integrated out.
  /// @return minus log density
  double add(const BodyView& at, const ShapeErrors* errors, bool observed,
             NormalEquations* equations, ShapeErrorEquations* error_equations) const;

  /// Weights of the keypoints' u and v at a state, 1 / cells^2, in the order of points().
  std::vector<Eigen::Vector2d> weights(const BodyView& at, const ShapeErrors* errors) const;

  /// How the keypoints agree with a state.
  struct Agreement {
    double count = 0.0;  ///< expected number of keypoints that are not far off
    double rmse_px = std::numeric_limits<double>::quiet_NaN();  ///< over them
  };
  Agreement agreement(const BodyView& at) const;

  std::vector<ObservedKeypoint> observed(const BodyView& at) const;

  /// Points of the body that have a pixel, ascending.
  const std::vector<int>& points() const { return points_; }
  const Eigen::Vector3d& ray(std::size_t j) const { return rays_[j]; }
  double seen_share(std::size_t j) const { return seen_share_[j]; }
  double cell_u() const { return cell_u_; }  ///< px
  double cell_v() const { return cell_v_; }  ///< px
  /// d error in cells / d shape error in m, at the last update_visibility().
  const Eigen::Matrix<double, 2, 3>& cells_by_shape_error() const { return cells_by_shape_error_; }

 private:
  /// Of keypoint j's pixel by its shape error, cells^2, each axis.
  double shape_variance(std::size_t j) const;
  /// Of a pixel from the projection, cells.
  struct Error {
    Eigen::Vector2d off;                          ///< projection minus pixel
    Eigen::Array2<bool> beyond = {false, false};  ///< the projection lies beyond a cut of the box
    SquaredError squared;
    /// Of u and v, 1 / cells^2.
    Eigen::Vector2d weights(const ErrorDensity& d) const {
      return beyond.select(Eigen::Array2d::Constant(d.seen_weight()), d.weight());
    }
  };
  Error error(std::size_t j, const BodyView& at, const ShapeErrors* errors) const;
  ErrorDensity density(std::size_t j, const SquaredError& error, bool integrate_shape) const;
  /// cells, of a seen keypoint, each axis, before it is adapted.
  double seen_sigma(std::size_t j) const;

  KeypointNoise noise_;
  Eigen::Vector2d focal_;
  std::array<double, kNumKeypoints> shape_variance_;  // m^2
  double mean_size_;                                  // m, sum of the three
  double cell_u_ = 1.0, cell_v_ = 1.0;                // px
  Eigen::Array2d first_, last_;                       // px, cuts of the box
  std::vector<double> stated_;  // cells, sigmas that the network states; empty: none
  std::vector<int> points_;
  std::vector<Eigen::Vector2d> pixels_;
  std::vector<Eigen::Vector3d> rays_;
  std::vector<double> rank_;  // of the confidences, in [0, 1]; empty: none
  std::vector<double> seen_share_;
  bool use_confidence_ = false;
  double seen_scale_ = 1.0;
  double shape_error_scale_ = 1.0;  // cells^2 / m^2
  Eigen::Matrix<double, 2, 3> cells_by_shape_error_ = Eigen::Matrix<double, 2, 3>::Zero();  // 1/m
};

}  // namespace camber::internal
