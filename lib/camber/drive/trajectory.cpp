#include "camber/drive/trajectory.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <utility>

#include "camber/core/errors.h"
#include "camber/drive/detail/window_scales.h"
#include "camber/road/detail/banded_ldlt.h"

namespace camber {
namespace {

using detail::BandedLdlt;
using detail::Measurement;
using detail::student_weight;
using detail::SymmetricBand;

constexpr Eigen::Index kPose = 6, kBlock = 7;  // of a frame: pose, logarithm of its window's scale
constexpr Eigen::Index kMap = 4;               // a turn about the vertical, a shift

/// What joins frames beside windows: a camera goes on as it did, or stands.
struct Bridge {
  std::size_t from = 0, to = 0;
  SE3 to_from_from;  // m
  double turn_sigma = 0.0, shift_sigma = 0.0;
};

class Smoother {
 public:
  Smoother(const std::vector<int>& ids, const std::vector<WindowMeasurement>& windows,
           const TrajectoryNoise& noise, const std::vector<double>& times, const DriveOnMap* map,
           const std::vector<int>& still)
      : ids_(ids),
        noise_(noise),
        times_(times),
        map_(map),
        measured_(detail::measurements_of(ids, windows, noise)) {
    poses_.resize(ids.size());
    joined_.assign(ids.size(), false);
    scales_.assign(ids.size(), 0.0);
    if (!ids.empty()) start();
    for (const int id : still) stand(id);
  }

  Trajectory solve() {
    constexpr int kIterations = 12, kAgain = 4;
    iterate(kIterations);
    assemble();
    factorise();
    scale_variance_ = variance_of_unit_weight();
    iterate(kAgain);
    assemble();
    factorise();
    return handed_out();
  }

 private:
  void factorise() {
    if (factor_.factorise(normal_)) return;
    throw NoAnswerError("the windows of the drive have no trajectory in common");
  }

  void iterate(int times) {
    constexpr double kSettled = 1e-7;  // rad, m
    for (int iteration = 0; iteration < times; ++iteration) {
      assemble();
      if (!factor_.factorise(normal_)) break;
      if (apply(solved()) < kSettled) break;
    }
  }

  double variance_of(const WindowMeasurement& w) const {
    return scale_variance_ *
           (w.scale_sigma * w.scale_sigma + noise_.scale_floor * noise_.scale_floor);
  }

  /// Factor on the variances of the windows' own scales by how far they are off the smoothed ones
  /// (a posteriori variance of unit weight; Niemeier, "Ausgleichungsrechnung", 2008, chapter 4),
  /// the stated ones counting as some windows that are off as stated.
  double variance_of_unit_weight() const {
    const SymmetricBand covariance = factor_.inverse_in_band();
    SymmetricBand readable = covariance;
    constexpr double kMost = 2.5;  // standard deviations: what is beyond took another layer
    double found = noise_.windows_as_stated, expected = noise_.windows_as_stated;
    for (const Measurement& m : measured_) {
      if (!m.votes) continue;
      const Eigen::Index at = kBlock * static_cast<Eigen::Index>(m.place()) + kPose;
      const double residual = residuals_.at(m.place());
      found += std::min(residual * residual, kMost * kMost);
      expected += std::max(0.0, 1.0 - readable.at(at, at) / variance_of(*m.window));
    }
    return found / expected;
  }

  void start() {
    metric_ = map_ != nullptr;
    for (const Measurement& m : measured_) metric_ = metric_ || (m.votes && m.window->metric);
    const std::vector<double> scale = detail::start_scales(measured_, noise_);
    for (std::size_t i = 0; i < measured_.size(); ++i) {
      scales_[measured_[i].place()] = scale[i] + by_map();
    }
    std::vector<std::vector<SE3>> steps(ids_.size());  // from the frame before, by each window
    for (const Measurement& m : measured_) {
      for (std::size_t k = 1; k < m.at.size(); ++k) {
        if (m.at[k] != m.at[k - 1] + 1) continue;
        steps[m.at[k]].push_back(scaled(m, k) * scaled(m, k - 1).inverse());
      }
    }
    SE3 step;
    for (std::size_t k = 1; k < ids_.size(); ++k) {
      joined_[k] = !steps[k].empty();
      if (joined_[k]) {
        step = most_agreed(steps, k);
      } else {
        const double shift = step.translation().norm();
        bridges_.push_back({k - 1, k, step, 0.05, 0.3 * shift + 0.05});
      }
      poses_[k] = poses_[k - 1] * step.inverse();
    }
  }

