#include "camber/scene/georeference.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/scene/json_reader.h"

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr double kWorstHeading = 10.0 / kDegrees;  // rad, standard deviation
constexpr double kWeakHeading = 2.0 / kDegrees;
constexpr double kMostSigmas = 4.0;

/// The rotation to a level frame, x in the direction of the camera's view, z up.
Matrix3d level_from(const Vector3d& up) {
  Vector3d ahead = Vector3d::UnitZ() - up.z() * up;
  if (ahead.norm() < 0.1) ahead = Vector3d::UnitX() - up.x() * up;
  ahead.normalize();
  Matrix3d out;
  out << ahead.transpose(), up.cross(ahead).transpose(), up.transpose();
  return out;
}

/// One position with the place of the antenna in the run, both level.
struct Match {
  Vector3d run, map;
  double sigma = 0.0, height_sigma = 0.0;  // m
};

/// Mean of the headings less those of the cameras in the run; they have their errors in common.
struct HeadingMeasurement {
  double angle = 0.0, sigma = 0.0;  // rad
};

struct Measurements {
  std::vector<Match> matches;
  std::optional<HeadingMeasurement> heading;
};

Measurements measurements_of(const Scene& scene, const RunDocument& run, const Matrix3d& level) {
  Measurements out;
  Vector2d sum = Vector2d::Zero();
  double variance = 0.0, headings = 0.0;
  for (const RunDocument::CameraPose& camera : run.cameras) {
    const SceneFrame* frame = scene.find_frame(camera.id);
    if (frame == nullptr || !frame->map_position) continue;
    const MapPosition& position = *frame->map_position;
    out.matches.push_back({level * (camera.reference_from_camera * scene.antenna),
                           position.position, position.sigma, position.height_sigma});
    if (!position.heading) continue;
    const Vector3d view = level * (camera.reference_from_camera.rotation() * Vector3d::UnitZ());
    const double angle = *position.heading - std::atan2(view.y(), view.x());
    sum += Vector2d(std::cos(angle), std::sin(angle));
    variance += position.heading_sigma * position.heading_sigma;
    headings += 1.0;
  }
  const bool heights = std::all_of(out.matches.begin(), out.matches.end(),
                                   [](const Match& m) { return std::isfinite(m.map.z()); });
  if (!heights) {  // then they are above the reference camera
    for (Match& m : out.matches) {
      m.map.z() = m.run.z();
      m.height_sigma = std::numeric_limits<double>::quiet_NaN();
    }
  }
  if (headings > 0.0) {
    out.heading = HeadingMeasurement{std::atan2(sum.y(), sum.x()), std::sqrt(variance / headings)};
  }
  return out;
}

/// Sums of the matches about their weighted means.
struct Moments {
  Vector3d run = Vector3d::Zero(), map = Vector3d::Zero();  // means
  double along = 0.0, across = 0.0, spread = 0.0;           // of run against map, over variances
  double variance = 0.0, height_variance = 0.0;             // m^2, means
  double span = 0.0;                                        // m, greatest in the run, in plan
};

Moments moments_of(const std::vector<Match>& matches) {
  Moments out;
  double weights = 0.0;
  const auto count = static_cast<double>(matches.size());
  for (const Match& m : matches) {
    const double w = 1.0 / (m.sigma * m.sigma);
    weights += w;
    out.run += w * m.run;
    out.map += w * (m.map - matches.front().map);  // small numbers
    out.variance += m.sigma * m.sigma / count;
    out.height_variance += m.height_sigma * m.height_sigma / count;
  }
  out.run /= weights;
  out.map = out.map / weights + matches.front().map;
  for (const Match& m : matches) {
    const double w = 1.0 / (m.sigma * m.sigma);
    const Vector2d p = (m.run - out.run).head<2>(), q = (m.map - out.map).head<2>();
    out.along += w * p.dot(q);
    out.across += w * (p.x() * q.y() - p.y() * q.x());
    out.spread += w * p.squaredNorm();
    for (const Match& other : matches) {
      out.span = std::max(out.span, (other.run - m.run).head<2>().norm());
    }
  }
  return out;
}

/// Gauss-Newton on the angle, from the measured heading where there is one.
double fit_angle(const Moments& moments, const std::optional<HeadingMeasurement>& heading) {
  const double prior = heading ? 1.0 / (heading->sigma * heading->sigma) : 0.0;
  double angle = heading ? heading->angle : std::atan2(moments.across, moments.along);
  for (int step = 0; step < 100; ++step) {
    double gradient = moments.along * std::sin(angle) - moments.across * std::cos(angle);
    if (heading) gradient += prior * std::remainder(angle - heading->angle, 2.0 * M_PI);
    angle -= gradient / (moments.spread + prior);
  }
  return std::remainder(angle, 2.0 * M_PI);
}

/// Horizontal misfit of the matches: root of the mean square, m, and over the standard deviations.
std::pair<double, double> misfit(const std::vector<Match>& matches, const Moments& moments,
                                 const Matrix3d& turn) {
  double squares = 0.0, weighted = 0.0;
  for (const Match& m : matches) {
    const Vector2d off = ((m.map - moments.map) - turn * (m.run - moments.run)).head<2>();
    squares += off.squaredNorm();
    weighted += off.squaredNorm() / (m.sigma * m.sigma);
  }
  const double freedom = std::max(2.0 * static_cast<double>(matches.size()) - 3.0, 1.0);
  return {std::sqrt(squares / static_cast<double>(matches.size())), std::sqrt(weighted / freedom)};
}

GeoReference refused(GeoReference out, std::string reason) {
  out.status = Status::kFailed;
  out.reason = std::move(reason);
  return out;
}

