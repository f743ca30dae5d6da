#include "camber/scale/road_width_constraint.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "camber/scale/detail/length_measurements.h"

namespace camber {
namespace {

using detail::GroundAtPixels;
using detail::LinearisedLengths;
using detail::UpdatedDepths;

constexpr double kNearest = 5.0;    // m
constexpr double kFarthest = 75.0;  // m
constexpr double kRatio = 1.13;     // of the distances of two places
constexpr double kReach = 0.06;     // of its distance, of rows that belong to one place

/// An edge around one row: a line through its pixels there.
struct Piece {
  double row = 0.0, column = 0.0, lean = 0.0;
  double sigma = 0.0;  // px, of the column
};

/// One side's edge with its points on the ground.
class Side {
 public:
  Side(const RoadPosterior& road, const PinholeCamera& camera,
       const std::vector<RoadEdgePixel>& pixels, const ScaleNoise& noise)
      : pixels_(pixels), noise_(noise) {
    int run = 0;
    for (const RoadEdgePixel& p : pixels) {
      const Eigen::Vector2d at(p.column, p.row);
      const double rho = road.inverse_depth(at);
      points_.push_back(rho > 1.0 / 150.0 ? Eigen::Vector3d(camera.ray(at) / rho)
                                          : Eigen::Vector3d::Constant(1e6));
      if (!p.continues) ++run;
      runs_.push_back(run);
    }
  }

  std::size_t size() const { return pixels_.size(); }
  const Eigen::Vector3d& point(std::size_t i) const { return points_[i]; }
  int run(std::size_t i) const { return runs_[i]; }
  int row(std::size_t i) const { return pixels_[i].row; }

  /// Pixels of one run whose depth differs little from that of pixel i.
  std::pair<std::size_t, std::size_t> around(std::size_t i) const {
    std::size_t a = i, b = i;
    const double z = points_[i].z();
    const auto near = [&](std::size_t k) {
      return runs_[k] == runs_[i] && std::abs(points_[k].z() - z) < kReach * z;
    };
    while (a > 0 && near(a - 1)) --a;
    while (b + 1 < size() && near(b + 1)) ++b;
    return {a, b};
  }

  std::optional<Eigen::Vector3d> direction(std::size_t i) const {
    const auto [a, b] = around(i);
    const Eigen::Vector3d d = points_[b] - points_[a];
    if (b < a + 2 || !(d.norm() > 0.3)) return std::nullopt;
    return d.normalized();
  }

  std::optional<Piece> piece(std::size_t i) const {
    const auto [a, b] = around(i);
    if (b < a + 2) return std::nullopt;
    Piece out;
    out.row = pixels_[i].row;
    std::vector<double> weight(b - a + 1, 1.0);
    Eigen::Vector2d x = Eigen::Vector2d::Zero();
    Eigen::Matrix2d inverse;
    double sum = 0.0, squares = 0.0;
    for (int round = 0; round < 4; ++round) {
      Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
      Eigen::Vector2d side = Eigen::Vector2d::Zero();
      for (std::size_t k = a; k <= b; ++k) {
        const Eigen::Vector2d basis(1.0, pixels_[k].row - out.row);
        normal += weight[k - a] * basis * basis.transpose();
        side += weight[k - a] * pixels_[k].column * basis;
      }
      inverse = normal.inverse();
      x = inverse * side;
      sum = squares = 0.0;
      for (std::size_t k = a; k <= b; ++k) {
        const double off = pixels_[k].column - x[0] - x[1] * (pixels_[k].row - out.row);
        weight[k - a] = 1.0 / (1.0 + off * off);
        sum += weight[k - a];
        squares += weight[k - a] * off * off;
      }
    }
    if (!(sum > 0.5 * static_cast<double>(b - a + 1))) return std::nullopt;
    out.column = x[0];
    out.lean = x[1];
    const double variance = std::max(0.25, squares / sum);
    out.sigma = std::sqrt(noise_.rows_with_one_error * variance * inverse(0, 0) +
                          noise_.edge_column_px * noise_.edge_column_px);
    return out;
  }

