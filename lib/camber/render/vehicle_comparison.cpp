#include "camber/render/vehicle_comparison.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "camber/core/errors.h"
#include "camber/evaluate/metrics.h"
#include "camber/evaluate/tables.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_space.h"
#include "camber/render/wireframe.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kBin = 0.5;    // m of road
constexpr double kStrip = 1.0;  // m to each side of the line towards the vehicle

/// A result's answer for one true vehicle.
struct Answer {
  std::string name;
  VehicleEstimate estimate;
  double error = 0.0;  // m
};

/// Answers by the true vehicle's index, of all results or not at all.
std::map<std::size_t, std::vector<Answer>> find_answers(
    const std::vector<const LoadedResult*>& results, int frame, const TruthFrame& truth,
    const PinholeCamera& camera) {
  std::map<std::size_t, std::vector<Answer>> answers;
  for (const LoadedResult* result : results) {
    if (!result->vehicles) {
      throw NoAnswerError(result->path.string() + " holds no vehicles to compare");
    }
    for (const VehicleFrame& candidate : result->vehicles->frames) {
      if (candidate.id != frame) continue;
      for (const Match& match : match_vehicles(truth.vehicles, candidate.vehicles, camera)) {
        const VehicleEstimate& estimate = candidate.vehicles[match.estimate];
        if (!has_box(estimate)) continue;
        const TruthVehicle& t = truth.vehicles[match.truth];
        const VehicleDocument& from = *result->vehicles;
        answers[match.truth].push_back(
            {from.method.empty() ? "estimate"
                                 : method_label(from.method, from.preset, from.paper_terms),
             estimate, (estimate.pose.center() - t.pose.center()).norm()});
      }
    }
  }
  for (auto it = answers.begin(); it != answers.end();) {
    it = it->second.size() == results.size() ? std::next(it) : answers.erase(it);
  }
  return answers;
}

/// Along the line from the camera to the vehicle: ahead, and height along up.
class View {
 public:
  View(const SE3& reference_from_camera, const Vector3d& up, double camera_height)
      : reference_from_camera_(reference_from_camera),
        origin_(reference_from_camera.translation()),
        up_(up.normalized()),
        camera_height_(camera_height) {
    ahead_ = reference_from_camera.rotation() * Vector3d::UnitZ();
    ahead_ -= up_ * up_.dot(ahead_);
    if (ahead_.norm() < 1e-6) ahead_ = up_.unitOrthogonal();
    ahead_.normalize();
    right_ = ahead_.cross(up_);
  }

  /// Ahead, left, up (over the road below the camera) of a point of the frame's camera.
  Vector3d operator()(const Vector3d& in_camera) const {
    return of_reference(reference_from_camera_ * in_camera);
  }
  Vector3d of_reference(const Vector3d& x) const {
    const Vector3d d = x - origin_;
    return {ahead_.dot(d), -right_.dot(d), up_.dot(d) + camera_height_};
  }
  Vector3d to_reference(double ahead, double left) const {
    return origin_ + ahead * ahead_ - left * right_ - camera_height_ * up_;
  }
  double camera_height() const { return camera_height_; }

 private:
  SE3 reference_from_camera_;
  Vector3d origin_, up_, ahead_, right_;
  double camera_height_;
};

/// Height of the road towards the vehicle by distance ahead.
std::map<double, double> road_line(const LoadedResult& result, const View& view,
                                   const Vector3d& vehicle, double from, double to) {
  std::map<double, double> line;
  const auto left_of = [&](double ahead) { return vehicle.y() * ahead / vehicle.x(); };
  if (result.truth_cloud) {
    std::map<int, std::vector<double>> bins;
    for (const auto& p : result.truth_cloud->points) {
      const Vector3d x = view.of_reference(result.reference_from_truth_cloud * p.cast<double>());
      if (!(x.x() >= from && x.x() <= to) || std::abs(x.y() - left_of(x.x())) > kStrip) continue;
      bins[static_cast<int>(std::floor(x.x() / kBin))].push_back(x.z());
    }
    for (auto& [bin, heights] : bins) {
      const auto middle = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 2);
      std::nth_element(heights.begin(), middle, heights.end());
      line[(bin + 0.5) * kBin] = *middle;
    }
  } else if (result.surface) {
    for (double ahead = from; ahead <= to; ahead += kBin) {
      const SurfaceQuery query =
          result.surface->query(view.to_reference(ahead, left_of(ahead)), 3.0);
      if (query.status == Status::kFailed || query.status == Status::kNotRun) continue;
      line[ahead] = view.of_reference(query.point).z();
    }
  }
  return line;
}

