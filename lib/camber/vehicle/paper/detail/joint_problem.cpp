#include "camber/vehicle/paper/detail/joint_problem.h"

#include <algorithm>
#include <cmath>

#include "camber/vehicle/paper/cost_functions/base_point.h"
#include "camber/vehicle/paper/cost_functions/form_regularisers.h"
#include "camber/vehicle/paper/cost_functions/ground_constraint.h"
#include "camber/vehicle/paper/cost_functions/keypoint_reprojection.h"
#include "camber/vehicle/paper/cost_functions/normal_alignment.h"
#include "camber/vehicle/paper/cost_functions/normal_disambiguation.h"
#include "camber/vehicle/paper/cost_functions/plane_consistency.h"
#include "camber/vehicle/paper/cost_functions/plane_regulariser.h"

namespace camber::paper::internal {
namespace {

/// A keypoint of the mean shape with the first `count` coefficients.
WireframePoint wireframe_point(const ShapePrior& shape, int keypoint, int count) {
  const int row = keypoint % kNumSideKeypoints;
  const Eigen::Vector3d mirror(1.0, 1.0, keypoint < kNumSideKeypoints ? 1.0 : -1.0);
  WireframePoint out;
  out.mean = mirror.cwiseProduct(shape.mean.col(row));
  out.basis = Eigen::Matrix3Xd::Zero(3, count);
  for (int k = 0; k < std::min(count, shape.num_coefficients()); ++k) {
    out.basis.col(k) = mirror.cwiseProduct(shape.basis[static_cast<std::size_t>(k)].col(row));
  }
  return out;
}

/// Where a wheel touches the ground: below its centre.
WireframePoint wheel_contact(const ShapePrior& shape, int keypoint, int count) {
  WireframePoint out = wireframe_point(shape, keypoint, count);
  out.mean.y() = 0.0;
  out.basis.row(1).setZero();
  return out;
}

constexpr int kRearWheel = 0, kFrontWheel = 1, kRearBumper = 10, kFrontBumper = 17;

ceres::CostFunction* reprojection(const KeypointReprojection& term, bool analytic) {
  if (analytic) return KeypointReprojection::create(term);
  return with_coefficients(term.point.basis.cols(), [&](auto k) -> ceres::CostFunction* {
    return KeypointReprojection::create_automatic<decltype(k)::value>(term);
  });
}

}  // namespace

JointProblem::JointProblem(const PinholeCamera& camera, const std::vector<SupportPlane>& supports,
                           const std::vector<VehicleStart>& starts, const JointFitOptions& options)
    : camera_(camera),
      options_(options),
      prior_(options.prior ? *options.prior : shipped_vehicle_prior()),
      huber_(options.weights.huber) {
  for (std::size_t i = 0; i < starts.size(); ++i) {
    if (starts[i].keypoints.empty()) continue;
    const VehicleEstimate& start = starts[i].vehicle;
    VehicleBlocks b;
    b.index = i;
    b.pose = start.pose.camera_from_vehicle;
    b.form = Eigen::VectorXd::Zero(3 + options.num_coefficients);
    b.form.head<3>() << start.pose.dimensions.length, start.pose.dimensions.width,
        start.pose.dimensions.height;
    b.plane = to_paper(supports[i].plane.plane);
    blocks_.push_back(std::move(b));
  }
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.disable_all_safety_checks = true;
  problem_ = std::make_unique<ceres::Problem>(ownership);
  for (VehicleBlocks& b : blocks_) add_vehicle(b, starts[b.index], supports[b.index]);
  add_links();
}

void JointProblem::add_vehicle(VehicleBlocks& b, const VehicleStart& start,
                               const SupportPlane& support) {
  const Weights& w = options_.weights;
  const int count = options_.num_coefficients;
  const ShapePrior& shape = prior_.shape(start.vehicle.vehicle_class);
  problem_->AddParameterBlock(b.pose.data(), 7, &pose_manifold_);
  problem_->AddParameterBlock(b.form.data(), 3 + count);
  problem_->AddParameterBlock(b.plane.data(), 4, &plane_manifold_);
  if (options_.planes_fixed) problem_->SetParameterBlockConstant(b.plane.data());

  for (const WeighedKeypoint& k : start.keypoints) {  // L_r
    const KeypointReprojection term{camera_, wireframe_point(shape, k.index, count), k.pixel,
                                    k.sigma_px};
    problem_->AddResidualBlock(reprojection(term, options_.analytic), &huber_, b.pose.data(),
                               b.form.data());
  }
  add_ground_terms(b, shape);
  // L_reg
  const Eigen::Vector3d sigma =
      w.dimensions * shape.parameters_covariance.diagonal().head<3>().cwiseSqrt();
  problem_->AddResidualBlock(
      DimensionRegulariser::create(shape.parameters_mean.head<3>(), sigma, count), &huber_,
      b.form.data());
  if (count > 0) {
    problem_->AddResidualBlock(ShapeRegulariser::create(count, w.shape), &huber_, b.form.data());
  }
  if (!options_.planes_fixed) {
    problem_->AddResidualBlock(PlaneRegulariser::create(support.plane), &huber_, b.plane.data());
  }
}

/// L_g, L_n, L_d, L_b
void JointProblem::add_ground_terms(VehicleBlocks& b, const ShapePrior& shape) {
  const Weights& w = options_.weights;
  const int count = options_.num_coefficients;
  const bool printed = options_.terms == Terms::kPrinted;
  const WheelLine wheels{wireframe_point(shape, kRearWheel, count),
                         wireframe_point(shape, kFrontWheel, count)};
  double *pose = b.pose.data(), *form = b.form.data(), *plane = b.plane.data();
  if (printed) {
    problem_->AddResidualBlock(create_printed_ground_constraint(wheels, w.ground), &huber_, pose,
                               form, plane);
  } else {
    problem_->AddResidualBlock(GroundConstraint::create(w.ground), &huber_, pose, plane);
  }
  problem_->AddResidualBlock(create_normal_alignment(wheels, w.normal), &huber_, pose, form, plane);
  problem_->AddResidualBlock(create_normal_disambiguation(wheels, w.disambiguation, printed),
                             &huber_, pose, form, plane);
  for (const int side : {0, kNumSideKeypoints}) {
    for (const int row : {kRearWheel, kFrontWheel, kRearBumper, kFrontBumper}) {
      const bool wheel = row == kRearWheel || row == kFrontWheel;
      if (printed) {
        if (wheel) continue;  // always in the plane of the wheel centres
        problem_->AddResidualBlock(
            create_printed_base_point(wireframe_point(shape, row + side, count), wheels,
                                      w.base_point),
            &huber_, form);
      } else {
        const WireframePoint point = wheel ? wheel_contact(shape, row + side, count)
                                           : wireframe_point(shape, row + side, count);
        problem_->AddResidualBlock(create_base_point(point, w.base_point), &huber_, pose, form,
                                   plane);
      }
    }
  }
}

/// L_c: the planes of all vehicles whose bottom centres start within reach of each other.
void JointProblem::add_links() {
  if (options_.links == PlaneLinks::kNone || options_.planes_fixed) return;
  const Weights& w = options_.weights;
  for (std::size_t j = 0; j < blocks_.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      VehicleBlocks &a = blocks_[i], &b = blocks_[j];
      const double distance = (a.pose.translation() - b.pose.translation()).norm();
      if (!(distance <= options_.link_reach)) continue;
      ++num_links_;
      if (options_.links == PlaneLinks::kConsistency) {
        problem_->AddResidualBlock(
            VehiclePlaneConsistency::create(w.consistency_normal, w.consistency_offset), &huber_,
            a.plane.data(), b.plane.data());
      } else {
        problem_->AddResidualBlock(PlaneContinuity::create(w.continuity), &huber_, a.pose.data(),
                                   b.pose.data(), a.plane.data(), b.plane.data());
      }
    }
  }
}