  /// Of the steps that windows measured to a frame the one nearest to all others and to those of
  /// the frames beside. Windows with a frame that was not found are metres off, and where they
  /// decide the start no weight brings the others back.
  static SE3 most_agreed(const std::vector<std::vector<SE3>>& steps, std::size_t k) {
    constexpr double kArm = 10.0;  // m: a turn counts as it moves a point so far away
    const SE3* best = nullptr;
    double least = 0.0;
    for (const SE3& a : steps[k]) {
      double sum = 0.0;
      for (std::size_t other = k - 1; other < std::min(k + 2, steps.size()); ++other) {
        for (const SE3& b : steps[other]) {
          sum += (a.translation() - b.translation()).norm() +
                 kArm * rotation_to_vector(a.rotation() * b.rotation().inverse()).norm();
        }
      }
      if (best && sum >= least) continue;
      best = &a;
      least = sum;
    }
    return *best;
  }

  /// What pictures that differ by their noise alone leave open.
  void stand(int id) {
    constexpr double kTurn = 1e-3, kShift = 0.005;  // rad, m (docs/notes/drives.md)
    const auto at = std::lower_bound(ids_.begin(), ids_.end(), id);
    const auto k = static_cast<std::size_t>(at - ids_.begin());
    if (k == 0 || at == ids_.end() || *at != id) return;
    bridges_.push_back({k - 1, k, SE3(), kTurn, kShift});
  }

  SE3 scaled(const Measurement& m, std::size_t k) const {
    const SE3& pose = m.window->frame_from_reference[k];
    return {pose.rotation(), std::exp(scales_[m.place()]) * pose.translation()};
  }

  /// Residual and derivative of the pose of a frame from another's camera, lengths divided by
  /// `unit`: columns are those of `from`, of `to` and of the logarithm of the unit.
  static void relative(const SE3& world_from_from, const SE3& world_from_to, const SE3& measured,
                       double unit, Eigen::Matrix<double, 6, 1>* residual,
                       Eigen::Matrix<double, 6, 13>* by) {
    const SE3 to_from_from = world_from_to.inverse() * world_from_from;
    const Eigen::Matrix3d turn = to_from_from.rotation_matrix();
    const Eigen::Vector3d shift = to_from_from.translation();
    residual->head<3>() =
        rotation_to_vector(to_from_from.rotation() * measured.rotation().inverse());
    residual->tail<3>() = shift / unit - measured.translation();
    by->setZero();
    by->block<3, 3>(0, 0) = turn;
    by->block<3, 3>(0, 6) = -Eigen::Matrix3d::Identity();
    by->block<3, 3>(3, 3) = turn / unit;
    by->block<3, 3>(3, 6) = skew(shift) / unit;
    by->block<3, 3>(3, 9) = -Eigen::Matrix3d::Identity() / unit;
    by->block<3, 1>(3, 12) = -shift / unit;
  }

  void assemble() {
    std::size_t span = 2;
    for (const Measurement& m : measured_) span = std::max(span, m.at.back() - m.at.front());
    const auto size = static_cast<Eigen::Index>(ids_.size()) * kBlock;
    normal_.set_zero(size, static_cast<Eigen::Index>(span + 1) * kBlock - 1);
    right_ = Eigen::VectorXd::Zero(size);
    for (Eigen::Index i = 0; i < kPose; ++i) normal_.at(i, i) += 1e12;  // the world
    for (Eigen::Index k = 0; k < static_cast<Eigen::Index>(ids_.size()); ++k) {
      const Eigen::Index at = kBlock * k + kPose;
      normal_.at(at, at) += 1e-9;
      for (Eigen::Index i = 0; i < kPose; ++i) normal_.at(kBlock * k + i, kBlock * k + i) += 1e-9;
    }
    weights_.clear();
    residuals_.clear();
    const bool voted = std::any_of(measured_.begin(), measured_.end(),
                                   [](const Measurement& m) { return m.votes; });
    if (!voted && !map_ && !measured_.empty()) {  // lengths in the first window's baselines
      const Eigen::Index at = kBlock * static_cast<Eigen::Index>(measured_.front().place()) + kPose;
      normal_.at(at, at) += 1e12;
    }
    for (const Measurement& m : measured_) add(m);
    for (const Bridge& bridge : bridges_) add(bridge);
    if (map_) {
      border_ = Eigen::MatrixXd::Zero(size, kMap);
      corner_ = 1e-9 * Eigen::Matrix<double, kMap, kMap>::Identity();
      border_right_.setZero();
      add_positions();
    }
    if (!metric_ || times_.size() != ids_.size()) return;
    for (std::size_t k = 1; k + 1 < ids_.size(); ++k) add_speeds(k);
  }