const TruthFrame& truth_of(const LoadedResult& result, int frame) {
  if (!result.scene || !result.scene->truth) {
    throw NoAnswerError("a comparison of vehicles needs a scene with truth");
  }
  const TruthFrame* truth = nullptr;
  for (const TruthFrame& candidate : result.scene->truth->frames) {
    if (candidate.id == frame) truth = &candidate;
  }
  if (!truth) throw NoAnswerError("the scene has no truth of frame " + std::to_string(frame));
  return *truth;
}

/// A true vehicle and what each result makes of it.
struct ComparedVehicle {
  TruthVehicle truth;
  std::vector<Answer> answers;
};

/// @param vehicle  id of the true one; none: where the errors differ most.
ComparedVehicle choose_vehicle(const std::vector<const LoadedResult*>& results, int frame,
                               std::optional<int> vehicle) {
  const TruthFrame& truth = truth_of(*results.front(), frame);
  const auto answers = find_answers(results, frame, truth, results.front()->scene->camera);
  std::optional<ComparedVehicle> chosen;
  double widest = -1.0;
  for (const auto& [index, list] : answers) {
    const TruthVehicle& candidate = truth.vehicles[index];
    if (vehicle && candidate.id != *vehicle) continue;
    double least = std::numeric_limits<double>::infinity(), largest = 0.0;
    for (const Answer& answer : list) {
      least = std::min(least, answer.error);
      largest = std::max(largest, answer.error);
    }
    if (largest - least <= widest) continue;
    widest = largest - least;
    chosen = {candidate, list};
  }
  if (chosen) return *chosen;
  throw NoAnswerError("frame " + std::to_string(frame) +
                      (vehicle ? ": true vehicle " + std::to_string(*vehicle) +
                                     " is not matched and answered by all results"
                               : ": no true vehicle is matched and answered by all results"));
}

View view_from_camera(const LoadedResult& result, int frame) {
  SE3 reference_from_camera;
  if (result.run) {
    for (const RunDocument::CameraPose& camera : result.run->cameras) {
      if (camera.id == frame) reference_from_camera = camera.reference_from_camera;
    }
  }
  return {reference_from_camera, result.surface ? result.surface->up : Vector3d(0.0, -1.0, 0.0),
          result.scene->height_above_road.value_or(0.0)};
}

/// The same lines in both plots.
struct Lines {
  PlotSeries side, top;

  void style(const Color& color, double thickness) {
    side.color = top.color = color;
    side.thickness = top.thickness = thickness;
  }
  void add_point(const Vector3d& p) {
    side.x.push_back(p.x());
    side.y.push_back(p.z());
    top.x.push_back(p.x());
    top.y.push_back(p.y());
  }
  void add_edge(const Vector3d& a, const Vector3d& b) {
    add_point(a);
    add_point(b);
    add_point({kNaN, kNaN, kNaN});
  }
  void add_box(const OrientedBox& box, const View& view) {
    const auto corners = box.corners();
    for (const auto& [a, b] : box_edges()) add_edge(view(corners.col(a)), view(corners.col(b)));
  }
};

Lines true_box(const TruthVehicle& truth, const View& view) {
  Lines lines;
  lines.side.name = "true box";
  lines.style(kTruthRed, 2.6);
  lines.add_box(truth.pose, view);
  return lines;
}

/// Its wireframe, or its box where it has none.
Lines estimated_vehicle(const Answer& answer, int color, const View& view) {
  Lines lines;
  lines.side.name = answer.name + ": centre " + format_number(answer.error, 2) + " m off";
  lines.style(plot_color(color), 2.0);
  if (!has_wireframe(answer.estimate)) {
    lines.add_box(answer.estimate.pose, view);
    return lines;
  }
  const auto& keypoints = answer.estimate.keypoints;
  for (const auto& [a, b] : wireframe_edges()) {
    lines.add_edge(view(keypoints[static_cast<std::size_t>(a)]),
                   view(keypoints[static_cast<std::size_t>(b)]));
  }
  return lines;
}