 private:
  const std::vector<RoadEdgePixel>& pixels_;
  const ScaleNoise& noise_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<int> runs_;
};

/// The road's width at one place: two pixels across it.
struct Place {
  Eigen::Vector2d left, right;
  double sigma_left = 0.0, sigma_right = 0.0;  // px
  double distance = 0.0;                       // m
  int run_left = 0, run_right = 0;
};

/// The pixel of a side that lies across the road from a point.
std::optional<std::size_t> pixel_across(const Side& side, const Eigen::Vector3d& from,
                                        const Eigen::Vector3d& along) {
  for (std::size_t j = 1; j < side.size(); ++j) {
    if (side.run(j) != side.run(j - 1)) continue;
    const double before = (side.point(j - 1) - from).dot(along);
    const double after = (side.point(j) - from).dot(along);
    if (before * after <= 0 && std::abs(after - before) < 8.0) {
      return std::abs(before) < std::abs(after) ? j - 1 : j;
    }
  }
  return std::nullopt;
}

std::vector<Place> find_places(const Side& left, const Side& right) {
  std::vector<Place> out;
  double wanted = kNearest;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double z = left.point(i).z();
    if (!(z >= wanted) || !(z < kFarthest)) continue;
    const auto along = left.direction(i);
    if (!along) continue;
    const std::optional<std::size_t> across = pixel_across(right, left.point(i), *along);
    if (!across) continue;
    const auto other = right.direction(*across);
    // Sides that part or meet are no width.
    if (!other || !(along->dot(*other) > std::cos(0.15))) continue;
    const auto l = left.piece(i), r = right.piece(*across);
    if (!l || !r) continue;
    const double width = (right.point(*across) - left.point(i)).norm();
    if (!(width > 2.5) || !(width < 30.0)) continue;
    out.push_back({{l->column, l->row},
                   {r->column, r->row},
                   l->sigma,
                   r->sigma,
                   0.5 * (left.point(i) + right.point(*across)).norm(),
                   left.run(i),
                   right.run(*across)});
    wanted = kRatio * z;
  }
  return out;
}

/// Two places whose widths are compared: log(width of `far`) - log(width of `near`).
struct WidthChange {
  std::size_t near, far;
  double variance;  // of the road's own change and of another edge beyond a gap
};

/// The widths at all places as functions of the inverse depths at their edges, left and right in
/// turn.
class Widths {
 public:
  Widths(const RoadPosterior& road, const PinholeCamera& camera, const std::vector<Place>& places,
         const ScaleNoise& noise)
      : camera_(camera), places_(places), noise_(noise), ground_(road, camera, pixels_of(places)) {
    height_.resize(ground_.size());
    for (Eigen::Index i = 0; i < ground_.size(); ++i) {
      const Eigen::Vector2d& p = ground_.pixels[static_cast<std::size_t>(i)];
      const double by_u = ground_.by_pixel(i, 0), by_v = ground_.by_pixel(i, 1);
      const Eigen::Vector3d plane(
          by_u * camera.fx, by_v * camera.fy,
          ground_.mean[i] - by_u * (p.x() - camera.cx) - by_v * (p.y() - camera.cy));
      height_[i] = std::max(0.3, 1.0 / plane.norm());
    }
  }

  const GroundAtPixels& ground() const { return ground_; }

  double width(const Eigen::VectorXd& x, std::size_t place) const {
    return across(x, place).norm();
  }

  WidthChange change(std::size_t near, std::size_t far) const {
    const Place &a = places_[near], &b = places_[far];
    double variance = noise_.width_walk * noise_.width_walk * std::abs(b.distance - a.distance) /
                      noise_.width_walk_length;
    const double gap = noise_.other_road_edge / width(ground_.mean, near);
    variance += (a.run_left != b.run_left ? gap * gap : 0.0) +
                (a.run_right != b.run_right ? gap * gap : 0.0);
    return {near, far, variance};
  }

  LinearisedLengths linearise(const Eigen::VectorXd& x,
                              const std::vector<WidthChange>& changes) const {
    const auto n = static_cast<Eigen::Index>(changes.size());
    LinearisedLengths out;
    out.by_inverse_depth = Eigen::MatrixXd::Zero(n, ground_.size());
    out.residual.resize(n);
    // By the edges' columns, places on the ground and the ground's unevenness, standard deviations.
    Eigen::MatrixXd by_error = Eigen::MatrixXd::Zero(n, 3 * ground_.size());
    for (Eigen::Index k = 0; k < n; ++k) {
      const WidthChange& c = changes[static_cast<std::size_t>(k)];
      out.residual[k] = std::log(width(x, c.near)) - std::log(width(x, c.far));
      add_place(x, c.near, -1.0, k, &out.by_inverse_depth, &by_error);
      add_place(x, c.far, 1.0, k, &out.by_inverse_depth, &by_error);
    }
    out.covariance = by_error * by_error.transpose();
    for (Eigen::Index k = 0; k < n; ++k) {
      out.covariance(k, k) += changes[static_cast<std::size_t>(k)].variance;
    }
    return out;
  }

  UpdatedDepths update(const std::vector<WidthChange>& changes) const {
    return detail::updated(ground_,
                           [&](const Eigen::VectorXd& x) { return linearise(x, changes); });
  }

 private:
  static std::vector<Eigen::Vector2d> pixels_of(const std::vector<Place>& places) {
    std::vector<Eigen::Vector2d> out;
    for (const Place& place : places) {
      out.push_back(place.left);
      out.push_back(place.right);
    }
    return out;
  }