  double by_map() const { return map_ ? map_->log_scale : 0.0; }

  /// Errors of positions last: so many of them count as one.
  double alike_positions() const {
    const std::vector<MapPositions::At>& at = map_->positions.at;
    if (at.size() < 2 || times_.size() != ids_.size()) return 1.0;
    const double span = times_[at.back().place] - times_[at.front().place];
    if (!(span > 0.0)) return 1.0;
    return std::max(1.0, noise_.position_correlation * static_cast<double>(at.size() - 1) / span);
  }

  Eigen::Vector3d antenna_in_level(const MapPositions::At& at) const {
    const MapPositions& p = map_->positions;
    return p.level_from_world * (poses_[at.place] * p.antenna);
  }

  /// The map's frame by the positions and their places in the trajectory.
  SE3 fitted_map() const {
    const std::vector<MapPositions::At>& at = map_->positions.at;
    Eigen::Vector3d run = Eigen::Vector3d::Zero(), on_map = Eigen::Vector3d::Zero();
    const Eigen::Vector3d base(at.front().position.x(), at.front().position.y(), 0.0);
    double total = 0.0, total_height = 0.0;
    for (std::size_t i = 0; i < at.size(); ++i) {
      const double w = 1.0 / (at[i].sigma * at[i].sigma);
      const double h = 1.0 / (at[i].height_sigma * at[i].height_sigma);
      const Eigen::Vector3d p = antenna_in_level(at[i]);
      const Eigen::Vector3d q = at[i].position - base;
      run += Eigen::Vector3d(w * p.x(), w * p.y(), h > 0.0 ? h * p.z() : 0.0);
      on_map += Eigen::Vector3d(w * q.x(), w * q.y(), h > 0.0 ? h * q.z() : 0.0);
      total += w;
      total_height += h;
    }
    const Eigen::Vector3d per(1.0 / total, 1.0 / total,
                              total_height > 0.0 ? 1.0 / total_height : 0.0);
    run = run.cwiseProduct(per);
    on_map = on_map.cwiseProduct(per);
    on_map += base;
    double along = 0.0, across = 0.0;
    for (std::size_t i = 0; i < at.size(); ++i) {
      const double w = 1.0 / (at[i].sigma * at[i].sigma);
      const Eigen::Vector2d p = (antenna_in_level(at[i]) - run).head<2>();
      const Eigen::Vector2d q = (at[i].position - on_map).head<2>();
      along += w * p.dot(q);
      across += w * (p.x() * q.y() - p.y() * q.x());
    }
    const Eigen::Quaterniond turn(
        Eigen::AngleAxisd(std::atan2(across, along), Eigen::Vector3d::UnitZ()));
    return {turn, on_map - turn * run};
  }

