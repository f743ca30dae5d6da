#include "camber/pipeline/width_statements.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "camber/pipeline/iterated_update.h"

namespace camber {
namespace {

constexpr double kGate = 3.0;           // standard deviations
constexpr double kNearest = 5.0;        // m
constexpr double kFarthest = 75.0;      // m
constexpr double kRatio = 1.13;         // of the distances of two places
constexpr double kReach = 0.06;         // of its distance, of rows that tell of one place
constexpr double kWalk = 0.01;          // of the width's logarithm over kWalkLength
constexpr double kWalkLength = 10.0;    // m
constexpr double kEdge = 0.02;          // m, by which one edge is off its place
constexpr double kOtherEdge = 0.12;     // m, the same from one side of a gap to the other
constexpr double kUneven = 0.02;        // m, of the ground at an edge off the field
constexpr double kPixel = 0.25;         // px, that all rows of a place share
constexpr double kRowsThatShare = 4.0;  // neighbouring rows with one error

/// A border around one row: a line through its pixels there.
struct Piece {
  double row = 0.0, column = 0.0, lean = 0.0;
  double sigma = 0.0;  // px, of the column
};

/// One side's border with its points on the ground.
class Side {
 public:
  Side(const GroundField& field, const PinholeCamera& camera, double metres_per_unit,
       const std::vector<BorderPixel>& pixels)
      : pixels_(pixels) {
    int run = 0;
    for (const BorderPixel& p : pixels) {
      const Eigen::Vector2d at(p.column, p.row);
      const double rho = field.inverse_depth(at);
      points_.push_back(rho > metres_per_unit / 150.0
                            ? Eigen::Vector3d(metres_per_unit / rho * camera.ray(at))
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
    out.sigma = std::sqrt(kRowsThatShare * variance * inverse(0, 0) + kPixel * kPixel);
    return out;
  }

 private:
  const std::vector<BorderPixel>& pixels_;
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

std::vector<Place> find_places(const Side& left, const Side& right) {
  std::vector<Place> out;
  double wanted = kNearest;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const double z = left.point(i).z();
    if (!(z >= wanted) || !(z < kFarthest)) continue;
    const auto along = left.direction(i);
    if (!along) continue;
    // The right border's pixel across the road from this one.
    std::optional<std::size_t> across;
    for (std::size_t j = 1; j < right.size(); ++j) {
      if (right.run(j) != right.run(j - 1)) continue;
      const double before = (right.point(j - 1) - left.point(i)).dot(*along);
      const double after = (right.point(j) - left.point(i)).dot(*along);
      if (before * after <= 0 && std::abs(after - before) < 8.0) {
        across = std::abs(before) < std::abs(after) ? j - 1 : j;
        break;
      }
    }
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

class Solver {
 public:
  Solver(const GroundField& field, const PinholeCamera& camera, double metres_per_unit,
         const std::vector<Place>& places, const Eigen::MatrixXd& shared_covariance,
         double inflation, double scale_sigma)
      : camera_(camera), metres_per_unit_(metres_per_unit), places_(places) {
    for (const Place& place : places) {
      pixels_.push_back(place.left);
      pixels_.push_back(place.right);
    }
    const auto n = static_cast<Eigen::Index>(pixels_.size());
    start_.resize(n);
    slope_.resize(n);
    height_.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Vector2d& p = pixels_[static_cast<std::size_t>(i)];
      start_[i] = field.inverse_depth(p);
      const Eigen::Vector2d du(4, 0), dv(0, 2);
      const double by_u = (field.inverse_depth(p + du) - field.inverse_depth(p - du)) / 8.0;
      const double by_v = (field.inverse_depth(p + dv) - field.inverse_depth(p - dv)) / 4.0;
      slope_[i] = by_u;
      const Eigen::Vector3d plane(
          by_u * camera.fx, by_v * camera.fy,
          start_[i] - by_u * (p.x() - camera.cx) - by_v * (p.y() - camera.cy));
      height_[i] = std::max(0.3, metres_per_unit / plane.norm());
    }
    prior_ = field.metric_covariance(pixels_, shared_covariance, inflation, scale_sigma);
  }

  const std::vector<Eigen::Vector2d>& pixels() const { return pixels_; }
  const Eigen::VectorXd& start() const { return start_; }
  const Eigen::MatrixXd& prior() const { return prior_; }

  double width(const Eigen::VectorXd& x, std::size_t place) const {
    return across(x, place).norm();
  }

  /// Two places whose widths are compared: log(width of `far`) - log(width of `near`).
  struct Change {
    std::size_t near, far;
    double variance;  // of the road's own change and of another edge beyond a gap
  };
  Change change(std::size_t near, std::size_t far) const {
    const Place &a = places_[near], &b = places_[far];
    double variance = kWalk * kWalk * std::abs(b.distance - a.distance) / kWalkLength;
    const double gap = kOtherEdge / width(start_, near);
    variance += (a.run_left != b.run_left ? gap * gap : 0.0) +
                (a.run_right != b.run_right ? gap * gap : 0.0);
    return {near, far, variance};
  }

  using Stack = internal::StatementStack;
  Stack stack(const Eigen::VectorXd& x, const std::vector<Change>& changes) const {
    const auto n = static_cast<Eigen::Index>(changes.size());
    Stack out;
    out.by_field = Eigen::MatrixXd::Zero(n, start_.size());
    out.missing.resize(n);
    Eigen::MatrixXd by_edge = Eigen::MatrixXd::Zero(n, 3 * start_.size());
    for (Eigen::Index k = 0; k < n; ++k) {
      const Change& c = changes[static_cast<std::size_t>(k)];
      out.missing[k] = std::log(width(x, c.near)) - std::log(width(x, c.far));
      for (const auto& [place, sign] : {std::pair{c.near, -1.0}, std::pair{c.far, 1.0}}) {
        const Eigen::Vector3d w = across(x, place);
        const Eigen::Vector3d unit = w / w.squaredNorm();  // d log(width) / d(point)
        for (int edge = 0; edge < 2; ++edge) {
          const auto i = static_cast<Eigen::Index>(2 * place) + edge;
          const double s = edge == 0 ? -sign : sign;
          const Eigen::Vector3d p = point(x, i);
          const double by_depth = -s * unit.dot(p) / x[i];
          out.by_field(k, i) += by_depth;
          const Place& at = places_[place];
          const Eigen::Vector3d du(p.z() / camera_.fx, 0, 0);
          by_edge(k, 3 * i) += (edge == 0 ? at.sigma_left : at.sigma_right) * s *
                               unit.dot(du - p * (slope_[i] / x[i]));
          by_edge(k, 3 * i + 1) += s * kEdge * unit.norm();
          by_edge(k, 3 * i + 2) += by_depth * x[i] * kUneven / height_[i];
        }
      }
    }
    out.noise = by_edge * by_edge.transpose();
    for (Eigen::Index k = 0; k < n; ++k) {
      out.noise(k, k) += changes[static_cast<std::size_t>(k)].variance;
    }
    return out;
  }

  /// Iterated Kalman update of the inverse depths at the edges.
  void solve(const std::vector<Change>& changes, Eigen::VectorXd* x,
             Eigen::MatrixXd* covariance) const {
    internal::iterated_update(
        start_, prior_, [&](const Eigen::VectorXd& at) { return stack(at, changes); }, x,
        covariance);
  }

 private:
  Eigen::Vector3d point(const Eigen::VectorXd& x, Eigen::Index i) const {
    return metres_per_unit_ / x[i] * camera_.ray(pixels_[static_cast<std::size_t>(i)]);
  }
  Eigen::Vector3d across(const Eigen::VectorXd& x, std::size_t place) const {
    const auto i = static_cast<Eigen::Index>(2 * place);
    return point(x, i + 1) - point(x, i);
  }

  const PinholeCamera& camera_;
  double metres_per_unit_;
  const std::vector<Place>& places_;
  std::vector<Eigen::Vector2d> pixels_;
  Eigen::VectorXd start_, slope_, height_;  // slope: d(inverse depth) / d(column)
  Eigen::MatrixXd prior_;
};

}  // namespace

WidthStatements width_statements(const GroundField& field, const PinholeCamera& camera,
                                 const RoadBorders& borders, double metres_per_unit,
                                 double scale_sigma, const Eigen::MatrixXd& shared_covariance,
                                 double inflation) {
  WidthStatements out;
  if (borders.left.empty() || borders.right.empty()) {
    out.reason = "the road's borders are not seen";
    return out;
  }
  const Side left(field, camera, metres_per_unit, borders.left);
  const Side right(field, camera, metres_per_unit, borders.right);
  const std::vector<Place> places = find_places(left, right);
  if (places.size() < 2) {
    out.reason = "both borders are seen at one distance at most";
    return out;
  }
  const Solver solver(field, camera, metres_per_unit, places, shared_covariance, inflation,
                      scale_sigma);
  // From near to far each place goes to the chain whose last width it fits best: the farther away
  // the more widths fit, and a bay or a border taken for another must not pass for a hill.
  struct Chain {
    std::vector<Solver::Change> changes;
    Eigen::VectorXd x;
    Eigen::MatrixXd covariance;
    std::size_t last;
  };
  std::vector<Chain> chains;
  for (std::size_t next = 0; next < places.size(); ++next) {
    Chain* best = nullptr;
    double least = kGate * kGate;
    for (Chain& chain : chains) {
      const Solver::Stack s = solver.stack(chain.x, {solver.change(chain.last, next)});
      const double variance =
          (s.by_field * chain.covariance * s.by_field.transpose() + s.noise)(0, 0);
      const double off = s.missing[0] * s.missing[0] / variance;
      if (off < least) {
        least = off;
        best = &chain;
      }
    }
    if (!best) {
      chains.push_back({{}, solver.start(), solver.prior(), next});
      continue;
    }
    best->changes.push_back(solver.change(best->last, next));
    best->last = next;
    solver.solve(best->changes, &best->x, &best->covariance);
  }
  const Chain& longest = *std::max_element(
      chains.begin(), chains.end(),
      [](const Chain& a, const Chain& b) { return a.changes.size() < b.changes.size(); });
  const std::vector<Solver::Change>& accepted = longest.changes;
  const Eigen::VectorXd& x = longest.x;
  out.refused = static_cast<int>(places.size() - 1 - accepted.size());
  if (accepted.empty() || out.refused > static_cast<int>(accepted.size())) {
    out.reason = "the widths at most distances contradict each other";
    return out;
  }
  out.places = static_cast<int>(accepted.size()) + 1;
  out.width = solver.width(x, accepted.front().near);
  out.farthest = places[accepted.back().far].distance;
  const Solver::Stack before = solver.stack(solver.start(), accepted);
  const Solver::Stack s = solver.stack(x, accepted);
  const auto mean_square = [&](const Solver::Stack& at, const Eigen::MatrixXd& covariance) {
    return at.missing.dot(covariance.ldlt().solve(at.missing)) /
           static_cast<double>(accepted.size());
  };
  out.misfit_before = mean_square(
      before, before.by_field * solver.prior() * before.by_field.transpose() + before.noise);
  out.misfit_after = mean_square(s, s.noise);
  out.statements.pixels = solver.pixels();
  out.statements.coefficients = s.by_field;
  out.statements.values = s.missing + s.by_field * (x - solver.start());
  out.statements.noise = s.noise;
  return out;
}

}  // namespace camber
