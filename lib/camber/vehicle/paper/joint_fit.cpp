#include "camber/vehicle/paper/joint_fit.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <stdexcept>

#include "camber/vehicle/detail/vehicle_answer.h"
#include "camber/vehicle/paper/cost_functions/base_point.h"
#include "camber/vehicle/paper/cost_functions/form_prior.h"
#include "camber/vehicle/paper/cost_functions/ground_contact.h"
#include "camber/vehicle/paper/cost_functions/keypoint_reprojection.h"
#include "camber/vehicle/paper/cost_functions/normal_alignment.h"
#include "camber/vehicle/paper/cost_functions/normal_disambiguation.h"
#include "camber/vehicle/paper/cost_functions/plane_consistency.h"
#include "camber/vehicle/paper/cost_functions/plane_prior.h"
#include "camber/vehicle/shape_prior.h"

namespace camber::paper {

namespace {

using namespace camber::internal;

/// Standard deviations of the terms.
struct Weights {
  double contact = 0.015;        // m
  double alignment = 0.008;      // rad
  double disambiguation = 0.01;  // of a cosine
  double base_point = 0.03;      // m
};

/// One vehicle's blocks.
struct Blocks {
  std::size_t index = 0;                        // of the detection
  std::unique_ptr<VehiclePosterior> posterior;  // of the vehicle by itself
  SE3 pose;
  Eigen::VectorXd form;
  Eigen::Vector4d plane;

  VehicleState state() const {
    VehicleState s;
    s.poses.assign(1, {pose.rotation_matrix(), pose.translation()});
    s.form.size = form.head<3>();
    s.form.shape = form.tail(form.size() - 3);
    return s;
  }
};

ceres::CostFunction* reprojection(const KeypointReprojection& term, bool analytic) {
  if (analytic) return KeypointReprojection::create(term);
  switch (term.point.basis.cols()) {
    case 0:
      return KeypointReprojection::create_automatic<0>(term);
    case 5:
      return KeypointReprojection::create_automatic<5>(term);
    case 10:
      return KeypointReprojection::create_automatic<10>(term);
    case 15:
      return KeypointReprojection::create_automatic<15>(term);
    default:
      return KeypointReprojection::create_automatic<20>(term);
  }
}

class JointProblem {
 public:
  JointProblem(const PinholeCamera& camera, const std::vector<VehicleDetection>& detections,
               const std::vector<SupportPlane>& supports,
               const std::vector<VehicleEstimate>& starts, const JointFitOptions& options)
      : camera_(camera),
        supports_(supports),
        options_(options),
        prior_(options.prior ? *options.prior : shipped_vehicle_prior()),
        huber_(options.huber) {
    for (std::size_t i = 0; i < detections.size(); ++i) {
      if (!std::isfinite(starts[i].reprojection_rmse_px)) continue;
      Blocks b;
      b.index = i;
      VehicleFitOptions fit;
      fit.keypoint_set = options.keypoint_set;
      fit.prior = options.prior;
      b.posterior = std::make_unique<VehiclePosterior>(camera, detections[i], supports[i], fit,
                                                       options.num_coefficients);
      const VehicleEstimate& start = starts[i];
      b.pose = start.pose.camera_from_vehicle;
      const int count = b.posterior->num_coefficients();
      b.form = Eigen::VectorXd::Zero(3 + count);
      b.form.head<3>() << start.pose.dimensions.length, start.pose.dimensions.width,
          start.pose.dimensions.height;
      for (int k = 0; k < std::min<int>(count, static_cast<int>(start.shape.size())); ++k) {
        b.form[3 + k] = start.shape[static_cast<std::size_t>(k)];
      }
      const Plane& plane = supports[i].plane.plane;
      b.plane << plane.normal, plane.offset;
      blocks_.push_back(std::move(b));
    }
    ceres::Problem::Options ownership;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.disable_all_safety_checks = true;
    problem_ = std::make_unique<ceres::Problem>(ownership);
    for (Blocks& b : blocks_) add_vehicle(b, detections[b.index].vehicle_class);
    add_links();
  }

  std::vector<Blocks>& blocks() { return blocks_; }