double number_of(const nlohmann::json& object, const char* key) {
  const auto at = object.find(key);
  return at != object.end() && at->is_number() ? at->get<double>()
                                               : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

std::string utm_crs(double latitude, double longitude) {
  const double wrapped = std::remainder(longitude, 360.0);
  int zone = std::min(static_cast<int>(std::floor((wrapped + 180.0) / 6.0)) + 1, 60);
  if (latitude >= 56.0 && latitude < 64.0 && wrapped >= 3.0 && wrapped < 12.0) zone = 32;
  if (latitude >= 72.0 && latitude < 84.0 && wrapped >= 0.0 && wrapped < 42.0) {
    zone = wrapped < 9.0 ? 31 : wrapped < 21.0 ? 33 : wrapped < 33.0 ? 35 : 37;
  }
  return fmt::format("EPSG:{}", (latitude < 0.0 ? 32700 : 32600) + zone);
}

GeoReference fit_georeference(const Scene& scene, const RunDocument& run,
                              const RoadSurface& surface) {
  const Matrix3d level = level_from(surface.up.normalized());
  const Measurements measured = measurements_of(scene, run, level);
  GeoReference out;
  if (measured.matches.empty()) return out;
  out.crs = scene.map_crs;
  out.level = surface.level;
  out.positions = static_cast<int>(measured.matches.size());
  if (!surface.metric || !run.metric) {
    return refused(out, "the run is up to an unknown scale, and a map is in metres");
  }
  const Moments moments = moments_of(measured.matches);
  double information = moments.spread;
  if (measured.heading) information += 1.0 / (measured.heading->sigma * measured.heading->sigma);
  out.heading_sigma = 1.0 / std::sqrt(information);  // infinite for a single position
  if (!(out.heading_sigma <= kWorstHeading)) {
    const std::string known =
        out.heading_sigma * kDegrees < 60.0
            ? fmt::format(" to {:.0f} degrees only", out.heading_sigma * kDegrees)
            : std::string(" not at all");
    return refused(
        out, fmt::format("{} positions with a standard deviation of {:.2g} m span {:.2g} m, which "
                         "gives the heading{}: take frames farther apart, or give headings",
                         out.positions, std::sqrt(moments.variance), moments.span, known));
  }
  const double angle = fit_angle(moments, measured.heading);
  const Matrix3d turn = Eigen::AngleAxisd(angle, Vector3d::UnitZ()).toRotationMatrix();
  const auto [rms, sigmas] = misfit(measured.matches, moments, turn);
  out.residual_rms = rms;
  if (sigmas > kMostSigmas) {
    return refused(out, fmt::format("the positions are {:.2g} m off the run's cameras (root mean "
                                    "square), {:.1f} standard deviations",
                                    rms, sigmas));
  }
  out.map_from_reference = SE3(Matrix3d(turn * level), moments.map - turn * moments.run);
  const double arm = moments.run.head<2>().norm();
  out.position_sigma = std::hypot(std::sqrt(moments.variance), out.heading_sigma * arm);
  if (std::isfinite(moments.height_variance)) {
    out.height_sigma = std::hypot(std::sqrt(moments.height_variance), surface.level_sigma * arm);
  }
  out.status = out.heading_sigma > kWeakHeading ? Status::kWeak : Status::kOk;
  if (out.status == Status::kWeak) {
    out.reason =
        fmt::format("the heading is known to {:.1f} degrees", out.heading_sigma * kDegrees);
  }
  return out;
}

void put_georeference(const Scene& scene, const RoadSurface& surface, RunDocument* run) {
  const GeoReference fit = fit_georeference(scene, *run, surface);
  if (fit.status == Status::kNotRun) return;
  nlohmann::json out = {{"status", to_string(fit.status)},
                        {"reason", fit.reason},
                        {"crs", fit.crs},
                        {"level", to_string(fit.level)},
                        {"positions", fit.positions},
                        {"heading_sigma_deg", number_json(fit.heading_sigma * kDegrees)},
                        {"residual_rms", number_json(fit.residual_rms)}};
  if (fit.known()) {
    out["map_from_reference"] = matrix_json(fit.map_from_reference.matrix());
    out["position_sigma"] = number_json(fit.position_sigma);
    out["height_sigma"] = number_json(fit.height_sigma);
  } else {
    run->warnings.push_back({"no_georeference", "no place on the map: " + fit.reason});
  }
  run->extra["georeference"] = std::move(out);
}

std::optional<GeoReference> georeference_of(const RunDocument& run,
                                            const std::filesystem::path& file) {
  const auto at = run.extra->find("georeference");
  if (at == run.extra->end()) return std::nullopt;
  JsonContext context;
  context.file = file.string() + ": georeference";
  JsonObject object(JsonCursor(*at, context), "an object");
  const auto matrix = object.find("map_from_reference");
  if (!matrix) return std::nullopt;
  GeoReference out;
  out.map_from_reference = matrix->pose();
  out.crs = object.require("crs", "a coordinate system").text();
  out.status =
      number_of(*at, "heading_sigma_deg") > kWeakHeading * kDegrees ? Status::kWeak : Status::kOk;
  out.position_sigma = number_of(*at, "position_sigma");
  out.height_sigma = number_of(*at, "height_sigma");
  out.heading_sigma = number_of(*at, "heading_sigma_deg") / kDegrees;
  out.residual_rms = number_of(*at, "residual_rms");
  if (const auto level = object.find("level"); level && level->text() == "gravity") {
    out.level = RoadSurface::Level::kGravity;
  }
  return out;
}

}  // namespace camber
