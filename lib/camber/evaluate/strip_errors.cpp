#include "camber/evaluate/strip_errors.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <stdexcept>
#include <utility>

#include "camber/cloud/point_tree.h"
#include "camber/core/errors.h"

namespace camber {
namespace {

constexpr double kInterval95 = 1.959964;
constexpr double kShortestStep = 0.05;  // m, between frames that place the others

/// A frame with both poses.
struct PosedFrame {
  const TruthFrame* truth = nullptr;
  const DriveFrame* estimate = nullptr;
  double true_s = 0.0, s = 0.0;  // m along each driven line
};

std::vector<PosedFrame> posed_frames(const Scene& scene, const DriveDocument& drive) {
  std::map<int, const DriveFrame*> estimates;
  for (const DriveFrame& frame : drive.frames) estimates[frame.id] = &frame;
  std::vector<PosedFrame> out;
  for (const TruthFrame& frame : scene.truth->frames) {
    const auto at = estimates.find(frame.id);
    if (!frame.world_from_camera || at == estimates.end() || !at->second->world_from_camera) {
      continue;
    }
    out.push_back({&frame, at->second, 0.0, 0.0});
  }
  if (out.size() < 2) {
    throw NoAnswerError(
        fmt::format("{} frames with a true and an estimated pose, 2 are needed", out.size()));
  }
  return out;
}

/// Turns the estimate's world to the truth's: the chordal mean over the frames.
Eigen::Matrix3d mean_turn(const std::vector<PosedFrame>& frames) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const PosedFrame& f : frames) {
    sum += f.truth->world_from_camera->rotation_matrix() *
           f.estimate->world_from_camera->rotation_matrix().transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d signs = Eigen::Matrix3d::Identity();
  signs(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * signs * svd.matrixV().transpose();
}

/// The true ground by its points, z up.
class TrueGround {
 public:
  TrueGround(const RoadCloud& cloud, const SE3& level_from_cloud) {
    const auto labels = cloud.labels.find("label");
    std::vector<Eigen::Vector3f> plan;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (labels != cloud.labels.end() && labels->second[i] != kRoad) continue;
      points_.push_back(level_from_cloud * (cloud.origin + cloud.points[i].cast<double>()));
      if (points_.size() == 1) origin_ = points_.front();
      const Eigen::Vector3d p = points_.back() - origin_;
      plan.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 0.0F);
    }
    tree_.emplace(plan);
  }

  /// The height at a place in plan, of a plane through the points about it; none: no ground there.
  /// @param near  m, a height that it is near: other levels of the road do not count
  std::optional<double> height(const Eigen::Vector3d& place, double near) const {
    constexpr float kRadius = 0.6F, kNearest = 0.35F;  // m
    constexpr double kOtherLevel = 2.0;                // m
    constexpr double kRidge = 1e-3;  // m^2: points on a line leave the slope across open
    constexpr std::size_t kLeast = 4;
    const Eigen::Vector3d off = place - origin_;
    std::vector<PointTree::Neighbor> found;
    tree_->within({static_cast<float>(off.x()), static_cast<float>(off.y()), 0.0F}, kRadius, found);
    if (found.size() < kLeast || found[0].squared_distance > kNearest * kNearest) return {};
    Eigen::Matrix3d normal = Eigen::Vector3d(0.0, kRidge, kRidge).asDiagonal();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const PointTree::Neighbor& n : found) {
      const Eigen::Vector3d d = points_[static_cast<std::size_t>(n.index)] - place;
      const double z = points_[static_cast<std::size_t>(n.index)].z() - near;
      if (std::abs(z) > kOtherLevel) continue;
      const Eigen::Vector3d row(1.0, d.x(), d.y());
      normal += row * row.transpose();
      right += z * row;
    }
    if (normal(0, 0) < static_cast<double>(kLeast)) return {};
    return near + normal.ldlt().solve(right)[0];
  }

 private:
  static constexpr int kRoad = 1;
  std::vector<Eigen::Vector3d> points_;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  std::optional<PointTree> tree_;
};