  void solve(JointFit* out) {
    ceres::Solver::Options solver;
    solver.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
    solver.num_threads = 1;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = 1e-4;
    solver.logging_type = ceres::SILENT;
    if (options_.iterative) {
      solver.linear_solver_type = ceres::CGNR;
      solver.preconditioner_type = ceres::JACOBI;
    } else {
      solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    }
    ceres::Solver::Summary summary;
    if (!options_.alternating) {
      ceres::Solve(solver, problem_.get(), &summary);
      out->initial_cost = summary.initial_cost;
      out->iterations = static_cast<int>(summary.iterations.size());
    } else {
      for (int round = 0; round < options_.rounds; ++round) {
        for (const bool form_free : {false, true}) {
          for (Blocks& b : blocks_) {
            set_free(b.form.data(), form_free);
            set_free(b.pose.data(), !form_free);
            set_free(b.plane.data(), !form_free);
          }
          ceres::Solve(solver, problem_.get(), &summary);
          if (round == 0 && !form_free) out->initial_cost = summary.initial_cost;
          out->iterations += static_cast<int>(summary.iterations.size());
        }
      }
      for (Blocks& b : blocks_) {
        set_free(b.pose.data(), true);
        set_free(b.plane.data(), true);
      }
    }
    out->final_cost = summary.final_cost;
    out->converged = summary.termination_type == ceres::CONVERGENCE;
    out->message = summary.message;
  }

  /// Covariance of (translation, rotation vector in the vehicle's frame, form) of every vehicle;
  /// empty where the problem is singular. (ceres::Covariance orders blocks by address, which would
  /// make the last bits differ from run to run.)
  std::vector<Eigen::MatrixXd> covariances() {
    ceres::Problem::EvaluateOptions options;
    std::vector<Eigen::Index> first;
    Eigen::Index total = 0;
    for (Blocks& b : blocks_) {
      options.parameter_blocks.insert(options.parameter_blocks.end(),
                                      {b.pose.data(), b.form.data(), b.plane.data()});
      first.push_back(total);
      total += 6 + b.form.size() + 3;
    }
    options.num_threads = 1;
    ceres::CRSMatrix jacobian;
    std::vector<Eigen::MatrixXd> out;
    if (!problem_->Evaluate(options, nullptr, nullptr, nullptr, &jacobian)) return out;
    Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(total, total);
    for (int row = 0; row < jacobian.num_rows; ++row) {
      const int begin = jacobian.rows[static_cast<std::size_t>(row)];
      const int end = jacobian.rows[static_cast<std::size_t>(row) + 1];
      for (int i = begin; i < end; ++i) {
        for (int j = begin; j < end; ++j) {
          hessian(jacobian.cols[static_cast<std::size_t>(i)],
                  jacobian.cols[static_cast<std::size_t>(j)]) +=
              jacobian.values[static_cast<std::size_t>(i)] *
              jacobian.values[static_cast<std::size_t>(j)];
        }
      }
    }
    const Eigen::LDLT<Eigen::MatrixXd> factors(hessian);
    if (factors.info() != Eigen::Success || !(factors.vectorD().minCoeff() > 0.0)) return out;
    const Eigen::MatrixXd all = factors.solve(Eigen::MatrixXd::Identity(total, total));
    for (std::size_t k = 0; k < blocks_.size(); ++k) {
      const Blocks& b = blocks_[k];
      const Eigen::Index form = b.form.size();
      // Tangent of the pose: half rotation vector in the camera's frame, then translation.
      Eigen::MatrixXd turn = Eigen::MatrixXd::Zero(6 + form, 6 + form);
      turn.block<3, 3>(0, 3).setIdentity();
      turn.block<3, 3>(3, 0) = 2.0 * b.pose.rotation_matrix().transpose();
      turn.bottomRightCorner(form, form).setIdentity();
      out.emplace_back(turn * all.block(first[k], first[k], 6 + form, 6 + form) * turn.transpose());
    }
    return out;
  }

 private:
  void set_free(double* block, bool free) {
    if (free) {
      problem_->SetParameterBlockVariable(block);
    } else {
      problem_->SetParameterBlockConstant(block);
    }
  }

