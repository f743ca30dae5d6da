#include "camber/evaluate/metrics.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kPi = 3.14159265358979323846;

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
constexpr Bin kBins[] = {
    {"all", 0.0, 1e9}, {"to_15", 0.0, 15.0}, {"15_to_30", 15.0, 30.0}, {"beyond_30", 30.0, 1e9}};

std::vector<double> collect(const SceneMetrics& metrics, const Bin& bin,
                            double (*value)(const VehicleError&)) {
  std::vector<double> out;
  for (const VehicleError& error : metrics.vehicles) {
    if (error.distance <= bin.from && bin.from > 0) continue;
    if (error.distance > bin.to || !error.answered) continue;
    const double v = value(error);
    if (std::isfinite(v)) out.push_back(v);
  }
  return out;
}

nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

// An error of a centre's place below this is rounding, m.
constexpr double kNoError = 1e-9;

// 95 %: of chi-square with three degrees of freedom, and either side of a normal distribution.
constexpr double kEllipsoid95 = 7.814728, kInterval95 = 1.959964;

double mean_of(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return values.empty() ? kNaN : sum / static_cast<double>(values.size());
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

/// Squared Mahalanobis distance by a stated covariance. Without variance in a direction no error in
/// it is allowed: infinite where there is one.
/// @param singular  set where the covariance has such a direction, or a negative variance.
double squared_mahalanobis(const Eigen::Vector3d& difference, const Eigen::Matrix3d& covariance,
                           bool* singular) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(
      0.5 * (covariance + covariance.transpose()));
  const double least = 1e-12 * std::max(solver.eigenvalues().maxCoeff(), 0.0);
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) {
    const double part = solver.eigenvectors().col(i).dot(difference);
    if (solver.eigenvalues()[i] > least) {
      sum += part * part / solver.eigenvalues()[i];
      continue;
    }
    *singular = true;
    if (std::abs(part) > kNoError) sum = std::numeric_limits<double>::infinity();
  }
  return sum;
}

const TruthFrame* find_truth(const SceneTruth& truth, int id) {
  for (const TruthFrame& frame : truth.frames) {
    if (frame.id == id) return &frame;
  }
  return nullptr;
}

}  // namespace

namespace {

/// Whether a vehicle is seen well enough to count.
bool is_seen(const TruthVehicle& vehicle, const PinholeCamera& camera) {
  const double least = camera.width == 960 ? 9.0 : 14.0;  // px; half-size images of SYNTHIA-SF
  return vehicle.occlusion <= 0.7 && vehicle.truncation <= 0.5 && vehicle.box.height() >= least;
}

}  // namespace

bool is_counted(const TruthVehicle& vehicle, const PinholeCamera& camera) {
  return vehicle.uncertain.empty() && is_seen(vehicle, camera);
}

std::vector<Match> match_vehicles(const std::vector<TruthVehicle>& truth,
                                  const std::vector<VehicleEstimate>& estimates,
                                  const PinholeCamera& camera) {
  std::vector<Match> pairs;
  for (std::size_t t = 0; t < truth.size(); ++t) {
    if (!is_counted(truth[t], camera)) continue;
    const Box2 box = truth[t].box.clipped(camera.width, camera.height);
    for (std::size_t e = 0; e < estimates.size(); ++e) {
      const double overlap = intersection_over_union(box, estimates[e].box);
      if (overlap >= 0.5) pairs.push_back({t, e, overlap});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const Match& a, const Match& b) { return a.overlap > b.overlap; });
  std::vector<bool> truth_used(truth.size()), used(estimates.size());
  std::vector<Match> out;
  for (const Match& pair : pairs) {
    if (truth_used[pair.truth] || used[pair.estimate]) continue;
    truth_used[pair.truth] = used[pair.estimate] = true;
    out.push_back(pair);
  }
  return out;
}