/// The line through the feet of the true cameras.
DrivenLine true_line(const Scene& scene, const TrueGround& ground,
                     const Eigen::Matrix3d& level_from_world) {
  std::vector<Eigen::Vector3d> feet;
  for (const TruthFrame& frame : scene.truth->frames) {
    if (!frame.world_from_camera) continue;
    const SE3& pose = *frame.world_from_camera;
    if (frame.ego_plane) {
      feet.push_back(level_from_world *
                     (pose * Eigen::Vector3d(-frame.ego_plane->offset * frame.ego_plane->normal)));
      continue;
    }
    const Eigen::Vector3d camera = level_from_world * pose.translation();
    const double beneath = camera.z() - scene.height_above_road.value_or(1.5);
    if (const auto height = ground.height(camera, beneath)) {
      feet.emplace_back(camera.x(), camera.y(), *height);
    }
  }
  return DrivenLine(feet);
}

/// The frames' places on both lines: where the camera stands above them.
void place_frames(const DrivenLine& line, const Eigen::Matrix3d& level_from_world,
                  const RoadStrip& strip, std::vector<PosedFrame>* frames) {
  constexpr double kBeside = 5.0;  // m, that a place may be off what its neighbour lets expect
  double true_s = 0.0, s = 0.0;
  std::optional<Eigen::Vector3d> last;
  for (PosedFrame& f : *frames) {
    const Eigen::Vector3d camera = level_from_world * f.truth->world_from_camera->translation();
    const double way = last ? (camera - *last).norm() : 0.0;
    last = camera;
    const auto true_place = line.project(camera, true_s - kBeside, true_s + 2.0 * way + kBeside);
    const auto place =
        strip.line.project(strip.strip_from_world * f.estimate->world_from_camera->translation(),
                           s - kBeside, s + 2.0 * way + kBeside);
    if (!true_place || !place) throw NoAnswerError("the camera stands: there is no driven line");
    f.true_s = true_s = true_place->s;
    f.s = s = place->s;
  }
}

/// From places along the estimated line to those along the true one; beyond the frames by metres.
class Correspondence {
 public:
  explicit Correspondence(const std::vector<PosedFrame>& frames) {
    for (const PosedFrame& f : frames) {
      if (!knots_.empty() && (f.s < knots_.back().first + kShortestStep ||
                              f.true_s < knots_.back().second + kShortestStep)) {
        continue;
      }
      knots_.emplace_back(f.s, f.true_s);
    }
    if (knots_.size() < 2) throw NoAnswerError("the camera stands: there is no driven line");
  }
  double true_s(double s) const {
    if (s <= first()) return knots_.front().second + s - first();
    if (s >= last()) return knots_.back().second + s - last();
    const auto after = std::upper_bound(knots_.begin(), knots_.end(), std::make_pair(s, HUGE_VAL));
    const auto before = after - 1;
    const double share = (s - before->first) / (after->first - before->first);
    return before->second + share * (after->second - before->second);
  }
  double first() const { return knots_.front().first; }
  double last() const { return knots_.back().first; }

 private:
  std::vector<std::pair<double, double>> knots_;
};

/// Whether a camera has a place in view, no vehicle before it.
bool in_view(const Scene& scene, const TruthFrame& frame, const Eigen::Vector3d& world,
             double farthest) {
  constexpr double kNearest = 0.5;  // m
  const Eigen::Vector3d x = frame.world_from_camera->inverse() * world;
  const PinholeCamera& camera = scene.camera;
  if (x.norm() > farthest || x.z() < kNearest) return false;
  const double u = camera.fx * x.x() / x.z() + camera.cx, v = camera.fy * x.y() / x.z() + camera.cy;
  if (u < 0.0 || v < 0.0 || u > camera.width - 1 || v > camera.height - 1) return false;
  return std::none_of(frame.vehicles.begin(), frame.vehicles.end(), [&](const TruthVehicle& car) {
    return u >= car.box.x1 && u <= car.box.x2 && v >= car.box.y1 && v <= car.box.y2 &&
           car.pose.bottom_center().norm() < x.norm() + 0.5 * car.pose.dimensions.length;
  });
}