  void add_vehicle(Blocks& b, const std::string& vehicle_class) {
    const int count = static_cast<int>(b.form.size()) - 3;
    problem_->AddParameterBlock(b.pose.data(), 7, &pose_manifold_);
    problem_->AddParameterBlock(b.form.data(), 3 + count);
    problem_->AddParameterBlock(b.plane.data(), 4, &plane_manifold_);
    const bool fixed = options_.fixed_weights;
    const ShapePrior& shape = prior_.shape(vehicle_class);
    const VehicleState state = b.state();
    const BodyView at = b.posterior->view(0, state);
    b.posterior->keypoints(0).prepare(at);
    for (const ObservedKeypoint& k : b.posterior->keypoints(0).observed(at)) {
      KeypointReprojection term;
      term.camera = camera_;
      term.point.mean = b.posterior->body().mean(k.point);
      term.point.basis = b.posterior->body().basis(k.point);
      term.pixel = k.pixel;
      term.sigma =
          fixed ? Eigen::Vector2d::Constant(k.seen ? 1.0 : 3.0) : Eigen::Vector2d(k.sigma_px);
      problem_->AddResidualBlock(reprojection(term, options_.analytic), &huber_, b.pose.data(),
                                 b.form.data());
    }
    const Weights w;
    const double contact = fixed ? 0.05 : w.contact, alignment = fixed ? 0.02 : w.alignment;
    problem_->AddResidualBlock(GroundContact::create(contact, options_.as_printed), &huber_,
                               b.pose.data(), b.plane.data());
    problem_->AddResidualBlock(NormalAlignment::create(alignment), &huber_, b.pose.data(),
                               b.plane.data());
    const Eigen::Vector3d up(0.0, -1.0, 0.0);
    problem_->AddResidualBlock(
        NormalDisambiguation::create(up, fixed ? 1.0 : w.disambiguation, options_.as_printed),
        &huber_, b.pose.data());
    // Wheels' contacts and bumpers' lower corners, of the form at the start.
    const Eigen::Vector3d size(b.form[0], b.form[2], b.form[1]);
    for (const int i : {0, 1, 10, 17}) {
      for (const double side : {1.0, -1.0}) {
        Eigen::Vector3d p = size.cwiseProduct(shape.mean.col(i));
        p.z() *= side;
        if (i < 2) p.y() = 0.0;
        // Eight points together measure what contact and alignment measure: their weight is shared.
        problem_->AddResidualBlock(
            BasePoint::create(p, fixed ? 0.05 : std::sqrt(8.0) * w.base_point, options_.as_printed),
            &huber_, b.pose.data(), b.plane.data());
      }
    }
    problem_->AddResidualBlock(VehiclePlanePrior::create(supports_[b.index].plane), &huber_,
                               b.plane.data());
    const Eigen::Index known = 3 + count;
    if (fixed) {
      const Eigen::Vector3d sigma = shape.parameters_covariance.diagonal().head<3>().cwiseSqrt();
      problem_->AddResidualBlock(
          DimensionRegulariser::create(shape.parameters_mean.head<3>(), sigma, count), nullptr,
          b.form.data());
      if (count > 0) {
        problem_->AddResidualBlock(ShapeRegulariser::create(count, 1.0), nullptr, b.form.data());
      }
    } else {
      problem_->AddResidualBlock(
          FormPrior::create(shape.parameters_mean.head(known),
                            shape.parameters_covariance.topLeftCorner(known, known)),
          nullptr, b.form.data());
    }
  }

  /// Every vehicle's plane with those of its two nearest neighbours.
  void add_links() {
    if (options_.links == PlaneLinks::kNone) return;
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      std::vector<std::pair<double, std::size_t>> near;
      for (std::size_t j = 0; j < blocks_.size(); ++j) {
        const double distance =
            (blocks_[i].pose.translation() - blocks_[j].pose.translation()).norm();
        if (j != i && distance < options_.link_reach) near.emplace_back(distance, j);
      }
      std::sort(near.begin(), near.end());
      for (std::size_t k = 0; k < std::min<std::size_t>(2, near.size()); ++k) {
        const auto [distance, j] = near[k];
        Blocks &a = blocks_[std::min(i, j)], &b = blocks_[std::max(i, j)];
        const std::pair<std::size_t, std::size_t> link{std::min(i, j), std::max(i, j)};
        if (std::find(links_.begin(), links_.end(), link) != links_.end()) continue;
        links_.push_back(link);
        if (options_.links == PlaneLinks::kConsistency) {
          const double slack = options_.fixed_weights ? 1.0 : std::max(distance, 1.0) / 10.0;
          problem_->AddResidualBlock(VehiclePlaneConsistency::create(0.05 * slack, 0.3 * slack),
                                     &huber_, a.plane.data(), b.plane.data());
        } else {
          // A kerb's height, and what the curvature's change leaves.
          problem_->AddResidualBlock(PlaneContinuity::create(0.1 + 0.005 * distance), &huber_,
                                     a.pose.data(), b.pose.data(), a.plane.data(), b.plane.data());
        }
      }
    }
  }

