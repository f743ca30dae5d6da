#include "camber/vehicle/paper/joint_fit.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/vehicle/detail/vehicle_answer.h"
#include "camber/vehicle/paper/detail/joint_problem.h"

namespace camber::paper {
namespace {

/// How the seen keypoints agree with an answer.
struct Agreement {
  int seen = 0, agreeing = 0;  // keypoints; those within three standard deviations
  double rmse_px = std::numeric_limits<double>::quiet_NaN();  // over the agreeing ones
};

Agreement agreement(const PinholeCamera& camera, const VehicleEstimate& vehicle,
                    const std::vector<WeighedKeypoint>& keypoints) {
  constexpr double kGate = 3.0;
  Agreement out;
  double sum = 0.0;
  for (const WeighedKeypoint& k : keypoints) {
    if (!k.seen) continue;
    ++out.seen;
    const auto pixel = camera.project(vehicle.keypoints[static_cast<std::size_t>(k.index)]);
    if (!pixel) continue;
    const Eigen::Vector2d off = *pixel - k.pixel;
    if (off.cwiseQuotient(k.sigma_px).norm() > kGate) continue;
    ++out.agreeing;
    sum += off.squaredNorm();
  }
  if (out.agreeing > 0) out.rmse_px = std::sqrt(sum / out.agreeing);
  return out;
}

/// Whether a depth is one that the vehicle's height in the image allows. A ground plane that is far
/// off, or seen edge-on, can draw a vehicle behind the camera or to infinity.
bool plausible_depth(const PinholeCamera& camera, const VehiclePrior& prior,
                     const VehicleEstimate& start, double depth) {
  constexpr double kFactor = 3.0;
  const double by_size =
      camera.fy * prior.size(start.vehicle_class).mean[2] / std::max(start.box.height(), 1.0);
  return depth > by_size / kFactor && depth < by_size * kFactor;
}

/// kWeak where the keypoints hardly agree or the position is hardly known.
void judge(const Agreement& seen, const AnswerGates& gates, VehicleEstimate* vehicle) {
  vehicle->status = Status::kOk;
  vehicle->reason.clear();
  const Eigen::Matrix3d place = vehicle->covariance.topLeftCorner<3, 3>();
  double sigma = 0.0;
  if (place.allFinite()) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(place, Eigen::EigenvaluesOnly);
    sigma = std::sqrt(std::max(spread.eigenvalues().maxCoeff(), 0.0));
  }
  if (seen.agreeing < std::max(gates.agreeing_keypoints, gates.agreeing_share * seen.seen)) {
    vehicle->status = Status::kNotObservable;
    vehicle->reason = "too few keypoints agree";
  } else if (sigma > gates.relative_sigma * vehicle->pose.bottom_center().norm()) {
    vehicle->status = Status::kWeak;
    vehicle->reason = fmt::format("position known to {:.1f} m only", sigma);
  }
}

}  // namespace

void JointFitOptions::validate() const {
  weights.validate();
  const auto require = [](bool good, const char* name, double value, const char* bound) {
    if (!good) throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
  };
  require(num_coefficients >= 0 && num_coefficients <= 20 && num_coefficients % 5 == 0,
          "num_coefficients", num_coefficients, "0, 5, 10, 15 or 20");
  require(link_reach > 0.0, "link_reach", link_reach, "> 0");
  require(rounds >= 1, "rounds", rounds, ">= 1");
  require(max_iterations >= 1, "max_iterations", max_iterations, ">= 1");
  require(function_tolerance > 0.0, "function_tolerance", function_tolerance, "> 0");
}

JointFit fit_joint(const PinholeCamera& camera, const std::vector<SupportPlane>& supports,
                   const std::vector<VehicleStart>& starts, const JointFitOptions& options) {
  options.validate();
  camera.validate();
  if (supports.size() != starts.size()) {
    throw std::invalid_argument(
        fmt::format("supports: {}, starts: {}", supports.size(), starts.size()));
  }
  JointFit out;
  for (const VehicleStart& start : starts) {
    out.vehicles.push_back(start.vehicle);
    out.planes.push_back(start.vehicle.plane);
  }
  internal::JointProblem problem(camera, supports, starts, options);
  out.solved = static_cast<int>(problem.blocks().size());
  out.links = problem.num_links();
  if (out.solved > 0) problem.solve(&out);
  std::vector<internal::JointProblem::Covariance> covariances;
  if (options.with_covariance && out.solved > 0) covariances = problem.covariances();
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  const VehicleNoise noise;
  for (std::size_t k = 0; k < problem.blocks().size(); ++k) {
    const internal::VehicleBlocks& b = problem.blocks()[k];
    const camber::internal::ViewPose pose{b.pose.rotation_matrix(), b.pose.translation()};
    camber::internal::Form form;
    form.size = b.form.head<3>();
    form.shape = b.form.tail(b.form.size() - 3);
    VehicleEstimate& vehicle = out.vehicles[b.index];
    if (!pose.translation.allFinite() ||
        !plausible_depth(camera, prior, vehicle, pose.translation.z())) {
      vehicle.status = Status::kNotObservable;
      vehicle.reason = "no place on its plane fits the keypoints; placed by its box";
      continue;
    }
    out.planes[b.index] = vehicle.plane = from_paper(b.plane);
    camber::internal::write_pose_and_form(prior, pose, form, &vehicle);
    if (!covariances.empty()) {
      vehicle.covariance =
          camber::internal::report_covariance(pose, form, covariances[k].vehicle, noise.form);
      vehicle.plane_sigma_height = std::sqrt(std::max(covariances[k].plane_height, 0.0));
    }
    const Agreement seen = agreement(camera, vehicle, starts[b.index].keypoints);
    vehicle.reprojection_rmse_px = seen.rmse_px;
    judge(seen, noise.answer, &vehicle);
  }
  for (std::size_t i = 0; i < starts.size(); ++i) {
    VehicleEstimate& vehicle = out.vehicles[i];
    if (vehicle.status == Status::kFailed) continue;
    const bool stated = vehicle.covariance.allFinite();
    if (stated) {
      camber::internal::finish_answer(supports[i], &vehicle);
    } else if (supports[i].status == Status::kNotObservable ||
               supports[i].status == Status::kFailed) {
      vehicle.status = Status::kNotObservable;
      if (vehicle.reason.empty()) vehicle.reason = "the plane below it is not observable";
    }
  }
  return out;
}

JointFit fit_frame(const PinholeCamera& camera, const std::vector<VehicleDetection>& detections,
                   const std::vector<SupportPlane>& supports, const JointFitOptions& options) {
  StartOptions start;
  start.weights = options.weights;
  start.keypoint_set = options.keypoint_set;
  start.prior = options.prior;
  return fit_joint(camera, supports, starts_on_planes(camera, detections, supports, start),
                   options);
}

}  // namespace camber::paper