VehicleError compare_vehicle(const TruthVehicle& t, const VehicleEstimate& e) {
  VehicleError error;
  error.truth_id = t.id;
  error.estimate_id = e.id;
  error.status = e.status;
  error.answered = e.status != Status::kFailed && e.status != Status::kNotRun;
  error.distance = t.pose.bottom_center().norm();
  error.center_error = error.height_error = error.yaw_error = error.normal_error = kNaN;
  error.along_error = error.center_mahalanobis = error.keypoint_error = error.dimension_error =
      kNaN;
  error.height_sigma = e.plane_sigma_height;
  error.true_depth = t.pose.center().z();
  error.depth = error.depth_sigma = kNaN;
  if (!error.answered) return error;

  const Eigen::Vector3d difference = e.pose.center() - t.pose.center();
  error.center_error = difference.norm();
  error.along_error = difference.dot(t.pose.center().normalized());
  error.depth = e.pose.center().z();
  const Eigen::Matrix3d covariance = e.covariance.topLeftCorner<3, 3>();
  if (covariance(2, 2) >= 0.0) error.depth_sigma = std::sqrt(covariance(2, 2));
  if (covariance.allFinite()) {
    error.center_mahalanobis =
        squared_mahalanobis(difference, covariance, &error.singular_covariance);
  }
  // n . f + d > 0: the true contact point is above the plane, the estimate too low.
  if (!std::isfinite(e.plane.offset)) {
    error.height_sigma = kNaN;  // no plane is stated
  } else if (t.plane) {
    const Eigen::Vector3d contact = t.plane->foot(t.pose.bottom_center());
    error.height_error = -e.plane.signed_distance(contact);
    error.normal_error = angle_between(e.plane.normal, t.plane->normal);
  } else {
    error.height_error = e.plane.signed_distance(t.pose.bottom_center()) / e.plane.normal.y();
  }
  error.yaw_error = std::remainder(rotation_y(e.pose.camera_from_vehicle.rotation_matrix()) -
                                       rotation_y(t.pose.camera_from_vehicle.rotation_matrix()),
                                   2.0 * kPi);
  if (t.keypoints.size() == static_cast<std::size_t>(kNumKeypoints)) {
    double sum = 0.0;
    for (int i = 0; i < kNumKeypoints; ++i) sum += (e.keypoints[i] - t.keypoints[i]).norm();
    error.keypoint_error = sum / kNumKeypoints;
  }
  const Dimensions &a = e.pose.dimensions, &b = t.pose.dimensions;
  error.dimension_error = (std::abs(a.length - b.length) + std::abs(a.width - b.width) +
                           std::abs(a.height - b.height)) /
                          3.0;
  return error;
}

SceneMetrics evaluate_vehicles(const Scene& scene, const VehicleDocument& vehicles) {
  if (!scene.truth) throw std::invalid_argument("the scene has no truth to compare with");
  SceneMetrics out;
  out.scale_error = out.rotation_error = out.direction_error = kNaN;
  out.ego_height_error = out.ego_normal_error = kNaN;
  for (const VehicleFrame& estimate : vehicles.frames) {
    const TruthFrame* truth = find_truth(*scene.truth, estimate.id);
    if (!truth) continue;
    int counted = 0;
    for (const TruthVehicle& v : truth->vehicles) {
      counted += is_counted(v, scene.camera) ? 1 : 0;
      out.uncertain += !v.uncertain.empty() && is_seen(v, scene.camera) ? 1 : 0;
    }
    const std::vector<Match> matches =
        match_vehicles(truth->vehicles, estimate.vehicles, scene.camera);
    for (const Match& match : matches) {
      VehicleError error =
          compare_vehicle(truth->vehicles[match.truth], estimate.vehicles[match.estimate]);
      error.frame = estimate.id;
      error.overlap = match.overlap;
      out.unanswered += error.answered ? 0 : 1;
      out.without_covariance += error.answered && std::isnan(error.center_mahalanobis) ? 1 : 0;
      out.singular_covariance += error.singular_covariance ? 1 : 0;
      out.vehicles.push_back(error);
    }
    out.counted += counted;
    out.missed += counted - static_cast<int>(matches.size());
  }
  for (const TruthFrame& truth : scene.truth->frames) {
    const bool judged =
        std::any_of(vehicles.frames.begin(), vehicles.frames.end(),
                    [&](const VehicleFrame& estimate) { return estimate.id == truth.id; });
    if (judged) continue;
    for (const TruthVehicle& v : truth.vehicles)
      out.unjudged += is_counted(v, scene.camera) ? 1 : 0;
  }
  return out;
}

