#include "camber/scale/ego_plane.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace camber {
namespace {

/// Robust plane through points: u = c + alpha b + beta a in a road frame.
Eigen::Vector3d robust_plane(const std::vector<Eigen::Vector3d>& abu, double noise) {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  std::vector<double> weight(abu.size(), 1.0);
  for (int iteration = 0; iteration < 6; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Identity() * 1e-9;
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < abu.size(); ++i) {
      const Eigen::Vector3d row(1.0, abu[i].y(), abu[i].x());
      normal += weight[i] * row * row.transpose();
      right += weight[i] * row * abu[i].z();
    }
    x = normal.ldlt().solve(right);
    for (std::size_t i = 0; i < abu.size(); ++i) {
      const double r = abu[i].z() - x.dot(Eigen::Vector3d(1.0, abu[i].y(), abu[i].x()));
      weight[i] = 1.0 / std::pow(1.0 + r * r / (noise * noise), 2);  // Geman and McClure
    }
  }
  return x;
}

/// Positions on one side of the camera, outwards, at least `reach` apart; the farthest if none is.
std::vector<Eigen::Vector3d> thinned(std::vector<Eigen::Vector3d> side, double reach) {
  std::sort(side.begin(), side.end(), [](const Eigen::Vector3d& p, const Eigen::Vector3d& q) {
    return std::abs(p.y()) < std::abs(q.y());
  });
  std::vector<Eigen::Vector3d> out;
  double last = 0.0;
  for (const Eigen::Vector3d& p : side) {
    if (std::abs(p.y()) - last < reach) continue;
    out.push_back(p);
    last = std::abs(p.y());
  }
  if (out.empty() && !side.empty()) out.push_back(side.back());
  return out;
}

}  // namespace

void EgoPlaneOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (!good) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) +
                                  ", expected " + expected);
    }
  };
  require(camera_height > 0, "camera_height", camera_height, "> 0");
  require(camera_height_sigma >= 0, "camera_height_sigma", camera_height_sigma, ">= 0");
  require(node_spacing > 0, "node_spacing", node_spacing, "> 0");
  require(reach > 8, "reach", reach, "> 8");
  require(half_width > 0, "half_width", half_width, "> 0");
  require(travel_sigma > 0, "travel_sigma", travel_sigma, "> 0");
  require(travel_reach > 0, "travel_reach", travel_reach, "> 0");
  require(curvature > 0, "curvature", curvature, "> 0");
  require(curvature_walk > 0, "curvature_walk", curvature_walk, "> 0");
  require(bank_walk > 0, "bank_walk", bank_walk, "> 0");
  require(roll_sigma > 0, "roll_sigma", roll_sigma, "> 0");
  require(surface_sigma > 0, "surface_sigma", surface_sigma, "> 0");
  require(correlation >= 1, "correlation", correlation, ">= 1");
  require(inflation >= 1, "inflation", inflation, ">= 1");
}

