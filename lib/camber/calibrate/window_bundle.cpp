#include "camber/calibrate/window_bundle.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <utility>

namespace camber {
namespace {

constexpr int kLens = DriveLens::kSize, kPose = 6;
constexpr double kBehind = 1e4;  // px, error of a point that is behind a camera

/// Two unit vectors that span the tangent plane of the unit sphere at a direction.
Eigen::Matrix<double, 3, 2> tangents(const Eigen::Vector3d& direction) {
  Eigen::Matrix<double, 3, 2> out;
  out.col(0) = direction.unitOrthogonal();
  out.col(1) = direction.cross(out.col(0));
  return out;
}

/// A pose as the loops need it.
struct FramePose {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;

  Eigen::Vector3d in_camera(const WindowPoint& point) const {
    return rotation * point.direction + point.inverse_distance * translation;
  }
};

std::vector<FramePose> poses_of(const CalibrationWindow& window) {
  std::vector<FramePose> out;
  for (const SE3& pose : window.frame_from_reference) {
    out.push_back({pose.rotation_matrix(), pose.translation()});
  }
  return out;
}

double loss_of(double squared, const BundleLoss& loss) {
  const double w2 = loss.width * loss.width;
  return 0.5 * w2 / loss.correlation * std::log1p(squared / w2);
}

}  // namespace

/// One observation, linearised: errors and derivatives in standard deviations, weighted.
struct WeightedRow {
  Eigen::Vector2d error;
  Eigen::Matrix<double, 2, kLens> by_lens;
  Eigen::Matrix<double, 2, kPose> by_pose;
  Eigen::Matrix<double, 2, 3> by_point;
};

namespace {

/// @return nothing behind the camera.
std::optional<WeightedRow> linearise(const WindowPoint& point,
                                     const Eigen::Matrix<double, 3, 2>& basis,
                                     const WindowObservation& seen, const FramePose& pose,
                                     const DriveLens& lens, const BundleLoss& loss, double* cost) {
  const Eigen::Vector3d turned = pose.rotation * point.direction;
  const Eigen::Vector3d at = turned + point.inverse_distance * pose.translation;
  const auto projection = lens.project(at);
  if (!projection) {
    *cost += loss_of(std::pow(kBehind / loss.pixel_sigma, 2), loss);
    return std::nullopt;
  }
  const Eigen::Vector2d error = (projection->pixel - seen.pixel) / loss.pixel_sigma;
  const double squared = error.squaredNorm();
  *cost += loss_of(squared, loss);
  const double weight =
      1.0 / std::sqrt(loss.correlation * (1.0 + squared / (loss.width * loss.width)));
  const Eigen::Matrix<double, 2, 3> by_at = weight / loss.pixel_sigma * projection->by_point;
  WeightedRow out;
  out.error = weight * error;
  out.by_lens = weight / loss.pixel_sigma * projection->by_lens;
  out.by_pose.leftCols<3>() = -by_at * skew(turned);
  out.by_pose.rightCols<3>() = by_at * point.inverse_distance;
  out.by_point.leftCols<2>() = by_at * (pose.rotation * basis);
  out.by_point.col(2) = by_at * pose.translation;
  return out;
}

/// Travel against the mounting, standard deviations: by yaw and by pitch.
std::optional<Eigen::Vector2d> travel_error(const CalibrationWindow& window, const DriveLens& lens,
                                            double sigma) {
  const auto travel = travel_of_window(window);
  if (!travel) return std::nullopt;
  return Eigen::Vector2d((travel->x() + lens.yaw) / sigma, (travel->y() - lens.pitch) / sigma);
}

double travel_sigma(const CalibrationWindow& window) {
  const TravelNoise noise;
  const double turn = rotation_to_vector(window.frame_from_reference.back().rotation() *
                                         window.frame_from_reference.front().rotation().inverse())
                          .norm();
  return std::hypot(noise.straight, noise.of_turn * turn);
}

/// One pose moved by a step of its six parameters.
SE3 moved(const SE3& pose, const Eigen::Matrix<double, kPose, 1>& step) {
  return {rotation_from_vector(step.head<3>()) * pose.rotation(),
          pose.translation() + step.tail<3>()};
}

void damp(double damping, Eigen::Ref<Eigen::MatrixXd> block) {
  block.diagonal() *= 1.0 + damping;
  block.diagonal().array() += 1e-9;
}

}  // namespace

std::optional<Eigen::Vector2d> travel_of_window(const CalibrationWindow& window) {
  if (window.frame_from_reference.size() < 2) return std::nullopt;
  Eigen::Vector3d chord = window.frame_from_reference.back().inverse().translation() -
                          window.frame_from_reference.front().inverse().translation();
  if (chord.z() < 0.0) chord = -chord;
  if (!(chord.z() > 1e-9)) return std::nullopt;
  return Eigen::Vector2d(std::atan2(chord.x(), chord.z()), std::atan2(chord.y(), chord.z()));
}

WindowBundle::WindowBundle(CalibrationWindow window)
    : window_(std::move(window)), tried_(window_) {}

std::size_t WindowBundle::observations() const {
  std::size_t out = 0;
  for (const WindowPoint& point : window_.points) out += point.seen.size();
  return out;
}

Eigen::Index WindowBundle::parameters_of_poses() const {
  return static_cast<Eigen::Index>(kPose * (window_.frame_from_reference.size() - 1));
}

Eigen::Index WindowBundle::row_of(int frame) const {
  const auto reference = static_cast<int>(window_.reference);
  if (frame == reference) return -1;
  return kLens + kPose * (frame < reference ? frame : frame - 1);
}

LensInformation WindowBundle::reduce(const DriveLens& lens, const BundleLoss& loss,
                                     double damping) {
  const Eigen::Index poses = parameters_of_poses(), size = kLens + poses;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(size);
  LensInformation out;
  const std::vector<FramePose> frames = poses_of(window_);
  std::vector<Eigen::Matrix<double, 3, kPose>> by_pose;
  eliminated_.resize(window_.points.size());
  for (std::size_t i = 0; i < window_.points.size(); ++i) {
    const WindowPoint& point = window_.points[i];
    Eliminated& kept = eliminated_[i];
    Eigen::Matrix3d own = Eigen::Matrix3d::Zero();
    Eigen::Vector3d own_gradient = Eigen::Vector3d::Zero();
    Eigen::Matrix<double, 3, kLens> by_lens = Eigen::Matrix<double, 3, kLens>::Zero();
    const Eigen::Matrix<double, 3, 2> basis = tangents(point.direction);
    by_pose.clear();
    kept.rows.clear();
    for (const WindowObservation& seen : point.seen) {
      const auto row = linearise(point, basis, seen, frames[static_cast<std::size_t>(seen.frame)],
                                 lens, loss, &out.cost);
      if (!row) continue;
      own += row->by_point.transpose() * row->by_point;
      own_gradient += row->by_point.transpose() * row->error;
      by_lens += row->by_point.transpose() * row->by_lens;
      information.topLeftCorner<kLens, kLens>() += row->by_lens.transpose() * row->by_lens;
      gradient.head<kLens>() += row->by_lens.transpose() * row->error;
      const Eigen::Index at = row_of(seen.frame);
      if (at < 0) continue;
      information.block<kPose, kPose>(at, at) += row->by_pose.transpose() * row->by_pose;
      information.block<kPose, kLens>(at, 0) += row->by_pose.transpose() * row->by_lens;
      gradient.segment<kPose>(at) += row->by_pose.transpose() * row->error;
      kept.rows.push_back(at);
      by_pose.push_back(row->by_point.transpose() * row->by_pose);
    }
    damp(damping, own);
    kept.inverse = own.inverse();
    kept.gradient = own_gradient;
    kept.by_camera.resize(3, kLens + kPose * static_cast<Eigen::Index>(by_pose.size()));
    kept.by_camera.leftCols<kLens>() = by_lens;
    for (std::size_t k = 0; k < by_pose.size(); ++k) {
      kept.by_camera.middleCols<kPose>(kLens + kPose * static_cast<Eigen::Index>(k)) = by_pose[k];
    }
    const Eigen::Matrix<double, 3, Eigen::Dynamic> solved = kept.inverse * kept.by_camera;
    const Eigen::Vector3d step = kept.inverse * own_gradient;
    information.topLeftCorner<kLens, kLens>() -= by_lens.transpose() * solved.leftCols<kLens>();
    gradient.head<kLens>() -= by_lens.transpose() * step;
    for (std::size_t k = 0; k < by_pose.size(); ++k) {
      const Eigen::Index at = kept.rows[k];
      information.block<kPose, kLens>(at, 0) -= by_pose[k].transpose() * solved.leftCols<kLens>();
      gradient.segment<kPose>(at) -= by_pose[k].transpose() * step;
      for (std::size_t l = 0; l < by_pose.size(); ++l) {
        information.block<kPose, kPose>(at, kept.rows[l]) -=
            by_pose[k].transpose() *
            solved.middleCols<kPose>(kLens + kPose * static_cast<Eigen::Index>(l));
      }
    }
  }
  add_travel(lens, &information, &gradient, &out.cost);
  // The unit of length is free: the longest baseline keeps its length.
  std::size_t longest = 0;
  double length = 0.0;
  for (std::size_t k = 0; k < window_.frame_from_reference.size(); ++k) {
    const double baseline = window_.frame_from_reference[k].translation().norm();
    if (k != window_.reference && baseline > length) {
      longest = k;
      length = baseline;
    }
  }
  if (length > 0.0) {
    const Eigen::Vector3d along =
        window_.frame_from_reference[longest].translation() / (length * length);
    const Eigen::Index at = row_of(static_cast<int>(longest)) + 3;
    constexpr double kUnitInformation = 1e8;
    information.block<3, 3>(at, at) += kUnitInformation * along * along.transpose();
  }
  Eigen::MatrixXd pose_block = information.bottomRightCorner(poses, poses);
  damp(damping, pose_block);
  const Eigen::MatrixXd coupling = information.bottomLeftCorner(poses, kLens);
  const Eigen::LDLT<Eigen::MatrixXd> solver(pose_block);
  poses_by_lens_ = solver.solve(coupling);
  poses_step_ = solver.solve(gradient.tail(poses));
  out.information =
      information.topLeftCorner<kLens, kLens>() - coupling.transpose() * poses_by_lens_;
  out.information = 0.5 * (out.information + out.information.transpose().eval());
  out.gradient = gradient.head<kLens>() - coupling.transpose() * poses_step_;
  return out;
}

void WindowBundle::add_travel(const DriveLens& lens, Eigen::MatrixXd* information,
                              Eigen::VectorXd* gradient, double* cost) const {
  const double sigma = travel_sigma(window_);
  const auto error = travel_error(window_, lens, sigma);
  if (!error) return;
  *cost += 0.5 * error->squaredNorm();
  // By the lens's yaw and pitch, and by the poses of the chord's ends.
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(2, information->rows());
  rows(0, 5) = 1.0 / sigma;
  rows(1, 6) = -1.0 / sigma;
  constexpr double kStep = 1e-6;
  CalibrationWindow changed;  // without points
  changed.reference = window_.reference;
  for (const std::size_t end : {std::size_t{0}, window_.frame_from_reference.size() - 1}) {
    for (int p = 0; p < kPose; ++p) {
      Eigen::Vector2d sides[2];
      for (int side = 0; side < 2; ++side) {
        changed.frame_from_reference = window_.frame_from_reference;
        const Eigen::Matrix<double, kPose, 1> step =
            (side == 0 ? kStep : -kStep) * Eigen::Matrix<double, kPose, 1>::Unit(p);
        changed.frame_from_reference[end] = moved(changed.frame_from_reference[end], step);
        const auto at = travel_error(changed, lens, sigma);
        if (!at) return;
        sides[side] = *at;
      }
      rows.col(row_of(static_cast<int>(end)) + p) = (sides[0] - sides[1]) / (2.0 * kStep);
    }
  }
  *information += rows.transpose() * rows;
  *gradient += rows.transpose() * *error;
}

void WindowBundle::try_step(const DriveLens::Vector& lens_step) {
  const Eigen::VectorXd poses = -(poses_step_ + poses_by_lens_ * lens_step);
  for (std::size_t k = 0; k < window_.frame_from_reference.size(); ++k) {
    const Eigen::Index at = row_of(static_cast<int>(k));
    if (at < 0) continue;
    const Eigen::Matrix<double, kPose, 1> step = poses.segment<kPose>(at - kLens);
    const SE3& pose = window_.frame_from_reference[k];
    tried_.frame_from_reference[k] = moved(pose, step);
  }
  for (std::size_t i = 0; i < window_.points.size(); ++i) {
    const Eliminated& kept = eliminated_[i];
    Eigen::Vector3d right = kept.gradient + kept.by_camera.leftCols<kLens>() * lens_step;
    for (std::size_t k = 0; k < kept.rows.size(); ++k) {
      right += kept.by_camera.middleCols<kPose>(kLens + kPose * static_cast<Eigen::Index>(k)) *
               poses.segment<kPose>(kept.rows[k] - kLens);
    }
    const Eigen::Vector3d step = -kept.inverse * right;
    const WindowPoint& point = window_.points[i];
    tried_.points[i].direction =
        (point.direction + tangents(point.direction) * step.head<2>()).normalized();
    tried_.points[i].inverse_distance = point.inverse_distance + step(2);
  }
}

void WindowBundle::accept() { std::swap(window_, tried_); }

void WindowBundle::set_window(CalibrationWindow window) {
  window_ = std::move(window);
  tried_ = window_;
}

double WindowBundle::cost(const CalibrationWindow& window, const DriveLens& lens,
                          const BundleLoss& loss) {
  const std::vector<FramePose> frames = poses_of(window);
  const double per_variance = 1.0 / (loss.pixel_sigma * loss.pixel_sigma);
  double out = 0.0;
  for (const WindowPoint& point : window.points) {
    for (const WindowObservation& seen : point.seen) {
      const auto pixel = lens.pixel(frames[static_cast<std::size_t>(seen.frame)].in_camera(point));
      const double squared = pixel ? (*pixel - seen.pixel).squaredNorm() : kBehind * kBehind;
      out += loss_of(squared * per_variance, loss);
    }
  }
  const auto travel = travel_error(window, lens, travel_sigma(window));
  if (travel) out += 0.5 * travel->squaredNorm();
  return out;
}

std::vector<Eigen::Vector2d> WindowBundle::errors(const CalibrationWindow& window,
                                                  const DriveLens& lens) {
  const std::vector<FramePose> frames = poses_of(window);
  std::vector<Eigen::Vector2d> out;
  for (const WindowPoint& point : window.points) {
    for (const WindowObservation& seen : point.seen) {
      const auto pixel = lens.pixel(frames[static_cast<std::size_t>(seen.frame)].in_camera(point));
      out.push_back(pixel ? Eigen::Vector2d(*pixel - seen.pixel)
                          : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()));
    }
  }
  return out;
}

}  // namespace camber