SceneMetrics evaluate_scene(const Scene& scene, const RoadSurface& surface,
                            const VehicleDocument& vehicles, const RunDocument& run) {
  SceneMetrics out = evaluate_vehicles(scene, vehicles);
  const auto truth_of = [&](int id) { return find_truth(*scene.truth, id); };

  // Coverage: the surface below the true vehicles, carried by the run's own motion.
  for (const RunDocument::CameraPose& camera : run.cameras) {
    const TruthFrame* truth = truth_of(camera.id);
    if (!truth) continue;
    for (const TruthVehicle& v : truth->vehicles) {
      const Eigen::Vector3d bottom = v.pose.bottom_center();
      if (!is_counted(v, scene.camera) || bottom.norm() > 40.0) continue;
      ++out.within_40;
      const SurfaceQuery query = surface.query(camera.reference_from_camera * bottom);
      out.covered_within_40 += query.status != Status::kFailed ? 1 : 0;
    }
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
      rotation =
          std::max(rotation, rotation_to_vector(e.rotation().conjugate() * t.rotation()).norm());
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
  out["unjudged"] = metrics.unjudged;
  out["uncertain"] = metrics.uncertain;
  out["matched"] = metrics.vehicles.size();
  out["missed"] = metrics.missed;
  out["unanswered"] = metrics.unanswered;
  out["without_covariance"] = metrics.without_covariance;
  out["singular_covariance"] = metrics.singular_covariance;
  out["within_40"] = metrics.within_40;
  out["covered_within_40"] = metrics.covered_within_40;
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
    entry["normal_error_deg"] = statistics(
        collect(metrics, bin, [](const VehicleError& e) { return e.normal_error * 180.0 / kPi; }));
    entry["yaw_error_deg"] = statistics(collect(
        metrics, bin, [](const VehicleError& e) { return std::abs(e.yaw_error) * 180.0 / kPi; }));
    const std::vector<double> inside = collect(metrics, bin, [](const VehicleError& e) {
      if (!std::isfinite(e.height_error) || !std::isfinite(e.height_sigma)) return kNaN;
      return std::abs(e.height_error) <= kInterval95 * e.height_sigma ? 1.0 : 0.0;
    });
    entry["height_within_95"] = number(mean_of(inside));
  }
  {
    const std::vector<double> inside = collect(metrics, kBins[0], [](const VehicleError& e) {
      if (std::isnan(e.center_mahalanobis)) return kNaN;
      return e.center_mahalanobis <= kEllipsoid95 ? 1.0 : 0.0;
    });
    out["center_within_95"] = number(mean_of(inside));
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
                               {"along_error", number(e.along_error)},
                               {"center_mahalanobis", number(e.center_mahalanobis)},
                               {"singular_covariance", e.singular_covariance},
                               {"keypoint_error", number(e.keypoint_error)},
                               {"dimension_error", number(e.dimension_error)},
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
  if (metrics.uncertain > 0) {
    add("  %d true vehicles do not count: their truth is uncertain\n", metrics.uncertain);
  }
  if (metrics.singular_covariance > 0) {
    add("  %d state a singular covariance: no error of theirs is allowed for\n",
        metrics.singular_covariance);
  }
  for (const Bin& bin : kBins) {
    const std::vector<double> heights =
        collect(metrics, bin, [](const VehicleError& e) { return std::abs(e.height_error); });
    const std::vector<double> centers =
        collect(metrics, bin, [](const VehicleError& e) { return e.center_error; });
    if (heights.empty() && centers.empty()) continue;
    const char* where =
        bin.to > 1e8 ? (bin.from > 0 ? "> 30 m" : "all") : (bin.from > 0 ? "15-30 m" : "<= 15 m");
    add("  %-8s %3zu: ground height error median %.3f m, p90 %.3f m; centre error median %.2f m\n",
        where, heights.size(), quantile(heights, 0.5), quantile(heights, 0.9),
        quantile(centers, 0.5));
  }
  return out;
}

}  // namespace camber