  const PinholeCamera& camera_;
  const std::vector<SupportPlane>& supports_;
  const JointFitOptions& options_;
  const VehiclePrior& prior_;
  ceres::HuberLoss huber_;
  PoseManifold pose_manifold_;
  PlaneManifold plane_manifold_;
  std::vector<Blocks> blocks_;
  std::vector<std::pair<std::size_t, std::size_t>> links_;
  std::unique_ptr<ceres::Problem> problem_;
};

}  // namespace

JointFitOptions JointFitOptions::paper() {
  JointFitOptions out;
  out.as_printed = true;
  out.fixed_weights = true;
  out.links = PlaneLinks::kConsistency;
  out.iterative = true;
  return out;
}

void JointFitOptions::validate() const {
  auto require = [](bool good, const char* name, double value, const char* bound) {
    if (!good) throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
  };
  require(num_coefficients >= 0 && num_coefficients <= kMaxCoefficients, "num_coefficients",
          num_coefficients, "in [0, 20]");
  require(analytic || num_coefficients % 5 == 0, "num_coefficients", num_coefficients,
          "a multiple of 5 with automatic derivatives");
  require(link_reach > 0.0, "link_reach", link_reach, "> 0");
  require(rounds >= 1, "rounds", rounds, ">= 1");
  require(huber > 0.0, "huber", huber, "> 0");
  require(max_iterations >= 1, "max_iterations", max_iterations, ">= 1");
  require(keypoint_set == KeypointSet::kSmall14 || keypoint_set == KeypointSet::kAll36,
          "keypoint_set", static_cast<int>(keypoint_set), "14 or 36");
}

JointFit fit_joint(const PinholeCamera& camera, const std::vector<VehicleDetection>& detections,
                   const std::vector<SupportPlane>& supports,
                   const std::vector<VehicleEstimate>& starts, const JointFitOptions& options) {
  options.validate();
  camera.validate();
  if (detections.size() != supports.size() || detections.size() != starts.size()) {
    throw std::invalid_argument(fmt::format("supports: {}, starts: {}, detections: {}",
                                            supports.size(), starts.size(), detections.size()));
  }
  JointFit out;
  out.vehicles = starts;
  for (const SupportPlane& s : supports) out.planes.push_back(s.plane.plane);
  JointProblem problem(camera, detections, supports, starts, options);
  out.solved = static_cast<int>(problem.blocks().size());
  if (out.solved == 0) return out;
  problem.solve(&out);
  std::vector<Eigen::MatrixXd> covariances;
  if (options.with_covariance) covariances = problem.covariances();
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  for (std::size_t k = 0; k < problem.blocks().size(); ++k) {
    Blocks& b = problem.blocks()[k];
    const VehicleState s = b.state();
    const ViewPose& pose = s.poses.front();
    if (!pose.translation.allFinite() || !(pose.translation.z() > 0.3)) continue;
    VehicleEstimate& vehicle = out.vehicles[b.index];
    const Eigen::Vector3d normal = b.plane.head<3>();
    out.planes[b.index] = {normal, b.plane[3]};
    const std::string unreliable = unreliable_reason(*b.posterior, 0, s, detections[b.index].box);
    if (!covariances.empty()) {
      write_answer(*b.posterior, 0, prior, s, covariances[k],
                   std::numeric_limits<double>::infinity(), &vehicle);
    } else {
      write_pose_and_form(prior, pose, s.form, &vehicle);
    }
    vehicle.plane = out.planes[b.index];
    finish_answer(supports[b.index], &vehicle);
    if (!unreliable.empty() && vehicle.status != Status::kFailed) {
      vehicle.status = Status::kNotObservable;
      vehicle.reason = unreliable;
    }
  }
  return out;
}

}  // namespace camber::paper