  /// Antennas are where their positions say, with the map's frame as it fits best by now.
  void add_positions() {
    const MapPositions& p = map_->positions;
    if (p.at.size() < 2) return;
    if (!map_from_level_) {
      map_from_level_ = fitted_map();
      pivot_ = *map_from_level_ * antenna_in_level(p.at[p.at.size() / 2]);
    }
    const Eigen::Matrix3d turn = map_from_level_->rotation_matrix() * p.level_from_world;
    const double alike = alike_positions();
    for (std::size_t i = 0; i < p.at.size(); ++i) {
      const MapPositions::At& at = p.at[i];
      const Eigen::Vector3d on_map = *map_from_level_ * antenna_in_level(at);
      Eigen::Vector3d off = on_map - at.position;
      Eigen::Vector3d information(1.0 / (at.sigma * at.sigma), 1.0 / (at.sigma * at.sigma),
                                  1.0 / (at.height_sigma * at.height_sigma));
      if (!(information.z() > 0.0)) off.z() = 0.0;
      const double squared = off.cwiseProduct(information).dot(off);
      const double weight = std::min(1.0, student_weight(squared, 3.0, noise_.motion_freedom));
      information *= weight / alike;
      const Eigen::Matrix3d of_pose = turn * poses_[at.place].rotation_matrix();
      Eigen::Matrix<double, 3, 6> by;
      by.leftCols<3>() = -of_pose * skew(p.antenna);
      by.rightCols<3>() = of_pose;
      const Eigen::Matrix<double, 6, 6> own = by.transpose() * information.asDiagonal() * by;
      const auto place = kBlock * static_cast<Eigen::Index>(at.place);
      right_.segment<6>(place) -= by.transpose() * information.asDiagonal() * off;
      for (Eigen::Index a = 0; a < kPose; ++a) {
        for (Eigen::Index b = 0; b <= a; ++b) normal_.at(place + a, place + b) += own(a, b);
      }
      Eigen::Matrix<double, 3, kMap> by_map;
      by_map << Eigen::Vector3d::UnitZ().cross(on_map - pivot_), Eigen::Matrix3d::Identity();
      border_.middleRows<kPose>(place) += by.transpose() * information.asDiagonal() * by_map;
      corner_ += by_map.transpose() * information.asDiagonal() * by_map;
      border_right_ -= by_map.transpose() * information.asDiagonal() * off;
    }
  }

  /// Change of all frames, and of the map's frame, which stands in a border of the normal matrix.
  Eigen::VectorXd solved() {
    Eigen::VectorXd out = factor_.solve_vector(right_);
    if (!map_from_level_) return out;
    put_map_covariance();
    const Eigen::Matrix<double, kMap, 1> map =
        map_covariance_ * (border_right_ - border_.transpose() * out);
    out -= by_map_ * map;
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(map[0], Eigen::Vector3d::UnitZ()));
    const SE3& before = *map_from_level_;
    map_from_level_ = SE3(turn * before.rotation(),
                          pivot_ + turn * (before.translation() - pivot_) + map.tail<3>());
    return out;
  }

  void put_map_covariance() {
    by_map_.resize(border_.rows(), kMap);
    for (Eigen::Index i = 0; i < kMap; ++i) {
      by_map_.col(i) = factor_.solve_vector(Eigen::VectorXd(border_.col(i)));
    }
    const Eigen::Matrix<double, kMap, kMap> left = corner_ - border_.transpose() * by_map_;
    map_covariance_ = left.ldlt().solve(Eigen::Matrix<double, kMap, kMap>::Identity());
  }

  /// A speed that is a random walk: those of the steps before and after a frame differ little.
  void add_speeds(std::size_t k) {
    const double before = times_[k] - times_[k - 1], after = times_[k + 1] - times_[k];
    if (!(before > 0.0) || !(after > 0.0)) return;
    Eigen::Matrix<double, 1, 9> by = Eigen::Matrix<double, 1, 9>::Zero();
    double change = 0.0;
    const auto add_step = [&](Eigen::Index from, double over) {
      const std::size_t at = k - 1 + static_cast<std::size_t>(from);
      const Eigen::Vector3d step = poses_[at + 1].translation() - poses_[at].translation();
      const double length = step.norm();
      change += length / over;
      if (!(length > 1e-9)) return;
      const Eigen::Vector3d way = step / (length * over);
      by.segment<3>(3 * from) -= (poses_[at].rotation().inverse() * way).transpose();
      by.segment<3>(3 * from + 3) += (poses_[at + 1].rotation().inverse() * way).transpose();
    };
    add_step(0, -before);
    add_step(1, after);
    const double variance = noise_.acceleration_density * 0.5 * (before + after);
    const double weight = student_weight(change * change / variance, 1.0, noise_.motion_freedom);
    const auto place = [&](Eigen::Index i) {
      return kBlock * (static_cast<Eigen::Index>(k) - 1 + i / 3) + 3 + i % 3;
    };
    for (Eigen::Index i = 0; i < by.size(); ++i) {
      right_[place(i)] -= weight / variance * change * by[i];
      for (Eigen::Index j = 0; j <= i; ++j) {
        normal_.at(place(i), place(j)) += weight / variance * by[i] * by[j];
      }
    }
  }