/// Distances ahead that the plots show, m.
struct Range {
  double low, high;
};

/// From before to behind all places that the vehicle has.
Range range_of(const ComparedVehicle& vehicle, double true_ahead, const View& view) {
  Range range{true_ahead, true_ahead};
  for (const Answer& answer : vehicle.answers) {
    const double ahead = view(answer.estimate.pose.center()).x();
    range.low = std::min(range.low, ahead);
    range.high = std::max(range.high, ahead);
  }
  range.low = std::max(0.0, std::min(range.low - 6.0, 0.5 * range.low));
  range.high += 6.0;
  return range;
}

/// @param line  road_line().
PlotSeries road_series(const std::map<double, double>& line, const std::string& name) {
  PlotSeries road;
  road.name = name;
  road.color = {185, 185, 185, 1.0};
  road.thickness = 7.0;
  double last = kNaN;
  for (const auto& [ahead, height] : line) {
    if (ahead - last > 3.0) {  // a gap
      road.x.push_back(kNaN);
      road.y.push_back(kNaN);
    }
    road.x.push_back(ahead);
    road.y.push_back(height);
    last = ahead;
  }
  return road;
}

/// From the camera through the vehicle's true centre.
Lines camera_ray(const TruthVehicle& truth, const Range& range, const View& view) {
  Lines ray;
  ray.side.name = "ray of the camera";
  ray.style({120, 120, 120, 1.0}, 1.2);
  ray.side.dashed = ray.top.dashed = true;
  const Vector3d center = view(truth.pose.center());
  for (const double ahead : {range.low, range.high}) {
    const double share = ahead / center.x();
    ray.add_point({ahead, share * center.y(),
                   view.camera_height() + share * (center.z() - view.camera_height())});
  }
  return ray;
}

/// Both plots without anything in them.
std::array<Plot, 2> empty_panels(const Range& range, bool road_known) {
  Plot side, top;
  side.title = "From the side";
  top.title = "From above";
  side.y.title = road_known ? "height above the near road, m" : "height above the camera, m";
  top.y.title = "left of the camera, m";
  for (Plot* plot : {&side, &top}) {
    plot->equal_scale = true;
    plot->x.title = "ahead of the camera, m";
    plot->x.low = range.low;
    plot->x.high = range.high;
  }
  return {side, top};
}

}  // namespace

PlotSheet vehicle_comparison(const std::vector<const LoadedResult*>& results, int frame,
                             std::optional<int> vehicle) {
  if (results.empty()) throw std::invalid_argument("vehicle comparison: found no results");
  const LoadedResult& first = *results.front();
  const ComparedVehicle chosen = choose_vehicle(results, frame, vehicle);
  const std::string id = std::to_string(chosen.truth.id);
  const View view = view_from_camera(first, frame);
  const Vector3d place = view(chosen.truth.pose.bottom_center());
  if (!(place.x() > 0.5)) {
    throw NoAnswerError("true vehicle " + id + " is not ahead of the camera");
  }
  const Range range = range_of(chosen, place.x(), view);
  auto [side, top] = empty_panels(range, first.scene->height_above_road.has_value());

  const PlotSeries road = road_series(
      road_line(first, view, place, range.low, range.high),
      first.truth_cloud ? "true road" : "road as estimated by " + chosen.answers[0].name);
  if (!road.x.empty()) side.series.push_back(road);
  std::vector<Lines> drawn = {camera_ray(chosen.truth, range, view), true_box(chosen.truth, view)};
  // The first result, usually the best, on top of the others.
  for (std::size_t k = chosen.answers.size(); k-- > 0;) {
    drawn.push_back(estimated_vehicle(chosen.answers[k], static_cast<int>(k), view));
  }
  for (const Lines& lines : drawn) {
    side.series.push_back(lines.side);
    top.series.push_back(lines.top);
  }
  PlotSheet sheet;
  sheet.title = first.scene->name + ", frame " + std::to_string(frame) + ": vehicle " + id +
                ", truly " + format_number(chosen.truth.pose.bottom_center().norm(), 1) + " m away";
  sheet.panels = {side, top};
  return sheet;
}

}  // namespace camber
