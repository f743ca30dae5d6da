#include "camber/render/vehicle_comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "camber/core/errors.h"
#include "camber/evaluate/metrics.h"
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
        const std::string& method = result->vehicles->method;
        answers[match.truth].push_back({method.empty() ? "estimate" : method, estimate,
                                        (estimate.pose.center() - t.pose.center()).norm()});
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

void add_edge(PlotSeries* side, PlotSeries* top, const Vector3d& a, const Vector3d& b) {
  for (const Vector3d& p : {a, b}) {
    side->x.push_back(p.x());
    side->y.push_back(p.z());
    top->x.push_back(p.x());
    top->y.push_back(p.y());
  }
  for (PlotSeries* series : {side, top}) {
    series->x.push_back(kNaN);
    series->y.push_back(kNaN);
  }
}

}  // namespace

PlotSheet vehicle_comparison(const std::vector<const LoadedResult*>& results, int frame,
                             std::optional<int> vehicle) {
  if (results.empty()) throw std::invalid_argument("vehicle comparison: found no results");
  const LoadedResult& first = *results.front();
  if (!first.scene || !first.scene->truth) {
    throw NoAnswerError("a comparison of vehicles needs a scene with truth");
  }
  const TruthFrame* truth = nullptr;
  for (const TruthFrame& candidate : first.scene->truth->frames) {
    if (candidate.id == frame) truth = &candidate;
  }
  if (!truth) {
    throw NoAnswerError("the scene has no truth of frame " + std::to_string(frame));
  }
  const auto answers = find_answers(results, frame, *truth, first.scene->camera);
  const std::vector<Answer>* chosen = nullptr;
  const TruthVehicle* t = nullptr;
  double widest = -1.0;
  for (const auto& [index, list] : answers) {
    const TruthVehicle& candidate = truth->vehicles[index];
    if (vehicle && candidate.id != *vehicle) continue;
    double least = std::numeric_limits<double>::infinity(), largest = 0.0;
    for (const Answer& answer : list) {
      least = std::min(least, answer.error);
      largest = std::max(largest, answer.error);
    }
    if (largest - least <= widest) continue;
    widest = largest - least;
    chosen = &list;
    t = &candidate;
  }
  if (!chosen) {
    throw NoAnswerError("frame " + std::to_string(frame) +
                        (vehicle ? ": true vehicle " + std::to_string(*vehicle) +
                                       " is not matched and answered by all results"
                                 : ": no true vehicle is matched and answered by all results"));
  }

  SE3 reference_from_camera;
  if (first.run) {
    for (const RunDocument::CameraPose& camera : first.run->cameras) {
      if (camera.id == frame) reference_from_camera = camera.reference_from_camera;
    }
  }
  const double camera_height = first.scene->height_above_road.value_or(0.0);
  const View view(reference_from_camera,
                  first.surface ? first.surface->up : Vector3d(0.0, -1.0, 0.0), camera_height);
  const Vector3d place = view(t->pose.bottom_center());
  if (!(place.x() > 0.5)) {
    throw NoAnswerError("true vehicle " + std::to_string(t->id) + " is not ahead of the camera");
  }

  Plot side, top;
  side.title = "From the side";
  top.title = "From above";
  side.equal_scale = top.equal_scale = true;
  side.x.title = top.x.title = "ahead of the camera, m";
  side.y.title = first.scene->height_above_road ? "height above the near road, m"
                                                : "height above the camera, m";
  top.y.title = "left of the camera, m";

  PlotSeries true_side, true_top;
  true_side.name = "true box";
  true_side.color = true_top.color = kTruthRed;
  true_side.thickness = true_top.thickness = 2.6;
  const auto true_corners = t->pose.corners();
  for (const auto& [a, b] : box_edges()) {
    add_edge(&true_side, &true_top, view(true_corners.col(a)), view(true_corners.col(b)));
  }
  double low = place.x(), high = place.x();
  std::vector<PlotSeries> estimates_side, estimates_top;
  for (std::size_t k = 0; k < chosen->size(); ++k) {
    const Answer& answer = (*chosen)[k];
    PlotSeries s, u;
    s.name = answer.name + ": centre " + format_number(answer.error, 2) + " m off";
    s.color = u.color = plot_color(static_cast<int>(k));
    s.thickness = u.thickness = 2.0;
    if (has_wireframe(answer.estimate)) {
      for (const auto& [a, b] : wireframe_edges()) {
        add_edge(&s, &u, view(answer.estimate.keypoints[static_cast<std::size_t>(a)]),
                 view(answer.estimate.keypoints[static_cast<std::size_t>(b)]));
      }
    } else {
      const auto corners = answer.estimate.pose.corners();
      for (const auto& [a, b] : box_edges()) {
        add_edge(&s, &u, view(corners.col(a)), view(corners.col(b)));
      }
    }
    const double ahead = view(answer.estimate.pose.center()).x();
    low = std::min(low, ahead);
    high = std::max(high, ahead);
    estimates_side.push_back(s);
    estimates_top.push_back(u);
  }
  low = std::max(0.0, std::min(low - 6.0, 0.5 * low));
  high += 6.0;

  PlotSeries road, ray_side, ray_top;
  road.name = first.truth_cloud ? "true road" : "road as estimated by " + (*chosen)[0].name;
  road.color = {185, 185, 185, 1.0};
  road.thickness = 7.0;
  double last = kNaN;
  for (const auto& [ahead, height] : road_line(first, view, place, low, high)) {
    if (ahead - last > 3.0) {  // a gap
      road.x.push_back(kNaN);
      road.y.push_back(kNaN);
    }
    road.x.push_back(ahead);
    road.y.push_back(height);
    last = ahead;
  }
  ray_side.name = "ray of the camera";
  ray_side.color = ray_top.color = {120, 120, 120, 1.0};
  ray_side.dashed = ray_top.dashed = true;
  ray_side.thickness = ray_top.thickness = 1.2;
  const Vector3d center = view(t->pose.center());
  for (const double ahead : {low, high}) {
    const double share = ahead / center.x();
    ray_side.x.push_back(ahead);
    ray_side.y.push_back(camera_height + share * (center.z() - camera_height));
    ray_top.x.push_back(ahead);
    ray_top.y.push_back(share * center.y());
  }
  if (!road.x.empty()) side.series.push_back(road);
  side.series.push_back(ray_side);
  side.series.push_back(true_side);
  top.series = {ray_top, true_top};
  // The first result, usually the best, on top of the others.
  for (std::size_t k = chosen->size(); k-- > 0;) {
    side.series.push_back(estimates_side[k]);
    top.series.push_back(estimates_top[k]);
  }
  for (Plot* plot : {&side, &top}) {
    plot->x.low = low;
    plot->x.high = high;
  }
  PlotSheet sheet;
  sheet.title = first.scene->name + ", frame " + std::to_string(frame) + ": vehicle " +
                std::to_string(t->id) + ", truly " +
                format_number(t->pose.bottom_center().norm(), 1) + " m away";
  sheet.panels = {side, top};
  return sheet;
}

}  // namespace camber