class Spread {
 public:
  void add(double error, double sigma = std::numeric_limits<double>::quiet_NaN()) {
    if (!std::isfinite(error)) return;
    values_.push_back(std::abs(error));
    sum_ += error;
    squares_ += error * error;
    if (!(sigma >= 0.0)) return;
    ++with_sigma_;
    inside_ += std::abs(error) <= kInterval95 * sigma ? 1 : 0;
  }
  ErrorSpread spread() const {
    ErrorSpread out;
    out.count = static_cast<int>(values_.size());
    out.with_sigma = with_sigma_;
    if (with_sigma_ > 0) out.within_95 = static_cast<double>(inside_) / with_sigma_;
    if (values_.empty()) return out;
    std::vector<double> sorted = values_;
    std::sort(sorted.begin(), sorted.end());
    const auto at = [&](double share) {
      return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1) + 0.5)];
    };
    out.median = at(0.5);
    out.p95 = at(0.95);
    out.mean = sum_ / out.count;
    return out;
  }
  double rms() const {
    return values_.empty() ? std::numeric_limits<double>::quiet_NaN()
                           : std::sqrt(squares_ / static_cast<double>(values_.size()));
  }

 private:
  std::vector<double> values_;
  double sum_ = 0.0, squares_ = 0.0;
  int with_sigma_ = 0, inside_ = 0;
};

/// A cell that both have.
struct ComparedCell {
  double s = 0.0, true_s = 0.0, lateral = 0.0;
  double height = 0.0, true_height = 0.0;  // m
};

/// Grades by the least-squares plane over the same cells; NaN where they do not show one.
std::pair<double, double> grades(const std::vector<ComparedCell>& cells, double s, double true_s,
                                 const StripErrorOptions& options) {
  constexpr int kLeast = 12;
  Eigen::Matrix3d normal[2] = {Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero()};
  Eigen::Vector3d right[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  double low = 0.0, high = 0.0;
  const double reach = 0.5 * options.grade_length;
  const auto from = std::lower_bound(cells.begin(), cells.end(), s - reach,
                                     [](const ComparedCell& c, double at) { return c.s < at; });
  for (auto c = from; c != cells.end() && c->s <= s + reach; ++c) {
    if (std::abs(c->lateral) > options.grade_half_width) continue;
    low = std::min(low, c->s - s);
    high = std::max(high, c->s - s);
    const std::pair<double, double> both[2] = {{c->s - s, c->height},
                                               {c->true_s - true_s, c->true_height}};
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector3d row(1.0, both[k].first, c->lateral);
      normal[k] += row * row.transpose();
      right[k] += both[k].second * row;
    }
  }
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  if (normal[0](0, 0) < kLeast || high - low < 0.6 * options.grade_length) return {kNaN, kNaN};
  return {std::atan(normal[0].ldlt().solve(right[0])[1]),
          std::atan(normal[1].ldlt().solve(right[1])[1])};
}

}  // namespace

void StripErrorOptions::validate() const {
  for (const auto& [name, value] : {std::pair("cell", cell),
                                    {"half_width", half_width},
                                    {"view", view},
                                    {"before", before},
                                    {"grade_length", grade_length},
                                    {"grade_half_width", grade_half_width}}) {
    if (!(value > 0.0)) {
      throw std::invalid_argument(fmt::format("strip errors: {} = {}, expected > 0", name, value));
    }
  }
}