  /// Frames of a window that were not found (an outer one where a texture repeats) say nothing,
  /// while the others are as good as ever: each has its own weight.
  Eigen::MatrixXd robust_covariance(const Measurement& m, const Eigen::VectorXd& residual) const {
    Eigen::MatrixXd out = m.covariance;
    for (Eigen::Index row = 0; row < residual.size(); row += kPose) {
      const Eigen::Matrix<double, 6, 6> own = m.covariance.block<6, 6>(row, row);
      const Eigen::Matrix<double, 6, 1> off = residual.segment<6>(row);
      const double weight = student_weight(off.dot(own.ldlt().solve(off)),
                                           static_cast<double>(kPose), noise_.motion_freedom);
      if (weight < 1.0) out.block<6, 6>(row, row) += (1.0 / weight - 1.0) * own;
    }
    return out;
  }

  void add(const Measurement& m) {
    const auto others = static_cast<Eigen::Index>(m.at.size() - 1);
    const auto frames = static_cast<Eigen::Index>(m.at.size());
    Eigen::VectorXd residual(kPose * others);
    Eigen::MatrixXd by = Eigen::MatrixXd::Zero(kPose * others, kBlock * frames);
    const std::size_t reference = m.place();
    const double unit = std::exp(scales_[reference]);
    const auto r = static_cast<Eigen::Index>(m.reference);
    Eigen::Index row = 0;
    for (std::size_t k = 0; k < m.at.size(); ++k) {
      if (k == m.reference) continue;
      Eigen::Matrix<double, 6, 1> e;
      Eigen::Matrix<double, 6, 13> d;
      relative(poses_[reference], poses_[m.at[k]], m.window->frame_from_reference[k], unit, &e, &d);
      residual.segment<6>(row) = e;
      by.block<6, 6>(row, kBlock * r) = d.leftCols<6>();
      by.block<6, 6>(row, kBlock * static_cast<Eigen::Index>(k)) = d.middleCols<6>(6);
      by.block<6, 1>(row, kBlock * r + kPose) = d.col(12);
      row += kPose;
    }
    const Eigen::MatrixXd weighted = robust_covariance(m, residual).ldlt().solve(by);
    const Eigen::MatrixXd own = by.transpose() * weighted;
    const Eigen::VectorXd down = -(weighted.transpose() * residual);
    for (Eigen::Index a = 0; a < frames; ++a) {
      const Eigen::Index at_a =
          kBlock * static_cast<Eigen::Index>(m.at[static_cast<std::size_t>(a)]);
      right_.segment(at_a, kBlock) += down.segment(kBlock * a, kBlock);
      for (Eigen::Index b = 0; b <= a; ++b) {
        const Eigen::Index at_b =
            kBlock * static_cast<Eigen::Index>(m.at[static_cast<std::size_t>(b)]);
        for (Eigen::Index i = 0; i < kBlock; ++i) {
          for (Eigen::Index j = 0; j < (a == b ? i + 1 : kBlock); ++j) {
            normal_.at(at_a + i, at_b + j) += own(kBlock * a + i, kBlock * b + j);
          }
        }
      }
    }
    add_scale(m);
  }

  void add_scale(const Measurement& m) {
    const WindowMeasurement& w = *m.window;
    const Eigen::Index at = kBlock * static_cast<Eigen::Index>(m.place()) + kPose;
    if (!w.log_scale) return;
    const double variance = variance_of(w);
    const double off = scales_[m.place()] - *w.log_scale - by_map();
    const double weight = student_weight(off * off / variance, 1.0, noise_.scale_freedom);
    weights_[m.place()] = std::min(1.0, weight);
    residuals_[m.place()] = off / std::sqrt(variance);
    if (!m.votes) return;
    const double information = weight / (variance * m.alike);
    normal_.at(at, at) += information;
    right_[at] -= information * off;
  }

  void add(const Bridge& bridge) {
    Eigen::Matrix<double, 6, 1> residual;
    Eigen::Matrix<double, 6, 13> by;
    relative(poses_[bridge.from], poses_[bridge.to], bridge.to_from_from, 1.0, &residual, &by);
    Eigen::Matrix<double, 6, 1> information;
    information.head<3>().setConstant(1.0 / (bridge.turn_sigma * bridge.turn_sigma));
    information.tail<3>().setConstant(1.0 / (bridge.shift_sigma * bridge.shift_sigma));
    const Eigen::Matrix<double, 12, 12> own =
        by.leftCols<12>().transpose() * information.asDiagonal() * by.leftCols<12>();
    const Eigen::Matrix<double, 12, 1> down =
        -by.leftCols<12>().transpose() * information.asDiagonal() * residual;
    const auto place = [&](Eigen::Index i) {
      const std::size_t at = i < kPose ? bridge.from : bridge.to;
      return kBlock * static_cast<Eigen::Index>(at) + i % kPose;
    };
    for (Eigen::Index i = 0; i < 12; ++i) {
      right_[place(i)] += down[i];
      for (Eigen::Index j = 0; j <= i; ++j) normal_.at(place(i), place(j)) += own(i, j);
    }
  }

