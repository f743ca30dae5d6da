#include "camber/evaluate/metrics.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kPi = 3.14159265358979323846;

/// Whether a true vehicle counts (DESIGN, "How results are judged").
bool counts(const TruthVehicle& vehicle, const PinholeCamera& camera) {
  const double least = camera.width == 960 ? 9.0 : 14.0;  // px; half-size images of SYNTHIA-SF
  return vehicle.occlusion <= 0.7 && vehicle.truncation <= 0.5 && vehicle.box.height() >= least;
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return kNaN;
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

struct Bin {
  const char* name;
  double from, to;
};
constexpr Bin kBins[] = {{"all", 0.0, 1e9},
                         {"to_15", 0.0, 15.0},
                         {"15_to_30", 15.0, 30.0},
                         {"beyond_30", 30.0, 1e9}};

std::vector<double> collect(const SceneMetrics& metrics, const Bin& bin,
                            double (*value)(const VehicleError&)) {
  std::vector<double> out;
  for (const VehicleError& error : metrics.vehicles) {
    if (error.distance <= bin.from && bin.from > 0) continue;
    if (error.distance > bin.to || error.status == Status::kFailed) continue;
    const double v = value(error);
    if (std::isfinite(v)) out.push_back(v);
  }
  return out;
}

nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::json statistics(const std::vector<double>& values) {
  double sum = 0.0, squares = 0.0;
  for (const double v : values) sum += v;
  const double mean = values.empty() ? kNaN : sum / static_cast<double>(values.size());
  for (const double v : values) squares += (v - mean) * (v - mean);
  const double deviation =
      values.size() < 2 ? kNaN : std::sqrt(squares / static_cast<double>(values.size() - 1));
  return {{"count", values.size()},
          {"mean", number(mean)},
          {"std", number(deviation)},
          {"median", number(quantile(values, 0.5))},
          {"p90", number(quantile(values, 0.9))}};
}

}  // namespace

SceneMetrics evaluate_scene(const Scene& scene, const RoadSurface& surface,
                            const VehicleDocument& vehicles, const RunDocument& run) {
  if (!scene.truth) throw std::invalid_argument("the scene has no truth to compare with");
  SceneMetrics out;
  out.scale_error = out.rotation_error = out.direction_error = kNaN;
  out.ego_height_error = out.ego_normal_error = kNaN;

  const auto truth_of = [&](int id) -> const TruthFrame* {
    for (const TruthFrame& frame : scene.truth->frames) {
      if (frame.id == id) return &frame;
    }
    return nullptr;
  };

  for (const VehicleFrame& estimate : vehicles.frames) {
    const TruthFrame* truth = truth_of(estimate.id);
    if (!truth) continue;
    // Greedy by overlap among all pairs of counted vehicles and detections.
    struct Pair {
      double overlap;
      std::size_t truth, estimate;
    };
    std::vector<Pair> pairs;
    std::vector<std::size_t> counted;
    for (std::size_t t = 0; t < truth->vehicles.size(); ++t) {
      const TruthVehicle& vehicle = truth->vehicles[t];
      if (!counts(vehicle, scene.camera)) continue;
      counted.push_back(t);
      const Box2 box = vehicle.box.clipped(scene.camera.width, scene.camera.height);
      for (std::size_t e = 0; e < estimate.vehicles.size(); ++e) {
        const double overlap = intersection_over_union(box, estimate.vehicles[e].box);
        if (overlap >= 0.5) pairs.push_back({overlap, t, e});
      }
    }
    out.counted += static_cast<int>(counted.size());
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const Pair& a, const Pair& b) { return a.overlap > b.overlap; });
    std::vector<bool> truth_used(truth->vehicles.size()), used(estimate.vehicles.size());
    int matched = 0;
    for (const Pair& pair : pairs) {
      if (truth_used[pair.truth] || used[pair.estimate]) continue;
      truth_used[pair.truth] = used[pair.estimate] = true;
      ++matched;
      const TruthVehicle& t = truth->vehicles[pair.truth];
      const VehicleEstimate& e = estimate.vehicles[pair.estimate];
      VehicleError error;
      error.frame = estimate.id;
      error.truth_id = t.id;
      error.estimate_id = e.id;
      error.status = e.status;
      error.distance = t.pose.bottom_center().norm();
      error.center_error = error.height_error = error.yaw_error = error.normal_error = kNaN;
      error.height_sigma = e.plane_sigma_height;
      if (e.status == Status::kFailed) {
        ++out.unanswered;
      } else {
        error.center_error = (e.pose.center() - t.pose.center()).norm();
        // n . f + d > 0: the true contact point is above the plane, the estimate too low.
        if (t.plane) {
          const Eigen::Vector3d contact = t.plane->foot(t.pose.bottom_center());
          error.height_error = -e.plane.signed_distance(contact);
          error.normal_error = angle_between(e.plane.normal, t.plane->normal);
        } else {
          const Eigen::Vector3d bottom = t.pose.bottom_center();
          error.height_error = e.plane.signed_distance(bottom) / e.plane.normal.y();
        }
        const double yaw =
            rotation_y(e.pose.camera_from_vehicle.rotation_matrix()) -
            rotation_y(t.pose.camera_from_vehicle.rotation_matrix());
        error.yaw_error = std::remainder(yaw, 2.0 * kPi);
      }
      out.vehicles.push_back(error);
    }
    out.missed += static_cast<int>(counted.size()) - matched;
  }

  // Motion: true poses of the frames that the run used, joined at the first of them.
  std::vector<SE3> estimated, known;
  for (const RunDocument::CameraPose& camera : run.cameras) {
    const TruthFrame* truth = truth_of(camera.id);
    if (!truth || !truth->world_from_camera) continue;
    estimated.push_back(camera.reference_from_camera);
    known.push_back(*truth->world_from_camera);
  }
  if (estimated.size() >= 2) {
    double length = 0.0, true_length = 0.0, rotation = 0.0;
    for (std::size_t k = 1; k < estimated.size(); ++k) {
      const SE3 e = estimated[k - 1].inverse() * estimated[k];
      const SE3 t = known[k - 1].inverse() * known[k];
      length += e.translation().norm();
      true_length += t.translation().norm();
      rotation = std::max(
          rotation, rotation_to_vector(e.rotation().conjugate() * t.rotation()).norm());
    }
    const SE3 e = estimated.front().inverse() * estimated.back();
    const SE3 t = known.front().inverse() * known.back();
    if (surface.metric && true_length > 0) out.scale_error = length / true_length - 1.0;
    out.rotation_error = rotation;
    out.direction_error = angle_between(e.translation(), t.translation());
  }

  const PlanePatch* ego = surface.find(surface.ego_patch);
  int reference = -1;
  for (const RunDocument::CameraPose& camera : run.cameras) {
    if (camera.reference_from_camera.translation().norm() == 0.0) reference = camera.id;
  }
  const TruthFrame* truth = truth_of(reference);
  if (ego && truth && truth->ego_plane) {
    const Eigen::Vector3d foot = truth->ego_plane->foot(Eigen::Vector3d::Zero());
    out.ego_height_error = -ego->plane.plane.signed_distance(foot);
    out.ego_normal_error = angle_between(ego->plane.plane.normal, truth->ego_plane->normal);
  }
  return out;
}