StripErrors strip_errors(const Scene& scene, const DriveDocument& drive, const RoadStrip& strip,
                         const RoadCloud& truth, const SE3& world_from_truth,
                         const StripErrorOptions& options) {
  options.validate();
  if (!scene.truth) throw std::invalid_argument("the scene has no truth to compare with");
  std::vector<PosedFrame> frames = posed_frames(scene, drive);
  const Eigen::Matrix3d strip_turn = strip.strip_from_world.rotation_matrix();
  const Eigen::Matrix3d level_from_world = strip_turn * mean_turn(frames).transpose();
  const TrueGround ground(truth, SE3(level_from_world, Eigen::Vector3d::Zero()) * world_from_truth);
  const DrivenLine line = true_line(scene, ground, level_from_world);
  place_frames(line, level_from_world, strip, &frames);
  const Correspondence places(frames);

  // By which the strip is turned so that a frame's two poses agree, heights' row.
  std::vector<Eigen::RowVector3d> up_by_frame;
  for (const PosedFrame& f : frames) {
    up_by_frame.emplace_back((level_from_world * f.truth->world_from_camera->rotation_matrix() *
                              f.estimate->world_from_camera->rotation_matrix().transpose() *
                              strip_turn.transpose())
                                 .row(2));
  }
  const auto frame_at = [&](double true_s) {
    auto at = std::lower_bound(frames.begin(), frames.end() - 1, true_s,
                               [](const PosedFrame& f, double place) { return f.true_s < place; });
    if (at != frames.begin() && true_s - (at - 1)->true_s < at->true_s - true_s) --at;
    return static_cast<std::size_t>(at - frames.begin());
  };

  std::map<std::pair<int, int>, const StripCell*> cells;
  const auto index_of = [&](double metres) {
    return static_cast<int>(std::floor(metres / options.cell));
  };
  for (const StripCell& c : strip.cells) cells[{index_of(c.s), index_of(c.lateral)}] = &c;

  StripErrors out;
  Spread height, joined, beside, grade, frame_grade;
  std::vector<ComparedCell> compared;
  for (int i = index_of(places.first()); i <= index_of(places.last() + options.view); ++i) {
    const double s = (i + 0.5) * options.cell, true_s = places.true_s(s);
    Eigen::Vector2d ahead;
    const Eigen::Vector3d on_line = line.at(true_s, &ahead);
    for (int j = index_of(-options.half_width); j < index_of(options.half_width); ++j) {
      const double lateral = (j + 0.5) * options.cell;
      Eigen::Vector3d place = on_line + lateral * Eigen::Vector3d(-ahead.y(), ahead.x(), 0.0);
      const std::optional<double> true_height = ground.height(place, on_line.z());
      if (!true_height) continue;
      place.z() = *true_height;
      const Eigen::Vector3d world = level_from_world.transpose() * place;
      if (std::none_of(frames.begin(), frames.end(), [&](const PosedFrame& f) {
            return std::abs(f.true_s - true_s) <= options.view &&
                   in_view(scene, *f.truth, world, options.view);
          })) {
        continue;
      }
      ++out.cells;
      const auto found = cells.find({i, j});
      if (found == cells.end()) continue;
      ++out.answered;
      const StripCell& cell = *found->second;
      compared.push_back({s, true_s, lateral, cell.point.z(), *true_height});
      if (s <= places.last()) {
        beside.add((cell.point.z() - strip.line.at(s).z()) - (*true_height - on_line.z()),
                   cell.sigma);
      }
      if (s - options.before < places.first() || s - options.before > places.last()) continue;
      const double true_rise = *true_height - line.at(true_s - options.before).z();
      const Eigen::Vector3d rise = cell.point - strip.line.at(s - options.before);
      height.add(rise.z() - true_rise);
      joined.add(up_by_frame[frame_at(true_s - options.before)] * rise - true_rise);
    }
  }
  for (const PosedFrame& f : frames) {
    const auto [estimated, true_grade] = grades(compared, f.s, f.true_s, options);
    grade.add(estimated - true_grade);
    if (!f.truth->ego_plane) continue;
    const Eigen::Vector3d normal =
        level_from_world * (f.truth->world_from_camera->rotation() * f.truth->ego_plane->normal);
    Eigen::Vector2d ahead;
    line.at(f.true_s, &ahead);
    frame_grade.add(f.estimate->grade.value - std::atan(-normal.head<2>().dot(ahead) / normal.z()),
                    f.estimate->grade.sigma);
  }
  out.height = height.spread();
  out.joined = joined.spread();
  out.beside = beside.spread();
  out.grade = grade.spread();
  out.grade_rms = grade.rms();
  out.frame_grade = frame_grade.spread();
  out.frame_grade_rms = frame_grade.rms();
  return out;
}

}  // namespace camber