  /// @return the largest change of a pose, rad or m.
  double apply(const Eigen::VectorXd& change) {
    double most = 0.0;
    for (std::size_t k = 0; k < poses_.size(); ++k) {
      const auto at = kBlock * static_cast<Eigen::Index>(k);
      const Eigen::Vector3d turn = change.segment<3>(at), shift = change.segment<3>(at + 3);
      SE3& pose = poses_[k];
      pose = SE3(pose.rotation() * rotation_from_vector(turn),
                 pose.translation() + pose.rotation() * shift);
      scales_[k] += change[at + kPose];
      most = std::max({most, turn.norm(), shift.norm()});
    }
    return most;
  }

  /// Of the length of a stretch, by the poses alone.
  Trajectory::Stretch stretch(std::size_t first, std::size_t last, double common) const {
    Trajectory::Stretch out;
    out.first = ids_[first];
    out.last = ids_[last];
    out.common = common;
    Eigen::VectorXd by = Eigen::VectorXd::Zero(right_.size());
    for (std::size_t k = first + 1; k <= last; ++k) {
      out.length += (poses_[k].translation() - poses_[k - 1].translation()).norm();
      Eigen::Vector3d before, after;
      if (!step_by_poses(k, &before, &after)) continue;
      const auto at = kBlock * static_cast<Eigen::Index>(k);
      by.segment<3>(at + 3) += after;
      by.segment<3>(at - kBlock + 3) += before;
    }
    out.own_sigma = std::sqrt(std::max(0.0, by.dot(factor_.solve_vector(by))));
    return out;
  }

  /// Derivative of the length of a step by the poses of its ends, in their own frames.
  /// @return false: the camera stands.
  bool step_by_poses(std::size_t k, Eigen::Vector3d* by_before, Eigen::Vector3d* by_after) const {
    const Eigen::Vector3d step = poses_[k].translation() - poses_[k - 1].translation();
    const double length = step.norm();
    if (!(length > 1e-9)) return false;
    *by_before = -(poses_[k - 1].rotation().inverse() * (step / length));
    *by_after = poses_[k].rotation().inverse() * (step / length);
    return true;
  }

  /// Of the way from the frame before a frame to the one after it.
  double beside_sigma(std::size_t k, SymmetricBand* covariance) const {
    const std::size_t first = k > 0 ? k - 1 : 0, last = std::min(k + 1, poses_.size() - 1);
    std::array<Eigen::Vector3d, 3> by;
    by.fill(Eigen::Vector3d::Zero());
    for (std::size_t i = first + 1; i <= last; ++i) {
      Eigen::Vector3d before, after;
      if (!step_by_poses(i, &before, &after)) continue;
      by[i - 1 - first] += before;
      by[i - first] += after;
    }
    double variance = 0.0;
    for (std::size_t a = first; a <= last; ++a) {
      for (std::size_t b = first; b <= last; ++b) {
        for (Eigen::Index i = 0; i < 3; ++i) {
          for (Eigen::Index j = 0; j < 3; ++j) {
            const Eigen::Index at = kBlock * static_cast<Eigen::Index>(a) + 3 + i;
            const Eigen::Index other = kBlock * static_cast<Eigen::Index>(b) + 3 + j;
            variance += by[a - first][i] * by[b - first][j] *
                        covariance->at(std::max(at, other), std::min(at, other));
          }
        }
      }
    }
    return std::sqrt(std::max(0.0, variance));
  }