EgoPlane fit_ego_plane(const RoadPoints& road, const Eigen::Vector3d& travel,
                       const Eigen::Vector3d& up, const Eigen::MatrixXd& shared_covariance,
                       const EgoPlaneOptions& options) {
  options.validate();
  EgoPlane out;
  const auto fail = [&](const std::string& reason) {
    out.status = Status::kFailed;
    out.reason = reason;
    return out;
  };
  const std::size_t count = road.points.size();
  if (count < 30) {
    return fail("too few road points: " + std::to_string(count) + ", expected at least 30");
  }

  // Road frame: b along the direction of travel, u up, a to the right; origin in the camera.
  const Eigen::Vector3d forward = travel.normalized();
  Eigen::Vector3d upward = (up - up.dot(forward) * forward).normalized();
  Eigen::Vector3d rightward = forward.cross(upward);  // x right, y down, z forward: z x (-y) = x
  std::vector<Eigen::Vector3d> abu(count);
  const auto to_road_frame = [&] {
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d& p = road.points[i];
      abu[i] = {rightward.dot(p), forward.dot(p), upward.dot(p)};
    }
  };
  to_road_frame();

  // A first scale and roll from the nearest points. The road runs along the direction of travel
  // under the camera, so that near points lie about one camera height below the travelled line.
  std::vector<double> ahead;
  for (const Eigen::Vector3d& p : abu) {
    if (p.y() > 0 && p.z() < 0 && std::abs(p.x()) < p.y()) ahead.push_back(p.y());
  }
  if (ahead.size() < 30) return fail("too few road points ahead of and below the camera");
  std::sort(ahead.begin(), ahead.end());
  const double nearest = ahead[ahead.size() / 50];
  std::vector<double> below;
  for (const Eigen::Vector3d& p : abu) {
    if (p.y() > 0 && p.z() < 0 && std::abs(p.x()) < p.y() && p.y() < ahead[ahead.size() / 4]) {
      below.push_back(-p.z());
    }
  }
  std::nth_element(below.begin(), below.begin() + static_cast<std::ptrdiff_t>(below.size() / 2),
                   below.end());
  out.near_plane_height = below[below.size() / 2];
  double metres_per_unit = options.camera_height / out.near_plane_height;
  for (int round = 0; round < 4; ++round) {
    const double window = std::max(1.3 * nearest, nearest + 6.0 / metres_per_unit);
    std::vector<Eigen::Vector3d> near;
    for (const Eigen::Vector3d& p : abu) {
      if (p.y() > 0 && p.y() < window && std::abs(p.x()) < 0.6 * p.y() &&
          std::abs(p.z() + out.near_plane_height) < 0.5 * out.near_plane_height) {
        near.push_back(p);
      }
    }
    if (near.size() < 20) return fail("too few road points near the camera");
    const Eigen::Vector3d plane =
        robust_plane(near, (round == 0 ? 0.1 : 0.03) * out.near_plane_height);
    if (!(plane.x() < 0)) return fail("the nearest points do not lie below the camera");
    out.near_plane_height =
        -plane.x() / std::sqrt(1.0 + plane.y() * plane.y() + plane.z() * plane.z());
    metres_per_unit = options.camera_height / out.near_plane_height;
    // Turn the frame about the direction of travel to the road's cross slope.
    upward = (upward - plane.z() * rightward).normalized();
    rightward = forward.cross(upward);
    to_road_frame();
  }

  // Cross slope, in this frame, of a road on which the camera stands without roll.
  const Eigen::Vector3d level = (up - up.dot(forward) * forward).normalized();
  const double level_cross_slope = -rightward.dot(level) / upward.dot(level);

  // The camera's path in that frame: b ahead and behind, as far as roads bend evenly.
  constexpr double kShortestDistance = 0.02, kLongestDistance = 10.0;  // m, to either side
  std::vector<Eigen::Vector3d> path;
  double distance_behind = 0.0;
  for (const Eigen::Vector3d& p : road.camera_path) {
    const Eigen::Vector3d q(rightward.dot(p), forward.dot(p), upward.dot(p));
    const double distance = metres_per_unit * std::abs(q.y());
    if (!(distance > kShortestDistance) || !(distance < kLongestDistance) ||
        !(q.norm() < 1.2 * std::abs(q.y()))) {
      continue;
    }
    path.push_back(q);
    distance_behind = std::max(distance_behind, -1.25 * metres_per_unit * q.y());
  }

  // Profile in metres: nodes from at least one step behind the camera to the reach.
  const double step = options.node_spacing;
  const int foot = 1 + static_cast<int>(distance_behind / step);  // the node under the camera
  const int nodes = foot + static_cast<int>(std::ceil(options.reach / step)) + 1;
  const auto size = static_cast<Eigen::Index>(2 * nodes);  // heights, then cross slopes
  Eigen::VectorXd x = Eigen::VectorXd::Zero(size);
  x.head(nodes).setConstant(-options.camera_height);
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd shared;
  std::vector<double> weight(count, 1.0);
  int used = 0;
  double seen_from = 0.0;
  const Eigen::Index columns = road.shared_jacobian.cols();
  constexpr int kRounds = 12;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(size);
    Eigen::MatrixXd shared_right = Eigen::MatrixXd::Zero(size, columns);
    const bool last = round + 1 == kRounds;
    used = 0;
    seen_from = options.reach;
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3d p = metres_per_unit * abu[i];
      const double at = p.y() / step + foot;
      if (!(p.y() > 1.0) || at >= nodes - 1 || std::abs(p.x()) > options.half_width) continue;
      const int j = static_cast<int>(at);
      const double f = at - j;
      const double row[4] = {1 - f, f, (1 - f) * p.x(), f * p.x()};
      const Eigen::Index index[4] = {j, j + 1, nodes + j, nodes + j + 1};
      double predicted = 0.0;
      for (int k = 0; k < 4; ++k) predicted += row[k] * x[index[k]];
      const double slope = (x[j + 1] - x[j]) / step;
      // A change of the distance by a share e lifts the point off the profile by e (u - slope b).
      const double lever = p.z() - slope * p.y() - x[nodes + j] * p.x();
      const double sigma = std::sqrt(std::pow(lever * road.relative_sigma[i], 2) +
                                     options.surface_sigma * options.surface_sigma);
      const double residual = p.z() - predicted;
      if (round > 0) weight[i] = 1.0 / std::pow(1.0 + residual * residual / (9 * sigma * sigma), 2);
      const double w = weight[i] / (options.correlation * sigma * sigma);
      for (int m = 0; m < 4; ++m) {
        for (int k = 0; k < 4; ++k) normal(index[m], index[k]) += w * row[m] * row[k];
        right[index[m]] += w * row[m] * p.z();
        if (last && columns > 0) {
          shared_right.row(index[m]) +=
              w * row[m] * lever *
              road.shared_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>();
        }
      }
      if (weight[i] > 0.25) {
        ++used;
        seen_from = std::min(seen_from, p.y());
      }
    }
    if (used < 30) {
      return fail(fmt::format("too few road points within {:g} m ahead: {}", options.reach, used));
    }
    const auto add_prior = [&](const std::vector<std::pair<int, double>>& terms, double mean,
                               double sigma) {
      for (const auto& [j, cj] : terms) {
        for (const auto& [k, ck] : terms) normal(j, k) += cj * ck / (sigma * sigma);
        right[j] += cj * mean / (sigma * sigma);
      }
    };
    if (path.empty()) {
      add_prior({{foot - 1, -0.5 / step}, {foot + 1, 0.5 / step}}, 0.0, options.travel_sigma);
    }
    for (const double side : {-1.0, 1.0}) {
      std::vector<Eigen::Vector3d> positions;
      for (const Eigen::Vector3d& p : path) {
        if (side * p.y() > 0) positions.push_back(metres_per_unit * p);
      }
      // The road below the camera at a position: where, and how high against the camera's height.
      struct Foot {
        double ahead, right, up;
      };
      const auto foot_below = [&](const Eigen::Vector3d& p) {
        const double at = std::clamp(p.y() / step + foot, 0.5, nodes - 1.5);
        const int j = std::clamp(static_cast<int>(std::lround(at)), 1, nodes - 2);
        const double slope = (x[j + 1] - x[j - 1]) / (2 * step), cross = x[nodes + j];
        const double h = options.camera_height / std::sqrt(1 + slope * slope + cross * cross);
        return Foot{p.y() + h * slope, p.x() + h * cross, p.z() + options.camera_height - h};
      };
      Foot last_foot = foot_below(Eigen::Vector3d::Zero());
      for (const Eigen::Vector3d& p : thinned(positions, options.travel_reach)) {
        const Foot next = foot_below(p);
        std::vector<std::pair<int, double>> terms;
        for (const auto& [f, sign] : {std::pair(last_foot, -1.0), std::pair(next, 1.0)}) {
          const double at = std::clamp(f.ahead / step + foot, 0.0, nodes - 1.001);
          const int j = static_cast<int>(at);
          const double share = at - j;
          terms.insert(terms.end(), {{j, sign * (1 - share)},
                                     {j + 1, sign * share},
                                     {nodes + j, sign * (1 - share) * f.right},
                                     {nodes + j + 1, sign * share * f.right}});
        }
        const double apart = std::abs(next.ahead - last_foot.ahead);
        add_prior(terms, next.up - last_foot.up,
                  std::sqrt(2.0) * options.travel_sigma *
                      std::sqrt(apart * std::min(apart, options.travel_reach)));
        last_foot = next;
      }
    }
    const double walk = options.curvature_walk * std::sqrt(step);
    for (int j = 0; j + 2 < nodes; ++j) {
      add_prior({{j, 1 / (step * step)}, {j + 1, -2 / (step * step)}, {j + 2, 1 / (step * step)}},
                0.0, options.curvature * std::sqrt((nodes - foot + 1) / 4.0));
      if (j + 3 < nodes) {
        const double s2 = step * step;
        add_prior({{j, -1 / s2}, {j + 1, 3 / s2}, {j + 2, -3 / s2}, {j + 3, 1 / s2}}, 0.0, walk);
      }
    }
    for (int j = 0; j + 1 < nodes; ++j) {
      add_prior({{nodes + j, -1.0}, {nodes + j + 1, 1.0}}, 0.0,
                options.bank_walk * std::sqrt(step));
    }
    add_prior({{nodes + foot, 1.0}}, level_cross_slope, options.roll_sigma);
    normal.diagonal().array() += 1e-8;
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(normal);
    x = ldlt.solve(right);
    if (last) {
      covariance = ldlt.solve(Eigen::MatrixXd::Identity(size, size));
      if (columns > 0) shared = ldlt.solve(shared_right);
    } else if (x[foot] < 0) {
      // New scale: the profile passes camera_height below the camera along its normal.
      const double slope = (x[foot + 1] - x[foot - 1]) / (2 * step), cross = x[nodes + foot];
      const double height = -x[foot] / std::sqrt(1.0 + slope * slope + cross * cross);
      const double change = std::clamp(options.camera_height / height, 0.8, 1.25);
      metres_per_unit *= change;
      x *= change;
    }
  }
  if (!(x[foot] < 0)) return fail("the road ahead does not pass below the camera");
  covariance *= options.inflation;
  if (columns > 0 && shared_covariance.size() > 0) {
    covariance += shared * shared_covariance * shared.transpose();
  }

  // Tangent plane under the camera.
  const double slope = (x[foot + 1] - x[foot - 1]) / (2 * step), cross = x[nodes + foot];
  const Eigen::Vector3d normal_vector = (upward - slope * forward - cross * rightward).normalized();
  const Eigen::Vector3d foot_on_axis = upward * (x[foot] / metres_per_unit);
  Plane plane = Plane::through(foot_on_axis, normal_vector);
  out.height = plane.offset;
  out.metres_per_unit = options.camera_height / out.height;
  out.plane.plane = plane;
  out.plane.centroid = plane.foot(Eigen::Vector3d::Zero());
  UncertainPlane::make_axes(normal_vector, forward, &out.plane.axis1, &out.plane.axis2);
  // axis1 is forward, axis2 = n x axis1 is to the left; a tilt about axis1 is a change of the cross
  // slope, a tilt about axis2 one of the slope (see UncertainPlane: h + a axis2.r - b axis1.r).
  Eigen::MatrixXd functional = Eigen::MatrixXd::Zero(3, size);
  functional(0, nodes + foot) = -1.0;
  functional(1, foot + 1) = -0.5 / step;
  functional(1, foot - 1) = 0.5 / step;
  functional(2, foot) = 1.0 / metres_per_unit;
  out.plane.covariance = functional * covariance * functional.transpose();
  if (columns > 0) out.by_shared = functional * shared;
  const double height_share = options.camera_height_sigma / options.camera_height;
  out.relative_sigma = std::sqrt(out.plane.covariance(2, 2) / (out.height * out.height) +
                                 height_share * height_share);
  for (int j = foot; j < nodes; ++j) {
    out.line.push_back((forward * ((j - foot) * step) + upward * x[j]) / metres_per_unit);
  }
  out.points = used;
  out.status = out.relative_sigma < 0.08 ? Status::kOk : Status::kWeak;
  if (out.status == Status::kWeak) {
    out.reason = "the height of the camera over the road is known to " +
                 std::to_string(static_cast<int>(std::lround(100 * out.relative_sigma))) + " %";
  }
  return out;
}

}  // namespace camber