ceres::Solver::Options JointProblem::solver_options() const {
  ceres::Solver::Options out;
  out.trust_region_strategy_type = ceres::LEVENBERG_MARQUARDT;
  out.num_threads = 1;
  out.max_num_iterations = options_.max_iterations;
  out.function_tolerance = options_.function_tolerance;
  out.gradient_tolerance = 1e-12;
  out.parameter_tolerance = 1e-12;
  out.logging_type = ceres::SILENT;
  if (options_.solver == LinearSolver::kConjugateGradients) {
    out.linear_solver_type = ceres::CGNR;
    out.preconditioner_type = ceres::JACOBI;
  } else {
    out.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  }
  return out;
}

void JointProblem::hold(bool poses, bool forms) {
  const auto set = [&](double* block, bool held) {
    if (held) {
      problem_->SetParameterBlockConstant(block);
    } else {
      problem_->SetParameterBlockVariable(block);
    }
  };
  for (VehicleBlocks& b : blocks_) {
    set(b.pose.data(), poses);
    set(b.plane.data(), poses || options_.planes_fixed);
    set(b.form.data(), forms);
  }
}

void JointProblem::solve(JointFit* out) {
  const ceres::Solver::Options solver = solver_options();
  ceres::Solver::Summary summary;
  const int rounds = options_.schedule == Schedule::kAlternating ? 2 * options_.rounds : 1;
  for (int round = 0; round < rounds; ++round) {
    if (rounds > 1) hold(round % 2 == 1, round % 2 == 0);
    ceres::Solve(solver, problem_.get(), &summary);
    if (round == 0) out->initial_cost = summary.initial_cost;
    out->iterations += static_cast<int>(summary.iterations.size());
  }
  if (rounds > 1) hold(false, false);
  out->final_cost = summary.final_cost;
  out->converged = summary.termination_type == ceres::CONVERGENCE;
  out->message = summary.message;
}