  Eigen::Vector3d across(const Eigen::VectorXd& x, std::size_t place) const {
    const auto i = static_cast<Eigen::Index>(2 * place);
    return ground_.point(x, i + 1) - ground_.point(x, i);
  }

  /// Derivatives of one place's log width, times `sign`, in row k.
  void add_place(const Eigen::VectorXd& x, std::size_t place, double sign, Eigen::Index k,
                 Eigen::MatrixXd* by_inverse_depth, Eigen::MatrixXd* by_error) const {
    const Place& at = places_[place];
    const Eigen::Vector3d w = across(x, place);
    const Eigen::Vector3d by_point = w / w.squaredNorm();  // d log(width) / d(right point)
    for (int edge = 0; edge < 2; ++edge) {
      const auto i = static_cast<Eigen::Index>(2 * place) + edge;
      const double s = edge == 0 ? -sign : sign;
      const Eigen::Vector3d p = ground_.point(x, i);
      const double by_depth = -s * by_point.dot(p) / x[i];
      (*by_inverse_depth)(k, i) += by_depth;
      const Eigen::Vector3d du(p.z() / camera_.fx, 0, 0);
      (*by_error)(k, 3 * i) += (edge == 0 ? at.sigma_left : at.sigma_right) * s *
                               by_point.dot(du - p * (ground_.by_pixel(i, 0) / x[i]));
      (*by_error)(k, 3 * i + 1) += s * noise_.road_edge * by_point.norm();
      (*by_error)(k, 3 * i + 2) += by_depth * x[i] * noise_.road_edge / height_[i];
    }
  }

  const PinholeCamera& camera_;
  const std::vector<Place>& places_;
  const ScaleNoise& noise_;
  GroundAtPixels ground_;
  Eigen::VectorXd height_;  // m, of the camera over the ground's tangent plane at each pixel
};

/// Places of like width, from near to far, and the inverse depths that they leave.
struct Chain {
  std::vector<WidthChange> changes;
  UpdatedDepths depths;
  std::size_t last;
};

/// From near to far each place goes to the chain whose last width it fits best: the farther away
/// the more widths fit, and a bay or an edge taken for another must not pass for a hill.
Chain longest_chain(const Widths& widths, std::size_t places, double gate) {
  std::vector<Chain> chains;
  for (std::size_t next = 0; next < places; ++next) {
    Chain* best = nullptr;
    double least = gate * gate;
    for (Chain& chain : chains) {
      const LinearisedLengths l =
          widths.linearise(chain.depths.mean, {widths.change(chain.last, next)});
      const double squared = detail::mean_squared_innovation(l, chain.depths.covariance);
      if (squared < least) {
        least = squared;
        best = &chain;
      }
    }
    if (!best) {
      chains.push_back({{}, {widths.ground().mean, widths.ground().covariance}, next});
      continue;
    }
    best->changes.push_back(widths.change(best->last, next));
    best->last = next;
    best->depths = widths.update(best->changes);
  }
  return *std::max_element(chains.begin(), chains.end(), [](const Chain& a, const Chain& b) {
    return a.changes.size() < b.changes.size();
  });
}

}  // namespace

RoadWidthConstraint road_width_constraint(const RoadPosterior& road, const PinholeCamera& camera,
                                          const RoadEdges& edges, const ScaleNoise& noise) {
  RoadWidthConstraint out;
  out.constraint.name = "road_width";
  if (edges.left.empty() || edges.right.empty()) {
    out.reason = "the road's borders are not seen";
    return out;
  }
  const Side left(road, camera, edges.left, noise), right(road, camera, edges.right, noise);
  const std::vector<Place> places = find_places(left, right);
  if (places.size() < 2) {
    out.reason = "both borders are seen at one distance at most";
    return out;
  }
  const Widths widths(road, camera, places, noise);
  const Chain chain = longest_chain(widths, places.size(), noise.gate);
  const std::vector<WidthChange>& accepted = chain.changes;
  out.rejected = static_cast<int>(places.size() - 1 - accepted.size());
  if (accepted.empty() || out.rejected > static_cast<int>(accepted.size())) {
    out.reason = "the widths at most distances contradict each other";
    return out;
  }
  const Eigen::VectorXd& solution = chain.depths.mean;
  out.places = static_cast<int>(accepted.size()) + 1;
  out.width = widths.width(solution, accepted.front().near);
  out.farthest = places[accepted.back().far].distance;
  detail::SolvedLengths at_solution = detail::solved(
      widths.ground(), [&](const Eigen::VectorXd& x) { return widths.linearise(x, accepted); },
      solution);
  at_solution.constraint.name = out.constraint.name;
  out.constraint = std::move(at_solution.constraint);
  out.misfit_before = at_solution.misfit_before;
  out.misfit_after = at_solution.misfit_after;
  out.constraint.source = fmt::format("width of {:.1f} m at {} places to {:.0f} m", out.width,
                                      out.places, out.farthest);
  return out;
}

}  // namespace camber