nlohmann::json to_json(const SceneMetrics& metrics) {
  nlohmann::json out;
  out["counted"] = metrics.counted;
  out["matched"] = metrics.vehicles.size();
  out["missed"] = metrics.missed;
  out["unanswered"] = metrics.unanswered;
  out["scale_error"] = number(metrics.scale_error);
  out["rotation_error_deg"] = number(metrics.rotation_error * 180.0 / kPi);
  out["direction_error_deg"] = number(metrics.direction_error * 180.0 / kPi);
  out["ego_height_error"] = number(metrics.ego_height_error);
  out["ego_normal_error_deg"] = number(metrics.ego_normal_error * 180.0 / kPi);
  for (const Bin& bin : kBins) {
    nlohmann::json& entry = out["by_distance"][bin.name];
    entry["center_error"] =
        statistics(collect(metrics, bin, [](const VehicleError& e) { return e.center_error; }));
    entry["height_error"] = statistics(
        collect(metrics, bin, [](const VehicleError& e) { return std::abs(e.height_error); }));
    entry["normal_error_deg"] = statistics(collect(
        metrics, bin, [](const VehicleError& e) { return e.normal_error * 180.0 / kPi; }));
    entry["yaw_error_deg"] = statistics(collect(
        metrics, bin, [](const VehicleError& e) { return std::abs(e.yaw_error) * 180.0 / kPi; }));
    const std::vector<double> inside = collect(metrics, bin, [](const VehicleError& e) {
      return std::abs(e.height_error) <= 1.959964 * e.height_sigma ? 1.0 : 0.0;
    });
    double sum = 0.0;
    for (const double v : inside) sum += v;
    entry["height_within_95"] =
        inside.empty() ? nlohmann::json(nullptr)
                       : nlohmann::json(sum / static_cast<double>(inside.size()));
  }
  out["vehicles"] = nlohmann::json::array();
  for (const VehicleError& e : metrics.vehicles) {
    out["vehicles"].push_back({{"frame", e.frame},
                               {"truth_id", e.truth_id},
                               {"estimate_id", e.estimate_id},
                               {"distance", number(e.distance)},
                               {"center_error", number(e.center_error)},
                               {"height_error", number(e.height_error)},
                               {"height_sigma", number(e.height_sigma)},
                               {"normal_error_deg", number(e.normal_error * 180.0 / kPi)},
                               {"yaw_error_deg", number(e.yaw_error * 180.0 / kPi)},
                               {"status", std::string(to_string(e.status))}});
  }
  return out;
}

std::string describe(const SceneMetrics& metrics) {
  std::string out = "against the truth:\n";
  char line[200];
  const auto add = [&](const char* format, auto... values) {
    std::snprintf(line, sizeof line, format, values...);
    out += line;
  };
  if (std::isfinite(metrics.scale_error)) {
    add("  scale %+.2f %%, direction of travel %.3f deg, rotation %.3f deg\n",
        100.0 * metrics.scale_error, metrics.direction_error * 180.0 / kPi,
        metrics.rotation_error * 180.0 / kPi);
  }
  if (std::isfinite(metrics.ego_height_error)) {
    add("  ego plane: height %+.3f m, normal %.2f deg\n", metrics.ego_height_error,
        metrics.ego_normal_error * 180.0 / kPi);
  }
  add("  vehicles: %d counted, %zu found, %d without an answer\n", metrics.counted,
      metrics.vehicles.size(), metrics.unanswered);
  for (const Bin& bin : kBins) {
    const std::vector<double> heights =
        collect(metrics, bin, [](const VehicleError& e) { return std::abs(e.height_error); });
    const std::vector<double> centers =
        collect(metrics, bin, [](const VehicleError& e) { return e.center_error; });
    if (heights.empty() && centers.empty()) continue;
    const char* where = bin.to > 1e8 ? (bin.from > 0 ? "> 30 m" : "all")
                                     : (bin.from > 0 ? "15-30 m" : "<= 15 m");
    add("  %-8s %3zu: ground height error median %.3f m, p90 %.3f m; centre error median %.2f m\n",
        where, heights.size(), quantile(heights, 0.5), quantile(heights, 0.9),
        quantile(centers, 0.5));
  }
  return out;
}

}  // namespace camber