  /// Of the way from the first frame to every other: at some 200 of them, between these variances
  /// grow evenly.
  void put_way_sigmas(std::vector<TrajectoryPose>* poses) const {
    constexpr std::size_t kPlaces = 200;
    const std::size_t stride = std::max<std::size_t>(1, poses->size() / kPlaces);
    double before = 0.0;
    for (std::size_t first = 0; first + 1 < poses->size(); first += stride) {
      const std::size_t last = std::min(first + stride, poses->size() - 1);
      const double after = std::pow(stretch(0, last, 0.0).own_sigma, 2);
      for (std::size_t k = first + 1; k <= last; ++k) {
        const double share = static_cast<double>(k - first) / static_cast<double>(last - first);
        (*poses)[k].way_sigma = std::sqrt(before + share * (after - before));
      }
      before = after;
    }
  }

  Trajectory handed_out() {
    Trajectory out;
    const double common = map_ ? map_->common_sigma : detail::common_sigma(measured_);
    out.metric = metric_;
    out.common_sigma = common;
    const SymmetricBand covariance = factor_.inverse_in_band();
    SymmetricBand readable = covariance;
    if (map_from_level_) put_map_covariance();
    for (std::size_t k = 0; k < ids_.size(); ++k) {
      TrajectoryPose pose;
      pose.frame = ids_[k];
      pose.world_from_camera = poses_[k];
      pose.measured = joined_[k] || (k + 1 < ids_.size() && joined_[k + 1]);
      pose.status = pose.measured ? Status::kOk : Status::kNotObservable;
      if (!pose.measured) pose.reason = "no picture shows how the camera moved here";
      const auto at = kBlock * static_cast<Eigen::Index>(k);
      for (Eigen::Index i = 0; i < kPose; ++i) {
        for (Eigen::Index j = 0; j <= i; ++j) {
          pose.covariance(i, j) = pose.covariance(j, i) = readable.at(at + i, at + j);
        }
      }
      if (map_from_level_) {
        const Eigen::Matrix<double, kPose, kMap> by = by_map_.middleRows<kPose>(at);
        pose.covariance += by * map_covariance_ * by.transpose();
      }
      pose.beside_sigma = beside_sigma(k, &readable);
      out.poses.push_back(std::move(pose));
    }
    put_way_sigmas(&out.poses);
    for (const auto& [place, weight] : weights_) {
      out.scales.push_back({ids_[place], residuals_.at(place), weight, scales_[place]});
    }
    if (ids_.size() > 1) out.whole = stretch(0, ids_.size() - 1, common);
    for (std::size_t first = 0; first + Trajectory::kWindow < ids_.size();
         first += Trajectory::kEvery) {
      out.windows.push_back(stretch(first, first + Trajectory::kWindow, common));
    }
    return out;
  }

  const std::vector<int>& ids_;
  const TrajectoryNoise& noise_;
  const std::vector<double>& times_;  // s
  const DriveOnMap* map_;
  bool metric_ = false;
  double scale_variance_ = 1.0;  // see variance_of_unit_weight
  std::vector<Measurement> measured_;
  std::vector<Bridge> bridges_;
  std::vector<SE3> poses_;  // world_from_camera
  std::vector<bool> joined_;
  std::vector<double> scales_;  // of the window whose reference the frame is
  SymmetricBand normal_;
  Eigen::VectorXd right_;
  BandedLdlt factor_;
  std::map<std::size_t, double> weights_, residuals_;
  // The map's frame (its turn about the vertical through the pivot, its shift): none where there
  // are no positions. Its border of the normal matrix, and how the frames' changes follow it.
  std::optional<SE3> map_from_level_;
  Eigen::Vector3d pivot_ = Eigen::Vector3d::Zero();
  Eigen::MatrixXd border_, by_map_;
  Eigen::Matrix<double, kMap, kMap> corner_, map_covariance_;
  Eigen::Matrix<double, kMap, 1> border_right_;
};

}  // namespace

double Trajectory::Stretch::sigma() const { return std::hypot(own_sigma, common * length); }

const TrajectoryPose* Trajectory::find(int frame) const {
  const auto found =
      std::lower_bound(poses.begin(), poses.end(), frame,
                       [](const TrajectoryPose& pose, int id) { return pose.frame < id; });
  return found != poses.end() && found->frame == frame ? &*found : nullptr;
}

Trajectory smooth_trajectory(const std::vector<int>& frame_ids,
                             const std::vector<WindowMeasurement>& windows,
                             const TrajectoryNoise& noise, const std::vector<double>& times,
                             const DriveOnMap* map, const std::vector<int>& still) {
  if (frame_ids.empty()) return {};
  return Smoother(frame_ids, windows, noise, times, map, still).solve();
}

}  // namespace camber