// (ceres::Covariance orders blocks by address, which would make the last bits differ from run to
// run.)
std::vector<JointProblem::Covariance> JointProblem::covariances() {
  ceres::Problem::EvaluateOptions evaluation;
  std::vector<Eigen::Index> first;
  Eigen::Index total = 0;
  const Eigen::Index form = 3 + options_.num_coefficients, plane = options_.planes_fixed ? 0 : 3;
  for (VehicleBlocks& b : blocks_) {
    evaluation.parameter_blocks.insert(evaluation.parameter_blocks.end(),
                                       {b.pose.data(), b.form.data()});
    if (plane > 0) evaluation.parameter_blocks.push_back(b.plane.data());
    first.push_back(total);
    total += 6 + form + plane;
  }
  evaluation.num_threads = 1;
  ceres::CRSMatrix jacobian;
  std::vector<Covariance> out;
  if (!problem_->Evaluate(evaluation, nullptr, nullptr, nullptr, &jacobian)) return out;
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
    const VehicleBlocks& b = blocks_[k];
    // Tangent of the pose: half rotation vector in the camera's frame, then translation.
    Eigen::MatrixXd turn = Eigen::MatrixXd::Zero(6 + form, 6 + form);
    turn.block<3, 3>(0, 3).setIdentity();
    turn.block<3, 3>(3, 0) = 2.0 * b.pose.rotation_matrix().transpose();
    turn.bottomRightCorner(form, form).setIdentity();
    Covariance c;
    c.vehicle = turn * all.block(first[k], first[k], 6 + form, 6 + form) * turn.transpose();
    if (plane > 0) {
      Eigen::Matrix<double, 4, 3, Eigen::RowMajor> by_tangent;
      plane_manifold_.PlusJacobian(b.plane.data(), by_tangent.data());
      Eigen::RowVector4d by_plane;
      by_plane << -b.pose.translation().transpose(), 1.0;
      const Eigen::RowVector3d j = by_plane * by_tangent;
      const Eigen::Index at = first[k] + 6 + form;
      c.plane_height = (j * all.block<3, 3>(at, at) * j.transpose())(0, 0);
    }
    out.push_back(std::move(c));
  }
  return out;
}

}  // namespace camber::paper::internal
